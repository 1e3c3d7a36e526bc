"""How much of a place is parsed as a face: the word of another network on what the detector takes for one.

Hands, cuffs, cups, stones and leaves that detector and landmarker take for faces have hardly any skin with features.
Faces in any light, size or roll have, also half hidden or out of the picture, and behind bars and nets in a filled
picture (`guise.aam.landmarks.glances`).
"""

from __future__ import annotations

from guise.aam.landmarks.builtin import crop_of_box
from guise.aam.landmarks.glances import likeness_through
from guise.aam.parsing import FACE_CLASSES, FaceParser
from guise.common.arrays import F32, F64, U8

# Of the middle, below which nothing speaks for a face.  Of hard faces of rendered clips without points (rolled, small,
# blurred, dark, negative, half out of the picture) 19 in 20 have 0.2 or more, of cuffs, cups, pins and shirts half 0.1.
MIN_FACE_SHARE = 0.17
MIN_NEGATIVE_SHARE = 0.34  # the same in the negative, in which dark things look like skin more often
_MIDDLE = (slice(16, 54), slice(16, 48))  # of the parser's cells, where the features would be


class FaceShares:
    """Tells it of boxes (4,) of the 68 iBUG points; not for several threads at once."""

    def __init__(self) -> None:
        self._parser = FaceParser()

    def likeness(self, rgb: U8, box: F32, turn: float) -> float:
        """The share in [0, 1] of the middle of a box that is parsed as skin or features."""
        return self._share(*crop_of_box(rgb, box, turn))

    def has_face(self, rgb: U8, box: F32, turn: float) -> bool:
        """Whether a part of a face may be there, seen as it is, filled, or as a negative."""
        if likeness_through(self, rgb, box, turn) >= MIN_FACE_SHARE:
            return True
        crop, to_picture = crop_of_box(rgb, box, turn)
        return self._share(255 - crop, to_picture) >= MIN_NEGATIVE_SHARE

    def _share(self, crop: U8, to_picture: F64) -> float:
        return float(self._parser.of_crop(crop, to_picture).share(*FACE_CLASSES)[_MIDDLE].mean())
