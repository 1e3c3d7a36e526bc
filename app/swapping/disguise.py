"""What a disguise paints anew: the forehead over hair, eyeballs, and the inside of the mouth."""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.model import Identity
from guise.app.swapping.eyeballs import Eyeballs
from guise.app.swapping.forehead import Forehead, skin_grain
from guise.app.swapping.inner_mouth import InnerMouth
from guise.common.arrays import F32, F64, U8


class Disguise:
    """Paints them into the texture of an identity.

    source, target : Identity of the head, whose gaze is followed, and of the face; both share a reference frame.
    forehead : face widths by which it is drawn farther up.

    Attributes
    ----------
    forehead : how the texture is read there.
    """

    def __init__(self, source: Identity, target: Identity, forehead: float) -> None:
        self.forehead = Forehead.of(target.reference, forehead)
        self._grain = self.forehead.softened * skin_grain(target)
        self._eyeballs, self._inner_mouth = Eyeballs(source, target), InnerMouth(target)

    def continued(self, picture: U8, contrast: float, black: float) -> U8:
        """A texture (h, w, 3), brightness first, with the forehead over hair.

        contrast : scale of grey levels of the identity's own texture.   black : the brightness of black.
        """
        picture = self.forehead.continued(picture)
        lit = (cv2.extractChannel(picture, 0) - np.float32(black)) * self.forehead.lit
        luma = cv2.addWeighted(lit, 1.0, self._grain, contrast, black, dtype=cv2.CV_8U)
        return np.asarray(cv2.insertChannel(luma, picture, 0), np.uint8)

    def look(self, irises: F64, head: F64) -> None:
        """See `Eyeballs.look`."""
        self._eyeballs.look(irises, head)

    def reset(self) -> None:
        """Look as at rest."""
        self._eyeballs.reset()

    def paint(self, texture: F32, mesh: F64) -> None:
        """Paint into a texture (n, 3) that will be drawn on a mesh (81, 2)."""
        self._eyeballs.paint(texture, mesh)
        self._inner_mouth.paint(texture, mesh)
