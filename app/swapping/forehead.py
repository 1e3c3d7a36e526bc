"""The forehead of a disguise, which is drawn over hair: its skin, and where it passes into the hair.

The mesh is stretched from the brows to the new hairline, and a texture with it, until brows are smeared upwards.  So
what lies above them is read from where it would lie without the stretch, and beyond the face's own hairline skin is
continued as in a mirror.  At the new hairline strands of the head's hair lie over the skin, as they do where hair
recedes.  Grid pixels, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import BROWS, FOREHEAD, NOSE
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.app.swapping.place import outward
from guise.common.arrays import F32, F64, U8, Bool


@dataclass(frozen=True)
class ForeheadLimits:
    """Face widths."""

    rim: float = 0.055  # within the face's own hairline, where its texture isn't only skin
    above_brows: float = 0.05  # where skin begins that can be mirrored
    least: float = 0.03  # height of it
    softening: float = 0.03  # standard deviation
    inwards: float = 0.4  # share by which that is read nearer to the middle, off the ends of brows
    # Of the strands at the hairline: how far they reach in at the middle, how wide they and tufts of them are, how long
    # they stay alike, and how soft their ends are, as a share of their reach.
    reach: float = 0.09
    widths: tuple[float, float] = (0.004, 0.012)
    length: float = 0.07
    softness: float = 0.65


LIMITS = ForeheadLimits()


@dataclass(frozen=True, eq=False)
class Forehead:
    """How the texture of a face is read whose forehead is drawn farther up.

    Parameters
    ----------
    places : (h, w, 2) where each pixel's texture is read.
    softened : (h, w) share in [0, 1] by which it is softened there: what is mirrored must not be seen twice.
    sigma : pixels, of that.
    added : (h, w) share in [0, 1] by which a pixel is drawn beyond the face's own hairline.
    """

    places: F32
    softened: F32
    sigma: float
    added: F32

    @classmethod
    def of(cls, reference: ReferenceFrame, face_widths: float) -> Forehead:
        """For a forehead that is drawn so much farther up, see `outward`."""
        return _forehead(reference.resolution, face_widths)

    @classmethod
    def _made(cls, reference: ReferenceFrame, face_widths: float) -> Forehead:
        height, width = reference.size
        y, x = np.mgrid[:height, :width].astype(np.float64)
        found, (softened, added) = np.dstack([x, y]).reshape(-1, 2), np.zeros((2, height * width))
        places = found[reference.pixels]
        moved = outward(reference, 0.0, face_widths)
        stretched = MeshSampler.build(reference, places).positions(moved).astype(np.float64)
        drawn, centre = places + stretched, reference.points[NOSE].mean(0)
        along, away = _polar(drawn - centre)
        rim = LIMITS.rim * reference.resolution
        _, own = _skin(reference, centre, along, moved)
        excess, share = away - own, np.clip(np.linalg.norm(stretched, axis=1) / rim, 0, 1)
        inwards = along * (1 - LIMITS.inwards * share * np.clip(excess / rim + 1, 0, 1))
        low, high = _skin(reference, centre, inwards, moved)
        turn = np.mod(excess, 2 * (high - low))
        away = np.where(excess > 0, high - np.minimum(turn, 2 * (high - low) - turn), away + high - own)
        read = centre + away[:, None] * np.column_stack([np.sin(inwards), -np.cos(inwards)])
        found[reference.pixels] = np.where(share[:, None] > 0, read, places)
        softened[reference.pixels] = share * np.clip(excess / rim + 1, 0, 1)
        added[reference.pixels] = share * np.clip(excess / rim - 0.5, 0, 1)
        return cls(
            found.reshape(height, width, 2).astype(np.float32),
            softened.reshape(height, width).astype(np.float32),
            LIMITS.softening * reference.resolution,
            added.reshape(height, width).astype(np.float32),
        )

    def continued(self, picture: U8) -> U8:
        """A texture (h, w, 3) with the forehead continued."""
        read = cv2.remap(picture, self.places, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
        soft = cv2.GaussianBlur(read, (0, 0), self.sigma)
        return np.asarray(cv2.blendLinear(soft, read, self.softened, 1 - self.softened), np.uint8)

    def detailed(self, detail: F32) -> F32:
        """Detail (2 h, 2 w) of such a texture."""
        height, width = self.softened.shape
        places = 2 * cv2.resize(self.places, (2 * width, 2 * height)) + np.float32(0.5)
        return np.asarray(cv2.remap(detail, places, None, cv2.INTER_LINEAR), np.float32)  # type: ignore[call-overload]


@lru_cache(maxsize=4)
def _forehead(resolution: int, face_widths: float) -> Forehead:
    return Forehead._made(ReferenceFrame.canonical(resolution), face_widths)


def strands(mesh: F64, inside: Bool, beyond: F64, face_width: float) -> F32:
    """(h, w) share in [0, 1] of skin among the strands of hair at the rim of a face that is drawn on a mesh (81, 2).

    inside : (h, w) where it is drawn.   beyond : (81, 2), the more its forehead is moved, the farther strands reach in.
    """
    centre = mesh[NOSE].mean(0)
    at_line, _ = _polar(mesh[FOREHEAD] - centre)
    depth = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    y, x = np.mgrid[: inside.shape[0], : inside.shape[1]]
    along, _ = _polar(np.column_stack([x.ravel(), y.ravel()]) - centre)
    along = along.reshape(inside.shape)
    share = np.interp(along, at_line, _shares(beyond), left=0, right=0)
    reach = face_width * LIMITS.reach * np.square(share)
    hair = _hair(face_width)
    rows = np.clip(depth, 0, len(hair) - 1).astype(np.float32)
    columns = ((along / (2 * np.pi) + 0.5) * (hair.shape[1] - 1)).astype(np.float32)
    length = cv2.remap(hair, columns, rows, cv2.INTER_LINEAR) * (1 - LIMITS.softness)
    alpha = np.clip((depth / np.maximum(reach, 1) - length) / LIMITS.softness, 0, 1)
    return np.asarray(np.where(share > 0, alpha, 1), np.float32)


def _hair(face_width: float) -> F32:
    """(depth, around) lengths of strands in [0, 1], as shares of the reach; they begin at the first row."""
    size = math.ceil(LIMITS.reach * face_width) + 2, math.ceil(4 * face_width)
    noise = np.random.default_rng(0).standard_normal((len(LIMITS.widths), *size)).astype(np.float32)
    total = np.zeros(size, np.float32)
    for width, one in zip(LIMITS.widths, noise, strict=True):
        smooth = cv2.GaussianBlur(
            one, (0, 0), sigmaX=max(width * face_width, 0.3), sigmaY=LIMITS.length * face_width,
            borderType=cv2.BORDER_REFLECT,
        )  # fmt: skip
        total += smooth / smooth.std()
    order = np.argsort(np.argsort(total.ravel()))
    return np.asarray(order.reshape(size) / (order.size - 1), np.float32)


def _polar(away: F64) -> tuple[F64, F64]:
    """Angles (n,) clockwise from straight up, and lengths, of (n, 2)."""
    return np.arctan2(away[:, 0], -away[:, 1]), np.hypot(away[:, 0], away[:, 1])


def _skin(reference: ReferenceFrame, centre: F64, along: F64, moved: F64) -> tuple[F64, F64]:
    """Distances (n,) from the centre, in directions (n,), between which the forehead is skin."""
    (at_line, line), (at_brow, brow) = (
        _polar(reference.points[list(points)] - centre) for points in (FOREHEAD, BROWS)
    )
    rim = LIMITS.rim * reference.resolution * _shares(moved)
    high = np.interp(along, at_line, line - rim)
    order = np.argsort(at_brow)
    low = np.interp(along, at_brow[order], brow[order]) + LIMITS.above_brows * reference.resolution
    return low, np.maximum(high, low + LIMITS.least * reference.resolution)


def _shares(beyond: F64) -> F64:
    """(13,) by which the forehead's points are moved, of the farthest."""
    away = np.linalg.norm(beyond[FOREHEAD], axis=1)
    return np.asarray(away / max(float(away.max()), 1e-6))
