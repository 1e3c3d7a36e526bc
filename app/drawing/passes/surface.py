"""What makes a drawn face look filmed by the same camera as the picture around it: its sharpness and its grain.

A donor filmed sharper than the picture, or in harder light, looks cut out and pasted on; a small or blurred one looks
painted.  So the gradients of the frame's skin before drawing are compared with those of the same pixels after it, and
the fine contrast of the texture is scaled until both are alike, within limits: a texture holds no more detail than its
donor's clip, and wrinkles are the donor's own.

What a donor's clip does not hold cannot be sharpened out of it: a raised contrast of more than the finest band ends
in blotches.  So only that is raised, in brows, lids and lips most to be seen, and where it is not enough the finest
band of the frame's brightness is laid into the texture, on skin alone: pores and grain.  Folds, moles and edges, by
which a person is known, stand out from it and stay out.

A mean of frames has less noise than a frame, and a drawn face without the noise around it looks pasted on.  So the
noise of the frame's skin before drawing is compared with that of the same pixels after it, and what is missing is added
to the texture of the frames that follow.

A face that shows nothing of the person's skin is compared by its pores alone, as the gradients of skin are those of
folds and gleams, which it has not: raised until they are alike, pores would be a net.

Pixels, x right, y down; grey levels 0..255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, NOSE_WINGS, RIGHT_BROW
from guise.aam.mask import FEATURE_PARTS, skin_mask, soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import Relief
from guise.app.drawing.face import BROW_REACH, FEATHER, GROWTH, FaceInFrame
from guise.app.drawing.memory import SLACK, Memory, SurfaceMemory
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.decay import FRAME_SECONDS
from guise.common.kernels import kernel
from guise.common.quantile import quantile
from guise.common.small import mean
from guise.common.tuned import derived, tuned


@dataclass(frozen=True)
class SharpnessLimits:
    """What is measured, how often, and how far contrast is scaled."""

    # standard deviation, beyond which a difference is light, not detail
    band_face_widths: float = tuned(0.04, "face widths", "picture.truth")
    # of a lowering, by which eyes, brows and lips follow
    feature_share: float = tuned(0.4, "share", "picture.identity")
    # standard deviation, within which all is noise
    smoothing_pixels: float = tuned(0.8, "pixels", "picture.identity")
    places: int = tuned(800, "places", "speed")  # on skin, half of them for grain
    # share of the places that must lie in the picture
    min_inside: float = tuned(0.5, "share", "picture.identity")
    # gradient energy of a place, of the mean, above which it's an edge
    max_excess: float = tuned(4.0, "ratio", "picture.identity")
    # of gradients, grey levels squared, below which both are smooth
    min_energy: float = tuned(4.0, "squared grey levels", "picture.identity")
    # by which the frame may be sharper; above that its own structure is shown
    slack_octaves: tuple[float, float] = tuned((-0.1, 0.3), "octaves of gradient energy", "picture.identity")
    rate: float = tuned(0.35, "share", "picture.identity")  # of a difference made up for at each measurement
    # of a face, in which every frame is measured and made up for twice as fast
    first_seconds: float = tuned(12 * FRAME_SECONDS, "seconds", "picture.identity")
    every_seconds: float = tuned(4 * FRAME_SECONDS, "seconds", "speed")  # between later measurements
    gain: tuple[float, float] = tuned((0.35, 1.6), "ratio", "picture.identity")  # least and most
    unseen_gain: float = tuned(0.03, "ratio", "speed")  # from 1, within which nothing is done


@dataclass(frozen=True)
class GrainLimits:
    """What is measured, how often, and how much is added."""

    patch_pixels: int = tuned(9, "pixels", "picture.truth")  # sides of the squares whose energy is measured
    # of the squares' energies: skin without features
    smooth_quantile: float = tuned(0.3, "quantile", "picture.truth")
    # of the variance added to a texture that the picture shows in the finest band
    shown_share: float = tuned(0.3, "share", "picture.truth")
    # below which rounding would swallow it
    min_grey_levels: float = derived(
        0.3, "grey levels", "the standard deviation of rounding to whole levels is 0.29"
    )
    # by which the pattern is shifted at random from frame to frame
    tile_slack_pixels: int = tuned(64, "pixels", "picture.truth")
    # frames after which the shifts repeat
    shifts: int = tuned(64, "frames", "speed")


@dataclass(frozen=True)
class OwnSkinLimits:
    """What is taken from the frame."""

    # standard deviation, below which structure is fine
    band_face_widths: float = tuned(0.012, "face widths", "picture.identity")
    # standard deviation, of which structure is a fold or an edge and stays out
    fold_grey_levels: float = tuned(3.0, "grey levels", "picture.identity")
    # around eyes, brows, lips and nostrils of either face
    feature_growth_face_widths: float = tuned(0.035, "face widths", "picture.identity")
    cell_grid_pixels: int = tuned(4, "grid pixels", "speed")  # between which places are interpolated


@dataclass(frozen=True)
class PoreLimits:
    """What is compared of a face that shows nothing of the person's skin."""

    # standard deviation, beyond which a difference is form
    band_face_widths: float = tuned(0.02, "face widths", "deidentify.identity")
    quantile: float = tuned(
        0.4, "quantile", "deidentify.identity"
    )  # of the places' energies: skin without features
    least_energy: float = derived(0.02, "squared grey levels", "a quarter of what rounding to levels leaves")
    gain: tuple[float, float] = tuned((0.1, 1.0), "ratio", "deidentify.identity")  # least and most


LIMITS, GRAIN, OWN, PORES = SharpnessLimits(), GrainLimits(), OwnSkinLimits(), PoreLimits()


class Finish:
    """Measures sharpness and grain of frames and gives them to pictures; the same frames always get the same grain.

    Parameters
    ----------
    reference : ReferenceFrame.
    mask : (h, w) bool, where the face is drawn.
    """

    _gains = LIMITS.gain

    def __init__(self, reference: ReferenceFrame, mask: Bool) -> None:
        rng = np.random.default_rng(0)
        order = rng.permutation(np.flatnonzero((skin_mask(reference) & mask)[reference.mask]))
        self._at_edges, self._at_grain = (
            reference.sampler[np.sort(order[:n])] for n in (LIMITS.places, LIMITS.places // 2)
        )
        height, width = (2 * side + GRAIN.tile_slack_pixels for side in reference.size)
        self._tile = rng.standard_normal((height, width), np.float32)
        self._lowered = 1 - np.float32(1 - LIMITS.feature_share) * soft_parts(reference, FEATURE_PARTS, 0.0)
        self._wide, self._fine = (
            _box(width * reference.resolution) for width in (LIMITS.band_face_widths, OWN.band_face_widths)
        )

    def sharpen(self, face: FaceInFrame, memory: Memory) -> None:
        """Scale the picture's fine contrast."""
        gain, canvas = memory.surface.gain, face.canvas
        picture = canvas.picture
        if gain >= 1 + LIMITS.unseen_gain:
            sharp = cv2.addWeighted(picture, gain, _blurred(picture, self._fine), 1 - gain, 0.0)
            canvas.picture = np.asarray(sharp, np.uint8)
        elif gain <= 1 - LIMITS.unseen_gain:
            share = np.float32(1 - gain) * self._lowered
            smooth = _blurred(picture, self._wide)
            canvas.picture = np.asarray(cv2.blendLinear(picture, smooth, 1 - share, share), np.uint8)
        canvas.contrast *= gain

    def add_grain(self, face: FaceInFrame, memory: Memory) -> None:
        """Put the grain of this frame on the picture, brightness first."""
        deviation = float(np.sqrt(memory.surface.variance))
        if deviation < GRAIN.min_grey_levels:
            return
        picture = face.canvas.picture
        x, y = _shifts()[face.frame.index % GRAIN.shifts]
        h, w = picture.shape[:2]
        luma = cv2.extractChannel(picture, 0)
        tile = self._tile[y : y + h, x : x + w]
        cv2.addWeighted(luma, 1.0, tile, deviation, 0.0, dst=luma, dtype=cv2.CV_8U)
        cv2.insertChannel(luma, picture, 0)

    def look(self, face: FaceInFrame, memory: Memory) -> None:
        """Measure the frame before the face is drawn, if that is due."""
        kept, now = memory.surface, memory.clock.now
        kept.edges = kept.grain = None
        if not face.seen:
            return
        if kept.began is None:
            kept.began = now
        is_early = now < kept.began + LIMITS.first_seconds - SLACK
        edges_due = is_early or memory.clock.is_due(kept.sharpness_seen + LIMITS.every_seconds)
        grain_due = memory.clock.is_due(kept.grain_seen + LIMITS.every_seconds)
        if edges_due:
            kept.edges = self._edges(face)
        if grain_due:
            kept.grain = self._grain(face)

    def compare(self, face: FaceInFrame, memory: Memory) -> None:
        """Compare what was measured with the same after drawing."""
        kept, now = memory.surface, memory.clock.now
        if kept.grain is not None:
            kept.grain_seen = now
            if kept.grain.size:
                pair = kept.grain, self._grain(face)
                there, own = (quantile(energies, GRAIN.smooth_quantile) for energies in pair)
                missing = (there - own) / GRAIN.shown_share
                kept.variance = max(kept.variance + LIMITS.rate * missing, 0.0)
        if kept.edges is not None:
            kept.sharpness_seen = now
            if kept.edges.size:
                there, own = (self._typical(energies) for energies in (kept.edges, self._edges(face)))
                _adjust(kept, float(np.log2(there / own)), now, self._gains)

    def _grain(self, face: FaceInFrame) -> F32:
        """(n,) grain at the places on skin that lie in the frame, none if they are too few."""
        places = self._at_grain.positions(face.mesh - face.canvas.corner)
        energies, box = np.empty(len(places), np.float32), GRAIN.patch_pixels
        return _enough(energies, grain_at(face.canvas.roi, places, LIMITS.smoothing_pixels, box, energies))

    def _edges(self, face: FaceInFrame) -> F32:
        """(n,) energies by which faces are compared, likewise."""
        places = self._at_edges.positions(face.mesh - face.canvas.corner)
        energies = np.empty(len(places), np.float32)
        return _enough(energies, self._measured(face, places, energies))

    def _measured(self, face: FaceInFrame, places: F32, energies: F32) -> int:
        return gradient_at(face.canvas.roi, places, LIMITS.smoothing_pixels, energies)

    def _typical(self, energies: F32) -> float:
        """Of energies (n,): the mean, to which single edges add little."""
        most = LIMITS.max_excess * mean(energies)
        return float(mean(np.minimum(energies, most))) + LIMITS.min_energy / 64


@cache
def _shifts() -> list[list[int]]:
    """By how many pixels x, y the pattern is shifted in each frame: making a generator takes as long as the grain."""
    slack = GRAIN.tile_slack_pixels
    return [np.random.default_rng(number).integers(0, slack, 2).tolist() for number in range(GRAIN.shifts)]


class PoreFinish(Finish):
    """The same for a face whose pores are never stronger than the frame's; folds, features and forms stay."""

    _gains = PORES.gain

    def __init__(self, reference: ReferenceFrame, mask: Bool) -> None:
        super().__init__(reference, mask)
        self._width = PORES.band_face_widths * reference.resolution
        self._skin = 1 - soft_parts(reference, FEATURE_PARTS, GROWTH)

    def sharpen(self, face: FaceInFrame, memory: Memory) -> None:
        """Weaken the picture's pores."""
        gain, canvas = memory.surface.gain, face.canvas
        if gain <= 1 - LIMITS.unseen_gain:
            share = np.float32(1 - gain) * self._skin
            smooth = _blurred(canvas.picture, _box(self._width))
            canvas.picture = np.asarray(cv2.blendLinear(canvas.picture, smooth, 1 - share, share), np.uint8)
        canvas.contrast *= gain

    def _measured(self, face: FaceInFrame, places: F32, energies: F32) -> int:
        luma = cv2.extractChannel(face.canvas.roi, 0).astype(np.float32)
        box, side = _box(self._width * face.zoom), (GRAIN.patch_pixels, GRAIN.patch_pixels)
        band = cv2.GaussianBlur(luma, (0, 0), LIMITS.smoothing_pixels) - cv2.blur(cv2.blur(luma, box), box)
        return _read(np.asarray(cv2.blur(band * band, side), np.float32), places, energies)

    def _typical(self, energies: F32) -> float:
        return quantile(energies, PORES.quantile) + PORES.least_energy


def _adjust(kept: SurfaceMemory, octaves: float, now: float, gains: tuple[float, float]) -> None:
    """Make up for a difference of gradient energy: all of it as a face begins, then less and less at once."""
    beyond = octaves - _within(octaves, *LIMITS.slack_octaves)
    early = now < (kept.began or 0.0) + LIMITS.first_seconds - SLACK
    rate = 1.0 if now == kept.began else LIMITS.rate * (2 if early else 1)
    kept.own_share = _within(kept.own_share + rate * (octaves - LIMITS.slack_octaves[1]), 0.0, 1.0)
    kept.gain = _within(kept.gain * 2 ** (rate * beyond / 2), *gains)


def _box(sigma: float) -> tuple[int, int]:
    """Sides of a box of which two means are nearly a Gaussian."""
    side = round(np.sqrt(6 * sigma**2 + 1)) | 1
    return side, side


def _blurred(picture: U8, box: tuple[int, int]) -> U8:
    """A picture (h, w, 3) whose pixels are means of means over boxes."""
    return np.asarray(cv2.blur(cv2.blur(picture, box), box), np.uint8)


def _within(value: float, least: float, most: float) -> float:
    return min(max(value, least), most)


def _enough(energies: F32, inside: int) -> F32:
    """Those (n,) at the places that lie inside, none if these are few of them all."""
    return energies[: inside if inside >= LIMITS.min_inside * len(energies) else 0]


def _read(plane: F32, places: F32, energies: F32) -> int:
    """Put what a plane (h, w) holds at those of the places (n, 2) that lie in it into energies (n,): how many."""
    (h, w), (x, y) = plane.shape, np.rint(places).astype(int).T
    inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
    found = plane[y[inside], x[inside]]
    energies[: len(found)] = found
    return len(found)


@kernel
def gradient_at(picture: U8, places: F32, sigma: float, energies: F32) -> int:
    """`gradient_energy` of a picture (h, w, 3) at the places (n, 2) within it, into energies (n,): how many.

    sigma : standard deviation within which all is noise, pixels.
    """
    return _read(gradient_energy(picture, sigma), places, energies)


@kernel
def grain_at(picture: U8, places: F32, sigma: float, box: int, energies: F32) -> int:
    """`grain_energy` of a picture (h, w, 3) at the places (n, 2) within it, into energies (n,): how many.

    sigma : standard deviation, below which a band is the finest, pixels.   box : side of the squares, pixels.
    """
    return _read(grain_energy(picture, sigma, box), places, energies)


class OwnSkin:
    """Lays the fine structure of a frame's skin into textures.

    Parameters
    ----------
    relief : of the face that is drawn.
    """

    def __init__(self, relief: Relief) -> None:
        reference = relief.reference
        self._width = reference.resolution
        features = (*FEATURE_PARTS, NOSE_WINGS)
        skin = cv2.GaussianBlur(skin_mask(reference).astype(np.float32), (0, 0), FEATHER * self._width)
        self._share = skin * (1 - soft_parts(reference, features, OWN.feature_growth_face_widths))
        self._share *= 1 - soft_parts(reference, (RIGHT_BROW, LEFT_BROW), BROW_REACH)
        h, w = reference.size
        self._share = np.ascontiguousarray(self._share, np.float32)
        self._fine_share = np.asarray(cv2.resize(self._share, (2 * w, 2 * h)), np.float32)
        self._cells = -(-h // OWN.cell_grid_pixels), -(-w // OWN.cell_grid_pixels)
        axes = ((np.arange(n) + 0.5) * side / n - 0.5 for n, side in zip(self._cells, (h, w), strict=True))
        ys, xs = np.meshgrid(*axes, indexing="ij")
        self._sampler = MeshSampler.build(relief.mesh, np.column_stack([xs.ravel(), ys.ravel()]))

    def add(self, face: FaceInFrame, memory: Memory) -> None:
        """Lay a share of what the frame shows into the picture, if its own sharpness is not enough."""
        if memory.surface.own_share > 0:
            canvas = face.canvas
            mesh = canvas.mesh - canvas.corner
            self.lay(canvas.picture, canvas.roi, mesh, face.zoom, memory.surface.own_share)

    def lay(self, picture: U8, roi: U8, mesh: F64, zoom: float, share: float) -> None:
        """Lay a share of what a rectangle (h, w, 3) shows into a texture (h, w, 3), in place; brightness comes first.

        mesh : (81 + k, 2), where the texture is drawn, in the rectangle's pixels.   zoom : of these per grid pixel.
        """
        sigma = max(OWN.band_face_widths * self._width * zoom, 0.5)
        cells = self._sampler.positions(mesh).reshape(*self._cells, 2)
        shares = self._share if len(picture) == len(self._share) else self._fine_share
        lay_skin(roi, cells, shares, sigma, OWN.fold_grey_levels, share, picture)


@kernel
def lay_skin(roi: U8, cells: F32, share: F32, sigma: float, fold: float, amount: float, picture: U8) -> None:
    """Add the fine structure of a rectangle (y, x, 3) to a texture (h, w, 3), in place; brightness comes first.

    cells : (i, j, 2) places in the rectangle, stretched over the texture.
    share, amount : (h, w) by how much of it is added, and how much of that.
    sigma : standard deviation, below which structure is fine, pixels.   fold : that of a fold, grey levels.
    """
    (h, w), side = roi.shape[:2], _blocks(2 * sigma)
    luma = cv2.extractChannel(roi, 0).astype(np.float32)
    luma = np.asarray(
        cv2.copyMakeBorder(luma, 0, -h % side, 0, -w % side, cv2.BORDER_REFLECT_101), np.float32
    )
    band = luma - _stretched(_wide(luma, sigma), luma.shape)
    folds = np.exp(_wide(band * band, 2 * sigma) * np.float32(-0.5 / fold**2))
    band = (band * _stretched(folds, luma.shape))[:h, :w]
    places = cv2.resize(cells, picture.shape[1::-1])
    band = cv2.remap(band, places, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    texture = cv2.add(cv2.extractChannel(picture, 0), np.float32(amount) * share * band, dtype=cv2.CV_8U)
    cv2.insertChannel(texture, picture, 0)


def _blocks(sigma: float) -> int:
    """Side of blocks, a power of two, whose means tell as much as pixels of what a Gaussian leaves."""
    return 1 << min(max(math.floor(math.log2(sigma / 1.33)), 0), 6)


def _wide(plane: F32, sigma: float) -> F32:
    """A plane (h, w) blurred by a Gaussian, which is smaller if that is wide; stretching it is counted in."""
    side, (h, w) = _blocks(sigma), plane.shape
    small = cv2.resize(plane, (w // side, h // side), interpolation=cv2.INTER_AREA)
    left = math.sqrt(sigma**2 - (side**2 - 1) / 3) / side
    return np.asarray(cv2.GaussianBlur(small, (0, 0), left), np.float32)


def _stretched(plane: F32, size: tuple[int, ...]) -> F32:
    """A plane at a size (h, w) that is a power of two times its own, by doubling it."""
    while plane.shape != size:
        plane = np.asarray(cv2.resize(plane, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR), np.float32)
    return plane


def gradient_energy(picture: U8, sigma: float = LIMITS.smoothing_pixels) -> F32:
    """(h, w) squared gradient of a picture (h, w, 3), brightness first, grey levels per pixel squared."""
    luma = np.rint(cv2.GaussianBlur(cv2.extractChannel(picture, 0).astype(np.float32), (0, 0), sigma))
    along, down = (cv2.Sobel(luma, cv2.CV_32F, *axes) for axes in ((1, 0), (0, 1)))
    return np.asarray((along * along + down * down) / 64, np.float32)


def grain_energy(picture: U8, sigma: float = LIMITS.smoothing_pixels, box: int = GRAIN.patch_pixels) -> F32:
    """(h, w) mean square of the finest band around each pixel of a picture (h, w, 3), brightness first."""
    luma = cv2.extractChannel(picture, 0).astype(np.float32)
    luma -= cv2.GaussianBlur(luma, (0, 0), sigma)
    return np.asarray(cv2.boxFilter(luma * luma, -1, (box, box)), np.float32)
