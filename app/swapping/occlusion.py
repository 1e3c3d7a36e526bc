"""What hides the source's face in a frame: hands and other objects, hair, glasses.

The frame is parsed (`guise.aam.parsing`), and what is in front of the face is read where the drawn face's mesh lies.
There the frame's own pixels stay, and neither light nor expression is measured.  While nothing but hair and glasses is
in front, or nothing in front moves, and the eyes rest, only some frames are parsed; what was found moves along with the
face.

Where no part of the person may show, only objects stay in front, and only those that reach in from beyond the face, as
hands and mugs do: a patch within it that is taken for an object may be skin.  A lock of hair, which is easily
taken for an object or for background, is told by its colour: that of the rest of the hair.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.builtin import SIZE, cut
from guise.aam.landmarks.crops import crop_to_picture, upright_square
from guise.aam.landmarks.rolls import upward
from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, LEFT_EYE, NOSE_ROOT, NOSE_TIP, RIGHT_BROW, RIGHT_EYE
from guise.aam.mask import soft_parts
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing, Parsed, Parser
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import STRAIGHT, Relief
from guise.app.media import Frame
from guise.app.swapping.coarse_grid import CoarseGrid
from guise.app.swapping.rims import Rims
from guise.common.arrays import F32, F64, Floating


@dataclass(frozen=True)
class OcclusionLimits:
    """Widths, thresholds and memory.

    Each share is a pair: that of a class up to which the drawn face is whole, and that from which it is gone.
    """

    cell_face_widths: float = 0.0125
    object_share: tuple[float, float] = (0.15, 0.45)
    sure_object_share: tuple[float, float] = (0.35, 0.65)  # where no part of the person may show
    min_object_face_shares: float = 0.01  # of an object there, and of one beside the face, of the face
    max_hair_share: float = (
        0.1  # of such an object: that of a hand or mug is a fiftieth, of hair taken for one a fifth
    )
    max_hair_coloured_share: float = 0.5  # of such an object, of what has the hair's colour
    hair_colour_deviations: float = 2.5  # from the mean of the hair, within which a colour is the hair's
    least_deviation: float = 2.0  # grey levels
    min_hair_cells: int = 40  # of the parsing, from which the hair's and the skin's colours are known
    rim_face_widths: float = 0.03  # of the face, which such an object reaches
    hair_share: tuple[float, float] = (0.5, 0.85)
    background_share: tuple[float, float] = (0.5, 0.85)  # beyond the person's own face
    frame_share: tuple[float, float] = (0.2, 0.5)  # of glasses, beside the eyes
    lens_share: tuple[float, float] = (0.7, 0.95)  # of glasses, dark ones, before the eyes
    mirror_face_widths: float = 0.04  # within which glasses must be seen on the other side of the face, too
    memory: float = (
        0.7  # share of hair and glasses kept from one parsed frame to the next; objects come and go
    )
    pause_frames: int = (
        2  # between two parsed frames while no object is in front, or none that moves over the face
    )
    still_share: float = 0.2  # change of a share up to which it is still
    still_face_shares: float = 0.005  # of an object's cells that change more while it is still, of the face
    eye_change: float = 0.04  # mean change of an eye's texels, of their mean, from which it moves
    growth_face_widths: float = 0.01  # around brows and eyes, where hair doesn't count
    min_hidden: float = 0.02  # share from which something is in front


LIMITS = OcclusionLimits()
KINDS = (
    (FaceClass.OCCLUDER, LIMITS.object_share),
    (FaceClass.HAIR, LIMITS.hair_share),
    (FaceClass.GLASSES, LIMITS.frame_share),
    (FaceClass.GLASSES, LIMITS.lens_share),
)
SURE_KINDS = (
    (FaceClass.OCCLUDER, LIMITS.object_share),
    (FaceClass.OCCLUDER, LIMITS.sure_object_share),
    (FaceClass.HAIR, (0.0, 1.0)),
)
RIM_MARGIN = 0.05  # face widths above the brows, up to which rims of glasses may reach
BESIDE = (FaceClass.BACKGROUND, LIMITS.background_share)


class Occlusion:
    """Measured frame by frame; what is worn is smooth in time.

    Parameters
    ----------
    reference : ReferenceFrame.
    texels : sampler of the places at which light and expression are measured.
    only_objects : hair, glasses and whatever lies wholly within the face don't stay in front.
    beyond : (h, w) share in [0, 1] by which what is drawn lies beyond the person's own face: no background there is
        drawn over.

    Attributes
    ----------
    parsing : of the last frame; None if it wasn't parsed.
    """

    def __init__(
        self, reference: ReferenceFrame, texels: MeshSampler, *, only_objects: bool = False,
        beyond: F32 | None = None,
    ) -> None:  # fmt: skip
        self._reference, self._texels = reference, texels
        self._only_objects = only_objects
        self._kinds = SURE_KINDS if only_objects else KINDS
        self._parser = FaceParser()
        self._grid = CoarseGrid(reference, LIMITS.cell_face_widths)
        height, width = self._grid.size
        cells = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
        places = cells * self._grid.cell
        self._cells = MeshSampler.build(reference, places.astype(np.float64))
        self._depth = Relief.shipped(reference).at(places.astype(np.float64))[:, None]
        eyes = (RIGHT_EYE, LEFT_EYE)
        x, y = np.minimum(np.round(places).astype(int), np.array(reference.size[::-1]) - 1).T
        self._beyond = None if beyond is None else beyond[y, x]
        around = soft_parts(reference, (RIGHT_BROW, LEFT_BROW, *eyes), LIMITS.growth_face_widths)
        self._hair_weight = np.asarray(1 - around[y, x], np.float32)
        self._face = reference.mask[y, x].reshape(self._grid.size)
        reach = 2 * round(LIMITS.rim_face_widths / LIMITS.cell_face_widths) + 1
        self._rim = self._face & (
            cv2.erode(np.pad(self._face.astype(np.uint8), 1), np.ones((reach, reach)))[1:-1, 1:-1] == 0
        )
        self._frame_weight = np.asarray(1 - soft_parts(reference, eyes, 0.0)[y, x], np.float32)
        x, y = np.round(texels.positions(reference.points)).astype(int).T
        in_eyes = (np.flatnonzero(soft_parts(reference, (eye,), 0.0)[y, x] > 0.5) for eye in eyes)
        self._in_eyes = [some for some in in_eyes if len(some)]
        middle = 2 * reference.points[NOSE_ROOT, 0] / self._grid.cell
        self._mirrored = np.clip(np.round(middle - np.arange(width)).astype(int), 0, width - 1)
        reach = 2 * round(LIMITS.mirror_face_widths / LIMITS.cell_face_widths) + 1
        self._reach = np.ones((reach, reach), np.uint8)
        self._rims = None if only_objects else Rims()
        self._rim_places: dict[int, tuple[slice, MeshSampler, F32]] = {}
        self.reset()

    def reset(self) -> None:
        """Measure the next frame without memory."""
        self._layers: _Layers | None = None  # of the last parsed frame, until it is drawn
        self._beside: _Layers | None = None
        self.parsing: FaceParsing | None = None
        self._pause_frames = 0
        self._eyes: list[F32] = []  # as they looked in the last parsed frame
        self._worn: F32 | None = None
        self._thing: F32 | None = None
        self._uncovered: F32 | None = None
        self._visible: F32 | None = None
        self._clear: F32 | None = None
        if self._rims is not None:
            self._rims.reset()

    @property
    def visible(self) -> F32 | None:
        """(t,) share in [0, 1] by which each texel counts as the source's face; None before the first frame."""
        return self._visible

    @property
    def last_uncovered(self) -> F32 | None:
        """What `uncovered` has returned last."""
        return self._uncovered

    def update(self, frame: Frame, shape: F64, places: F32 | None = None, seen: F32 | None = None) -> None:
        """Look at a frame in which the face lies at a shape (81, 2), and the texels at places (t, 2).

        By default the texels lie on the shape's triangles.

        seen : the frame's RGB (t, 3) at the texels, if it matters whether the eyes move.
        """
        self.parsing = None
        eyes = [] if seen is None else [_even(seen[eye]) for eye in self._in_eyes]
        if self._pause_frames and not self._have_moved(eyes):
            self._pause_frames -= 1
            self._look_for_rims(frame, shape)
            return
        self._eyes = eyes
        parsing = self.parsing = parse_frame(self._parser, frame, shape)
        self._layers = _Layers.of(parsing, self._kinds)
        self._beside = None if self._beyond is None else _Layers.of(parsing, (BESIDE,))
        places = self._texels.positions(shape) if places is None else places
        self._visible = 1 - np.max(self._layers.at(places), axis=1)
        if self._only_objects:  # a beard has the hair's colour, too, and is seen
            is_needed = self._beside is not None or self._layers.hidden[..., 0].any()
            hair = _hair_coloured(frame, parsing) if is_needed else np.zeros_like(parsing.shares[0])
            self._layers = self._layers.with_map(hair)
            self._beside = self._beside and self._beside.without(hair)
        self._look_for_rims(frame, shape)
        if self._rims is not None and self._rims.seen:
            self._visible *= 1 - self._rims.at(places)

    def cleared(self, seen: F32) -> F32:
        """The frame's RGB (t, 3) at the texels; where something is in front, what was seen there before."""
        if self._clear is None or self._visible is None:
            self._clear = seen
        else:
            self._clear = self._clear + self._visible[:, None] * (seen - self._clear)
        return self._clear

    def uncovered(self, mesh: F64, across: F64 = STRAIGHT) -> F32 | None:
        """(h, w) share in [0, 1] of the drawn face that nothing hides, on the reference grid; None is all of it.

        mesh : (81, 2) pixels, where the face is drawn.   across : see `View`.
        Until another frame is parsed it's the same array.
        """
        if self._layers is None:
            return self._uncovered
        places = self._cells.positions(mesh) + self._depth * across.astype(np.float32)
        layers = self._layers.at(places).T
        self._layers = None
        hidden = self._reaching_in(*layers[1:]) if self._only_objects else self._in_front(*layers)
        if self._beside is not None and self._beyond is not None:
            hidden = np.maximum(hidden, self._steady(self._beside.at(places)[:, 0] * self._beyond))
        self._uncovered = self._on_reference(1 - hidden) if hidden.max() > LIMITS.min_hidden else None
        return self._uncovered

    def rims(self, mesh: F64, across: F64, factor: int) -> F32 | None:
        """(factor h, factor w) share in [0, 1] of the drawn face before which there are rims of glasses; None is none.

        mesh, across : see `uncovered`.   factor : pixels per grid pixel, along each axis.
        """
        if self._rims is None or not self._rims.seen:
            return None
        if factor not in self._rim_places:
            self._rim_places[factor] = self._places_of_rims(factor)
        rows, sampler, depth = self._rim_places[factor]
        h, w = np.multiply(self._reference.size, factor)
        share = np.zeros((h, w), np.float32)
        places = sampler.positions(mesh) + depth * across.astype(np.float32)
        share[rows] = self._rims.at(places).reshape(-1, w)
        return share

    def _places_of_rims(self, factor: int) -> tuple[slice, MeshSampler, F32]:
        """Rows of a grid with so many pixels per grid pixel where rims may be, a sampler of them and their depths."""
        points = self._reference.points
        first, last = points[BROWS, 1].min() - RIM_MARGIN * self._reference.resolution, points[NOSE_TIP, 1]
        rows = slice(max(int(first), 0) * factor, (int(last) + 1) * factor)
        ys, xs = np.mgrid[rows, : factor * self._reference.size[1]]
        places = (np.column_stack([xs.ravel(), ys.ravel()]) + 0.5) / factor - 0.5
        depth = Relief.shipped(self._reference).at(places)[:, None]
        return rows, MeshSampler.build(self._reference, places), depth

    def _look_for_rims(self, frame: Frame, shape: F64) -> None:
        if self._rims is not None:
            self._rims.see(frame.luma, shape, self.parsing)

    def _in_front(self, thing: F32, hair: F32, frame: F32, lens: F32) -> F32:
        """The share (n,) of the cells that anything hides."""
        glasses = self._on_both_sides(np.maximum(frame * self._frame_weight, lens))
        worn = self._steady(np.maximum(hair * self._hair_weight, glasses))
        moving = self._is_object(thing) and self._has_moved(thing)
        self._pause_frames = 0 if moving else LIMITS.pause_frames
        self._thing = thing
        return np.maximum(thing, worn)

    def _steady(self, worn: F32) -> F32:
        """The share (n,) of the cells that what comes and goes slowly hides, with memory."""
        self._worn = worn if self._worn is None else worn + np.float32(LIMITS.memory) * (self._worn - worn)
        return self._worn

    def _have_moved(self, eyes: list[F32]) -> bool:
        """Whether eyes look otherwise than in the last parsed frame."""
        pairs = zip(eyes, self._eyes, strict=False)
        return any(float(np.abs(now - then).mean()) > LIMITS.eye_change for now, then in pairs)

    def _has_moved(self, thing: F32) -> bool:
        """Whether things that hide shares (n,) of the cells do not lie over the face as in the last parsed frame."""
        if self._thing is None:
            return True
        changed = np.count_nonzero(np.abs(thing - self._thing) > LIMITS.still_share)
        return bool(changed > LIMITS.still_face_shares * self._face.sum())

    def _is_object(self, thing: F32) -> bool:
        """Whether the share (n,) of the cells that things hide is more than specks beside the face."""
        seen = thing > LIMITS.min_hidden
        beside = np.count_nonzero(seen)
        return beside > LIMITS.min_object_face_shares * self._face.sum() or bool(
            seen[self._face.ravel()].any()
        )

    def _reaching_in(self, thing: F32, hair: F32, hair_coloured: F32) -> F32:
        """The share (n,) of the cells that objects hide which reach over the rim of the face, and are no hair."""
        inside = (thing.reshape(self._grid.size) > LIMITS.min_hidden) & self._face
        _, labels, stats, _ = cv2.connectedComponentsWithStats(inside.astype(np.uint8))
        large = stats[:, cv2.CC_STAT_AREA] > LIMITS.min_object_face_shares * self._face.sum()
        large[0] = False
        area = stats[:, cv2.CC_STAT_AREA]
        large &= np.bincount(labels.ravel(), hair) < LIMITS.max_hair_share * area
        large &= np.bincount(labels.ravel(), hair_coloured) < LIMITS.max_hair_coloured_share * area
        reaching = np.isin(labels, [n for n in np.unique(labels[self._rim]) if large[n]])
        self._pause_frames = 0 if reaching.any() else LIMITS.pause_frames
        return np.where(reaching.ravel() | ~self._face.ravel(), thing, 0.0) if reaching.any() else 0 * thing

    def _on_both_sides(self, glasses: F32) -> F32:
        """The share (n,) of the cells without what has no counterpart: an eye in the shade is no glass."""
        other = cv2.dilate(glasses.reshape(self._grid.size)[:, self._mirrored], self._reach)
        return np.minimum(glasses, other.ravel())

    def _on_reference(self, cells: F32) -> F32:
        height, width = self._reference.size
        to_cells = np.array([[1 / self._grid.cell, 0, 0], [0, 1 / self._grid.cell, 0]])
        picture = cv2.warpAffine(
            cells.reshape(self._grid.size), to_cells, (width, height),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return np.clip(picture, 0, 1)


@dataclass(frozen=True, eq=False)
class _Layers:
    """How far each kind of thing hides the cells (64, 64, k) of a parsed frame."""

    parsing: FaceParsing
    hidden: F32

    @classmethod
    def of(cls, parsing: FaceParsing, kinds: Sequence[tuple[FaceClass, tuple[float, float]]]) -> _Layers:
        return cls(parsing, np.dstack([_ramp(parsing.shares[kind], ends) for kind, ends in kinds]))

    def with_map(self, one: F32) -> _Layers:
        """And one more map (64, 64)."""
        return _Layers(self.parsing, np.dstack([self.hidden, one]))

    def without(self, share: F32) -> _Layers:
        """Nothing where a share (64, 64) is 1."""
        return _Layers(self.parsing, self.hidden * (1 - share)[..., None])

    def at(self, points: Floating) -> F32:
        """(n, k) at points (n, 2) of the picture."""
        return self.parsing.at(points, self.hidden)


def parse_frame(parser: Parser[Parsed], frame: Frame, shape: F64) -> Parsed:
    """Parse the face or head at a shape (81, 2) of a frame, of which only its surroundings are converted."""
    centre, side, turn = upright_square(shape)
    centre = centre - parser.framing.drop * side * upward(turn)
    side *= parser.framing.side
    to_picture = crop_to_picture(centre, side, turn, (SIZE, SIZE))
    corners = np.array([[0, 0], [SIZE, 0], [0, SIZE], [SIZE, SIZE]]) - 0.5
    reached = corners @ to_picture[:, :2].T + to_picture[:, 2]
    x0, y0, w, h = frame.align_roi(*(reached.min(0) - 1), *(reached.max(0) + 2))
    if w < 2 or h < 2:
        return parser.of_crop(np.zeros((SIZE, SIZE, 3), np.uint8), to_picture)
    crop, _ = cut(frame.rgb_roi(x0, y0, w, h), centre - (x0, y0), side, turn)
    return parser.of_crop(crop, to_picture)


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
    return np.asarray(colours / np.maximum(colours.mean(), np.float32(1)))


def _ramp(shares: F32, ends: tuple[float, float]) -> F32:
    """0 up to the first end, 1 from the second, linear between them."""
    return np.asarray(np.clip((shares - ends[0]) / (ends[1] - ends[0]), 0, 1), np.float32)
