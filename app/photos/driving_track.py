"""The person in a clip whose expressions drive a photo: landmarks of every frame, and the most neutral frame.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.aam.appearance import neutral_frames
from guise.aam.landmarks import (
    Face,
    FaceTracker,
    Landmarker,
    LandmarkFilter,
    interocular,
    load_annotations,
    open_landmarker,
)
from guise.aam.landmarks.schemes import EYES, LIPS
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.reference import ReferenceFrame
from guise.aam.tracker import FEATURE_RESOLUTION, Fit
from guise.analogy.photo import PhotoError
from guise.app.media import Frame, NullSink, frames_at, open_input, process
from guise.app.photos.faces import PHOTO_LIMITS, head_angles
from guise.app.swapping.donors import open_face
from guise.common.arrays import F64, U8, Bool
from guise.common.progress import Progress, Say

# Mean confidence of the landmarks of mouth or eyes, from which their expression is used.  Behind a hand, a mug or a box
# it is 0.2 to 0.65; when visible 0.88 and more, in extreme expressions too.
MIN_PART_CONFIDENCE = 0.7


@dataclass(frozen=True)
class TrackingOptions:
    """How the person in a clip is tracked.

    Parameters
    ----------
    source : that person, as for `open_face`, whose model's tracker is used, or None for a landmarker.
    landmarker : see `guise.aam.landmarks.open_landmarker`; finds the face, and tracks it if there is no model.
    landmarks : a file of landmarks of the clip, instead of both.
    """

    source: str | None = None
    landmarker: str | None = None
    landmarks: Path | None = None


@dataclass(frozen=True, eq=False)
class DrivingTrack:
    """Landmarks (frames, 81, 2) of a clip, NaN where the face was not found or is partly hidden."""

    points: F64

    @property
    def found(self) -> Bool:
        """(frames,) whether the face was found."""
        return np.asarray(np.isfinite(self.points).all((1, 2)))

    def usable_points(self, index: int) -> F64 | None:
        """Landmarks (81, 2) of a frame with a usable expression, else None: faces turned too far are not usable."""
        points = self.points[index]
        usable = (
            bool(np.isfinite(points).all())
            and max(map(abs, head_angles(points))) <= PHOTO_LIMITS.max_turn_deg
        )
        return np.asarray(points) if usable else None

    @property
    def rest_index(self) -> int:
        """Index of the most neutral frame: mouth shut; lids, brows and head as usual in the clip."""
        seen = np.flatnonzero(self.found)
        frame = ReferenceFrame.canonical(FEATURE_RESOLUTION)
        return int(seen[neutral_frames(self.points[seen], frame, 1)[0]])


def track_clip(clip: Path, tracking: TrackingOptions, progress: Progress, say: Say) -> DrivingTrack:
    """The landmarks of the person in a clip, temporally filtered.

    Raises
    ------
    MediaError, LandmarkError, ModelError, PhotoError
        When there is nobody to track.
    """
    points = (
        _load_landmarks(clip, tracking, say) if tracking.landmarks else _track(clip, tracking, progress, say)
    )
    driver = DrivingTrack(points)
    if not driver.found.any():
        raise PhotoError(
            f"no face found in the {len(points)} frames of {clip}: use a clip that shows one from the front"
        )
    eyes = float(np.median(interocular(points[driver.found])))
    if eyes < PHOTO_LIMITS.min_eye_distance_px:
        raise PhotoError(
            f"the face in {clip} is too small, {eyes:.0f} pixels between the outer eye corners instead of at least "
            f"{PHOTO_LIMITS.min_eye_distance_px}: use a clip that shows it larger"
        )
    return driver


def read_frame(clip: Path, index: int) -> U8:
    """A frame of a clip (h, w, 3)."""
    return next(frames_at(clip, {index})).rgb()


class _LandmarkerTracker:
    """One face, by a landmarker and its temporal filter."""

    def __init__(self, landmarker: Landmarker, say: Say) -> None:
        self._tracker = FaceTracker(landmarker, PHOTO_LIMITS.min_confidence, report=say)
        self._filter = LandmarkFilter()

    def __call__(self, frame: Frame) -> F64 | None:
        face = self._tracker.update(frame.rgb())
        if face is None:
            return None
        seconds = frame.seconds
        points = self._filter.update(face.points, face.point_confidence, seconds)
        return points.astype(np.float64) if _is_unoccluded(face) else None


def _is_unoccluded(face: Face) -> bool:
    """Whether mouth and eyes are visible, by the confidence of the landmarks."""
    sure = face.point_confidence
    parts = (LIPS, EYES)
    return sure is None or all(float(sure[part].mean()) >= MIN_PART_CONFIDENCE for part in parts)


class _ModelTracker:
    """One person, by the tracker of their model."""

    def __init__(self, model: Identity, finder: Landmarker) -> None:
        self._tracker = PersonTracker(model.tracker, finder, rest=model.rest_frame)

    def __call__(self, frame: Frame) -> F64 | None:
        fit = self._tracker.update(frame.luma)
        return fit.shape if isinstance(fit, Fit) else None


def _track(clip: Path, tracking: TrackingOptions, progress: Progress, say: Say) -> F64:
    landmarker = open_landmarker(tracking.landmarker)
    model = None if tracking.source is None else open_face(tracking.source)
    step = _LandmarkerTracker(landmarker, say) if model is None else _ModelTracker(model, landmarker)
    rows: list[F64] = []

    def look(frame: Frame) -> None:
        points = step(frame)
        rows.append(np.full((81, 2), np.nan) if points is None else points)

    with open_input(clip) as media:
        total = media.frame_count or 0
        process(
            media, NullSink(clip, force=True), look,
            progress=lambda done: progress("tracking", done / total if total else 0.0),
        )  # fmt: skip
    return np.array(rows).reshape(-1, 81, 2)


def _load_landmarks(clip: Path, tracking: TrackingOptions, say: Say) -> F64:
    assert tracking.landmarks is not None
    annotations = load_annotations(tracking.landmarks)
    with open_input(clip) as media:
        annotations.require_frames(sum(1 for _ in media))
    if annotations.note:
        say(annotations.note)
    return annotations.points.astype(np.float64)
