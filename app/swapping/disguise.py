"""What a disguise paints anew: the forehead over hair, eyeballs, and the inside of the mouth."""

from __future__ import annotations

from guise.aam.model import Identity
from guise.app.swapping.eyeballs import Eyeballs
from guise.app.swapping.forehead import Forehead
from guise.app.swapping.inner_mouth import InnerMouth
from guise.common.arrays import F32, F64


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
        self._eyeballs, self._inner_mouth = Eyeballs(source, target), InnerMouth(target)

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
