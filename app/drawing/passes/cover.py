"""What hides the source's face in a frame: hands and other objects, hair, glasses.

The frame is parsed (`guise.aam.parsing`), and what is in front of the face is read where the drawn face's mesh lies.
There the frame's own pixels stay, and neither light nor expression is measured.  While nothing but hair and glasses is
in front, or nothing in front moves, and the eyes rest, only some frames are parsed; what was found moves along with the
face.

Where no part of the person may show, only objects stay in front, and only those that reach in from beyond the face, as
hands and mugs do: a patch within it that is taken for an object may be skin, and between bars or wires all may be.  A
lock of hair, which is easily taken for an object or for background, is told by its colour: that of all the hair.  Hair
that reaches in above the mouth may stay, too; below, a beard may be taken for it.  Glasses are drawn over, and their
arms beside the face become what is beside them (A. Telea, "An image inpainting technique based on the fast marching
method", Journal of Graphics Tools 9(1), 2004).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.coarse_grid import CoarseGrid
from guise.aam.glasses import STILL, GlassesOnHead
from guise.aam.landmarks.glances import LIMITS as GLANCES
from guise.aam.landmarks.glances import behind_lines
from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    BROWS,
    LEFT_BROW,
    LEFT_EYE,
    NOSE_ROOT,
    NOSE_TIP,
    OUTER_EYE_CORNERS,
    RIGHT_BROW,
    RIGHT_EYE,
    UPPER_LIP_TOP,
)
from guise.aam.mask import soft_parts
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.rims import RimFinder
from guise.app.drawing.face import (
    BROW_THICKNESS,
    CELL,
    GROWTH,
    MIN_SHARE,
    PAUSE_SECONDS,
    FaceInFrame,
    Layers,
    Seen,
    parse_frame,
    ramp,
)
from guise.app.drawing.memory import CoverMemory, Memory
from guise.app.media import Frame
from guise.common.arrays import F32, F64, I32, Bool, Int
from guise.common.decay import Decay
from guise.common.kernels import kernel
from guise.common.sampling import remap_points
from guise.common.small import mean
from guise.common.tuned import derived, tuned


@dataclass(frozen=True)
class OcclusionLimits:
    """Widths, thresholds and memory.

    Each share is a pair: that of a class up to which the drawn face is whole, and that from which it is gone.
    """

    object_share: tuple[float, float] = tuned((0.15, 0.45), "share", "picture.truth")
    # where no part of the person may show
    sure_object_share: tuple[float, float] = tuned((0.35, 0.65), "share", "deidentify.leaks")
    # of an object there, and of one beside the face, of the face; half of it may change while an object is still
    min_object_face_shares: float = tuned(0.01, "share", "picture.truth")
    # of such an object: of a hand or mug a fiftieth, of hair taken for one a fifth
    max_hair_share: float = tuned(0.1, "share", "deidentify.leaks")
    # of such an object, of what has the hair's colour
    max_hair_coloured_share: float = tuned(0.5, "share", "deidentify.leaks")
    # from the mean of the hair, within which a colour is the hair's
    hair_colour_deviations: float = tuned(2.5, "deviations", "deidentify.leaks")
    least_deviation: float = tuned(2.0, "grey levels", "deidentify.leaks")
    # of the parsing, from which the hair's and the skin's colours are known
    min_hair_cells: int = tuned(40, "cells", "deidentify.leaks")
    # of the face, which such an object reaches
    rim_face_widths: float = tuned(0.03, "face widths", "deidentify.leaks")
    # and of the background beyond the person's own face
    hair_share: tuple[float, float] = tuned((0.5, 0.85), "share", "landmarks.parsing")
    # of glasses, beside the eyes
    frame_share: tuple[float, float] = tuned((0.2, 0.5), "share", "picture.identity")
    # of glasses, dark ones, before the eyes
    lens_share: tuple[float, float] = tuned((0.7, 0.95), "share", "picture.identity")
    # within which glasses must be seen on the other side of the face, too
    mirror_face_widths: float = tuned(0.04, "face widths", "picture.identity")
    # of hair and glasses; objects come and go
    memory: Decay = tuned(Decay(0.7, PAUSE_SECONDS), "share a pause", "picture.identity")
    still_share: float = tuned(0.2, "share", "picture.truth")  # change of a share up to which it is still
    # mean change of an eye's texels, of their mean, from which it moves
    eye_change: float = tuned(0.04, "ratio", "picture.truth")
    # inside the hull, where the source's hair is kept
    hair_rim_face_widths: float = tuned(0.09, "face widths", "picture.identity")


@dataclass(frozen=True)
class ArmsLimits:
    """Where arms are looked for, face widths from the outer corner of an eye."""

    aside: float = tuned(0.3, "face widths", "deidentify.identity")
    reach: float = tuned(0.14, "face widths", "deidentify.identity")  # up and down, and inwards
    share: float = tuned(0.12, "share", "landmarks.parsing")  # of glasses, from which a pixel is an arm's
    around: float = tuned(0.03, "face widths", "deidentify.identity")  # from which it is painted
    least: float = tuned(0.5, "share", "landmarks.parsing")  # of glasses, where they are seen best


LIMITS, ARMS = OcclusionLimits(), ArmsLimits()
GLASSES = (FaceClass.GLASSES, LIMITS.frame_share), (FaceClass.GLASSES, LIMITS.lens_share)
KINDS = (FaceClass.OCCLUDER, LIMITS.object_share), (FaceClass.HAIR, LIMITS.hair_share), *GLASSES
SURE_KINDS = (
    (FaceClass.OCCLUDER, LIMITS.object_share),
    (FaceClass.OCCLUDER, LIMITS.sure_object_share),
    (FaceClass.HAIR, (0.0, 1.0)),
)
LEAST = derived(1e-6, "share", "far below what a byte shows")
EYES = RIGHT_EYE, LEFT_EYE
BESIDE = (FaceClass.BACKGROUND, LIMITS.hair_share)


class Cover:
    """Finds what is in front of the face; what is worn is smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : sampler of the places at which light and expression are measured.
    only_objects : hair, glasses and whatever lies wholly within the face don't stay in front;
    keeps_hair, keeps_glasses : but hair that reaches in does, and glasses do.
    beyond : (h, w) share in [0, 1] by which what is drawn lies beyond the person's own face: no background there is
        drawn over.
    watches_eyes : whether a frame in which the eyes move is parsed.
    beard : (h, w) share in [0, 1] of the person's own, which is easily taken for an object.
    """

    def __init__(
        self, reference: ReferenceFrame, texels: MeshSampler, *, only_objects: bool = False, keeps_hair: bool = False,
        keeps_glasses: bool = False, beyond: F32 | None = None, watches_eyes: bool = True, beard: F32 | None = None,
    ) -> None:  # fmt: skip
        self._reference = reference
        self._only_objects, self._keeps_hair = only_objects, keeps_hair
        self._keeps_glasses = keeps_glasses or not only_objects
        self._kinds = (*SURE_KINDS, *(GLASSES if keeps_glasses else ())) if only_objects else KINDS
        self._parser = FaceParser()
        self._cells = _Cells(reference, beyond, beard)
        x, y = np.round(texels.positions(reference.points)).astype(int).T
        in_eyes = (np.flatnonzero(soft_parts(reference, (eye,), 0.0)[y, x] > 0.5) for eye in EYES)
        self._in_eyes = [some for some in in_eyes if watches_eyes and len(some)]
        self._rims = RimFinder() if self._keeps_glasses else None
        self._rim_places: dict[int, tuple[slice, MeshSampler, F32]] = {}

    def look(self, face: FaceInFrame, memory: Memory) -> None:
        """Parse the frame if that is due, and tell what of the head it shows."""
        kept, seen = memory.cover, face.seen
        eyes = [_even(seen.rgb[eye]) for eye in self._in_eyes]
        is_due = memory.clock.is_due(kept.due) or _have_moved(eyes, kept.eyes)
        face.parsing = parse_frame(self._parser, face.frame, face.head) if is_due else None
        self._find_rims(face, memory)
        if face.parsing is not None:
            kept.eyes, layers = eyes, Layers.of(face.parsing, self._kinds)
            kept.visible = 1 - np.maximum.reduce(layers.at(seen.places), 1)
            self._set_apart(face.frame, face.parsing, layers, seen)
            if memory.rims.share is not None:
                kept.visible *= 1 - memory.rims.at(seen.places)
        if kept.clear is None or kept.visible is None:
            kept.clear = seen.rgb
        else:
            kept.clear = kept.clear + kept.visible[:, None] * (seen.rgb - kept.clear)
        seen.clear, seen.visible = kept.clear, kept.visible

    def share(self, face: FaceInFrame, memory: Memory) -> None:
        """Leave undrawn what is in front of the drawn face."""
        kept = memory.cover
        if face.parsing is not None:
            memory.parsed = face.parsing, face.head
            kept.uncovered = self._uncovered(face, memory)
            kept.parsed_at = memory.clock.now
        face.canvas.cover(kept.uncovered)

    def rims(self, face: FaceInFrame, memory: Memory) -> None:
        """Leave rims of glasses undrawn, which are thinner than the parsing tells."""
        if self._rims is None or memory.rims.share is None:
            return
        canvas, factor = face.canvas, 1 + face.canvas.fine
        if factor not in self._rim_places:
            self._rim_places[factor] = self._places_of_rims(factor)
        rows, sampler, depth = self._rim_places[factor]
        h, w = np.multiply(self._reference.size, factor)
        canvas.rims = np.zeros((h, w), np.float32)
        places = sampler.positions(face.mesh) + depth * face.sight.across.astype(np.float32)
        canvas.rims[rows] = memory.rims.at(places).reshape(-1, w)

    def _set_apart(self, frame: Frame, parsing: FaceParsing, layers: Layers, seen: Seen) -> None:
        """Tell hair from objects, and beyond the person's own face the background, where that matters."""
        beside = None if self._cells.beyond is None else Layers.of(parsing, (BESIDE,))
        if self._only_objects:  # a beard has the hair's colour, too, and is seen
            is_needed = beside is not None or layers.hidden[..., 0].any()
            hair = _hair_coloured(frame, parsing) if is_needed else np.zeros_like(parsing.shares[0])
            layers = layers.with_map(hair)
            beside = beside if self._keeps_hair else beside and beside.without(hair)
        seen.layers, seen.beside = layers, beside

    def _uncovered(self, face: FaceInFrame, memory: Memory) -> F32 | None:
        """(h, w) share in [0, 1] of the drawn face that nothing hides, on the reference grid; None is all of it."""
        kept, seen, cells = memory.cover, face.seen, self._cells
        assert seen.layers is not None
        places, layers = cells.read(face, seen.layers)
        worn = np.zeros_like(layers[0])
        if self._only_objects:
            hidden, is_moving = cells.reaching_in(layers[1], layers[2], layers[-1])
            if self._keeps_hair:
                worn = cells.hair_reaching_in(layers[2])
            if self._keeps_glasses:
                worn = np.maximum(worn, cells.glasses(*layers[3:5]))
            if (is_moving or worn.any()) and _is_behind_lines(face.frame, face.head):
                hidden, worn = 0 * hidden, worn * (0 if cells.beyond is None else cells.beyond)
        else:
            thing, worn = cells.in_front(*layers)
            is_moving = cells.is_object(thing) and cells.have_moved(thing, kept.thing)
            hidden = cells.lasting(thing, kept.thing)
            kept.thing = thing
        kept.due = memory.clock.now + (0.0 if is_moving else PAUSE_SECONDS)
        if seen.beside is not None and cells.beyond is not None:
            worn = np.maximum(worn, seen.beside.at(places)[:, 0] * cells.beyond)
        hidden = np.maximum(hidden, _steady(kept, worn, memory.clock.now - kept.parsed_at))
        return cells.on_reference(1 - hidden) if np.maximum.reduce(hidden) > MIN_SHARE else None

    def _find_rims(self, face: FaceInFrame, memory: Memory) -> None:
        if self._rims is not None:
            clock, since = memory.clock, memory.clock.now - memory.cover.parsed_at
            self._rims.see(memory.rims, face.frame.luma, face.head, face.parsing, clock.now, since)

    def _places_of_rims(self, factor: int) -> tuple[slice, MeshSampler, F32]:
        """Rows of a grid with so many pixels per grid pixel where rims may be, a sampler of them and their depths."""
        points = self._reference.points
        first, last = (
            points[BROWS, 1].min() - BROW_THICKNESS * self._reference.resolution,
            points[NOSE_TIP, 1],
        )
        rows = slice(max(int(first), 0) * factor, (int(last) + 1) * factor)
        ys, xs = np.mgrid[rows, : factor * self._reference.size[1]]
        places = (np.column_stack([xs.ravel(), ys.ravel()]) + 0.5) / factor - 0.5
        depth = Relief.shipped(self._reference).at(places)[:, None]
        return rows, MeshSampler.build(self._reference, places), depth


class Arms:
    """The arms of a person's glasses beside the face.   limits : where they are looked for."""

    def __init__(self, limits: ArmsLimits = ARMS) -> None:
        self._limits = limits

    def cover(self, face: FaceInFrame, memory: Memory) -> None:
        """Paint over the arms of glasses in the frame."""
        if memory.parsed is None or memory.parsed[0].shares[FaceClass.GLASSES].max() < self._limits.least:
            return
        (parsing, then), frame, head = memory.parsed, face.frame, face.head
        width, moved = float(np.ptp(head[:, 0])), mean(head - then, 0)
        for eye, sign in zip(OUTER_EYE_CORNERS, (-1, 1), strict=True):
            (x, y), out, reach = head[eye], sign * self._limits.aside * width, self._limits.reach * width
            x0, x1 = sorted((x - sign * reach, x + out))
            left, top, w, h = frame.align_roi(x0, y - reach, x1, y + reach)
            if min(w, h) < 2:
                continue
            here = parsing.from_place(*((left, top) - moved))
            shares = cv2.warpAffine(
                here.shares[FaceClass.GLASSES],
                here.to_cells,
                (w, h),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            )
            arms = (shares > self._limits.share).astype(np.uint8)
            if arms.any():
                part = np.ascontiguousarray(frame.read_yuv(left, top, w, h))
                made = cv2.inpaint(part, arms, self._limits.around * width, cv2.INPAINT_TELEA)
                frame.write_yuv(left, top, np.asarray(made, np.uint8))


class DonorGlasses:
    """The donor's glasses, over the drawn face of a person who wears none; hands and hair stay in front of them.

    reference : ReferenceFrame.
    """

    def __init__(self, glasses: GlassesOnHead, reference: ReferenceFrame) -> None:
        self._glasses, self._reference = glasses, reference

    def draw(self, face: FaceInFrame, memory: Memory) -> None:
        """Draw them into the frame."""
        worn, frame, across, at_rest = memory.rims.worn, face.frame, face.sight.across, face.sight.at_rest
        if at_rest is None or (worn is not None and worn > 0.5):
            return
        seen = at_rest @ self._reference.to_grid(face.head).inverse.linear
        front = self._glasses.front(seen + mean(face.mesh[STILL] - seen[STILL], 0), across)
        outline = self._glasses.outline(front, across)
        x, y, w, h = frame.align_roi(*(np.minimum.reduce(outline) - 1), *(np.maximum.reduce(outline) + 2))
        if w < 2 or h < 2:
            return
        change = self._shown(face, (x, y), (h, w)) * (self._glasses.ratio(front, across, (x, y), (h, w)) - 1)
        roi = frame.read_roi(x, y, w, h)
        lit = cv2.transform(roi, frame.colour.to_rgb) * (1 + change)[..., None]
        drawn = np.clip(cv2.transform(lit, frame.colour.from_rgb) + 0.5, 0, 255).astype(np.uint8)
        np.copyto(roi, drawn, where=(change != 0)[..., None])
        frame.write_roi(x, y, roi)

    def _shown(self, face: FaceInFrame, corner: tuple[int, int], size: tuple[int, int]) -> F32:
        """(h, w) share in [0, 1] of a rectangle of the frame that nothing hides."""
        parsing = face.parsed
        if parsing is None:
            return np.ones(size, np.float32)
        rows, columns = (np.linspace(0, side - 1, side // 4 + 2) for side in size)  # a cell is far larger
        places = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
        hidden = Layers.of(parsing, KINDS[:2]).at(places + corner - face.canvas.corner)
        shown = 1 - np.maximum.reduce(hidden, 1).reshape(len(rows), len(columns))
        return np.asarray(cv2.resize(shown, size[::-1]), np.float32)


class _Cells:
    """Places of the drawn face at which it is told what is in front: cells of a coarse grid."""

    def __init__(self, reference: ReferenceFrame, beyond: F32 | None, beard: F32 | None) -> None:
        self._reference, self._grid = reference, CoarseGrid(reference, CELL)
        height, width = self._grid.size
        cells = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
        places = cells * self._grid.cell
        self._sampler = MeshSampler.build(reference, places.astype(np.float64))
        self._depth = Relief.shipped(reference).at(places.astype(np.float64))
        x, y = np.minimum(np.round(places).astype(int), np.array(reference.size[::-1]) - 1).T
        self.beyond = None if beyond is None else beyond[y, x]
        around = soft_parts(reference, (RIGHT_BROW, LEFT_BROW, *EYES), GROWTH / 2)
        self._beard = None if beard is None or not beard.any() else beard[y, x]
        self._face = reference.mask[y, x].reshape(self._grid.size)
        self._area = int(self._face.sum())
        reach = 2 * round(LIMITS.rim_face_widths / CELL) + 1
        self._rim = self._face & (
            cv2.erode(np.pad(self._face.astype(np.uint8), 1), np.ones((reach, reach)))[1:-1, 1:-1] == 0
        )
        eyes, (mouth, nose) = soft_parts(reference, EYES, 0.0), reference.points[[UPPER_LIP_TOP, NOSE_TIP], 1]
        self._above_mouth = np.asarray(np.clip((mouth - y) / (mouth - nose), 0, 1), np.float32)
        self._weights = np.asarray([1 - around[y, x], 1 - eyes[y, x]], np.float32)  # of hair and of frames
        middle = 2 * reference.points[NOSE_ROOT, 0] / self._grid.cell
        self._mirrored = np.clip(np.round(middle - np.arange(width)).astype(int), 0, width - 1)
        reach = 2 * round(LIMITS.mirror_face_widths / CELL) + 1
        self._reach = np.ones((reach, reach), np.uint8)

    def read(self, face: FaceInFrame, layers: Layers) -> tuple[F32, F32]:
        """(n, 2) pixels of the frame, and what layers (k, n) have there."""
        maps, places = layers.hidden, np.empty((len(self._depth), 2), np.float32)
        shares, across = (
            np.empty((maps.shape[2], len(places)), np.float32),
            face.sight.across.astype(np.float32),
        )
        mesh = face.mesh, self._sampler.vertices, self._sampler.weights
        sample_cells(*mesh, self._depth, across, maps, layers.parsing.to_cells, places, shares)
        return places, shares

    def in_front(self, thing: F32, hair: F32, frame: F32, lens: F32) -> tuple[F32, F32]:
        """Shares (n,) of the cells that objects hide, and that hair and glasses do."""
        return thing, np.maximum(hair * self._weights[0], self.glasses(frame, lens))

    def glasses(self, frame: F32, lens: F32) -> F32:
        """Share (n,) of the cells that glasses hide: their frames beside the eyes, or lenses."""
        return self._on_both_sides(np.maximum(frame * self._weights[1], lens))

    def hair_reaching_in(self, hair: F32) -> F32:
        """Share (n,) of the cells that hair (n,) hides which reaches over the rim of the face, above the mouth."""
        hair = ramp(hair, LIMITS.hair_share)
        inside = (hair.reshape(self._grid.size) > MIN_SHARE) & self._face
        labels = _patches(inside)
        there = inside & _among(labels, labels[self._rim & inside])
        return (
            np.where((there | ~self._face).ravel(), hair * self._weights[0], np.float32(0))
            * self._above_mouth
        )

    def have_moved(self, thing: F32, before: F32 | None) -> bool:
        """Whether things that hide shares (n,) of the cells do not lie over the face as before."""
        if before is None:
            return True
        changed = np.count_nonzero(np.abs(thing - before) > LIMITS.still_share)
        return bool(changed > LIMITS.min_object_face_shares / 2 * self._area)

    def is_object(self, thing: F32) -> bool:
        """Whether the share (n,) of the cells that things hide is more than specks beside the face."""
        seen = thing > MIN_SHARE
        beside = np.count_nonzero(seen)
        return bool(beside > LIMITS.min_object_face_shares * self._area) or bool(
            np.logical_or.reduce(seen & self._face.ravel())
        )

    def lasting(self, thing: F32, before: F32 | None) -> F32:
        """The share (n,) that objects hide which reach over the rim of the face and were in front before (n,), too.

        What lies in the person's beard for the most part is that.
        """
        inside = thing.reshape(self._grid.size) > MIN_SHARE
        if not np.logical_or.reduce(inside & self._face, None):
            return np.where(self._face.ravel(), np.float32(0), thing)
        labels = _patches(inside & self._face)
        reaching = _among(labels, labels[self._rim & inside])
        if self._beard is not None:
            reaching &= (np.bincount(labels.ravel(), 1 - 2 * self._beard) > 0)[labels]
        if before is not None:
            there = (before > MIN_SHARE).reshape(self._grid.size)
            reaching &= _among(labels, labels[inside & there])
        return np.where((reaching & inside | ~self._face).ravel(), thing, np.float32(0))

    def reaching_in(self, thing: F32, hair: F32, hair_coloured: F32) -> tuple[F32, bool]:
        """The share (n,) that objects hide which reach over the rim of the face, and are no hair; whether there are."""
        inside = (thing.reshape(self._grid.size) > MIN_SHARE) & self._face
        _, labels, stats, _ = cv2.connectedComponentsWithStats(inside.astype(np.uint8))
        area = stats[:, cv2.CC_STAT_AREA]
        large = area > LIMITS.min_object_face_shares * self._area
        large[0] = False
        large &= np.bincount(labels.ravel(), hair) < LIMITS.max_hair_share * area
        large &= np.bincount(labels.ravel(), hair_coloured) < LIMITS.max_hair_coloured_share * area
        reaching = np.isin(labels, [n for n in np.unique(labels[self._rim]) if large[n]]).ravel()
        if not reaching.any():
            return 0 * thing, False
        return np.where(reaching | ~self._face.ravel(), thing, 0.0), True

    def on_reference(self, cells: F32) -> F32:
        """Shares (n,) of the cells on the reference grid (h, w)."""
        height, width = self._reference.size
        to_cells = np.array([[1 / self._grid.cell, 0, 0], [0, 1 / self._grid.cell, 0]])
        picture = cv2.warpAffine(
            cells.reshape(self._grid.size), to_cells, (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return np.asarray(picture, np.float32)

    def _on_both_sides(self, glasses: F32) -> F32:
        """The share (n,) of the cells without what has no counterpart: an eye in the shade is no glass."""
        other = cv2.dilate(glasses.reshape(self._grid.size)[:, self._mirrored], self._reach)
        return np.minimum(glasses, other.ravel())


@kernel
def sample_cells(
    points: F64,
    corners: Int,
    weights: F32,
    depth: F32,
    across: F32,
    maps: F32,
    to_cells: F64,
    places: F32,
    shares: F32,
) -> None:
    """Read maps (h, w, c) at places of a mesh, bilinearly, beyond their edges as at them.

    points, corners, weights : (v, 2) of the mesh, and (3, n) of the places, see `MeshSampler`.
    depth, across : (n,) of the places, and how far one moves for each unit of it (2,).
    to_cells : (2, 3) affine map from the mesh's pixels to the maps'.
    places, shares : (n, 2) pixels and (c, n), which are written.
    """
    places[:] = MeshSampler(corners, weights).positions(points) + depth[:, None] * across
    shares[:] = remap_points(maps, cv2.transform(places[None], to_cells)[0]).reshape(len(places), -1).T


def _patches(inside: Bool) -> I32:
    """(h, w) a number for each connected patch of what is inside, and 0 for the rest."""
    return np.asarray(cv2.connectedComponents(inside.view(np.uint8))[1], np.int32)


def _among(labels: I32, chosen: I32) -> Bool:
    """(h, w) whether labels are among those chosen (n,): numpy.isin by a table, several times as fast."""
    table = np.zeros(labels.size + 1, bool)
    table[chosen] = True
    return np.asarray(table[labels])


def _steady(kept: CoverMemory, worn: F32, since: float) -> F32:
    """The share (n,) of the cells that what comes and goes slowly hides, with memory."""
    if kept.worn is not None:
        worn = worn + np.float32(LIMITS.memory.over(since)) * (kept.worn - worn)
        worn *= worn >= LEAST  # what fades for ever gets too small to be multiplied quickly
    kept.worn = worn
    return worn


def _is_behind_lines(frame: Frame, head: F64) -> bool:
    """Whether bars, wires or letters are before a head (81, 2): what is between them is easily taken for an object."""
    x, y, w, h = frame.align_roi(*head.min(0), *head.max(0))
    if not w or not h:
        return False
    return bool(
        behind_lines(frame.rgb_roi(x, y, w, h), GLANCES.judged_face_pixels)[0].mean() >= GLANCES.lines_share
    )


def _have_moved(eyes: list[F32], before: list[F32]) -> bool:
    """Whether eyes look otherwise than before."""
    pairs = zip(eyes, before, strict=False)
    return any(mean(np.abs(now - then)) > LIMITS.eye_change for now, then in pairs)


def shown_mask(source: Bool, reference: ReferenceFrame) -> Bool:
    """Where a face is shown on the source's head (h, w): everywhere but over hair at the forehead and at the rim.

    Around the brows it is shown whatever the source's mask says, which takes the tails of dark or raised brows for
    hair; a fringe is kept in front frame by frame, see `Cover`.  Farther inside, below the brows, the source's mask
    doesn't count either: what it leaves out there (stubble, shadow, a lock of hair) would show the source's own face.
    The target needs no mask: its neutral face has skin where hair was.
    """
    inside = cv2.distanceTransform(np.pad(reference.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    below = np.arange(reference.size[0])[:, None] >= reference.points[BROW_TOPS, 1].mean()
    brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), BROW_THICKNESS) > 0.5
    inner = below & (inside > LIMITS.hair_rim_face_widths * reference.resolution)
    return np.asarray(reference.mask & (source | inner | brows))


def _hair_coloured(frame: Frame, parsing: FaceParsing) -> F32:
    """(64, 64) 1 in cells next to hair that have its colour rather than that of the skin; 0 if either is unknown."""
    side = parsing.shares.shape[1]
    cells = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(1, -1, 2)
    colours = frame.sample_rgb(cv2.transform(cells.astype(np.float64), parsing.to_picture)[0])
    away = []
    for part in (FaceClass.HAIR, FaceClass.SKIN):
        sure = colours[parsing.shares[part].ravel() > 0.5]
        if len(sure) < LIMITS.min_hair_cells:
            return np.zeros((side, side), np.float32)
        spread = np.maximum(sure.std(0), LIMITS.least_deviation)
        away.append(np.abs((colours - sure.mean(0)) / spread).max(1))
    hair, skin = away
    alike = (hair < LIMITS.hair_colour_deviations) & (hair < skin)
    locks = cv2.medianBlur(alike.reshape(side, side).astype(np.uint8), 3)
    sure_hair = parsing.shares[FaceClass.HAIR] > 0.5
    _, labels = cv2.connectedComponents(locks | sure_hair.astype(np.uint8))
    next_to_hair = np.bincount(labels.ravel(), sure_hair.ravel()) >= LIMITS.min_hair_cells
    return np.asarray(locks * next_to_hair[labels], np.float32)


def _even(colours: F32) -> F32:
    """Colours (n, 3) as shares of their mean brightness."""
    return np.asarray(colours / np.maximum(mean(colours), np.float32(1)))
