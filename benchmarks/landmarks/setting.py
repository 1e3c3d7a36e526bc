"""What the landmarker benchmarks share: their options, the landmarker under test, and reports of skipped ones."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.common import F64, Picture, Report
from guise.aam.landmarks import Face, Landmarker, open_landmarker
from guise.aam.landmarks.tracking import LIMITS

# Faces of less confidence are not taken; what the trackers do by default.
MIN_CONFIDENCE = LIMITS.min_confidence
MEDIAPIPE = "face_landmarker.task"
CENTERFACE_MIN_SCORE = 0.5  # the score from which CenterFace's boxes count


def landmarker(options: argparse.Namespace) -> Landmarker:
    """The landmarker under test, on one thread of OpenCV."""
    cv2.setNumThreads(1)
    return open_landmarker(options.landmarker)


def skipped(name: str, title: str, reason: str) -> Report:
    """A report that says why nothing was measured."""
    return Report(name, title, notes=[f"Skipped: {reason}"])


def picture(path: Path) -> Picture:
    """A picture file as RGB."""
    bgr = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if bgr is None:
        raise FileNotFoundError(f"{path} is no picture that OpenCV reads")
    return np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8, copy=False)


def points_of(faces: list[Face], count: int = 68) -> F64:
    """The first points (n, count, 2) of faces."""
    return np.array([face.points[:count] for face in faces], np.float64).reshape(-1, count, 2)


def boxes_of(points: NDArray[Any]) -> F64:
    """Tight boxes (n, 4) of points (n, p, 2); points that are NaN are left out."""
    if not len(points):
        return np.zeros((0, 4))
    return np.concatenate([np.nanmin(points, axis=1), np.nanmax(points, axis=1)], axis=1).astype(np.float64)


def sure(faces: list[Face]) -> list[Face]:
    """Those that the trackers would take."""
    return [face for face in faces if face.confidence >= MIN_CONFIDENCE]
