"""The scene's light and skin tone on a face, by a small network trained on rendered swaps with exact truth.

The classical light (`local_light.py`) takes every smooth difference between the frame and the face for light, also the
source's own cheeks, lips and eye sockets; the network knows both as enrolled and has seen what remains of them under
another's face.  It gets sums of texels on a coarse grid and gives an affine map of colours per cell, one gain for the
eyes and one for the mouth, of which the brightness counts (training/light_net.py, training/train_light.py).
RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_BROW, LEFT_EYE, RIGHT_BROW, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.onnx_model import ShippedNetwork
from guise.aam.reference import ReferenceFrame
from guise.app.swapping.brow_hair import BrowHair
from guise.app.swapping.coarse_grid import CellReader, TexelSums, gaussian_kernel
from guise.app.swapping.light_of_features import FLOOR, LightOfFeatures, brightness
from guise.app.swapping.whites import Whites
from guise.common.arrays import F32, Bool, Int

CELL_FACE_WIDTHS = 1 / 32
GRID = 41, 35  # height, width in cells; the margin is one cell
BLACK_GREY_LEVELS = 4.0  # added before a ratio is taken


@dataclass(frozen=True)
class LearnedLightLimits:
    """Memory, pace, and the colour of brows."""

    memory: float = 0.5  # share kept from frame to frame
    brow_tint: float = 0.6  # share of a brow's colour that is taken from the skin
    brow_growth_face_widths: float = 0.02
    min_share: float = 0.01  # of a brow or a part, from which a pixel belongs to it
    frames_per_check: int = 2  # of whether what the network sees has changed, so that it has to look again
    still_checks: int = 8  # after which it looks in any case
    max_change: float = 0.012  # of logs of a colour's local means, or of the share of skin that is seen
    min_weight: float = 0.2  # of a cell whose means are compared
    looks_per_mirrored: int = 8  # of which one is also taken at the mirror image
    # Of the light that is a mean over a wider neighbourhood: the rest follows the person's own form as well, and less
    # of the donor's is left.  At the edge of a shadow there is none.
    wide_share: float = 0.2
    shadow_edge: float = 0.12  # log of light over its mean, by which the share falls by a standard deviation
    wide_face_widths: float = 0.1


LIMITS = LearnedLightLimits()
INPUTS = "skin", "other", "own", "rest"  # of the network
PARTS = ((RIGHT_EYE, LEFT_EYE), (INNER_LIPS,))


def places(reference: ReferenceFrame, texels: Int | None = None) -> F32:
    """(t, 2) places in cells of texels, given as indices into the reference frame's mask pixels; of all by default."""
    pixels = reference.pixels if texels is None else reference.pixels[texels]
    ys, xs = np.divmod(pixels, reference.size[1])
    from_corner = np.column_stack([xs, ys]) - reference.points.min(0)
    return np.asarray(from_corner / (CELL_FACE_WIDTHS * reference.resolution) + 1, np.float32)


def part_masks(reference: ReferenceFrame) -> list[F32]:
    """Share (n,) of eyes and of the mouth in each of the reference frame's mask pixels."""
    return [soft_parts(reference, part, 0.0)[reference.mask] for part in PARTS]


class LearnedLight:
    """A `Palette` by a network, smooth in time.

    The network looks again when local means of skin have changed.  The mean of what it finds in a face and in its
    mirror image is nearer to the truth than either; half their difference changes slowly and is taken anew at every
    eighth look.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : (t,) indices into the reference frame's mask pixels, where colours are compared.
    mask : (h, w) bool, where the face is shown.
    enrolled : neutral RGB (n, 3) of the frame's person and of the face, in the reference frame's mask pixels.
    """

    def __init__(self, reference: ReferenceFrame, texels: Int, mask: Bool, enrolled: tuple[F32, F32]) -> None:
        at = places(reference, texels)
        skin = (skin_mask(reference) & mask)[reference.mask][texels]
        self._kinds = [np.flatnonzero(kind) for kind in (skin, ~skin)]
        self._sums = [TexelSums(GRID, at[kind]) for kind in self._kinds]
        self._enrolled = [self._means(texture[texels]) for texture in enrolled]
        self._weight = np.float32(mask.sum() / len(texels) / (CELL_FACE_WIDTHS * reference.resolution) ** 2)
        self._at_pixels = CellReader(places(reference))
        parts = np.array(part_masks(reference))
        self._in_parts = np.flatnonzero(parts.max(0) > LIMITS.min_share)
        self._parts = parts[:, self._in_parts]
        self._surface = 1 - self._parts.max(0)
        brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.brow_growth_face_widths)[reference.mask]
        self._brows = np.flatnonzero(brows > LIMITS.min_share)
        self._brow_share = np.float32(LIMITS.brow_tint) * brows[self._brows]
        person, face = (float((texture[texels[self._kinds[0]]] @ LUMA).mean()) for texture in enrolled)
        self._hair = BrowHair(reference, face / max(person, 1.0))
        self._whites = Whites(reference, enrolled, texels[self._kinds[0]])
        self._of_features = LightOfFeatures(reference, mask, GRID, places(reference), CELL_FACE_WIDTHS)
        self._wide = [gaussian_kernel(n, LIMITS.wide_face_widths / CELL_FACE_WIDTHS) for n in GRID]
        self._session = session()
        self.reset()

    def reset(self) -> None:
        """Take the next update as it is."""
        self._light = _Light()
        self._aim: _Light | None = None
        self._unlike: list[F32] = []  # half of what the mirror image gives more than the face
        self._looked_at: F32 | None = None  # sums (7, h, w) of skin
        self._updates = self._still = self._looks = 0

    @property
    def contrast(self) -> float:
        """Scale of grey differences on skin."""
        values = np.tensordot(LUMA, self._light.map[:3], 1).ravel()
        middle = len(values) // 2  # of an odd number of cells; np.median imports numpy.ma
        return float(np.partition(values, middle)[middle])

    def update(self, face: F32, seen: F32, visible: F32 | None) -> None:
        """See `Palette.update`."""
        fresh = self._aim is None
        if self._aim is None or self._updates % LIMITS.frames_per_check == 0:
            visible = np.ones(len(face), np.float32) if visible is None else visible
            sums = self._summed(np.concatenate([face, seen], axis=1), visible * self._weight)
            self._still += 1
            if self._aim is None or self._still >= LIMITS.still_checks or self._has_changed(sums[0][0]):
                self._aim, self._looked_at, self._still = self._looked(sums), sums[0][0], 0
        self._updates += 1
        self._light.move(self._aim, 1.0 if fresh else 1.0 - LIMITS.memory)

    def apply(self, texture: F32, to_stored: F32, offset: F32) -> F32:
        """See `Palette.apply`."""
        planes, light = np.ascontiguousarray(texture.T), self._at_pixels(self._light.map)
        gains, lit = light[:3], light[3:]
        part_gains = gains.take(self._in_parts, 1) * self._surface + self._light.parts.T @ self._parts
        gains[:, self._in_parts] = part_gains
        lit[:, self._in_parts] *= self._surface
        lit[:, self._brows] += gains.take(self._brows, 1) * self._brow_changes(planes.take(self._brows, 1))
        skin = self._hair.lit_skin(planes, gains, lit)
        gains *= planes
        gains += lit
        self._hair.adjust(gains, planes, skin, self._light.of_eyes)
        out = to_stored.astype(np.float32) @ gains
        out += offset.astype(np.float32)[:, None]
        return np.asarray(out)

    def _has_changed(self, skin: F32) -> bool:
        """Whether sums (7, h, w) of skin differ from those that the network has looked at."""
        if self._looked_at is None:
            return True
        now, last = skin[6], self._looked_at[6]
        if np.abs(now - last).sum() > LIMITS.max_change * last.sum():
            return True
        cells = np.minimum(now, last) > LIMITS.min_weight
        means = (
            np.maximum(s[:6, cells] / s[6, cells], 0) + BLACK_GREY_LEVELS for s in (skin, self._looked_at)
        )
        logs = np.log(np.divide(*means)).reshape(2, -1)  # of the face, of the frame
        return bool((np.square(logs).sum(1) > LIMITS.max_change**2 * logs.shape[1]).any())

    def _looked(self, sums: list[F32]) -> _Light:
        """What the network finds in sums of skin and of other texels; weights are 1 in all of a cell."""
        found, gains = self._found([*sums, *self._enrolled])
        tint, in_frame = (part.sum((1, 2)) for part in (sums[0][0, :3], sums[0][0, 3:6]))
        gains = (gains @ LUMA)[:, None] * self._whites.tint(in_frame)
        seen = sums[0][0, 6] + sums[1][0, 6]
        shown = tint / max(float(sums[0][0, 6].sum()), FLOOR)
        return _Light(self._widened(found, seen, shown), gains, tint / max(float(tint @ LUMA), 1.0))

    def _found(self, inputs: list[F32]) -> list[F32]:
        """The map (6, h, w) and the gains (2, 3) that the network gives for its inputs (1, ..., h, w)."""
        found, gains = self._session.run(None, dict(zip(INPUTS, inputs, strict=True)))
        if self._looks % LIMITS.looks_per_mirrored == 0:
            image = [np.ascontiguousarray(values[..., ::-1]) for values in inputs]
            in_image, its_gains = self._session.run(None, dict(zip(INPUTS, image, strict=True)))
            self._unlike = [(in_image[..., ::-1] - found) / 2, (its_gains - gains) / 2]
        self._looks += 1
        return [(values + more)[0] for values, more in zip((found, gains), self._unlike, strict=True)]

    def _summed(self, colours: F32, weights: F32) -> list[F32]:
        """Sums (1, c + 1, h, w) of skin and of other texels."""
        return [
            s(colours[kind], weights[kind])[None] for kind, s in zip(self._kinds, self._sums, strict=True)
        ]

    def _means(self, colours: F32) -> F32:
        """Means (1, 2, 3, h, w) of skin and of other texels (t, 3), 0 where nothing is."""
        sums = np.stack(self._summed(colours, np.ones(len(colours), np.float32)), axis=1)
        return np.asarray(sums[:, :, :3] / np.maximum(sums[:, :, 3:], FLOOR), np.float32)

    def _widened(self, found: F32, seen: F32, skin: F32) -> F32:
        """The map (6, h, w) with a share of its means over a wider neighbourhood, of cells that are seen (h, w).

        skin : (3,) RGB on which lights are compared.
        """
        found = self._of_features.without(found, seen, skin)
        rows, columns = self._wide
        wide = (rows @ (found * seen) @ columns.T) / np.maximum(rows @ seen @ columns.T, FLOOR)
        near, far = brightness(found, skin), brightness(np.asarray(wide, np.float32), skin)
        share = LIMITS.wide_share * np.exp(-0.5 * (np.log(near / far) / LIMITS.shadow_edge) ** 2)
        return np.asarray(found + share.astype(np.float32) * (wide - found))

    def _brow_changes(self, brows: F32) -> F32:
        """What brings brows (3, b) nearer to the colour of the face's skin: the little colour of dark hair is noise."""
        return np.asarray(self._brow_share * ((LUMA @ brows) * self._light.tint[:, None] - brows))


def _same_map() -> F32:
    """(6, h, w) that changes nothing."""
    return np.concatenate([np.ones((3, *GRID), np.float32), np.zeros((3, *GRID), np.float32)])


@dataclass(eq=False)
class _Light:
    """Gain and offset of each cell (6, h, w), gains of the parts (2, 3), colour of the face's own skin (3,)."""

    map: F32 = field(default_factory=_same_map)
    parts: F32 = field(default_factory=lambda: np.ones((len(PARTS), 3), np.float32))
    tint: F32 = field(default_factory=lambda: np.ones(3, np.float32))

    @property
    def of_eyes(self) -> float:
        """Gain of the eyes' brightness."""
        return float(self.parts[0] @ LUMA)

    def move(self, aim: _Light, share: float) -> None:
        """Move a share of the way to another, but all of the way in what is common to the whole face."""
        change = aim.map[:3].mean((1, 2)) / np.maximum(self.map[:3].mean((1, 2)), FLOOR)
        now, parts = self.map * np.tile(change, 2)[:, None, None], self.parts * change
        self.map = now + share * (aim.map - now)
        self.parts = parts + share * (aim.parts - parts)
        self.tint = self.tint + share * (aim.tint - self.tint)


@lru_cache(maxsize=1)
def session() -> ShippedNetwork:
    """The network that ships with the package."""
    return ShippedNetwork("light.onnx")
