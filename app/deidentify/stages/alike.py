"""How alike people are before and after the drawing, to the recogniser (`guise.aam.recognition`).

A face that was wholly replaced may still be taken for the person's, in light that tells more than its features.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from guise.aam.recognition import picture_signature
from guise.app.media import Frame
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class AlikeLimits:
    """When and how faces are compared: cosines of the sums of signatures."""

    interval_frames: int = 8  # from one frame to the next
    alike: float = 0.42  # from which another face is tried; of 40 photos nine reach it with the first
    same: float = 0.6  # from which a face that no other hides better is covered
    donors: int = 4  # that are tried at most,
    tried_frames: int = 12  # in so many frames of each person


LIMITS = AlikeLimits()


class Signatures:
    """Sums (2, 64) of the signatures of people's faces before and after the drawing, by person.

    interval : frames from one in which they are looked at to the next.
    """

    def __init__(self, interval: int = LIMITS.interval_frames) -> None:
        self.sums: dict[int, F64] = {}
        self._interval = interval

    def is_due(self, frame: Frame, person: int) -> bool:
        """Whether somebody is looked at in a frame: in the first one, and now and then."""
        return person not in self.sums or frame.index % self._interval == 0

    def add(self, person: int, before: F32, after: F32) -> None:
        """Add what was seen in a frame."""
        self.sums[person] = self.sums.get(person, 0) + np.stack([before, after]).astype(np.float64)

    def as_json(self) -> dict[str, list[list[float]]]:
        """The sums as JSON holds them."""
        return {str(person): np.round(both, 4).tolist() for person, both in self.sums.items()}


def signature_in(frame: Frame, shape: F64) -> F32:
    """The signature (64,) of the face with landmarks (81, 2) in a frame."""
    x, y, w, h = frame.align_roi(*(shape.min(0) - 2), *(shape.max(0) + 3))
    return picture_signature(frame.rgb_roi(x, y, w, h), shape - (x, y))


def likeness(sums: Iterable[Mapping[str, Sequence[Sequence[float]]]]) -> dict[int, float]:
    """By person, how alike they are before and after the drawing.   sums : of all parts of a file."""
    total: dict[int, F64] = {}
    for part in sums:
        for who, both in part.items():
            total[int(who)] = total.get(int(who), 0) + np.array(both, np.float64)
    norms = {who: float(np.prod(np.linalg.norm(both, axis=1))) for who, both in total.items()}
    return {who: float(a @ b) / max(norms[who], 1e-9) for who, (a, b) in total.items()}
