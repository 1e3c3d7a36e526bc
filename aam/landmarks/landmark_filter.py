"""A temporal filter of the landmarks of one face: less jitter without delaying what moves.

A one-euro filter (Casiez, Roussel and Vogel, CHI 2012) in a frame that the head carries along. Each new shape is split
into a motion of the whole head, a similarity taken robustly from the rigid points, and what is left within the face.
Both go a share of the way to where they are seen,

    share = 1 - exp(-2 pi cutoff dt),   cutoff = min_cutoff (1 + (evidence / noise)^2)   in Hz,

where the evidence is the recent mean of the way that would have to be gone: noise points now here, now there and
cancels in that mean, motion persists. The original raises the cutoff with a speed that is itself filtered at 1 Hz,
which is too slow for a blink of a tenth of a second; here a way of several times the noise passes at once. A point's
evidence is that of its neighbours in the same feature (lid, lip, brow), for these move together.

:class:`guise.aam.shape_filter.ShapeFilter` has the same idea for the shapes of a person's tracker. It stays apart:
those shapes lie in
the tracker's few modes and hold less noise, come without confidences, and are filtered by frames, not by seconds.

Ways are in inter-ocular distances and times in seconds, so that sizes and frame rates do not matter. Points face81,
pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import (
    BROWS,
    COUNT,
    EYE_CORNERS,
    EYES,
    FOREHEAD,
    JAW,
    LEFT_BROW,
    LEFT_LOWER_LID,
    LEFT_MOUTH_CORNER_POINTS,
    LEFT_UPPER_LID,
    LIPS,
    LOWER_LIP,
    NOSE,
    RIGHT_BROW,
    RIGHT_LOWER_LID,
    RIGHT_MOUTH_CORNER_POINTS,
    RIGHT_UPPER_LID,
    RIGID_WEIGHTS,
    UPPER_LIP,
    Group,
    interocular,
    mean_geometry,
)
from guise.aam.similarity import align_planar
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class FilterSettings:
    """Settings of the filter; lengths in inter-ocular distances.

    Chosen by a search on rendered clips with exact truth and on real ones (benchmarks/landmarks/jitter.py): the least
    jitter on still stretches for a lag at 30 Hz of less than half a frame of lids and lips and of one of a slow head.
    """

    min_head_cutoff_hz: float = 0.65  # of a head that does not move
    min_cutoff_hz: float = 0.5  # of what does not move within the face
    memory_seconds: float = 0.04  # over which the evidence is averaged
    head_noise: tuple[float, ...] = (0.003, 0.003, 0.004, 0.008)  # shift x, y, logarithm of the scale, angle
    skin_noise: float = 0.015
    brow_noise: float = 0.003  # they move little and mean much
    lid_noise: float = 0.006
    lip_noise: float = 0.006
    feature_reach: float = 0.25  # over which points of a feature move together
    outlier: float = 0.02  # off by this a rigid point counts half for the head's motion
    max_pause_seconds: float = 0.5  # without a shape, after which the past is forgotten
    min_confidence: float = 0.05  # of a point, as which a lower one counts


SETTINGS = FilterSettings()

# Parts of the face whose points move together.
FEATURES: tuple[Group, ...] = (
    JAW, RIGHT_BROW, LEFT_BROW, NOSE, FOREHEAD, *EYE_CORNERS[:, None],
    RIGHT_UPPER_LID, RIGHT_LOWER_LID, LEFT_UPPER_LID, LEFT_LOWER_LID,
    RIGHT_MOUTH_CORNER_POINTS, LEFT_MOUTH_CORNER_POINTS, UPPER_LIP, LOWER_LIP,
)  # fmt: skip


class LandmarkFilter:
    """Takes the jitter out of the points of one face, frame by frame.

    A point of low confidence moves with the head and takes little from the picture.

    Examples
    --------
    >>> mean = mean_geometry().mean
    >>> face = 100 * np.stack([mean.real, mean.imag], axis=-1)
    >>> landmark_filter = LandmarkFilter()
    >>> rng = np.random.default_rng(0)
    >>> seen = [face + 0.2 * rng.normal(size=(81, 2)) for _ in range(60)]
    >>> filtered = [landmark_filter.update(points, None, i / 30) for i, points in enumerate(seen)]
    >>> bool(np.abs(np.diff(filtered[20:], axis=0)).mean() < 0.2 * np.abs(np.diff(seen[20:], axis=0)).mean())
    True
    """

    def __init__(self) -> None:
        self._noise = _point_noise()
        self._near = _neighbours()
        self._rigid = RIGID_WEIGHTS
        self.reset()

    def reset(self) -> None:
        """The next shape is taken as it is."""
        self._seconds: float | None = None
        self._head = np.zeros(4)  # centre x, y in pixels, logarithm of the inter-ocular distance, angle
        self._head_way = np.zeros(4)
        self._face = np.zeros((COUNT, 2))  # in the head's frame, inter-ocular distances
        self._face_way = np.zeros((COUNT, 2))

    def update(self, points: NDArray[Any], point_confidence: NDArray[Any] | None, seconds: float) -> F32:
        """The filtered points (81, 2) float32, pixels.

        Parameters
        ----------
        points : (81, 2) float, pixels
            NaN where there is no face: they come back as they are, and the past is forgotten.
        point_confidence : (81,) float in [0, 1], optional
        seconds : float
            The frame's time. After a pause of half a second, or a time that does not rise, the past is forgotten.
        """
        seen = np.asarray(points, np.float64)
        if seen.shape != (COUNT, 2):
            raise ValueError(f"points must have shape ({COUNT}, 2), got {seen.shape}")
        if not (np.isfinite(seen).all() and interocular(seen) > 0):
            self.reset()
            return seen.astype(np.float32)
        elapsed = None if self._seconds is None else seconds - self._seconds
        self._seconds = seconds
        if elapsed is None or not 0 < elapsed < SETTINGS.max_pause_seconds:
            self._start(seen)
            return seen.astype(np.float32)
        self._follow(seen, _confidences(point_confidence), elapsed)
        return _out(self._head, self._face).astype(np.float32)

    def _start(self, seen: F64) -> None:
        centre, size = self._rigid @ seen, float(interocular(seen))
        self._head = np.array([*centre, np.log(size), 0.0])
        self._face = (seen - centre) / size
        self._head_way[:] = 0
        self._face_way[:] = 0

    def _follow(self, seen: F64, confidence: F64, elapsed: float) -> None:
        keep = np.exp(-elapsed / SETTINGS.memory_seconds)
        head = self._seen_head(seen, confidence)
        face_way = _into(head, seen) - self._face
        head_way = _way(self._head, head)

        self._head_way += (1 - keep) * (head_way - self._head_way)
        moved = (self._head_way / SETTINGS.head_noise) ** 2
        moved[:2] = moved[:2].sum()
        share = _share(SETTINGS.min_head_cutoff_hz, moved, elapsed)
        self._head = _gone(self._head, share * head_way)
        self._head_way *= 1 - share

        self._face_way += (1 - keep) * (face_way - self._face_way)
        moved = ((self._near @ self._face_way) ** 2).sum(1) / self._noise**2
        share = _share(SETTINGS.min_cutoff_hz, moved, elapsed * confidence**2)[:, None]
        self._face += share * face_way
        self._face_way *= 1 - share

    def _seen_head(self, seen: F64, confidence: F64) -> F64:
        """Where the head (4,) is, by the rigid points; those that went their own way count little."""
        weights = head = self._rigid * confidence
        for _ in range(3):
            a, b, tx, ty = align_planar(self._face, seen, weights / weights.sum())
            head = np.array([tx, ty, np.log(max(np.hypot(a, b), 1e-9)), np.arctan2(b, a)])
            off = ((_into(head, seen) - self._face) ** 2).sum(1)
            weights = self._rigid * confidence / (1 + off / SETTINGS.outlier**2)
        return head


def _point_noise() -> F64:
    """(81,) motions that are noise, inter-ocular distances."""
    noise = np.full(COUNT, SETTINGS.skin_noise)
    noise[BROWS] = SETTINGS.brow_noise
    noise[EYES] = SETTINGS.lid_noise
    noise[LIPS] = SETTINGS.lip_noise
    return noise


def _neighbours() -> F64:
    """(81, 81) rows that sum to 1: whose motions count for a point's."""
    mean, feature = mean_geometry().mean, np.zeros(COUNT, int)
    for number, points in enumerate(FEATURES):
        feature[points] = number
    near = np.exp(-(np.abs(mean[:, None] - mean) ** 2) / (2 * SETTINGS.feature_reach**2))
    near *= feature[:, None] == feature
    return np.asarray(near / near.sum(1, keepdims=True))


def _confidences(given: NDArray[Any] | None) -> F64:
    if given is None:
        return np.ones(COUNT)
    confidence = np.asarray(given, np.float64)
    if confidence.shape != (COUNT,):
        raise ValueError(f"point_confidence must have shape ({COUNT},), got {confidence.shape}")
    return np.clip(np.nan_to_num(confidence), SETTINGS.min_confidence, 1.0)


def _share(min_cutoff_hz: float, moved: F64, elapsed: float | F64) -> F64:
    """Share of the way to go, from squared evidence in units of the noise."""
    return np.asarray(1 - np.exp(-2 * np.pi * min_cutoff_hz * (1 + moved) * elapsed))


def _way(head: F64, seen: F64) -> F64:
    """From a head (4,) to another: shift in inter-ocular distances, logarithm of the growth, turn."""
    way = seen - head
    way[:2] /= np.exp(head[2])
    way[3] = (way[3] + np.pi) % (2 * np.pi) - np.pi
    return way


def _gone(head: F64, way: F64) -> F64:
    return np.asarray(head + way * [np.exp(head[2]), np.exp(head[2]), 1, 1])


def _into(head: F64, points: F64) -> F64:
    """Points (n, 2) in pixels, in the head's frame."""
    cos, sin = np.cos(head[3]), np.sin(head[3])
    return np.asarray((points - head[:2]) @ np.array([[cos, -sin], [sin, cos]]) / np.exp(head[2]))


def _out(head: F64, face: F64) -> F64:
    """Points (n, 2) of the head's frame, in pixels."""
    cos, sin = np.cos(head[3]), np.sin(head[3])
    return np.asarray(np.exp(head[2]) * face @ np.array([[cos, sin], [-sin, cos]]) + head[:2])
