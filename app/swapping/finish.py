"""What makes a drawn face look filmed by the same camera as the picture around it: its sharpness and its grain."""

from __future__ import annotations

from guise.aam.reference import ReferenceFrame
from guise.app.swapping.grain import Grain
from guise.app.swapping.sharpness import Sharpness
from guise.common.arrays import F32, F64, U8, Bool

FIRST_DRAWS = 4


class Finish:
    """`Grain` and `Sharpness` of one face, measured on the same frames.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is drawn.
    """

    def __init__(self, reference: ReferenceFrame, mask: Bool) -> None:
        self._grain, self.sharpness = Grain(reference, mask), Sharpness(reference, mask)
        self.reset()

    def reset(self) -> None:
        """Begin with the next face."""
        self._grain.reset()
        self.sharpness.reset()
        self._seen: tuple[F32 | None, F32 | None] = None, None

    @property
    def draws(self) -> int:
        """How often a frame is to be drawn: a face's first several times, of which the last counts, to measure it."""
        return 1 if self.sharpness.measured else FIRST_DRAWS

    def before(self, roi: U8, texture: U8, frame: int) -> None:
        """Look at a rectangle (h, w, 3) before drawing, and put the grain of the frame of this number on a texture."""
        self._grain.add(texture, frame)
        self._seen = self._grain.seen(roi), self.sharpness.seen(roi)

    def after(self, roi: U8, mesh: F64) -> None:
        """Compare it with the same rectangle after drawing, on a mesh (81, 2) in its pixels."""
        grain, gradients = self._seen
        if grain is not None:
            self._grain.update(grain, roi, mesh)
        if gradients is not None:
            self.sharpness.update(gradients, roi, mesh)
