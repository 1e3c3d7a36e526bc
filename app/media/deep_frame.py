"""A video frame with more than 8 bits, or HDR: its planes stay as they are, and 8-bit rectangles stand for them.

What reads such a frame gets the 8-bit picture of its `Rendition`; what writes a rectangle changes only the pixels that
differ from that picture, and those get what they show in all the frame's bits.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media.colour import ColourMatrix
from guise.app.media.frame import Frame, components_at, matrix_of
from guise.app.media.orientation import AS_STORED, Orientation, Points
from guise.app.media.pixel_formats import DEEP_FORMATS, depth
from guise.app.media.rendition import Rendition, is_hdr, rendition_of

Plane = NDArray[np.uint8]
F32 = NDArray[np.float32]


def frame_of(
    picture: av.VideoFrame | Plane, *, pts: int, time_base: Fraction, index: int,
    orientation: Orientation = AS_STORED,
) -> Frame:  # fmt: skip
    """The frame of a picture: RGB (h, w, 3) uint8, or decoded, in a native format of any depth."""
    rest: dict[str, Any] = {"pts": pts, "time_base": time_base, "index": index, "orientation": orientation}
    if isinstance(picture, av.VideoFrame) and (
        picture.format.name in DEEP_FORMATS or is_hdr(picture.color_trc)
    ):
        return DeepFrame(picture, **rest)
    return Frame(picture, **rest)


class DeepFrame(Frame):
    """A frame whose components have 9 to 16 bits, or are HDR's; once it shows another picture, neither."""

    def __init__(self, picture: av.VideoFrame, **rest: Any) -> None:
        super().__init__(picture, **rest)
        bits = depth(picture.format.name)
        self._most, self._unit = (1 << bits) - 1, np.float32(1 << (bits - 8))
        self._look = look_of(picture)

    def _make_luma(self) -> Plane:
        if self._video is None:
            return super()._make_luma()
        return _luma_table(self._look, self._most + 1)[self._shown_planes()[0]]

    def quick_rgb(self) -> Plane:
        return self._look.quick(super().quick_rgb()) if self._as_stored else self.rgb()

    def scaled_rgb(self, width: int, height: int) -> Plane:
        scaled = super().scaled_rgb(width, height)
        return self._look.quick(scaled) if self._as_stored else scaled

    # -- rectangles ---------------------------------------------------------------------------------------

    def read_roi(self, x0: int, y0: int, w: int, h: int) -> Plane:
        """A copy of a rectangle of the 8-bit picture, as of `Frame.read_roi`."""
        if self._video is None:
            return super().read_roi(x0, y0, w, h)
        self._check(x0, y0, w, h)
        return _bytes(self._look.shown(self._read_stored(x0, y0, w, h)))

    def shown_planes(self) -> None:
        """None: they have more bits."""

    def _read_stored(self, x0: int, y0: int, w: int, h: int) -> F32:
        """A rectangle of stored components (h, w, 3) in units of 8 bits, chroma replicated."""
        luma, *chroma = self._shown_planes()
        parts = [
            luma[y0 : y0 + h, x0 : x0 + w],
            *(self._read_chroma(plane, x0, y0, w, h) for plane in chroma),
        ]
        scaled = [np.multiply(part, 1 / self._unit, dtype=np.float32) for part in parts]
        scaled += [np.full((h, w), 128, np.float32)] * (3 - len(parts))
        return np.asarray(cv2.merge(scaled), np.float32)

    def _read_chroma(self, plane: Any, x0: int, y0: int, w: int, h: int) -> Any:
        (cx0, cx1, left), (cy0, cy1, top) = self._cells(x0, w, 0), self._cells(y0, h, 1)
        up = plane[cy0:cy1, cx0:cx1].repeat(1 << self._shift[0], axis=1).repeat(1 << self._shift[1], axis=0)
        return up[top : top + h, left : left + w]

    def write_roi(self, x0: int, y0: int, yuv: Plane, hidden: Plane | None = None) -> None:
        """Make a rectangle show these components of 8 bits; what shows them already keeps all its bits.

        See `Frame.write_roi`.
        """
        if self._video is None:
            super().write_roi(x0, y0, yuv)
            return
        h, w = _size_of(yuv)
        self._check(x0, y0, w, h)
        left, top, wide, high = self.align_roi(x0, y0, x0 + w, y0 + h)
        stored, drawn = self._read_stored(left, top, wide, high), np.zeros((high, wide), bool)
        inside = slice(y0 - top, y0 - top + h), slice(x0 - left, x0 - left + w)
        drawn[inside] = (yuv != _bytes(self._look.shown(stored[inside]))).any(2)
        if hidden is not None:
            drawn[inside] |= hidden > 0
        if not drawn.any():
            return
        self._luma = None
        made = self._look.stored(yuv.astype(np.float32))
        np.copyto(stored[inside], made, where=drawn[inside][..., None])
        for number, plane in enumerate(self._shown_planes()):
            self._put(plane, stored[..., number], drawn, left, top, is_chroma=number > 0)

    def _put(self, plane: Any, values: F32, drawn: Any, x0: int, y0: int, *, is_chroma: bool) -> None:
        """Write values (h, w), in units of 8 bits, where a pixel of a sample is drawn (h, w)."""
        h, w = values.shape
        rows, columns, where = slice(y0, y0 + h), slice(x0, x0 + w), drawn
        if is_chroma and self._shift != (0, 0):
            (cx0, cx1, left), (cy0, cy1, top) = self._cells(x0, w, 0), self._cells(y0, h, 1)
            rows, columns, size = slice(cy0, cy1), slice(cx0, cx1), (cx1 - cx0, cy1 - cy0)
            right, bottom = (
                (n << k) - part for n, k, part in zip(size, self._shift, (left + w, top + h), strict=True)
            )
            both = np.stack([values, drawn.astype(np.float32)], -1)
            whole = cv2.copyMakeBorder(both, top, bottom, left, right, cv2.BORDER_REPLICATE)
            part = cv2.resize(whole, size, interpolation=cv2.INTER_AREA)
            values, where = np.asarray(part[..., 0], np.float32), part[..., 1] > 0
        made = np.clip(values * self._unit + np.float32(0.5), 0, self._most).astype(plane.dtype)
        np.copyto(plane[rows, columns], made, where=where)

    def _colours_at(self, points: Points) -> F32:
        planes = self._stored_planes()
        values = components_at(planes, points, self._to_chroma) / self._unit
        if len(planes) < 3:
            values[..., 1:] = 128
        return np.asarray(cv2.transform(self._look.shown(values), self.colour.to_rgb)[:, 0], np.float32)


def _size_of(yuv: Plane) -> tuple[int, int]:
    if yuv.ndim != 3 or yuv.shape[2] != 3 or yuv.dtype != np.uint8:
        raise ValueError(f"yuv must be (h, w, 3) uint8, got {yuv.shape} {yuv.dtype}")
    return yuv.shape[0], yuv.shape[1]


def _bytes(values: F32) -> Plane:
    """Rounded and clipped."""
    return np.asarray(np.clip(values + np.float32(0.5), 0, 255).astype(np.uint8))


_LOOKS: dict[tuple[ColourMatrix, int, int], Rendition] = {}


def look_of(video: av.VideoFrame) -> Rendition:
    """How a picture is shown in 8 bits, made once per set of tags."""
    matrix = matrix_of(video)
    key = (matrix, int(video.color_trc), int(video.color_primaries))
    if key not in _LOOKS:
        _LOOKS[key] = rendition_of(*key)
    return _LOOKS[key]


@cache
def _luma_table(look: Rendition, levels: int) -> Plane:
    """What each stored level of luma is shown as, where there is no chroma."""
    grey = np.full((levels, 1, 3), 128, np.float32)
    grey[:, 0, 0] = np.arange(levels) * (256 / levels)
    return np.ascontiguousarray(_bytes(look.shown(grey))[:, 0, 0])
