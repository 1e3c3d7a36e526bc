"""The built-in landmarker: face81 by a small network that ships with the package.

`aam/data/landmarks.onnx` and the confidence in `aam/data/landmarks.json` are made by scripts in `training/`;
`aam/data/landmarks.md` says by which, from what data, under what licence, and how large the errors are. The network
sees an upright square crop of 128 x 128 pixels about the face and gives each point with a standard deviation, and how
much the crop looks like a face.  A picture in which no upright face is found is searched at the other rolls, too, and
a face that is not sure is looked at the other way up: detectors take some faces for upright that hang upside down.

Pixels, x right, y down, pixel centres at integers; images RGB uint8 (h, w, 3). Not for several threads at once.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.correction import shipped
from guise.aam.landmarks.crops import crop_to_picture, upright_square
from guise.aam.landmarks.face import BoxDetector, Face, iou
from guise.aam.landmarks.plausible import visible_share
from guise.aam.landmarks.rolls import HALF_TURN, TURNED, UPRIGHT, detect_at_rolls, turn_of, upward
from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS, interocular
from guise.aam.onnx_model import ShippedNetwork
from guise.common.arrays import F32, F64, U8, Int, side_by_side
from guise.common.kernels import kernel
from guise.common.small import mean

DATA = Path(__file__).parents[1] / "data"
SIZE = 128  # pixels, the side of the crop that the network sees
MAX_BLOCK_PIXELS = 256  # the side of blocks that are averaged for it


@dataclass(frozen=True)
class CropGeometry:
    """Where a crop lies about a face."""

    side_head_boxes: float = 1.25  # of the crop, in longer sides of the box of the 81 points
    head_box_sides: float = 1.33  # that longer side, in those of the box of the 68 iBUG points
    rise_sides: float = 0.16  # how much higher its centre lies: the forehead is above


@dataclass(frozen=True)
class LandmarkerLimits:
    """Thresholds of the built-in landmarker."""

    min_box_score: float = 0.2  # from which the network is run on a box; its own confidence decides
    max_distinct_iou: float = 0.5  # of the points' boxes, from which two faces are one
    min_visible_share: float = 0.4  # of the points, that must lie inside the picture
    min_first_confidence: float = 0.002  # after the first pass, below which there is no second,
    min_first_likeness: float = (
        0.0  # unless the crop looks like a face: rolled by 45 degrees its points are unsure
    )
    min_confidence: float = 0.05  # of a face that is reported
    sure_confidence: float = 0.9  # of a face in a box, from which it is not looked at upside down as well
    near_interocular: float = 0.05  # from its place, within which a point is right
    min_size_pixels: float = 2.0  # of the box of the points, either way
    min_interocular_pixels: float = 1.0
    min_upright_confidence: float = 0.5  # of an upright face, from which no others are searched for,
    max_upright_turn: float = 0.5  # radians, unless it leans by more: then others may lean farther


CROP = CropGeometry()
LIMITS = LandmarkerLimits()


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
        spread = self.face[1]
        z = self.bias(logit) + spread * np.log(max(float(mean(sigma)) / eyes, 1e-6))
        return float(1 / (1 + np.exp(-min(max(float(z), -60.0), 60.0))))

    @cached_property
    def rules(self) -> F64:
        """(7,) of the spread and of sigma; then of `LandmarkerLimits`, in order, what `judge_points` needs."""
        kept = (
            LIMITS.min_visible_share,
            LIMITS.min_confidence,
            LIMITS.near_interocular,
            LIMITS.min_size_pixels,
        )
        return np.array([self.face[1], self.sigma, *kept, LIMITS.min_interocular_pixels])

    def bias(self, logit: float) -> float:
        """What a face logit adds to the sum."""
        bias, _, looks = self.face
        return bias + looks * min(max(logit, -8.0), 8.0)

    def of_points(self, sigma: NDArray[Any], eyes: float) -> F32:
        """Probability (81,) that each point is nearer to its place than 5 % of the inter-ocular distance."""
        reach = LIMITS.near_interocular * eyes / np.maximum(self.sigma * sigma, 1e-6)
        return np.asarray(1 - np.exp(-0.5 * reach**2), np.float32)


@cache
def calibration() -> Calibration:
    """The calibration shipped with the package."""
    stored = json.loads((DATA / "landmarks.json").read_text(encoding="utf-8"))
    bias, spread, looks = stored["face"]
    return Calibration((bias, spread, looks), stored["sigma"])


@dataclass(frozen=True, eq=False)
class Prediction:
    """What one pass of the network gives.

    Points (81, 2) and their standard deviations (81,), in pixels of the picture, NaN if they were not asked for, and
    the face logit; infinite if it was not.
    """

    points: F64
    sigma: F64
    logit: float

    @cached_property
    def eyes(self) -> float:
        """The inter-ocular distance, pixels."""
        return float(interocular(self.points))

    @cached_property
    def is_usable(self) -> bool:
        """Whether the points are finite and some pixels apart."""
        if not np.isfinite(self.points).all():
            return False
        size = np.maximum.reduce(self.points) - np.minimum.reduce(self.points)
        is_large = bool(np.minimum.reduce(size) > LIMITS.min_size_pixels)
        return is_large and self.eyes > LIMITS.min_interocular_pixels


class BuiltinLandmarker:
    """Finds faces by a detector and their 81 points by the network that ships with the package.

    Parameters
    ----------
    detector : BoxDetector, optional
        Default: the built-in one.
    threads : int
        Of onnxruntime.
    turned : sequence of int
        Other rolls, in quarter turns, that are searched where no upright face is confident; see
        `guise.aam.landmarks.rolls`.
    corrected : bool
        Whether the points are corrected by what they usually lack, see `guise.aam.landmarks.correction`.
    """

    name = "builtin"

    def __init__(
        self,
        detector: BoxDetector | None = None,
        threads: int = 1,
        turned: Sequence[int] = TURNED,
        *,
        corrected: bool = True,
    ) -> None:
        if detector is None:
            from guise.aam.landmarks.detector import FaceDetector

            detector = FaceDetector(min_score=LIMITS.min_box_score, threads=threads)
        self.detector = detector
        self._turned = tuple(turned)
        self._session = ShippedNetwork("landmarks.onnx", threads)
        self._calibration = calibration()
        self._correction = shipped() if corrected else None

    def detect(self, rgb: U8) -> list[Face]:
        """All faces, largest box first; confidence is a probability, see `Calibration`.

        Rolled faces are searched where no upright one is confident, and to the side to which a confident one leans.
        """
        faces = self._detect(rgb, UPRIGHT)
        turns = [turn_of(f.points) for f in faces if f.confidence >= LIMITS.min_upright_confidence]
        leaning = [1 if turn > 0 else 3 for turn in turns if abs(turn) > LIMITS.max_upright_turn]
        searched = set(leaning if turns else TURNED) & set(self._turned)
        return distinct(faces + self._detect(rgb, sorted(searched)))

    def _detect(self, rgb: U8, quarter_turns: Sequence[int]) -> list[Face]:
        found = detect_at_rolls(self.detector, rgb, quarter_turns)
        faces = (
            self.points_in_box(rgb, self.detector.fit.apply(box, turn), turn)
            for box, turn in zip(found.boxes, found.turns.tolist(), strict=True)
        )
        return [face for face in faces if face is not None]

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The face of the previous frame in this one; None when there is no face where it was.

        Whether what was surely a face looks like one is only asked where its points leave a doubt.
        """
        square = upright_square(previous.points.astype(np.float64))
        asks = previous.confidence < LIMITS.sure_confidence
        found = self._pass(rgb, *square, asks=asks)
        if not asks and self._judgement(rgb, found, -math.inf)[0] < LIMITS.sure_confidence:
            found = self._pass(rgb, *square)  # the points alone don't say that there is a face
        return self._judged(rgb, found)

    def points_in_box(self, rgb: U8, box: NDArray[Any], turn: float = 0.0) -> Face | None:
        """The face whose iBUG-68 points fill box (4,) ``x0 y0 x1 y1``: one pass, and another on the upright crop.

        Where that is not sure, it may be a face that is upside down in the box, if half turns are searched at all.

        turn : radians, by which the face is rolled clockwise, to about 45 degrees.
        """
        return self.look_in_box(rgb, box, turn)[0]

    def look_in_box(self, rgb: U8, box: NDArray[Any], turn: float = 0.0) -> tuple[Face | None, float]:
        """Both `points_in_box` and `likeness`, which begin with the same pass."""
        first = self._first(rgb, box, turn)
        face = self._second(rgb, first)
        if face is None or face.confidence >= LIMITS.sure_confidence or HALF_TURN not in self._turned:
            return face, first.logit
        other = self._other_way_up(rgb, face)
        is_surer = other is not None and other.confidence > face.confidence
        return other if is_surer else face, first.logit

    def likeness(self, rgb: U8, box: NDArray[Any], turn: float = 0.0) -> float:
        """How much the crop about box (4,) ``x0 y0 x1 y1`` looks like a face, also one too small or hidden for points.

        A logit: above 0 nearly all are faces, below -3 hardly any.
        """
        return self._first(rgb, box, turn, points=False).logit

    def _first(self, rgb: U8, box: NDArray[Any], turn: float, *, points: bool = True) -> Prediction:
        return self._pass(rgb, *_square_about(box, turn), turn, points=points)

    def _second(self, rgb: U8, first: Prediction) -> Face | None:
        """The face after another pass, on the upright crop; None where the first is not like a face."""
        if not first.is_usable or not self._is_hopeful(first):
            return None
        return self._judged(rgb, self._pass(rgb, *upright_square(first.points)))

    def _other_way_up(self, rgb: U8, face: Face) -> Face | None:
        """The face that is upside down where another was seen; a pass more, as its middle lies elsewhere."""
        centre, side, turn = upright_square(face.points.astype(np.float64))
        rough = self._pass(rgb, centre, side, turn + np.pi)
        if not rough.is_usable or not self._is_hopeful(rough):
            return None
        return self._second(rgb, self._pass(rgb, *upright_square(rough.points)))

    def _pass(
        self, rgb: U8, centre: F64, side: float, turn: float, *, asks: bool = True, points: bool = True
    ) -> Prediction:
        """What the network gives.

        asks : whether it looks like a face, a sixth of the time.   points : whether there are any, a third.
        """
        crop, inverse = cut(rgb, centre, CROP.side_head_boxes * side, turn)
        least = -math.inf if points else math.inf  # likeness from which there are points
        given = {"crop": crop[None], "looks": np.array(asks), "least": np.array([least], np.float32)}
        found, deviations, face = self._session.run(None, given)
        made, sigma = np.empty(found.shape[1:]), np.empty(deviations.shape[1:])
        place_points(found[0], deviations[0], inverse, made, sigma)
        return Prediction(made, sigma, float(face[0]) if asks else math.inf)

    def _judged(self, rgb: U8, found: Prediction) -> Face | None:
        confidence, certain = self._judgement(rgb, found, found.logit)
        if not confidence:
            return None
        points = found.points if self._correction is None else self._correction(found.points)
        return Face.around(points, confidence, certain)

    def _judgement(self, rgb: U8, found: Prediction, logit: float) -> tuple[float, F32]:
        """The confidence, 0 for points that are no face's, and the probability (81,) of each point."""
        certain, (height, width) = np.empty(len(found.points), np.float32), rgb.shape[:2]
        bias, rules = self._calibration.bias(logit), self._calibration.rules
        return judge_points(
            found.points, found.sigma, bias, width, height, OUTER_EYE_CORNERS, rules, certain
        ), certain

    def _is_hopeful(self, first: Prediction) -> bool:
        return (
            first.logit >= LIMITS.min_first_likeness or self._confidence(first) >= LIMITS.min_first_confidence
        )

    def _confidence(self, found: Prediction) -> float:
        return self._calibration.confidence(found.sigma, found.eyes, found.logit)


@kernel
def place_points(found: F32, deviations: F32, to_picture: F64, points: F64, sigma: F64) -> None:
    """Take points of a crop, and their standard deviations, to the picture.

    Parameters
    ----------
    found, deviations : (n, 2) and (n,), pixels of the crop.
    to_picture : (2, 3) similarity from the pixels of the crop to the picture's.
    points, sigma : the same in pixels of the picture, which are written.
    """
    points[:] = found @ to_picture[:, :2].T + to_picture[:, 2]
    sigma[:] = deviations * np.hypot(*to_picture[:, 0])


@kernel
def judge_points(
    points: F64, sigma: F64, bias: float, width: float, height: float, eyes: Int, rules: F64, certain: F32
) -> float:  # fmt: skip
    """How likely points are those of a face, and each of them is right.

    Parameters
    ----------
    points, sigma : (n, 2) and (n,) standard deviations, pixels.
    bias, rules : see `Calibration`.   width, height : of the picture.   eyes : (2,) the outer eye corners.
    certain : (n,) probability of each point, which is written.

    Returns
    -------
    The face's confidence; 0 for points that are none.
    """
    spread, factor, visible, least, *_ = rules.tolist()
    found, known = Prediction(points, sigma, 0.0), Calibration((bias, spread, 0.0), factor)
    if not found.is_usable or visible_share(points, width, height) < visible:
        return 0.0
    confidence = known.confidence(sigma, found.eyes, 0.0)
    if confidence < least:
        return 0.0
    certain[:] = known.of_points(sigma, found.eyes)
    return confidence


def crop_of_box(rgb: U8, box: NDArray[Any], turn: float) -> tuple[U8, F64]:
    """What the network sees of a face whose iBUG-68 points fill box (4,), as `cut` gives it."""
    centre, side = _square_about(box, turn)
    return cut(rgb, centre, CROP.side_head_boxes * side, turn)


def _square_about(box: NDArray[Any], turn: float) -> tuple[F64, float]:
    """Centre and longer side of the box of all points, of a face whose iBUG-68 points fill a box."""
    corners = np.asarray(box, np.float64)
    side = float((corners[2:] - corners[:2]).max())
    return (corners[:2] + corners[2:]) / 2 + CROP.rise_sides * side * upward(turn), CROP.head_box_sides * side


def cut(rgb: U8, centre: F64, side: float, turn: float) -> tuple[U8, F64]:
    """Crop (128, 128, 3) of a square, and the affine map (2, 3) from its pixels to the picture's.

    centre, side : pixels; turn : radians, by which the face is rolled clockwise. Black beyond the picture.
    A view of one channel as three (`numpy.broadcast_to`), as a grey picture is, is cut as one.
    """
    inverse, crop = crop_to_picture(centre, side, turn, (SIZE, SIZE)), np.empty((SIZE, SIZE, 3), np.uint8)
    is_grey = rgb.strides[2] == 0
    upright_crop(side_by_side(rgb[..., :1] if is_grey else rgb), inverse, crop)
    return crop, inverse


@kernel
def upright_crop(picture: U8, to_picture: F64, crop: U8) -> None:
    """Cut a part out of a picture (h, w, 1) or (h, w, 3); black beyond it.

    to_picture : (2, 3) similarity from the pixels of the crop to the picture's.   crop : (h, w, 3), which is written.
    """
    step, source, local = float(np.hypot(*to_picture[:, 0])), picture, to_picture
    if step >= 2:  # average whole blocks before sampling, so that nothing aliases
        source, local = _shrunk(picture, to_picture, min(int(step), MAX_BLOCK_PIXELS), crop.shape[1::-1])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    crop[:] = cv2.warpAffine(source, local, crop.shape[1::-1], flags=flags).reshape(*crop.shape[:2], -1)


def _shrunk(rgb: U8, inverse: F64, factor: int, size: tuple[int, int]) -> tuple[U8, F64]:
    """The part of the picture that a crop needs, averaged over blocks of `factor` pixels, and the map into it."""
    corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size - 0.5
    reached = corners @ inverse[:, :2].T + inverse[:, 2]
    limit = np.array(rgb.shape[1::-1])
    low = np.maximum(np.floor(np.minimum.reduce(reached)) - factor, 0)
    low = np.minimum(low, np.maximum(limit - factor, 0)).astype(int)
    high = np.maximum(np.ceil(np.maximum.reduce(reached)) + factor, low + 1)
    high = np.minimum(high, limit).astype(int)
    blocks = np.maximum((high - low) // factor, 1)
    high = np.minimum(low + blocks * factor, limit)
    part = rgb[low[1] : high[1], low[0] : high[0]]
    small = cv2.resize(part, (int(blocks[0]), int(blocks[1])), interpolation=cv2.INTER_AREA)
    scale, local = blocks / (high - low), np.empty((2, 3))
    local[:, :2] = inverse[:, :2] * scale[:, None]
    local[:, 2] = (inverse[:, 2] - low + 0.5) * scale - 0.5
    return np.asarray(small, np.uint8), local


def distinct(faces: list[Face]) -> list[Face]:
    """The most confident of those that overlap; largest box first."""
    kept: list[Face] = []
    for face in sorted(faces, key=lambda f: -f.confidence):
        if all(iou(face.box, other.box) < LIMITS.max_distinct_iou for other in kept):
            kept.append(face)
    return sorted(kept, key=lambda f: -f.area)
