"""Jitter where the face is still, compared with MediaPipe's landmarks; lag where eyelids and lips move.

Jitter is the root mean square, over points and frames, of the first and of the second difference in time, in % of the
distance between the outer eye corners, on the same still frames for all.  No landmarker decides which frames are still:
dense optical flow (OpenCV's DIS) does, between the pictures FLOW_FRAMES before and after a frame.  It is still when
nine tenths of the face's rectangle move by less than MAX_STILL_MOTION % of the distance between the eye corners.
Slower motion remains in all figures alike.  MediaPipe's landmarks are those beside the clips, by its video mode with
its own smoothing.

Lag is measured on rendered clips against ground truth: the shift, in frames and fractions, at which the opening of the
eyelids (lips) correlates best with the true one.  Depth is how far the eyelids' opening falls below its median (to the
second percentile), over the true depth.
"""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.clips import RealClip, real_clips
from benchmarks.landmarks.metrics import Bools, depth, lag, mean_of, motion, opening, root_mean_square
from guise.aam.brows import BrowLift
from guise.aam.landmarks import FaceTracker, Landmarker, interocular
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.landmark_filter import LandmarkFilter
from guise.aam.landmarks.schemes import LOWER_INNER_LIP, LOWER_LIDS, UPPER_INNER_LIP, UPPER_LIDS
from guise.aam.parsing import FaceParser

NAME, TITLE = "landmarks.jitter", "Jitter and lag"
CLIPS = (
    "franck", "webcam_a1", "webcam_a2", "studio_d5", "studio_d6", "studio_d7", "studio_d18", "phone_d13", "address_o3",
    "room_s18",
)  # fmt: skip
FRAMES = 300  # of a clip
FLOW_FRAMES = 3  # frames
MAX_STILL_MOTION = 1.0  # % of the distance between the outer eye corners
FLOW_SIZE = 160  # pixels of the rectangle in which the flow is taken
MIN_STILL_FRAMES = 10  # from which jitter is reported
LIDS = tuple(zip(UPPER_LIDS, LOWER_LIDS, strict=True))
INNER_LIP = tuple(zip(UPPER_INNER_LIP, LOWER_INNER_LIP, strict=True))


@dataclass(frozen=True, eq=False)
class Tracks:
    """Points of one face through a clip (t, 81, 2), NaN where lost: as found, and as smoothed."""

    raw: F64
    smoothed: F64


def tracks(landmarker: Landmarker, frames: Iterator[tuple[Picture, float]]) -> Tracks:
    """Follow one face through pictures with their times in seconds, as `guise landmarks` does."""
    tracker, landmark_filter = FaceTracker(landmarker), LandmarkFilter()
    lift = BrowLift() if isinstance(landmarker, BuiltinLandmarker) else None
    parser, missing = FaceParser(), np.full((81, 2), np.nan)
    raw: list[F64] = []
    smoothed: list[F64] = []
    for picture, seconds in frames:
        face = tracker.update(picture)
        if face is None:
            landmark_filter.reset()
            lift = lift and BrowLift()
            raw.append(missing)
            smoothed.append(missing)
            continue
        points = landmark_filter.update(face.points, face.point_confidence, seconds).astype(np.float64)
        if lift is not None:
            lift.see(parser.parse(picture, points), points)
            points = lift(points)
        raw.append(face.points.astype(np.float64))
        smoothed.append(points)
    return Tracks(np.array(raw), np.array(smoothed))


def timed(clip: Clip, count: int | None) -> Iterator[tuple[Picture, float]]:
    """Frames as RGB and their times in seconds."""
    for frame in common.frames(clip):
        if count is not None and frame.index >= count:
            return
        yield frame.rgb(), float(frame.pts * frame.time_base)


# -- still frames ---------------------------------------------------------------------------------------------


def rectangle(points: F64) -> F64:
    """Square (4,) about the median place of the face through a clip (t, p, 2)."""
    box = np.nanmedian(setting.boxes_of(points[np.isfinite(points).all((1, 2))]), axis=0)
    centre, half = (box[:2] + box[2:]) / 2, (box[2:] - box[:2]).max() / 2
    return np.concatenate([centre - half, centre + half])


def patch(rgb: Picture, square: F64) -> Picture:
    """Grey (FLOW_SIZE, FLOW_SIZE) of a square of a picture."""
    scale = (square[2] - square[0]) / FLOW_SIZE
    inverse = np.array([[scale, 0, square[0]], [0, scale, square[1]]])
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    flags = cv2.INTER_AREA | cv2.WARP_INVERSE_MAP if scale > 1 else cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(grey, inverse, (FLOW_SIZE, FLOW_SIZE), flags=flags), np.uint8)


def picture_motion(patches: Iterator[Picture]) -> list[float]:
    """The 0.9 quantile of the motion from FLOW_FRAMES before each frame to FLOW_FRAMES after; NaN at the ends."""
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    kept: deque[Picture] = deque(maxlen=2 * FLOW_FRAMES + 1)
    moved = []
    for grey in patches:
        kept.append(grey)
        if len(kept) == kept.maxlen:
            field = flow.calc(kept[0], kept[-1], None)  # type: ignore[call-overload]
            moved.append(float(np.quantile(np.linalg.norm(field, axis=2), 0.9)))
    ends = [float("nan")] * FLOW_FRAMES
    return ends + moved + ends if moved else []


def still_frames(clip: RealClip, count: int | None) -> Bools:
    """Which frames (t,) are still."""
    points = clip.points[:count]
    square = rectangle(points)
    moved = picture_motion(patch(rgb, square) for rgb in clip.frames(count))
    eyes = float(np.nanmedian(interocular(points))) * FLOW_SIZE / (square[2] - square[0])
    return np.asarray(100 * np.array(moved) / eyes < MAX_STILL_MOTION)


# -- jitter ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Jitter:
    """One clip: still frames, and root mean squares of first and second differences, %."""

    clip: str
    still: int
    first: dict[str, float]
    second: dict[str, float]


def jitter(clip: RealClip, landmarker: Landmarker, count: int | None) -> Jitter:
    """One clip."""
    found = tracks(landmarker, timed(Clip(clip.name, clip.video, clip.points), count))
    given = clip.points[: len(found.raw)]
    eyes = interocular(given)
    sources = {"smoothed": found.smoothed, "raw": found.raw, "MediaPipe": given}
    chosen = still_frames(clip, count)
    values = {o: {name: motion(p, eyes, o) for name, p in sources.items()} for o in (1, 2)}
    for sizes in values.values():
        for size in sizes.values():
            chosen &= np.isfinite(size)
    enough = int(chosen.sum()) >= MIN_STILL_FRAMES
    rms = {
        o: {n: root_mean_square(v[chosen]) if enough else float("nan") for n, v in sizes.items()}
        for o, sizes in values.items()
    }
    return Jitter(clip.name, int(chosen.sum()), rms[1], rms[2])


def jitter_table(results: list[Jitter]) -> Table:
    """A row for each clip."""
    columns = (
        "clip", "still frames", "1st smoothed, %", "1st raw, %", "1st MediaPipe, %", "2nd smoothed, %", "2nd raw, %",
        "2nd MediaPipe, %",
    )  # fmt: skip
    rows = [(r.clip, r.still, *r.first.values(), *r.second.values()) for r in results]
    return Table("Jitter on still frames: root mean square of first and second differences", columns, rows)


def jitter_criteria(results: list[Jitter]) -> list[Criterion]:
    """Smoothed over MediaPipe's: geometric mean over the clips that hold still, and the worst."""
    made = []
    for text, values in (("first", [r.first for r in results]), ("second", [r.second for r in results])):
        ratios = np.array([v["smoothed"] / v["MediaPipe"] for v in values])
        ratios = ratios[np.isfinite(ratios)]
        mean = float(np.exp(np.log(ratios).mean())) if len(ratios) else float("nan")
        made.append(Criterion(f"jitter, {text} difference, over MediaPipe's, mean of clips", mean, "<=", 1.0))
    return made


# -- lag ------------------------------------------------------------------------------------------------------


def rendered_clips(shared: Path, samples: Path) -> list[Clip]:
    """Talking clips with exact truth: sample_videos, else data/synthetic."""
    videos = sorted(samples.glob("*/talk*.mp4")) or sorted(
        (shared / "data/synthetic/people").glob("*/talk*.mp4")
    )
    return [common.clip_at(video, f"{video.parent.name}/{video.stem}") for video in videos]


def lag_row(clip: Clip, landmarker: Landmarker, count: int | None) -> tuple[object, ...]:
    """Clip, lag of lids smoothed, raw, smoothed to raw; lag of lips smoothed, raw; depth of blinks smoothed, raw."""
    found = tracks(landmarker, timed(clip, count))
    truth = clip.points[: len(found.raw)]
    lids = {
        name: opening(p, LIDS)
        for name, p in (("true", truth), ("raw", found.raw), ("smoothed", found.smoothed))
    }
    lips = {
        name: opening(p, INNER_LIP)
        for name, p in (("true", truth), ("raw", found.raw), ("smoothed", found.smoothed))
    }
    return (
        clip.name, lag(lids["smoothed"], lids["true"]), lag(lids["raw"], lids["true"]),
        lag(lids["smoothed"], lids["raw"]), lag(lips["smoothed"], lips["true"]), lag(lips["raw"], lips["true"]),
        depth(lids["smoothed"]) / depth(lids["true"]), depth(lids["raw"]) / depth(lids["true"]),
    )  # fmt: skip


def measure(options: argparse.Namespace) -> Report:
    """Jitter on real clips, lag on rendered ones."""
    landmarker = setting.landmarker(options)
    count = 60 if options.quick else options.frames or None
    report, results, rows = Report(NAME, TITLE), [], []
    clips = [clip for name in CLIPS for clip in real_clips(options.shared, name)]
    for clip in clips[: 2 if options.quick else None]:
        results.append(jitter(clip, landmarker, count))
        common.say(str(results[-1]))
    if results:
        report.criteria += jitter_criteria(results)
        report.tables.append(jitter_table(results))
    else:
        report.notes.append(f"Skipped: jitter, no clips in {options.shared / 'data' / 'real'}.")
    for rendered in rendered_clips(options.shared, options.samples)[: 1 if options.quick else None]:
        rows.append(lag_row(rendered, landmarker, None))
        common.say(str(rows[-1]))
    if rows:
        report.criteria += lag_criteria(rows)
        columns = (
            "clip", "lids smoothed", "lids raw", "lids smoothed after raw", "lips smoothed", "lips raw",
            "blink depth smoothed", "blink depth raw",
        )  # fmt: skip
        report.tables.append(
            Table("Lag behind exact truth, frames; depth of blinks over the true one", columns, rows)
        )
    else:
        report.notes.append(f"Skipped: lag, no rendered clips in {options.samples}.")
    return report


def lag_criteria(rows: list[tuple[object, ...]]) -> list[Criterion]:
    """Mean and worst lag; a clip in which the lids' opening cannot be measured does not meet the target."""
    lids, lips = (np.array([row[i] for row in rows], float) for i in (1, 4))
    return [
        Criterion("lag on blinks, mean of clips", mean_of(lids), "<=", 1.0, "frames"),
        Criterion("lag on blinks, worst clip", float(lids.max()), "<=", 1.0, "frames"),
        Criterion("lag of the lips, worst clip", float(lips.max()), "<=", 1.0, "frames"),
    ]


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--frames", type=int, default=FRAMES, help="first frames of each real clip; 0 for all")
    samples = Path(__file__).parents[2] / "sample_videos"
    made.add_argument("--samples", type=Path, default=samples, help="folder of rendered clips with truth")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
