"""What a palette is: it puts a synthesised face into a frame's light and colours.  RGB 0..255."""

from __future__ import annotations

from typing import Protocol

from guise.common.arrays import F32


class Palette(Protocol):
    """Fitted frame by frame at the texels of a `ParameterEstimator`; applied to whole textures."""

    def update(self, face: F32, seen: F32, visible: F32 | None) -> None:
        """Move towards the mapping from the face's RGB (t, 3) to what the frame shows (t, 3).

        visible : (t,) share in [0, 1] of each texel that nothing hides in the frame; None when that isn't known.
        """

    def apply(self, texture: F32, to_stored: F32, offset: F32) -> F32:
        """A texture (n, 3) RGB in the frame's colours, as planes (3, n) float32 of the frame's stored components.

        to_stored (3, 3), offset (3,) : RGB to stored components; the first of them is brightness.
        """

    def reset(self) -> None:
        """Take the next update as it is."""

    @property
    def contrast(self) -> float:
        """Scale of grey differences on skin."""
