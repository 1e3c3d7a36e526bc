"""Following one person through a video: fit, lost or not, and finding them again.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Landmarker
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION, Fit, Tracker
from guise.common.arrays import F64

Grey = NDArray[np.uint8]

QUIET = 0.005  # inter-ocular distances: smaller steps of the head count as tremble
QUIET_FEATURES = 0.0025  # the same for lids and lips
NEIGHBOURS = 0.06  # face widths over which points tremble together
CONFIDENT = 0.5  # from which a landmarker's face is taken for one
MOST_STARTS = 4  # faces in a frame that are tried
PATIENCE = 10  # lost frames with a search in each; later only every third


class Boxes(Protocol):
    """Anything that finds face boxes."""

    def detect(self, image: Grey) -> NDArray[np.float32]:
        """(n, 4) x0 y0 x1 y1, largest first."""


Finder = Boxes | Landmarker


class Steadier:
    """Takes the tremble out of tracked points without delaying what moves.

    Each point goes k = m^2 / (m^2 + c^2) of the way to where it is seen.  m is the recent mean of the way that it and
    its neighbours would go: tremble points now here, now there and cancels, motion persists.  c is QUIET for the head
    and QUIET_FEATURES for lids and lips, inter-ocular distances.  So noise is averaged over many frames, while a blink
    or a syllable (many times c) passes at once and a slow drift is followed within about c.
    """

    def __init__(self) -> None:
        points = ReferenceFrame.canonical(FEATURE_RESOLUTION).points / FEATURE_RESOLUTION
        near = np.exp(-((points[:, None] - points) ** 2).sum(2) / (2 * NEIGHBOURS**2))
        quiet = np.full(POINTS, QUIET)
        quiet[36:68] = QUIET_FEATURES
        self._gain = near / near.sum(1, keepdims=True) / quiet[:, None] ** 2
        self.forget()

    def forget(self) -> None:
        """The next shape is taken as it is."""
        self._last: F64 | None = None
        self._way = np.zeros((POINTS, 2))

    def __call__(self, shape: F64) -> F64:
        """The steadied shape (81, 2), pixels."""
        if self._last is None:
            self._last = shape
            return shape
        step = shape - self._last
        self._way = (self._way + step) / 2
        moved = self._gain @ (self._way**2).sum(1) / max(float(((shape[45] - shape[36]) ** 2).sum()), 1e-6)
        share = (moved / (1 + moved))[:, None]
        self._last = self._last + share * step
        self._way *= 1 - share
        return self._last


class PersonFollower:
    """Tracks one person; one call per frame, in order.

    Parameters
    ----------
    tracker : the person's Tracker.
    boxes : for the first frame and after a loss: a detector of boxes, or a landmarker, which gives the tracker a whole
        face to start from; without one, give `start`.
    start : (81, 2) landmarks of the first frame, pixels, or None.
    """

    def __init__(self, tracker: Tracker, boxes: Finder | None, start: F64 | None = None) -> None:
        self.tracker, self.boxes = tracker, boxes
        self.lost = 0  # frames since the last fit
        self.most_faces = 0  # largest number of boxes seen in one frame
        self._last = start
        self._velocity = np.zeros(2)
        self._steadier = Steadier()

    def step(self, luma: Grey) -> Fit | Failed:
        """The person in the next frame (h, w) uint8, steadied, or why not."""
        fit = self._continued(luma)
        if not isinstance(fit, Fit):
            self._steadier.forget()
            fit = self._found(luma, fit)
        self._remember(fit)
        return replace(fit, shape=self._steadier(fit.shape)) if isinstance(fit, Fit) else fit

    def _continued(self, luma: Grey) -> Fit | Failed:
        if self._last is None:
            return Failed("no face found yet")
        fit = self.tracker.fit(luma, self._last)
        if isinstance(fit, Fit) or not self._velocity.any():
            return fit
        return self.tracker.fit(luma, self._last + self._velocity)

    def _found(self, luma: Grey, why: Failed) -> Fit | Failed:
        if self.boxes is None or (self.lost > PATIENCE and self.lost % 3):
            return why
        if isinstance(self.boxes, Landmarker):
            faces = self.boxes.detect(np.repeat(luma[..., None], 3, axis=2))
            sure = [f.points.astype(np.float64) for f in faces if f.confidence >= CONFIDENT]
            self.most_faces = max(self.most_faces, len(sure))
            return self.tracker.acquire_from(luma, sure[:MOST_STARTS]) if sure else why
        boxes = self.boxes.detect(luma)
        self.most_faces = max(self.most_faces, len(boxes))
        return self.tracker.acquire(luma, boxes[:MOST_STARTS]) if len(boxes) else why

    def _remember(self, fit: Fit | Failed) -> None:
        if not isinstance(fit, Fit):
            self.lost += 1
            return
        still = self._last is None or self.lost > 0
        self._velocity = np.zeros(2) if still else fit.shape.mean(0) - np.asarray(self._last).mean(0)
        self._last, self.lost = fit.shape, 0
