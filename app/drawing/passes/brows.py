"""Brows: as thick as they are, and never two of them, one above the other.

A mesh stretches brows when lids close or brows rise.  The points of a brow lie along its upper edge, and its hair in
the triangles between them and the lid, so that a brow would grow with its distance from the lid, by a third in a blink,
and its lower edge break where triangles meet.  So each place of the texture below a brow's points is read as far below
as it is drawn, and the skin from the brow's end to the lid takes up the rest.

A brow of the source may reach beyond the drawn face: its tail at the temple, or an arch above the drawn forehead.  So
before the face is drawn, what the parsing takes for brows becomes skin as it is beside them.  Hair, glasses and things
in front of a brow stay.

Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.brows import BrowFollower
from guise.aam.landmarks.schemes import (
    BROWS,
    LEFT_BROW,
    LEFT_EYE_INNER,
    LEFT_EYE_OUTER,
    LEFT_UPPER_LID,
    RIGHT_BROW,
    RIGHT_EYE_INNER,
    RIGHT_EYE_OUTER,
    RIGHT_UPPER_LID,
    Group,
)
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.app.drawing.face import BROW_REACH, BROW_THICKNESS, CELL, GROWTH, FaceInFrame, ramp
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, F64, U8, Int
from guise.common.interpolation import interpolation
from guise.common.kernels import kernel
from guise.common.tuned import tuned


@dataclass(frozen=True)
class BrowStripLimits:
    """Lengths in face widths, heights in distances from brow to lid."""

    lowest: float = tuned(0.8, "brow to lid", "picture.truth")  # height at which a brow ends at most
    # of the distance, more counts as this
    stretch: tuple[float, float] = tuned((0.6, 1.8), "ratio", "picture.truth")
    unchanged: float = tuned(0.02, "ratio", "speed")  # of a stretch, that isn't seen
    least: float = tuned(1.0, "grid pixels", "picture.truth")  # from brow to lid


@dataclass(frozen=True)
class BrowCoverLimits:
    """Lengths in face widths, shares of classes."""

    # of a brow, up to which nothing is painted over, from which all is; of what lies in front, from all to nothing
    brow_share: tuple[float, float] = tuned((0.06, 0.25), "share", "landmarks.parsing")
    # of skin, from which it begins to tell what is beside
    bare_share: tuple[float, float] = tuned((0.5, 1.0), "share", "landmarks.parsing")
    # standard deviation of the weights of the skin beside
    beside: float = tuned(0.05, "face widths", "picture.truth")
    # mean weight, below which nothing is known of it
    least_skin: tuple[float, float] = tuned((0.003, 0.02), "share", "picture.truth")


LIMITS, COVER = BrowStripLimits(), BrowCoverLimits()
TOLD = np.array([LIMITS.least, LIMITS.unchanged, *LIMITS.stretch, LIMITS.lowest])  # to `keep_brow`
IN_FRONT = FaceClass.GLASSES, FaceClass.OCCLUDER
KINDS = FaceClass.BROWS, FaceClass.SKIN
READ = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


class HeadBrows:
    """Sets the brows of the head where the frame shows them."""

    def __init__(self, person: AppearanceModel) -> None:
        self._follower = BrowFollower(person)

    def see(self, face: FaceInFrame, memory: Memory) -> None:
        """Look at the hair of brows in a frame that was parsed."""
        if face.parsing is not None:
            memory.brows.lift.see(face.parsing, face.found)

    def follow(self, face: FaceInFrame, memory: Memory) -> None:
        """Move their points to their hair as it was seen last, and to where they look alike in this frame."""
        kept, luma = memory.brows, face.frame.luma
        lifted = kept.lift(face.found)
        kept.shifts = self._follower.shifts(luma, lifted, kept.shifts)
        face.head = self._follower.moved(lifted, kept.shifts)


class DrawnBrows:
    """Keeps the drawn brows as thick as they are at rest, and covers the head's own.

    Parameters
    ----------
    reference : ReferenceFrame.
    """

    def __init__(self, reference: ReferenceFrame) -> None:
        self._width = reference.resolution
        self._strips = {factor: _strips(reference, factor) for factor in (1, 2)}

    def keep_thick(self, face: FaceInFrame, memory: Memory) -> None:
        """Read the brows of the picture as thick as they are at rest."""
        at_rest = face.sight.at_rest
        if at_rest is not None:
            for strip in self._strips[1 + face.canvas.fine]:
                strip.keep(face.canvas.picture, face.shape, at_rest)

    def cover_own(self, face: FaceInFrame, memory: Memory) -> None:
        """Paint over the head's own brows in the frame."""
        if face.parsed is not None:
            canvas = face.canvas
            cover_brows(canvas.roi, face.head - canvas.corner, face.parsed, face.zoom * self._width)


def _strips(reference: ReferenceFrame, factor: int) -> list[_Strip]:
    """Both brows of a texture, with so many pixels per grid pixel along each axis."""
    lids = (
        np.r_[RIGHT_EYE_OUTER, RIGHT_UPPER_LID, RIGHT_EYE_INNER],
        np.r_[LEFT_EYE_INNER, LEFT_UPPER_LID, LEFT_EYE_OUTER],
    )
    return [_Strip(reference, *pair, factor) for pair in zip((RIGHT_BROW, LEFT_BROW), lids, strict=True)]


class _Strip:
    """One of them, with the points of the lid below it from left to right."""

    def __init__(self, reference: ReferenceFrame, brow: Group, lid: Group, factor: int) -> None:
        points, width = reference.points, reference.resolution
        fade = BROW_THICKNESS * width
        left, right = int(points[brow, 0].min() - fade), int(points[brow, 0].max() + fade + 1)
        top, bottom = int(points[brow, 1].min()), int(points[lid, 1].max() + 1)
        self._factor = factor
        self._place = np.s_[top * factor : bottom * factor, left * factor : right * factor]
        ys, xs = np.mgrid[top:bottom, left:right]
        x = xs[0].astype(np.float64)
        beyond = np.maximum(points[brow, 0].min() - x, x - points[brow, 0].max())
        shown = 1 - np.clip(beyond / fade, 0, 1)
        line, lids = (interpolation(x, points[group, 0]) @ points[group, 1] for group in (brow, lid))
        line, gap = (np.asarray(values, np.float32) for values in (line, lids - line))
        end = np.minimum(BROW_THICKNESS * width / gap, LIMITS.lowest)
        self._columns = np.array([line, gap, end, shown], np.float32)
        self._heights = np.asarray((ys - line) / gap, np.float32)
        inside, ends = np.column_stack([xs.ravel(), ys.ravel()]), np.tile(x, 2)
        self._inside = MeshSampler.build(reference, inside.astype(np.float64))
        self._ends = MeshSampler.build(reference, np.column_stack([ends, np.concatenate([line, line + gap])]))

    def keep(self, picture: U8, drawn: F64, at_rest: F64) -> None:
        """In a picture (h, w, 3) of a face (81, 2) that is another at rest."""
        rows, columns = self._place
        keep_brow(
            self._inside.vertices, self._inside.weights, self._ends.vertices, self._ends.weights, drawn, at_rest,
            self._heights, self._columns, TOLD, rows.start, self._factor, picture[:, columns],
        )  # fmt: skip


@kernel
def keep_brow(
    corners: Int, weights: F32, end_corners: Int, end_weights: F32, drawn: F64, at_rest: F64, heights: F32,
    columns: F32, limits: F64, top: int, factor: int, picture: U8,
) -> None:  # fmt: skip
    """Read a brow of a picture as thick as it is at rest, in place.

    corners, weights : (3, h w) of the grid's pixels about the brow, see `MeshSampler`.
    end_corners, end_weights : (3, 2 w) of its columns' ends, on the brow's points, then at the lid.
    drawn, at_rest : (81, 2) grid pixels.   heights : (h, w) of the pixels, 0 at the brow's points and 1 at the lid.
    columns : (4, w) row of the points, distance to the lid, height at which the brow ends, share that is changed.
    limits : least, unchanged, stretch and lowest of `BrowStripLimits`.
    picture : (y, factor w, 3) its columns, of which the pixels begin at a row `top`, factor h of them.
    """
    line, gap, end, shown = columns
    least, unchanged, *stretches, lowest = limits.astype(np.float32)
    moved, ends = MeshSampler(corners, weights), MeshSampler(end_corners, end_weights)
    above, below = ends.positions(at_rest)[:, 1].reshape(2, -1)
    gap_at_rest = np.maximum(below - above, least)
    above, below = ends.positions(drawn - at_rest)[:, 1].reshape(2, -1)
    stretch = (below - above) / gap_at_rest
    if np.maximum.reduce(np.abs(stretch)) < unchanged:
        return
    limited = np.minimum(np.maximum(stretch, stretches[0] - 1), stretches[1] - 1)
    share = shown * limited / (stretch + (stretch == 0))
    lower = moved.positions(drawn - at_rest)[:, 1].reshape(heights.shape) - above
    drawn_at, lid = heights + lower / gap_at_rest * share, 1 + shown * limited
    drawn_end = np.minimum(end, lowest * lid)
    beyond = end + (drawn_at - drawn_end) * ((1 - end) / (lid - drawn_end))
    read = np.where(drawn_at < drawn_end, drawn_at * (end / drawn_end), beyond)
    read = np.where((heights > 0) & (heights < 1), read, heights)
    rows = np.asarray((line + gap * read + np.float32(0.5)) * factor - np.float32(0.5), np.float32)
    size = factor * heights.shape[1], factor * heights.shape[0]
    if factor > 1:
        rows = np.asarray(cv2.resize(rows, size), np.float32)
    along = np.tile(np.arange(size[0], dtype=np.float32), (size[1], 1))
    picture[top : top + size[1]] = cv2.remap(
        np.ascontiguousarray(picture), along, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def cover_brows(roi: U8, head: F64, parsing: Parsing, width: float) -> None:
    """Paint over the brows of a head (81, 2) in a rectangle (h, w, 3) of a frame, in place.

    parsing : of the rectangle.   width : of the face, pixels.
    """
    points, reach, step = head[BROWS], BROW_REACH * width, max(round(CELL * width), 1)
    left, top = (max(int(one), 0) for one in np.minimum.reduce(points) - reach)
    right, bottom = (int(one) + 1 for one in np.maximum.reduce(points) + reach)
    part = roi[top : max(bottom, 0), left : max(right, 0)]
    if min(part.shape[:2]) > 2 * step:
        to_cells = parsing.to_cells @ np.array([[step, 0, left], [0, step, top], [0, 0, 1.0]])
        brows, skin = _shares(parsing, to_cells, (-(-part.shape[1] // step), -(-part.shape[0] // step)))
        _cover(part, brows, skin, width / step)


def _shares(parsing: Parsing, to_cells: F64, size: tuple[int, int]) -> tuple[F32, F32]:
    """(h, w) shares of brows, and of bare skin, at places whose map (2, 3) to the parsing's cells is given."""
    planes = cv2.merge([*(parsing.shares[kind] for kind in KINDS), parsing.share(*IN_FRONT)])
    read = cv2.split(cv2.warpAffine(planes, to_cells, size, flags=READ))
    brows, skin, front = (np.asarray(plane, np.float32) for plane in read)
    return np.asarray(ramp(brows, COVER.brow_share) * (1 - ramp(front, COVER.brow_share))), skin


def _cover(part: U8, brows: F32, skin: F32, width: float) -> None:
    """Paint over brows in a rectangle (h, w, 3), in place.

    brows, skin : shares at places that lie `width` to a face, of what is painted over and of what is bare skin.
    """
    if cv2.countNonZero(brows):
        lengths = max(round(GROWTH * width), 1), COVER.beside * width
        numbers = np.array([*lengths, *COVER.brow_share, *COVER.bare_share, *COVER.least_skin])
        paint_over(brows, skin, numbers, part)


@kernel
def paint_over(brows: F32, skin: F32, numbers: F64, part: U8) -> None:
    """Paint over brows in a picture (y, x, 3) with the colours of the skin beside them, in place.

    brows, skin : (h, w) shares in the picture's cells, of brows and of bare skin.
    numbers : cells by which brows are grown, standard deviation of the skin beside, cells, and the pairs of
        `BrowCoverLimits`: brow_share, bare_share, least_skin.
    """
    reach, sigma, *ends = numbers.tolist()
    brow_share, bare_share, least_skin = zip(ends[::2], ends[1::2], strict=True)
    size, side = part.shape[1::-1], 2 * int(reach) + 1
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (side, side))
    grown = np.asarray(cv2.GaussianBlur(cv2.dilate(brows, square), (0, 0), side / 4), np.float32)
    cells = cv2.resize(part.astype(np.float32), brows.shape[::-1], interpolation=cv2.INTER_AREA)
    weight = np.asarray(ramp(skin, bare_share) * (1 - ramp(grown, brow_share)))
    known = np.asarray(cv2.GaussianBlur(weight, (0, 0), sigma), np.float32)
    beside = cv2.GaussianBlur(cells * weight[..., None], (0, 0), sigma)
    beside = np.asarray(beside / np.maximum(known, np.float32(1e-6))[..., None])
    share = cv2.resize(np.asarray(grown * ramp(known, least_skin)), size)[..., None]
    part[:] = np.rint(part + share * (cv2.resize(beside, size) - part))
