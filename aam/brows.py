"""Brows where the picture shows them: a landmarker that has seen few raised brows leaves its points behind.

On some people tracked brows follow half of a movement only, measured against other landmarkers.  Two ways to find the
rest of it.  :class:`BrowLift`, of any face: the parsing (`parsing.py`) tells which pixels are hair of a brow.  How far
its upper edge lies from the points differs little between people; where it lies higher or lower, turned or arched
otherwise, the points move along.  :class:`BrowFollower`, of a known person: then the brow lies higher in the sampled
texture than in the neutral one, which shows by how much: the band about each brow is compared at shifts up and down
(normalised cross-correlation), and the brow's points move along.

Frame pixels, x right, y down, unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.light import LUMA
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, U8, Int
from guise.common.interpolation import interpolation
from guise.common.kernels import kernel
from guise.common.small import mean, ramp

BROW_PAIR: Int = np.stack([RIGHT_BROW, LEFT_BROW])  # (2, 5)

# (12,) how far below the line through a brow's points its hair begins, from the outer end to the inner one: medians of
# the people of the sample clips (`training/brow_edges.py`), face widths.
USUAL_EDGE = np.array([-53, -42, -25, -11, -7, 0, 8, 13, 17, 4, -9, -19]) / 1000


@dataclass(frozen=True)
class BrowLimits:
    """Where brows are looked for, and how much of what is found counts; lengths in face widths."""

    hair_above: float = 0.11  # of the line through a brow's points, where hair is looked for
    hair_below: float = 0.09
    hair_row: float = 0.005  # between the places that are looked at
    edge: float = 0.1  # share of a column's hair that lies above its upper edge
    whole_column: float = 0.015  # of hair, from which a column counts fully
    believed: tuple[float, float] = (0.5, 0.8)  # share of such columns, at which not at all and fully
    stiffness: tuple[float, float, float] = (0.0, 0.75, 1.25)  # against a shift, a turn, an arch; columns
    strength: float = 0.75
    memory: float = 0.85  # share of the last frame's shifts that is kept

    band_beside: float = 0.012  # of a brow's points, what is compared by its looks
    band_above: float = 0.06
    band_below: float = 0.03
    band_column: float = 0.01  # between the columns that are sampled
    band_row: float = 0.006  # between the rows
    search: float = 0.06  # up and down
    cost: float = 6.0  # of correlation, by which a shift of one face width must be better than none, squared
    unsure: tuple[float, float] = (0.3, 0.5)  # correlations from which and at which a shift is believed
    jitter: float = 0.004  # smaller changes from frame to frame count less


LIMITS = BrowLimits()

_ROWS = np.arange(-LIMITS.hair_above, LIMITS.hair_below, LIMITS.hair_row)
_ALONG = interpolation(np.linspace(0, 4, len(USUAL_EDGE)), np.arange(5.0))  # from a brow's points to columns
_USUAL = np.stack([USUAL_EDGE, USUAL_EDGE[::-1]])  # of the right brow and the left one, from left to right
# Shift, turn and arch of columns and of points, and what they are held back by.
_COLUMNS, _POINTS = (
    np.vander(np.linspace(-1, 1, n), len(LIMITS.stiffness), increasing=True) for n in (len(USUAL_EDGE), 5)
)
_STIFF = np.diag(np.maximum(LIMITS.stiffness, 1e-6))

_MARGIN = round(LIMITS.search / LIMITS.band_row)  # rows above and below the bands that are searched
_SHIFTS = LIMITS.band_row * np.arange(-_MARGIN, _MARGIN + 1)
_COSTS = np.asarray(LIMITS.cost * _SHIFTS**2, np.float64)
TOLD = np.array([LIMITS.band_row, *LIMITS.unsure])  # to `brow_shifts`


class BrowLift:
    """Sets the brows of one face onto their hair, frame by frame, steadily; a new one for a single picture."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin with the next face."""
        self._shifts: F64 | None = None  # (2, 5) of the points of both brows

    @property
    def has_seen(self) -> bool:
        """Whether a face was seen since the last reset."""
        return self._shifts is not None

    def see(self, parsing: Parsing, points: F64) -> None:
        """Look at the brows of a parsed face with points (81, 2), pixels, as they were found."""
        found = _shifts(*edges_of_hair(parsing, points))
        self._shifts = found if self._shifts is None else found + LIMITS.memory * (self._shifts - found)

    def __call__(self, points: F64) -> F64:
        """Points (81, 2) as they were found, pixels, with the brows on their hair as it was seen last."""
        lifted = points.copy()
        if self._shifts is not None:
            lifted[BROW_PAIR] += self._shifts[..., None] * _down(ReferenceFrame.canonical(), points)
        return lifted


def edges_of_hair(parsing: Parsing, points: F64) -> tuple[F64, F64]:
    """How far below the lines through the brows of a face (81, 2) their hair begins, from left to right.

    (2, 12) face widths, in columns along the right and the left brow, and their weights (2, 12).
    """
    down = _down(ReferenceFrame.canonical(), points)
    places = (_ALONG @ points[BROW_PAIR])[:, :, None] + _ROWS[:, None] * down
    hair = parsing.at(places.reshape(-1, 2), parsing.shares[FaceClass.BROWS]).reshape(-1, len(_ROWS))
    amount = np.add.reduce(hair, 1)
    above = hair.cumsum(1) / np.maximum(amount, 1e-6)[:, None]
    columns, after = np.arange(len(above)), (above > LIMITS.edge).argmax(1)
    low, high = above[columns, after - 1], above[columns, after]
    edges = _ROWS[after] - LIMITS.hair_row * (high - LIMITS.edge) / np.maximum(high - low, 1e-6)
    edges = np.where(after > 0, edges, _ROWS[0])
    weights = np.minimum(np.maximum(amount * LIMITS.hair_row / LIMITS.whole_column, 0), 1)
    return edges.reshape(_USUAL.shape), weights.reshape(_USUAL.shape)


def _shifts(edges: F64, weights: F64) -> F64:
    """(2, 5) by how much the points of the brows belong lower: a smooth fit to their edges."""
    weighted = _COLUMNS * weights[..., None]
    normal, away = _COLUMNS.T @ weighted + _STIFF, edges - _USUAL
    fits = [
        cv2.solve(left, one.T @ off[:, None], flags=cv2.DECOMP_CHOLESKY)[1]
        for left, one, off in zip(normal, weighted, away, strict=True)
    ]
    believed = np.array([ramp(share, *LIMITS.believed) for share in mean(weights, 1)])
    return np.asarray((LIMITS.strength * believed)[:, None] * (_POINTS @ fits)[..., 0])


class BrowFollower:
    """Corrects the brows of one person's tracked shapes, frame by frame.

    appearance : of the person; its neutral face shows how the brows look where their points are.
    """

    def __init__(self, appearance: AppearanceModel) -> None:
        self._reference = reference = appearance.reference
        grids = [_band(reference, brow) for brow in BROW_PAIR]
        sizes = [grid.shape[:2] for grid in grids]
        self._sampler = MeshSampler.build(reference, np.concatenate([grid.reshape(-1, 2) for grid in grids]))
        luma = reference.scatter(appearance.neutral_texture @ LUMA)
        bands = _split(self._sampler.sample(luma, reference.points), sizes)
        self._right, self._left = (np.ascontiguousarray(seen[_MARGIN:-_MARGIN]) for seen in bands)

    def shifts(self, luma: U8, shape: F64, before: F64 | None) -> F64:
        """(2,) by how much right and left brow lie lower than the points of a shape (81, 2), face widths.

        before : as they were found in the frame before, of a face that is not a new one.
        """
        found, mesh = np.empty(2), self._sampler
        brow_shifts(mesh.vertices, mesh.weights, shape, luma, self._right, self._left, TOLD, _COSTS, found)
        if before is None:
            return found
        step = found - before
        return np.asarray(before + step * step**2 / (step**2 + LIMITS.jitter**2))

    def moved(self, shape: F64, shifts: F64) -> F64:
        """A shape (81, 2) with its brows lower by shifts (2,)."""
        made = shape.copy()
        made[BROW_PAIR] += shifts[:, None, None] * _down(self._reference, shape)
        return made


def _band(reference: ReferenceFrame, brow: Int) -> F64:
    """(rows, columns, 2) places on the grid about a brow at rest, and above and below it as far as it is searched."""
    points = reference.points[brow] / reference.resolution
    low, high = points.min(0), points.max(0)
    xs = np.arange(low[0] - LIMITS.band_beside, high[0] + LIMITS.band_beside, LIMITS.band_column)
    rows = round((high[1] - low[1] + LIMITS.band_above + LIMITS.band_below) / LIMITS.band_row)
    ys = low[1] - LIMITS.band_above + LIMITS.band_row * np.arange(-_MARGIN, rows + _MARGIN)
    return np.asarray(reference.resolution * np.stack(np.meshgrid(xs, ys), -1))


@kernel
def brow_shifts(
    corners: Int,
    weights: F32,
    shape: F64,
    luma: U8,
    right: F32,
    left: F32,
    limits: F64,
    costs: F64,
    found: F64,
) -> None:
    """By how much brows lie lower than their points, face widths; 0 where one isn't recognised.

    corners, weights : (3, n) of the pixels of both bands, see `MeshSampler`.   shape : (81, 2) pixels.
    luma : (h, w).   right, left : (rows, columns) the bands at rest; what is seen has a row more for each shift.
    limits : a row in face widths, and correlations from which and at which a shift is believed.
    costs : (k,) of shifts, from the farthest up, in correlation.   found : (2,) the result.
    """
    (row, first, last), extra = limits, len(costs) - 1
    seen = _split(
        MeshSampler(corners, weights).sample(luma, shape),
        [(len(b) + extra, b.shape[1]) for b in (right, left)],
    )
    for side, (band, at_rest) in enumerate(zip(seen, (right, left), strict=True)):
        alike = _correlations(band.astype(np.float64), at_rest.astype(np.float64))
        likely = alike - costs
        k = int(likely.argmax())
        peak = row * (k - extra // 2)
        if 0 < k < extra:
            before, here, after = likely[k - 1 : k + 2]
            peak += row * float((before - after) / (2 * min(before - 2 * here + after, -1e-6)))
        found[side] = peak * min(max(float(alike[k] - first) / (last - first), 0.0), 1.0)


def _correlations(seen: F64, at_rest: F64) -> F64:
    """(k,) normalised cross-correlations of a band (rows, columns) with parts of one that has k - 1 rows more."""
    windows = np.lib.stride_tricks.sliding_window_view(seen, len(at_rest), 0).transpose(0, 2, 1)
    apart, windows = at_rest - at_rest.mean(), windows - windows.mean((1, 2), keepdims=True)
    both = (apart * windows).sum((1, 2))
    spread = np.sqrt((windows * windows).sum((1, 2)) * (apart * apart).sum())
    return np.asarray(np.where(spread > 1e-6, both / np.maximum(spread, 1e-6), 0))


def _split(values: F32, sizes: list[tuple[int, int]]) -> list[F32]:
    """Two bands (rows, columns) of the values (n,) of both."""
    (rows, columns), left = sizes
    return [values[: rows * columns].reshape(rows, columns), values[rows * columns :].reshape(left)]


def _down(reference: ReferenceFrame, points: F64) -> F64:
    """(2,) pixels, a face width down a face with points (81, 2)."""
    down: F64 = reference.resolution * reference.to_shape(points).linear[1]
    return down
