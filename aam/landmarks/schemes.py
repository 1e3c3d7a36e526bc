"""Landmark schemes: what the points of a face are called, and how other schemes become ``face81``.

``face81`` is the iBUG 68 points followed by 13 along the upper forehead, from the person's right temple
(image left) to the left one. Index groups are named from the person's point of view, as iBUG does.
Pixels, x right, y down, pixel centres at integers; any leading axes are batches; NaN stays NaN.

A scheme without a forehead is completed through a mean geometry (``aam/data/face81_mean.json``), made by
:func:`fit_geometry` from the exact truths of the CC0 clips in ``sample_videos/`` (three people, all six
clips, every fifth frame, each also mirrored, every person with the same weight). The 13 points are the mean
forehead placed by the least-squares similarity of points 0-47 (mouth and lips left out: they move), plus a
linear term in the displacement of the nose from the middle of the temples, which stands for the turn of the
head. Left-out-person error on those clips 1.6-3.1 % of the inter-ocular distance.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.face import LandmarkError
from guise.aam.similarity import Complex, align_complex
from guise.common.arrays import F32, F64, Int
from guise.common.small import lengths

Group = Int


def _group(*points: int) -> Group:
    group = np.array(points, np.intp)
    group.setflags(write=False)
    return group


# Groups of points, as arrays that index the points of a face: ``points[LEFT_EYE]`` is (6, 2).
JAW = _group(*range(0, 17))
RIGHT_BROW = _group(*range(17, 22))
LEFT_BROW = _group(*range(22, 27))
NOSE = _group(*range(27, 36))
RIGHT_EYE = _group(*range(36, 42))
LEFT_EYE = _group(*range(42, 48))
OUTER_LIPS = _group(*range(48, 60))
INNER_LIPS = _group(*range(60, 68))
FOREHEAD = _group(*range(68, 81))

# Every point is in one of these.
GROUPS: Mapping[str, Group] = {
    "jaw": JAW,
    "right_brow": RIGHT_BROW,
    "left_brow": LEFT_BROW,
    "nose": NOSE,
    "right_eye": RIGHT_EYE,
    "left_eye": LEFT_EYE,
    "outer_lips": OUTER_LIPS,
    "inner_lips": INNER_LIPS,
    "forehead": FOREHEAD,
}

BROWS = _group(*RIGHT_BROW, *LEFT_BROW)
EYES = _group(*RIGHT_EYE, *LEFT_EYE)
LIPS = _group(*OUTER_LIPS, *INNER_LIPS)
NOSE_BRIDGE = _group(*range(27, 31))
NOSE_WINGS = _group(*range(31, 36))
BROWS_AND_EYES = _group(*BROWS, *EYES)
EYES_AND_LIPS = _group(*EYES, *LIPS)
BELOW_BROWS = _group(*NOSE, *EYES_AND_LIPS)
IBUG68 = _group(*range(0, 68))
INNER51 = _group(*range(17, 68))  # of iBUG 68, without the jaw
OUTLINE = _group(*JAW, *FOREHEAD)
SILHOUETTE = _group(*JAW, *FOREHEAD[::-1])  # the outline as a closed curve
# Lines by which a face is drawn.
CLOSED_LINES = (SILHOUETTE, RIGHT_EYE, LEFT_EYE, OUTER_LIPS, INNER_LIPS)
OPEN_LINES = (RIGHT_BROW, LEFT_BROW, NOSE_BRIDGE, NOSE_WINGS)

# Single points; right and left are the person's.
RIGHT_TEMPLE, LEFT_TEMPLE = 0, 16
CHIN = 8
RIGHT_BROW_OUTER, RIGHT_BROW_TOP, RIGHT_BROW_INNER = 17, 19, 21
LEFT_BROW_INNER, LEFT_BROW_TOP, LEFT_BROW_OUTER = 22, 24, 26
NOSE_ROOT, NOSE_TIP, NOSE_BASE = 27, 30, 33
RIGHT_NOSTRIL, LEFT_NOSTRIL = 31, 35
RIGHT_EYE_OUTER, RIGHT_EYE_INNER = 36, 39
LEFT_EYE_INNER, LEFT_EYE_OUTER = 42, 45
RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER = 48, 54
UPPER_LIP_TOP, LOWER_LIP_BOTTOM = 51, 57
UPPER_LIP_INNER, LOWER_LIP_INNER = 62, 66  # their middles
HAIRLINE = 74  # the middle of the forehead's points

OUTER_EYE_CORNERS = _group(RIGHT_EYE_OUTER, LEFT_EYE_OUTER)
RIGHT_EYE_CORNERS = _group(RIGHT_EYE_OUTER, RIGHT_EYE_INNER)
LEFT_EYE_CORNERS = _group(LEFT_EYE_INNER, LEFT_EYE_OUTER)
EYE_CORNERS = _group(*RIGHT_EYE_CORNERS, *LEFT_EYE_CORNERS)
MOUTH_CORNERS = _group(RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER)
BROW_TOPS = _group(RIGHT_BROW_TOP, LEFT_BROW_TOP)
TEMPLES = _group(RIGHT_TEMPLE, LEFT_TEMPLE)
# Pairs of points that open: each upper one lies above the lower one of the same place in its list.
RIGHT_UPPER_LID, RIGHT_LOWER_LID = _group(37, 38), _group(41, 40)
LEFT_UPPER_LID, LEFT_LOWER_LID = _group(43, 44), _group(47, 46)
# Of both eyes: corners, upper and lower lid, from left to right as seen.
EYE_OUTLINES = (
    (RIGHT_EYE_CORNERS, RIGHT_UPPER_LID, RIGHT_LOWER_LID),
    (LEFT_EYE_CORNERS, LEFT_UPPER_LID, LEFT_LOWER_LID),
)
UPPER_LIDS = _group(*RIGHT_UPPER_LID, *LEFT_UPPER_LID)
LOWER_LIDS = _group(*RIGHT_LOWER_LID, *LEFT_LOWER_LID)
LIDS_BELOW_BROW_TOPS = _group(37, 44)
UPPER_INNER_LIP, LOWER_INNER_LIP = _group(61, 62, 63), _group(67, 66, 65)
# The lips in parts that move together: the corners, outer and inner, and what lies between them.
RIGHT_MOUTH_CORNER_POINTS, LEFT_MOUTH_CORNER_POINTS = _group(48, 60), _group(54, 64)
UPPER_LIP = _group(*OUTER_LIPS[1:6], *UPPER_INNER_LIP)
LOWER_LIP = _group(*OUTER_LIPS[7:], *LOWER_INNER_LIP)
# The upper ends of the jaw, beside the ears.
NEAR_TEMPLES = _group(0, 1, 2, 14, 15, 16)
COUNT = 81

# How rigidly each landmark moves with the skull: eye corners, upper nose and temples; lips, lids and jaw not at all.
RIGID_WEIGHTS: F64 = np.zeros(COUNT)
RIGID_WEIGHTS[EYE_CORNERS] = 1.0
RIGID_WEIGHTS[NOSE_BRIDGE[:2]] = 1.0
RIGID_WEIGHTS[[*NOSE_BRIDGE[2:], RIGHT_NOSTRIL, NOSE_BASE, LEFT_NOSTRIL]] = 0.5
RIGID_WEIGHTS[[*TEMPLES, *FOREHEAD[[0, -1]]]] = 0.25
RIGID_WEIGHTS /= RIGID_WEIGHTS.sum()
RIGID_WEIGHTS.setflags(write=False)

# Which point takes whose place when the picture is mirrored left to right.
MIRROR: tuple[int, ...] = (
    *range(16, -1, -1),
    *range(26, 16, -1),
    *range(27, 31),
    *range(35, 30, -1),
    *(45, 44, 43, 42, 47, 46),
    *(39, 38, 37, 36, 41, 40),
    *(54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55),
    *(64, 63, 62, 61, 60, 67, 66, 65),
    *range(80, 67, -1),
)

_STEADY = np.arange(48)


def interocular(points: NDArray[Any]) -> NDArray[Any]:
    """Distance between the outer eye corners, the usual measure of a face's size.

    points : (..., n, 2) with n >= 46, scheme ``face81`` or ``ibug68``, pixels. Returns (...), pixels.

    Examples
    --------
    >>> points = np.zeros((81, 2))
    >>> points[45] = 3, 4
    >>> float(interocular(points))
    5.0
    """
    right, left = OUTER_EYE_CORNERS
    away: NDArray[Any] = lengths(points[..., left, :] - points[..., right, :])
    return away


def mirror(points: NDArray[Any], width: int) -> NDArray[Any]:
    """Points (..., 81, 2) of the picture mirrored left to right, in face81 order again.

    width : pixels of the picture; pixel column x becomes ``width - 1 - x``.
    """
    flipped = np.array(points)[..., list(MIRROR), :]
    flipped[..., 0] = width - 1 - flipped[..., 0]
    return flipped


@dataclass(frozen=True, eq=False)
class Geometry:
    """Mean face and how its forehead turns.

    mean : (81,) complex, outer eye corners at -0.5 and 0.5 on average, x + iy, y down.
    turn : (2, 26) float; nose displacement (x, y) -> displacement of the 13 forehead points (x..., y...).
    """

    mean: Complex
    turn: F64

    def forehead(self, points: NDArray[Any]) -> F64:
        """The 13 forehead points (..., 13, 2) of iBUG 68 points (..., 68, 2), pixels."""
        shape = _complex(points)
        scale, shift = align_complex(self.mean[_STEADY], shape[..., _STEADY])
        inside = _undone(shape, scale, shift)
        moved = _nose_displacement(inside, self.mean) @ self.turn
        forehead = (self.mean[68:] + moved[..., :13] + 1j * moved[..., 13:]) * scale + shift
        return np.stack([forehead.real, forehead.imag], axis=-1)

    def residual(self, points: NDArray[Any]) -> F64:
        """How unlike the mean face points (..., n, 2), n = 68 or 81, are.

        Root mean square distance (...) of points 0-47 after the best similarity, inter-ocular distances.
        """
        shape = _complex(points)[..., _STEADY]
        mean = self.mean[_STEADY]
        scale, shift = align_complex(mean, shape)
        distance = np.abs(_undone(shape, scale, shift) - mean)
        return np.asarray(np.sqrt(np.mean(distance**2, axis=-1)))


def fit_geometry(people: Sequence[NDArray[Any]], ridge: float = 1e-5) -> Geometry:
    """Mean geometry of people given as face81 truths, one array (T, 81, 2) per person.

    Each face is also used mirrored, so that the result is symmetric; ridge steadies the turn term.
    """
    shapes = [_eye_frame(np.concatenate([p, mirror(p, 1)])) for p in (np.asarray(p, float) for p in people)]
    mean = np.mean([s.mean(axis=0) for s in shapes], axis=0)
    sources, targets = [], []
    for shape in shapes:
        scale, shift = align_complex(mean[_STEADY], shape[:, _STEADY])
        inside = _undone(shape, scale, shift)
        offset = (inside - mean)[:, 68:]
        weight = 1 / np.sqrt(len(shape))
        sources.append(weight * _nose_displacement(inside, mean))
        targets.append(weight * np.concatenate([offset.real, offset.imag], axis=1))
    source, target = np.concatenate(sources), np.concatenate(targets)
    normal = source.T @ source + ridge * len(people) * np.eye(2)
    return Geometry(mean, np.linalg.solve(normal, source.T @ target))


@cache
def mean_geometry() -> Geometry:
    """The geometry shipped with the package."""
    stored = json.loads((Path(__file__).parents[1] / "data" / "face81_mean.json").read_text(encoding="utf-8"))
    mean = np.array(stored["mean"], dtype=np.float64)
    return Geometry(mean[:, 0] + 1j * mean[:, 1], np.array(stored["turn"], dtype=np.float64))


@dataclass(frozen=True)
class Scheme:
    """A named landmark scheme.

    Parameters
    ----------
    name : str
    count : int
        Number of points.
    complete : callable
        (..., count, 2) -> (..., 81, 2), equivariant under similarities.
    within : tuple of int
        The face81 points that this scheme has too; their box is the scheme's landmark box.
    """

    name: str
    count: int
    complete: Callable[[NDArray[Any]], NDArray[Any]]
    within: tuple[int, ...]


_SCHEMES: dict[str, Scheme] = {}


def register_scheme(scheme: Scheme) -> None:
    """Make a scheme known to annotation files and cards; the name must be new."""
    if scheme.name in _SCHEMES:
        raise ValueError(f"landmark scheme {scheme.name!r} is registered already")
    _SCHEMES[scheme.name] = scheme


def scheme_named(name: str) -> Scheme:
    """The scheme of that name; LandmarkError with the list of names otherwise."""
    if name not in _SCHEMES:
        raise LandmarkError(f"landmark scheme must be one of {', '.join(_SCHEMES)}, got {name!r}")
    return _SCHEMES[name]


def scheme_of_count(count: int) -> Scheme:
    """The scheme registered first with that many points; LandmarkError otherwise."""
    for scheme in _SCHEMES.values():
        if scheme.count == count:
            return scheme
    known = ", ".join(f"{s.count} ({s.name})" for s in _SCHEMES.values())
    raise LandmarkError(f"landmarks must have one of these numbers of points: {known}; got {count}")


def to_face81(points: NDArray[Any], scheme: str) -> F32:
    """Points of a scheme as ``face81``.

    Parameters
    ----------
    points : (..., n, 2) float
        Pixels; NaN stays NaN.
    scheme : str
        ``'face81'``, ``'ibug68'`` or a name given to :func:`register_scheme`.

    Returns
    -------
    (..., 81, 2) float32, pixels

    Examples
    --------
    >>> mean = mean_geometry().mean
    >>> face = np.stack([mean.real, mean.imag], axis=-1)
    >>> bool(np.abs(to_face81(face[:68], "ibug68") - face).max() < 1e-6)
    True
    """
    known = scheme_named(scheme)
    array = np.asarray(points, dtype=np.float64)
    if array.ndim < 2 or array.shape[-2:] != (known.count, 2):
        raise LandmarkError(f"{scheme} landmarks must have shape (..., {known.count}, 2), got {array.shape}")
    return known.complete(array).astype(np.float32)


def _complete_ibug68(points: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([points, mean_geometry().forehead(points)], axis=-2)


def _complex(points: NDArray[Any]) -> Complex:
    array = np.asarray(points, dtype=np.float64)
    return np.asarray(array[..., 0] + 1j * array[..., 1])


def _eye_frame(points: NDArray[Any]) -> Complex:
    shape = _complex(points)
    right, left = shape[..., OUTER_EYE_CORNERS[:1]], shape[..., OUTER_EYE_CORNERS[1:]]
    return np.asarray((shape - (right + left) / 2) / (left - right))


def _undone(shape: Complex, scale: Complex, shift: Complex) -> Complex:
    """Points in the frame before the similarity; of coincident points (scale 0) the shift only is undone."""
    with np.errstate(invalid="ignore"):  # NaN, a missing face, stays NaN
        return np.asarray((shape - shift) / np.where(scale == 0, 1, scale))


def _nose_displacement(inside: Complex, mean: Complex) -> F64:
    """Nose against the middle of the temples, relative to the mean face (..., 2), inter-ocular distances."""
    offset = inside - mean[: inside.shape[-1]]
    turned = offset[..., NEAR_TEMPLES].mean(axis=-1) - offset[..., NOSE].mean(axis=-1)
    return np.stack([turned.real, turned.imag], axis=-1)


register_scheme(Scheme("face81", COUNT, lambda points: points, tuple(range(COUNT))))
register_scheme(Scheme("ibug68", 68, _complete_ibug68, tuple(range(68))))
