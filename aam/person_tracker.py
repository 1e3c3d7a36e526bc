"""Tracking one person through a video: fit frame by frame, decide when they are lost, re-acquire them.

Where the tracker doesn't recognise the person (hard light, a turned head, a hand in front) but a landmarker sees a face
in the same place, the landmarker's points carry the track until the tracker recognises the person again.  Pixels, x
right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from guise.aam.landmarks import BoxDetector, Face, Landmarker, iou
from guise.aam.landmarks.plausible import is_plausible_motion
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.shape_filter import ShapeFilter
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit, Tracker
from guise.common.arrays import F64, U8
from guise.common.errors import GuiseError

FaceFinder = BoxDetector | Landmarker


@dataclass(frozen=True)
class PersonTrackingLimits:
    """Thresholds for finding a person again."""

    min_start_confidence: float = 0.5  # of a landmarker's face, from which the tracker starts on it
    max_start_faces: int = 4  # faces of a frame on which a start is tried
    eager_lost_frames: int = (
        10  # lost frames with a search in each; later only every `search_interval_frames`-th
    )
    search_interval_frames: int = 3
    detection_interval_frames: int = (
        15  # while the landmarker carries the track, from one detection to the next
    )
    min_person_iou: float = 0.3  # of a face with where the person was last
    max_carried_residual: float = 1.6  # of a face elsewhere, in lost thresholds
    crossfade_memory: float = (
        0.8  # share that is left, frame by frame, of the step between tracker and landmarker
    )


LIMITS = PersonTrackingLimits()


class PersonTracker:
    """Tracks one person; one call per frame, in order.

    Parameters
    ----------
    tracker : the person's Tracker.
    finder : finds faces in the first frame and after a loss: a box detector, or a landmarker, which gives the tracker
        a whole face to start from; without one, give `start`.
    start : (81, 2) landmarks of the first frame, pixels, or None.

    Attributes
    ----------
    lost_frames : number of frames since the last fit.
    most_faces : largest number of faces that the finder has seen in one frame.
    """

    def __init__(self, tracker: Tracker, finder: FaceFinder | None, start: F64 | None = None) -> None:
        if not len(tracker.pixels):
            raise GuiseError(
                "the model of the person in the video is a donor's, which can be shown but not tracked: "
                "enrol the person from the video"
            )
        self.tracker, self.finder = tracker, finder
        self.lost_frames = 0
        self.most_faces = 0
        self._last = start
        self._velocity = np.zeros(2)
        self._filter = ShapeFilter()
        self._face: Face | None = None  # the landmarker's, while it carries the track
        self._carried_frames = 0
        self._recognised = False  # in any frame
        self._difference: F64 | None = None

    def update(self, luma: U8) -> Fit | Failed:
        """The person in the next frame (h, w), temporally filtered, or why there is no fit."""
        fit = self._continued(luma)
        if not isinstance(fit, Fit):
            fit = self._reacquired(luma, fit)
        elif self._face is not None:
            self._face = None
        if not isinstance(fit, Fit):
            self._filter.reset()
        fit = self._crossfaded(fit)
        self._remember(fit)
        return replace(fit, shape=self._filter(fit.shape)) if isinstance(fit, Fit) else fit

    def _continued(self, luma: U8) -> Fit | Failed:
        if self._last is None:
            return Failed("no face found yet")
        fit = self.tracker.fit(luma, self._last)
        if isinstance(fit, Fit) or not self._velocity.any():
            return fit
        return self.tracker.fit(luma, self._last + self._velocity)

    def _reacquired(self, luma: U8, reason: Failed) -> Fit | Failed:
        pause = self.lost_frames > LIMITS.eager_lost_frames
        if self.finder is None or (pause and self.lost_frames % LIMITS.search_interval_frames):
            return reason
        if isinstance(self.finder, Landmarker):
            return self._from_landmarks(self.finder, luma, reason)
        boxes = self.finder.detect(luma)
        self.most_faces = max(self.most_faces, len(boxes))
        return self.tracker.acquire(luma, boxes[: LIMITS.max_start_faces]) if len(boxes) else reason

    def _from_landmarks(self, landmarker: Landmarker, luma: U8, reason: Failed) -> Fit | Failed:
        """The tracker's fit from a landmarker's face, or else that face itself: what is in plain view isn't lost."""
        rgb = np.repeat(luma[..., None], 3, axis=2)
        faces = self._landmarked(landmarker, rgb)
        starts = [face.points.astype(np.float64) for face in faces[: LIMITS.max_start_faces]]
        fit = self.tracker.acquire_from(luma, starts) if starts else reason
        if isinstance(fit, Fit):
            self._face = None
            return fit
        found = [
            (one, self.tracker.measured(luma, face.points.astype(np.float64)))
            for one, face in enumerate(faces)
        ]
        known = [
            (one, fit) for one, fit in found if isinstance(fit, Fit) and self._is_person(faces[one], fit)
        ]
        if not known:
            self._face = None
            return reason
        one, fit = min(known, key=lambda entry: entry[1].residual)
        self._face = faces[one]
        return fit

    def _landmarked(self, landmarker: Landmarker, rgb: U8) -> list[Face]:
        """The landmarker's faces: the one that was carried before, refined, or all that are detected."""
        if self._face is not None and self._carried_frames % LIMITS.detection_interval_frames:
            face = landmarker.refine(rgb, self._face)
            if (
                face is not None
                and face.confidence >= LIMITS.min_start_confidence
                and is_plausible_motion(self._face.points, face.points)
            ):
                return [face]
        faces = [face for face in landmarker.detect(rgb) if face.confidence >= LIMITS.min_start_confidence]
        self.most_faces = max(self.most_faces, len(faces))
        return faces

    def _is_person(self, face: Face, fit: Fit) -> bool:
        """Whether a face is where the person was a moment ago, or its texture is not too far from theirs.

        Where the tracker hasn't recognised the person in any frame yet, the light differs from that of the enrolment,
        and the texture says nothing.
        """
        if self._last is not None and self.lost_frames <= LIMITS.eager_lost_frames:
            last = self._last[IBUG68]
            box = np.concatenate([last.min(0), last.max(0)]).astype(np.float32)
            return iou(face.box, box) > LIMITS.min_person_iou
        return (
            not self._recognised
            or fit.residual < LIMITS.max_carried_residual * self.tracker.quality.threshold
        )

    def _crossfaded(self, fit: Fit | Failed) -> Fit | Failed:
        """The fit; after a change between tracker and landmarker the difference of the two fades over some frames."""
        if not isinstance(fit, Fit):
            self._carried_frames, self._difference = 0, None
            return fit
        if self._last is not None and self.lost_frames == 0 and fit.carried != (self._carried_frames > 0):
            self._difference = self._last + self._velocity - fit.shape
        self._carried_frames = self._carried_frames + 1 if fit.carried else 0
        if self._difference is None:
            return fit
        self._difference = LIMITS.crossfade_memory * self._difference
        return replace(fit, shape=fit.shape + self._difference)

    def _remember(self, fit: Fit | Failed) -> None:
        if not isinstance(fit, Fit):
            self.lost_frames += 1
            return
        restarted = self._last is None or self.lost_frames > 0
        self._velocity = np.zeros(2) if restarted else fit.shape.mean(0) - np.asarray(self._last).mean(0)
        self._last, self.lost_frames = fit.shape, 0
        self._recognised |= not fit.carried
