"""The source's own eyeballs and inner mouth, drawn through the identity's lids and lips.

The frame is sampled between the source's own lids and lips and laid into the texture, so that it moves with the drawn
mesh: whatever the two faces' proportions, an eye is whole and looks where the source looks.  Its iris takes the
identity's colours (`iris.py`).  Pixels, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks.schemes import LEFT_BROW, LEFT_EYE, RIGHT_BROW, Group
from guise.aam.mask import soft_parts
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.app.media import ColourMatrix
from guise.app.swapping.brow_strips import LIMITS as BROWS
from guise.app.swapping.iris import EYES, IrisChange, IrisTint, in_eye, whole_width
from guise.common.arrays import F32, F64, U8


@dataclass(frozen=True)
class ApertureLimits:
    """Where and when the source shows."""

    min_share: float = 0.02  # of the source, below which a pixel is left to the identity
    shut_growth_face_widths: float = 0.08  # of the source's part while it is shut
    brow_growth_face_widths: float = 0.025  # within which no brow of the source's shows
    brow_share: tuple[float, float] = (0.3, 0.6)  # of a parsed cell, at which none and all is a brow's
    eye_share: tuple[float, float] = (0.15, 0.4)  # likewise an eye's, of the largest in it,
    known_eye_share: tuple[float, float] = (0.4, 0.7)  # which is believed from and at such a largest one
    sharpening: float = 0.5  # of what the source shows, which is resampled twice; share of an unsharp mask
    growth_face_widths: float = 0.01  # of what always shows, so that no sliver of the identity's does
    lid_growth_face_widths: float = 0.03  # of an eye over which a lid is drawn,
    lashes_growth_face_widths: float = 0.008  # and at whose margin its lashes lie
    lid_softening_face_widths: float = (
        0.015  # of it, standard deviation: it has less texture than what it is made of
    )
    lid_reach_face_widths: float = 0.03  # of the skin of which it is made,
    lid_margin_share: float = 0.3  # and its distance from the margin, where lashes are
    lashes: tuple[float, float] = (0.45, 0.12)  # their darkness, and how wide they are, of the eye's height
    # Openings, of that at rest, from which and at which lids count as shut, and from and at which they are drawn so.
    shut: tuple[float, float] = (0.55, 0.3)
    drawn_shut: tuple[float, float] = (0.65, 0.4)


LIMITS = ApertureLimits()


class Aperture:
    """The inside of one landmark group on a texture.

    Parameters
    ----------
    reference : ReferenceFrame.
    part : landmark group whose hull is the aperture, soft-edged.
    factor : pixels of the texture per grid pixel, along each axis.
    at_rest : the source's shape (81, 2) at rest, if the source is to show only while the aperture is shut: then there
        are only lashes and lids to see, where the texture's modes leave slivers of the identity's open eye.
    irises : if the part is an eye whose iris is to be the identity's.
    """

    def __init__(
        self, reference: ReferenceFrame, part: Group, factor: int, at_rest: F64 | None = None,
        irises: IrisChange | None = None,
    ) -> None:  # fmt: skip
        self._part = part
        self._shut = None if at_rest is None else ShutShare(part, at_rest)
        grow = LIMITS.growth_face_widths if at_rest is None else LIMITS.shut_growth_face_widths
        shown = soft_parts(reference, (part,), grow)
        if at_rest is not None:
            shown = shown * (
                1 - soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.brow_growth_face_widths)
            )
            shown = np.maximum(shown, _up_to_brow(reference, part))
        share = _enlarged(shown, factor)
        ys, xs = (np.flatnonzero((share > LIMITS.min_share).any(axis)) for axis in (1, 0))
        self._place = np.s_[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        self._share = share[self._place]
        rows, columns = np.mgrid[self._place]
        places = (np.column_stack([columns.ravel(), rows.ravel()]) + 0.5) / factor - 0.5
        self._sampler = MeshSampler.build(reference, places)
        self._tint: IrisTint | None = None
        if irises is not None:
            lids = soft_parts(reference, (part,), LIMITS.growth_face_widths)
            lids = _enlarged(lids, factor)[self._place]
            self._tint = IrisTint(lids, irises, int(part is EYES[1]))
            self._hidden, self._at_rest = ShutShare(part, irises.at_rest), irises.at_rest

    def fill(
        self, picture: U8, roi: U8, head: F64, colour: ColourMatrix, openings: F64 | None = None,
        parsing: Parsing | None = None,
    ) -> None:  # fmt: skip
        """Lay what a rectangle shows on the source's shape (81, 2), in its pixels, into a texture in place.

        colour : the matrix of both pictures.   openings : `eye_openings` of the shape, if they are known.
        parsing : of the rectangle, if it is known, which tells brows and lids from what is to show.
        """
        openings = eye_openings(head) if openings is None else openings
        shown = 1.0 if self._shut is None else self._shut(openings)
        if shown == 0:
            return
        places: F32 = self._sampler.positions(head).reshape(*self._share.shape, 2)
        own = cv2.remap(roi, places, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        own = cv2.addWeighted(
            own, 1 + LIMITS.sharpening, cv2.GaussianBlur(own, (3, 3), 0), -LIMITS.sharpening, 0
        )
        if self._tint is not None:
            eye = cv2.transform(own.astype(np.float32), colour.to_rgb)
            whole = whole_width(self._part, head, self._at_rest)
            within = in_eye(places, head[self._part], whole)
            seen = np.float32(1 - self._hidden(openings)) * _eye_seen(parsing, places)
            eye = self._tint.apply(np.asarray(eye, np.float32), within, seen)
            eye = cv2.transform(eye, colour.from_rgb)
            own = cv2.add(eye, np.zeros_like(eye), dtype=cv2.CV_8U)  # rounds and saturates
        here = np.ascontiguousarray(picture[self._place])
        share = self._share * np.float32(shown)
        if self._shut is not None and parsing is not None:
            share *= 1 - _ramp(_shares(parsing, FaceClass.BROWS, places), LIMITS.brow_share)
        picture[self._place] = cv2.blendLinear(own, here, share, 1 - share)


def _eye_seen(parsing: Parsing | None, places: F32) -> F32:
    """(h, w) share in [0, 1] by which the parsing takes places (h, w, 2) about an eye for eye, not lid."""
    if parsing is None:
        return np.ones(places.shape[:2], np.float32)
    shares = _shares(parsing, FaceClass.EYES, places)
    most = float(shares.max())
    known = np.float32(np.interp(most, LIMITS.known_eye_share, (0, 1)))
    return np.asarray(
        1 - known * (1 - _ramp(shares / np.float32(max(most, 1e-6)), LIMITS.eye_share)), np.float32
    )


def _shares(parsing: Parsing, what: FaceClass, places: F32) -> F32:
    """(h, w) share of a class at places (h, w, 2)."""
    return parsing.at(places.reshape(-1, 2), parsing.shares[what]).reshape(places.shape[:2])


def _ramp(shares: F32, limits: tuple[float, float]) -> F32:
    """Shares in [0, 1] between the limits, at which they are 0 and 1."""
    first, last = limits
    return np.asarray(np.clip((shares - first) / (last - first), 0, 1), np.float32)


class ShutShare:
    """How far an eye of the source is shut.

    part : landmark group of the eye.   at_rest : shape (81, 2).
    limits : openings, of that at rest, from which and at which it counts as shut.
    """

    def __init__(self, part: Group, at_rest: F64, limits: tuple[float, float] = LIMITS.shut) -> None:
        self._limits = limits
        self._openings = np.maximum(eye_openings(at_rest), 1e-6)
        self._eye = int(part is LEFT_EYE)

    def __call__(self, openings: F64) -> float:
        """Share in [0, 1] for the `eye_openings` of a shape.

        An eye that is found half open beside a shut one counts as shut too: hardly anyone winks like that.
        """
        first, last = self._limits
        ratios = openings / self._openings
        least = min(float(ratios[self._eye]), float(ratios.mean()))
        return min(max((first - least) / (first - last), 0.0), 1.0)


class DrawnLid:
    """The identity's own upper lid, drawn down over an eye while the source's is shut.

    For a disguise, which shows nothing of the source: the skin above the eye is mirrored down about the upper margin,
    with a line of lashes along the lower one.

    Parameters
    ----------
    reference : ReferenceFrame.   part : landmark group of the eye.   factor : as for `Aperture`.
    at_rest : the source's shape (81, 2) at rest.
    """

    def __init__(self, reference: ReferenceFrame, part: Group, factor: int, at_rest: F64) -> None:
        self._shut = ShutShare(part, at_rest, LIMITS.drawn_shut)
        share, eye = (
            _enlarged(soft_parts(reference, (part,), growth), factor)
            for growth in (LIMITS.lid_growth_face_widths, LIMITS.lashes_growth_face_widths)
        )
        ys, xs = (np.flatnonzero((share > LIMITS.min_share).any(axis)) for axis in (1, 0))
        self._place = np.s_[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        self._share = share[self._place]
        rows, columns = (grid.astype(np.float32) for grid in np.mgrid[self._place])
        upper = (self._share >= 0.5 * self._share.max(0)).argmax(0) + np.float32(ys[0])
        inside = eye[self._place] > 0.5
        whole, last = np.flatnonzero(inside.any(0)), ys[-1] - inside[::-1].argmax(0)
        lower = np.interp(np.arange(inside.shape[1]), whole, last[whole]).astype(np.float32)
        into = np.maximum(rows - upper, 0) / np.maximum(lower - upper, 1)
        reach = LIMITS.lid_reach_face_widths * reference.resolution * factor
        skin = np.minimum(rows, upper - LIMITS.lid_margin_share * reach)
        self._from = np.dstack([columns, skin - into * reach]).astype(np.float32)
        self._sigma = LIMITS.lid_softening_face_widths * reference.resolution * factor
        lashes = np.exp(-0.5 * ((into - 1) / LIMITS.lashes[1]) ** 2)
        self._dark = np.asarray(1 - LIMITS.lashes[0] * lashes, np.float32)

    def fill(self, picture: U8, openings: F64) -> None:
        """Draw the lid into a texture (h, w, 3), brightness first, as far as an eye with `eye_openings` is shut."""
        shut = self._shut(openings)
        if shut == 0:
            return
        lid = cv2.remap(picture, self._from, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        lid = cv2.GaussianBlur(lid, (0, 0), self._sigma)
        lid[..., 0] = (lid[..., 0] * self._dark).astype(np.uint8)
        share = self._share * np.float32(shut)
        here = np.ascontiguousarray(picture[self._place])
        picture[self._place] = cv2.blendLinear(lid, here, share, 1 - share)


def _up_to_brow(reference: ReferenceFrame, eye: Group) -> F32:
    """(h, w) 1 from an eye up to the lower edge of the brow above it, soft-edged."""
    points = reference.points.copy()
    brow = LEFT_BROW if eye is LEFT_EYE else RIGHT_BROW
    points[brow, 1] += BROWS.thickness * reference.resolution
    return soft_parts(replace(reference, points=points), (np.r_[eye, brow],), 0.0)


def _enlarged(plane: F32, factor: int) -> F32:
    h, w = plane.shape[:2]
    return np.asarray(cv2.resize(plane, (factor * w, factor * h), interpolation=cv2.INTER_LINEAR), np.float32)


def eye_openings(shape: F64) -> F64:
    """(2,) openings of the right and the left eye of a shape (81, 2)."""
    return np.array([opening(shape[eye]) for eye in EYES])


def opening(outline: F64) -> float:
    """Area of an aperture's outline (n, 2), of the square of its length."""
    area = cv2.contourArea(outline.astype(np.float32))
    length = math.hypot(*(outline.max(0) - outline.min(0)))
    return area / max(length, 1e-6) ** 2
