"""The identity's irises on the source's own eyeballs.

The source's eyeballs show through the drawn lids, so that the gaze, the light and its reflections are the scene's
(`apertures.py`).  Where the identity's iris is darker, the source's is scaled, channel by channel, by how the two
people's irises at rest differ from their own whites, so that neither light counts; a lighter one is painted over it,
each ring as bright as the same ring of the identity's.  Pixels tell by their colours whether they are iris, but those
of one that is nearly as light as its white: there all within its radius is painted.  Where irises are, the parsing
tells (`aam/parsing.py`).  Places in an eye are in its widths, corner to corner, from the middle of its corners, x along
them.  RGB 0..255.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, NOSE_BASE, NOSE_ROOT, RIGHT_EYE, Group
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.aam.parsing import FaceParser
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32, F64, Floating, Int
from guise.common.quantile import quantile

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
    # In a frame, near where the parsing found the iris: the disc that is least like white against the ring about it, or
    # of a light iris what looks most as at rest.
    many_pixels: int = 500  # of an eye, from which a fourth of them is enough
    ring: float = 1.5  # radii
    steps: tuple[float, ...] = (0.04, 0.02, 0.01)
    turn: tuple[float, float] = (0.85, 2.0)  # limits of a whole eye's width over its own
    first_steps: tuple[int, int] = (2, 1)  # along the eye and across it; one of the others
    moved: tuple[float, float] = (2.0, 0.6)  # cost of a distance, and of a light iris's
    max_difference: float = 1.0  # of a pixel from that at rest, sum over the channels, shares of the white
    memory: float = 0.25  # share of a place kept from frame to frame
    max_step: float = 0.08  # beyond which it is taken as it is found
    # Drawing.
    border: tuple[float, float] = (1.15, 0.85)  # radii, at which nothing and all of a dark iris is changed,
    painted_border: tuple[float, float] = (1.2, 0.96)  # and of a light one
    # How unlike white nothing and all of a pixel is changed, of an iris that becomes darker, and of one that becomes
    # lighter, where what is no iris would shine; and how far its colour may be from those between white and iris.
    unlike: tuple[tuple[float, float], tuple[float, float]] = ((0.0, 0.5), (0.35, 0.85))
    other_colour: tuple[float, float] = (0.15, 0.3)  # at which all and none of a pixel is changed
    iris: tuple[float, float] = (0.4, 0.85)  # radii, of the ring that has its colour: no pupil, no rim
    light: tuple[float, float] = (0.6, 0.66)  # brightness of a light iris: of none below, of all above
    gain: tuple[float, float] = (0.15, 2.5)  # limits of the factors of one that becomes darker
    lightening: float = 2.2  # of an iris at most: more, in the shade of lids, looks blind
    black_share: float = 0.02  # of the white, added before colours are divided
    white_quantile: float = 0.8  # of an eye's brightness, above which it's its white
    catch_light: float = 0.25  # of the white, by which a pixel is brighter than a light iris at least
    shade: tuple[float, float] = (0.55, 1.1)  # limits of the frame's iris over that at rest
    shade_eye_widths: float = 0.04  # standard deviation


LIMITS = IrisLimits()
# (k, 2) steps about the best place so far, finer and finer.
MOVES = [
    step * np.mgrid[-across : across + 1, -down : down + 1].reshape(2, -1).T
    for step, (across, down) in zip(LIMITS.steps, (LIMITS.first_steps, (1, 1), (1, 1)), strict=True)
]


def in_eye(points: Floating, outline: F64, whole: float | None = None) -> F32:
    """Points (..., 2) of a picture in widths of the eye with an outline (6, 2) there.

    whole : width in pixels that it would have from the front, by which heights are divided; by default its own.
    """
    first, last = outline[list(CORNERS)]
    (x, y), middle = last - first, (first + last) / 2
    width = max(float(np.hypot(x, y)), 1e-3)
    least, most = (width * share for share in LIMITS.turn)
    height = width if whole is None else min(max(whole, least), most)
    axes = np.array([[x / width, -y / height], [y / width, x / height]], np.float32) / np.float32(width)
    away = np.asarray(points, np.float32) - middle.astype(np.float32)
    return np.asarray((away.reshape(-1, 2) @ axes).reshape(away.shape), np.float32)


def whole_width(eye: Group, head: F64, at_rest: F64) -> float:
    """Width in pixels of an eye of a head (81, 2) if it weren't turned, by the length of its nose; shape at rest."""
    now, then = (math.dist(shape[NOSE_BASE], shape[NOSE_ROOT]) for shape in (head, at_rest))
    first, last = at_rest[eye][list(CORNERS)]
    return math.dist(first, last) * now / max(then, 1e-3)


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
    def at_rest(cls, person: Identity, parser: FaceParser) -> Irises:
        """Of a person's neutral face."""
        reference, shape = person.reference, person.appearance.neutral_shape
        picture = reference.scatter(person.appearance.neutral_texture)
        margin = reference.resolution // 3  # the parser sees the face's surroundings
        around = cv2.copyMakeBorder(picture, *(margin,) * 4, cv2.BORDER_REPLICATE)
        rgb = np.asarray(np.clip(around + 0.5, 0, 255), np.uint8)
        found = parser.parse(rgb, reference.points + margin).irises[:, :2] - margin
        eyes = [_EyeAtRest.of(reference, picture, shape, *pair) for pair in zip(EYES, found, strict=True)]
        radii = np.arange(LIMITS.radii[0], LIMITS.radii[1] + LIMITS.radii[2] / 2, LIMITS.radii[2])
        fits = [[eye.fit(radius) for radius in radii] for eye in eyes]
        unusual = LIMITS.unusual * (radii - LIMITS.usual_radius) ** 2
        best = int(np.argmax(np.mean([[score for score, _ in fit] for fit in fits], axis=0) - unusual))
        places = np.array([fit[best][1] for fit in fits])
        profiles = [eye.profile(float(radii[best]), place) for eye, place in zip(eyes, places, strict=True)]
        return cls(float(radii[best]), np.asarray(np.mean(profiles, axis=0), np.float32), places)

    @property
    def colour(self) -> F32:
        """(3,) RGB of the iris, shares of the white."""
        return np.asarray(self.at(np.linspace(*LIMITS.iris, LIMITS.rings, dtype=np.float32)).mean(1))

    def at(self, away: F32, profile: F32 | None = None) -> F32:
        """(3, ...) shares of the white at distances from the middle, radii; or of another profile (..., rings)."""
        profile = self.profile.T if profile is None else profile
        rings = LIMITS.rings / LIMITS.reach * away - np.float32(0.5)
        ring = np.clip(rings, 0, LIMITS.rings - 1.001)
        low = ring.astype(np.intp)
        share = (ring - low).astype(np.float32)
        return np.asarray(profile.take(low, -1) * (1 - share) + profile.take(low + 1, -1) * share)


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
    brightest = np.argpartition(grey, -count)[-count:]
    return np.asarray(np.maximum(colours[brightest].mean(0), 8), np.float32)


class Gaze:
    """Where the source's irises are, from frame to frame.

    at_rest : (2, 2) places of the right and the left one.

    Attributes
    ----------
    parsed, places : (2, 2), by the last parsing, and as they are found near by.
    """

    def __init__(self, at_rest: F64) -> None:
        self._at_rest = at_rest
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self.parsed, self.places = self._at_rest.copy(), self._at_rest.copy()

    def see(self, irises: F64, head: F64, at_rest: F64) -> None:
        """Follow irises (2, 2), pixels, that the parsing of a frame finds in a head (81, 2); its shape at rest."""
        for place, iris, eye in zip(self.parsed, irises, EYES, strict=True):
            place[:] = _steadied(place, in_eye(iris, head[eye], whole_width(eye, head, at_rest)))

    def settle(self, eye: int, place: F64) -> F32:
        """Follow an iris that is found in a frame; returns its place (2,)."""
        self.places[eye] = _steadied(self.places[eye], place)
        return np.asarray(self.places[eye], np.float32)


def _steadied(last: F64, found: Floating) -> F64:
    step = last - found
    return np.asarray(found + (LIMITS.memory if np.hypot(*step) < LIMITS.max_step else 0) * step)


@dataclass(frozen=True, eq=False)
class IrisChange:
    """What both eyes share: the two people's irises, the source's shape (81, 2) at rest, and its gaze."""

    source: Irises
    target: Irises
    at_rest: F64
    gaze: Gaze

    @classmethod
    def of(cls, source: Identity, target: Identity) -> IrisChange:
        """From one person's irises to another's; both share a reference frame."""
        parser = FaceParser()
        own, other = (Irises.at_rest(person, parser) for person in (source, target))
        return cls(own, other, source.appearance.neutral_shape, Gaze(own.places))

    @property
    def lightens(self) -> bool:
        """Whether the target's iris is the lighter one."""
        return bool(self.target.colour @ LUMA > self.source.colour @ LUMA)

    @property
    def lightness(self) -> float:
        """Share in [0, 1] by which the source's iris is too light to be told from its white pixel by pixel."""
        return float(np.interp(self.source.colour @ LUMA, LIMITS.light, (0, 1)))


class IrisTint:
    """Gives one eye of the source the identity's iris, frame by frame.

    Parameters
    ----------
    lids : (h, w) share in [0, 1] by which pixels are within the lids.
    change : shared by both eyes.
    eye : 0 for the right one, 1 for the left one.
    """

    def __init__(self, lids: F32, change: IrisChange, eye: int) -> None:
        self._lids, inside = lids.ravel(), lids > 0.5
        thinned = np.zeros_like(inside)
        thinned[::2, ::2] = True
        looked_at = inside & (thinned | (inside.sum() < LIMITS.many_pixels))
        self._inside, self._looked_at = np.flatnonzero(inside), np.flatnonzero(looked_at)
        self._change, self._eye = change, eye
        self._lightens, self._lightness = change.lightens, np.float32(change.lightness)
        self._blur = max(LIMITS.shade_eye_widths * inside.any(0).sum(), 0.5)
        own, other = (irises.colour + LIMITS.black_share for irises in (change.source, change.target))
        self._gain = np.clip(other / own, *LIMITS.gain).astype(np.float32)
        self._dimmed = np.float32(min(1.0, LIMITS.lightening * float(own @ LUMA) / float(other @ LUMA)))
        self._contrast = 1 - own
        self._direction = self._contrast / max(float(self._contrast @ self._contrast), 1e-3)

    def apply(self, picture: F32, places: F32, seen: F32 | None = None) -> F32:
        """An eye (h, w, 3) with places (h, w, 2) and the other's iris, by shares (h, w) of eye that is seen there."""
        if not len(self._inside) or (seen is not None and not seen.any()):
            return picture
        shown = self._lids if seen is None else self._lids * seen.ravel()
        pixels = picture.reshape(-1, 3)
        bright = white(pixels.take(self._inside, 0))
        colours = (pixels.take(self._looked_at, 0) / bright).T
        if self._lightness < 0.5:
            colours = self._direction @ (1 - colours)
        found = self._found(colours, places.reshape(-1, 2).take(self._looked_at, 0))
        x, y = np.moveaxis(places - self._change.gaze.settle(self._eye, found), -1, 0)
        away = np.sqrt(x * x + y * y) / np.float32(self._change.source.radius)
        near = np.flatnonzero(away < max(LIMITS.border[0], LIMITS.painted_border[0]))
        before, there, light = np.ascontiguousarray(pixels.take(near, 0).T), away.take(near), self._lightness
        painted = (
            self._painted(picture, bright, away, near, before) if self._lightens or light > 0 else before
        )
        change = np.zeros_like(before)
        if light < 1:
            other = painted - before if self._lightens else (self._gain[:, None] - 1) * before
            share = self._share(before / bright[:, None]) * _within(there, LIMITS.border)
            change += (1 - light) * share * other
        if light > 0:
            change += light * _within(there, LIMITS.painted_border) * (painted - before)
        changed = pixels.copy()
        changed[near] = (before + change * shown.take(near)).T
        return changed.reshape(picture.shape)

    def _found(self, seen: F32, places: F32) -> F64:
        """(2,) where the iris is most likely, by pixels at places (n, 2).

        seen : (n,) how unlike white they are; of a light iris (3, n) their colours, shares of the white.
        """
        light = seen.ndim == 2
        start = self._change.gaze.parsed[self._eye]
        best, (x, y) = start, places.T
        for moves in MOVES:
            middles = (best + moves).astype(np.float32)
            dx, dy = x - middles[:, :1], y - middles[:, 1:]
            away = np.sqrt(dx * dx + dy * dy) / np.float32(self._change.source.radius)
            scores = -self._differences(seen, away) if light else _set_off(seen, away)
            scores -= LIMITS.moved[light] * np.hypot(*(middles - start).T)
            best = best + moves[int(np.argmax(scores))]
        return np.asarray(best)

    def _differences(self, seen: F32, away: F32) -> F32:
        """(k,) mean difference of colours (3, n) from the iris at rest, at distances (k, n) from its middle, radii."""
        near = away < LIMITS.ring
        off = seen[:, None] - self._change.source.at(away)
        unlike = np.minimum(np.abs(off).sum(0), LIMITS.max_difference)
        return np.asarray((unlike * near).sum(1) / np.maximum(near.sum(1), 1))

    def _share(self, shares: F32) -> F32:
        """(n,) share in [0, 1] by which pixels (3, n), shares of the white, have the colours of the source's iris."""
        unlike_white = self._direction @ (1 - shares)
        off = 1 - shares - unlike_white * self._contrast[:, None]
        none, every = LIMITS.unlike[self._lightens]
        share = _within(np.sqrt(np.square(off).sum(0)), LIMITS.other_colour[::-1])
        return np.asarray(share * np.clip((unlike_white - none) / np.float32(every - none), 0, 1))

    def _painted(self, picture: F32, bright: F32, away: F32, near: Int, pixels: F32) -> F32:
        """Pixels (3, n) at indices `near` with the other's iris painted ring by ring; shading and catch-lights stay."""
        source, there, white = self._change.source, away.take(near), bright[:, None]
        own, other = source.at(there), self._dimmed * self._change.target.at(there)
        usual = own * white
        inner = np.clip((1 - there) / np.float32(1 - LIMITS.edges[0]), 0, 1)
        brighter = pixels - usual
        gleams = np.clip((LUMA @ brighter / (LIMITS.catch_light * (bright @ LUMA)) - 1) * 2, 0, 1)
        catch_light = np.maximum(brighter, 0) * (gleams * inner)
        matt = pixels - catch_light
        above, below = (
            picture @ LUMA,
            source.at(away, np.asarray(LUMA @ (source.profile * bright).T, np.float32)),
        )
        above.ravel()[near] = LUMA @ matt
        seen, at_rest = (cv2.GaussianBlur(p, (0, 0), self._blur).take(near) for p in (above, below))
        shade = np.clip(seen / np.maximum(at_rest, 4), *LIMITS.shade)
        structure = matt - usual * shade
        structure *= np.minimum(1, other / np.maximum(own, LIMITS.black_share))
        return np.asarray(other * white * shade + catch_light + structure, np.float32)


def _within(away: F32, border: tuple[float, float]) -> F32:
    """1 inside a border, at distances (h, w), 0 outside."""
    outer, inner = border
    return np.asarray(np.clip((outer - away) / np.float32(outer - inner), 0, 1))


def _set_off(unlike_white: F32, away: F32) -> F32:
    """(k,) how much less white pixels (n,) are on discs than beside them, by distances (k, n) from their middles."""
    disc, ring = away < 1, (away >= 1) & (away < LIMITS.ring)
    within, beside = (some @ unlike_white / np.maximum(some.sum(1), 1) for some in (disc, ring))
    return np.asarray(within - beside)
