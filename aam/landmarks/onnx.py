"""Landmarks from an ONNX model that a TOML card describes, run by onnxruntime.

The user brings the model and its card; :mod:`guise.aam.landmarks.card` describes the card's format. Images RGB uint8
(h, w, 3); pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.card import LandmarkCard, read_card
from guise.aam.landmarks.crops import crop_to_picture, roll
from guise.aam.landmarks.face import BoxDetector, Face, LandmarkError, iou, tight_box
from guise.aam.landmarks.plausible import pass_shift, settled_confidence, shape_confidence, visible_share
from guise.aam.onnx_model import OnnxModel
from guise.common.arrays import F64, U8


@dataclass(frozen=True)
class OnnxLimits:
    """Thresholds of landmarkers with a card."""

    min_visible_share: float = 0.5  # of the points inside the picture, below which a face is lost
    min_confidence: float = 0.1
    max_distinct_iou: float = 0.4  # of the points' boxes, from which two faces are one
    settled_shift_interocular: float = (
        0.03  # mean, from one pass to the next, up to which the points have settled
    )
    max_refine_passes: int = 3


LIMITS = OnnxLimits()


class OnnxLandmarker:
    """Landmarker from a card and a box detector.

    Parameters
    ----------
    card : path or LandmarkCard
        The TOML card.
    detector : BoxDetector, optional
        Finds the faces to start from; without one :class:`guise.aam.landmarks.boxes.LbpDetector`.
    threads : int
        Threads of onnxruntime within one call; one by default, as the models are small.
    """

    def __init__(
        self, card: str | Path | LandmarkCard, detector: BoxDetector | None = None, threads: int = 1
    ) -> None:
        self.card = card if isinstance(card, LandmarkCard) else read_card(card)
        self.detector = detector if detector is not None else _default_detector()
        self._within = list(self.card.scheme.within)
        self._model = OnnxModel(self.card, self.card.output, threads)
        boxes = self.card.boxes or {}
        self._fit = boxes.get(self.detector.name, self.detector.fit)
        self._predict(np.zeros((*self.card.size[::-1], 3), np.uint8))

    @property
    def name(self) -> str:
        """The card's name and the detector's."""
        return f"{self.card.name}@{self.detector.name}"

    def detect(self, rgb: U8) -> list[Face]:
        """Faces of the picture RGB (h, w, 3), largest box first.

        A face that lies mostly beyond the picture, or has the points of no face, is left out; of two that
        came to the same place the more confident one stays.
        """
        faces: list[Face] = []
        for box, score in zip(*self.detector.detect_scored(rgb), strict=True):
            face = self._from_box(rgb, self._fit.apply(box), float(score))
            if face is not None:
                faces.append(face)
        kept: list[Face] = []
        for face in sorted(faces, key=lambda f: -f.confidence):
            if all(iou(face.box, other.box) < LIMITS.max_distinct_iou for other in kept):
                kept.append(face)
        return sorted(kept, key=lambda f: -f.area)

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The face again, from a crop around its previous points; None when they lead to no face.

        One pass when it moved little, up to three otherwise: on a face they settle, elsewhere they wander.
        """
        points, shift = previous.points, np.inf
        for _ in range(LIMITS.max_refine_passes):
            before, points = points, self._once(rgb, points)
            shift = pass_shift(before, points)
            if not shift > LIMITS.settled_shift_interocular:
                break
        return self._judge(rgb, points, settled_confidence(shift))

    def points_in(self, rgb: U8, box: NDArray[Any], turn: float = 0.0) -> F64:
        """The model's own points (n, 2), pixels of the picture, from one crop.

        box : (4,), the landmarks' box; turn : radians, by which the face is rolled clockwise.
        """
        width, height = self.card.size
        corners = np.asarray(box, np.float64)
        centre, side = (
            (corners[:2] + corners[2:]) / 2,
            float(self.card.enlarge * (corners[2:] - corners[:2]).max()),
        )
        inverse = crop_to_picture(centre, side, turn, (width, height))
        crop = cv2.warpAffine(rgb, inverse, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
        return np.asarray(self._predict(np.asarray(crop, np.uint8)) @ inverse[:, :2].T + inverse[:, 2])

    def _from_box(self, rgb: U8, box: NDArray[Any], score: float) -> Face | None:
        points = self.card.scheme.complete(self.points_in(rgb, box))
        shift = 0.0
        for _ in range(self.card.passes - 1):
            before, points = points, self._once(rgb, points)
            shift = pass_shift(before, points)
        return self._judge(rgb, points, min(score, settled_confidence(shift)))

    def _once(self, rgb: U8, points: NDArray[Any]) -> NDArray[Any]:
        if not np.isfinite(points).all():
            return points
        own = self.points_in(rgb, tight_box(points[self._within]), roll(points) if self.card.upright else 0.0)
        return self.card.scheme.complete(own)

    def _judge(self, rgb: U8, points: NDArray[Any], score: float) -> Face | None:
        if (
            not np.isfinite(points).all()
            or visible_share(points, rgb.shape[1], rgb.shape[0]) < LIMITS.min_visible_share
        ):
            return None
        confidence = min(score, shape_confidence(points))
        return Face.around(points, confidence) if confidence >= LIMITS.min_confidence else None

    def _predict(self, crop: U8) -> F64:
        """Points (n, 2) in pixels of the crop, from the crop RGB (height, width, 3)."""
        card, output = self.card, self._model(crop)
        points = _arranged(card, output.astype(np.float64))
        return points * card.size - 0.5 if card.unit == "fraction" else points


def _default_detector() -> BoxDetector:
    from guise.aam.landmarks.boxes import LbpDetector

    return LbpDetector()


def _arranged(card: LandmarkCard, output: F64) -> F64:
    count = card.scheme.count
    if output.size != 2 * count:
        raise LandmarkError(
            f"landmark model {card.model} must put out {2 * count} numbers for scheme {card.scheme.name}, "
            f"got {output.shape}"
        )
    return output.reshape(count, 2) if card.order == "interleaved" else output.reshape(2, count).T
