"""The built-in landmarker: face81 by a small network that ships with the package.

`aam/data/landmarks.onnx` is made by `training/train_landmarks.py` (see `aam/data/landmarks.md` for data, licence and
errors), its confidence by `training/calibrate_landmarks.py`. The network sees an upright square crop of 128 x 128
pixels about the face and gives each point with a standard deviation, and how much the crop looks like a face.

Pixels, x right, y down, pixel centres at integers; images RGB uint8 (h, w, 3). Not for several threads at once.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.face import BoxDetector, Face, Image, iou
from guise.aam.landmarks.plausible import visible_share
from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS, interocular
from guise.aam.onnx_model import open_session

DATA = Path(__file__).parents[1] / "data"
SIZE = 128  # pixels, the side of the crop
ENLARGE = 1.25  # crop side / longer side of the box of the 81 points
# The box of the 81 points from that of the iBUG 68, in sides of the latter: the forehead lies above.
_TALLER, _HIGHER = 1.33, 0.16
_CANDIDATE = 0.2  # score of a box from which the network has a look; its own confidence decides
_SAME = 0.5  # overlap of the points' boxes above which two finds are one face
_LEAST_VISIBLE = 0.4  # share of the points that must lie inside the picture
_WORTH = 0.002  # confidence after the first pass below which there is no second
_LEAST = 0.05  # faces of lower confidence are not told


@dataclass(frozen=True)
class Calibration:
    """From what the network says to probabilities.

    face : bias and weights of log(mean sigma / inter-ocular distance) and of the face logit (clipped to +-8); the
        logistic function of their sum is the probability that the mean error is under 5 % of the inter-ocular distance.
    sigma : factor from the network's standard deviations to those measured.
    """

    face: tuple[float, float, float]
    sigma: float

    def confidence(self, sigma: NDArray[Any], eyes: float, logit: float) -> float:
        """Probability for standard deviations (81,) pixels, inter-ocular distance in pixels and face logit."""
        bias, spread, looks = self.face
        z = bias + spread * np.log(max(float(np.mean(sigma)) / eyes, 1e-6)) + looks * np.clip(logit, -8, 8)
        return float(1 / (1 + np.exp(-np.clip(z, -60, 60))))

    def of_points(self, sigma: NDArray[Any], eyes: float) -> NDArray[np.float32]:
        """Probability (81,) that each point is nearer to its place than 5 % of the inter-ocular distance."""
        reach = 0.05 * eyes / np.maximum(self.sigma * sigma, 1e-6)
        return np.asarray(1 - np.exp(-0.5 * reach**2), np.float32)


@cache
def calibration() -> Calibration:
    """The calibration shipped with the package."""
    stored = json.loads((DATA / "landmarks.json").read_text(encoding="utf-8"))
    bias, spread, looks = stored["face"]
    return Calibration((bias, spread, looks), stored["sigma"])


@dataclass(frozen=True, eq=False)
class Found:
    """What one pass gives: points (81, 2) and their standard deviations (81,) in pixels of the picture, face logit."""

    points: NDArray[np.float64]
    sigma: NDArray[np.float64]
    logit: float


class BuiltinLandmarker:
    """Finds faces by a detector and their 81 points by the network that ships with the package.

    Parameters
    ----------
    detector : BoxDetector, optional
        Default: the built-in one.
    threads : int
        Of onnxruntime.
    """

    name = "builtin"

    def __init__(self, detector: BoxDetector | None = None, threads: int = 1) -> None:
        if detector is None:
            from guise.aam.landmarks.detector import FaceDetector

            detector = FaceDetector(min_score=_CANDIDATE, threads=threads)
        self.detector = detector
        self._session = open_session((DATA / "landmarks.onnx").read_bytes(), threads)
        self._calibration = calibration()

    def detect(self, rgb: Image) -> list[Face]:
        """All faces, largest box first; confidence is a probability, see `Calibration`."""
        boxes = [self.detector.fit.apply(box) for box in self.detector.detect(rgb)]
        faces: list[Face] = []
        for box in boxes:
            face = self.points_in_box(rgb, box)
            if face is not None:
                faces.append(face)
        return _distinct(faces)

    def refine(self, rgb: Image, previous: Face) -> Face | None:
        """The face of the frame before, found again; None when what is there is no face."""
        return self._judged(rgb, self._pass(rgb, *_upright(previous.points.astype(np.float64))))

    def points_in_box(self, rgb: Image, box: NDArray[Any]) -> Face | None:
        """The face whose iBUG-68 points fill box (4,) ``x0 y0 x1 y1``: one pass, and another on the upright crop."""
        first = self._first(rgb, box)
        if not _usable(first.points) or self._confidence(first) < _WORTH:
            return None
        return self._judged(rgb, self._pass(rgb, *_upright(first.points)))

    def likeness(self, rgb: Image, box: NDArray[Any]) -> float:
        """How much the crop about box (4,) ``x0 y0 x1 y1`` looks like a face, also one too small or hidden for points.

        A logit: above 0 nearly all are faces, below -5 hardly any.
        """
        return self._first(rgb, box).logit

    def _first(self, rgb: Image, box: NDArray[Any]) -> Found:
        corners = np.asarray(box, np.float64)
        side = float((corners[2:] - corners[:2]).max())
        return self._pass(rgb, (corners[:2] + corners[2:]) / 2 - (0, _HIGHER * side), _TALLER * side, 0.0)

    def _pass(self, rgb: Image, centre: NDArray[np.float64], side: float, turn: float) -> Found:
        crop, inverse = cut(rgb, centre, ENLARGE * side, turn)
        points, sigma, face = self._session.run(None, {"crop": crop[None]})
        scale = float(np.hypot(*inverse[:, 0]))
        return Found(
            points[0].astype(np.float64) @ inverse[:, :2].T + inverse[:, 2],
            sigma[0].astype(np.float64) * scale,
            float(face[0]),
        )

    def _judged(self, rgb: Image, found: Found) -> Face | None:
        if not _usable(found.points) or visible_share(found.points, *rgb.shape[1::-1]) < _LEAST_VISIBLE:
            return None
        confidence = self._confidence(found)
        if confidence < _LEAST:
            return None
        eyes = float(interocular(found.points))
        return Face.around(found.points, confidence, self._calibration.of_points(found.sigma, eyes))

    def _confidence(self, found: Found) -> float:
        return self._calibration.confidence(found.sigma, float(interocular(found.points)), found.logit)


def cut(
    rgb: Image, centre: NDArray[np.float64], side: float, turn: float
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Crop (128, 128, 3) of a square, and the affine map (2, 3) from its pixels to the picture's.

    centre, side : pixels; turn : radians, by which the face is rolled clockwise. Black beyond the picture.
    """
    step = max(side, 1e-3) / SIZE
    cos, sin = step * np.cos(turn), step * np.sin(turn)
    linear = np.array([[cos, -sin], [sin, cos]])
    inverse = np.column_stack([linear, centre - linear @ np.full(2, (SIZE - 1) / 2)])
    source, local = rgb, inverse
    if step >= 2:  # average whole blocks before sampling, so that nothing aliases
        source, local = _shrunk(rgb, inverse, int(step))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(source, local, (SIZE, SIZE), flags=flags), np.uint8), inverse


def _shrunk(rgb: Image, inverse: NDArray[np.float64], factor: int) -> tuple[Image, NDArray[np.float64]]:
    """The part of the picture that a crop needs, averaged over blocks of `factor` pixels, and the map into it."""
    corners = np.array([[0, 0], [SIZE, 0], [0, SIZE], [SIZE, SIZE]]) - 0.5
    reached = corners @ inverse[:, :2].T + inverse[:, 2]
    limit = np.array(rgb.shape[1::-1])
    low = np.clip(np.floor(reached.min(0)) - factor, 0, np.maximum(limit - factor, 0)).astype(int)
    high = np.clip(np.ceil(reached.max(0)) + factor, low + 1, limit).astype(int)
    blocks = np.maximum((high - low) // factor, 1)
    high = np.minimum(low + blocks * factor, limit)
    part = rgb[low[1] : high[1], low[0] : high[0]]
    small = cv2.resize(part, (int(blocks[0]), int(blocks[1])), interpolation=cv2.INTER_AREA)
    scale = blocks / (high - low)
    linear = inverse[:, :2] * scale[:, None]
    return np.asarray(small, np.uint8), np.column_stack([linear, (inverse[:, 2] - low + 0.5) * scale - 0.5])


def _upright(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Centre, side and turn of the box of points (81, 2) in the frame in which the eyes are level."""
    right, left = (points[i] for i in OUTER_EYE_CORNERS)
    turn = float(np.arctan2(left[1] - right[1], left[0] - right[0]))
    cos, sin = np.cos(turn), np.sin(turn)
    level = points @ np.array([[cos, -sin], [sin, cos]])
    low, high = level.min(0), level.max(0)
    return np.array([[cos, -sin], [sin, cos]]) @ ((low + high) / 2), float((high - low).max()), turn


def _usable(points: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(points).all() and np.ptp(points, axis=0).min() > 2 and interocular(points) > 1)


def _distinct(faces: list[Face]) -> list[Face]:
    """The surest of those that overlap; largest box first."""
    kept: list[Face] = []
    for face in sorted(faces, key=lambda f: -f.confidence):
        if all(iou(face.box, other.box) < _SAME for other in kept):
            kept.append(face)
    return sorted(kept, key=lambda f: -f.area)
