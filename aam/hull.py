"""The convex hull of points in a picture, and what lies beyond it.  Pixels, x right, y down."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F64
from guise.common.small import mean


def beyond_hull(places: F64, points: F64) -> tuple[F64, F64]:
    """How far places (k, 2) lie beyond the edge of the hull of points (n, 2) that they are farthest beyond.

    Returns lengths (k,), negative inside, and the unit normals (k, 2) of these edges, outwards.
    """
    hull = cv2.convexHull(points.astype(np.float32))[:, 0].astype(np.float64)
    along = np.concatenate([hull[1:], hull[:1]]) - hull
    out = along[:, ::-1] * (1, -1)
    out *= np.sign(np.add.reduce((hull - mean(hull, 0)) * out, None))
    out /= np.maximum(np.hypot(along[:, :1], along[:, 1:]), 1e-9)
    beyond = places @ out.T - np.add.reduce(hull * out, 1)
    farthest = beyond.argmax(1)
    return beyond[np.arange(len(places)), farthest], out[farthest]
