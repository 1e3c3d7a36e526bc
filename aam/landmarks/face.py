"""What every landmark source gives and takes: a face, a landmarker, a box detector.

Pixels, x right, y down, pixel centres at integers; images RGB uint8 (h, w, 3). Landmarks are in scheme
``face81`` (see :mod:`guise.aam.landmarks.schemes`) and never rounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F32, U8
from guise.common.errors import GuiseError


class LandmarkError(GuiseError):
    """A user's mistake about landmarks, in one sentence: what was expected, what was got, what to do."""


class NoFaceError(LandmarkError):
    """Landmarks of a clip that hold no face."""


def frozen(array: Any) -> F32:
    """Read-only float32 copy of an array-like; the caller's array stays writable."""
    copy = np.array(array, dtype=np.float32)
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True, eq=False)
class Face:
    """One face in one picture.

    Parameters
    ----------
    points : (81, 2) float32
        Landmarks in scheme ``face81``, pixels; kept read-only.
    confidence : float
        In [0, 1]: how much the points look like a face that was really found.
    box : (4,) float32
        ``x0 y0 x1 y1``, pixels. The landmarkers here give the tight box of the points.
    point_confidence : (81,) float32, optional
        In [0, 1] per point, from landmarkers that know it.

    Examples
    --------
    >>> face = Face.around(np.random.default_rng(0).random((81, 2)), confidence=0.5)
    >>> face.points.dtype, face.box.shape
    (dtype('float32'), (4,))
    """

    points: F32
    confidence: float
    box: F32
    point_confidence: F32 | None = None

    def __post_init__(self) -> None:
        """Check shapes and take read-only copies."""
        object.__setattr__(self, "points", _checked("points", self.points, (81, 2)))
        object.__setattr__(self, "box", _checked("box", self.box, (4,)))
        if self.point_confidence is not None:
            checked = _checked("point_confidence", self.point_confidence, (81,))
            object.__setattr__(self, "point_confidence", checked)
        if not 0.0 <= self.confidence <= 1.0:
            raise ValueError(f"confidence must be in [0, 1], got {self.confidence}")

    @classmethod
    def around(cls, points: Any, confidence: float, point_confidence: F32 | None = None) -> Face:
        """Face whose box is the tight box of ``points`` (81, 2)."""
        return cls(points, confidence, tight_box(np.asarray(points)), point_confidence)

    @property
    def area(self) -> float:
        """Area of the box, square pixels."""
        return float((self.box[2] - self.box[0]) * (self.box[3] - self.box[1]))


@runtime_checkable
class Landmarker(Protocol):
    """Finds the faces of a picture and their 81 points."""

    @property
    def name(self) -> str:
        """Short name for reports."""
        ...

    def detect(self, rgb: U8) -> list[Face]:
        """All faces, largest box first; an empty list when there are none."""
        ...

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The face of the frame before, found again from its points without detection; None when lost."""
        ...


@runtime_checkable
class BoxDetector(Protocol):
    """Finds face boxes."""

    @property
    def name(self) -> str:
        """Short name for reports; the key of a card's ``[box.NAME]`` table."""
        ...

    @property
    def fit(self) -> BoxFit:
        """How a landmark box (of the iBUG 68 points) follows from this detector's boxes."""
        ...

    def detect(self, image: U8) -> F32:
        """Boxes (n, 4), ``x0 y0 x1 y1`` pixels, largest first; image RGB (h, w, 3) or grey (h, w)."""
        ...

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) as in :meth:`detect` and their scores (n,) in [0, 1]."""
        ...


@dataclass(frozen=True)
class BoxFit:
    """Square landmark box from a detector's box.

    With side = the longer side of the detector's box, the landmark box has side ``scale * side`` and its
    centre is moved by ``shift * side`` (x right, y down).

    Examples
    --------
    >>> BoxFit(0.5, (0.0, 0.25)).apply(np.array([0, 0, 8, 8]))
    array([2., 4., 6., 8.], dtype=float32)
    """

    scale: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)

    def apply(self, box: NDArray[Any], turn: float = 0.0) -> F32:
        """Square box (4,) ``x0 y0 x1 y1`` from a detector's box (4,) of a face rolled clockwise by `turn`, radians."""
        corners = np.asarray(box, dtype=np.float64)
        side = float(max(corners[2] - corners[0], corners[3] - corners[1]))
        cos, sin = np.cos(turn), np.sin(turn)
        centre = (corners[:2] + corners[2:]) / 2 + side * (np.array([[cos, -sin], [sin, cos]]) @ self.shift)
        half = self.scale * side / 2
        return np.concatenate([centre - half, centre + half]).astype(np.float32)


def tight_box(points: NDArray[Any]) -> F32:
    """Smallest box (4,) ``x0 y0 x1 y1`` that holds points (n, 2), pixels."""
    return np.concatenate([np.minimum.reduce(points), np.maximum.reduce(points)]).astype(np.float32)


def iou(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Intersection over union of two boxes (4,).

    Examples
    --------
    >>> round(iou(np.array([0, 0, 2, 2]), np.array([1, 0, 3, 2])), 3)
    0.333
    """
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    shared = float(width * height)
    return shared / (float((a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1])) - shared)


def _checked(name: str, value: Any, shape: tuple[int, ...]) -> F32:
    array = frozen(value)
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
    return array
