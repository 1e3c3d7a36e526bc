"""Tracking one person through a video: fit frame by frame, decide when they are lost, re-acquire them.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from guise.aam.landmarks import BoxDetector, Landmarker
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

    def update(self, luma: U8) -> Fit | Failed:
        """The person in the next frame (h, w), temporally filtered, or why there is no fit."""
        fit = self._continued(luma)
        if not isinstance(fit, Fit):
            self._filter.reset()
            fit = self._reacquired(luma, fit)
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
            faces = self.finder.detect(np.repeat(luma[..., None], 3, axis=2))
            confident = [f for f in faces if f.confidence >= LIMITS.min_start_confidence]
            starts = [face.points.astype(np.float64) for face in confident]
            self.most_faces = max(self.most_faces, len(starts))
            return self.tracker.acquire_from(luma, starts[: LIMITS.max_start_faces]) if starts else reason
        boxes = self.finder.detect(luma)
        self.most_faces = max(self.most_faces, len(boxes))
        return self.tracker.acquire(luma, boxes[: LIMITS.max_start_faces]) if len(boxes) else reason

    def _remember(self, fit: Fit | Failed) -> None:
        if not isinstance(fit, Fit):
            self.lost_frames += 1
            return
        restarted = self._last is None or self.lost_frames > 0
        self._velocity = np.zeros(2) if restarted else fit.shape.mean(0) - np.asarray(self._last).mean(0)
        self._last, self.lost_frames = fit.shape, 0
