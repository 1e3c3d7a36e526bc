"""The source's own eyeballs and inner mouth, drawn through the identity's lids and lips.

The frame is sampled between the source's own lids and lips and laid into the texture, so that it moves with the drawn
mesh: whatever the two faces' proportions, an eye is whole and of one colour.  Pixels, x right, y down.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.landmarks.schemes import Group
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, U8

EDGE = 0.02  # share of the source, below which a pixel is left to the identity


class Aperture:
    """The inside of one landmark group on a texture.

    Parameters
    ----------
    reference : ReferenceFrame.
    part : landmark group whose hull is the aperture, soft-edged.
    factor : pixels of the texture per grid pixel, along each axis.
    """

    def __init__(self, reference: ReferenceFrame, part: Group, factor: int) -> None:
        h, w = reference.size
        share = soft_parts(reference, (part,), 0.0)
        share = np.asarray(
            cv2.resize(share, (factor * w, factor * h), interpolation=cv2.INTER_LINEAR), np.float32
        )
        ys, xs = (np.flatnonzero((share > EDGE).any(axis)) for axis in (1, 0))
        self._place = np.s_[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        self._share = share[self._place]
        self._rest = 1 - self._share
        rows, columns = np.mgrid[self._place]
        places = (np.column_stack([columns.ravel(), rows.ravel()]) + 0.5) / factor - 0.5
        self._sampler = MeshSampler.build(reference, places)

    def fill(self, picture: U8, roi: U8, head: F64) -> None:
        """Lay what a rectangle shows on the source's shape (81, 2), in its pixels, into a texture in place."""
        places: F32 = self._sampler.positions(head).reshape(*self._share.shape, 2)
        own = cv2.remap(roi, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        here = np.ascontiguousarray(picture[self._place])
        picture[self._place] = cv2.blendLinear(own, here, self._share, self._rest)
