"""The person's own brows painted over with the skin around them, where no drawn face hides them.

A brow of the source may reach beyond the drawn face: its tail at the temple, or an arch above the drawn forehead.  Two
brows, one above the other, give a swap away at once.  So before the face is drawn, what the parsing takes for brows
becomes skin as it is beside them, unless both brows lie on one line: the drawn one, which ends with the face, goes on
in the person's own then.  Hair, glasses and things in front of a brow stay.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.parsing import FaceClass, Parsing
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class BrowCoverLimits:
    """Lengths in face widths, shares of classes."""

    reach: float = 0.09  # beyond a brow's points, within which it is looked for
    brow_share: tuple[float, float] = (0.06, 0.25)  # up to which nothing is painted over, from which all is
    apart: tuple[float, float] = (0.015, 0.03)  # from the drawn brow, up to which one goes on in the other
    tail: float = 0.1  # by which a drawn brow goes on beyond its last point
    growth: float = 0.02  # of what is painted over
    beside: float = 0.05  # standard deviation of the weights of the skin beside
    least_skin: tuple[float, float] = (0.003, 0.02)  # mean weight, below which nothing is known of it
    step: float = 0.0125  # between the places at which all of this is found


LIMITS = BrowCoverLimits()
IN_FRONT = FaceClass.GLASSES, FaceClass.OCCLUDER
KINDS = FaceClass.BROWS, FaceClass.SKIN


def cover_brows(roi: U8, head: F64, drawn: F64, parsing: Parsing, width: float) -> None:
    """Paint over the brows of a head (81, 2) in a rectangle (h, w, 3) of a frame, in place.

    drawn : (81, 2), the face that is drawn.   parsing : of the rectangle.   width : of the face, pixels.
    """
    for brow, outwards in ((RIGHT_BROW, np.s_[::-1]), (LEFT_BROW, np.s_[:])):
        share = _share_apart(head[brow][outwards], drawn[brow][outwards], width)
        if share == 0:
            continue
        reach = LIMITS.reach * width
        x0, y0 = np.maximum(np.floor(head[brow].min(0) - reach), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(head[brow].max(0) + reach), roi.shape[1::-1]).astype(int)
        step = max(round(LIMITS.step * width), 1)
        if min(x1 - x0, y1 - y0) > 2 * step:
            part = roi[y0:y1, x0:x1]
            brows, skin = _shares(parsing.from_place(x0, y0), part.shape[:2], step)
            _cover(part, share * brows, skin, width / step)


def _share_apart(own: F64, drawn: F64, width: float) -> np.float32:
    """Share in [0, 1] by which a brow's points (5, 2), the tail's last, do not lie on the drawn one's line."""
    tail = drawn[-1] - drawn[-2]
    tail *= LIMITS.tail * width / max(float(np.linalg.norm(tail)), 1e-6)
    line = np.concatenate([drawn, [drawn[-1] + tail]])
    first, last = LIMITS.apart
    away = max(_to_line(point, line) for point in own[len(own) // 2 :])
    return np.float32(np.clip((away / width - first) / (last - first), 0, 1))


def _to_line(point: F64, line: F64) -> float:
    """Distance of a point (2,) from a line through points (n, 2)."""
    start, along = line[:-1], np.diff(line, axis=0)
    share = ((point - start) * along).sum(1) / np.maximum((along**2).sum(1), 1e-9)
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    return float(np.linalg.norm(point - nearest, axis=1).min())


def _shares(parsing: Parsing, size: tuple[int, ...], step: int) -> tuple[F32, F32]:
    """(h / step, w / step) shares of brows, and of bare skin, in a rectangle (h, w)."""
    planes = np.dstack([*(parsing.shares[kind] for kind in KINDS), parsing.share(*IN_FRONT)])
    ys, xs = np.mgrid[: size[0] : step, : size[1] : step]
    values = parsing.at(np.column_stack([xs.ravel(), ys.ravel()]), planes).reshape(*xs.shape, -1)
    first, last = LIMITS.brow_share
    brows, skin, front = (np.ascontiguousarray(values[..., k]) for k in range(3))
    return np.clip((brows - first) / (last - first), 0, 1) * np.clip(1 - 4 * front, 0, 1), skin


def _cover(part: U8, brows: F32, skin: F32, width: float) -> None:
    """Paint over brows in a rectangle (h, w, 3), in place.

    brows, skin : shares at places that lie `width` to a face, of what is painted over and of what is bare skin.
    """
    if not brows.any():
        return
    size, sigma = part.shape[1::-1], LIMITS.beside * width
    grown = 2 * max(round(LIMITS.growth * width), 1) + 1
    brows = np.asarray(
        cv2.GaussianBlur(cv2.dilate(brows, np.ones((grown, grown))), (0, 0), grown / 4), np.float32
    )
    small = cv2.resize(part, brows.shape[::-1], interpolation=cv2.INTER_AREA).astype(np.float32)
    weight = np.clip(2 * skin - 1, 0, 1) * np.clip(1 - 4 * brows, 0, 1)
    known = cv2.GaussianBlur(weight, (0, 0), sigma)
    beside = cv2.GaussianBlur(small * weight[..., None], (0, 0), sigma) / np.maximum(known, 1e-6)[..., None]
    first, last = LIMITS.least_skin
    brows *= np.clip((known - first) / (last - first), 0, 1)
    share = cv2.resize(brows, size)
    paint = cv2.resize(np.asarray(np.clip(beside, 0, 255), np.uint8), size)
    part[:] = cv2.blendLinear(paint, np.ascontiguousarray(part), share, 1 - share)
