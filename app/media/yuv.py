"""Whole pictures between RGB and YUV planes of any depth, rounded: FFmpeg's scaler is a level off, always the same way.

RGB is full range and non-linear as stored: uint8, or uint16 with the significant bits scaled to all 16.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from guise.app.media import colour
from guise.app.media.colour import yuv_matrix

Plane: TypeAlias = "NDArray[Any]"


@dataclass(frozen=True, eq=False)
class YUV:
    """A picture as it is coded.

    planes : (h, w) each, chroma perhaps of half the size, of this number of bits; one for grey.
    matrix, span : as H.273 and FFmpeg number them.
    """

    planes: list[Plane]
    bits: int
    matrix: int
    span: int


def read_planes(picture: av.VideoFrame, bits: int) -> list[Plane]:
    """Copies (h, w) of a planar picture's planes, uint8 or uint16."""
    kind = np.dtype(np.uint8 if bits == 8 else "<u2")
    found: list[Plane] = []
    for plane in picture.planes:
        rows = np.frombuffer(plane, kind)  # type: ignore[call-overload]
        found.append(rows.reshape(plane.height, -1)[:, : plane.width].astype(kind.newbyteorder("=")))
    return found


def to_rgb(yuv: YUV) -> Plane:
    """Planes as (h, w) grey or (h, w, 3) RGB, uint8 or uint16, full range; chroma is interpolated."""
    h, w = yuv.planes[0].shape
    planes = [_as_large(plane, h, w) for plane in yuv.planes[:3]]
    if len(planes) == 3 and yuv.matrix == colour.RGB:
        return _full(np.stack([planes[2], planes[0], planes[1]], axis=2), yuv.bits)
    to_full = yuv_matrix(
        yuv.matrix if yuv.matrix != colour.UNSPECIFIED else colour.SMPTE170M, yuv.span, 0
    ).to_rgb
    if len(planes) == 1:
        gain, offset = (1.0, 0.0) if yuv.span == colour.FULL else (255 / 219, -16 * 255 / 219)
        to_full = np.array([[gain, offset]], np.float32)
    if yuv.bits == 8:
        return np.asarray(cv2.transform(cv2.merge(planes), to_full), np.uint8)
    top = (1 << yuv.bits) - 1
    middle, unit = 1 << (yuv.bits - 1), 255 / top if yuv.span == colour.FULL else 2.0 ** (8 - yuv.bits)
    parts = [planes[0] * np.float32(unit)] + [
        (p.astype(np.float32) - middle) * np.float32(unit) + 128 for p in planes[1:]
    ]
    rgb = cv2.transform(cv2.merge(parts), to_full)
    levels = np.rint(np.clip(rgb, 0, 255) * (top / 255)).astype(np.uint16)
    return _full(levels, yuv.bits)


def _as_large(chroma: Plane, h: int, w: int) -> Plane:
    """A plane, perhaps of half the size, as (h, w); the last sample of an odd length stands for one pixel."""
    if chroma.shape == (h, w):
        return chroma
    wide, tall = (2 if size > kept else 1 for size, kept in ((w, chroma.shape[1]), (h, chroma.shape[0])))
    whole = cv2.resize(
        chroma, (wide * chroma.shape[1], tall * chroma.shape[0]), interpolation=cv2.INTER_LINEAR
    )
    return np.asarray(whole[:h, :w], chroma.dtype)


def _full(values: Plane, bits: int) -> Plane:
    """Values of a number of bits, scaled to all 16; 8 stay as they are."""
    if bits == 8:
        return values
    return np.asarray((values.astype(np.uint32) * 65535 + (1 << (bits - 1))) // ((1 << bits) - 1), np.uint16)


def from_rgb(rgb: Plane, fmt: str, bits: int) -> av.VideoFrame:
    """A full-range BT.601 frame of format yuv420p (even sizes), yuv444p or the like with 10 bits, from grey or RGB.

    rgb : (h, w) or (h, w, 3), uint8 or uint16.
    """
    unit = 255 / np.iinfo(rgb.dtype).max
    colours = np.repeat(rgb[..., None], 3, axis=2) if rgb.ndim == 2 else rgb
    matrix = yuv_matrix(colour.SMPTE170M, colour.FULL, 0).from_rgb * np.array([unit, unit, unit, 1.0])
    parts = list(
        cv2.split(cv2.transform(np.ascontiguousarray(colours, np.float32), matrix.astype(np.float32)))
    )
    picture = av.VideoFrame(rgb.shape[1], rgb.shape[0], fmt)
    top = (1 << bits) - 1
    for number, (plane, part) in enumerate(zip(picture.planes, parts, strict=True)):
        if number and "420" in fmt:
            part = cv2.resize(part, (plane.width, plane.height), interpolation=cv2.INTER_AREA)
        levels = (part - 128) * (top / 255) + (top + 1) / 2 if number else part * (top / 255)
        kind = np.dtype(np.uint8 if bits == 8 else "<u2")
        rows = np.frombuffer(plane, kind).reshape(plane.height, -1)  # type: ignore[call-overload]
        rows[:, : plane.width] = np.clip(np.rint(levels), 0, top)
    picture.colorspace, picture.color_range = colour.SMPTE170M, colour.FULL
    return picture
