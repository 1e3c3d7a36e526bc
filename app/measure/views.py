"""What an attacker looks at: the face alone, the face as it is cut out, or hair and outline alone, by an embedding.

Images RGB uint8 (h, w, 3); pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.recognition import picture_signature
from guise.aam.similarity import Failed, align
from guise.app.people.recogniser import Recogniser, five_points
from guise.common.arrays import F32, U8

Region = Literal["face", "outline"]

FILL_GREY_LEVEL = 128  # of what is hidden from a view
HEAD_FACE_SIZES = 1.6  # of a crop with hair and outline, in those of the face
HEAD_SIDE_PIXELS = 24  # of the picture of a head that is itself the embedding
HEAD_POINTS = (
    (0.40, 0.46),
    (0.60, 0.46),
    (0.50, 0.56),
    (0.42, 0.66),
    (0.58, 0.66),
)  # of its side: eyes, nose, mouth
HEAD_BLUR_PIXELS = 1.0


@dataclass(frozen=True)
class Embedder:
    """How faces become embeddings.

    name : shown in reports.   region : what tells the people apart in it.
    embed : gives a unit vector (d,), or None, for a picture (h, w, 3) and landmarks (81, 2).
    """

    name: str
    region: Region
    embed: Callable[[U8, NDArray[Any]], F32 | None]


def embedders(recognisers: Sequence[Recogniser]) -> list[Embedder]:
    """The built-in views, and three for each recogniser."""
    found = [
        Embedder("built-in, face", "face", _signature),
        Embedder("built-in, outline", "outline", head_pixels),
    ]
    for one in recognisers:
        found += [
            Embedder(f"{one.name}, crop", "face", one),
            Embedder(f"{one.name}, face", "face", partial(_face_by, one)),
            Embedder(f"{one.name}, outline", "outline", partial(_outline_by, one)),
        ]
    return found


def _signature(rgb: U8, points: NDArray[Any]) -> F32 | None:
    vector = picture_signature(rgb, points)
    return vector if np.isfinite(vector).all() and vector.any() else None


def _face_by(recogniser: Recogniser, rgb: U8, points: NDArray[Any]) -> F32 | None:
    return recogniser(face_only(rgb, points), points)


def _outline_by(recogniser: Recogniser, rgb: U8, points: NDArray[Any]) -> F32 | None:
    return recogniser(outline_only(rgb, points), _about(points))


def face_only(rgb: U8, points: NDArray[Any]) -> U8:
    """A picture in which all outside the hull of a face (81, 2) is grey."""
    picture = np.full_like(rgb, FILL_GREY_LEVEL)
    inside = _hull(rgb, points)
    picture[inside] = rgb[inside]
    return picture


def outline_only(rgb: U8, points: NDArray[Any]) -> U8:
    """A picture in which the hull of a face (81, 2) is grey."""
    picture = rgb.copy()
    picture[_hull(rgb, points)] = FILL_GREY_LEVEL
    return picture


def head_pixels(rgb: U8, points: NDArray[Any]) -> F32 | None:
    """The colours of a small picture of the head, its face grey: a unit vector without its mean, None if all equal."""
    side = HEAD_SIDE_PIXELS
    move = align(five_points(points), np.array(HEAD_POINTS) * side - 0.5)
    if isinstance(move, Failed):
        return None
    matrix = np.column_stack([move.linear, move.translation])
    sigma = HEAD_BLUR_PIXELS / max(move.scale, 1e-6)
    smooth = cv2.GaussianBlur(outline_only(rgb, points), (0, 0), sigma)
    small = cv2.warpAffine(smooth, matrix, (side, side), borderMode=cv2.BORDER_REPLICATE)
    vector = small.astype(np.float32).ravel()
    vector -= vector.mean()
    length = float(np.linalg.norm(vector))
    return np.asarray(vector / length, np.float32) if length > 1e-3 else None


def _hull(rgb: U8, points: NDArray[Any]) -> NDArray[np.bool_]:
    mask = np.zeros(rgb.shape[:2], np.uint8)
    corners = cv2.convexHull(np.asarray(points, np.float32))
    cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 1)
    return mask.astype(bool)


def _about(points: NDArray[Any]) -> NDArray[Any]:
    """Points (81, 2) spread about their middle, so that a recogniser sees the whole head in place of the face."""
    middle = points.mean(0, keepdims=True)
    return np.asarray(middle + HEAD_FACE_SIZES * (points - middle))
