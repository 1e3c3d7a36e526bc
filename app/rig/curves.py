"""The coefficients of one person over time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from guise.aam.rig.coefficients import Coefficients, smoothed
from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES
from guise.common.arrays import F64, Bool

REST = Coefficients(np.zeros(len(ARKIT_NAMES), np.float32), np.zeros(3), np.zeros((2, 3)))


@dataclass(frozen=True, eq=False)
class RigCurves:
    """A row for each frame.

    Parameters
    ----------
    seconds : (t,) ascending.   weights : (t, 52) in [0, 1], in the order of `ARKIT_NAMES`.
    head : (t, 3) degrees; yaw to the image's right, pitch up, roll to the image's right.
    eyes : (t, 2, 3) likewise, of the person's left and right eye in the head.
    seen : (t,) whether there was a face; the other rows hold the last one, and rest before the first.
    """

    seconds: F64
    weights: F64
    head: F64
    eyes: F64
    seen: Bool

    @property
    def longest_gap(self) -> float:
        """Seconds of the longest part without a face."""
        at = np.concatenate([self.seconds, self.seconds[-1:]])
        longest, begun = 0.0, None
        for k, seen in enumerate([*self.seen.tolist(), True]):
            if not seen and begun is None:
                begun = at[k]
            elif seen and begun is not None:
                longest, begun = max(longest, float(at[k] - begun)), None
        return longest


@dataclass(eq=False)
class CurveRecorder:
    """Takes frame by frame."""

    rows: list[tuple[float, Coefficients, bool]] = field(default_factory=list)

    def add(self, seconds: float, found: Coefficients | None) -> None:
        """The next frame, None without a face; a frame of the same time replaces the one before."""
        if self.rows and seconds <= self.rows[-1][0]:
            self.rows.pop()
        held = self.rows[-1][1] if self.rows else REST
        self.rows.append((seconds, held if found is None else found, found is not None))

    @property
    def with_face(self) -> int:
        """Number of frames with a face."""
        return sum(seen for _, _, seen in self.rows)

    def curves(self, *, smooth: bool = False) -> RigCurves:
        """What was taken; there must be a frame.   smooth : over all frames."""
        seconds, found, seen = zip(*self.rows, strict=True)
        times, count = np.array(seconds, np.float64), len(ARKIT_NAMES)
        units = np.repeat(
            [1.0, 90.0, FULL_LOOK_DEGREES], [count, 3, 6]
        )  # in which the filter sees each value
        values = np.array([np.concatenate([w, head, eyes.ravel()]) for w, head, eyes in found], np.float64)
        if smooth:
            values = smoothed(values / units, times) * units
        weights, head, eyes = np.split(values, [count, count + 3], axis=1)
        return RigCurves(times, weights, head, eyes.reshape(-1, 2, 3), np.array(seen))
