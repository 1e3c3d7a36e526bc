"""The scene's light and skin tone on a face, by a small network trained on rendered swaps with exact truth.

A ratio of local means (as in `plain_light.py`) takes every smooth difference between the frame and the face for light,
also the source's own cheeks, lips and eye sockets; the network knows both as enrolled and has seen what remains of them
under another's face.  It gets sums of texels on a coarse grid and gives an affine map of colours per cell, one gain for
the eyes and one for the mouth, of which the brightness counts (training/light_net.py, training/train_light.py).  RGB
0..255.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np

from guise.aam.coarse_grid import CellReader, TexelSums, gaussian_kernel
from guise.aam.irises import Whites
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_BROW, LEFT_EYE, LIPS, RIGHT_BROW, RIGHT_EYE, Group
from guise.aam.light import LUMA
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.onnx_model import ShippedNetwork
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import BLACK_GREY_LEVELS, GROWTH, MIN_SHARE, FaceInFrame, Seen
from guise.app.drawing.memory import Clock, FaceLight, LightMemory, Memory
from guise.common.arrays import F32, Bool, Int
from guise.common.decay import FRAME_SECONDS, Decay
from guise.common.quantile import quantile
from guise.common.small import mean
from guise.common.tuned import derived, tuned

CELL_FACE_WIDTHS = derived(1 / 32, "face widths", "the grid that the network reads, training.train_light")
GRID = derived((41, 35), "cells", "the grid that the network reads: its margin is one cell")  # height, width


@dataclass(frozen=True)
class LearnedLightLimits:
    """Memory, pace, and the colour of brows."""

    memory: Decay = tuned(Decay(0.5), "share", "picture.truth")
    # share of a brow's colour that is taken from the skin
    brow_tint: float = tuned(0.6, "share", "picture.truth")
    # between two looks whether what the network sees has changed
    check_seconds: float = tuned(2 * FRAME_SECONDS, "seconds", "speed")
    # after which it is asked in any case
    still_seconds: float = tuned(16 * FRAME_SECONDS, "seconds", "speed")
    # of logs of a colour's local means, or of the share of skin that is seen
    max_change: float = tuned(0.012, "log", "picture.truth")
    min_weight: float = tuned(0.2, "share", "picture.truth")  # of a cell whose means are compared
    looks_per_mirrored: int = tuned(8, "looks", "speed")  # of which one is also taken at the mirror image
    # Of the light that is a mean over a wider neighbourhood: the rest follows the person's own form as well, and less
    # of the donor's is left.  At the edge of a shadow there is none.
    wide_share: float = tuned(0.2, "share", "picture.truth")
    # log of light over its mean, by which the share falls by a standard deviation
    shadow_edge: float = tuned(0.12, "log", "picture.truth")
    wide_face_widths: float = tuned(0.1, "face widths", "picture.truth")


@dataclass(frozen=True)
class LightOfFeaturesLimits:
    """Lengths in face widths."""

    # by which what may be hidden lies above the brows,
    raised: float = tuned(0.035, "face widths", "picture.truth")
    growth: float = tuned(0.045, "face widths", "picture.truth")  # and by which it is larger
    # by which what may be too bright is larger than eyes and lips
    around: float = tuned(0.06, "face widths", "picture.truth")
    # by which what may tint the light is larger than brows and eyes
    tinted: float = tuned(0.03, "face widths", "picture.truth")
    # standard deviation of the weights of what lies beside
    beside: float = tuned(0.04, "face widths", "picture.truth")
    # logs, of which none and all is taken for a brow
    darkness: tuple[float, float] = tuned((0.08, 0.2), "log", "picture.truth")
    # the same for what is brighter around eyes and lips
    gleam: tuple[float, float] = tuned((0.12, 0.3), "log", "picture.truth")


@dataclass(frozen=True)
class BrowHairLimits:
    """Lengths in face widths."""

    # from the brows, between which their skin lies
    beside: tuple[float, float] = tuned((0.03, 0.06), "face widths", "picture.truth")
    # quantile of the brows' brightness that is mostly hair
    darkest: float = tuned(0.05, "quantile", "picture.truth")
    hair: float = tuned(0.55, "ratio", "picture.truth")  # brightness of hair alone, of that quantile
    strength: float = tuned(0.8, "share", "picture.truth")
    min_factor: float = tuned(0.2, "ratio", "picture.truth")


LIMITS, FEATURES, HAIR = LearnedLightLimits(), LightOfFeaturesLimits(), BrowHairLimits()
# of the weight of a mean
FLOOR = derived(1e-4, "share", "far less than a texel's weight, and no division by zero")
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
    """The light by a network, smooth in time.

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
        self._texels = texels
        self._kinds = [np.flatnonzero(kind) for kind in (skin, ~skin)]
        self._sums = [TexelSums(GRID, at[kind]) for kind in self._kinds]
        self._enrolled = [self._means(texture[texels]) for texture in enrolled]
        self._weight = np.float32(mask.sum() / len(texels) / (CELL_FACE_WIDTHS * reference.resolution) ** 2)
        self._at_pixels = CellReader(places(reference))
        self._parts = _Parts(reference)
        person, own = (float((texture[texels[self._kinds[0]]] @ LUMA).mean()) for texture in enrolled)
        self._hair = BrowHair(reference, own / max(person, 1.0))
        self._whites = Whites(reference, enrolled, texels[self._kinds[0]])
        self._of_features = LightOfFeatures(reference, mask, GRID, places(reference), CELL_FACE_WIDTHS)
        self._session = session()

    def measure(self, face: FaceInFrame, memory: Memory) -> None:
        """Move towards the light that takes the face's colours to what the frame shows."""
        if not face.seen:
            return
        kept, clock = memory.light, memory.clock
        if clock.is_due(kept.checked + LIMITS.check_seconds):
            kept.checked = clock.now
            self._check(kept, clock, face.canvas.texture[self._texels], face.seen)
        if kept.now is None:
            kept.now = kept.aim
        else:
            assert kept.aim is not None
            kept.now = _moved(kept.now, kept.aim, 1.0 - LIMITS.memory.over(clock.step))

    def _check(self, kept: LightMemory, clock: Clock, face: F32, seen: Seen) -> None:
        """Ask the network again if what it sees has changed: the face's RGB (t, 3) and what the frame shows."""
        weights = self._weight if seen.visible is None else seen.visible * self._weight
        sums = self._summed(
            np.concatenate([face, seen.rgb], axis=1), weights + np.zeros(len(face), np.float32)
        )
        is_due = clock.is_due(kept.looked + LIMITS.still_seconds)
        if is_due or _has_changed(sums[0][0], kept.looked_at):
            kept.aim, kept.looked_at, kept.looked = self._looked(kept, sums), sums[0][0], clock.now

    def apply(self, face: FaceInFrame, memory: Memory) -> None:
        """Light the face's texture."""
        light, canvas, colour = memory.light.now, face.canvas, face.frame.colour
        assert light is not None
        to_stored, offset = colour.from_rgb[:, :3], colour.from_rgb[:, 3]
        planes, of_cells = np.ascontiguousarray(canvas.texture.T), self._at_pixels(light.map)
        gains, lit = of_cells[:3], of_cells[3:]
        self._parts.light(gains, lit, light.parts)
        self._hair.tint(planes, gains, lit, light.tint)
        brows = self._hair.under(planes, gains, lit)
        gains *= planes
        gains += lit
        self._hair.adjust(gains, planes, brows, float(light.parts[0] @ LUMA))
        out = to_stored.astype(np.float32) @ gains
        out += offset.astype(np.float32)[:, None]
        canvas.planes = out
        canvas.contrast = _middle(LUMA @ light.map[:3].reshape(3, -1)) * float(np.add.reduce(to_stored[0]))

    def _looked(self, kept: LightMemory, sums: list[F32]) -> FaceLight:
        """What the network finds in sums of skin and of other texels; weights are 1 in all of a cell."""
        found, gains = self._found(kept, [*sums, *self._enrolled])
        tint, in_frame = (part.sum((1, 2)) for part in (sums[0][0, :3], sums[0][0, 3:6]))
        gains = (gains @ LUMA)[:, None] * self._whites.tint(in_frame)
        seen = sums[0][0, 6] + sums[1][0, 6]
        shown = tint / max(float(sums[0][0, 6].sum()), FLOOR)
        return FaceLight(
            _widened(self._of_features.without(found, seen, shown), seen, shown),
            gains,
            tint / max(float(tint @ LUMA), 1.0),
        )

    def _found(self, kept: LightMemory, inputs: list[F32]) -> list[F32]:
        """The map (6, h, w) and the gains (2, 3) that the network gives for its inputs (1, ..., h, w)."""
        found, gains = self._session.run(None, dict(zip(INPUTS, inputs, strict=True)))
        if kept.looks % LIMITS.looks_per_mirrored == 0:
            image = [np.ascontiguousarray(values[..., ::-1]) for values in inputs]
            in_image, its_gains = self._session.run(None, dict(zip(INPUTS, image, strict=True)))
            kept.unlike = [(in_image[..., ::-1] - found) / 2, (its_gains - gains) / 2]
        kept.looks += 1
        return [(values + more)[0] for values, more in zip((found, gains), kept.unlike, strict=True)]

    def _summed(self, colours: F32, weights: F32) -> list[F32]:
        """Sums (1, c + 1, h, w) of skin and of other texels."""
        return [
            s(colours[kind], weights[kind])[None] for kind, s in zip(self._kinds, self._sums, strict=True)
        ]

    def _means(self, colours: F32) -> F32:
        """Means (1, 2, 3, h, w) of skin and of other texels (t, 3), 0 where nothing is."""
        sums = np.stack(self._summed(colours, np.ones(len(colours), np.float32)), axis=1)
        return np.asarray(sums[:, :, :3] / np.maximum(sums[:, :, 3:], FLOOR), np.float32)


class _Parts:
    """Eyes and mouth among the mask's pixels, which are lit each by one gain."""

    def __init__(self, reference: ReferenceFrame) -> None:
        parts = np.array(part_masks(reference))
        self._pixels = np.flatnonzero(parts.max(0) > MIN_SHARE / 2)
        self._shares = parts[:, self._pixels]
        self._surface = 1 - self._shares.max(0)

    def light(self, gains: F32, lit: F32, parts: F32) -> None:
        """Put gains of the parts (2, 3) into those (3, n) and the offsets (3, n) of pixels, in place."""
        gains[:, self._pixels] = gains[:, self._pixels] * self._surface + parts.T @ self._shares
        lit[:, self._pixels] *= self._surface


def _widened(light: F32, seen: F32, skin: F32) -> F32:
    """A map (6, h, w) with a share of its means over a wider neighbourhood, of cells that are seen (h, w).

    skin : (3,) RGB on which lights are compared.
    """
    rows, columns = _wide_kernels()
    wide = (rows @ (light * seen) @ columns.T) / np.maximum(rows @ seen @ columns.T, FLOOR)
    near, far = brightness(light, skin), brightness(np.asarray(wide, np.float32), skin)
    share = LIMITS.wide_share * np.exp(-0.5 * (np.log(near / far) / LIMITS.shadow_edge) ** 2)
    return np.asarray(light + share.astype(np.float32) * (wide - light))


@cache
def _wide_kernels() -> tuple[F32, F32]:
    rows, columns = (gaussian_kernel(n, LIMITS.wide_face_widths / CELL_FACE_WIDTHS) for n in GRID)
    return rows, columns


def _has_changed(skin: F32, before: F32 | None) -> bool:
    """Whether sums (7, h, w) of skin differ from those that the network has looked at."""
    if before is None:
        return True
    now, last = skin[6], before[6]
    if np.add.reduce(np.abs(now - last), None) > LIMITS.max_change * np.add.reduce(last, None):
        return True
    cells = np.minimum(now, last) > LIMITS.min_weight
    means = (np.maximum(s[:6, cells] / s[6, cells], 0) + BLACK_GREY_LEVELS for s in (skin, before))
    logs = np.log(np.divide(*means)).reshape(2, -1)  # of the face, of the frame
    squares = np.maximum.reduce(np.add.reduce(np.square(logs), 1))
    return bool(squares > LIMITS.max_change**2 * logs.shape[1])


def _moved(light: FaceLight, aim: FaceLight, share: float) -> FaceLight:
    """A light on a share of the way to another, but all of the way in what is common to the whole face."""
    change = mean(aim.map[:3], (1, 2)) / np.maximum(mean(light.map[:3], (1, 2)), FLOOR)
    now, parts = light.map * np.concatenate([change, change])[:, None, None], light.parts * change
    return FaceLight(
        now + share * (aim.map - now),
        parts + share * (aim.parts - parts),
        light.tint + share * (aim.tint - light.tint),
    )


def _middle(values: F32) -> float:
    """The median of an odd number of values (n,); NumPy's imports numpy.ma."""
    middle = len(values) // 2
    ordered = values.copy()
    ordered.partition(middle)
    return float(ordered[middle])


@lru_cache(maxsize=1)
def session() -> ShippedNetwork:
    """The network that ships with the package."""
    return ShippedNetwork("light.onnx")


class LightOfFeatures:
    """Where features lie, and where brows rise to, on a grid of cells.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is shown.
    grid : height and width in cells.
    places : (n, 2) of the mask pixels of the reference frame, in cells.
    cell : side of a cell, face widths.
    """

    def __init__(
        self, reference: ReferenceFrame, mask: Bool, grid: tuple[int, int], places: F32, cell: float
    ) -> None:
        brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), FEATURES.growth)
        raised = np.roll(brows, -round(FEATURES.raised * reference.resolution), axis=0)
        bare = np.asarray(skin_mask(reference) & mask, np.float32)
        tinted = soft_parts(reference, (RIGHT_BROW, LEFT_BROW, RIGHT_EYE, LEFT_EYE), FEATURES.tinted)
        around = soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS), FEATURES.around)
        pixels = np.column_stack([plane[reference.mask] for plane in (raised, around, tinted, bare)])
        *sums, every = TexelSums(grid, places)(pixels, np.ones(len(pixels), np.float32))
        self._raised, self._around, self._tinted, self._bare = (
            one / np.maximum(every, FLOOR) for one in sums
        )
        self._reach = np.ones((2 * round(1.5 * FEATURES.beside / cell) + 1,) * 2, np.uint8)
        self._rows, self._columns = (gaussian_kernel(length, FEATURES.beside / cell) for length in grid)

    def without(self, light: F32, seen: F32, skin: F32) -> F32:
        """A map (6, h, w), gain and offset of each cell, without what raised brows, lids and lips add to it.

        seen : (h, w) share of each cell that is seen.   skin : (3,) RGB on which lights are compared.
        """
        beside = self._beside(light, seen * self._bare * (1 - np.maximum(self._raised, self._around)))
        now, then = brightness(light, skin), brightness(beside, skin)
        brightest = cv2.dilate(then, self._reach)  # so that the edge of a shadow stays
        share = np.maximum(
            self._raised * _beyond(np.log(then / now), FEATURES.darkness),
            self._around * _beyond(np.log(now / brightest), FEATURES.gleam),
        )
        light = light + share * (beside - light)
        tints = [colours / brightness_of(colours) for colours in (lit(light, skin), lit(beside, skin))]
        change = (tints[1] / tints[0]) ** self._tinted
        return np.asarray(light * np.concatenate([change, change]), np.float32)

    def _beside(self, light: F32, known: F32) -> F32:
        """(6, h, w) means of a map by weights (h, w) of what is known of it."""
        rows, columns = self._rows, self._columns
        return np.asarray(
            (rows @ (light * known) @ columns.T) / np.maximum(rows @ known @ columns.T, FLOOR), np.float32
        )


def _beyond(values: F32, limits: tuple[float, float]) -> F32:
    """Share in [0, 1] of values that go from the first limit to the last."""
    share: F32 = np.minimum(np.maximum((values - limits[0]) / (limits[1] - limits[0]), 0), 1)
    return share


def lit(light: F32, colour: F32) -> F32:
    """(3, h, w) a colour (3,) in the light of a map (6, h, w), at least 1."""
    return np.asarray(np.maximum(light[:3] * colour[:, None, None] + light[3:], 1), np.float32)


def brightness_of(colours: F32) -> F32:
    """(h, w) of colours (3, h, w)."""
    luma: F32 = (LUMA @ colours.reshape(3, -1)).reshape(colours.shape[1:])
    return luma


def brightness(light: F32, colour: F32) -> F32:
    """(h, w) brightness of a colour (3,) in the light of a map (6, h, w), at least 1."""
    return brightness_of(lit(light, colour))


class BrowHair:
    """The brows of textures (3, n); each has a skin and hair of its own, as faces are seldom lit alike on both sides.

    Parameters
    ----------
    reference : ReferenceFrame.
    tone : brightness of the face's skin over that of the frame's person, as both were enrolled: at most by that factor
        hair gets less or more light than skin.
    """

    def __init__(self, reference: ReferenceFrame, tone: float) -> None:
        self._brows = [_Brow(reference, brow, tone) for brow in (RIGHT_BROW, LEFT_BROW)]
        brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), GROWTH)[reference.mask]
        self._pixels = np.flatnonzero(brows > MIN_SHARE / 2)
        self._tinted = np.float32(LIMITS.brow_tint) * brows[self._pixels]

    def tint(self, texture: F32, gain: F32, offset: F32, skin: F32) -> None:
        """Bring brows nearer to a colour (3,) of skin, in place: the little colour of dark hair is noise."""
        brows = texture[:, self._pixels]
        change = self._tinted * ((LUMA @ brows) * skin[:, None] - brows)
        offset[:, self._pixels] += gain[:, self._pixels] * change

    def under(self, texture: F32, gain: F32, offset: F32) -> list[tuple[float, F32]]:
        """Of each brow: the brightness of the skin beside it, and (b,) in its pixels what that would be under a light.

        gain, offset : (3, n) of the light, of each pixel.
        """
        return [brow.under(texture, gain, offset) for brow in self._brows]

    def adjust(self, lit: F32, texture: F32, under: list[tuple[float, F32]], light: float) -> None:
        """Darken or lighten the brows of a lit texture (3, n) in place.

        texture : (3, n) as it was.   under : see above.   light : change of brightness of what isn't skin.
        """
        for brow, skin in zip(self._brows, under, strict=True):
            brow.adjust(lit, texture, *skin, light)


class _Brow:
    """One of them."""

    def __init__(self, reference: ReferenceFrame, brow: Group, tone: float) -> None:
        self._tone = tone
        core, grown, near, far = (
            soft_parts(reference, (brow,), grow)[reference.mask] for grow in (0.0, GROWTH, *HAIR.beside)
        )
        self._pixels = np.flatnonzero(grown > MIN_SHARE / 2)
        self._share = np.float32(HAIR.strength) * grown[self._pixels]
        self._core = np.flatnonzero(core > 0.5)
        skin = skin_mask(reference)[reference.mask]
        self._beside = np.flatnonzero(skin & (far > 0.5) & (near < 0.5))

    def under(self, texture: F32, gain: F32, offset: F32) -> tuple[float, F32]:
        skin = np.asarray(mean(texture[:, self._beside], 1), np.float32)
        lit = gain[:, self._pixels] * skin[:, None] + offset[:, self._pixels]
        return float(skin @ LUMA), np.asarray(LUMA @ lit)

    def adjust(self, lit: F32, texture: F32, skin: float, lit_skin: F32, light: float) -> None:
        own = LUMA @ texture[:, self._pixels]
        hair = HAIR.hair * quantile(LUMA @ texture[:, self._core], HAIR.darkest)
        of_skin = float(mean(lit_skin)) / max(skin, 1.0)
        other = self._tone * of_skin
        light = max(light, other) if self._tone < 1 else max(min(light, other), of_skin)
        share = np.minimum(np.maximum((skin - own) / max(skin - hair, 1.0), 0), 1)
        aim = lit_skin + share * (np.minimum(hair * light, lit_skin) - lit_skin)
        brow = lit[:, self._pixels]
        factor = np.maximum(aim / np.maximum(LUMA @ brow, 1.0), HAIR.min_factor)
        factor = np.minimum(factor, max(self._tone, 1.0))
        lit[:, self._pixels] = brow * (1 + self._share * (factor - 1)).astype(np.float32)
