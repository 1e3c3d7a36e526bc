"""What the estimator of coefficients sees of real people, with MediaPipe's coefficients, for `rig_head.py`.

    python -m training.rig_real --data DATA --task face_landmarker.task --output SIGHTS

DATA holds `real/` (the clips under CC BY 4.0 are taken, whose .landmarks.npz have MediaPipe's coefficients) and
`pairs/london/` (neutral and smiling people, CC BY 4.0, those for evaluation left out, to which MediaPipe is put: it
must be installed, `task` is its model).  Truth is what a coefficient is above the person's lowest.  Stills are seen
`VERSIONS` times, all but the first in other light and cameras.  Files are like those of `rig_sights.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks import FaceTracker
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.schemes import IBUG68, JAW
from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, INDEX
from guise.aam.rig.sight import see
from guise.aam.solid_shape import SolidPrior, SolidTracker
from guise.app.media import open_input
from guise.common.arrays import F32, F64, U8
from training.rig_sights import NOISE, REAL, STILLS, degraded

CLIPS = ("grid_*", "gesture_*")  # under CC BY 4.0
OFF = 0.08  # face widths from MediaPipe's points, from which on it is about another face
LOWEST = 5  # percentile of a clip that counts as the lowest
LEAST = 20  # frames of a clip
VERSIONS, PER_GROUP = 8, 2
LOOKS = (  # pairs whose difference is the eyes' turn to the image's right, and up
    (("eyeLookOutLeft", "eyeLookInLeft"), ("eyeLookInRight", "eyeLookOutRight")),
    (("eyeLookUpLeft", "eyeLookDownLeft"), ("eyeLookUpRight", "eyeLookDownRight")),
)


def truth_of(names: Sequence[str], values: F64) -> F64:
    """(n, 54) of MediaPipe's (n, 52), over the lowest, the looks beside their median, degrees."""
    found = np.zeros((len(values), 54))
    above = np.clip(values - np.percentile(values, LOWEST, axis=0), 0, 1)
    for name in ARKIT_NAMES:
        if name in names and "Look" not in name:
            found[:, INDEX[name]] = above[:, names.index(name)]
    for k, pairs in enumerate(LOOKS):
        turn = np.mean([values[:, names.index(a)] - values[:, names.index(b)] for a, b in pairs], 0)
        found[:, 52 + k] = FULL_LOOK_DEGREES * (turn - np.median(turn))
    return found


def clip_rows(video: Path, number: int) -> Iterator[dict[str, Any]]:
    """Sights of a clip's frames; none when too few of them show MediaPipe's face."""
    with np.load(next(video.parent.glob(f"{video.stem}.landmarks.npz"))) as stored:
        names = [str(name) for name in stored["blendshape_names"]]
        values, theirs = stored["blendshapes"][:, 0].astype(np.float64), stored["face81"][:, 0]
    tracker, heads, taken, seen = FaceTracker(BuiltinLandmarker(turned=())), SolidTracker(), list[int](), []
    with open_input(video) as media:
        for k, frame in enumerate(media):
            rgb = frame.rgb()
            face = tracker.update(rgb)
            if face is None:
                continue
            points = face.points.astype(np.float64)
            pose = heads.update(points).pose
            if k < len(values) and np.isfinite(values[k]).all():
                away = np.linalg.norm(points - theirs[k], axis=1).mean() / np.ptp(theirs[k, JAW, 0])
                if away < OFF:
                    taken.append(k)
                    seen.append(see(rgb, points, pose))
    if len(taken) >= LEAST:
        for sight, truth in zip(seen, truth_of(names, values[taken]), strict=True):
            yield _row(sight, truth, REAL + number, number)


def still_rows(
    folder: Path, person: str, label: Callable[[U8], F32], names: Sequence[str]
) -> Iterator[dict[str, Any]]:
    """Sights of one of London's people, neutral and smiling."""
    pictures = [cv2.imread(str(folder / f"{person}_{what}.jpg"))[..., ::-1] for what in ("neutral", "smile")]
    values = np.array([label(np.ascontiguousarray(picture)) for picture in pictures], np.float64)
    if not np.isfinite(values).all():
        return
    above = np.clip(values - values.min(0), 0, 1)
    landmarker, prior = BuiltinLandmarker(turned=()), SolidPrior.shipped()
    for k, picture in enumerate(pictures):
        truth = np.zeros(54)
        for name in ARKIT_NAMES:
            if name in names and "Look" not in name:
                truth[INDEX[name]] = above[k, names.index(name)]
        faces = landmarker.detect(np.ascontiguousarray(picture))
        for version in range(VERSIONS if faces else 0):
            shown, points = np.ascontiguousarray(picture), faces[0].points.astype(np.float64)
            if version:
                rng, light = (np.random.default_rng([int(person), version, x]) for x in (k, 9))
                shown = degraded(rng, light, shown)
                points = points + rng.normal(0, NOISE * np.ptp(points[IBUG68, 0]), points.shape)
                points = (points + 0.5) * (shown.shape[0] / picture.shape[0]) - 0.5
            sight = see(shown, points, prior.fit(points).pose)
            yield _row(sight, truth, STILLS + int(person) * VERSIONS + version // PER_GROUP, int(person))


def _row(sight: Any, truth: F64, group: int, person: int) -> dict[str, Any]:
    return {
        "eyes": sight.eyes, "mouth": sight.mouth, "shape": sight.shape.astype(np.float16),
        "weights": truth.astype(np.float32), "group": np.int64(group), "rest": np.bool_(False),
        "person": np.int64(10 * person), "glasses": np.bool_(False),
    }  # fmt: skip


def mediapipe(task: Path) -> tuple[Callable[[U8], F32], list[str]]:
    """What gives MediaPipe's coefficients (52,) of a picture, NaN without a face, and their names."""
    import mediapipe as mp  # type: ignore[import-not-found]

    vision = mp.tasks.vision
    options = vision.FaceLandmarkerOptions(
        base_options=mp.tasks.BaseOptions(model_asset_path=str(task)), output_face_blendshapes=True
    )
    finder, names = vision.FaceLandmarker.create_from_options(options), list[str]()

    def label(rgb: U8) -> F32:
        found = finder.detect(mp.Image(image_format=mp.ImageFormat.SRGB, data=rgb)).face_blendshapes
        if not found:
            return np.full(52, np.nan, np.float32)
        names[:] = [one.category_name for one in found[0]]
        return np.array([one.score for one in found[0]], np.float32)

    return label, names


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--task", type=Path, required=True, help="MediaPipe's face_landmarker.task")
    parser.add_argument("--output", type=Path, required=True)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    clips = sorted(p for kind in CLIPS for p in (options.data / "real").glob(kind) if p.suffix != ".npz")
    london = options.data / "pairs" / "london"
    kept = set((london / "evaluation_only.txt").read_text().split())
    people = sorted({p.name[:3] for p in london.glob("*_smile.jpg")} - kept)
    label, names = mediapipe(options.task)
    sources = {f"part_{k:05d}": lambda k=k, v=v: clip_rows(v, k) for k, v in enumerate(clips)}
    sources |= {f"part_1{p:0>4}": lambda p=p: still_rows(london, p, label, names) for p in people}
    for name, rows in sources.items():
        path, found = options.output / f"{name}.npz", []
        if not path.exists() and (found := list(rows())):
            np.savez(path, **{key: np.array([row[key] for row in found]) for key in found[0]})
            print(name, len(found), flush=True)


if __name__ == "__main__":
    main()
