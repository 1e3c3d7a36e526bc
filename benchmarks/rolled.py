"""Pictures and clips rolled by any angle, with their points: for benchmarks of faces at any roll.

Degrees clockwise.  Quarter turns move pixels and change nothing; between them the picture is interpolated on a grey
canvas that holds all of it.
"""

from __future__ import annotations

import cv2
import numpy as np

from benchmarks.common import F64, Picture

CANVAS_GREY_LEVEL = 96


def rolled(rgb: Picture, degrees: float) -> tuple[Picture, F64]:
    """A picture (h, w, 3) rolled clockwise, and the affine map (2, 3) of its points."""
    height, width = rgb.shape[:2]
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    linear = np.array([[cos, -sin], [sin, cos]])
    size = np.ceil(np.abs(linear) @ (width, height) - 1e-6).astype(int)
    centre, middle = (np.array([width, height]) - 1) / 2, (size - 1) / 2
    forward = np.column_stack([linear, middle - linear @ centre])
    if degrees % 90 == 0:
        return np.ascontiguousarray(np.rot90(rgb, -round(degrees / 90))), forward
    grey = (CANVAS_GREY_LEVEL,) * 3
    moved = cv2.warpAffine(rgb, forward, size.tolist(), flags=cv2.INTER_LINEAR, borderValue=grey)
    return np.asarray(moved, np.uint8), forward


def moved(points: F64, forward: F64) -> F64:
    """Points (..., 2) after an affine map (2, 3)."""
    return np.asarray(points @ forward[:, :2].T + forward[:, 2])
