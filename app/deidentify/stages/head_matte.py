"""Where a head is in a picture: hair, ears and neck, without what is behind and below.

The parsing network tells roughly what is head; GrabCut (Rother, Kolmogorov and Blake, *GrabCut: interactive foreground
extraction using iterated graph cuts*, SIGGRAPH 2004) finds the edges in the picture.  Lengths are widths of the face,
about a place a little above its middle; x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from guise.aam.landmarks.schemes import CHIN, JAW
from guise.aam.model import RestFrame
from guise.aam.parsing import FaceClass, HeadParser, Parsing
from guise.app.drawing.face import parse_frame
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8, Bool

_HEAD = tuple(c for c in FaceClass if c not in (FaceClass.BACKGROUND, FaceClass.OCCLUDER))
Ellipse = tuple[float, float, float]  # half axes: aside, up, down
Roi = tuple[int, int, int, int]  # x0, y0, width and height of a rectangle in a picture


@dataclass(frozen=True)
class MatteLimits:
    """What is head for certain, likely, or not at all; shares are the parsing's."""

    still_face_pixels: float = 185.0  # width of the face at which a still is divided,
    face_pixels: float = 48.0  # and a frame
    rise: float = 0.1  # of the ellipses' middle from the face's
    head_share: float = 0.5
    sure_share: float = 0.85
    sure_ellipse: Ellipse = (0.6, 0.85, 0.9)
    sure_margin: float = 0.05  # of what is sure within what the parsing calls so
    likely_share: float = 0.55
    likely_ellipse: Ellipse = (0.72, 1.1, 1.2)
    likely_hair: float = 0.8  # anywhere
    possible_ellipse: Ellipse = (1.3, 1.5, 2.1)  # of long hair
    rim: float = 0.06  # of where a head can be
    short_ellipse: Ellipse = (0.8, 1.2, 9.0)  # beyond which only hair is head
    object_share: float = 0.5
    min_hair: float = 0.3
    neck: float = 0.1  # below the chin, beyond which only hair is head
    overlap: float = 0.04  # of a still's head with the neck, below the jaw,
    fade: float = 0.05  # over which it ends there
    beside: float = 0.2  # above the chin, where a neck begins beside the jaw,
    fade_beside: float = 0.15  # and over how much
    hair_fade: float = 0.25  # above the ends of long hair, likewise
    specks: float = 0.027  # narrower ones are no head
    edge: tuple[float, float] = (0.55, 0.95)  # of a soft edge, where the matte begins and is full
    strands: float = 0.008  # of an edge that follows the picture,
    strand_contrast: float = 0.03  # as far as it differs from what is behind it by this share of white
    sure_hair: float = 0.5  # of a pixel that goes in any case, beside the face, below and before the neck
    growth: float = 0.04  # of what goes
    iterations: int = 2  # of GrabCut
    min_pixels: int = 50  # on either side, with which there is something to divide


LIMITS = MatteLimits()
SOFT_CELLS = 3  # around a gap or a body, over which it ends


@dataclass(frozen=True, eq=False)
class FoundHead:
    """A head in a part of a picture, made smaller.

    mask : (h, w) whether a pixel shows the head.   hair, head, objects : (h, w) the parsing's shares of them.
    places : where its parts may be.   corner, scale : of the part in the picture, and small pixels per pixel there.
    """

    mask: Bool
    hair: F32
    head: F32
    objects: F32
    places: HeadPlaces
    corner: F64
    scale: float

    @property
    def hidden_share(self) -> float:
        """Share of the face that is behind objects; 1 where no face is in the picture."""
        face = self.places.face
        return float((self.objects[face] > LIMITS.object_share).mean()) if face.any() else 1.0

    def in_picture(self, values: F32 | Bool, roi: Roi) -> F32:
        """Values (h, w) of the small part in a rectangle of the picture."""
        return _in_picture(values, self.corner, self.scale, roi)


@dataclass(frozen=True, eq=False)
class Gap:
    """What a head leaves in a picture when it is taken away.

    cells : (h, w) of a part of the picture, made smaller; whether nothing that was there may be seen.
    body : (h, w) whether the person's neck or shoulder is there, which tells nothing of what was behind the head.
    corner, scale : of the part, as for a `FoundHead`.
    """

    cells: Bool
    body: Bool
    corner: F64
    scale: float

    @classmethod
    def of(cls, head: FoundHead) -> Gap:
        """The head and its hair, and a little around them; its neck stays."""
        hair = head.hair > LIMITS.sure_hair
        neck = head.places.neck & ~hair
        cells = (head.mask | (hair & head.places.low)) & ~neck
        side = 2 * round(LIMITS.growth * head.places.width) + 1
        grown = (cv2.dilate(cells.astype(np.uint8), np.ones((side, side), np.uint8)) > 0) & ~neck
        x, y, w, h = cv2.boundingRect(grown.astype(np.uint8))
        part = np.s_[y : y + h, x : x + w]
        body = (head.head > LIMITS.head_share) & ~grown
        return cls(grown[part], body[part], head.corner + np.array([x, y]) / head.scale, head.scale)

    def with_parts(self, cells: Bool, body: Bool, corner: F64, scale: float) -> Gap:
        """The same with other cells and more of the body, (h, w) of a picture smaller by a scale, from a corner."""
        low = np.minimum(self.corner, corner)
        at = np.ceil((self.corner - low) * self.scale).astype(int)
        low = self.corner - at / self.scale
        high = np.maximum(self.corners[1], corner + np.array(cells.shape[::-1]) / scale)
        w, h = np.ceil((high - low) * self.scale).astype(int)
        to_cells = np.column_stack([np.eye(2) * self.scale / scale, (corner - low) * self.scale])
        parts = np.dstack([cells, body]).astype(np.float32)
        more = cv2.warpAffine(parts, to_cells, (int(w), int(h)), flags=cv2.INTER_LINEAR) > 0.1
        part = np.s_[at[1] : at[1] + self.cells.shape[0], at[0] : at[0] + self.cells.shape[1]]
        more[part] |= np.dstack([self.cells, self.body])
        return Gap(more[..., 0], more[..., 1] & ~more[..., 0], low, self.scale)

    @property
    def corners(self) -> F64:
        """(2, 2) the first and last corner of the part in the picture."""
        return np.array([self.corner, self.corner + np.array(self.cells.shape[::-1]) / self.scale])

    def share(self, roi: Roi) -> F32:
        """(h, w) share in [0, 1] of each pixel of a rectangle that is not to be seen any more."""
        grown = np.pad(self.cells.astype(np.float32), SOFT_CELLS)
        soft = np.maximum(grown, cv2.GaussianBlur(grown, (0, 0), 1.0))
        return _in_picture(soft, self.corner - SOFT_CELLS / self.scale, self.scale, roi)

    def body_share(self, roi: Roi) -> F32:
        """(h, w) share in [0, 1] of each pixel of a rectangle that is body, or shaded by it."""
        square = np.ones((2 * SOFT_CELLS + 1,) * 2, np.uint8)
        near = cv2.dilate(np.pad(self.body.astype(np.uint8), SOFT_CELLS), square) > 0
        return _in_picture(near, self.corner - SOFT_CELLS / self.scale, self.scale, roi)


def _in_picture(values: F32 | Bool, corner: F64, scale: float, roi: Roi) -> F32:
    """Values (h, w) of a part of a picture, made smaller, in a rectangle of the picture; 0 beyond the part."""
    x0, y0, w, h = roi
    if not values.size:
        return np.zeros((h, w), np.float32)
    offset = (np.array([x0, y0]) + 0.5 - corner) * scale - 0.5
    to_small = np.column_stack([np.eye(2) * scale, offset])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(np.asarray(values, np.float32), to_small, (w, h), flags=flags), np.float32
    )


def find_head(parser: HeadParser, frame: Frame, shape: F64) -> FoundHead:
    """The head of the face at a shape (81, 2) in a frame, as the parsing tells it."""
    found = _looked_at(parser, frame, shape, LIMITS.face_pixels)
    likely = (found.head > LIMITS.head_share) & ~found.places.beyond(found.hair)
    return replace(found, mask=found.places.one_piece(likely))


def _looked_at(parser: HeadParser, frame: Frame, shape: F64, face_pixels: float) -> FoundHead:
    """Where a head may be, and what the parsing tells of it; face_pixels : width of the face as it is looked at."""
    width = max(float(np.ptp(shape[:, 0])), 1.0)
    centre = (shape.min(0) + shape.max(0)) / 2 - (0, LIMITS.rise * width)
    aside, up, down = (width * axis for axis in LIMITS.possible_ellipse)
    x0, y0, w, h = frame.align_roi(centre[0] - aside, centre[1] - up, centre[0] + aside, centre[1] + down)
    scale = min(1.0, face_pixels / width)
    size = max(2, round(w * scale)), max(2, round(h * scale))
    corner = np.array([x0, y0], np.float64)
    parsing = parse_frame(parser, frame, shape)
    shares = [parsing.share(*kinds) for kinds in ((FaceClass.HAIR,), _HEAD, (FaceClass.OCCLUDER,))]
    hair, head, objects = (_of_cells(s, parsing, corner, scale, size) for s in shares)
    seen = _of_cells(np.ones_like(parsing.shares[0]), parsing, corner, scale, size) > 0.5
    places = HeadPlaces((shape - corner + 0.5) * scale - 0.5, seen)
    return FoundHead(places.face, hair, head, objects, places, corner, scale)


def matte(parser: HeadParser, still: RestFrame) -> F32:
    """(h, w) share in [0, 1] of a still that is the head, with edges that hold nothing of what is behind it."""
    found = _looked_at(parser, Frame.from_rgb(still.picture), still.shape, LIMITS.still_face_pixels)
    (x0, y0), (small_height, small_width) = found.corner.astype(int), found.mask.shape
    part = still.picture[
        y0 : y0 + round(small_height / found.scale), x0 : x0 + round(small_width / found.scale)
    ]
    small = np.asarray(cv2.resize(part, (small_width, small_height), interpolation=cv2.INTER_AREA), np.uint8)
    ends = found.places.ends(found.hair)
    mask = _divided(small, found.places.seeds(found.hair, found.head)) & (ends > 0)
    soft = cv2.GaussianBlur(found.places.one_piece(mask) * ends, (0, 0), 1.0)
    height, width = still.picture.shape[:2]
    first, last = LIMITS.edge
    whole = found.in_picture(np.asarray(soft, np.float32), (0, 0, width, height))
    edge = np.asarray(np.clip((whole - first) / (last - first), 0, 1), np.float32)
    return np.minimum(_with_strands(edge, still.picture, LIMITS.strands * np.ptp(still.shape[:, 0])), whole)


def _with_strands(matte: F32, picture: U8, reach: float) -> F32:
    """A matte (h, w) whose edge, within a reach in pixels, follows the brightness of a picture (h, w, 3), as hair does.

    K. He, J. Sun and X. Tang, "Guided image filtering", ECCV 2010.
    """
    side = (2 * max(1, round(reach)) + 1,) * 2
    light = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    mean, share = cv2.blur(light, side), cv2.blur(matte, side)
    spread = cv2.blur(light * light, side) - mean * mean + LIMITS.strand_contrast**2
    slope = (cv2.blur(light * matte, side) - mean * share) / spread
    made = cv2.blur(slope, side) * light + cv2.blur(share - slope * mean, side)
    return np.asarray(np.clip(made, 0, 1), np.float32)


class HeadPlaces:
    """Where the parts of a head may be about a face's shape (81, 2) in a picture.

    seen : (h, w) whether a pixel of the picture has been looked at.
    """

    def __init__(self, shape: F64, seen: Bool) -> None:
        size = seen.shape
        self.width = max(float(np.ptp(shape[:, 0])), 1.0)
        self._middle = (shape.min(0) + shape.max(0)) / 2
        y, x = np.mgrid[: size[0], : size[1]]
        self._aside = (x - self._middle[0]) / self.width
        self._down = (y - self._middle[1]) / self.width + LIMITS.rise
        self._below_chin = (y - shape[CHIN][1]) / self.width
        self._possible = seen & self.within(LIMITS.possible_ellipse)
        face, jaw = np.zeros((2, *size), np.uint8)
        cv2.fillConvexPoly(face, cv2.convexHull(np.round(shape).astype(np.int32)), 1)
        cv2.fillPoly(jaw, [np.round(shape[JAW]).astype(np.int32)], 1)
        self.face = face > 0
        self.low = self._down > LIMITS.rise  # than the face's middle
        self.below_jaw = (np.cumsum(jaw, axis=0) > 0) & ~self.face

    def within(self, ellipse: Ellipse) -> Bool:
        """(h, w) whether a pixel lies in an ellipse."""
        aside, up, down = ellipse
        y = self._down / np.where(self._down < 0, up, down)
        return np.asarray((self._aside / aside) ** 2 + y**2 < 1)

    def rim(self) -> Bool:
        """(h, w) the edge of where a head can be, above the chin, but for the picture's own edges."""
        inner = cv2.erode(self._possible.astype(np.uint8), self._square(2 * LIMITS.rim)) > 0
        return np.asarray(self._possible & ~inner & (self._below_chin < 0))

    def beyond(self, hair: F32) -> Bool:
        """(h, w) where no head can be, given the parsing's share (h, w) of hair."""
        limits = LIMITS
        beyond = ~self._possible
        beyond |= ~self.within(limits.short_ellipse) & (hair < limits.min_hair) & (self._below_chin < 0)
        beyond |= (self._below_chin > limits.neck) & ~self._long_hair(hair)
        return np.asarray(beyond & ~self.face)

    def seeds(self, hair: F32, head: F32) -> U8:
        """(h, w) GrabCut's mask for the parsing's shares (h, w) of hair and of the head as a whole."""
        limits = LIMITS
        mask = np.full(hair.shape, cv2.GC_PR_BGD, np.uint8)
        likely = (head > limits.likely_share) & self.within(limits.likely_ellipse)
        mask[likely | (hair > limits.likely_hair)] = cv2.GC_PR_FGD
        core = cv2.erode((head > limits.sure_share).astype(np.uint8), self._square(limits.sure_margin)) > 0
        mask[(core & self.within(limits.sure_ellipse)) | self.face] = cv2.GC_FGD
        mask[self.beyond(hair)] = cv2.GC_BGD
        return mask

    def one_piece(self, found: Bool) -> Bool:
        """(h, w) of what was found, the piece with the face, without specks."""
        square = self._square(LIMITS.specks)
        solid = cv2.morphologyEx(found.astype(np.uint8), cv2.MORPH_OPEN, square)
        solid = cv2.morphologyEx(solid | self.face.astype(np.uint8), cv2.MORPH_CLOSE, square)
        _, labels = cv2.connectedComponents(solid)
        x, y = np.clip(np.round(self._middle), 0, np.array(found.shape[::-1]) - 1).astype(int)
        return np.asarray((labels == labels[y, x]) & (solid > 0))

    @property
    def neck(self) -> Bool:
        """(h, w) where a neck can be: below the jaw, no earlobe beside it."""
        return np.asarray(self.below_jaw & (self._below_chin > -LIMITS.beside))

    def ends(self, hair: F32) -> F32:
        """(h, w) share that is left where the head ends: at the neck, and at the ends of long hair."""
        away = cv2.distanceTransform((~self.face).astype(np.uint8), cv2.DIST_L2, 5) / self.width
        low = np.where(
            self.below_jaw, 1, np.clip((self._below_chin + LIMITS.beside) / LIMITS.fade_beside, 0, 1)
        )
        neck = 1 - low * np.clip((away - LIMITS.overlap) / LIMITS.fade, 0, 1)
        falling = np.clip((LIMITS.possible_ellipse[2] - self._down) / LIMITS.hair_fade, 0, 1)
        return np.asarray(np.where(self._long_hair(hair), falling, neck), np.float32)

    def _long_hair(self, hair: F32) -> Bool:
        """(h, w) where hair falls below the chin."""
        return np.asarray(hair > LIMITS.min_hair)

    def _square(self, share: float) -> U8:
        side = max(1, round(share * self.width))
        return np.ones((side, side), np.uint8)


def _of_cells(cells: F32, parsing: Parsing, corner: F64, scale: float, size: tuple[int, int]) -> F32:
    """The parsing's cells (64, 64) in a small picture of a size w, h."""
    to_small = parsing.to_picture * scale
    to_small[:, 2] += (0.5 - corner) * scale - 0.5
    return np.asarray(
        cv2.warpAffine(np.asarray(cells, np.float32), to_small, size, flags=cv2.INTER_LINEAR), np.float32
    )


def _divided(picture: U8, mask: U8) -> Bool:
    """(h, w) whether a picture shows the head, by what a mask tells of it."""
    likely = (mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD)
    if min(likely.sum(), (~likely).sum()) < LIMITS.min_pixels:
        return np.asarray(likely)
    cv2.setRNGSeed(0)  # of the models' first guess, so that all runs find the same
    behind, head = np.zeros((2, 1, 65))
    cv2.grabCut(picture, mask, (0, 0, 1, 1), behind, head, LIMITS.iterations, cv2.GC_INIT_WITH_MASK)
    return np.asarray((mask == cv2.GC_FGD) | (mask == cv2.GC_PR_FGD))
