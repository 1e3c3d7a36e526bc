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

from guise.aam.coarse_grid import LEAST, CellReader, CoarseGrid, TexelSums, texel_sums
from guise.aam.irises import Whites
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import BLACK_GREY_LEVELS, COARSE_CELL, MIN_SHARE, FaceInFrame, ramp
from guise.app.drawing.memory import FaceLight, Memory
from guise.common.arrays import F32, F64, Bool, Int
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
TOLD = np.array([BLACK, *LIMITS.clipped])  # what `move_light` is told of limits
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
        self._grid = reference.pixels, reference.size[1], grid.cell
        self._smoother = grid.smoother(LIMITS.width_face_widths)
        self._own, self._at_rest = (np.maximum(texture, 0)[self._skin] for texture in enrolled)
        own_tone, tone = (np.exp(mean(np.log(rgb + BLACK), 0)) for rgb in (self._own, self._at_rest))
        self._tone = np.asarray(own_tone / tone, np.float32)
        self._every = np.ones(len(texels), np.float32)
        rest = self._smoother(
            self._sums(self._own, self._at_rest, np.arange(len(self._skin)), self._every[: len(self._skin)])
        )
        at_rest = rest[3:6] / np.maximum(rest[-1], LEAST) + BLACK
        self._skin_at_rest = np.asarray(at_rest * self._tone[:, None, None], np.float32)
        self._parts = _parts_of(reference)
        self._whites = Whites(reference, enrolled, self._skin)
        self._first = FaceLight(np.zeros((6, *grid.size), np.float32), np.zeros((len(PARTS), 3), np.float32))

    def measure(self, face: FaceInFrame, memory: Memory) -> None:
        """Move towards the light of what the frame shows."""
        if not face.seen:
            return
        seen, step = face.seen, 1.0 - LIMITS.memory.over(memory.clock.step)
        kept, share = (self._first, 1.0) if memory.light is None else (memory.light, step)
        weights = self._every if seen.visible is None else seen.visible
        sums = self._sums(self._own, seen.rgb, self._in_seen, weights)
        light, change = np.empty_like(kept.map), np.empty(3, np.float32)
        move_light(self._smoother(sums), self._skin_at_rest, self._tone, TOLD, kept.map, share, light, change)
        aim, parts = self._on_whites(np.add.reduce(sums, (1, 2))), kept.parts * change
        memory.light = FaceLight(light, np.asarray(parts + share * (aim - parts), np.float32))

    def apply(self, face: FaceInFrame, memory: Memory) -> None:
        """Light the face's texture."""
        light, canvas, colour = memory.light, face.canvas, face.frame.yuv
        assert light is not None
        sums = self._sums
        canvas.planes = np.empty(canvas.texture.shape[::-1], np.float32)
        lit(
            canvas.texture, *self._grid, light.map, self._skin, self._at_rest, sums.corners, sums.shares,
            *self._parts, light.parts, colour.from_rgb, canvas.planes,
        )  # fmt: skip
        grey = LUMA @ light.map[:3].reshape(3, -1)
        canvas.contrast = (
            float(np.add.reduce(grey)) / len(grey) * float(np.add.reduce(colour.from_rgb[0, :3]))
        )

    def _on_whites(self, sums: F32) -> F32:
        """(3,) gain of eyes and mouth, by sums (7,) of the person's own colours, of the frame's and of weights."""
        own, now = (float(rgb @ LUMA) for rgb in (sums[:3], sums[3:6]))
        black = float(BLACK) * float(sums[6]) + 1e-6
        bright = self._whites.brightness * (now + black) / (own + black)
        return np.float32(bright) * self._whites.tint(sums[3:6])


@kernel
def move_light(
    sums: F32, at_rest: F32, tone: F32, limits: F64, kept: F32, share: float, light: F32, change: F32
) -> None:
    """Move a light on a share of the way to another, but all of the way in what is common to the whole face.

    Parameters
    ----------
    sums : (7, h, w) around each cell: of the person's own colours and the frame's, whose ratio is the light; weights.
    at_rest : (3, h, w) of the face's skin in the person's tone, over black, whose colour white skin takes.
    tone : (3,) of the person's skin over the face's.   limits : `TOLD`.   kept : (6, h, w), see `FaceLight`.
    light, change : (6, h, w) where it is then, and (3,) what is common to the face, which are written.
    """
    black, *clipped = limits.astype(np.float32)
    means = sums[:-1] / np.maximum(sums[-1], LEAST) + black
    own, now = means[:3], means[3:]
    ratio = now / own
    if np.maximum.reduce(now[1], None) > clipped[0]:
        ratio *= (own / at_rest) ** ramp(now[1], (clipped[0], clipped[1]))
    ratio *= tone[:, None, None]
    change[:] = np.add.reduce(ratio, (1, 2)) / np.maximum(np.add.reduce(kept[:3], (1, 2)), 1e-4)
    last = kept * np.concatenate([change, change])[:, None, None]
    light[:] = last + np.float32(share) * (np.concatenate([ratio, black * (ratio - 1)]) - last)


@kernel
def lit(
    texture: F32, pixels: Int, width: int, cell: float, light: F32, skin: Int, at_rest: F32, corners: Int,
    corner_shares: F64, in_parts: Int, shares: F32, parts: F32, to_stored: F32, planes: F32,
) -> None:  # fmt: skip
    """Planes (3, n), in stored components, of a texture (n, 3) in a light.

    The light has the colour of the person's own skin, which moves in the same way as the face's is off from that at
    rest.

    Parameters
    ----------
    pixels, width : (n,) flat indices into a grid of a width, in ascending order.
    cell, light : (6, h, w) gains and offsets of colours, which are read bilinearly, every so many grid pixels.
    skin, at_rest : (k,) of the n that are skin, and its RGB (k, 3) at rest.
    corners, corner_shares : (4, k) of the skin, see `texel_sums`.
    in_parts, shares : (m,) of the n, ascending, in eyes and mouth, and the shares (p, m) of each of these parts there.
    parts : (p, 3) gains of the parts, which have no offset.
    to_stored : (3, 4) matrix and offset from RGB.
    """
    moved, cells = np.empty((4, *light.shape[1:]), np.float32), light.copy()
    every = np.ones(len(skin), np.float32)
    texel_sums(
        corners,
        corner_shares,
        texture[skin] - at_rest,
        every[:, None][:, :0],
        np.arange(len(skin)),
        every,
        moved,
    )
    cells[3:] -= light[:3] * (moved[:3] / np.maximum(moved[3:], 1))
    y, x = np.divmod(pixels, width)
    surface = 1 - shares.max(0)
    found = CellReader((np.column_stack([x, y]) / cell).astype(np.float32))(cells)
    found[:, in_parts] *= surface
    found[:3, in_parts] += parts.T @ shares
    rgb = found[:3] * texture.T + found[3:]
    np.add(to_stored[:, :3] @ rgb, to_stored[:, 3:], out=planes)


def _parts_of(reference: ReferenceFrame) -> tuple[Int, F32]:
    """Eyes and mouth, which are lit each by one gain: (m,) pixels of the mask, and the shares (2, m) of either."""
    parts = np.array([soft_parts(reference, part, 0.0)[reference.mask] for part in PARTS])
    pixels = np.flatnonzero(parts.max(0) > MIN_SHARE / 2)
    return pixels, np.ascontiguousarray(parts[:, pixels], np.float32)
