"""Glasses with thin rims, drawn over a person in a picture."""

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.common.arrays import F64, U8

SIZE_EYES = 0.33, 0.25  # half the width and the height of a lens, distances between the eyes


def lenses(shape: F64, points: int = 120) -> F64:
    """(2, n, 2) the lines of the rims of glasses on a face (81, 2)."""
    right, left = shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0)
    along = left - right
    down = np.array([-along[1], along[0]])
    turns = np.linspace(0, 2 * np.pi, points, endpoint=False)[:, None]
    across, up = SIZE_EYES
    circle = across * np.cos(turns) * along + up * np.sin(turns) * down
    return np.array([middle + 0.07 * down + circle for middle in (right, left)])


def with_rims(rgb: U8, shape: F64, colour: tuple[int, int, int]) -> U8:
    """A person who wears thin glasses."""
    out = rgb.copy()
    lines = lenses(shape)
    ends = [lines[0, 0], lines[1, len(lines[1]) // 2]]
    for line, closed in ((lines[0], True), (lines[1], True), (np.array(ends), False)):
        corners = np.round(16 * line).astype(np.int32)
        cv2.polylines(out, [corners], closed, colour, 2, cv2.LINE_AA, shift=4)
    return out
