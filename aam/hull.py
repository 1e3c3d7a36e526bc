"""The convex hull of points in a picture, and what lies beyond it.  Pixels, x right, y down."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F64


def beyond_hull(places: F64, points: F64) -> tuple[F64, F64]:
    """How far places (k, 2) lie beyond the edge of the hull of points (n, 2) that they are farthest beyond.

    Returns lengths (k,), negative inside, and the unit normals (k, 2) of these edges, outwards.
    """
    hull = cv2.convexHull(points.astype(np.float32))[:, 0].astype(np.float64)
    along = np.roll(hull, -1, axis=0) - hull
    out = np.column_stack([along[:, 1], -along[:, 0]])
    out *= np.sign(((hull - hull.mean(0)) * out).sum())
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    beyond = np.einsum("kec,ec->ke", places[:, None] - hull, out)
    return beyond.max(1), out[beyond.argmax(1)]
