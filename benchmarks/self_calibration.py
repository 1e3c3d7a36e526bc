"""Self-calibration at enrolment: models from detected landmarks, refined over all frames together or left as detected.

Rendered people have ground truth.  A landmarker detects the points of the first clip; reported are their errors in the
training frames, and the errors of the models' trackers in the second clip.  Landmarkers define points in other places
than the renderer does, so the mean error of each point in the head's frame is subtracted first: what is left varies
from frame to frame.  Jitter is the root mean square second difference in time of the error, and the size of
blinks and of speech is the slope of the tracked lid and mouth opening over the true one.

Of real clips the first part is enrolled and the rest is tracked.  The texture residual is the part of the texture under
the tracked points that twelve modes of the model's appearance do not explain, root mean square in grey levels: blurred,
misaligned training pictures make it larger.  Jitter is that of benchmarks.tracker_real.  Lengths are in % of the
inter-ocular distance.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from benchmarks.tracker_real import MIN_STILL_FRAMES, jitter, still_frames
from guise.aam.appearance import SHAPE_ENTRIES, appearance_vectors, openness, sample_texture
from guise.aam.landmarks import Face, Landmarker, interocular, open_landmarker, track_video
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.reference import ReferenceFrame
from guise.aam.refinement import Refined, refine_shapes
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, cut
from guise.aam.training import TrainingOptions, choose_frames
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource

REAL = ("franck", "webcam_a1", "studio_d6", "address_o1", "phone_d13", "room_s18")
MAX_FRAMES = 900  # frames of a real clip
ENROLLED_SHARE = 1 / 3
MODES = 12
TEXTURE_FRAME_STEP = 5  # between tracked frames for the texture residual
VARIANTS = (("as found", False), ("refined", True))


class Replayed:
    """A landmarker that replays earlier points (t, 81, 2), frame by frame."""

    name = "replayed"

    def __init__(self, points: F64) -> None:
        self._points: Iterator[F64] = iter(points)

    def detect(self, rgb: Picture) -> list[Face]:
        """The face of the next frame."""
        points = next(self._points, None)
        return [] if points is None or not np.isfinite(points).all() else [Face.around(points, 1.0)]

    def refine(self, rgb: Picture, previous: Face) -> Face | None:
        """None, so that `detect` is called."""
        return None


@dataclass(frozen=True)
class Points:
    """Landmarks of one person, as found and refined: errors in %, size of blinks, frames left out."""

    clip: str
    found: float
    refined: float
    quotient: float
    blinks_found: float
    blinks_refined: float
    left_out: int


@dataclass(frozen=True)
class Row:
    """One person and one way of enrolment; NaN for what needs ground truth."""

    clip: str
    way: str
    frames: int
    jitter: float
    residual: float
    seconds: float
    error: float = float("nan")
    blinks: float = float("nan")
    speech: float = float("nan")


def found(landmarker: Landmarker, clip: Clip, count: int) -> tuple[F64, float]:
    """Points (count, 81, 2) by a landmarker in the first frames of a clip, and the processor time, seconds."""
    start = time.process_time()
    pictures = (frame.rgb() for frame in common.frames(clip) if frame.index < count)
    points = track_video(landmarker, pictures).astype(np.float64)
    return points, time.process_time() - start


def enrolled(clip: Clip, points: F64, refine: bool) -> tuple[Identity, float]:
    """A person enrolled on found points, and the processor time, seconds."""
    start = time.process_time()
    source = LandmarkSource(landmarker=Replayed(points), refine=refine)
    return enrol([clip.video], source, name=clip.name), time.process_time() - start


def refined_frames(clip: Clip, points: F64) -> tuple[NDArray[np.intp], Refined]:
    """The frames that enrolment chooses, and their points refined."""
    chosen, frame = choose_frames(points, TrainingOptions()).all, ReferenceFrame.canonical(FEATURE_RESOLUTION)
    wanted = {int(i) for i in chosen}
    crops = [cut(f.luma, points[f.index], frame) for f in common.frames(clip) if f.index in wanted]
    return chosen, refine_shapes([c for c in crops if isinstance(c, Crop)], points[chosen])


def off(shapes: F64, truth: F64) -> F64:
    """(t, 81, 2) errors in the true head's frame without the mean of each point, %."""
    axis = (truth[:, LEFT_EYE_OUTER] - truth[:, RIGHT_EYE_OUTER]) @ [1, 1j]
    errors = ((shapes - truth) @ [1, 1j]) / axis[:, None]
    errors = 100 * (errors - errors.mean(0))
    return np.stack([errors.real, errors.imag], axis=-1)


def slope(shapes: F64, truth: F64, column: int) -> float:
    """Slope of an opening over the true one."""
    here, there = openness(shapes)[:, column], openness(truth)[:, column]
    there = there - there.mean()
    return float(there @ here / (there @ there))


def tracked(person: Identity, clip: Clip, first: int, last: int) -> tuple[F64, float]:
    """Shapes (t, 81, 2) of frames from first to last, NaN where lost, and the texture residual, grey levels."""
    person_tracker = PersonTracker(person.tracker, common.detector(), clip.points[first])
    shapes, residuals = np.full((last, *clip.points.shape[1:]), np.nan), []
    for frame in common.frames(clip):
        if frame.index >= last:
            break
        if frame.index < first:
            continue
        shape = common.shape_of(person_tracker.update(frame.luma))
        if shape is not None:
            shapes[frame.index] = shape
            if frame.index % TEXTURE_FRAME_STEP == 0:
                residuals.append(texture_residual(person, frame.rgb(), shape))
    return shapes, float(np.mean(residuals))


def texture_residual(person: Identity, rgb: Picture, shape: F64) -> float:
    """The texture under a shape that some modes do not explain, root mean square in grey levels."""
    look = person.appearance.components
    texture = sample_texture(rgb, shape, person.reference)
    vector = appearance_vectors(shape[None], texture[None], person.reference)[0]
    kept = np.repeat(person.appearance.mask[person.reference.mask], 3)
    centred = vector - look.mean
    basis = look.basis[:, :MODES]
    left = (centred - basis @ (basis.T @ centred))[SHAPE_ENTRIES:]
    return float(np.sqrt((left[kept] ** 2).mean()))


def points_of(clip: Clip, points: F64) -> Points:
    """Errors of found points, and of the same refined, in the frames that enrolment chooses."""
    chosen, refined = refined_frames(clip, points)
    truth, both = clip.points[chosen], (points[chosen], refined.shapes)
    before, after = (float(np.linalg.norm(off(shapes, truth), axis=2).mean()) for shapes in both)
    open_before, open_after = (slope(shapes, truth, 1) for shapes in both)
    left_out = int((~refined.kept).sum())
    return Points(clip.name, before, after, after / before, open_before, open_after, left_out)


def rendered(points: F64, seconds: float, first: Clip, second: Clip) -> list[Row]:
    """A rendered person enrolled in both ways on points of the first clip, and tracked in the second."""
    rows = []
    for way, refine in VARIANTS:
        person, more = enrolled(first, points, refine)
        shapes, residual = tracked(person, second, 0, len(second.points))
        seen = np.isfinite(shapes).all((1, 2))
        shapes, truth = shapes[seen], second.points[seen]
        errors = off(shapes, truth)
        jittering = jitter(errors, np.full(len(errors), 100.0), np.ones(len(errors), np.bool_))
        rows.append(
            Row(
                second.name, way, len(errors), jittering, residual, seconds + more,
                float(np.linalg.norm(errors, axis=2).mean()), slope(shapes, truth, 1), slope(shapes, truth, 0),
            )
        )  # fmt: skip
    return rows


def real(landmarker: Landmarker, clip: Clip) -> list[Row]:
    """The first part of a real clip enrolled in both ways, and the rest tracked."""
    last = min(MAX_FRAMES, len(clip.points))
    first = round(ENROLLED_SHARE * last)
    found_points, seconds = found(landmarker, clip, first)
    points = np.full(clip.points.shape, np.nan)
    points[:first] = found_points
    first += int(np.flatnonzero(np.isfinite(clip.points[first:]).all((1, 2)))[0])
    still = still_frames(clip.points[:last], clip.interocular[:last])
    rows = []
    for way, refine in VARIANTS:
        person, more = enrolled(clip, points, refine)
        shapes, residual = tracked(person, clip, first, last)
        whole = np.asarray(np.isfinite(shapes).all((1, 2)))
        steady = still.copy()
        steady[1:-1] &= whole[:-2] & whole[1:-1] & whole[2:]
        enough = int(np.count_nonzero(steady)) >= MIN_STILL_FRAMES
        jittering = jitter(shapes, np.asarray(interocular(shapes)), steady) if enough else float("nan")
        rows.append(Row(clip.name, way, int(whole.sum()), jittering, residual, seconds + more))
    return rows


def quotients(rows: list[Row], name: str) -> F64:
    """A figure with refinement over that without, of each clip that has it."""
    pairs = zip(rows[::2], rows[1::2], strict=True)
    every = np.array([getattr(after, name) / getattr(before, name) for before, after in pairs])
    return np.asarray(every[np.isfinite(every)])


def measure(options: argparse.Namespace) -> Report:
    """All people, rendered and real."""
    landmarker = open_landmarker(options.landmarker)
    landmarks: list[Points] = []
    people: list[Row] = []
    clips: list[Row] = []
    for name in common.synthetic_people(options.shared)[: 1 if options.quick else None]:
        first, second = (common.synthetic_clip(options.shared, name, take) for take in ("talk", "talk2"))
        points, seconds = found(landmarker, first, len(first.points))
        landmarks.append(points_of(first, points))
        people += rendered(points, seconds, first, second)
        common.say(f"{landmarks[-1]} {people[-2:]}")
    for name in REAL[-1:] if options.quick else REAL:
        clips += real(landmarker, common.real_clip(options.shared, name))
        common.say(f"{clips[-2:]}")
    columns = (
        "clip", "landmarks", "frames", "jitter, %", "texture residual", "processor time of enrolment, s", "error, %",
        "blinks", "speech",
    )  # fmt: skip
    return Report(
        "self_calibration",
        f"Self-calibration at enrolment, landmarks by {landmarker.name}",
        criteria(landmarks, people, clips),
        [
            Table(
                "Landmarks of the frames trained with, without each point's mean error",
                ("clip", "found, %", "refined, %", "quotient", "blinks, found", "blinks, refined", "frames left out"),
                [tuple(vars(p).values()) for p in landmarks],
            ),
            Table("Rendered people, tracked in the other clip", columns, [tuple(vars(r).values()) for r in people]),
            Table("Real clips, tracked in the rest", columns[:-3], [tuple(vars(r).values())[:-3] for r in clips]),
        ],
    )  # fmt: skip


def criteria(landmarks: list[Points], people: list[Row], clips: list[Row]) -> list[Criterion]:
    """With refinement over without."""
    errors = [p.quotient for p in landmarks]
    blinks = [p.blinks_refined / p.blinks_found for p in landmarks]
    times = quotients(people + clips, "seconds")
    return [
        Criterion("landmark error, rendered", float(np.mean(errors)), "<", 1),
        Criterion("the same, worst person", float(np.max(errors)), "<=", 1),
        Criterion("size of blinks in the landmarks", float(np.mean(blinks)), ">=", 0.95),
        Criterion("tracking error in the other clip", float(quotients(people, "error").mean()), "<", 1),
        Criterion("jitter of its error", float(quotients(people, "jitter").mean()), "<=", 1),
        Criterion("texture residual, rendered", float(quotients(people, "residual").mean()), "<", 1),
        Criterion("texture residual, real", float(quotients(clips, "residual").mean()), "<", 1),
        Criterion("jitter, real", float(quotients(clips, "jitter").mean()), "<=", 1),
        Criterion("processor time of enrolment, most", float(times.max()), "<=", 2),
    ]


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--landmarker", default="builtin", help="whose points are refined (default: builtin)")
    common.run(measure, parser)
