"""The pixels of a texture in and about an eye or a mouth that is painted anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import Group
from guise.aam.mask import beyond_mask, soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, Int

GROWTH_FACE_WIDTHS = 0.01  # of a part, so that no sliver of the texture's own shows
MIN_SHARE = 0.15  # of a pixel that is painted


@dataclass(frozen=True, eq=False)
class PaintedPart:
    """Pixels (n,) of a texture in and about a landmark group.

    Parameters
    ----------
    pixels, beside : indices into the mask's pixels, of each and of what lies next to the part.
    share : (n,) in [0, 1] that is painted of each.
    sampler : of their places.
    """

    pixels: Int
    beside: Int
    share: F32
    sampler: MeshSampler

    @classmethod
    def of(cls, reference: ReferenceFrame, part: Group) -> PaintedPart:
        """Of a landmark group."""
        drawn = soft_parts(reference, (part,), GROWTH_FACE_WIDTHS)
        inside, beside = beyond_mask(drawn < MIN_SHARE)
        order = np.full(drawn.size, -1)
        order[reference.pixels] = np.arange(len(reference.pixels))
        ys, xs = np.divmod(inside, reference.size[1])
        sampler = MeshSampler.build(reference, np.column_stack([xs, ys]).astype(np.float64))
        return cls(order[inside], order[beside], drawn.ravel()[inside], sampler)

    def places(self, mesh: F64) -> F32:
        """(n, 2) pixels on a mesh (81, 2)."""
        return self.sampler.positions(mesh)

    def paint(self, texture: F32, colours: F32, share: F32 | float = 1.0) -> None:
        """Lay colours (n, 3) into a texture (k, 3), by shares (n,) in [0, 1] beside those of the part."""
        here = texture[self.pixels]
        texture[self.pixels] = here + (self.share * share)[:, None] * (colours - here)
