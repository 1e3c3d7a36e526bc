"""Brows found again by their looks: where tracked brows follow only half of a movement, the rest of it.

A landmarker that has seen few raised brows leaves its brow points behind (half of the way on some people, measured
against other landmarkers).  Then the brow lies higher in the sampled texture than in the neutral one, which shows by
how much: the band about each brow is compared at shifts up and down (normalised cross-correlation), and the brow's
points move along.  Frame pixels, x right, y down, unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW, RIGID_WEIGHTS
from guise.aam.light import LUMA
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.similarity import align_planar
from guise.common.arrays import F32, F64, U8

BROW_PAIR = (RIGHT_BROW, LEFT_BROW)


@dataclass(frozen=True)
class BrowLimits:
    """Size of the bands and of the search, and what counts; lengths in face widths."""

    beside: float = 0.012  # of the band, beyond the brow's points
    above: float = 0.06
    below: float = 0.03
    search: float = 0.06  # up and down
    column: float = 0.01  # between the columns that are sampled
    row: float = 0.006  # between the rows
    cost: float = 6.0  # of correlation, by which a shift of one face width must be better than none, squared
    unsure: tuple[float, float] = (0.3, 0.5)  # correlations from which and at which a shift is believed
    jitter: float = 0.004  # smaller changes from frame to frame count less


LIMITS = BrowLimits()


class BrowFollower:
    """Corrects the brows of one person's tracked shapes, frame by frame.

    appearance : of the person; its neutral face shows how the brows look where their points are.
    """

    def __init__(self, appearance: AppearanceModel) -> None:
        reference = appearance.reference
        luma = reference.scatter(appearance.neutral_texture @ LUMA)
        self._reference = reference
        self._bands = [_Band.of(reference, brow, luma) for brow in BROW_PAIR]
        self.reset()

    def reset(self) -> None:
        """Begin with the next face."""
        self._shifts: F64 | None = None  # of right and left brow, face widths, down

    def corrected(self, luma: U8, shape: F64) -> F64:
        """A tracked shape (81, 2) in a picture (h, w), with the brows where the picture shows them."""
        found = np.array([band.shift(luma, shape) for band in self._bands])
        if self._shifts is None:
            self._shifts = found
        else:
            step = found - self._shifts
            self._shifts = self._shifts + step * step**2 / (step**2 + LIMITS.jitter**2)
        down = np.array([0.0, self._reference.resolution]) @ _to_picture(self._reference, shape)
        made = shape.copy()
        for brow, shift in zip(BROW_PAIR, self._shifts, strict=True):
            made[brow] += shift * down
        return made


@dataclass(frozen=True, eq=False)
class _Band:
    """The surroundings of a brow: how they look at rest, and where they and the rows above and below are seen."""

    template: F32
    sampler: MeshSampler
    size: tuple[int, int]  # of what is sampled: rows, columns
    margin: int  # rows above and below the template

    @classmethod
    def of(cls, reference: ReferenceFrame, brow: np.ndarray, luma: F32) -> _Band:
        points, width = reference.points[brow] / reference.resolution, reference.resolution
        low, high = points.min(0), points.max(0)
        margin = round(LIMITS.search / LIMITS.row)
        xs = np.arange(low[0] - LIMITS.beside, high[0] + LIMITS.beside, LIMITS.column)
        rows = round((high[1] - low[1] + LIMITS.above + LIMITS.below) / LIMITS.row)
        ys = low[1] - LIMITS.above + LIMITS.row * np.arange(-margin, rows + margin)
        places = width * np.stack(np.meshgrid(xs, ys), -1).reshape(-1, 2)
        sampler = MeshSampler.build(reference, places)
        band = cls(np.zeros((0, 0), np.float32), sampler, (len(ys), len(xs)), margin)
        seen = band._seen(luma, reference.points)
        return cls(seen[margin:-margin], sampler, band.size, margin)

    def shift(self, luma: U8, shape: F64) -> float:
        """By how much the brow lies lower than its points, face widths; 0 where it isn't recognised."""
        alike = cv2.matchTemplate(self._seen(luma, shape), self.template, cv2.TM_CCOEFF_NORMED)[:, 0]
        at = LIMITS.row * np.arange(-self.margin, self.margin + 1)
        likely = alike - LIMITS.cost * at**2
        k = int(np.argmax(likely))
        peak = float(at[k])
        if 0 < k < len(at) - 1:
            before, here, after = likely[k - 1 : k + 2]
            peak += LIMITS.row * float((before - after) / (2 * min(before - 2 * here + after, -1e-6)))
        first, last = LIMITS.unsure
        return peak * float(np.clip((alike[k] - first) / (last - first), 0, 1))

    def _seen(self, luma: U8 | F32, shape: F64) -> F32:
        places: F32 = self.sampler.positions(shape).astype(np.float32).reshape(*self.size, 2)
        picture = cv2.remap(luma, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        return np.asarray(picture, np.float32)


def _to_picture(reference: ReferenceFrame, shape: F64) -> F64:
    """(2, 2) that takes steps on the reference grid to steps in the picture, for rows."""
    return np.asarray(align_planar(reference.points, shape, RIGID_WEIGHTS).linear)
