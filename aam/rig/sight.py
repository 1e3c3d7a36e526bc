"""What the estimator of coefficients sees of a face: two pictures of eye and brow, one of the mouth, and its points.

The windows follow the head, not what moves in them: an eye's lies about its corners, the mouth's below the nose where
it is at rest, both rolled and scaled with the head.  Points are where they are seen beside those of the mean face in
the same pose, straightened into its plane.  Pixels, x right, y down; lengths in face widths where not said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    IBUG68,
    LEFT_EYE_CORNERS,
    NOSE_BASE,
    OUTER_LIPS,
    RIGHT_EYE_CORNERS,
)
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.common.arrays import F32, F64, U8, Floating
from guise.common.small import mean

EYE_SIZE = (48, 48)  # columns and rows
MOUTH_SIZE = (64, 48)
SHAPE_VALUES = 2 * 68 + 3
CELLS, DIRECTIONS = 8, 8  # to a side of a window, and in a full circle
WINDOW_VALUES = (DIRECTIONS + 4) * CELLS**2
# Rows and columns around the eye in its window; those of the iris in these, at half size.
NEAR_EYE, WITHIN = np.s_[16:48, 2:46], np.s_[5:14, 4:18]
IRIS_RADII, IRIS_SHARPNESS = (2.5, 3.5), 0.15  # pixels at half size; share of the answer
MOST_IRIS = 6.0  # pixels from the middle
LEAST_SPREAD = 4.0  # of luma, of a window that shows nothing
_ANGLES = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
_DIRECTIONS: F32 = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]).astype(np.float32)


@dataclass(frozen=True)
class Windows:
    """Widths and places of the windows, face widths."""

    eye_width: float = 0.34
    eye_rise: float = 0.075  # of the middle above that of the eye's corners
    mouth_width: float = 0.56
    mouth_drop: float = 0.21  # of the middle below the nose


WINDOWS = Windows()


@dataclass(frozen=True, eq=False)
class FaceSight:
    """What the network is given.

    Parameters
    ----------
    eyes : (2, 48, 48) uint8 luma, the person's right eye, and the left one mirrored.
    mouth : (48, 64) uint8 luma.
    shape : (139,) float32: 68 points (x, y) beside the mean face, in tenths of a face width, then yaw, pitch, roll in
        units of 30 degrees.
    """

    eyes: U8
    mouth: U8
    shape: F32


def see(picture: U8, points: Floating, pose: HeadPose) -> FaceSight:
    """The sight of a face with points (81, 2) and a pose in a picture RGB (h, w, 3) or luma (h, w)."""
    exact: F64 = np.asarray(points, np.float64)
    return FaceSight(
        np.stack([_cut(picture, *place, EYE_SIZE) for place in eye_places(exact, pose)]),
        _cut(picture, *mouth_place(exact, pose), MOUTH_SIZE),
        shape_of(exact, pose),
    )


def eye_places(points: F64, pose: HeadPose) -> list[tuple[F64, F64]]:
    """Middle (2,) and linear part (2, 2), pixels a face width, of both eyes' windows; the left one is mirrored."""
    turned = pose.scale * _rolled(pose)
    rise = turned @ (0, -WINDOWS.eye_rise)
    right, left = (mean(points[corners], 0) + rise for corners in (RIGHT_EYE_CORNERS, LEFT_EYE_CORNERS))
    side = turned * WINDOWS.eye_width
    return [(right, side), (left, side * (-1, 1))]


def mouth_place(points: F64, pose: HeadPose) -> tuple[F64, F64]:
    """Likewise, of the mouth's window."""
    middle = points[NOSE_BASE] + np.array([0, WINDOWS.mouth_drop, _mouth_depth()]) @ pose.linear
    return middle, pose.scale * _rolled(pose) * WINDOWS.mouth_width


def shape_of(points: F64, pose: HeadPose) -> F32:
    """The values (139,) of `FaceSight.shape`."""
    away = points[IBUG68] - pose.apply(_mean_face())
    across = np.array(pose.linear[:2])
    flat = np.linalg.solve(across.T, away.T).T
    made = np.empty(SHAPE_VALUES, np.float32)
    made[:-3] = 10 * flat.ravel()
    made[-3:] = np.array(pose.angles) / 30
    return made


def _rolled(pose: HeadPose) -> F64:
    """(2, 2) rotation by the head's roll."""
    turn = np.radians(pose.angles[2])
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin], [sin, cos]])


def _cut(picture: U8, middle: F64, linear: F64, size: tuple[int, int]) -> U8:
    """The window of `size` about a place; the picture's border goes on beyond it."""
    matrix = np.empty((2, 3))
    matrix[:, :2] = linear / size[0]
    step = float(np.hypot(*matrix[:, 0]))
    if step > 2:  # average whole blocks first, so that nothing aliases
        factor = int(step)
        reach = float(np.abs(linear).sum()) / 2 + 2 * factor
        low = np.clip(
            np.floor(middle - reach), 0, np.maximum(np.array(picture.shape[1::-1]) - factor, 0)
        ).astype(int)
        high = np.clip(np.ceil(middle + reach), low + factor, picture.shape[1::-1]).astype(int)
        width, height = (high - low) // factor
        part = picture[low[1] : low[1] + height * factor, low[0] : low[0] + width * factor]
        picture = np.asarray(
            cv2.resize(part, (int(width), int(height)), interpolation=cv2.INTER_AREA), np.uint8
        )
        middle, matrix = (middle - low + 0.5) / factor - 0.5, matrix / factor
    matrix[:, 2] = middle - matrix[:, :2] @ ((size[0] - 1) / 2, (size[1] - 1) / 2)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(picture, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cv2.cvtColor(cut, cv2.COLOR_RGB2GRAY) if cut.ndim == 3 else cut, np.uint8)


def iris_values(eye: U8) -> F32:
    """(4,) where a dark disc lies in an eye's window, x and y, by two radii, pixels from its middle.

    The response to a disc in a bright ring, and the mean place weighted by its exponential.
    """
    part = cv2.resize(eye[NEAR_EYE], None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    found = np.empty(2 * len(IRIS_RADII), np.float32)
    for k, radius in enumerate(IRIS_RADII):
        answer = cv2.filter2D(part, cv2.CV_32F, _disc(radius), borderType=cv2.BORDER_REPLICATE)[WITHIN]
        above = answer - np.maximum.reduce(answer, None)
        weight = np.exp(above / (1e-3 - IRIS_SHARPNESS * mean(above)))
        weight /= np.add.reduce(weight, None)
        rows, columns = _centred(weight.shape[0]), _centred(weight.shape[1])
        found[2 * k], found[2 * k + 1] = np.add.reduce(weight, 0) @ columns, np.add.reduce(weight, 1) @ rows
    return np.minimum(np.maximum(2 * found, -MOST_IRIS), MOST_IRIS)


def window_values(window: U8) -> F32:
    """What a window (h, w) shows, whatever its brightness and contrast: edges by direction, and luma, coarsely.

    Histograms of gradients (Dalal and Triggs 2005) over 8 x 8 cells, 8 directions to full circle, each value's root,
    then luma over 16 x 16 cells.
    """
    luma = window.astype(np.float32)
    middle, spread = cv2.meanStdDev(luma)
    luma = (luma - np.float32(middle[0, 0])) / np.float32(spread[0, 0] + LEAST_SPREAD)
    across = cv2.Sobel(luma, cv2.CV_32F, 1, 0, borderType=cv2.BORDER_REPLICATE)
    down = cv2.Sobel(luma, cv2.CV_32F, 0, 1, borderType=cv2.BORDER_REPLICATE)
    gradients = _DIRECTIONS @ np.concatenate([across, down]).reshape(2, -1)
    edges = np.maximum(gradients, 0).reshape(DIRECTIONS, *luma.shape)
    half = _averages(luma.shape[0]).T @ (edges @ _averages(luma.shape[1]))
    coarse = cv2.resize(luma, (2 * CELLS, 2 * CELLS), interpolation=cv2.INTER_AREA)
    return np.concatenate([np.sqrt(half).ravel(), coarse.ravel()])


@cache
def _centred(count: int) -> F32:
    """Places of a row of pixels from its middle."""
    return np.arange(count, dtype=np.float32) - np.float32((count - 1) / 2)


@cache
def _disc(radius: float) -> F32:
    """A disc below 0 in a ring above, both of sum 1."""
    reach = int(np.ceil(1.6 * radius))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    away = np.hypot(x, y)
    inner = np.clip(radius + 0.5 - away, 0, 1)
    ring = np.clip(1.5 * radius + 0.5 - away, 0, 1) - inner
    return np.asarray(ring / ring.sum() - inner / inner.sum(), np.float32)


@cache
def _averages(pixels: int) -> F32:
    """(pixels, CELLS) that averages each cell's share of a side."""
    return np.repeat(np.eye(CELLS, dtype=np.float32), pixels // CELLS, axis=0) * np.float32(CELLS / pixels)


@cache
def _mean_face() -> F64:
    return SolidPrior.shipped().mean[IBUG68]


@cache
def _mouth_depth() -> float:
    """How much farther back the mouth lies than the nose's base."""
    solid = _mean_face()
    return float(solid[list(OUTER_LIPS), 2].mean() - solid[NOSE_BASE, 2])
