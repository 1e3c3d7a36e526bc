"""2-D facial expression analogy: T' is to T as S' is to S (Song et al. 2007, section VI).

Landmarks are (81, 2) of scheme face81, pixels of their own picture, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from guise.analogy.photo.change import agreement, bounded, carried, steadied
from guise.analogy.photo.eyes import closed, opened_again
from guise.analogy.photo.filling import filled, lidded
from guise.analogy.photo.flow import followed, left
from guise.analogy.photo.grids import Grid, Seen, drawn, face, own, wide
from guise.analogy.photo.heights import DARK, asked, heights
from guise.analogy.photo.motion import Motion
from guise.analogy.photo.mouth import light, opened
from guise.analogy.photo.pictures import (
    LUMINANCE,
    PhotoError,
    Picture,
    checked_points,
    like,
    sampled,
    shrunk,
    unit,
)
from guise.analogy.photo.poisson import integrated
from guise.analogy.photo.ratio import faded, ratio
from guise.analogy.photo.template import ring, template
from guise.common.arrays import F32, F64, Bool

Method = Literal["tents", "ratio", "warp"]
Mouth = Literal["fill", "none"]
METHODS: tuple[Method, ...] = get_args(Method)
MOUTHS: tuple[Mouth, ...] = get_args(Mouth)


class PhotoAnalogy:
    """Puts the expressions of a person S onto a photograph T of another.

    Parameters
    ----------
    source : S, neutral, (h, w, 3) RGB or (h, w): uint8, uint16 or float in 0 .. 1.   source_points : (81, 2).
    target : T, neutral, alike; of any size.   target_points : (81, 2).
    method : 'tents'; 'ratio', expression ratio images; 'warp', geometry alone.
    mouth : 'fill', the inside of a mouth that opens is taken from S'; 'none', as in the paper, T is stretched.

    Raises
    ------
    PhotoError
        When a picture or landmarks cannot be used.
    """

    def __init__(
        self,
        source: Picture,
        source_points: ArrayLike,
        target: Picture,
        target_points: ArrayLike,
        method: Method = "tents",
        mouth: Mouth = "fill",
    ) -> None:
        if method not in METHODS or mouth not in MOUTHS:
            raise PhotoError(f"method must be of {METHODS} and mouth of {MOUTHS}, got {method!r}, {mouth!r}")
        self.method, self.mouth = method, mouth
        self._mesh = template()
        first = checked_points(source_points, "source_points")
        second = checked_points(target_points, "target_points")
        self._target = np.asarray(target)
        self._motion = Motion(first, second)
        self._ring = ring(second)
        self._grid = Grid.around(second, self._ring, self._target.shape)
        self._face = unit(self._grid.of(self._target), "target")
        self._vertices = self._mesh.vertices(second, self._ring)
        picture = unit(source, "source")
        neutral, self._neutral_places = self._source(picture, first, ring(first))
        self._neutral = neutral @ LUMINANCE
        self._light = light(picture, first, self._face, second - self._grid.origin)

    def __call__(
        self, expressive: Picture, points: ArrayLike, strength: float = 1.0, facing: ArrayLike | None = None
    ) -> Picture:
        """T' with the type and size of T.

        expressive : S', of any size.   points : (81, 2).
        strength : 0 gives T, 1 the expression; beyond it is exaggerated.
        facing : (81, 2), the landmarks of S' as they would lie with the head held as in S: motion is measured from
            them, where a head's turn shall not count as one.

        Raises
        ------
        PhotoError
            When the picture or its landmarks cannot be used.
        """
        given = checked_points(points, "points")
        told = given if facing is None else checked_points(facing, "facing")
        shares = closed(self._motion.source, told, strength) if self.method == "tents" else np.zeros(2)
        if shares.any():
            given, told = (self._unlidded(landmarks, shares) for landmarks in (given, told))
        around = self._motion.pose(given).inverse().apply(ring(self._motion.source))
        picture, places = self._source(unit(expressive, "expressive"), given, around)
        share = opened(self._motion.source, given, strength) if self.mouth == "fill" else 0.0
        seen = self._drawn(self._motion(told, strength), places)
        shown, lids = sampled(picture, seen.values[..., 4:]), seen.eyes(shares)
        if self.method == "tents":
            seen = self._refined(seen, shown @ LUMINANCE, strength if facing is None else 0.0)
        out = self._warped(seen)
        if self.method != "warp":
            out = self._lit(out, strength * self._change(seen, shown @ LUMINANCE, out, lids))
        out = self._completed(out, shown, lids, seen.between * np.float32(share))
        return self._written(out, seen)

    def _unlidded(self, points: F64, shares: F64) -> F64:
        """Landmarks (81, 2) of S' with the eyes, in shares (2,), as open as in S."""
        rest = self._motion.pose(points).inverse().apply(self._motion.source)
        return opened_again(points, rest, shares)

    def _source(self, picture: F32, points: F64, around: F64) -> tuple[F32, F64]:
        """A picture of the source no finer than the grid, and the mesh's vertices (V, 2) in it."""
        factor = self._grid.factor * wide(self._motion.target) / max(wide(points), 1e-6)
        small, held = shrunk(picture, np.concatenate([points, around]), factor)
        return small, self._mesh.vertices(held[: len(points)], held[len(points) :])

    def _drawn(self, made: F64, places: F64) -> Seen:
        """The mesh at the landmarks (81, 2) of T', its vertices in S' given (V, 2)."""
        grid = self._grid
        vertices = grid.places(self._mesh.vertices(made, self._ring))
        values = [grid.places(self._vertices) - vertices, self._neutral_places, places]
        return drawn(
            self._mesh,
            vertices,
            np.concatenate(values, axis=1),
            grid.size,
            face(grid.places(made), grid.size),
        )

    def _refined(self, seen: Seen, shown: F32, share: float) -> Seen:
        """The places in S, and by a share in T, moved by what landmarks leave of the motion to S', which is shown.

        Of a turned head that is the turn's, and none of T's.
        """
        neutral = sampled(self._neutral, seen.values[..., 2:4])
        moved = left(heights(shown), heights(neutral), seen.face & (seen.part == 0), self._width)
        values = seen.values.copy()
        values[..., 2:4] = followed(seen.values[..., 2:4], own(self._grid.size) + moved)
        moved *= np.float32(share)
        values[..., :2] = followed(seen.values[..., :2], own(self._grid.size) + moved) + moved
        return replace(seen, values=values)

    def _warped(self, seen: Seen) -> F32:
        """The target's rectangle (h, w, 3), warped."""
        grid = self._grid
        moved = grid.fine(seen.values[..., :2]) / np.float32(grid.factor)
        return sampled(self._face, own(grid.within) + moved)

    def _change(self, seen: Seen, shown: F32, warped: F32, lids: F32) -> F32:
        """(h, w) on the grid: by how much the logarithm of the luminance changes."""
        neutral = sampled(self._neutral, seen.values[..., 2:4])
        share = faded(seen.face, self._width)
        if self.method == "ratio":
            return np.asarray(np.log(ratio(neutral, shown, self._width)) * share, np.float32)
        before, after = heights(neutral), heights(shown)
        target = heights(self._grid.coarse(warped) @ LUMINANCE)
        filled_in = (seen.between & (self.mouth == "fill")) | (lids > 0)
        alike, same = agreement(before, target, self._width)
        taken = carried(after - before, alike, same, filled_in, self._width)
        if seen.face.any():
            keep = float(same[seen.face].mean()) ** 2
            taken = bounded(steadied(taken, seen.face, keep), keep)
            share = share * (1 - (1 - keep) * seen.eyes(np.ones(2)))
        taken = taken * share
        return integrated(*asked(before, before + taken, target), seen.face)

    def _lit(self, picture: F32, change: F32) -> F32:
        """A picture (h, w, 3) with its luminance changed, its colours kept."""
        return np.asarray((picture + DARK) * np.exp(self._grid.fine(change))[:, :, None] - DARK, np.float32)

    def _completed(self, picture: F32, shown: F32, lids: F32, mouth: F32) -> F32:
        """A picture (h, w, 3) with lids and the inside of the mouth of S', which is shown on the grid, in shares."""
        fine, width = self._grid.fine, wide(self._motion.target)
        if lids.any():
            picture = lidded(picture, fine(shown), fine(lids), width)
        if mouth.any():
            picture = filled(picture, fine(shown), fine(mouth), self._light, width)
        return picture

    def _written(self, made: F32, seen: Seen) -> Picture:
        """T with what the mesh covers replaced."""
        covered: Bool = self._grid.fine(seen.covered.astype(np.float32)) > 0.5
        out = self._target.copy()
        self._grid.of(out)[covered] = like(np.clip(made, 0, 1), self._target)[covered]
        return out

    @property
    def _width(self) -> float:
        """Of the target's face, in pixels of the grid."""
        return self._grid.factor * wide(self._motion.target)
