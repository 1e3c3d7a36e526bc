"""What each part of a face or of a head shows, and where the irises are, by small networks that ship with Guise.

`aam/data/face.onnx` and `head.onnx` are made by scripts in `training/`; `face.md` and `head.md` beside them say from
what data and how large the errors are.  A network sees an upright crop of 128 x 128 pixels about a face whose points
are known, and divides it into 64 x 64 cells.

Pixels, x right, y down, pixel centres at integers; images RGB uint8 (h, w, 3).  Not for several threads at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cache, cached_property
from typing import Protocol, TypeVar

import cv2
import numpy as np

from guise.aam.landmarks.builtin import CROP, cut
from guise.aam.landmarks.crops import upright_square
from guise.aam.landmarks.schemes import EYE_OUTLINES
from guise.aam.onnx_model import ShippedNetwork
from guise.common.arrays import F32, F64, U8, Floating
from guise.common.sampling import remap_points

CELLS = 64  # the side of the maps
CROP_PIXELS_PER_CELL = 2
_FIRST_CELL: F64 = np.full(2, (CROP_PIXELS_PER_CELL - 1) / 2)  # its middle, in pixels of the crop


@dataclass(frozen=True)
class SeenIrisLimits:
    """When an iris is seen."""

    min_opening_eye_widths: float = 0.17  # of the lids, below which an eye is shut
    max_offset_eye_widths: float = 0.6  # of an iris from the middle of the corners


LIMITS = SeenIrisLimits()


class FaceClass(IntEnum):
    """What a cell can show, in the order of the maps."""

    BACKGROUND = 0
    SKIN = 1
    BROWS = 2
    EYES = 3
    LIPS = 4
    INNER_MOUTH = 5
    HAIR = 6
    FACIAL_HAIR = 7
    GLASSES = 8
    OCCLUDER = 9


@dataclass(frozen=True)
class Framing:
    """What a crop shows, in longer sides of the box of the 81 points.

    side : of the crop.   drop : of its middle below the face's.
    """

    side: float
    drop: float = 0.0


FACE_FRAMING = Framing(CROP.side_head_boxes)
HEAD_FRAMING = Framing(2.5, 0.15)  # long hair reaches below

FACE_CLASSES = (
    FaceClass.SKIN, FaceClass.BROWS, FaceClass.EYES, FaceClass.LIPS, FaceClass.INNER_MOUTH, FaceClass.FACIAL_HAIR,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Parsing:
    """The maps of one face or head.

    shares : (10, 64, 64) float32, share in [0, 1] of each `FaceClass` in each cell; they sum to 1.
    to_picture : (2, 3) affine map from cells to pixels of the picture.
    """

    shares: F32
    to_picture: F64

    def share(self, *classes: FaceClass) -> F32:
        """(64, 64) share of all these classes together."""
        return np.asarray(np.add.reduce(self.shares[list(classes)]))

    def at(self, points: Floating, cells: F32, border: int = cv2.BORDER_CONSTANT) -> F32:
        """(n,) or (n, c) bilinear values, at points (n, 2) of the picture, of maps (64, 64, ...); 0 outside."""
        places = cv2.transform(np.asarray(points, np.float32)[None], self.to_cells)[0]
        return remap_points(cells, places, border)

    def from_place(self, x: float, y: float) -> Parsing:
        """The same in pixels of a part of the picture that begins at a place."""
        return Parsing(self.shares, self.to_picture - [[0, 0, x], [0, 0, y]])

    @cached_property
    def to_cells(self) -> F64:
        """(2, 3) affine map from pixels of the picture to cells."""
        return np.asarray(cv2.invertAffineTransform(self.to_picture), np.float64)


@dataclass(frozen=True, eq=False)
class FaceParsing(Parsing):
    """The maps of one face, and its irises.

    irises : (2, 4) float64: x, y, radius and standard deviation of the centre in pixels of the picture, of the
        person's right eye and of the left one.  Of a shut or hidden eye they are a guess.
    """

    irises: F64

    def open_irises(self, points: Floating) -> F64:
        """(2, 3) x, y and radius of the irises of a face with points (81, 2), pixels; NaN where the eye is shut."""
        irises = self.irises[:, :3].copy()
        for iris, (corners, upper, lower) in zip(irises, EYE_OUTLINES, strict=True):
            outer, inner = points[corners]
            width = float(np.linalg.norm(outer - inner))
            opening = float(np.linalg.norm(points[upper].mean(0) - points[lower].mean(0)))
            away = float(np.linalg.norm(iris[:2] - (outer + inner) / 2))
            if opening < LIMITS.min_opening_eye_widths * width or away > LIMITS.max_offset_eye_widths * width:
                iris[:] = np.nan
        return irises


Parsed = TypeVar("Parsed", bound=Parsing, covariant=True)


class Parser(Protocol[Parsed]):
    """Parses crops of one framing."""

    @property
    def framing(self) -> Framing:
        """What a crop shows."""

    def of_crop(self, crop: U8, to_picture: F64) -> Parsed:
        """The maps of a crop (128, 128, 3), given the map (2, 3) from its pixels to those of the picture."""


class FaceParser:
    """Parses faces whose points are known.

    Parameters
    ----------
    threads : of onnxruntime.
    """

    framing = FACE_FRAMING

    def __init__(self, threads: int = 1) -> None:
        self._session = session("face.onnx", threads)

    def parse(self, rgb: U8, points: Floating) -> FaceParsing:
        """The maps of the face with points (81, 2) in a picture."""
        centre, side, turn = upright_square(np.asarray(points, np.float64))
        return self.of_crop(*cut(rgb, centre, CROP.side_head_boxes * side, turn))

    def of_crop(self, crop: U8, to_picture: F64) -> FaceParsing:
        """The maps of a crop (128, 128, 3), given the map (2, 3) from its pixels to those of the picture."""
        iris, shares = self._session.run(["iris", "parsing"], {"crop": crop[None]})
        irises = iris[0].astype(np.float64)
        irises[:, :2] = irises[:, :2] @ to_picture[:, :2].T + to_picture[:, 2]
        irises[:, 2:] *= float(np.hypot(*to_picture[:, 0]))
        return FaceParsing(shares[0], _from_cells(to_picture), irises)


class HeadParser:
    """Parses heads whose face's points are known, with long hair and what is around them.

    threads : of onnxruntime.
    """

    framing = HEAD_FRAMING

    def __init__(self, threads: int = 1) -> None:
        self._session = session("head.onnx", threads)

    def of_crop(self, crop: U8, to_picture: F64) -> Parsing:
        """The maps of a crop (128, 128, 3), given the map (2, 3) from its pixels to those of the picture."""
        (shares,) = self._session.run(["parsing"], {"crop": crop[None]})
        return Parsing(shares[0], _from_cells(to_picture))


def _from_cells(to_picture: F64) -> F64:
    """The map (2, 3) from cells to pixels of the picture, given that from the crop's pixels to those."""
    linear, made = to_picture[:, :2], np.empty((2, 3))
    made[:, :2] = linear * CROP_PIXELS_PER_CELL
    made[:, 2] = linear @ _FIRST_CELL + to_picture[:, 2]
    return made


@cache
def session(name: str, threads: int) -> ShippedNetwork:
    """A network that ships with the package, which all parsers share: opening it takes as long as many passes."""
    return ShippedNetwork(name, threads)
