"""Luminance as a height field on a grid of quads, and its vertex tents (Song et al. 2007, section VI).

A pixel (i, j) with luminance l is the vertex (i, j, k l).  Its tent consists of four edges and a tip along its normal.
The transformation Q of the tents of S by the expression (eq. 2) is imposed on those of T, where i and j are known, so
that only the heights are solved for.  `guise.analogy.tents.VertexTents` does the same for any mesh; on a grid there is
a closed form.

l is the logarithm of the luminance: a change of light that is smooth over the face then adds a smooth surface, which
hardly affects differences between neighbours.
"""

from __future__ import annotations

import numpy as np

from guise.common.arrays import F32

LUMINANCE_OFFSET = np.float32(0.02)  # added before the logarithm, so that noise in black makes no relief
K_PIXELS = 2.0  # k of section VI: pixels by which a vertex rises for e times the luminance


def log_luminance(luminance: F32) -> F32:
    """l (h, w) of luminance (h, w) in 0 .. 1."""
    return np.asarray(np.log(luminance + LUMINANCE_OFFSET))


def edge_differences(field: F32) -> tuple[F32, F32]:
    """Edges of a field (h, w): to the right (h, w - 1) and down (h - 1, w)."""
    return np.asarray(field[:, 1:] - field[:, :-1]), np.asarray(field[1:] - field[:-1])


def target_edge_changes(before: F32, after: F32, target: F32) -> tuple[F32, F32]:
    """Changes (h, w - 1) and (h - 1, w) of the target's edges when its tents transform as those of the source.

    An edge of the target becomes Q times itself, averaged over the Q of its ends.  The residual of the source's five
    vectors (w' - Q w), which Q with its three columns cannot represent, is added unchanged, so that a source
    transferred to itself is reproduced.  With i and j fixed only the height entry of the third row of Q matters.

    before, after, target : (h, w) heights.
    """
    gain = _height_gain(K_PIXELS * before, K_PIXELS * after)
    right, down = edge_differences(after - before)
    own_right, own_down = edge_differences(target - before)
    right += ((gain[:, 1:] + gain[:, :-1]) / 2 - 1) * own_right
    down += ((gain[1:] + gain[:-1]) / 2 - 1) * own_down
    return right, down


def _height_gain(before: F32, after: F32) -> F32:
    """Q_33 of eq. 2 with i, j fixed, for each vertex (h, w)."""
    east, west, south, north = _neighbour_differences(before)
    east_, west_, south_, north_ = _neighbour_differences(after)
    tip, tip_ = _tent_tips(east, west, south, north), _tent_tips(east_, west_, south_, north_)
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


def _neighbour_differences(field: F32) -> tuple[F32, F32, F32, F32]:
    """Differences to the neighbours east, west, south and north; mirrored (odd) at the border."""
    wide = np.pad(field, 1, mode="reflect", reflect_type="odd") if min(field.shape) > 1 else np.pad(field, 1)
    return (
        wide[1:-1, 2:] - field,
        wide[1:-1, :-2] - field,
        wide[2:, 1:-1] - field,
        wide[:-2, 1:-1] - field,
    )


def _tent_tips(east: F32, west: F32, south: F32, north: F32) -> tuple[F32, F32, F32]:
    """The tip along the normal, with the length of the mean edge."""
    x, y = (west - east) / 2, (north - south) / 2
    mean = (np.sqrt(1 + east**2) + np.sqrt(1 + west**2) + np.sqrt(1 + south**2) + np.sqrt(1 + north**2)) / 4
    size: F32 = np.asarray(mean / np.sqrt(1 + x**2 + y**2), np.float32)
    return np.asarray(x * size), np.asarray(y * size), size
