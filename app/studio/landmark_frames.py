"""The frames of a clip by row, in full and as thumbnails.  Pixels as in docs/conventions.md."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import LandmarkError
from guise.app.media import Frame, open_input
from guise.app.media.segments import read_frames, scan
from guise.app.studio.landmark_view import FrameView
from guise.app.studio.pictures import data_url
from guise.common.arrays import F32, U8

THUMBNAIL_PIXELS = 72  # on each side
NEIGHBOUR_FRAMES = 4  # kept in memory on either side of the current frame


class ClipFrames:
    """The frames of a clip by row.

    pts : (t,) time stamps of the rows.
    """

    def __init__(self, path: Path, pts: NDArray[np.int64]) -> None:
        self._path, self._scan = path, scan(path)
        self._index = np.searchsorted(self._scan.pts, pts)
        self._near: dict[int, U8] = {}
        self._lock = threading.Lock()

    def rgb(self, row: int) -> U8:
        """The picture (h, w, 3) of a row."""
        with self._lock:
            if row not in self._near:
                first = max(row - NEIGHBOUR_FRAMES, 0)
                pictures = self.between(first, min(row + NEIGHBOUR_FRAMES + 1, len(self._index)))
                self._near = {first + i: frame.rgb().copy() for i, frame in enumerate(pictures)}
            if row not in self._near:
                raise LandmarkError(f"frame {row + 1} of the clip cannot be read: choose another one")
            return self._near[row]

    def between(self, first: int, last: int) -> Iterator[Frame]:
        """The frames of the rows [first, last)."""
        return read_frames(self._path, self._scan, int(self._index[first]), int(self._index[last - 1]) + 1)

    def faces(self, rows: set[int], points: F32) -> dict[int, str]:
        """Thumbnails of rows, as data URLs; points : (t, 81, 2) of all rows."""
        with open_input(self._path) as source:
            return {
                frame.index: thumbnail(frame.rgb(), points[frame.index])
                for frame in source
                if frame.index in rows
            }


def thumbnail(rgb: U8, points: F32) -> str:
    """A small picture of the face at points (81, 2), or of the whole frame, as a data URL."""
    view = FrameView.whole(rgb.shape[1], rgb.shape[0])
    view = view.around(points) if np.isfinite(points).all() else view
    return data_url(view.picture(rgb, THUMBNAIL_PIXELS))
