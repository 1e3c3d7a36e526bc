"""How good a swap will look: one grade, from a trial on the frame that the source's model keeps and from the two faces.

The trial is drawn by the engine of the swap on the source's frame at rest; what its skin then has of colour, light and
sharpness that the frame hasn't, and how far the two faces at rest differ in shape, predict what programs that have no
part in it find in whole swaps (benchmarks/picture/grade.py, which also fitted the weights).

Colours are compared by the tone of all of the skin: elsewhere a face that looks like the person in the video would be
graded best.  Lab is OpenCV's float Lab, L 0..100; pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import cv2
import numpy as np

from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.tuned import derived, tuned

TYPICAL_FACE = "p03"  # of the gallery, with which somebody who is enrolled is graded
TRIAL_FRAMES = tuned(6, "frames", "picture.grade")  # over which light and occlusion settle
MARGIN_FACE_WIDTHS = tuned(0.2, "face widths", "picture.grade")  # about the face, of what is looked at
MIN_SKIN = tuned(0.8, "share", "picture.grade")  # of a pixel that counts as skin


@dataclass(frozen=True)
class GradeWeights:
    """Figures that a good swap does not exceed, and the weights of the prediction.

    most : multiple of its target at which a figure counts no further.   The prediction is the mean multiple of their
    targets that the figures of a whole swap reach.
    """

    colour: float = derived(1.0, "Lab", "the target of picture.identity: tone_chroma")
    light: float = derived(1.2, "Lab", "the target of picture.identity: tone_light")
    # what is too sharp is softened in a whole swap
    softness: float = derived(0.3, "octaves of gradient energy", "the target of picture.identity")
    most: float = tuned(3.0, "targets", "picture.grade")
    constant: float = tuned(0.54, "targets", "picture.grade")
    trial: float = tuned(0.47, "ratio", "picture.grade")  # of the mean multiple of the three in the trial
    shape: float = tuned(8.8, "targets a face width", "picture.grade")  # of the distance of the shapes
    points: float = derived(40.0, "of 100 points", "what a multiple costs, so that `good` is 1")
    good: int = derived(60, "of 100 points", "100 less `points`: on average the targets are met")
    fair: int = derived(45, "of 100 points", "a choice of words: 1.4 times the targets")


WEIGHTS = GradeWeights()


@dataclass(frozen=True)
class Grade:
    """A grade and what it is made of.

    Parameters
    ----------
    colour, light : Lab differences of the median colour of the skin, and of its L.
    sharpness : octaves by which the drawn skin is sharper than the frame's.
    shape : mean distance of the points of the two faces at rest, face widths.
    """

    colour: float
    light: float
    sharpness: float
    shape: float

    @property
    def predicted(self) -> float:
        """The mean multiple of their targets that the figures of the whole swap are expected to reach."""
        return WEIGHTS.constant + WEIGHTS.trial * self.trial + WEIGHTS.shape * self.shape

    @property
    def trial(self) -> float:
        """The mean multiple of their targets that the figures of the trial reach."""
        return float(np.mean(list(self._multiples().values())))

    @property
    def score(self) -> int:
        """0 to 100; `WEIGHTS.good` is expected to meet the targets, on average."""
        return max(0, round(100 - WEIGHTS.points * self.predicted))

    @property
    def word(self) -> Literal["good", "fair", "poor"]:
        """The score in a word."""
        return "good" if self.score >= WEIGHTS.good else "fair" if self.score >= WEIGHTS.fair else "poor"

    @property
    def advice(self) -> str:
        """What would help most, "" for a good one."""
        if self.word == "good":
            return ""
        gains = {name: WEIGHTS.trial / 3 * multiple for name, multiple in self._multiples().items()}
        gains["shape"] = WEIGHTS.shape * self.shape
        return _ADVICE[max(gains, key=lambda name: gains[name])]

    def __str__(self) -> str:
        """For a person to read."""
        return f"{self.word}, {self.score} of 100" + (f"; {self.advice}" if self.advice else "")

    def _multiples(self) -> dict[str, float]:
        figures = {"colour": self.colour, "light": self.light, "softness": max(0.0, -self.sharpness)}
        return {name: min(WEIGHTS.most, value / getattr(WEIGHTS, name)) for name, value in figures.items()}


_ADVICE = {
    "colour": "the colours differ: enroll the two in light of the same colour",
    "light": "the light differs: enroll the two in even light from the front",
    "softness": "the face's picture is softer than the video: enroll the face from a sharper or nearer clip",
    "shape": "the faces differ in shape, or are turned: a face of a more similar shape will look better",
}


class Pair(Protocol):
    """The person in the video, and whose face is shown."""

    @property
    def person(self) -> Identity: ...
    @property
    def donor(self) -> Identity: ...


class TrialEngine(Protocol):
    """What draws a swap: an `guise.app.drawing.engine.Engine`."""

    @property
    def plan(self) -> Pair: ...
    def reset(self) -> None:
        """Begin with a new face."""

    def draw(self, frame: Frame, shape: F64) -> F64:
        """Swap the face that lies at a shape (81, 2) in a frame, in place."""


def grade(engine: TrialEngine) -> Grade | None:
    """The grade of a swap by its engine, which has drawn all that it is to draw; None without skin to look at."""
    person, face = engine.plan.person, engine.plan.donor
    rest = person.rest_frame
    engine.reset()
    for _ in range(TRIAL_FRAMES):
        frame = Frame.from_rgb(np.array(rest.picture))
        engine.draw(frame, np.array(rest.shape, np.float64))
    (x0, y0), (x1, y1) = _surroundings(rest.shape, rest.picture.shape)
    before, after = (picture[y0:y1, x0:x1] for picture in (rest.picture, frame.rgb()))
    skin = _skin(before, rest.shape - (x0, y0))
    if not skin.any():
        return None
    shapes = [one.appearance.neutral_shape / one.reference.resolution for one in (person, face)]
    was, made = _lab(before), _lab(after)
    away = np.median(made[skin], axis=0) - np.median(was[skin], axis=0)
    return Grade(
        round(float(np.hypot(*away[1:])), 3),
        round(float(abs(away[0])), 3),
        round(float(np.log2(_energy(made, skin) / _energy(was, skin))), 3),
        round(float(np.abs(shapes[0] - shapes[1]).mean()), 4),
    )


def _surroundings(shape: F64, size: tuple[int, ...]) -> tuple[tuple[int, int], tuple[int, int]]:
    margin = MARGIN_FACE_WIDTHS * np.ptp(shape[:, 0])
    low = np.clip(np.floor(shape.min(0) - margin), 0, None).astype(int)
    high = np.clip(np.ceil(shape.max(0) + margin) + 1, 0, size[1::-1]).astype(int)
    return (int(low[0]), int(low[1])), (int(high[0]), int(high[1]))


def _skin(rgb: U8, shape: F64) -> Bool:
    """Which pixels (h, w) of a picture are skin of the face."""
    parsing = FaceParser().parse(rgb, shape)
    share = cv2.warpAffine(parsing.share(FaceClass.SKIN), parsing.to_picture, rgb.shape[1::-1])
    face = np.zeros(rgb.shape[:2], np.uint8)
    cv2.fillConvexPoly(face, cv2.convexHull(shape.astype(np.int32)), 1)
    return np.asarray((share > MIN_SKIN) & (face > 0))


def _lab(rgb: U8) -> F32:
    return np.asarray(cv2.cvtColor(rgb.astype(np.float32) / 255, cv2.COLOR_RGB2LAB), np.float32)


def _energy(lab: F32, skin: Bool) -> float:
    """Mean squared gradient of L."""
    light = np.ascontiguousarray(lab[..., 0])
    across, down = cv2.Sobel(light, -1, 1, 0), cv2.Sobel(light, -1, 0, 1)
    return float((across**2 + down**2)[skin].mean()) + 1e-6
