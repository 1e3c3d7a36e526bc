"""Tracking one person through a video: where they are in each frame, when they are lost, and where they are again.

A landmarker and the person's own tracker are one estimator.  The landmarker has seen many faces and follows every
expression, so its points, from one frame to the next, say where the face is; the tracker knows this person and says
whether it is theirs.  Where the landmarker fails (a hidden or tiny face), the tracker's own fit continues.  Where the
tracker doesn't recognise the person (hard light, a turned head, a hand in front) but the landmarker sees a face in the
same place, its points carry the track.  Pixels, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks import BoxDetector, Face, Landmarker, iou
from guise.aam.landmarks.crops import upright_square
from guise.aam.landmarks.plausible import is_plausible_motion
from guise.aam.landmarks.schemes import IBUG68, INNER51, interocular
from guise.aam.model import RestFrame
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_filter import ShapeFilter
from guise.aam.similarity import Failed
from guise.aam.solid_shape import SolidPrior
from guise.aam.tracker import Fit, Tracker
from guise.common.arrays import F64, U8
from guise.common.errors import GuiseError
from guise.common.small import mean

FaceFinder = BoxDetector | Landmarker


@dataclass(frozen=True)
class PersonTrackingLimits:
    """Thresholds for finding a person again."""

    min_confidence: float = 0.5  # of a landmarker's face that is taken
    # Of a followed face: as it turns, confidence falls though its points are right; degrees of yaw, and what is enough.
    turned: tuple[tuple[float, float], tuple[float, float]] = ((40.0, 55.0), (0.5, 0.08))
    reach_head_boxes: float = 0.95  # from a face's middle, within which the landmarker is shown the picture
    max_same_definition_interocular: float = 0.02  # mean distance of two sources' points of one face
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
    landmarker : follows the face from frame to frame; None for the finder, if that is one, or the tracker alone.
    rest : a frame of the person with their model's points.  Where the landmarker defines points differently from the
        landmarks that the model was made from, its points are moved by the difference there.

    Attributes
    ----------
    lost_frames : number of frames since the last fit.
    most_faces : largest number of faces that the finder has seen in one frame.
    """

    def __init__(
        self,
        tracker: Tracker,
        finder: FaceFinder | None,
        start: F64 | None = None,
        *,
        landmarker: Landmarker | None = None,
        rest: RestFrame | None = None,
    ) -> None:
        if not len(tracker.pixels):
            raise GuiseError(
                "the model of the person in the video is a donor's, which can be shown but not tracked: "
                "enroll the person from the video"
            )
        self.tracker, self.finder = tracker, finder
        self.landmarker = finder if landmarker is None and isinstance(finder, Landmarker) else landmarker
        self.lost_frames = 0
        self.most_faces = 0
        self._last = start
        self._velocity = np.zeros(2)
        self._filter = ShapeFilter()
        self._by_landmarks = False  # whether the landmarker's points were the last fit
        self._carried_frames = 0
        self._confidence = 1.0  # of the landmarker's last face
        self._recognised = False  # in any frame
        self._difference: F64 | None = None
        self._definition = _Definition(self.landmarker, rest, tracker.reference)

    def update(self, luma: U8) -> Fit | Failed:
        """The person in the next frame (h, w), temporally filtered, or why there is no fit."""
        return self._filtered(*self._found(luma))

    def follow(self, luma: U8, face: Face | None) -> Fit | Failed:
        """As `update` where another tracker has found the person's face in the frame, or that it isn't there."""
        fit = Failed("no face there") if face is None else self.tracker.measured(luma, self._defined(face))
        return self._filtered(fit, by_landmarks=True)

    def _filtered(self, fit: Fit | Failed, by_landmarks: bool) -> Fit | Failed:
        if not isinstance(fit, Fit):
            self._filter.reset()
        fit = self._crossfaded(fit, by_landmarks)
        self._remember(fit, by_landmarks)
        return replace(fit, shape=self._filter(fit.shape)) if isinstance(fit, Fit) else fit

    def _found(self, luma: U8) -> tuple[Fit | Failed, bool]:
        """The person in a frame, and whether the landmarker's points say where."""
        near = self._followed(luma)
        if isinstance(near, Fit) and not near.carried:
            return near, True
        tracked = self._continued(luma)
        if isinstance(tracked, Fit):
            return tracked, False
        if isinstance(near, Fit) and self._carried_frames % LIMITS.detection_interval_frames:
            return near, True
        return self._searched(luma, near if isinstance(near, Fit) else tracked)

    def _followed(self, luma: U8) -> Fit | Failed:
        """The landmarker's points where the face was in the last frame."""
        if self.landmarker is None or self._last is None or self.lost_frames:
            return Failed("no face to follow")
        x, y, rgb = _surroundings(luma, self._last)
        if not rgb.size:
            return Failed("the face has left the picture")
        last = self._last - (x, y)
        last = last - self._definition.on(last)
        face = self.landmarker.refine(rgb, Face.around(last, self._confidence))
        self._confidence = face.confidence if face else 0.0
        if face is None or not _is_sure(face):
            return Failed("no face where it was")
        if not is_plausible_motion(last, face.points):
            return Failed("the face jumped")
        return self.tracker.measured(luma, self._defined(face) + np.array([x, y]))

    def _continued(self, luma: U8) -> Fit | Failed:
        """The tracker's own fit near the last one."""
        if self._last is None:
            return Failed("no face found yet")
        fit = self.tracker.fit(luma, self._last)
        if isinstance(fit, Fit) or not self._velocity.any():
            return fit
        return self.tracker.fit(luma, self._last + self._velocity)

    def _searched(self, luma: U8, otherwise: Fit | Failed) -> tuple[Fit | Failed, bool]:
        """The person among the faces that the finder sees anywhere; what is known otherwise where it sees none."""
        pause = self.lost_frames > LIMITS.eager_lost_frames
        if self.finder is None or (pause and self.lost_frames % LIMITS.search_interval_frames):
            return otherwise, isinstance(otherwise, Fit)
        if isinstance(self.finder, Landmarker):
            return self._from_landmarks(self.finder, luma, otherwise)
        boxes = self.finder.detect(luma)
        self.most_faces = max(self.most_faces, len(boxes))
        fit = self.tracker.acquire(luma, boxes[: LIMITS.max_start_faces]) if len(boxes) else otherwise
        return (fit, False) if isinstance(fit, Fit) and fit is not otherwise else (otherwise, True)

    def _from_landmarks(
        self, landmarker: Landmarker, luma: U8, otherwise: Fit | Failed
    ) -> tuple[Fit | Failed, bool]:
        """The landmarker's face that is the person's, or the tracker's fit from one, or the likeliest face."""
        faces = [f for f in landmarker.detect(_grey_rgb(luma)) if f.confidence >= LIMITS.min_confidence]
        self.most_faces = max(self.most_faces, len(faces))
        measured = [(face, self.tracker.measured(luma, self._defined(face))) for face in faces]
        found = [(face, fit) for face, fit in measured if isinstance(fit, Fit)]
        recognised = [fit for _, fit in found if not fit.carried]
        if recognised:
            return min(recognised, key=lambda fit: fit.residual), True
        starts = [fit.shape for _, fit in found[: LIMITS.max_start_faces]]
        fit = self.tracker.acquire_from(luma, starts)
        if isinstance(fit, Fit):
            return fit, False
        likely = [fit for face, fit in found if self._is_person(face, fit)]
        if likely:
            return min(likely, key=lambda fit: fit.residual), True
        return otherwise, isinstance(otherwise, Fit)

    def _defined(self, face: Face) -> F64:
        """A face's points (81, 2) as the model defines them."""
        points = face.points.astype(np.float64)
        return points + self._definition.on(points)

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

    def _crossfaded(self, fit: Fit | Failed, by_landmarks: bool) -> Fit | Failed:
        """The fit; after a change between tracker and landmarker the difference of the two fades over some frames."""
        if not isinstance(fit, Fit):
            self._difference = None
            return fit
        if self._last is not None and self.lost_frames == 0 and by_landmarks != self._by_landmarks:
            self._difference = self._last + self._velocity - fit.shape
        if self._difference is None:
            return fit
        self._difference = LIMITS.crossfade_memory * self._difference
        return replace(fit, shape=fit.shape + self._difference)

    def _remember(self, fit: Fit | Failed, by_landmarks: bool) -> None:
        if not isinstance(fit, Fit):
            self.lost_frames += 1
            self._carried_frames = 0
            return
        if self._last is None or self.lost_frames > 0:
            self._velocity = np.zeros(2)
        else:
            self._velocity = mean(fit.shape, 0) - mean(self._last, 0)
        self._last, self.lost_frames, self._by_landmarks = fit.shape, 0, by_landmarks
        self._carried_frames = self._carried_frames + 1 if fit.carried else 0
        self._recognised |= not fit.carried


def _is_sure(face: Face) -> bool:
    """Whether a followed face is still one; of a turned head less confidence is enough."""
    if face.confidence >= LIMITS.min_confidence:
        return True
    if face.confidence < LIMITS.turned[1][1]:
        return False
    yaw = SolidPrior.shipped().fit(face.points.astype(np.float64)).pose.angles[0]
    return bool(face.confidence >= np.interp(abs(yaw), *LIMITS.turned))


def _surroundings(luma: U8, shape: F64) -> tuple[int, int, U8]:
    """Left, top and RGB picture of what a landmarker looks at around a shape (81, 2), in a picture (h, w)."""
    centre, side, _ = upright_square(shape)
    reach = LIMITS.reach_head_boxes * side
    height, width = luma.shape
    if not np.isfinite(reach) or not np.isfinite(centre).all():
        return 0, 0, np.zeros((0, 0, 3), np.uint8)
    (x0, x1), (y0, y1) = (
        (min(max(math.floor(at - reach), 0), size), min(max(math.ceil(at + reach) + 1, 0), size))
        for at, size in zip(centre.tolist(), (width, height), strict=True)
    )
    part = luma[y0:y1, x0:x1]
    return x0, y0, np.broadcast_to(part[..., None], (*part.shape, 3))


def _grey_rgb(luma: U8) -> U8:
    return np.asarray(cv2.cvtColor(luma, cv2.COLOR_GRAY2RGB), np.uint8)


class _Definition:
    """By how much a model's points differ from the landmarker's on the same face, where they differ by definition."""

    def __init__(
        self, landmarker: Landmarker | None, rest: RestFrame | None, reference: ReferenceFrame
    ) -> None:
        self._reference = reference
        self._offset: F64 | None = None  # (81, 2) grid pixels
        face = landmarker.refine(rest.picture, Face.around(rest.shape, 1.0)) if landmarker and rest else None
        if face is None or rest is None:
            return
        away = rest.shape - face.points
        allowed = LIMITS.max_same_definition_interocular * interocular(rest.shape)
        if np.linalg.norm(away[INNER51], axis=1).mean() > allowed:
            self._offset = away @ reference.to_grid(rest.shape).linear

    def on(self, points: F64) -> F64:
        """The difference (81, 2) on a face with points (81, 2), in their pixels."""
        if self._offset is None:
            return np.zeros_like(points)
        return self._offset @ self._reference.to_shape(points).linear
