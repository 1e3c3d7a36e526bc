"""The frames of an enrolment that are worth keeping, bounded in number however long it takes.

Three kinds: the sharpest of each stretch of time, those that differ most from all others, and those with the face at
rest.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import openness
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, cut
from guise.aam.training import Observation, observe
from guise.common.arrays import F64

Picture = NDArray[np.uint8]

STRETCHES = 32  # of the time; the sharpest frame of each is kept
VARIED = 64  # frames that differ most
RESTING = 8  # frames at rest; their whole pictures are kept
SHARP = 0.6  # share of the usual sharpness from which a frame is kept for what it shows
UNHURRIED = 0.05  # share that a frame has in the usual sharpness
OPENINGS = (
    1.0,
    3.0,
    1.0,
)  # weights of mouth, lids and brows beside the points, as in the choice for training
SIDEWAYS = 0.005  # inter-ocular distances of open mouth that a degree of yaw counts for


@dataclass(frozen=True, eq=False)
class Shot:
    """What is known of a frame before it is kept.

    Parameters
    ----------
    shape : (81, 2) pixels.
    described : (k,) values whose distances tell how much shapes differ in pose, mouth, lids and brows.
    brightness : grey level that a tenth of the face exceeds.
    sharpness : mean strength of the edges in the face, grey levels.
    unrest : smaller when the mouth is shut, the lids are open and the head is straight.
    """

    shape: F64
    described: F64
    brightness: float
    sharpness: float
    unrest: float

    @classmethod
    def of(cls, luma: Picture, shape: F64) -> Shot | Failed:
        """From a picture (h, w) with landmarks (81, 2) in its pixels."""
        grid = ReferenceFrame.canonical(FEATURE_RESOLUTION)
        crop = cut(luma, shape, grid)
        if isinstance(crop, Failed):
            return crop
        aligned = grid.align(shape)
        mouth, lids, brows = openness(shape[None])[0]
        described = np.append(aligned / grid.resolution, np.multiply(OPENINGS, (mouth, lids, brows)))
        face = _inside(crop, shape)
        edges = cv2.Laplacian(face, cv2.CV_32F)
        return cls(
            shape,
            described,
            float(np.quantile(face, 0.9)),
            float(np.sqrt((edges**2).mean())),
            float(mouth - lids + SIDEWAYS * abs(grid.yaw(aligned))),
        )


@dataclass(frozen=True, eq=False)
class Kept:
    """A frame that is kept: its number among the offered ones, what was known of it, what training needs of it."""

    number: int
    shot: Shot
    observation: Observation


class Album:
    """Takes frames one by one and keeps at most STRETCHES + VARIED + RESTING of them.

    Parameters
    ----------
    frame : ReferenceFrame of the model to be.
    """

    def __init__(self, frame: ReferenceFrame) -> None:
        self._frame = frame
        self._offered = 0
        self._usual = 0.0
        self._stretches: dict[int, Kept] = {}
        self._varied = _Varied()
        self._resting: list[Kept] = []

    def offer(self, rgb: Picture, shot: Shot, share: float) -> None:
        """Look at a frame (h, w, 3) with a good face, taken at a share in [0, 1] of the time."""
        self._offered += 1
        self._usual += (UNHURRIED if self._usual else 1.0) * (shot.sharpness - self._usual)
        stretch = min(int(share * STRETCHES), STRETCHES - 1)
        sharpest = stretch not in self._stretches or shot.sharpness > self._stretches[stretch].shot.sharpness
        sharp = shot.sharpness >= SHARP * self._usual
        place = self._varied.place(shot) if sharp else None
        rests = sharp and (len(self._resting) < RESTING or shot.unrest < self._resting[-1].shot.unrest)
        if not (sharpest or rests or place is not None):
            return
        seen = observe(rgb, shot.shape, self._frame, keep_picture=rests)
        if isinstance(seen, Failed):
            return
        kept = Kept(self._offered, shot, replace(seen, picture=None))
        if sharpest:
            self._stretches[stretch] = kept
        if place is not None:
            self._varied.put(kept, place)
        if rests:
            whole = [*self._resting, replace(kept, observation=seen)]
            self._resting = sorted(whole, key=lambda k: k.shot.unrest)[:RESTING]

    def frames(self) -> list[Observation]:
        """The kept frames in order of time, each once; pictures only of those at rest."""
        kept = {k.number: k for k in (*self._stretches.values(), *self._varied.kept, *self._resting)}
        return [kept[number].observation for number in sorted(kept)]


class _Varied:
    """At most VARIED frames that differ from each other as much as they can."""

    def __init__(self) -> None:
        self.kept: list[Kept] = []
        self._described = np.full((VARIED, 2 * POINTS + len(OPENINGS)), np.inf)
        self._apart = np.full((VARIED, VARIED), np.inf)  # squared distances between the kept ones

    def place(self, shot: Shot) -> int | None:
        """Where a new one goes: at the end, over the duller of the two most alike, or nowhere."""
        if len(self.kept) < VARIED:
            return len(self.kept)
        i, j = np.unravel_index(self._apart.argmin(), self._apart.shape)
        if self._from(shot).min() <= self._apart[i, j]:
            return None
        return int(min(i, j, key=lambda k: self.kept[k].shot.sharpness))

    def put(self, kept: Kept, place: int) -> None:
        """Put a frame at a place that `place` gave."""
        self.kept[place : place + 1] = [kept]
        distances = self._from(kept.shot)
        self._described[place] = kept.shot.described
        self._apart[place] = self._apart[:, place] = distances
        self._apart[place, place] = np.inf

    def _from(self, shot: Shot) -> F64:
        return np.asarray(((self._described - shot.described) ** 2).sum(1))


def _inside(crop: Crop, shape: F64) -> Picture:
    """The part of a crop that the face fills."""
    points = crop.to_crop(shape)
    x0, y0 = np.maximum(points.min(0), 0).astype(int)
    x1, y1 = np.ceil(points.max(0)).astype(int) + 1
    return crop.image[y0:y1, x0:x1]
