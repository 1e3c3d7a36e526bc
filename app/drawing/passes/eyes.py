"""Eyes: the source's own eyeballs and inner mouth through the identity's lids and lips, or eyeballs painted anew; lids.

The frame is sampled between the source's own lids and lips and laid into the texture, so that it moves with the drawn
mesh: whatever the two faces' proportions, an eye is whole and looks where the source looks.  Its iris takes the
identity's colours (`irises.py`).  Where a landmarker leaves the lids of a shut eye apart, the parsing sees no eye
between them.  How much of the outline of an eye it takes for eye differs between people, pictures and glasses; so what
is seen is compared with the most that was seen of the same eye lately.

The eyeballs of a disguise look where the source looks, and show nothing of the source's eyes.  The identity's own, as
its texture has them, look where they did when it was enrolled, and are squeezed when lids close.  White, iris and pupil
are the identity's, with the shade of the upper lid and a reflection.

Pixels, x right, y down; places in an eye are in its widths, see `in_eye`.  RGB 0..255.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Protocol

import cv2
import numpy as np

from guise.aam.irises import EYES, Irises, eye_axes, in_eye, nose_length, white, width_to_nose
from guise.aam.landmarks.schemes import (
    EYE_OUTLINES,
    INNER_LIPS,
    LEFT_BROW,
    LEFT_EYE,
    RIGHT_BROW,
    RIGHT_EYE,
    RIGHT_UPPER_LID,
    Group,
)
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.painted_part import PaintedPart
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.app.drawing.face import (
    BROW_THICKNESS,
    GROWTH,
    IRIS_BORDER,
    MIN_SHARE,
    PAUSE_SECONDS,
    FaceInFrame,
    ramp,
)
from guise.app.drawing.memory import GazeMemory, Memory
from guise.app.media import ColourMatrix
from guise.common import small
from guise.common.arrays import F32, F64, U8, Int
from guise.common.decay import Decay
from guise.common.interpolation import interpolation
from guise.common.kernels import kernel
from guise.common.tuned import derived, tuned


@dataclass(frozen=True)
class ApertureLimits:
    """Where and when the source shows."""

    # of the source's part while it is shut
    shut_growth_face_widths: float = tuned(0.08, "face widths", "picture.truth")
    # within which no brow of the source's shows
    brow_growth_face_widths: float = tuned(0.025, "face widths", "picture.truth")
    # of a parsed cell, at which none and all is a brow's, or between lids
    cell_share: tuple[float, float] = tuned((0.3, 0.6), "share", "landmarks.parsing")
    # of what the source shows, which is resampled twice; share of an unsharp mask
    sharpening: float = tuned(0.5, "ratio", "picture.truth")
    # of an eye over which a lid is drawn, and of the skin of which it is made, which is softened over half of that,
    lid_growth_face_widths: float = tuned(0.03, "face widths", "picture.truth")
    # and at whose margin its lashes lie
    lashes_growth_face_widths: float = tuned(0.008, "face widths", "picture.truth")
    # distance of that skin from the margin, where lashes are
    lid_margin_share: float = tuned(0.3, "share", "picture.truth")
    # their darkness, and how wide they are, of the eye's height
    lashes: tuple[float, float] = tuned((0.45, 0.12), "share", "picture.truth")
    # Openings, of that at rest, from which and at which lids count as shut, and by how much earlier they are drawn so.
    shut: tuple[float, float] = tuned((0.55, 0.3), "ratio", "picture.truth")
    drawn_earlier: float = tuned(0.1, "ratio", "picture.truth")


@dataclass(frozen=True)
class EyeballLimits:
    """Eye widths, or radii of the iris where they say so."""

    # over which an eyeball ends at the lids, its lashes outside of them, and their shade inside
    edge: float = tuned(0.05, "eye widths", "deidentify.expression")
    # their darkness at the upper and the lower lid
    lashes: tuple[float, float] = tuned((0.6, 0.25), "share", "deidentify.expression")
    # of the skin's redness in the white, and darkness of that at the corners of the eye
    red: float = tuned(0.12, "share", "deidentify.expression")
    corner: float = tuned(0.25, "share", "deidentify.expression")
    lid_shade: float = tuned(0.4, "share", "deidentify.expression")  # just below the upper lid
    # place, and standard deviation
    reflection: tuple[float, float, float] = tuned((-0.35, -0.4, 0.13), "radii", "deidentify.expression")
    reflected: float = tuned(1.3, "ratio", "deidentify.expression")  # of the white
    # Radii beyond which nothing and within which all is pupil, and its brightness: a still's reflection hides it.
    pupil: tuple[float, float] = derived((0.42, 0.28), "radii", "a pupil of 4 mm in an iris of 12")
    black: float = derived(0.12, "share of the white", "what a cornea reflects of a bright room")
    # by which an iris, lit from above, is brighter at its lower rim than in its middle
    lit: float = tuned(0.35, "ratio", "deidentify.expression")


@dataclass(frozen=True)
class LidClosingLimits:
    """Shares of the area between lids."""

    # of the usual, at which lids are shut, and as they were found
    closed: tuple[float, float] = tuned((0.25, 0.6), "share", "picture.truth")
    # that is usual of eyes of which the parsing can tell
    least: float = tuned(0.5, "share", "landmarks.parsing")
    memory: Decay = tuned(Decay(0.996, PAUSE_SECONDS), "share a pause", "picture.identity")  # of the usual
    # of an eye's width, below which the parsing sees one now and then only
    min_eye_pixels: float = tuned(14.0, "pixels", "landmarks.parsing")
    columns: int = tuned(9, "places", "speed")
    rows: int = tuned(5, "places", "speed")


LIMITS, EYEBALL, CLOSING = ApertureLimits(), EyeballLimits(), LidClosingLimits()
# From a corner, two points of a lid and the other corner to columns, and how far down between lids rows lie.
_LID_POINTS = 2 + len(RIGHT_UPPER_LID)
_ALONG = interpolation(
    np.linspace(0, _LID_POINTS - 1, CLOSING.columns + 2)[1:-1], np.arange(float(_LID_POINTS))
)
_DOWN = (np.arange(CLOSING.rows) + 0.5)[:, None, None] / CLOSING.rows
# (2, 2, 4) the upper lids of the right and the left eye, and the lower ones, each from corner to corner.
_LIDS = np.array(
    [[[first, *lids[k], last] for (first, last), *lids in EYE_OUTLINES] for k in range(2)], np.intp
)


class Tint(Protocol):
    """Gives an eye of the source other colours."""

    def apply(
        self, eye: F32, places: F32, axes: F32, parsing: Parsing | None, colour: ColourMatrix, gaze: GazeMemory,
        shown: float, step: float,
    ) -> None:  # fmt: skip
        """See `IrisTint.apply`."""


Tinting = Callable[
    [F32, int], Tint
]  # for (h, w) share by which pixels are within the lids, and the number of the eye


class Aperture:
    """The inside of one landmark group on a texture.

    Parameters
    ----------
    reference : ReferenceFrame.
    part : landmark group whose hull is the aperture, soft-edged.
    factor : pixels of the texture per grid pixel, along each axis.
    at_rest : the source's shape (81, 2) at rest.
    only_shut : whether the source is to show only while the aperture is shut: then there are only lashes and lids to
        see, where the texture's modes leave slivers of the identity's open eye.
    tint : of an eye whose iris is to be the identity's.
    """

    def __init__(
        self, reference: ReferenceFrame, part: Group, factor: int, at_rest: F64, *, only_shut: bool = False,
        tint: Tinting | None = None,
    ) -> None:  # fmt: skip
        self._part, self._only_shut, self._eye = part, only_shut, int(part is LEFT_EYE)
        grow = LIMITS.shut_growth_face_widths if only_shut else GROWTH / 2
        shown = soft_parts(reference, (part,), grow)
        if only_shut:
            shown = shown * (
                1 - soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.brow_growth_face_widths)
            )
            shown = np.maximum(shown, _up_to_brow(reference, part))
        share = _enlarged(shown, factor)
        ys, xs = (np.flatnonzero((share > MIN_SHARE).any(axis)) for axis in (1, 0))
        self._place = np.s_[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        self._share = share[self._place]
        if only_shut:
            eye = soft_parts(reference, (part,), LIMITS.lid_growth_face_widths)
            self._skin = self._share * (1 - _enlarged(eye, factor)[self._place])
            self._sigma = LIMITS.shut_growth_face_widths / 2 * reference.resolution * factor
        rows, columns = np.mgrid[self._place]
        places = (np.column_stack([columns.ravel(), rows.ravel()]) + 0.5) / factor - 0.5
        self._sampler = MeshSampler.build(reference, places)
        self._tint: Tint | None = None
        if tint is not None:
            lids = soft_parts(reference, (part,), GROWTH / 2)
            lids = _enlarged(lids, factor)[self._place]
            self._tint = tint(lids, self._eye)
            self._width = width_to_nose(part, at_rest)

    def fill(
        self, face: FaceInFrame, memory: Memory, shut: tuple[float, float], head: F64, nose: float
    ) -> None:
        """Lay what the frame shows of the head there into the picture.

        shut : of its right and left eye, see `ShutShares`.   head, nose : (81, 2) in the rectangle, see `nose_length`.
        """
        shown = shut[self._eye] if self._only_shut else 1.0
        if shown == 0:
            return
        canvas, parsing = face.canvas, face.parsed
        picture, share = canvas.picture[self._place], self._share
        own, places = np.empty(picture.shape, np.float32), np.empty((share.size, 2), np.float32)
        corners, weights = self._sampler.vertices, self._sampler.weights
        show_through(corners, weights, head, canvas.roi, LIMITS.sharpening, places, own)
        if self._tint is not None:
            axes = eye_axes(head[self._part], self._width * nose)
            open_, step = 1 - shut[self._eye], memory.clock.step
            self._tint.apply(own, places, axes, parsing, face.frame.yuv, memory.gaze, open_, step)
        if self._only_shut:
            skin = self._skin
            if parsing is not None:
                brows = parsing.at(places, parsing.shares[FaceClass.BROWS])
                bare = 1 - ramp(brows, LIMITS.cell_share).reshape(share.shape)
                share, skin = share * bare, skin * bare
            self._give_tone(own, picture, skin)
        lay_over(own, share, shown, picture)

    def _give_tone(self, own: F32, picture: U8, skin: F32) -> None:
        """Give the source's shut eye (h, w, 3), in place, the tone of the skin (h, w) around it in the picture."""
        h, w = skin.shape
        weights = skin + np.float32(MIN_SHARE)
        weighted = [weights[..., None] * one for one in (picture, own)]
        cells = max(round(2 * w / self._sigma), 1), max(round(2 * h / self._sigma), 1)
        sigma = self._sigma * cells[0] / w
        there, theirs, around = (
            cv2.GaussianBlur(cv2.resize(one, cells, interpolation=cv2.INTER_AREA), (0, 0), sigma)
            for one in (*weighted, weights)
        )
        change = (there - theirs) / around[..., None]
        change[..., 0] = there[..., 0] / (theirs[..., 0] + np.float32(MIN_SHARE))
        change = np.asarray(cv2.resize(change, (w, h)), np.float32)
        own[..., 0] *= change[..., 0]
        own[..., 1:] += change[..., 1:]


@kernel
def show_through(
    corners: Int, weights: F32, head: F64, roi: U8, sharpening: float, places: F32, own: F32
) -> None:
    """Read a rectangle (h, w, 3) of a frame at places of a mesh, and sharpen what is seen.

    corners, weights : (3, n) of the places, see `MeshSampler`.   head : (p, 2) points of the mesh in the rectangle.
    sharpening : share of an unsharp mask.
    Out: places (n, 2) in the rectangle; own (y, x, 3) grey levels, n pixels.
    """
    places[:] = MeshSampler(corners, weights).positions(head)
    grid = places.reshape(*own.shape[:2], 2)
    seen = cv2.remap(roi.astype(np.float32), grid, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    own[:] = cv2.addWeighted(seen, 1 + sharpening, cv2.GaussianBlur(seen, (3, 3), 0), -sharpening, 0)


@kernel
def lay_over(own: F32, share: F32, shown: float, picture: U8) -> None:
    """Draw grey levels (h, w, 3) over a picture (h, w, 3), in place, by shares (h, w), times that which is shown."""
    shares = (np.float32(shown) * share)[..., None]
    made = picture + shares * (np.minimum(np.maximum(own, 0), 255) - picture)
    picture[:] = np.rint(made)


class Apertures:
    """Those of a face through which the source shows, and lids that are drawn over what shows nothing of them.

    Parameters
    ----------
    reference : ReferenceFrame.   at_rest : the source's shape (81, 2) at rest.
    always, shut : landmark groups in which the source shows always, or while they are shut.
    tint : of the eyes among the former.
    lids : eyes over which the identity's own lids are drawn while they are shut.
    """

    def __init__(
        self, reference: ReferenceFrame, at_rest: F64, always: Sequence[Group], shut: Sequence[Group],
        tint: Tinting | None, lids: Sequence[Group],
    ) -> None:  # fmt: skip
        def apertures(factor: int) -> list[Aperture]:
            open_ = [
                Aperture(reference, p, factor, at_rest, tint=None if p is INNER_LIPS else tint)
                for p in always
            ]
            return open_ + [Aperture(reference, p, factor, at_rest, only_shut=True) for p in shut]

        def drawn(factor: int) -> list[DrawnLid]:
            return [DrawnLid(reference, eye, factor) for eye in lids]

        self._apertures, self._lids = cache(apertures), cache(drawn)
        self._shut, self._drawn_shut = ShutShares(at_rest), ShutShares(at_rest, LIMITS.drawn_earlier)

    def draw(self, face: FaceInFrame, memory: Memory) -> None:
        """Draw them into the picture."""
        openings, factor = eye_openings(face.head), 1 + face.canvas.fine
        shut, head, nose = self._shut(openings), face.head - face.canvas.corner, nose_length(face.head)
        for aperture in self._apertures(factor):
            aperture.fill(face, memory, shut, head, nose)
        for lid in self._lids(factor):
            lid.fill(face.canvas.picture, self._drawn_shut(openings))


class ShutShares:
    """How far the eyes of the source are shut.

    at_rest : shape (81, 2).   earlier : opening, of that at rest, by which eyes count as shut before `LIMITS.shut`.
    """

    def __init__(self, at_rest: F64, earlier: float = 0.0) -> None:
        self._first, self._last = (opening + earlier for opening in LIMITS.shut)
        self._openings = [max(one, 1e-6) for one in eye_openings(at_rest)]

    def __call__(self, openings: tuple[float, float]) -> tuple[float, float]:
        """Shares in [0, 1] of the right and the left eye for the `eye_openings` of a shape."""
        right, left = self._openings
        return self._share(openings[0] / right), self._share(openings[1] / left)

    def _share(self, opening: float) -> float:
        return min(max((self._first - opening) / (self._first - self._last), 0.0), 1.0)


class DrawnLid:
    """The identity's own upper lid, drawn down over an eye while the source's is shut.

    For a disguise, which shows nothing of the source: the skin above the eye is mirrored down about the upper margin,
    with a line of lashes along the lower one.

    Parameters
    ----------
    reference : ReferenceFrame.   part : landmark group of the eye.   factor : as for `Aperture`.
    """

    def __init__(self, reference: ReferenceFrame, part: Group, factor: int) -> None:
        self._eye = int(part is LEFT_EYE)
        share, eye = (
            _enlarged(soft_parts(reference, (part,), growth), factor)
            for growth in (LIMITS.lid_growth_face_widths, LIMITS.lashes_growth_face_widths)
        )
        ys, xs = (np.flatnonzero((share > MIN_SHARE).any(axis)) for axis in (1, 0))
        self._place = np.s_[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        self._share = share[self._place]
        rows, columns = (grid.astype(np.float32) for grid in np.mgrid[self._place])
        upper = (self._share >= 0.5 * self._share.max(0)).argmax(0) + np.float32(ys[0])
        inside = eye[self._place] > 0.5
        whole, last = np.flatnonzero(inside.any(0)), ys[-1] - inside[::-1].argmax(0)
        lower = np.interp(np.arange(inside.shape[1]), whole, last[whole]).astype(np.float32)
        into = np.maximum(rows - upper, 0) / np.maximum(lower - upper, 1)
        reach = LIMITS.lid_growth_face_widths * reference.resolution * factor
        skin = np.minimum(rows, upper - LIMITS.lid_margin_share * reach)
        self._from = np.dstack([columns, skin - into * reach]).astype(np.float32)
        self._sigma = LIMITS.lid_growth_face_widths / 2 * reference.resolution * factor
        lashes = np.exp(-0.5 * ((into - 1) / LIMITS.lashes[1]) ** 2)
        self._dark = np.asarray(1 - LIMITS.lashes[0] * lashes, np.float32)

    def fill(self, picture: U8, shut: tuple[float, float]) -> None:
        """Draw the lid into a texture (h, w, 3), brightness first, as far as its eye is shut, see `ShutShares`."""
        shown = shut[self._eye]
        if shown == 0:
            return
        lid = cv2.remap(picture, self._from, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        lid = cv2.GaussianBlur(lid, (0, 0), self._sigma)
        lid[..., 0] = (lid[..., 0] * self._dark).astype(np.uint8)
        share = self._share * np.float32(shown)
        here = np.ascontiguousarray(picture[self._place])
        picture[self._place] = cv2.blendLinear(lid, here, share, 1 - share)


def _up_to_brow(reference: ReferenceFrame, eye: Group) -> F32:
    """(h, w) 1 from an eye up to the lower edge of the brow above it, soft-edged."""
    points = reference.points.copy()
    brow = LEFT_BROW if eye is LEFT_EYE else RIGHT_BROW
    points[brow, 1] += BROW_THICKNESS * reference.resolution
    return soft_parts(replace(reference, points=points), (np.r_[eye, brow],), 0.0)


def _enlarged(plane: F32, factor: int) -> F32:
    h, w = plane.shape[:2]
    return np.asarray(cv2.resize(plane, (factor * w, factor * h), interpolation=cv2.INTER_LINEAR), np.float32)


def eye_openings(shape: F64) -> tuple[float, float]:
    """Openings of the right and the left eye of a shape (81, 2)."""
    return opening(shape[RIGHT_EYE]), opening(shape[LEFT_EYE])


def opening(outline: F64) -> float:
    """Area of an aperture's outline (n, 2), of the square of its length."""
    area = cv2.contourArea(outline.astype(np.float32))
    length = math.hypot(*(np.maximum.reduce(outline) - np.minimum.reduce(outline)))
    return area / max(length, 1e-6) ** 2


class LidCloser:
    """Shuts the lids of the head as the parsing sees them."""

    def see(self, face: FaceInFrame, memory: Memory) -> None:
        """Look at the eyes of a frame that was parsed."""
        if face.parsing is None:
            return
        lids, points = memory.lids, face.found
        seen = _seen(face.parsing, points)
        kept = CLOSING.memory.over(memory.clock.now - memory.cover.parsed_at)
        lids.usual = np.maximum(kept * lids.usual, seen)
        share = small.ramps(seen / np.maximum(lids.usual, CLOSING.least), *CLOSING.closed)
        widths = np.array([math.dist(*points[corners]) for corners, _, _ in EYE_OUTLINES])
        can_tell = (lids.usual > CLOSING.least) & (widths >= CLOSING.min_eye_pixels)
        lids.open = np.where(can_tell, share, 1.0)

    def close(self, face: FaceInFrame, memory: Memory) -> None:
        """Put the upper lids as far down as they were seen last."""
        closed = face.head.copy()
        for (_, upper, lower), share in zip(EYE_OUTLINES, memory.lids.open, strict=True):
            closed[upper] = face.head[lower] + share * (face.head[upper] - face.head[lower])
        face.head = closed


def _seen(parsing: Parsing, points: F64) -> F64:
    """(2,) share of the area between the lids of the right and the left eye in which there is an eye."""
    top, bottom = _ALONG @ points[_LIDS]
    places = top[:, None] + _DOWN * (bottom - top)[:, None]
    seen = parsing.at(places.reshape(-1, 2), parsing.shares[FaceClass.EYES])
    shares: F64 = small.mean(small.ramps(seen, *LIMITS.cell_share).reshape(len(places), -1), 1)
    return shares


class Eyeballs:
    """Paints both eyes of an identity into its texture.

    Parameters
    ----------
    reference : ReferenceFrame.
    irises : of the identity.
    at_rest, texture : its shape (81, 2) and RGB (n, 3) at rest.
    """

    def __init__(self, reference: ReferenceFrame, irises: Irises, at_rest: F64, texture: F32) -> None:
        self._irises, self._widths = irises, [width_to_nose(eye, at_rest) for eye in EYES]
        self._parts = [PaintedPart.of(reference, group) for group in EYES]
        inside = (soft_parts(reference, (eye,), 0.0)[reference.mask] > 0.5 for eye in EYES)
        self._whites = [float(white(texture[eye]) @ LUMA) for eye in inside]

    def paint(self, face: FaceInFrame, memory: Memory) -> None:
        """Paint them, looking where the source looks."""
        texture, mesh, nose = face.canvas.texture, face.mesh, nose_length(face.mesh)
        for group, part, bright, iris, width in zip(
            EYES, self._parts, self._whites, memory.gaze.parsed, self._widths, strict=True
        ):
            outline = mesh[group]
            places, lids = (in_eye(points, outline, width * nose) for points in (part.places(mesh), outline))
            lid = lids[:, 1].min() * max(1 - 4 * iris[0] ** 2, 0) - iris[1]
            colours = self._shares(places - iris.astype(np.float32), float(lid)) * np.float32(bright)
            colours *= _shade(places, lids)[:, None] * _veined(texture[part.beside], places)
            inside = _inside(places, lids)
            dark = np.where(places[:, 1] < 0, *EYEBALL.lashes) * np.exp(inside.clip(max=0) / EYEBALL.edge)
            skin = texture[part.beside] * (1 - dark)[:, None]
            shown = np.clip(inside / EYEBALL.edge + 0.5, 0, 1)[:, None]
            part.paint(texture, skin + shown * (colours - skin))

    def _shares(self, from_middle: F32, lid: float) -> F32:
        """(n, 3) shares of the white at places (n, 2) from the middle of the iris; lid : where the upper one is there.

        What is reflected lies below that lid: without it an iris looks like a hole.
        """
        x, y = from_middle.T / np.float32(self._irises.radius)
        away = np.hypot(x, y)
        share, pupil = ramp(away, IRIS_BORDER), ramp(away, EYEBALL.pupil)
        iris = self._irises.at(np.minimum(away, 1)) * (1 + np.float32(EYEBALL.lit) * np.clip(y, -1, 1))
        iris += pupil * (np.minimum(iris, np.float32(EYEBALL.black)) - iris)
        seen = 1 + share * (iris - 1)
        left, up, width = EYEBALL.reflection
        up = max(up, lid / self._irises.radius + 2 * width)
        gleam = np.exp(-((x - left) ** 2 + (y - up) ** 2) / (2 * width**2))
        return np.asarray((seen + gleam * (EYEBALL.reflected - seen)).T, np.float32)


def _veined(skin: F32, places: F32) -> F32:
    """(n, 3) by which whites are darker than their brightest at places (n, 2), and redder, as the skin (m, 3) is."""
    tone = np.maximum(skin.mean(0), 1)
    red = 1 + np.float32(EYEBALL.red) * (tone / (tone @ LUMA) - 1)
    corner = np.minimum(4 * places[:, 0] ** 2, 1)[:, None]
    return np.asarray((1 - np.float32(EYEBALL.corner) * corner) * red, np.float32)


def _inside(places: F32, lids: F32) -> F32:
    """(n,) how far places (n, 2) lie within lids (6, 2), of which the outline is convex; negative outside."""
    x, y = (np.roll(lids, -1, axis=0) - lids).T[..., None] + np.float32(1e-6)
    from_x, from_y = places.T[:, None] - lids.T[..., None]
    return np.asarray(((x * from_y - y * from_x) / np.hypot(x, y)).min(0), np.float32)


def _shade(places: F32, outline: F32) -> F32:
    """(n,) how bright an eyeball with an outline (6, 2) is at places (n, 2)."""
    x, y = places.T
    lid = outline[:, 1].min() * np.clip(1 - 4 * x * x, 0, 1)
    below = np.exp(-np.maximum(y - lid, 0) / EYEBALL.edge)
    return np.asarray(1 - EYEBALL.lid_shade * below, np.float32)
