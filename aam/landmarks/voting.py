"""The audit's face detector: cells that lie in a face vote for it, at any roll.

`aam/data/audit.onnx` is made by `training/train_audit.py` and rounded to 8 bits by `round_audit.py` there
(`aam/data/audit.md` has data, licence and figures).  It is no kin of the built-in detector, which looks for centres of
upright faces: each part of a face tells where the whole is, how large, and how it is rolled.

Pixels, x right, y down, pixel centres at integers; turns in radians, by which a face is rolled clockwise.  The box of a
rolled face is the one of the same size that stands upright about its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.rolls import RolledBoxes, halved
from guise.aam.onnx_model import ShippedNetwork
from guise.common.arrays import F32, F64, U8

STRIDE = 4  # pixels, from one cell to the next
BLOCK = 8  # pixels, of which the network's pictures are multiples
UNIT = 8.0  # pixels, of the network's distances
SMALLEST = 12.0  # pixels, the side of a face from which the network is sure of it


@dataclass(frozen=True)
class VoteLimits:
    """Which votes count, and together."""

    min_share: float = 0.25  # of a vote
    same_sides: float = 0.4  # between centres that are the same, and
    same_log_size: float = 0.5  # between sides
    expected: float = 0.2  # votes, as a share of the cells of a face's box
    smallest_level_pixels: int = 16  # longer side of the smallest picture
    margin_share: float = (
        0.125  # of the longer side, mirrored at left and right: a cut face is whole beside it
    )
    max_beyond: float = (
        0.25  # widths of a box, by which its middle may lie beyond a side: else it is a mirror image
    )


LIMITS = VoteLimits()


@dataclass(frozen=True, eq=False)
class Votes:
    """What cells say.

    shares : (n,) how likely the cell is in a face.   centres, halves, upward : (n, 2) the face's middle, half width and
    height, and direction from chin to forehead.   areas : (n,) of the cells, pixels.
    """

    shares: F64
    centres: F64
    halves: F64
    upward: F64
    areas: F64

    @classmethod
    def of(cls, maps: Sequence[F32], factors: Sequence[float]) -> Votes:
        """From the network's answers (7, h, w) for pictures that are smaller by factors."""
        least = float(np.log(LIMITS.min_share / (1 - LIMITS.min_share)))
        parts: list[tuple[F64, ...]] = []
        for answers, factor in zip(maps, factors, strict=True):
            rows, columns = np.nonzero(answers[0] > least)
            logit, *rest = answers[:, rows, columns].astype(np.float64)
            values = np.stack(rest, axis=1)
            places = np.stack([columns, rows], axis=1) * float(STRIDE) + (STRIDE - 1) / 2
            centres = (places + values[:, :2] * UNIT + 0.5) * factor - 0.5
            halves = np.exp(np.clip(values[:, 2:4], -2, 3)) * UNIT * factor
            areas = np.full(len(logit), (STRIDE * factor) ** 2)
            parts.append((1 / (1 + np.exp(-logit)), centres, halves, values[:, 4:], areas))
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def boxes(self, min_score: float) -> RolledBoxes:
        """Faces that votes agree on, the surest first."""
        left, found = np.ones(len(self.shares), bool), []
        sides = 2 * self.halves.max(1) if len(left) else self.shares
        for k in np.argsort(-self.shares, kind="stable"):
            if not left[k]:
                continue
            apart = np.abs(self.centres - self.centres[k]).max(1) / sides[k]
            alike = np.abs(np.log(sides / sides[k])) < LIMITS.same_log_size
            same = left & alike & (apart < LIMITS.same_sides)
            left &= ~same
            weights = self.shares[same]
            values = (part[same] for part in (self.centres, self.halves, self.upward))
            centre, half, up = (weights @ value / weights.sum() for value in values)
            votes = float(weights @ self.areas[same]) / (LIMITS.expected * 4 * half.prod())
            score = float(self.shares[k]) * min(1.0, votes)
            if score >= min_score:
                found.append([*(centre - half), *(centre + half), score, np.arctan2(up[0], -up[1])])
        rows = np.array(found, np.float32).reshape(-1, 6)
        return RolledBoxes(rows[:, :4], rows[:, 4], rows[:, 5])


class VotingDetector:
    """Faces of any size and roll.

    Parameters
    ----------
    min_score : in [0, 1]; boxes below are dropped.
    threads : of onnxruntime.
    """

    def __init__(self, min_score: float = 0.5, threads: int = 1) -> None:
        self._min_score = min_score
        self._session = ShippedNetwork("audit.onnx", threads, keeps=True)

    def search(self, image: U8, smallest: float) -> RolledBoxes:
        """Faces of at least `smallest` pixels in a picture RGB (h, w, 3), also those that its sides cut."""
        pictures = levels(image, smallest)
        maps = [self._session.run(None, {"image": whole_blocks(one.image)[None]})[0][0] for one in pictures]
        found = Votes.of(maps, [one.factor for one in pictures]).boxes(self._min_score)
        found = found.moved(-pictures[0].margin * pictures[0].factor, 0)
        centres, widths = found.boxes[:, [0, 2]].mean(1), found.boxes[:, 2] - found.boxes[:, 0]
        beyond = np.maximum(-centres, centres - image.shape[1]) > LIMITS.max_beyond * widths
        return found[~beyond]


@dataclass(frozen=True, eq=False)
class Level:
    """A picture made smaller by a factor, with mirrored margins of so many pixels at left and right."""

    image: U8
    factor: float
    margin: float


def levels(image: U8, smallest: float) -> list[Level]:
    """The picture at sizes of which each is half the one before; in the first, `smallest` pixels are `SMALLEST`."""
    factor = max(1.0, smallest / SMALLEST)
    small = _smaller(image, factor)
    margin = min(round(LIMITS.margin_share * max(small.shape)), small.shape[1])
    small = np.asarray(cv2.copyMakeBorder(small, 0, 0, margin, margin, cv2.BORDER_REFLECT), np.uint8)
    made = [Level(small, factor, margin)]
    while max(made[-1].image.shape) / 2 >= LIMITS.smallest_level_pixels:
        last = made[-1]
        made.append(Level(_smaller(last.image, 2), 2 * last.factor, last.margin / 2))
    return made


def _smaller(image: U8, factor: float) -> U8:
    size = [max(1, round(side / factor)) for side in image.shape[1::-1]]
    image = halved(image) if factor > 2 else image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def whole_blocks(image: U8) -> U8:
    """A picture (h, w, 3) on whose right and lower sides is added what the network's blocks need."""
    below, beside = (-side % BLOCK for side in image.shape[:2])
    return np.asarray(cv2.copyMakeBorder(image, 0, below, 0, beside, cv2.BORDER_REPLICATE), np.uint8)
