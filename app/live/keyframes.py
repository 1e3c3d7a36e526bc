"""Keyframe selection during an enrolment, bounded in number however long it takes.

Three kinds are kept: the sharpest of each time interval, those that differ most from each other, and those with the
face at rest.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.appearance import openness
from guise.aam.parsing import FaceParser
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, cut
from guise.aam.training import Observation, observe
from guise.common.arrays import F64, U8


@dataclass(frozen=True)
class KeyframeLimits:
    """How many keyframes are kept, and what counts."""

    intervals: int = 32  # of the enrolment's time; the sharpest frame of each is kept
    diverse_frames: int = 64  # that differ most from each other
    resting_frames: int = 8  # with the face at rest; their whole pictures are kept
    min_relative_sharpness: float = 0.6  # to the running average; of diverse and resting frames
    sharpness_weight: float = 0.05  # of one frame in the running average of the sharpness
    opening_weights: tuple[float, float, float] = (1.0, 3.0, 1.0)  # of mouth, lids, brows beside the points
    yaw_weight: float = 0.005  # inter-ocular distances of mouth opening that equal a degree of yaw

    @property
    def keyframes(self) -> int:
        """The greatest number of keyframes."""
        return self.intervals + self.diverse_frames + self.resting_frames


LIMITS = KeyframeLimits()


@dataclass(frozen=True, eq=False)
class FrameFeatures:
    """Features of a frame by which keyframes are selected.

    Parameters
    ----------
    shape : (81, 2) pixels.
    descriptor : (k,) values; their distance measures how much shapes differ in pose, mouth, lids and brows.
    brightness : grey level, 90th percentile of the face.
    sharpness : root mean square of the face's Laplacian, grey levels.
    expression : departure from rest: smaller when the mouth is shut, the lids are open and the head is straight.
    """

    shape: F64
    descriptor: F64
    brightness: float
    sharpness: float
    expression: float

    @classmethod
    def of(cls, luma: U8, shape: F64) -> FrameFeatures | Failed:
        """From a picture (h, w) with landmarks (81, 2) in its pixels."""
        grid = ReferenceFrame.canonical(FEATURE_RESOLUTION)
        crop = cut(luma, shape, grid)
        if isinstance(crop, Failed):
            return crop
        aligned = grid.align(shape)
        mouth, lids, brows = openness(shape[None])[0]
        descriptor = np.append(
            aligned / grid.resolution, np.multiply(LIMITS.opening_weights, (mouth, lids, brows))
        )
        face = _inside(crop, shape)
        edges = cv2.Laplacian(face, cv2.CV_32F)
        return cls(
            shape,
            descriptor,
            float(np.quantile(face, 0.9)),
            float(np.sqrt((edges**2).mean())),
            float(mouth - lids + LIMITS.yaw_weight * abs(grid.yaw(aligned))),
        )


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A selected frame: its number among the offered ones, its features, and what training needs of it."""

    number: int
    features: FrameFeatures
    observation: Observation


class KeyframeAlbum:
    """Is offered frames one by one and keeps at most `LIMITS.keyframes` of them.

    Parameters
    ----------
    frame : ReferenceFrame of the model to be.
    """

    def __init__(self, frame: ReferenceFrame) -> None:
        self._frame, self._parser = frame, FaceParser()
        self._offered = 0
        self._average_sharpness = 0.0
        self._sharpest: dict[int, Keyframe] = {}  # by interval
        self._diverse = _DiverseFrames(LIMITS.diverse_frames)
        self._resting: list[Keyframe] = []

    def offer(self, rgb: U8, features: FrameFeatures, share: float) -> None:
        """Consider a frame (h, w, 3) with a good face, taken at a share in [0, 1] of the enrolment."""
        self._offered += 1
        weight = LIMITS.sharpness_weight if self._average_sharpness else 1.0
        self._average_sharpness += weight * (features.sharpness - self._average_sharpness)
        interval = min(int(share * LIMITS.intervals), LIMITS.intervals - 1)
        before = self._sharpest.get(interval)
        sharpest = before is None or features.sharpness > before.features.sharpness
        sharp = features.sharpness >= LIMITS.min_relative_sharpness * self._average_sharpness
        place = self._diverse.place(features) if sharp else None
        rests = sharp and self._rests(features)
        if not (sharpest or rests or place is not None):
            return
        seen = observe(rgb, features.shape, self._frame, self._parser, keep_picture=rests)
        if isinstance(seen, Failed):
            return
        kept = Keyframe(self._offered, features, replace(seen, picture=None))
        if sharpest:
            self._sharpest[interval] = kept
        if place is not None:
            self._diverse.put(kept, place)
        if rests:
            whole = [*self._resting, replace(kept, observation=seen)]
            self._resting = sorted(whole, key=lambda k: k.features.expression)[: LIMITS.resting_frames]

    def frames(self, pictures: int | None = None) -> list[Observation]:
        """The keyframes in order of time, each once; pictures only of those at rest, or of so many of them."""
        resting = self._resting[:pictures]
        kept = {k.number: k for k in (*self._sharpest.values(), *self._diverse.kept, *resting)}
        return [kept[number].observation for number in sorted(kept)]

    def _rests(self, features: FrameFeatures) -> bool:
        """Whether a frame is among those closest to rest so far."""
        if len(self._resting) < LIMITS.resting_frames:
            return True
        return features.expression < self._resting[-1].features.expression


class _DiverseFrames:
    """At most `count` frames, chosen greedily to differ from each other as much as possible."""

    def __init__(self, count: int) -> None:
        self.kept: list[Keyframe] = []
        self._count = count
        self._descriptors = np.full((count, 2 * POINTS + len(LIMITS.opening_weights)), np.inf)
        self._distances = np.full((count, count), np.inf)  # squared, between the kept frames

    def place(self, features: FrameFeatures) -> int | None:
        """Where a new frame goes: to the end, in place of the less sharp of the two most similar, or nowhere."""
        if len(self.kept) < self._count:
            return len(self.kept)
        i, j = np.unravel_index(self._distances.argmin(), self._distances.shape)
        if self._distances_from(features).min() <= self._distances[i, j]:
            return None
        return int(min(i, j, key=lambda k: self.kept[k].features.sharpness))

    def put(self, kept: Keyframe, place: int) -> None:
        """Put a frame at an index returned by `place`."""
        self.kept[place : place + 1] = [kept]
        distances = self._distances_from(kept.features)
        self._descriptors[place] = kept.features.descriptor
        self._distances[place] = self._distances[:, place] = distances
        self._distances[place, place] = np.inf

    def _distances_from(self, features: FrameFeatures) -> F64:
        return np.asarray(((self._descriptors - features.descriptor) ** 2).sum(1))


def _inside(crop: Crop, shape: F64) -> U8:
    """The face's bounding box in a crop."""
    points = crop.to_crop(shape)
    x0, y0 = np.maximum(points.min(0), 0).astype(int)
    x1, y1 = np.ceil(points.max(0)).astype(int) + 1
    return crop.image[y0:y1, x0:x1]
