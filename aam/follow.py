"""Following one person through a video: fit, lost or not, and finding them again.

Pixels, x right, y down.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aam.similarity import Failed
from aam.tracker import Fit, Tracker

F64 = NDArray[np.float64]
Grey = NDArray[np.uint8]

PATIENCE = 10  # lost frames with a search in each; later only every third


class Boxes(Protocol):
    """Anything that finds face boxes."""

    def detect(self, image: Grey) -> NDArray[np.float32]:
        """(n, 4) x0 y0 x1 y1, largest first."""


class PersonFollower:
    """Tracks one person; one call per frame, in order.

    Parameters
    ----------
    tracker : the person's Tracker.
    boxes : detector for the first frame and after a loss; without one, give `start`.
    start : (81, 2) landmarks of the first frame, pixels, or None.
    """

    def __init__(self, tracker: Tracker, boxes: Boxes | None, start: F64 | None = None) -> None:
        self.tracker, self.boxes = tracker, boxes
        self.lost = 0  # frames since the last fit
        self.most_faces = 0  # largest number of boxes seen in one frame
        self._last = start
        self._velocity = np.zeros(2)

    def step(self, luma: Grey) -> Fit | Failed:
        """The person in the next frame (h, w) uint8, or why not."""
        fit = self._continued(luma)
        if not isinstance(fit, Fit):
            fit = self._found(luma, fit)
        self._remember(fit)
        return fit

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
        boxes = self.boxes.detect(luma)
        self.most_faces = max(self.most_faces, len(boxes))
        return self.tracker.acquire(luma, boxes[:4]) if len(boxes) else why

    def _remember(self, fit: Fit | Failed) -> None:
        if not isinstance(fit, Fit):
            self.lost += 1
            return
        still = self._last is None or self.lost > 0
        self._velocity = np.zeros(2) if still else fit.shape.mean(0) - np.asarray(self._last).mean(0)
        self._last, self.lost = fit.shape, 0
