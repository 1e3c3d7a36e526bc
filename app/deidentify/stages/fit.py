"""The fourth stage: the place of a person's face in every frame in which it was tracked, with its confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from guise.app.swapping.trust import LocatedFace
from guise.common.arrays import F32


@dataclass(frozen=True, eq=False)
class Fits:
    """Placed faces: track (n,), frame (n,), shape (n, 81, 2), confidence (n,), by track and then by frame."""

    track: NDArray[np.int32]
    frame: NDArray[np.int32]
    shape: F32
    confidence: F32

    @classmethod
    def of(cls, rows: list[tuple[int, int, LocatedFace]]) -> Fits:
        """From rows of track, frame and face."""
        rows = sorted(rows, key=lambda row: row[:2])
        return cls(
            np.array([track for track, _, _ in rows], np.int32),
            np.array([frame for _, frame, _ in rows], np.int32),
            np.array([placed.shape for _, _, placed in rows], np.float32).reshape(-1, 81, 2),
            np.array([placed.confidence for _, _, placed in rows], np.float32),
        )
