"""The scene's light on a face, by what it does to the person in the video.

That person is enrolled: the frame over their own face in even light, at the same texels, is the scene's light (the
quotient image of Shashua and Riklin-Raviv 2001), with what is misplaced and what expressions change.  The face that
is shown has no part in it, so that no difference between the two people can pass for light: neither a beard nor the
form of an eye socket shines through.  Means of skin on a coarse grid are divided, over so little of the neighbourhood
that shadows keep their edges.  One ratio of the two people's skin gives the face the person's tone.  Eyes and
the inside of the mouth get the light of the whole face, in the tint of the light on whites.  Where the picture is
clipped to white no ratio tells the light, and the face's skin takes the colour of the frame.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.coarse_grid import CellReader, CoarseGrid, TexelSums
from guise.aam.irises import Whites
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import BLACK_GREY_LEVELS, COARSE_CELL, MIN_SHARE, FaceInFrame, ramp
from guise.app.drawing.memory import FaceLight, Memory
from guise.common.arrays import F32, Bool, Int
from guise.common.decay import Decay
from guise.common.kernels import kernel
from guise.common.small import mean
from guise.common.tuned import tuned


@dataclass(frozen=True)
class QuotientLightLimits:
    """Width and memory."""

    # standard deviation of the means that are divided
    width_face_widths: float = tuned(0.025, "face widths", "picture.identity")
    # means of green, over black, from which and at which skin is white, and nothing tells its light
    clipped: tuple[float, float] = tuned((236.0, 252.0), "grey levels", "picture.identity")
    memory: Decay = tuned(Decay(0.65), "share", "picture.truth")


LIMITS = QuotientLightLimits()
BLACK = np.float32(BLACK_GREY_LEVELS)
PARTS = ((RIGHT_EYE, LEFT_EYE), (INNER_LIPS,))


class QuotientLight:
    """The light by a quotient, smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the reference frame's mask pixels, where colours are compared.
    mask : (h, w) bool, where the face is shown.
    enrolled : neutral RGB (n, 3) in even light of the frame's person and of the face, in the reference frame's mask
        pixels.
    """

    def __init__(self, reference: ReferenceFrame, texels: Int, mask: Bool, enrolled: tuple[F32, F32]) -> None:
        grid = CoarseGrid(reference, COARSE_CELL)
        self._skin = texels[(skin_mask(reference) & mask)[reference.mask][texels]]
        self._in_seen = np.flatnonzero(np.isin(texels, self._skin, kind="table"))
        self._sums = TexelSums(grid.size, grid.places(self._skin))
        self._reference, self._cell = reference, grid.cell
        self._smoother = grid.smoother(LIMITS.width_face_widths)
        self._own, self._at_rest = (np.maximum(texture, 0)[self._skin] for texture in enrolled)
        own_tone, tone = (np.exp(mean(np.log(rgb + BLACK), 0)) for rgb in (self._own, self._at_rest))
        self._tone = np.asarray(own_tone / tone, np.float32)[:, None, None]
        rest = self._sums(self._at_rest, np.ones(len(self._skin), np.float32))
        self._skin_at_rest = (self._smoother.means(rest) + BLACK) * self._tone
        self._every = np.ones(len(self._skin), np.float32)
        self._parts = _parts_of(reference)
        self._whites = Whites(reference, enrolled, self._skin)

    def measure(self, face: FaceInFrame, memory: Memory) -> None:
        """Move towards the light of what the frame shows."""
        if not face.seen:
            return
        now = self._found(face.seen.rgb, face.seen.visible)
        kept = memory.light
        memory.light = now if kept is None else _moved(kept, now, 1.0 - LIMITS.memory.over(memory.clock.step))

    def apply(self, face: FaceInFrame, memory: Memory) -> None:
        """Light the face's texture."""
        light, canvas, colour = memory.light, face.canvas, face.frame.yuv
        assert light is not None
        to_stored, offset = colour.from_rgb[:, :3], colour.from_rgb[:, 3]
        cells = light.map.copy()
        cells[3:] -= light.map[:3] * self._moved_skin(canvas.texture[self._skin])
        planes = np.empty(canvas.texture.shape[::-1], np.float32)
        matrix = np.column_stack([to_stored, offset]).astype(np.float32)
        grid = self._reference.pixels, self._reference.size[1]
        lit(canvas.texture, *grid, cells, self._cell, *self._parts, light.parts, matrix, planes)
        canvas.planes = planes
        grey = LUMA @ light.map[:3].reshape(3, -1)
        canvas.contrast = float(np.add.reduce(grey)) / len(grey) * float(np.add.reduce(to_stored[0]))

    def _found(self, seen: F32, visible: F32 | None) -> FaceLight:
        """The light in which the person has RGB (t, 3) at the texels, of which shares (t,) are visible."""
        seen = seen[self._in_seen]
        weight = self._every if visible is None else visible[self._in_seen]
        ratio = self._ratio(self._sums(np.concatenate([self._own, seen], axis=1), weight))
        own, now = (float(weight @ rgb @ LUMA) for rgb in (self._own, seen))
        black = float(BLACK) * float(np.add.reduce(weight)) + 1e-6
        bright = self._whites.brightness * (now + black) / (own + black)
        part = np.float32(bright) * self._whites.tint(weight @ seen)
        return FaceLight(self._map(ratio * self._tone), np.array([part, part], np.float32))

    def _ratio(self, sums: F32) -> F32:
        """(3, h, w) of the frame's colours over the person's own, from sums (7, h, w) of both and of weights."""
        means = self._smoother.means(sums) + BLACK
        own, now = means[:3], means[3:]
        ratio = now / own
        if np.maximum.reduce(now[1], None) > LIMITS.clipped[0]:
            ratio *= (own / self._skin_at_rest) ** ramp(now[1], LIMITS.clipped)
        return np.asarray(ratio, np.float32)

    def _map(self, ratio: F32) -> F32:
        """(6, h, w) gain and offset that multiply the face's colours, over its black, by a ratio (3, h, w)."""
        return np.concatenate([ratio, BLACK * (ratio - 1)])

    def _moved_skin(self, face: F32) -> F32:
        """(3, h, w) by how much the skin of the face's RGB (t, 3) is off from that at rest.

        The light has that of the person's own skin, which moves in the same way.
        """
        sums = self._sums(face - self._at_rest, self._every)
        return np.asarray(sums[:3] / np.maximum(sums[3:], 1), np.float32)


@kernel
def lit(
    texture: F32, pixels: Int, width: int, cells: F32, cell: float,
    in_parts: Int, shares: F32, parts: F32, to_stored: F32, planes: F32,
) -> None:  # fmt: skip
    """Planes (3, n), in stored components, of a texture (n, 3) in a light.

    Parameters
    ----------
    pixels, width : (n,) flat indices into a grid of a width, in ascending order.
    cells, cell : (6, h, w) gains and offsets of colours, which are read bilinearly, every so many grid pixels.
    in_parts, shares : (m,) of the n, ascending, in eyes and mouth, and the shares (p, m) of each of these parts there.
    parts : (p, 3) gains of the parts, which have no offset.
    to_stored : (3, 4) matrix and offset from RGB.
    """
    y, x = np.divmod(pixels, width)
    light = CellReader((np.column_stack([x, y]) / cell).astype(np.float32))(cells)
    surface = 1 - shares.max(0)
    light[:, in_parts] *= surface
    light[:3, in_parts] += parts.T @ shares
    rgb = light[:3] * texture.T + light[3:]
    np.add(to_stored[:, :3] @ rgb, to_stored[:, 3:], out=planes)


def _parts_of(reference: ReferenceFrame) -> tuple[Int, F32]:
    """Eyes and mouth, which are lit each by one gain: (m,) pixels of the mask, and the shares (2, m) of either."""
    parts = np.array([soft_parts(reference, part, 0.0)[reference.mask] for part in PARTS])
    pixels = np.flatnonzero(parts.max(0) > MIN_SHARE / 2)
    return pixels, np.ascontiguousarray(parts[:, pixels], np.float32)


def _moved(light: FaceLight, aim: FaceLight, share: float) -> FaceLight:
    """A light on a share of the way to another, but all of the way in what is common to the whole face."""
    sums = [np.add.reduce(one.map[:3], (1, 2)) for one in (aim, light)]
    change = sums[0] / np.maximum(sums[1], 1e-4)
    now, parts = light.map * np.concatenate([change, change])[:, None, None], light.parts * change
    return FaceLight(now + share * (aim.map - now), parts + share * (aim.parts - parts))
