"""Swaps on heads that turn by nearly 60 degrees, rendered with their ideal swap.

The scenes are rendered on the way (`benchmarks.picture.sweeps`), people are enrolled from their clips of speech, and
frames are judged as in `picture.truth`, by how far the head is turned.  Drawn pixels are those changed beyond where
truth may differ from the source, by more than a pixel, in a swap that is coded without loss.  Points are those that the
swap tracks, against the truth as in `tracker_scenes`.  Similarity to the donor, enrolled nearly from the front, is that
of embeddings of mobilefacenet at true points; the ideal swap's, too, falls as the head turns.  Of a face that doesn't
move, curves of mouth and lids are measured in the swap, the ideal one and the source: their standard deviation while
the head turns, over the range of the same curves in speech.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from benchmarks.embeddings import Recogniser, person
from benchmarks.landmarks.head_pose import true_angles
from benchmarks.landmarks.metrics import Bools
from benchmarks.landmarks.setting import skipped
from benchmarks.picture import sweeps
from benchmarks.picture.program import WORK, alone, enrolled, swapped
from benchmarks.picture.truth import missing, model, pair_of
from benchmarks.tracker_scenes import differences, tracked
from guise.aam.appearance import openness
from guise.aam.landmarks import FaceTracker, interocular, open_landmarker
from guise.aam.landmarks.schemes import JAW, NOSE_TIP
from guise.aam.model import Identity
from guise.aam.solid_shape import SolidTracker
from guise.app.media import open_input
from training.point_correction import on_line

NAME, TITLE = "picture.turned", "Picture: turned heads"
TURNS_DEGREES = ((0, 25), (25, 60))
POINTS_DEGREES = (30, 60)
FAR_JAW = slice(4, 8)  # of the jaw from the far ear
FRONT_DEGREES, HALF_DEGREES = (0, 15), (38, 52)  # between which similarity is compared
DONOR_FRAMES = set(range(0, 300, 10))
RIM_PIXELS = 1
CHANGED_GREY_LEVELS = 24
EVERY_FRAME = 2
CURVES = ("mouth", "lids")
SPEECH_QUANTILES = (0.02, 0.98)  # whose distance is the range of a curve
Row = tuple[Any, ...]


def rendered(options: argparse.Namespace) -> list[Path]:
    """The folders of the scenes, rendered unless they are there."""
    folder = options.work / "sweeps"
    program = sweeps.load(options.shared)
    for kind, head, face, seed in sweeps.SCENES:
        program.make(folder, kind, head, face, seed, sweeps.FRAMES, False)
    return [folder / f"{kind}_{head}_gets_{face}" for kind, head, face, _ in sweeps.SCENES]


def turned_donor(options: argparse.Namespace, person: str) -> Path | None:
    """The model of somebody enrolled from speech and from their own scene, in which they turn; None without one."""
    scene = next((options.work / "sweeps").glob(f"sweep_{person}_gets_*"), None)
    if scene is None:
        return None
    folder = options.work / "turned" / person
    speech = alone(common.synthetic_clip(options.shared, person).video, folder / "speech.mp4")
    return enrolled(speech, alone(scene / "source.mp4", folder / "turn.mp4"))


def swap(scene: Path, options: argparse.Namespace) -> tuple[Path, Path, float]:
    """A swapped scene, the same coded without loss, and the share of its frames that weren't swapped, per cent."""
    source, identity = (model(options, person) for person in pair_of(scene.name))
    video = alone(scene / "source.mp4", options.work / "turned" / scene.name / "source.mp4")
    made = swapped(video, source, identity, video.with_name("swapped.mp4"))
    exact = swapped(video, source, identity, video.with_name("exact.mp4"), "--crf", "0")
    return made.video, exact.video, 100 * made.not_swapped / made.frames


def judged(scene: Path, video: Path, exact: Path, shared: Path) -> list[dict[str, Any]]:
    """What swap_score.py finds in some frames, with their yaw and the pixels drawn beyond the face."""
    sys.path.insert(0, str(shared / "tools"))
    tool: Any = importlib.import_module("swap_score")
    yaw = true_angles(scene / "truth.npz")[:, 0]
    with np.load(scene / "truth.npz") as stored:
        truth = {key: stored[key] for key in ("landmarks", "landmarks3d_cam", "K", "region")}
    points, solid = truth["landmarks"], truth["landmarks3d_cam"]
    widths = (
        truth["K"][0, 0] * np.linalg.norm(solid[:, 0] - solid[:, 16], axis=1) / solid[:, [0, 16], 2].mean(1)
    )
    first = points[len(points) // 2]
    canon = (first[tool.RIGID] - first.mean(0)) / widths[len(points) // 2] * 160 + 128
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    files = (scene / "source.mp4", scene / "truth.mp4", video)
    window: deque[Any] = deque(maxlen=3)
    rows = []
    for number, pictures in enumerate(zip(*map(tool.frames, files), strict=False)):
        window.append(pictures)
        at = number - 1
        if len(window) == 3 and at % EVERY_FRAME == 0:
            row = tool.one(truth, points, widths, canon, flow, at, window)
            rows.append({**row, "at": at, "yaw": yaw[at]})
    pairs = enumerate(zip(tool.frames(scene / "source.mp4"), tool.frames(exact), strict=False))
    wanted = {row["at"]: row for row in rows}
    for at, pair in pairs:
        if at in wanted:
            region = tool.bits(truth, "region", at, *pair[0].shape[:2])
            wanted[at]["beyond"] = drawn_beyond(*pair, region)
    return [row for row in rows if row["err"] is not None]


def drawn_beyond(source: Picture, made: Picture, region: Bools) -> int:
    """Pixels changed beyond a region (h, w) and its rim."""
    around = cv2.dilate(region.astype(np.uint8), np.ones((2 * RIM_PIXELS + 1,) * 2, np.uint8))
    changed = np.abs(made.astype(int) - source).max(2) > CHANGED_GREY_LEVELS
    return int(((around == 0) & changed).sum())


def tracked_points(scene: Path, shapes: F64) -> tuple[F64, F64]:
    """Differences (t, 81, 2) of tracked points (t, 81, 2) from the truth, as in `tracker_scenes`, and yaw (t,)."""
    truth = np.load(scene / "source.npz")["landmarks"].astype(np.float64)
    return differences(shapes, truth[: len(shapes)]), true_angles(scene / "source.npz")[: len(shapes), 0]


def far_jaw(scene: Path, shapes: F64) -> float:
    """Mean distance of the far jaw's points from the true jaw's line, pixels of 640: along it they may lie anywhere."""
    truth = np.load(scene / "source.npz")["landmarks"].astype(np.float64)
    yaw = np.abs(true_angles(scene / "source.npz")[:, 0])
    with open_input(scene / "source.mp4") as media:
        width = media.width
    missed = []
    for at, (found, exact) in enumerate(zip(shapes, truth, strict=False)):
        if not POINTS_DEGREES[0] <= yaw[at] < POINTS_DEGREES[1] or np.isnan(found).any():
            continue
        right, left = (abs(exact[NOSE_TIP, 0] - exact[temple, 0]) for temple in (JAW[0], JAW[-1]))
        far = JAW[FAR_JAW] if right < left else JAW[::-1][FAR_JAW]
        missed.append(distances_from_line(found[far], exact[JAW]).mean())
    return float(np.mean(missed)) * 640 / width


def distances_from_line(points: F64, line: F64) -> F64:
    """(n,) from points (n, 2) to the nearest of a line's pieces, given its corners (m, 2)."""
    return np.asarray(np.linalg.norm(points - on_line(points, line), axis=1))


def point_error(scenes: list[tuple[F64, F64]]) -> float:
    """Mean error of the turned frames, %; each point's mean difference, which is one of definition, is removed."""
    away, yaw = (np.concatenate(parts) for parts in zip(*scenes, strict=True))
    errors = np.linalg.norm(away - np.nanmean(away, axis=0), axis=2).mean(1)
    low, high = POINTS_DEGREES
    return float(np.nanmean(errors[(np.abs(yaw) >= low) & (np.abs(yaw) < high)]))


def similarity(scene: Path, video: Path, donor: Clip, recognise: Recogniser) -> F64:
    """(2,) mean similarity to the donor of frames near the front and half turned, by the truth's points."""
    with np.load(scene / "truth.npz") as stored:
        points = stored["landmarks"].astype(np.float64)
    yaw = np.abs(true_angles(scene / "truth.npz")[:, 0])
    known = person(donor, DONOR_FRAMES, recognise)
    found: list[list[float]] = [[], []]
    for frame in common.frames(Clip(scene.name, video, points)):
        for some, (low, high) in zip(found, (FRONT_DEGREES, HALF_DEGREES), strict=True):
            if low <= yaw[frame.index] < high:
                some.append(float(recognise(frame.rgb(), points[frame.index]) @ known))
    return np.array([np.mean(some) for some in found])


def known_turned(
    scene: Path, exact: Path, donor: Clip, recognise: Recogniser, options: argparse.Namespace
) -> list[Row]:
    """The scene, gain, shape error and similarities of a swap whose donor is `turned_donor`; empty without one."""
    source, identity = pair_of(scene.name)
    known = turned_donor(options, identity)
    if known is None:
        return []
    folder = options.work / "turned" / scene.name
    video = swapped(folder / "source.mp4", model(options, source), known, folder / "known.mp4").video
    _, gain, shape, _ = of_turn(judged(scene, video, exact, options.shared), *TURNS_DEGREES[-1])
    return [(scene.name, gain, shape, *similarity(scene, video, donor, recognise))]


def curves(video: Path) -> F64:
    """(t, 2) openings of mouth and lids in widths of the face as it is from the front, NaN without a face."""
    tracker, solid, rows = FaceTracker(open_landmarker("builtin")), SolidTracker(), []
    with open_input(video) as media:
        for frame in media:
            face = tracker.update(frame.rgb())
            if face is None:
                rows.append(np.full(2, np.nan))
                continue
            points = face.points.astype(np.float64)
            scale = float(interocular(points)) / solid.update(points).pose.scale
            rows.append(openness(points[None])[0, :2] * scale)
    return np.array(rows)


def of_turn(rows: list[dict[str, Any]], low: float, high: float) -> tuple[int, float, float, float]:
    """Frames, gain, shape error and pixels changed beyond the face of frames turned that far."""
    some = [row for row in rows if low <= abs(row["yaw"]) < high]
    gain = 1 - sum(row["err"] for row in some) / max(sum(row["err0"] for row in some), 1e-9)
    return len(some), gain, *(float(np.mean([row[k] for row in some])) for k in ("shape", "beyond"))  # type: ignore[return-value]


def unrest(video: Path, speech: Path, yaw: F64) -> F64:
    """(2,) standard deviation of the curves of a face at rest while it turns, over their range in speech."""
    said, still = curves(speech), curves(video)
    low, high = np.nanquantile(said, SPEECH_QUANTILES, axis=0)
    turned = np.abs(yaw[: len(still)]) < TURNS_DEGREES[-1][1]
    return np.asarray(np.nanstd(still[turned], axis=0) / (high - low))


@dataclass
class Found:
    """What was found so far: rows of the tables, and by scene what the criteria are of."""

    by_turn: list[Row] = field(default_factory=list)
    similar: list[Row] = field(default_factory=list)
    known: list[Row] = field(default_factory=list)  # donors enrolled while turning
    at_rest: list[Row] = field(default_factory=list)
    not_swapped: list[float] = field(default_factory=list)
    tracks: list[tuple[F64, F64]] = field(default_factory=list)
    jaws: list[float] = field(default_factory=list)

    def add(self, scene: Path, recognise: Recogniser, options: argparse.Namespace) -> None:
        """Swap a scene and measure it."""
        video, exact, not_swapped = swap(scene, options)
        self.not_swapped.append(not_swapped)
        source, truth = scene / "source.mp4", scene / "truth.mp4"
        shapes = tracked(Identity.load(model(options, pair_of(scene.name)[0])), source, landmarker=True)
        self.tracks.append(tracked_points(scene, shapes))
        self.jaws.append(far_jaw(scene, shapes))
        donor = common.synthetic_clip(options.shared, pair_of(scene.name)[1])
        for what, shown in (("swapped", video), ("ideal", truth)):
            self.similar.append((scene.name, what, *similarity(scene, shown, donor, recognise)))
        if scene.name.startswith("still"):
            yaw = self.tracks[-1][1]
            videos = {"swapped": video, "ideal": truth, "source": source}
            self.at_rest += [(what, *unrest(shown, donor.video, yaw)) for what, shown in videos.items()]
        rows = judged(scene, video, exact, options.shared)
        for low, high in TURNS_DEGREES:
            self.by_turn.append((scene.name, f"{low}-{high}", *of_turn(rows, low, high)))
            common.say(str(self.by_turn[-1]))
        self.known += known_turned(scene, exact, donor, recognise, options)

    def criteria(self) -> list[Criterion]:
        """What was found beside what is asked for."""
        turned = [row[3:] for row in self.by_turn[len(TURNS_DEGREES) - 1 :: len(TURNS_DEGREES)]]
        gain, shape, beyond = np.array(turned, float).T
        front, half = np.array([row[2:] for row in self.similar if row[1] == "swapped"], float).T
        criteria = [
            Criterion(
                "gain of frames turned by 25 to 60 degrees, mean of the scenes", float(gain.mean()), ">=", 0.20
            ),
            Criterion("their shape error, mean", float(shape.mean()), "<=", 1.5, "% of the face's width"),
            Criterion("pixels of them drawn beyond the face, mean", float(beyond.mean()), "<=", 0.0),
            Criterion(
                "frames not swapped, of heads turned by up to 63 degrees, worst scene",
                max(self.not_swapped), "<=", 0.0, "%",
            ),
            Criterion("points at 30 to 60 degrees", point_error(self.tracks), "<=", 3.0, "% of inter-ocular"),
            Criterion(
                "far jaw beside the true one's line, mean", float(np.mean(self.jaws)), "<=", 2.0, "pixels of 640"
            ),
            Criterion(
                "similarity to the donor at 45 degrees over that from the front",
                float(half.mean() / front.mean()), ">=", 0.80,
            ),
        ]  # fmt: skip
        if self.at_rest:
            worst = 100 * float(max(self.at_rest[0][1:]))
            criteria.append(
                Criterion("unrest of a still face's curves, worst", worst, "<=", 5.0, "% of range")
            )
        return criteria

    def tables(self) -> list[Table]:
        """All rows."""
        return [
            Table(
                "Scenes",
                ("scene", "yaw, degrees", "frames", "gain", "shape, %", "pixels beyond"),
                self.by_turn,
            ),
            Table("Similarity to the donor", ("scene", "video ", "front", "45 degrees"), self.similar),
            Table(
                "Donors who were enrolled from speech and a turn: frames turned by 25 to 60 degrees",
                ("scene", "gain", "shape, %", "similarity: front", "45 degrees"),
                self.known,
            ),
            Table(
                "A face at rest: standard deviation over the range in speech",
                ("video", *CURVES),
                self.at_rest,
            ),
        ]


def measure(options: argparse.Namespace) -> Report:
    """All scenes."""
    reason = missing(options.shared)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    found, recognise = Found(), Recogniser(options.shared / "models" / "mobilefacenet.onnx")
    for scene in rendered(options)[:: 3 if options.quick else 1]:
        found.add(scene, recognise, options)
    return Report(NAME, TITLE, found.criteria(), found.tables())


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, work=WORK))
