"""The forehead of a disguise, which is drawn up to the hair of the person, and beneath it: its skin.

The mesh is stretched from the brows upwards, and a texture with it, until brows are smeared.  So what lies above them
is read from where it would lie without the stretch, and beyond the face's own hairline, and at the temples' rim, skin
is continued as in a mirror.  It is softened, so that nothing is seen twice, and gets the grain of the cheeks instead.
Grid pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROWS,
    FOREHEAD,
    JAW,
    LEFT_NOSTRIL,
    NOSE,
    OUTER_EYE_CORNERS,
    RIGHT_NOSTRIL,
    RIGHT_TEMPLE,
    SILHOUETTE,
)
from guise.aam.light import LUMA
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame
from guise.app.drawing.face import BROW_THICKNESS, FaceInFrame
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, F64, U8
from guise.common.tuned import derived, tuned


@dataclass(frozen=True)
class ForeheadLimits:
    """Face widths."""

    # within the face's own hairline, where its texture isn't only skin
    rim: float = tuned(0.055, "face widths", "deidentify.identity")
    # standard deviation, and the least height of skin
    softening: float = tuned(0.03, "face widths", "deidentify.identity")
    # share by which that is read nearer to the middle, off the ends of brows
    inwards: float = tuned(0.4, "share", "deidentify.identity")
    cheek: float = tuned(0.16, "face widths", "deidentify.identity")  # side of the skin whose grain it gets
    widening: float = tuned(0.4, "share", "deidentify.identity")  # sideways share of what is added


LIMITS = ForeheadLimits()
LOBE = derived(3, "point", "of the jaw's 17 that which lies at the ear's lobe")


@dataclass(frozen=True, eq=False)
class Forehead:
    """How the texture of a face is read whose forehead is drawn farther up.

    Parameters
    ----------
    places : (h, w, 2) where each pixel's texture is read.
    softened : (h, w) share in [0, 1] by which it is softened there: what is mirrored must not be seen twice.
    sigma : pixels, of that.
    added : (h, w) share in [0, 1] by which a pixel is drawn beyond the face's own hairline.
    drawn : (h, w, 2) where each pixel is drawn, so that what is read there is not stretched.
    """

    places: F32
    softened: F32
    sigma: float
    added: F32
    drawn: F32

    @classmethod
    def of(cls, reference: ReferenceFrame, face_widths: float) -> Forehead:
        """For a forehead that is drawn so much farther up, see `outward`."""
        return _forehead(reference.resolution, face_widths)

    @classmethod
    def _made(cls, reference: ReferenceFrame, face_widths: float) -> Forehead:
        height, width = reference.size
        y, x = np.mgrid[:height, :width].astype(np.float64)
        read = np.dstack([x, y]).reshape(-1, 2)
        moved, centre = outward(reference, 0.0, face_widths), reference.points[NOSE].mean(0)
        places = read[reference.pixels]
        stretch = MeshSampler.build(reference, places).positions(moved).astype(np.float64)
        rim = LIMITS.rim * reference.resolution
        added = np.clip(np.linalg.norm(stretch, axis=1) / rim, 0, 1)
        along, away = _polar(places + stretch - centre)
        _, own = _skin(reference, centre, along)
        beyond = np.clip((away - own) / rim + 1, 0, 1)
        share = np.maximum(added, _above_ears(reference, centre, along)) if face_widths else added
        inwards = along * (1 - LIMITS.inwards * added * beyond)
        source = centre + _mirrored(reference, centre, inwards, away - own)
        read[reference.pixels] = np.where(share[:, None] > 0, source, places)
        drawn = np.dstack([x, y])
        drawn[reference.mask] += stretch
        over = away - _at_outline(reference.points, centre, along)
        drawn_over = added * np.clip(over / rim + added - 0.5, 0, 1)
        softened, drawn_over = (
            reference.scatter(plane.astype(np.float32)) for plane in (share * beyond, drawn_over)
        )
        return cls(
            read.reshape(height, width, 2).astype(np.float32), softened, LIMITS.softening * reference.resolution,
            drawn_over, drawn.astype(np.float32),
        )  # fmt: skip

    def continued(self, picture: U8) -> U8:
        """A texture (h, w, 3) with the forehead continued."""
        read = cv2.remap(picture, self.places, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
        soft = cv2.GaussianBlur(read, (0, 0), self.sigma)
        return np.asarray(cv2.blendLinear(soft, read, self.softened, 1 - self.softened), np.uint8)

    def detailed(self, detail: F32) -> F32:
        """Detail (2 h, 2 w) of such a texture; where it is softened there is none."""
        size = detail.shape[::-1]
        places = 2 * cv2.resize(self.places, size) + np.float32(0.5)
        read = cv2.remap(detail, places, None, cv2.INTER_LINEAR)  # type: ignore[call-overload]
        return np.asarray(read * (1 - cv2.resize(self.softened, size)), np.float32)


class Hairline:
    """Draws the forehead of a disguise up to the hair.

    Parameters
    ----------
    reference : ReferenceFrame.
    texture : (n, 3) neutral RGB of the identity.
    forehead : face widths by which it is drawn farther up.
    """

    def __init__(self, reference: ReferenceFrame, texture: F32, forehead: float) -> None:
        self.forehead = Forehead.of(reference, forehead)
        grain = cv2.remap(  # type: ignore[call-overload]
            skin_grain(texture, reference), self.forehead.drawn, None, cv2.INTER_CUBIC, None, cv2.BORDER_WRAP
        )
        self._grain = self.forehead.softened * grain

    def draw(self, face: FaceInFrame, memory: Memory) -> None:
        """Continue the picture's forehead, with the grain of its cheeks."""
        canvas = face.canvas
        picture = self.forehead.continued(canvas.picture)
        luma = cv2.extractChannel(picture, 0)
        luma = cv2.addWeighted(luma, 1.0, self._grain, canvas.contrast, 0.0, dtype=cv2.CV_8U)
        canvas.picture = np.asarray(cv2.insertChannel(luma, picture, 0), np.uint8)


def outward(reference: ReferenceFrame, jaw: float, forehead: float) -> F64:
    """(81, 2) grid pixels: displacements of the outline's points out of the face; 0 for the others.

    jaw, forehead : face widths; the latter grows from zero at the temples to all of it in the middle, and leads up more
        than to the sides, where hair frames a face.
    """
    away = reference.points - reference.points[NOSE].mean(0)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    height = np.sqrt(np.sin(np.linspace(0, np.pi, len(FOREHEAD))).clip(0))
    ways = np.zeros((POINTS, 2))
    ways[JAW] = jaw * away[JAW]
    ways[FOREHEAD] = forehead * height[:, None] * (away[FOREHEAD] * (LIMITS.widening, 0) - (0, 1))
    return reference.resolution * ways


def skin_grain(texture: F32, reference: ReferenceFrame) -> F32:
    """(h, w) fine differences of brightness as on the cheeks of a texture (n, 3), in its grey levels, for any place.

    White noise gets the spectrum of the cheeks: B. Galerne, Y. Gousseau and J.-M. Morel, "Random phase textures: theory
    and synthesis", 2011, as asymptotic discrete spot noise.
    """
    luma = reference.scatter(texture @ LUMA)
    fine = luma - cv2.GaussianBlur(luma, (0, 0), LIMITS.softening * reference.resolution)
    side = round(LIMITS.cheek * reference.resolution)
    window = np.outer(np.hanning(side), np.hanning(side))
    total, noise = np.zeros(reference.size), np.random.default_rng(0)
    for corners in ((RIGHT_NOSTRIL, JAW[2]), (LEFT_NOSTRIL, JAW[-3])):
        x, y = np.round(reference.points[list(corners)].mean(0) - side / 2).astype(int)
        cheek = fine[y : y + side, x : x + side]
        spot = window * (cheek - np.average(cheek, weights=window)) / np.sqrt((window**2).sum())
        spectrum = np.fft.rfft2(spot, reference.size) * np.fft.rfft2(noise.standard_normal(reference.size))
        total += np.fft.irfft2(spectrum, reference.size)
    return np.asarray(total / np.sqrt(2), np.float32)


@lru_cache(maxsize=4)
def _forehead(resolution: int, face_widths: float) -> Forehead:
    return Forehead._made(ReferenceFrame.canonical(resolution), face_widths)


def _polar(away: F64) -> tuple[F64, F64]:
    """Angles (n,) clockwise from straight up, and lengths, of (n, 2)."""
    return np.arctan2(away[:, 0], -away[:, 1]), np.hypot(away[:, 0], away[:, 1])


def _mirrored(reference: ReferenceFrame, centre: F64, along: F64, excess: F64) -> F64:
    """(n, 2) from the centre, in directions (n,), to skin at distances (n,) beyond its upper end, as in a mirror."""
    low, high = _skin(reference, centre, along)
    turn = np.mod(excess, 2 * (high - low))
    away = high - np.where(excess > 0, np.minimum(turn, 2 * (high - low) - turn), -excess)
    return np.asarray(away[:, None] * np.column_stack([np.sin(along), -np.cos(along)]))


def _skin(reference: ReferenceFrame, centre: F64, along: F64) -> tuple[F64, F64]:
    """Distances (n,) from the centre, in directions (n,), between which forehead and temples are skin."""
    at_brow, brow = _polar(reference.points[[*BROWS, *OUTER_EYE_CORNERS]] - centre)
    order = np.argsort(at_brow)
    low = np.interp(along, at_brow[order], brow[order]) + BROW_THICKNESS * reference.resolution
    rim = LIMITS.rim * reference.resolution * _above_ears(reference, centre, along)
    high = _at_outline(reference.points, centre, along) - rim
    return low, np.maximum(high, low + LIMITS.softening * reference.resolution)


def _at_outline(points: F64, centre: F64, along: F64) -> F64:
    """Distances (n,) from the centre, in directions (n,), of the outline of points (81, 2)."""
    at_line, line = _polar(points[SILHOUETTE] - centre)
    order = np.argsort(at_line)
    return np.interp(along, at_line[order], line[order], period=2 * np.pi)


def _above_ears(reference: ReferenceFrame, centre: F64, along: F64) -> F64:
    """(n,) share in [0, 1] of forehead and temples in directions (n,): all above the ears, nothing below them."""
    (first, last), _ = _polar(reference.points[[RIGHT_TEMPLE, JAW[LOBE]]] - centre)
    return np.asarray(np.clip((abs(last) - np.abs(along)) / (abs(last) - abs(first)), 0, 1))


def _shares(beyond: F64) -> F64:
    """(13,) by which the forehead's points are moved, of the farthest."""
    away = np.linalg.norm(beyond[FOREHEAD], axis=1)
    return np.asarray(away / max(float(away.max()), 1e-6))
