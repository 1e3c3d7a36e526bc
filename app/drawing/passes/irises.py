"""The identity's irises on the source's own eyeballs.

The source's eyeballs show through the drawn lids, so that the gaze, the light and its reflections are the scene's
(`eyes.py`).  Where the identity's iris is darker, the source's is scaled, channel by channel, by how the two people's
irises at rest differ from their own whites, so that neither light counts; a lighter one is painted over it, each ring
as bright as the same ring of the identity's.  Pixels tell by their colours whether they are iris, but those of one that
is nearly as light as its white: there all within its radius is painted.  Where irises are, the parsing tells
(`aam/parsing.py`).  What is as bright as a reflection on glasses is no eye and stays.  Places in an eye are in its
widths, corner to corner, from the middle of its corners, x along them.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from guise.aam.irises import EYES, Irises, at_rings, in_eye, nose_length, white, width_to_nose
from guise.aam.irises import LIMITS as IRISES
from guise.aam.light import LUMA
from guise.aam.parsing import FaceClass, Parsing
from guise.app.drawing.face import IRIS_BORDER, FaceInFrame, ramp
from guise.app.drawing.memory import GazeMemory, Memory
from guise.app.media import ColourMatrix
from guise.common import small
from guise.common.arrays import F32, F64, Bool, Floating, Int
from guise.common.decay import Decay
from guise.common.kernels import kernel
from guise.common.sampling import remap_points
from guise.common.tuned import tuned


@dataclass(frozen=True)
class TintLimits:
    """Lengths are eye widths, or radii of the iris where they say so."""

    # In a frame, near where the parsing found the iris: the disc that is least like white against the ring about it, or
    # of a light iris what looks most as at rest.
    many_pixels: int = tuned(500, "pixels", "speed")  # of an eye, from which a fourth of them is enough
    ring: float = tuned(1.5, "radii", "landmarks.parsing")
    step: float = tuned(0.04, "eye widths", "landmarks.parsing")  # the first; then halves of the one before
    # along the eye, beyond which a place is taken as it is found, and across it; one of the others
    first_steps: tuple[int, int] = (2, 1)
    # cost of a distance, and of a light iris's
    moved: tuple[float, float] = tuned((2.0, 0.6), "1/eye widths", "landmarks.parsing")
    max_difference: float = 1.0  # of a pixel from that at rest, sum over the channels, shares of the white
    memory: Decay = tuned(Decay(0.25), "share", "picture.identity")  # of a place
    edge: float = tuned(0.7, "radii", "picture.identity")  # beyond which catch-lights fade
    # of a parsed cell, of the largest in an eye, at which none and all is an eye's,
    eye_share: tuple[float, float] = tuned((0.15, 0.4), "share", "landmarks.parsing")
    # which is believed from and at such a largest one
    known_eye_share: tuple[float, float] = tuned((0.4, 0.7), "share", "landmarks.parsing")
    # width of an eye in the clip from which a darker and a lighter iris is known
    known_eye_pixels: tuple[float, float] = tuned((22.0, 30.0), "pixels", "picture.identity")
    # Drawing.
    # How unlike white nothing and all of a pixel is changed: what is no iris stays.
    unlike: tuple[float, float] = tuned((0.35, 0.85), "share of the white", "picture.identity")
    # brightness of an iris from which it can't be told from its white pixel by pixel
    light: float = tuned(0.63, "share of the white", "picture.identity")
    # of an iris at most: more, in the shade of lids, looks blind
    lightening: float = tuned(2.2, "ratio", "picture.identity")
    # added before colours are divided
    black_share: float = tuned(0.02, "share of the white", "picture.identity")
    # by which a pixel is brighter than a light iris at least
    catch_light: float = tuned(0.25, "share of the white", "picture.identity")
    # luma from which and at which a pixel is all reflection: of a lens or of what shines
    glare: tuple[float, float] = tuned((200.0, 240.0), "grey levels", "picture.identity")
    # limits of the frame's iris over that at rest
    shade: tuple[float, float] = tuned((0.55, 1.1), "ratio", "picture.identity")
    shade_eye_widths: float = tuned(0.04, "eye widths", "picture.identity")  # standard deviation


LIMITS = TintLimits()
# (k, 3) rounds, finer and finer, and steps in each about the best place so far.
MOVES = np.array(
    [
        (finer, LIMITS.step / 2**finer * x, LIMITS.step / 2**finer * y)
        for finer, (across, down) in enumerate((LIMITS.first_steps, (1, 1), (1, 1)))
        for x in range(-across, across + 1)
        for y in range(-down, down + 1)
    ]
)
NO_CELLS, STRAIGHT = np.zeros((1, 1), np.float32), np.eye(2, 3)


class Gaze:
    """Follows where the source's irises are, from frame to frame.

    source : Irises of the source.   at_rest : (81, 2) the source's shape at rest.
    """

    def __init__(self, source: Irises, at_rest: F64) -> None:
        self._places, self._widths = source.places, [width_to_nose(eye, at_rest) for eye in EYES]

    def follow(self, face: FaceInFrame, memory: Memory) -> None:
        """Look where the parsing of a frame finds the irises."""
        gaze, kept = memory.gaze, LIMITS.memory.over(memory.clock.step)
        if not gaze.parsed.size:
            gaze.parsed, gaze.places = self._places.copy(), self._places.copy()
        if face.parsing is None:
            return
        nose, irises = nose_length(face.head), face.parsing.irises[:, :2]
        for place, iris, eye, width in zip(gaze.parsed, irises, EYES, self._widths, strict=True):
            place[:] = _steadied(place, in_eye(iris, face.head[eye], width * nose), kept)


def _steadied(last: F64, found: Floating, kept: float) -> F64:
    step = last - found
    place: F64 = found + (kept if np.hypot(*step) < LEAP else 0) * step
    return place


@dataclass(frozen=True, eq=False)
class IrisChange:
    """From one person's irises to another's."""

    source: Irises
    target: Irises

    def is_known(self, eye_pixels: float) -> bool:
        """Whether a clip that shows the target's eye so many pixels wide tells its colour.

        A light iris on a dark one must be known better: a doubtful one looks blind.
        """
        return eye_pixels >= LIMITS.known_eye_pixels[self.lightens]

    @property
    def lightens(self) -> bool:
        """Whether the target's iris is the lighter one."""
        return bool(self.target.colour @ LUMA > self.source.colour @ LUMA)

    @property
    def is_light(self) -> bool:
        """Whether the source's iris is too light to be told from its white pixel by pixel."""
        return bool(self.source.colour @ LUMA > LIMITS.light)


LEAP = LIMITS.first_steps[0] * LIMITS.step  # of a place, from which it is taken as it is found
# What the compiled twin of `tint_iris` is told of limits.
TOLD = np.hstack(
    [
        LEAP, LIMITS.known_eye_share, LIMITS.eye_share, 1 - IRISES.white_quantile, IRISES.reach, LIMITS.ring,
        LIMITS.max_difference, IRIS_BORDER, LIMITS.glare, LIMITS.unlike, LIMITS.edge, LIMITS.catch_light,
        LIMITS.black_share, LIMITS.shade,
    ]
)  # fmt: skip


class TintNumbers(NamedTuple):
    """What `tint_iris` is told of two people, and of a frame."""

    is_light: float  # the source's iris, see `IrisChange`
    lightens: float
    radius: float
    dimmed: float  # gain of a lighter iris
    blur: float  # pixels, standard deviation of a shade
    moved: float
    shown: float = 1.0  # share of the change, and of the last place that is kept
    kept: float = 0.0


SHOWN, KEPT = (TintNumbers._fields.index(name) for name in ("shown", "kept"))


class IrisTint:
    """Gives one eye of the source the identity's iris, frame by frame.

    Parameters
    ----------
    change : shared by both eyes.
    lids : (h, w) share in [0, 1] by which pixels are within the lids.
    eye : 0 for the right one, 1 for the left one.
    """

    def __init__(self, change: IrisChange, lids: F32, eye: int) -> None:
        self._lids, self._eye, inside = lids, eye, lids > 0.5
        thinned = np.zeros_like(inside)
        thinned[::2, ::2] = True
        self._looked_at = np.flatnonzero(inside & (thinned | (inside.sum() < LIMITS.many_pixels)))
        self._profiles = np.array([change.source.profile, change.target.profile], np.float32)
        own, other = (irises.colour + LIMITS.black_share for irises in (change.source, change.target))
        contrast = 1 - own
        direction = contrast / max(float(contrast @ contrast), 1e-3)
        self._factors = np.array([other / own, direction], np.float32)
        numbers = TintNumbers(
            is_light=change.is_light,
            lightens=change.lightens,
            radius=change.source.radius,
            dimmed=min(1.0, LIMITS.lightening * float(own @ LUMA) / float(other @ LUMA)),
            blur=max(LIMITS.shade_eye_widths * inside.any(0).sum(), 0.5),
            moved=LIMITS.moved[change.is_light],
        )
        self._numbers = np.concatenate([numbers, TOLD])

    def apply(
        self, eye: F32, places: F32, axes: F32, parsing: Parsing | None, colour: ColourMatrix, gaze: GazeMemory,
        shown: float, step: float,
    ) -> None:  # fmt: skip
        """Give an eye (h, w, 3) in a frame's components the other's iris, in place.

        places : (h w, 2) in the picture that is parsed.   axes : of the eye there, see `eye_axes`.
        shown : share of the change.   step : seconds since the frame before.
        """
        cells = NO_CELLS if parsing is None else parsing.shares[FaceClass.EYES]
        to_cells = STRAIGHT if parsing is None else parsing.to_cells
        numbers = self._numbers
        numbers[SHOWN], numbers[KEPT] = shown, LIMITS.memory.over(step)
        found = np.array([gaze.parsed[self._eye], gaze.places[self._eye]], np.float64)
        tint_iris(
            places, axes, cells, to_cells, self._lids, self._looked_at, colour.to_rgb, colour.from_rgb, MOVES,
            self._factors, self._profiles, numbers, found, eye,
        )  # fmt: skip
        gaze.places[self._eye] = found[1]


@kernel
def tint_iris(
    places: F32, axes: F32, cells: F32, to_cells: F64, lids: F32, looked_at: Int, to_rgb: F32, from_rgb: F32,
    moves: F64, factors: F32, profiles: F32, numbers: F64, gaze: F64, eye: F32,
) -> None:  # fmt: skip
    """Give one person's eye another's iris, in place.

    places : (h w, 2) pixels of the picture that is parsed.   axes : (3, 2) of the eye there, see `eye_axes`.
    cells, to_cells : (m, m) share of eyes, and the map (2, 3) from places to cells.
    lids : (h, w) share by which pixels are within lids.   looked_at : (n,) pixels that tell where the iris is.
    to_rgb, from_rgb : (3, 4) of the eye's components.   moves : (k, 3), see `MOVES`.
    factors : (2, 3) the gain of a darker iris, and how white becomes the source's.
    profiles : (2, rings, 3) of both people, see `Irises`.   numbers : `TintNumbers`, then `TOLD`.
    gaze : (2, 2) where the parsing found the iris, and in place where it was found near by.
    eye : (h, w, 3) in place.
    """
    told, pixels, inside = TintNumbers(*numbers[: -len(TOLD)]), eye.reshape(-1, 3), lids.ravel() > 0.5
    seen = np.float32(told.shown) * eye_seen(cells, to_cells, places)
    if np.maximum.reduce(seen) == 0 or not inside.any():
        return
    picture = np.asarray(cv2.transform(eye, to_rgb), np.float32).reshape(-1, 3)
    colours = picture[inside]
    matt = colours[colours @ LUMA < LIMITS.glare[0]]
    bright = white(matt if matt.size else colours)
    x, y = (places - axes[0]).T
    x, y = x * axes[1, 0] + y * axes[2, 0], x * axes[1, 1] + y * axes[2, 1]
    colours = (picture[looked_at] / bright).T
    source, target = profiles.transpose(0, 2, 1)
    found = _found(told, colours, factors[1], source, (x[looked_at], y[looked_at]), moves, gaze[0])
    gaze[1] = _steadied(gaze[1], found, told.kept)
    x, y = x - np.float32(gaze[1, 0]), y - np.float32(gaze[1, 1])
    away = np.sqrt(x * x + y * y) / np.float32(told.radius)
    near = (away < IRIS_BORDER[0]).nonzero()[0]
    before, there = np.ascontiguousarray(picture[near].T), away.take(near)
    if told.lightens or told.is_light:
        luma = (picture @ LUMA).reshape(lids.shape)
        change = _painted(told, luma, bright, away, near, before, source, target) - before
    else:
        change = (factors[0][:, None] - 1) * before
    if not told.is_light:
        unlike = factors[1] @ (1 - before / bright[:, None])
        change *= ramp(np.asarray(unlike, np.float32), LIMITS.unlike)
    change *= ramp(there, IRIS_BORDER)
    change *= 1 - ramp(LUMA @ before, LIMITS.glare)
    after = before + change * (lids.ravel() * seen).take(near)
    pixels[near] = (from_rgb[:, :3] @ after + from_rgb[:, 3:]).T


def eye_seen(cells: F32, to_cells: F64, places: F32) -> F32:
    """(n,) share in [0, 1] by which a parsing takes places (n, 2) about an eye for eye, not lid.

    cells, to_cells : (m, m) its share of eyes, and the map (2, 3) from places to cells.
    """
    shares = remap_points(cells, cv2.transform(places[None], to_cells)[0], cv2.BORDER_CONSTANT)
    most = float(np.maximum.reduce(shares, None))
    known = np.float32(small.ramp(most, *LIMITS.known_eye_share))
    seen: F32 = 1 - known * (1 - ramp(shares / np.float32(max(most, 1e-6)), LIMITS.eye_share))
    return seen


def _found(
    told: TintNumbers, colours: F32, direction: F32, profile: F32, places: tuple[F32, F32], moves: F64, start: F64
) -> F64:  # fmt: skip
    """(2,) where the iris is most likely, by colours (3, n) at places in the eye, shares of the white.

    direction : (3,) from white to the iris.   profile : (3, rings) of it.   start : (2,) where it is looked for.
    """
    (x, y), radius = places, np.float32(told.radius)
    unlike = np.asarray(direction @ (1 - colours), np.float64)
    best: F64 = start
    for finer in range(int(moves[-1, 0]) + 1):
        steps = moves[moves[:, 0] == finer, 1:]
        middles = (best + steps).astype(np.float32)
        dx, dy = x - middles[:, :1], y - middles[:, 1:]
        away = np.sqrt(dx * dx + dy * dy) / radius
        if told.is_light:
            off = np.add.reduce(np.abs(colours[:, None] - at_rings(profile, away)), 0)
            near = away < LIMITS.ring
            scores = -_means(near, np.minimum(off, LIMITS.max_difference))
        else:
            disc = away < 1
            ring = ~disc & (away < LIMITS.ring)
            scores = np.asarray(_means(disc, unlike) - _means(ring, unlike))
        off = middles - start
        scores -= told.moved * np.hypot(off[:, 0], off[:, 1])
        best = best + steps[int(scores.argmax())]
    return best


def _means(chosen: Bool, values: Floating) -> F64:
    """(k,) means of values (n,) or (k, n) where they are chosen (k, n); 0 of none."""
    sums = np.add.reduce(np.where(chosen, values, 0), 1, np.float64)
    return np.asarray(sums / np.maximum(np.add.reduce(chosen, 1, np.intp), 1))


def _painted(
    told: TintNumbers, luma: F32, bright: F32, away: F32, near: Int, pixels: F32, source: F32, target: F32
) -> F32:  # fmt: skip
    """Pixels (3, n) at indices `near` with the other's iris painted ring by ring; shading and catch-lights stay."""
    there, white = away.take(near), bright[:, None]
    own, other = at_rings(source, there), np.float32(told.dimmed) * at_rings(target, there)
    usual = own * white
    inner = ramp(there, (1.0, LIMITS.edge))
    brighter = pixels - usual
    gleams = (LUMA @ brighter / (LIMITS.catch_light * (bright @ LUMA)) - 1) * 2
    gleams = np.minimum(np.maximum(gleams, 0), 1)
    catch_light = np.maximum(brighter, 0) * (gleams * inner)
    matt = pixels - catch_light
    below = at_rings(LUMA @ (source * white), away)
    luma.ravel()[near] = LUMA @ matt
    seen = cv2.GaussianBlur(luma, (0, 0), told.blur).take(near)
    at_rest = cv2.GaussianBlur(below.reshape(luma.shape), (0, 0), told.blur).take(near)
    shade = np.minimum(np.maximum(seen / np.maximum(at_rest, 4), LIMITS.shade[0]), LIMITS.shade[1])
    structure = matt - usual * shade
    structure *= np.minimum(1, other / np.maximum(own, LIMITS.black_share))
    return np.asarray(other * white * shade + catch_light + structure, np.float32)
