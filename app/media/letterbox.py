"""Pictures of another size than the first of their stream, whole and undistorted between bars."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import av
import numpy as np
from av.video.format import VideoFormatComponent
from numpy.typing import NDArray

from guise.app.media import colour

SQUARE = Fraction(1)  # pixels as wide as they are high
_CELL = 2  # pixels to which pictures are placed, so that halved chroma stays where it was


def fitting_box(
    width: int, height: int, size: tuple[int, int], stretch: Fraction = SQUARE
) -> tuple[int, int, int, int]:
    """Left, top, width and height of the largest picture with an aspect ratio of `width` x `height` that `size` holds.

    stretch : how much wider a pixel of the picture is than one of `size`.  All four are even where `size` allows.

    >>> fitting_box(270, 480, (640, 480))
    (184, 0, 270, 480)
    """
    ratio = min(Fraction(size[0]) / (width * stretch), Fraction(size[1], height))
    wanted = (float(width * stretch * ratio), float(height * ratio))
    sides = [
        min(max(_CELL, _CELL * round(side / _CELL)), whole) for side, whole in zip(wanted, size, strict=True)
    ]
    left, top = ((whole - side) // 2 // _CELL * _CELL for whole, side in zip(size, sides, strict=True))
    return left, top, sides[0], sides[1]


def pasted(picture: av.VideoFrame, size: tuple[int, int], left: int, top: int) -> av.VideoFrame:
    """A picture of planes within a black one of `size`, with its tags; left and top are even.

    The bars are black in the picture's range, and opaque.
    """
    whole = av.VideoFrame(*size, picture.format.name)
    full = picture.color_range == colour.FULL or picture.format.name.startswith(("yuvj", "gray"))
    components = picture.format.components
    for number, (target, plane) in enumerate(zip(whole.planes, picture.planes, strict=True)):
        held = [one for one in components if one.plane == number]
        rows, own = _samples(target, held[0]), _samples(plane, held[0])
        rows[:] = _black(
            held[0], is_colour=components.index(held[0]) in (1, 2) and not picture.format.is_rgb, full=full
        )
        x, y = left * target.width // size[0] * len(held), top * target.height // size[1]
        columns = plane.width * len(held)
        rows[y : y + plane.height, x : x + columns] = own[:, :columns]
    whole.pts, whole.duration = picture.pts, picture.duration
    whole.colorspace, whole.color_range = picture.colorspace, picture.color_range
    whole.color_trc, whole.color_primaries = picture.color_trc, picture.color_primaries
    return whole


def _samples(plane: av.video.plane.VideoPlane, component: VideoFormatComponent) -> NDArray[Any]:
    """(h, samples a line) view of a plane, padding included."""
    kind = np.uint8 if component.bits <= 8 else np.dtype("<u2")
    rows: NDArray[Any] = np.frombuffer(plane, kind).reshape(plane.height, -1)  # type: ignore[call-overload]
    return rows


def _black(component: VideoFormatComponent, *, is_colour: bool, full: bool) -> int:
    if is_colour:
        return 1 << (component.bits - 1)
    if component.is_alpha:
        return (1 << component.bits) - 1
    return 0 if full or not component.is_luma else 16 << (component.bits - 8)
