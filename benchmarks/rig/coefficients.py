"""ARKit's coefficients against the truth of rendered people who were not trained on, and against MediaPipe's.

Correlations over the frames of a clip, averaged over people: of talk2, calibrated on talk by its true controls, by
stills of the person (`stills`), or not at all.  The renderer's controls are put in ARKit's terms by
`training.arkit_shapes.UNIT_SHAPES`.  Curves are smoothed as `guise rig from-video` does it.  One that does not move
in a clip is left out.  `--work` keeps what was seen of each clip.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from guise.aam.landmarks import FaceTracker
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.rig.calibration import Calibrator, fit_map
from guise.aam.rig.coefficients import LOOKS, TOLD, Rest, RigCalibration, RigEstimator, shipped, smoothed
from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, INDEX
from guise.app.media import open_input
from guise.common.arrays import F32, F64
from training.arkit_shapes import UNIT_SHAPES

NAME, TITLE = "rig.coefficients", "ARKit's coefficients"
MOVES = 0.05  # standard deviation of a curve that moves
NAMES = [*(ARKIT_NAMES[k] for k in TOLD), *LOOKS]
CURVES: Mapping[str, tuple[str, ...]] = {
    "blink": ("eyeBlinkLeft", "eyeBlinkRight"), "smile": ("mouthSmileLeft", "mouthSmileRight"), "jaw": ("jawOpen",),
    "pucker": ("mouthPucker",), "brows up": ("browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    "brows down": ("browDownLeft", "browDownRight"), "gaze": LOOKS, "gaze, across": LOOKS[:1], "gaze, up": LOOKS[1:],
}  # fmt: skip
TARGETS = {
    "blink": 0.95,
    "smile": 0.97,
    "jaw": 0.95,
    "pucker": 0.85,
    "brows up": 0.85,
    "brows down": 0.75,
    "gaze": 0.9,
}
STILLS = {"neutral": "rest", "smile": "smile", "surprise": "brows", "open": "jaw"}
UNCALIBRATED = 0.9  # share of a target that is to be reached without calibration
WHOLE_MEDIAPIPE = 0.85
TRAINED_ON = ("grid_", "gesture_")
MOST_MS = 2.0


@dataclass(frozen=True, eq=False)
class Seen:
    """What was seen of a clip: components (t, k), NaN where there was no face, when, and milliseconds a frame."""

    components: F32
    seconds: F64
    milliseconds: float


def look(video: Path, keep: Path | None) -> Seen:
    """What the estimator sees of a clip, with the built-in landmarker's points."""
    file = None if keep is None else keep / f"{video.parent.name}_{video.stem}.npz"
    if file is not None and file.is_file():
        with np.load(file) as stored:
            return Seen(stored["components"], stored["seconds"], float(stored["milliseconds"]))
    tracker, estimator = FaceTracker(BuiltinLandmarker(turned=())), RigEstimator()
    rows: list[F32 | None] = []
    seconds, spent = list[float](), 0.0
    with open_input(video) as source:
        for frame in source:
            rgb = frame.rgb()
            seconds.append(float(frame.seconds))
            face = tracker.update(rgb)
            began = time.process_time()
            rows.append(None if face is None else estimator.components(rgb, face.points)[0])
            spent += time.process_time() - began
    width = next(len(row) for row in rows if row is not None)
    found = np.array([np.full(width, np.nan, np.float32) if row is None else row for row in rows])
    seen = Seen(found, np.array(seconds), 1e3 * spent / max(len(rows), 1))
    if file is not None:
        file.parent.mkdir(parents=True, exist_ok=True)
        np.savez(file, **vars(seen))
    return seen


def truth_of(file: Path) -> F64:
    """(t, 46) coefficients and looks of a rendered clip."""
    with np.load(file) as stored:
        names, weights = stored["weight_names"], stored["weights"].astype(np.float64)
    made = np.zeros((len(weights), len(ARKIT_NAMES)))
    for name, column in zip(names, weights.T, strict=True):
        for shape, share in UNIT_SHAPES.get(str(name), {}).items():
            made[:, INDEX[shape]] += share * column
    return np.column_stack([made[:, list(TOLD)], weights[:, -2:] / FULL_LOOK_DEGREES])


def told(components: F32, calibration: RigCalibration | None) -> F64:
    """(t, 46) of what was seen frame by frame."""
    rest, network, rows = Rest(calibration), shipped(), []
    last = np.zeros(len(NAMES))
    for row in components:
        if np.isfinite(row).all():
            last = rest.tell(network, row)
            if calibration is not None:
                last = calibration.mapped(last, row)
        rows.append(last)
    return np.array(rows)


def on_talk(seen: Seen, truth: F64) -> RigCalibration:
    """Calibrated by all frames of a clip whose true controls are known."""
    calm = np.argsort(np.abs(truth[:, :-2]).sum(1))[: max(3, len(truth) // 7)]
    rest = np.asarray(np.nanmedian(seen.components[calm], axis=0), np.float32)
    there = np.isfinite(seen.components).all(1)
    found = told(seen.components, RigCalibration(rest))
    return RigCalibration(rest, fit_map(found[there], seen.components[there] - rest, truth[there]))


def on_stills(folder: Path) -> RigCalibration:
    """Calibrated as a user is: by pictures of what is asked for."""
    calibrator, landmarker = Calibrator(), BuiltinLandmarker(turned=())
    for name, step in STILLS.items():
        rgb = cv2.imread(str(folder / f"{name}.jpg"))[..., ::-1].copy()
        face = landmarker.detect(rgb)[0]
        calibrator.see(rgb, face.points, step)
    return calibrator.result()


def correlation(found: F64, truth: F64, names: Sequence[str]) -> float:
    """Mean over the curves that move, NaN where none does; of both looks together, as eyes turn one way."""
    picked = [NAMES.index(name) for name in names if truth[:, NAMES.index(name)].std() > MOVES]
    if not picked:
        return np.nan
    a, b = found[:, picked] - found[:, picked].mean(0), truth[:, picked] - truth[:, picked].mean(0)
    if tuple(names) == LOOKS:
        a, b = a.reshape(-1, 1), b.reshape(-1, 1)
    return float(((a * b).sum(0) / np.maximum(np.sqrt((a**2).sum(0) * (b**2).sum(0)), 1e-9)).mean())


def people_figures(options: argparse.Namespace) -> tuple[dict[str, dict[str, F64]], float]:
    """Correlations of each curve by way of calibration and person, and milliseconds a frame."""
    folder = options.shared / "data" / "synthetic" / "people"
    people = common.synthetic_people(options.shared)[: 2 if options.quick else None]
    found: dict[str, dict[str, list[float]]] = {}
    spent = []
    for person in people:
        first, second = (look(folder / person / f"{take}.mp4", options.work) for take in ("talk", "talk2"))
        truth = truth_of(folder / person / "talk2.npz")
        ways: dict[str, Callable[[], RigCalibration | None]] = {
            "talk": lambda first=first, person=person: on_talk(first, truth_of(folder / person / "talk.npz")),  # type: ignore[misc]
            "stills": lambda person=person: on_stills(folder / person),  # type: ignore[misc]
            "none": lambda: None,
        }
        for way, calibrated in ways.items():
            values = smoothed(told(second.components, calibrated()), second.seconds)
            for curve, names in CURVES.items():
                found.setdefault(way, {}).setdefault(curve, []).append(correlation(values, truth, names))
        spent.append(second.milliseconds)
        common.say(
            person
            + " "
            + " ".join(f"{w}:" + ",".join(f"{v[-1]:.2f}" for v in c.values()) for w, c in found.items())
        )
    return {w: {c: np.array(v) for c, v in curves.items()} for w, curves in found.items()}, float(
        np.median(spent)
    )


def mediapipe_clips(shared: Path) -> Iterator[tuple[Path, F64, list[str]]]:
    """Real clips with MediaPipe's coefficients (t, 52) and their names, but those that were trained on."""
    for file in sorted((shared / "data" / "real").glob("*.landmarks.npz")):
        if file.name.startswith(TRAINED_ON):
            continue
        with np.load(file) as stored:
            if "blendshapes" in stored.files and len(stored["blendshapes"]) > 20:
                video = next(
                    p for p in file.parent.glob(file.name.split(".")[0] + ".*") if p.suffix != ".npz"
                )
                yield (
                    video,
                    stored["blendshapes"][:, 0].astype(np.float64),
                    [str(n) for n in stored["blendshape_names"]],
                )


def beside_mediapipe(options: argparse.Namespace) -> list[tuple[str, str, float]]:
    """Clip, curve and correlation of every curve of MediaPipe's that moves."""
    rows = []
    for video, theirs, names in mediapipe_clips(options.shared):
        if options.quick and not video.stem.startswith("talk"):
            continue
        clip = look(video, options.work)
        seen, found = clip.components, smoothed(told(clip.components, None), clip.seconds)
        count = min(len(found), len(theirs))
        both = np.isfinite(theirs[:count]).all(1) & np.isfinite(seen[:count]).all(1)
        for name in NAMES[: len(TOLD)]:
            a, b = (
                found[:count][both, NAMES.index(name)],
                theirs[:count][both, names.index(name)] if name in names else None,
            )
            if b is not None and len(b) > 20 and b.std() > 0.05:
                rows.append((video.stem, name, float(np.corrcoef(a, b)[0, 1])))
    return rows


def measure(options: argparse.Namespace) -> Report:
    """All figures."""
    figures, spent = people_figures(options)
    report = Report(NAME, TITLE)
    rows = []
    for curve in CURVES:
        means = {way: float(np.nanmean(curves[curve])) for way, curves in figures.items()}
        worst = {way: float(np.nanmin(curves[curve])) for way, curves in figures.items()}
        rows.append((curve, *(f"{means[w]:.2f} ({worst[w]:.2f})" for w in ("talk", "stills", "none"))))
        if curve not in TARGETS:
            continue
        target = TARGETS[curve]
        report.criteria.append(Criterion(f"{curve}, calibrated", means["talk"], ">=", target))
        report.criteria.append(
            Criterion(f"{curve}, not calibrated", means["none"], ">=", UNCALIBRATED * target)
        )
    report.tables.append(Table("Mean of all people (the worst)", ("curve", "talk", "stills", "none"), rows))
    theirs = beside_mediapipe(options)
    if theirs:
        report.criteria.append(
            Criterion(
                "median beside MediaPipe", float(np.median([r[2] for r in theirs])), ">=", WHOLE_MEDIAPIPE
            )
        )
        by_name = {n: [r[2] for r in theirs if r[1] == n] for n in dict.fromkeys(r[1] for r in theirs)}
        report.tables.append(
            Table(
                "Beside MediaPipe",
                ("curve", "clips", "median"),
                [(n, len(v), f"{np.median(v):.2f}") for n, v in by_name.items()],
            )
        )
    report.criteria.append(Criterion("a frame beyond landmarks", spent, "<=", MOST_MS, "ms"))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
