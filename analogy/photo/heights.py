"""Luminance as a height field on a grid of quads, and what tents ask of it (Song et al. 2007, section VI).

A pixel (i, j) with luminance l is the vertex (i, j, k l).  Its tent is its four edges and a tip along its normal;
the transformation Q of the tents of S by the expression (eq. 2) is asked of those of T, where i and j are known, so
that only the heights are solved for.  `guise.analogy.tents.Tents` says the same of any mesh; on a grid it is
closed form.

l is the logarithm of the luminance: a change of light that is smooth over the face then adds a smooth surface, which
slopes hardly see.
"""

from __future__ import annotations

import numpy as np

from guise.common.arrays import F32

DARK = np.float32(0.02)  # luminance added before the logarithm, so that noise in black is no relief
STEEPNESS = 2.0  # k: pixels by which a vertex rises for e times the luminance


def heights(luminance: F32) -> F32:
    """l (h, w) of luminance (h, w) in 0 .. 1."""
    return np.asarray(np.log(luminance + DARK))


def slopes(field: F32) -> tuple[F32, F32]:
    """Edges of a field (h, w): to the right (h, w - 1) and down (h - 1, w)."""
    return np.asarray(field[:, 1:] - field[:, :-1]), np.asarray(field[1:] - field[:-1])


def asked(before: F32, after: F32, target: F32) -> tuple[F32, F32]:
    """How the edges of the target's heights (h, w) change when its tents do as the source's, before to after.

    An edge of the target is asked to become Q times itself, its ends agreeing by halves; what Q, which has three
    columns, leaves of the source's own five vectors (w' - Q w) is carried as it is, so that a source is its own answer.
    With i and j fixed only Q's third row counts, and of it the share of heights: (h, w - 1) and (h - 1, w).
    """
    gain = _gain(STEEPNESS * before, STEEPNESS * after)
    right, down = slopes(after - before)
    own_right, own_down = slopes(target - before)
    right += ((gain[:, 1:] + gain[:, :-1]) / 2 - 1) * own_right
    down += ((gain[1:] + gain[:-1]) / 2 - 1) * own_down
    return right, down


def _gain(before: F32, after: F32) -> F32:
    """The share of its height in Q's third row, of each vertex (h, w): Q_33 of eq. 2 with i, j fixed."""
    east, west, south, north = _edges(before)
    east_, west_, south_, north_ = _edges(after)
    tip, tip_ = _tips(east, west, south, north), _tips(east_, west_, south_, north_)
    xx, yy = 2 + tip[0] ** 2, 2 + tip[1] ** 2
    zz = east**2 + west**2 + south**2 + north**2 + tip[2] ** 2
    xy, xz, yz = tip[0] * tip[1], east - west + tip[0] * tip[2], south - north + tip[1] * tip[2]
    x = east_ - west_ + tip_[2] * tip[0]
    y = south_ - north_ + tip_[2] * tip[1]
    z = east * east_ + west * west_ + south * south_ + north * north_ + tip_[2] * tip[2]
    across = xx * yy - xy**2
    first, second = xy * yz - xz * yy, xy * xz - xx * yz
    whole = zz * across + xz * first + yz * second
    return np.asarray((x * first + y * second + z * across) / whole)


def _edges(field: F32) -> tuple[F32, F32, F32, F32]:
    """How much higher the neighbours east, west, south and north are; at the rim as on the other side."""
    wide = np.pad(field, 1, mode="reflect", reflect_type="odd") if min(field.shape) > 1 else np.pad(field, 1)
    return (
        wide[1:-1, 2:] - field,
        wide[1:-1, :-2] - field,
        wide[2:, 1:-1] - field,
        wide[:-2, 1:-1] - field,
    )


def _tips(east: F32, west: F32, south: F32, north: F32) -> tuple[F32, F32, F32]:
    """The tip along the normal, as long as the mean edge."""
    x, y = (west - east) / 2, (north - south) / 2
    mean = (np.sqrt(1 + east**2) + np.sqrt(1 + west**2) + np.sqrt(1 + south**2) + np.sqrt(1 + north**2)) / 4
    size: F32 = np.asarray(mean / np.sqrt(1 + x**2 + y**2), np.float32)
    return np.asarray(x * size), np.asarray(y * size), size
