"""The colour of the light on what isn't skin: whites of the eyes, and teeth.

Light that is measured on skin holds two skin tones, and by that of a dark face on a fair one its eyes and teeth would
be blue.  The white of the eyes is nearly the same in everybody.  So the light's colour on it is that of the person's
own whites over the face's, both as enrolled, times the change that the frame shows on the person's own skin since then.
RGB 0..255.
"""

from __future__ import annotations

import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.iris import white
from guise.common.arrays import F32, Int


class Whites:
    """What is known of two people's whites.

    Parameters
    ----------
    reference : ReferenceFrame.
    enrolled : neutral RGB (n, 3) of the frame's person and of the face, in the reference frame's mask pixels.
    skin : indices into the mask pixels, where the person's skin is compared.
    """

    def __init__(self, reference: ReferenceFrame, enrolled: tuple[F32, F32], skin: Int) -> None:
        eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.0)[reference.mask] > 0.5
        own, other = (white(texture[eyes]) for texture in enrolled)
        self._ratio = own / other / np.maximum(enrolled[0][skin].mean(0), 1)

    def tint(self, skin: F32) -> F32:
        """(3,) gain of the face's whites, 1 in brightness, in a light in which the person's skin has a colour (3,)."""
        tint = self._ratio * np.maximum(skin, np.float32(1e-3))
        return np.asarray(tint / (tint @ LUMA), np.float32)
