"""From where a person was seen when they were enrolled, and what that leaves to guess."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.aam.solid_shape import SolidPrior
from guise.common.arrays import F64

REACH_DEGREES = 25  # beyond what was seen, as far as a view is near enough to one that was
TAILS = 0.02  # share of the frames at either end that doesn't count as seen


@dataclass(frozen=True)
class Views:
    """How far a head was turned in an enrolment: smallest and largest yaw and pitch, degrees."""

    yaw: tuple[int, int]
    pitch: tuple[int, int]

    @classmethod
    def of(cls, shapes: Sequence[F64]) -> Views:
        """The views of frames with shapes (81, 2), pixels."""
        prior = SolidPrior.shipped()
        angles = np.array([prior.fit(shape).pose.angles[:2] for shape in shapes])
        low, high = np.quantile(angles, (TAILS, 1 - TAILS), axis=0).round().astype(int).tolist()
        return cls((low[0], high[0]), (low[1], high[1]))

    @property
    def guessed(self) -> tuple[int, int]:
        """Yaw, degrees, to the image's left and right, beyond which a side of the face is guessed."""
        return self.yaw[0] - REACH_DEGREES, self.yaw[1] + REACH_DEGREES

    def as_facts(self) -> dict[str, list[int]]:
        """As a model file holds them."""
        return {"yaw": list(self.yaw), "pitch": list(self.pitch)}

    def __str__(self) -> str:
        """One sentence for a person to read."""
        low, high = self.guessed
        return (
            f"turned {self.yaw[0]} to {self.yaw[1]} degrees, nodding {self.pitch[0]} to {self.pitch[1]}; "
            f"beyond {low} and {high} degrees the far side is guessed"
        )
