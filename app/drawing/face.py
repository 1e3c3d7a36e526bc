"""One frame's face: where the head is and how it is seen, each computed once, and the canvas it is drawn on.

Pixels, x right, y down; texels are the places of the reference grid at which light and expression are measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from guise.aam.landmarks.builtin import SIZE, cut, upright_crop
from guise.aam.landmarks.crops import crop_to_picture, upright_square
from guise.aam.landmarks.rolls import upward
from guise.aam.parsing import FaceClass, FaceParsing, Parsed, Parser, Parsing
from guise.aam.relief import STRAIGHT
from guise.aam.solid_shape import HeadPose, Sight
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8, Floating
from guise.common.kernels import kernel
from guise.common.tuned import tuned

NOWHERE: F64 = np.zeros((0, 2))
NOTHING: F32 = np.zeros(0, np.float32)
BLANK: U8 = np.zeros((0, 0, 3), np.uint8)

# What several passes share.
# By which features are larger than the hulls of their points.
GROWTH = tuned(0.02, "face widths", "picture.truth")
# From a brow's points, down and up, to where skin is bare.
BROW_THICKNESS = tuned(0.05, "face widths", "picture.truth")
# About a brow's points, within which all of its hair lies, also while it rises.
BROW_REACH = tuned(0.09, "face widths", "picture.truth")
CELL = tuned(0.0125, "face widths", "picture.truth")  # between places at which a parsing is looked at
# Between places of what is smooth all over a face: light, and what a turned head shows of it.
COARSE_CELL = tuned(0.025, "face widths", "speed")
# Between two parsed frames while no object moves over the face.
PAUSE_SECONDS = tuned(0.1, "seconds", "speed")
# Of a painted iris, at which there is none, and all of it.
IRIS_BORDER = tuned((1.2, 0.96), "radii", "picture.identity")
FEATHER = tuned(0.02, "face widths", "picture.identity")  # standard deviation of a soft border
MIN_SHARE = tuned(0.02, "share", "picture.truth")  # that is seen at all
BLACK_GREY_LEVELS = tuned(4.0, "grey levels", "picture.truth")  # added before a ratio is taken


@dataclass(frozen=True, eq=False)
class Fold:
    """Where a texture is smoothed, as the mesh squeezes it, and where the mesh turns over.

    Parameters
    ----------
    place : of the part (h, w) of the grid with all of it.
    share : (h, w) in [0, 1] by which it is smoothed.
    side : pixels of the box that is averaged, twice.
    edges : (e, 2, 2) ends in the picture of the mesh's edges at which it turns over, where what lies behind begins.
    """

    place: tuple[slice, slice]
    share: F32
    side: int
    edges: F64


STRAIGHT_AHEAD = Sight(STRAIGHT, np.ones(1, np.float32))
STRAIGHT_POSE = HeadPose(np.eye(3), 1.0, np.zeros(2))


@dataclass(eq=False)
class Canvas:
    """What is drawn of a frame, from the first pass to the last.

    Parameters
    ----------
    texture : (n, 3) RGB of the drawn face, in the reference frame's mask pixels.
    planes : (3, n) the texture lit, in the frame's stored components, of which the first is brightness.
    picture : (h, w, 3) uint8, the same as a picture, as large as the grid, or twice that.
    contrast : scale of grey levels of the texture in the picture.
    share : (h, w) in [0, 1] of the face that is drawn, on the grid; None is all of it.
    rims : (h, w) share by which rims lie before the picture; None is nowhere.
    fine : whether the picture is twice as large as the grid.
    fold : where the mesh is folded; None is nowhere.
    mesh : (81 + k, 2) of the relief, pixels of the frame.
    roi, corner : the rectangle (h, w, 3) uint8 of the frame, and x, y where it begins.
    is_grey : whether the frame has no colour there.
    """

    texture: F32
    planes: F32 = field(default_factory=lambda: NOTHING)
    picture: U8 = field(default_factory=lambda: BLANK)
    contrast: float = 1.0
    share: F32 | None = None
    rims: F32 | None = None
    fine: bool = False
    fold: Fold | None = None
    mesh: F64 = field(default_factory=lambda: NOWHERE)
    roi: U8 = field(default_factory=lambda: BLANK)
    corner: tuple[int, int] = (0, 0)
    is_grey: bool = False

    @property
    def is_outside(self) -> bool:
        """Whether nothing of the face lies in the frame."""
        return not self.roi.size

    def cover(self, share: F32 | None) -> None:
        """Draw only a share (h, w) in [0, 1] of what would be; None is all of it."""
        if share is not None:
            self.share = share if self.share is None else np.asarray(self.share * share, np.float32)


@dataclass(frozen=True, eq=False)
class Layers:
    """How far each kind of thing hides the cells (64, 64, k) of a parsed frame."""

    parsing: Parsing
    hidden: F32

    @classmethod
    def of(cls, parsing: Parsing, kinds: Sequence[tuple[FaceClass, tuple[float, float]]]) -> Layers:
        """Of kinds, each a class and the shares of it that hide nothing and all."""
        maps = cv2.merge([ramp(parsing.shares[kind], ends) for kind, ends in kinds])
        return cls(parsing, np.asarray(maps, np.float32).reshape(*parsing.shares.shape[1:], len(kinds)))

    def with_map(self, one: F32) -> Layers:
        """And one more map (64, 64)."""
        return Layers(self.parsing, np.asarray(cv2.merge([self.hidden, one]), np.float32))

    def without(self, share: F32) -> Layers:
        """Nothing where a share (64, 64) is 1."""
        return Layers(self.parsing, self.hidden * (1 - share)[..., None])

    def at(self, points: Floating) -> F32:
        """(n, k) at points (n, 2) of the picture; beyond what was parsed as at its edge, where hair goes on."""
        return self.parsing.at(points, self.hidden, cv2.BORDER_REPLICATE)


def ramp(shares: F32, ends: tuple[float, float]) -> F32:
    """0 up to the first end, 1 from the second, linear between them."""
    return np.asarray(np.minimum(np.maximum((shares - ends[0]) / (ends[1] - ends[0]), 0), 1), np.float32)


@dataclass(eq=False)
class Seen:
    """What a frame shows of the head at the texels.

    places : (t, 2) pixels.   rgb : (t, 3) there.   clear : (t, 3) the same without what is in front of the face.
    visible : (t,) share in [0, 1] of each that nothing hides; None is all of it.
    parameters : (k,) of the head's appearance.
    layers, beside : of a frame that was parsed: what hides the face, and background beside the head.
    """

    places: F32 = field(default_factory=lambda: NOTHING)
    rgb: F32 = field(default_factory=lambda: NOTHING)
    clear: F32 = field(default_factory=lambda: NOTHING)
    visible: F32 | None = None
    parameters: F32 = field(default_factory=lambda: NOTHING)
    layers: Layers | None = None
    beside: Layers | None = None

    def __bool__(self) -> bool:
        """Whether there is anything."""
        return self.rgb.size > 0


@dataclass(eq=False)
class FaceInFrame:
    """A face in a frame, which the passes complete one after the other.

    Parameters
    ----------
    frame : Frame, which is drawn on in place.
    pose : how the head is turned.
    found : (81, 2) pixels, the head's points as tracked.
    head : (81, 2) the same, with brows and lids as the frame shows them.
    sight : how the drawn face is seen.
    seen : at the texels; empty where a face is held that isn't found.
    parsing : of the frame; None if it wasn't parsed.
    parsed : the last parsing, moved along with the head, in pixels of the canvas's rectangle.
    shape : (81, 2) grid pixels, the drawn face.
    mesh, zoom : (81, 2) where it is drawn, and pixels per grid pixel there.
    canvas : what is drawn.
    """

    frame: Frame
    found: F64
    head: F64
    pose: HeadPose = STRAIGHT_POSE
    sight: Sight = STRAIGHT_AHEAD
    seen: Seen = field(default_factory=Seen)
    parsing: FaceParsing | None = None
    parsed: Parsing | None = None
    shape: F64 = field(default_factory=lambda: NOWHERE)
    mesh: F64 = field(default_factory=lambda: NOWHERE)
    zoom: float = 1.0
    canvas: Canvas = field(default_factory=lambda: Canvas(NOTHING))


def parse_frame(parser: Parser[Parsed], frame: Frame, shape: F64) -> Parsed:
    """Parse the face or head at a shape (81, 2) of a frame, of which only its surroundings are converted."""
    centre, side, turn = upright_square(shape)
    centre = centre - parser.framing.drop * side * upward(turn)
    side *= parser.framing.side
    to_picture = crop_to_picture(centre, side, turn, (SIZE, SIZE))
    corners = np.array([[0, 0], [SIZE, 0], [0, SIZE], [SIZE, SIZE]]) - 0.5
    reached = corners @ to_picture[:, :2].T + to_picture[:, 2]
    low, high = np.minimum.reduce(reached), np.maximum.reduce(reached)
    planes, margin = frame.shown_planes(), 2 * side / SIZE + 4
    if (
        planes is not None
        and (low > margin).all()
        and (high < (frame.width - margin, frame.height - margin)).all()
    ):
        crop = np.empty((SIZE, SIZE, 3), np.uint8)
        upright_planes(*planes, frame.colour.to_rgb, to_picture, crop)
        return parser.of_crop(crop, to_picture)
    x0, y0, w, h = frame.align_roi(*(low - 1), *(high + 2))
    if w < 2 or h < 2:
        return parser.of_crop(np.zeros((SIZE, SIZE, 3), np.uint8), to_picture)
    crop, _ = cut(frame.rgb_roi(x0, y0, w, h), centre - (x0, y0), side, turn)
    return parser.of_crop(crop, to_picture)


@kernel
def upright_planes(
    luma: U8, first: U8, second: U8, to_chroma: F64, to_rgb: F32, to_picture: F64, crop: U8
) -> None:
    """Cut a part, which lies within, out of a picture of brightness (h, w) and chroma (i, j), as RGB.

    to_chroma : (4,) scales of places, after the last two are taken off.   to_rgb : (3, 4) of the components.
    to_picture : (2, 3) similarity from the pixels of the crop to the picture's.   crop : (y, x, 3), which is written.
    """
    to_cells, parts = (to_picture - [[0, 0, to_chroma[2]], [0, 0, to_chroma[3]]]) * to_chroma[:2, None], []
    for plane, place in ((luma, to_picture), (first, to_cells), (second, to_cells)):
        upright_crop(plane[..., None], place, crop)
        parts.append(crop[..., 0].copy())
    crop[:] = cv2.transform(cv2.merge(parts), to_rgb)
