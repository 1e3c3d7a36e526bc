"""The rims of the glasses that a person wears, which stay whole in front of the drawn face.

A parsing sees that there are glasses, but its cells are several times as wide as a thin rim.  So the rims are looked
for in the picture: around each eye, the closed line along which the picture is most like a thin dark or bright line.
Such a line is the best path through a polar map about the eye, by dynamic programming (Amini, Weymouth and Jain, Using
dynamic programming for solving variational problems in vision, TPAMI 1990).  What it looks through moves, lids and
lashes, and so do errors; rims move with the head, so that the map is a mean over time.

Pixels, x right, y down; lengths in distances between the middles of the eyes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_EYE, NOSE_TIP, NOSE_WINGS, RIGHT_EYE
from guise.aam.parsing import FaceClass, FaceParsing
from guise.aam.reference import remap_points
from guise.aam.without_glasses import disc, wears_glasses
from guise.common.arrays import F32, F64, U8, Bool, Floating, Int
from guise.common.decay import Decay


@dataclass(frozen=True)
class RimLimits:
    """Where rims may be, what they look like, and how they are followed."""

    pixels: int = 100  # of the crop, in the unit of length
    size: tuple[float, float] = (2.6, 1.5)  # width and height of the crop,
    below_eyes: float = 0.2  # whose middle lies below that between the eyes
    angles: int = 72
    radii: tuple[float, float, int] = (0.12, 0.5, 39)  # from, to and how many; vertical ones
    centre: tuple[float, float] = (0.02, 0.05)  # of a lens from the eye's, outwards and down
    width_over_height: float = 1.35  # of a circle in the polar map
    line: float = 0.07  # the widest line
    usual_contrast: float = 0.25  # of a line, more counts as this
    eye_growth: float = 0.045  # around eyes, where no rim is looked for, but one may pass
    lash_growth: float = 0.02  # around eyes, where nothing is a rim
    nose_growth: float = 0.12
    nose_half_width: float = 0.04  # of what no lens reaches over
    glasses_weight: float = 0.15  # of the parsed glasses' share, which counts up to one half
    bend: float = 0.04  # reward that a change of the radius by one step costs
    memory: Decay = Decay(0.8, 0.1)  # of the map
    pause_seconds: float = 0.1  # more from one search to the next, as they go on,
    max_pause_seconds: float = 1.1  # up to this
    band: float = 0.09  # about the line, across all of which a rim may lie
    contrast: tuple[float, float] = (
        0.04,
        0.12,
    )  # of a line, up to which there is no rim, from which there is
    min_contrast: float = 0.05  # median along a rim, below which there is none


LIMITS = RimLimits()


@dataclass
class RimMemory:
    """What was seen of a face's rims.

    worn : share of the last parsed frames in which there were glasses; None before the first.
    reward : (2, angles, radii) mean of what speaks for a line there.   lines : (2, angles, 2) crop pixels.
    searches, due : how often the lines were searched for, and when they are again, seconds.
    share : (h, w) of the crop by which rims lie there in this frame; None is nowhere.   to_crop : (2, 3), its map.
    """

    worn: float | None = None
    reward: F32 | None = None
    lines: F32 | None = None
    searches: int = 0
    due: float = -np.inf
    share: F32 | None = None
    to_crop: F64 = field(default_factory=lambda: np.eye(2, 3))

    def at(self, places: Floating) -> F32:
        """(n,) share in [0, 1] by which a rim lies at places (n, 2) of the picture."""
        if self.share is None:
            return np.zeros(len(places), np.float32)
        there = places @ self.to_crop[:, :2].T + self.to_crop[:, 2]
        return remap_points(self.share, there.astype(np.float32))


class RimFinder:
    """Finds rims anew in some parsed frames, and in the others where they were on the head."""

    def __init__(self) -> None:
        turns = np.arange(LIMITS.angles)[:, None] * (2 * np.pi / LIMITS.angles)
        first, last, count = LIMITS.radii
        radii = np.linspace(first, last, count)
        circles = np.stack([LIMITS.width_over_height * np.cos(turns) * radii, np.sin(turns) * radii], axis=-1)
        outwards, down = LIMITS.centre
        centres = np.array([(-0.5 - outwards, down), (0.5 + outwards, down)])
        self._size = tuple(round(length * LIMITS.pixels) for length in LIMITS.size)
        self._middle = np.array(self._size) / 2 - 0.5 - (0, LIMITS.below_eyes * LIMITS.pixels)
        # (2, angles, radii, 2) crop pixels
        self._places = np.asarray(
            self._middle + LIMITS.pixels * (centres[:, None, None] + circles), np.float32
        )
        across = (self._places[..., 0] - self._middle[0]) * np.reshape([-1, 1], (2, 1, 1))
        self._over_nose = across < LIMITS.nose_half_width * LIMITS.pixels
        self._thin = disc(LIMITS.line * LIMITS.pixels / 2)

    def see(
        self, memory: RimMemory, luma: U8, shape: F64, parsing: FaceParsing | None, now: float, since: float
    ) -> None:
        """Look at a frame's brightness (h, w) in which the face lies at a shape (81, 2).

        parsing : of the frame; None if it wasn't parsed.   now, since : its time, and that since the last parsed one,
        seconds.
        """
        memory.share = None
        if parsing is not None:
            wears, kept = float(wears_glasses(parsing, shape)), LIMITS.memory.over(since)
            memory.worn = wears if memory.worn is None else wears + kept * (memory.worn - wears)
        if memory.worn is None or memory.worn < 0.5:
            return
        memory.to_crop = self._crop_of(shape)
        contrast = self._contrast(luma, memory.to_crop)
        if parsing is not None:
            reward = (
                self._polar(self._looks_like_rim(contrast, shape, parsing, memory.to_crop)) - self._over_nose
            )
            self._learn(memory, reward, now, since)
        if memory.lines is not None:
            for eye in (RIGHT_EYE, LEFT_EYE):
                contrast[self.about(shape[eye], LIMITS.lash_growth, memory.to_crop)] = 0
            memory.share = self._drawn(memory.lines, contrast)

    def _learn(self, memory: RimMemory, reward: F32, now: float, since: float) -> None:
        """Take in the rewards (2, angles, radii) of a frame, and now and then search for the lines anew."""
        kept = np.float32(LIMITS.memory.over(since))
        memory.reward = reward if memory.reward is None else reward + kept * (memory.reward - reward)
        if now < memory.due:
            return
        rings = best_rings(memory.reward, LIMITS.bend)
        memory.lines = np.ascontiguousarray(
            np.take_along_axis(self._places, rings[..., None, None], 2)[:, :, 0]
        )
        memory.searches += 1
        pause = min((memory.searches + 1) * LIMITS.pause_seconds, LIMITS.max_pause_seconds)
        memory.due = now + pause - LIMITS.pause_seconds / 10

    @property
    def pixels(self) -> int:
        """Of the crop, between the middles of the eyes."""
        return LIMITS.pixels

    def cut(self, luma: U8, to_crop: F64) -> F32:
        """The crop (h, w) of a picture (h, w)."""
        return np.asarray(_cut(luma, to_crop, self._size), np.float32)

    def parsed(self, parsing: FaceParsing, kinds: Sequence[FaceClass], to_crop: F64) -> F32:
        """(h, w, k) shares of kinds in the crop."""
        width, height = self._size
        step = 2  # the parsing's cells are larger by far
        xs, ys = np.meshgrid(np.arange(0, width, step), np.arange(0, height, step))
        back = cv2.invertAffineTransform(to_crop)
        places = np.column_stack([xs.ravel(), ys.ravel()]) @ back[:, :2].T + back[:, 2]
        shares = parsing.at(places.astype(np.float32), np.dstack([parsing.shares[kind] for kind in kinds]))
        return np.asarray(cv2.resize(shares.reshape(*xs.shape, len(kinds)), (width, height)), np.float32)

    def _crop_of(self, shape: F64) -> F64:
        """Map (2, 3) from the picture to the crop."""
        right, left = shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0)
        along = (left - right) * LIMITS.pixels / max(float(((left - right) ** 2).sum()), 1e-6)
        linear = np.array([along, (-along[1], along[0])])
        return np.column_stack([linear, self._middle - linear @ (right + left) / 2])

    def _contrast(self, luma: U8, to_crop: F64) -> F32:
        """(h, w) contrast of thin lines of the crop with what lies beside them."""
        crop = np.maximum(_cut(luma, to_crop, self._size), 8).astype(np.float32)
        crop = np.asarray(cv2.GaussianBlur(crop, (0, 0), 0.6), np.float32)
        closed = cv2.morphologyEx(crop, cv2.MORPH_CLOSE, self._thin)
        opened = cv2.morphologyEx(crop, cv2.MORPH_OPEN, self._thin)
        return np.asarray(np.maximum(1 - crop / closed, 1 - opened / crop), np.float32)

    def _looks_like_rim(self, contrast: F32, shape: F64, parsing: FaceParsing, to_crop: F64) -> F32:
        """(h, w) reward of a line that passes there."""
        kinds = FaceClass.BROWS, FaceClass.HAIR, FaceClass.GLASSES
        shares = self.parsed(parsing, kinds, to_crop)
        bare = np.clip(1 - 2 * shares[..., :2], 0, 1).prod(2)
        lines = np.minimum(contrast, LIMITS.usual_contrast) * bare
        for part, growth in (
            (RIGHT_EYE, LIMITS.eye_growth),
            (LEFT_EYE, LIMITS.eye_growth),
            ([NOSE_TIP, *NOSE_WINGS], LIMITS.nose_growth),
        ):
            lines[self.about(shape[part], growth, to_crop)] = 0
        return np.asarray(
            np.sqrt(lines) / 2 + LIMITS.glasses_weight * np.minimum(shares[..., 2], 0.5), np.float32
        )

    def about(self, points: F64, growth: float, to_crop: F64) -> Bool:
        """(h, w) places of the crop in the hull of points (n, 2) of the picture, grown."""
        there = points @ to_crop[:, :2].T + to_crop[:, 2]
        hull = np.zeros(self._size[::-1], np.uint8)
        cv2.fillConvexPoly(hull, cv2.convexHull(np.round(there).astype(np.int32)), 1)
        return np.asarray(cv2.dilate(hull, disc(growth * LIMITS.pixels)) > 0)

    def _polar(self, picture: F32) -> F32:
        """(2, angles, radii) of a crop (h, w), about both eyes."""
        return remap_points(picture, self._places.reshape(-1, 2)).reshape(self._places.shape[:3])

    def _drawn(self, lines: F32, contrast: F32) -> F32 | None:
        """(h, w) share of rims about lines (2, angles, 2); None if there are none."""
        along = remap_points(contrast, lines.reshape(-1, 2))
        if np.median(along) < LIMITS.min_contrast:
            return None
        near = np.zeros(contrast.shape, np.uint8)
        thickness = round(LIMITS.band * LIMITS.pixels)
        cv2.polylines(near, list(np.round(lines).astype(np.int32)), True, 1, thickness)
        first, last = LIMITS.contrast
        share = np.clip((contrast - first) / (last - first), 0, 1) * near
        share = np.asarray(cv2.GaussianBlur(cv2.dilate(share, np.ones((3, 3))), (0, 0), 0.7), np.float32)
        share[[0, -1]], share[:, [0, -1]] = 0, 0  # goes on beyond the crop
        return share


def best_rings(reward: F32, bend: float) -> Int:
    """(n, angles) indices of the radii along the closed line of most reward, in each of (n, angles, radii).

    bend : what a change of the radius by one step costs; from one angle to the next it changes by up to two.
    """
    several, angles, radii = reward.shape
    twice = np.concatenate([reward, reward], axis=1).transpose(1, 0, 2)
    steps = np.arange(-2, 3)
    costs = (bend * np.abs(steps))[:, None, None]
    best, came = twice[0].copy(), np.zeros(twice.shape, np.intp)
    padded = np.full((several, radii + 4), -np.inf, np.float32)
    for at in range(1, len(twice)):
        padded[:, 2:-2] = best
        choices = np.stack([padded[:, 2 + s : 2 + s + radii] for s in steps]) - costs
        came[at] = choices.argmax(0)
        best = np.take_along_axis(choices, came[at][None], 0)[0] + twice[at]
    rings = np.zeros((len(twice), several), np.intp)
    rings[-1] = best.argmax(1)
    for at in range(len(twice) - 1, 0, -1):
        rings[at - 1] = rings[at] + steps[came[at][np.arange(several), rings[at]]]
    half = angles // 2  # either end of the two rounds is free: only the middle is closed
    return np.roll(rings[half : half + angles].T, half, axis=1)


def _cut(luma: U8, to_crop: F64, size: tuple[int, ...]) -> U8:
    """A crop of a picture (h, w) under a map (2, 3) to it, without aliasing; the picture's border goes on beyond it."""
    width, height = size
    back = cv2.invertAffineTransform(to_crop)
    corners = np.array([(0, 0), (width, 0), (0, height), (width, height)]) @ back[:, :2].T + back[:, 2]
    (x0, y0), (x1, y1) = np.floor(corners.min(0)).astype(int) - 4, np.ceil(corners.max(0)).astype(int) + 5
    x0, y0 = max(min(x0, luma.shape[1] - 1), 0), max(min(y0, luma.shape[0] - 1), 0)
    part = np.ascontiguousarray(luma[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)])
    shrinks = float(np.hypot(*back[:, 0]))
    if shrinks > 1.25:
        part = np.asarray(cv2.GaussianBlur(part, (0, 0), 0.45 * shrinks), np.uint8)
    local = to_crop.copy()
    local[:, 2] += to_crop[:, :2] @ (x0, y0)
    return np.asarray(
        cv2.warpAffine(part, local, (width, height), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        np.uint8,
    )
