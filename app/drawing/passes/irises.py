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

import cv2
import numpy as np

from guise.aam.irises import EYES, Irises, in_eye, nose_length, white, width_to_nose
from guise.aam.light import LUMA
from guise.app.drawing.face import IRIS_BORDER, FaceInFrame, ramp
from guise.app.drawing.memory import GazeMemory, Memory
from guise.common.arrays import F32, F64, Floating, Int
from guise.common.decay import Decay
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
# (k, 2) steps about the best place so far, finer and finer.
MOVES = [
    LIMITS.step / 2**finer * np.mgrid[-across : across + 1, -down : down + 1].reshape(2, -1).T
    for finer, (across, down) in enumerate((LIMITS.first_steps, (1, 1), (1, 1)))
]


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
    place: F64 = found + (kept if np.hypot(*step) < LIMITS.first_steps[0] * LIMITS.step else 0) * step
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


class IrisTint:
    """Gives one eye of the source the identity's iris, frame by frame.

    Parameters
    ----------
    change : shared by both eyes.
    lids : (h, w) share in [0, 1] by which pixels are within the lids.
    eye : 0 for the right one, 1 for the left one.
    """

    def __init__(self, change: IrisChange, lids: F32, eye: int) -> None:
        self._lids, inside = lids.ravel(), lids > 0.5
        thinned = np.zeros_like(inside)
        thinned[::2, ::2] = True
        looked_at = inside & (thinned | (inside.sum() < LIMITS.many_pixels))
        self._inside, self._looked_at = np.flatnonzero(inside), np.flatnonzero(looked_at)
        self._change, self._eye = change, eye
        self._lightens, self._is_light = change.lightens, change.is_light
        self._blur = max(LIMITS.shade_eye_widths * inside.any(0).sum(), 0.5)
        own, other = (irises.colour + LIMITS.black_share for irises in (change.source, change.target))
        self._gain = (other / own).astype(np.float32)
        self._dimmed = np.float32(min(1.0, LIMITS.lightening * float(own @ LUMA) / float(other @ LUMA)))
        self._contrast = 1 - own
        self._direction = self._contrast / max(float(self._contrast @ self._contrast), 1e-3)

    def apply(self, picture: F32, places: F32, seen: F32, gaze: GazeMemory, step: float) -> F32:
        """An eye (h, w, 3) with places (h w, 2) and the other's iris, by shares (h w,) of eye that is seen there.

        step : seconds since the frame before.
        """
        if not self._inside.size or np.maximum.reduce(seen) == 0:
            return picture
        shown = self._lids * seen
        pixels = picture.reshape(-1, 3)
        inside = pixels[self._inside]
        matt = inside[inside @ LUMA < LIMITS.glare[0]]
        bright = white(matt if matt.size else inside)
        colours = (pixels[self._looked_at] / bright).T
        if not self._is_light:
            colours = self._direction @ (1 - colours)
        found = self._found(colours, places[self._looked_at], gaze)
        gaze.places[self._eye] = _steadied(gaze.places[self._eye], found, LIMITS.memory.over(step))
        from_middle = places - gaze.places[self._eye].astype(np.float32)
        x, y = from_middle[:, 0], from_middle[:, 1]
        away = np.sqrt(x * x + y * y) / np.float32(self._change.source.radius)
        near = (away < IRIS_BORDER[0]).nonzero()[0]
        before, there = np.ascontiguousarray(pixels[near].T), away.take(near)
        if self._lightens or self._is_light:
            change = self._painted(picture, bright, away, near, before) - before
        else:
            change = (self._gain[:, None] - 1) * before
        if not self._is_light:
            change *= self._share(np.asarray(before / bright[:, None], np.float32))
        change *= ramp(there, IRIS_BORDER)
        change *= 1 - ramp(LUMA @ before, LIMITS.glare)
        changed = pixels.copy()
        changed[near] = (before + change * shown.take(near)).T
        return changed.reshape(picture.shape)

    def _found(self, seen: F32, places: F32, gaze: GazeMemory) -> F64:
        """(2,) where the iris is most likely, by pixels at places (n, 2).

        seen : (n,) how unlike white they are; of a light iris (3, n) their colours, shares of the white.
        """
        light = seen.ndim == 2
        start = gaze.parsed[self._eye]
        best: F64 = start
        x, y = places.T
        for moves in MOVES:
            middles = (best + moves).astype(np.float32)
            dx, dy = x - middles[:, :1], y - middles[:, 1:]
            away = np.sqrt(dx * dx + dy * dy) / np.float32(self._change.source.radius)
            scores = -self._differences(seen, away) if light else _set_off(seen, away)
            off = middles - start
            scores -= LIMITS.moved[light] * np.hypot(off[:, 0], off[:, 1])
            best = best + moves[int(scores.argmax())]
        return best

    def _differences(self, seen: F32, away: F32) -> F32:
        """(k,) mean difference of colours (3, n) from the iris at rest, at distances (k, n) from its middle, radii."""
        near = away < LIMITS.ring
        off = seen[:, None] - self._change.source.at(away)
        unlike = np.minimum(np.add.reduce(np.abs(off), 0), LIMITS.max_difference)
        mean: F32 = np.add.reduce(unlike * near, 1) / np.maximum(np.add.reduce(near, 1, np.intp), 1)
        return mean

    def _share(self, shares: F32) -> F32:
        """(n,) share in [0, 1] by which pixels (3, n), shares of the white, are the source's iris by their colours."""
        return ramp(np.asarray(self._direction @ (1 - shares), np.float32), LIMITS.unlike)

    def _painted(self, picture: F32, bright: F32, away: F32, near: Int, pixels: F32) -> F32:
        """Pixels (3, n) at indices `near` with the other's iris painted ring by ring; shading and catch-lights stay."""
        source, there, white = self._change.source, away.take(near), bright[:, None]
        own, other = source.at(there), self._dimmed * self._change.target.at(there)
        usual = own * white
        inner = ramp(there, (1.0, LIMITS.edge))
        brighter = pixels - usual
        gleams = (LUMA @ brighter / (LIMITS.catch_light * (bright @ LUMA)) - 1) * 2
        gleams = np.minimum(np.maximum(gleams, 0), 1)
        catch_light = np.maximum(brighter, 0) * (gleams * inner)
        matt = pixels - catch_light
        above, below = picture @ LUMA, source.at(away, LUMA @ (source.profile * bright).T)
        above.ravel()[near] = LUMA @ matt
        seen = cv2.GaussianBlur(above, (0, 0), self._blur).take(near)
        at_rest = cv2.GaussianBlur(below.reshape(above.shape), (0, 0), self._blur).take(near)
        shade = np.minimum(np.maximum(seen / np.maximum(at_rest, 4), LIMITS.shade[0]), LIMITS.shade[1])
        structure = matt - usual * shade
        structure *= np.minimum(1, other / np.maximum(own, LIMITS.black_share))
        return np.asarray(other * white * shade + catch_light + structure, np.float32)


def _set_off(unlike_white: F32, away: F32) -> F32:
    """(k,) how much less white pixels (n,) are on discs than beside them, by distances (k, n) from their middles."""
    disc, ring = away < 1, (away >= 1) & (away < LIMITS.ring)
    within, beside = (
        some @ unlike_white / np.maximum(np.add.reduce(some, 1, np.intp), 1) for some in (disc, ring)
    )
    return np.asarray(within - beside)
