"""The frames of a clip by their rows, for a page: in full, and as thumbnails.  Pixels as in docs/conventions.md."""

from __future__ import annotations

import base64
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import LandmarkError
from guise.app.media import Frame, open_source
from guise.app.media.images import encode_image
from guise.app.media.segments import read_frames, scan
from guise.app.studio.landmark_view import View

Picture = NDArray[np.uint8]
Points = NDArray[np.float32]

THUMB = 72  # pixels, the side of a thumbnail
AROUND = 4  # frames before and after the one that is shown that are kept for quick steps


class Frames:
    """The frames of a clip by their rows.

    pts : (t,) time stamps of the rows.
    """

    def __init__(self, path: Path, pts: NDArray[np.int64]) -> None:
        self._path, self._scan = path, scan(path)
        self._index = np.searchsorted(self._scan.pts, pts)
        self._near: dict[int, Picture] = {}
        self._lock = threading.Lock()

    def rgb(self, row: int) -> Picture:
        """The picture (h, w, 3) of a row."""
        with self._lock:
            if row not in self._near:
                first = max(row - AROUND, 0)
                pictures = self.between(first, min(row + AROUND + 1, len(self._index)))
                self._near = {first + i: frame.rgb().copy() for i, frame in enumerate(pictures)}
            if row not in self._near:
                raise LandmarkError(f"frame {row + 1} of the clip cannot be read: choose another one")
            return self._near[row]

    def between(self, first: int, last: int) -> Iterator[Frame]:
        """The frames of the rows [first, last)."""
        return read_frames(self._path, self._scan, int(self._index[first]), int(self._index[last - 1]) + 1)

    def faces(self, rows: set[int], points: Points) -> dict[int, str]:
        """Thumbnails of rows, as addresses; points : (t, 81, 2) of all rows."""
        with open_source(self._path) as source:
            return {
                frame.index: thumbnail(frame.rgb(), points[frame.index])
                for frame in source
                if frame.index in rows
            }


def thumbnail(rgb: Picture, points: Points) -> str:
    """A small picture of the face at points (81, 2), or of the whole frame, as an address."""
    view = View.whole(rgb.shape[1], rgb.shape[0])
    view = view.around(points) if np.isfinite(points).all() else view
    return address(view.picture(rgb, THUMB))


def address(picture: Picture) -> str:
    """A picture as an address that holds it."""
    data = base64.b64encode(encode_image(picture, None, ".jpg", {})).decode()
    return f"data:image/jpeg;base64,{data}"
