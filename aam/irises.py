"""A person's irises and whites, as their neutral face has them.

Where irises are, the parsing tells (`parsing.py`); how large they are and how they look, what sets them off from the
white.  Places in an eye are in its widths, corner to corner, from the middle of its corners, x along them.  RGB 0..255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, NOSE_BASE, NOSE_ROOT, RIGHT_EYE, Group
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.parsing import FaceParser
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, Floating, Int
from guise.common.quantile import quantile
from guise.common.small import mean

EYES = RIGHT_EYE, LEFT_EYE
CORNERS = 0, 3  # of an eye's points


@dataclass(frozen=True)
class IrisLimits:
    """Lengths are eye widths, or radii of the iris where they say so."""

    # At rest: the radius that sets the iris off from what lies beside it, near that of most people.
    radii: tuple[float, float, float] = (0.20, 0.28, 0.01)  # least, most, step
    usual_radius: float = 0.235
    unusual: float = 100.0  # cost of a squared distance from it
    off_place: float = 1.0  # cost of a distance from where the parsing found it
    place_reach: tuple[float, float] = (0.06, 0.02)  # of that distance, and step
    edges: tuple[float, ...] = (0.7, 0.98, 1.02, 1.3)  # radii, of the rings within and beyond its edge
    chroma: float = 2.0  # by which colour counts more than brightness there
    pupil: tuple[float, float, float] = (0.35, 0.5, 0.85)  # radii, of the pupil and of the brighter ring
    max_pupil: float = 0.4  # contrast of them that counts
    # Of a profile: means of rings, as far out, and by how much rings overlap, radii.
    rings: int = 12
    reach: float = 1.5
    overlap: float = 0.06
    min_pixels: int = 3  # of a ring
    lid_shadow: float = -0.6  # radii below the middle, above which nothing counts
    typical: float = 0.4  # quantile: catch-lights are brighter
    turn: tuple[float, float] = (0.85, 2.0)  # limits of a whole eye's width over its own
    iris: tuple[float, float] = (0.4, 0.85)  # radii, of the ring that has its colour: no pupil, no rim
    white_quantile: float = 0.8  # of an eye's brightness, above which it's its white


LIMITS = IrisLimits()


def in_eye(points: Floating, outline: F64, whole: float | None = None) -> F32:
    """Points (n, 2) of a picture in widths of the eye with an outline (6, 2) there, see `eye_axes`."""
    axes = eye_axes(outline, whole)
    places: F32 = (np.asarray(points, np.float32) - axes[0]) @ axes[1:]
    return places


def eye_axes(outline: F64, whole: float | None = None) -> F32:
    """(3, 2) middle of an eye with an outline (6, 2), and the matrix by which rows from there become places in it.

    whole : width in pixels that it would have from the front, by which heights are divided; by default its own.
    """
    first, last = outline[CORNERS[0]], outline[CORNERS[1]]
    (x, y), middle = last - first, (first + last) / 2
    width, (least, most) = max(math.hypot(x, y), 1e-3), LIMITS.turn
    height = width if whole is None else min(max(whole, least * width), most * width)
    axes = np.array([middle, (x / width, -y / height), (y / width, x / height)], np.float32)
    axes[1:] /= np.float32(width)
    return axes


def nose_length(shape: F64) -> float:
    """From the root of the nose of a shape (81, 2) to its base, pixels."""
    return math.dist(shape[NOSE_BASE], shape[NOSE_ROOT])


def width_to_nose(eye: Group, at_rest: F64) -> float:
    """Width of an eye that isn't turned over the length of the nose, both of a shape (81, 2) at rest."""
    first, last = (at_rest[eye[corner]] for corner in CORNERS)
    return math.dist(first, last) / max(nose_length(at_rest), 1e-3)


@dataclass(frozen=True)
class HumanIrises:
    """Colours of people's irises: red and blue over green, least and most, by brightness, shares of the white."""

    brightness: tuple[float, float, float] = (0.1, 0.33, 0.5)
    red: tuple[tuple[float, float, float], ...] = ((1.2, 1.1, 0.85), (1.8, 1.5, 1.2))
    blue: tuple[tuple[float, float, float], ...] = ((0.45, 0.55, 0.7), (0.8, 0.9, 1.2))
    lightest: float = 0.62
    border: float = 0.1  # radii, over which a change fades


HUMAN = HumanIrises()


@dataclass(frozen=True, eq=False)
class Irises:
    """How a person's irises look at rest.

    Attributes
    ----------
    radius : eye widths.
    profile : (rings, 3) RGB from the middle outwards, shares of the white, up to `LIMITS.reach` radii.
    places : (2, 2) of the right and the left one.
    """

    radius: float
    profile: F32
    places: F64

    @classmethod
    def at_rest(cls, reference: ReferenceFrame, shape: F64, texture: F32) -> Irises:
        """Of a face at rest: its shape (81, 2), grid pixels, and RGB (n, 3)."""
        picture = reference.scatter(texture)
        margin = reference.resolution // 3  # the parser sees the face's surroundings
        around = cv2.copyMakeBorder(picture, *(margin,) * 4, cv2.BORDER_REPLICATE)
        rgb = np.asarray(np.clip(around + 0.5, 0, 255), np.uint8)
        found = FaceParser().parse(rgb, reference.points + margin).irises[:, :2] - margin
        eyes = [_EyeAtRest.of(reference, picture, shape, *pair) for pair in zip(EYES, found, strict=True)]
        radii = np.arange(LIMITS.radii[0], LIMITS.radii[1] + LIMITS.radii[2] / 2, LIMITS.radii[2])
        fits = [[eye.fit(radius) for radius in radii] for eye in eyes]
        unusual = LIMITS.unusual * (radii - LIMITS.usual_radius) ** 2
        best = int(np.argmax(np.mean([[score for score, _ in fit] for fit in fits], axis=0) - unusual))
        places = np.array([fit[best][1] for fit in fits])
        profiles = [eye.profile(float(radii[best]), place) for eye, place in zip(eyes, places, strict=True)]
        return cls(float(radii[best]), np.asarray(np.mean(profiles, axis=0), np.float32), places)

    def in_human_range(self) -> Irises:
        """The same in the nearest colour that irises have: dark ones are brown, none is red or purple.

        A clip shows an iris in a few pixels, in which the sky or a lamp is reflected.
        """
        colour = np.maximum(self.colour, 0.02)
        grey = float(colour @ LUMA)
        ends = [float(np.interp(grey, HUMAN.brightness, end)) for end in HUMAN.red + HUMAN.blue]
        red = float(np.clip(colour[0] / colour[1], ends[0], ends[1]))
        blue = float(np.clip(colour[2] / colour[1], ends[2], ends[3]))
        aim = np.array([red, 1.0, blue], np.float32)
        aim *= min(grey, HUMAN.lightest) / float(aim @ LUMA)
        rings = (np.arange(LIMITS.rings) + 0.5) * LIMITS.reach / LIMITS.rings
        within = np.clip((1 + HUMAN.border - rings) / (2 * HUMAN.border), 0, 1)[:, None]
        factor = 1 + within * (aim / colour - 1)
        return replace(self, profile=np.asarray(self.profile * factor, np.float32))

    @property
    def colour(self) -> F32:
        """(3,) RGB of the iris, shares of the white."""
        return np.asarray(self.at(np.linspace(*LIMITS.iris, LIMITS.rings, dtype=np.float32)).mean(1))

    def at(self, away: F32) -> F32:
        """(3, ...) shares of the white at distances from the middle, radii."""
        return at_rings(self.profile.T, away)


def at_rings(profile: F32, away: F32) -> F32:
    """Values of rings (..., rings) at distances (...) from their middle, radii: (..., ...)."""
    rings = LIMITS.rings / LIMITS.reach * away - np.float32(0.5)
    ring = np.minimum(np.maximum(rings, 0), LIMITS.rings - 1.001)
    low, share = ring.astype(np.intp), ring - np.floor(ring)
    shown: F32 = profile[..., low] * (1 - share) + profile[..., low + 1] * share
    return shown


@dataclass(frozen=True, eq=False)
class _EyeAtRest:
    """Pixels (n,) of an eye: RGB as shares of the white, place, and where the parsing found the iris."""

    colours: F32
    places: F32
    found: F32

    @classmethod
    def of(cls, reference: ReferenceFrame, picture: F32, shape: F64, eye: Group, found: F64) -> _EyeAtRest:
        ys, xs = np.nonzero(soft_parts(reference, (eye,), 0.0) > 0.5)
        grid = np.vstack([np.column_stack([xs, ys]), found[None]]).astype(np.float64)
        places = in_eye(MeshSampler.build(reference, grid).positions(shape), shape[eye])
        colours = picture[ys, xs]
        return cls(colours / white(colours), places[:-1], places[-1])

    def fit(self, radius: float) -> tuple[float, F32]:
        """How well the best iris of a radius is set off at its sides, and its place (2,)."""
        reach, step = LIMITS.place_reach
        offsets = np.arange(-reach, reach + step / 2, step, dtype=np.float32)
        moves = np.array([(x, y) for x in offsets for y in offsets])
        from_middle = self.places - (self.found + moves)[:, None]
        away = np.hypot(*np.moveaxis(from_middle, -1, 0)) / radius
        sides = np.abs(from_middle[..., 0]) > np.abs(from_middle[..., 1])
        grey = self.colours @ LUMA
        tint = np.linalg.norm(self.colours - grey[:, None], axis=1)
        unlike = np.minimum(np.abs(1 - grey) + LIMITS.chroma * tint, 1.2)
        inner, outer = (
            ((away > low) & (away < high) & sides).astype(np.float32)
            for low, high in (LIMITS.edges[:2], LIMITS.edges[2:])
        )
        pupil, beside = (
            ((away > low) & (away < high)).astype(np.float32)
            for low, high in ((-1, LIMITS.pupil[0]), LIMITS.pupil[1:])
        )
        within, beyond, dark, bright = (
            ring @ values / np.maximum(ring.sum(1), 1)
            for ring, values in ((inner, unlike), (outer, unlike), (pupil, grey), (beside, grey))
        )
        scores = within - beyond - LIMITS.off_place * np.hypot(*moves.T)
        scores += np.clip(bright - dark, 0, LIMITS.max_pupil)
        scores[np.minimum(inner.sum(1), outer.sum(1)) < LIMITS.min_pixels] = -1
        best = int(np.argmax(scores))
        return float(scores[best]), self.found + moves[best]

    def profile(self, radius: float, place: F64) -> F32:
        """(rings, 3) typical colours of the rings about a place; where a ring isn't seen, that within it."""
        from_middle = (self.places - place) / radius
        away = np.hypot(*from_middle.T)
        away[from_middle[:, 1] < LIMITS.lid_shadow] = np.inf
        edges = np.linspace(0, LIMITS.reach, LIMITS.rings + 1)
        rings: list[F32] = []
        for low, high in zip(edges[:-1] - LIMITS.overlap, edges[1:] + LIMITS.overlap, strict=True):
            ring = self.colours[(away >= low) & (away < high)]
            if len(ring) >= LIMITS.min_pixels:
                rings.append(np.array([quantile(channel, LIMITS.typical) for channel in ring.T], np.float32))
            else:
                rings.append(rings[-1] if rings else np.ones(3, np.float32))
        return np.asarray(rings, np.float32)


def white(colours: F32) -> F32:
    """(3,) RGB of the white among an eye's pixels (n, 3)."""
    grey = colours @ LUMA
    count = max(1, round(len(grey) * (1 - LIMITS.white_quantile)))
    brightest = colours[grey.argpartition(-count)[-count:]]
    found: F32 = np.maximum(mean(brightest, 0), 8)
    return found


class Whites:
    """The colour of the light on what isn't skin: whites of the eyes, and teeth.

    Light that is measured on skin holds two skin tones, and by that of a dark face on a fair one its eyes and teeth
    would be blue.  The white of the eyes is nearly the same in everybody.  So the light's colour on it is that of the
    person's own whites over the face's, both as enrolled, times the change that the frame shows on the person's own
    skin since then.

    Parameters
    ----------
    reference : ReferenceFrame.
    enrolled : neutral RGB (n, 3) of the frame's person and of the face, in the reference frame's mask pixels.
    skin : indices into the mask pixels, where the person's skin is compared.
    """

    def __init__(self, reference: ReferenceFrame, enrolled: tuple[F32, F32], skin: Int) -> None:
        eyes = soft_parts(reference, (RIGHT_EYE, LEFT_EYE), 0.0)[reference.mask] > 0.5
        own, other = (white(texture[eyes]) for texture in enrolled)
        self.brightness = float(own @ LUMA) / float(other @ LUMA)
        self._ratio = own / other / np.maximum(enrolled[0][skin].mean(0), 1)

    def tint(self, skin: F32) -> F32:
        """(3,) gain of the face's whites, 1 in brightness, in a light in which the person's skin has a colour (3,)."""
        tint = self._ratio * np.maximum(skin, np.float32(1e-3))
        return np.asarray(tint / (tint @ LUMA), np.float32)
