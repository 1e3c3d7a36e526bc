"""The inside of the mouth of a disguise, painted anew: teeth, tongue and darkness between the drawn lips.

Modes of a texture average what was seen between the lips, and none are shown on a turned head.  Upper teeth stay with
the nose, lower ones with the chin.  Lengths are those of the nose, which no expression changes.  RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.aam.landmarks.schemes import CHIN, INNER_LIPS, NOSE_BASE, NOSE_ROOT
from guise.aam.painted_part import PaintedPart
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.common.arrays import F64, Floating
from guise.common.tuned import tuned


@dataclass(frozen=True)
class InnerMouthLimits:
    """Lengths of the nose; colours in even light, to which the palette gives that of the scene."""

    flesh: tuple[float, float, float] = tuned((105, 52, 48), "RGB", "deidentify.expression")
    tooth: tuple[float, float, float] = tuned((184, 178, 166), "RGB", "deidentify.expression")
    dark: float = tuned(0.28, "share", "deidentify.expression")  # of the flesh's light, behind it
    # over which the inside begins at the lips, and teeth end
    edge: float = tuned(0.015, "nose lengths", "deidentify.expression")
    # down to where the upper ones reach, below the upper lip at rest, with the lower ones behind,
    teeth: float = tuned(0.06, "nose lengths", "deidentify.expression")
    # and how that rises to the sides, of the squared way there
    arc: float = tuned(0.35, "1/nose lengths", "deidentify.expression")
    lower: float = tuned(0.7, "ratio", "deidentify.expression")  # brightness of the lower ones
    # shade of the teeth there, and how far down
    below_lip: tuple[float, float] = tuned((0.45, 0.05), "share, nose lengths", "deidentify.expression")
    # from which light falls on all of the teeth between lips
    parted: float = tuned(0.08, "nose lengths", "deidentify.expression")
    # shade, of the squared way
    to_sides: float = tuned(1.8, "1/squared nose lengths", "deidentify.expression")
    # share at the lower lip, height, and shade to the sides
    tongue: tuple[float, float, float] = tuned(
        (0.7, 0.22, 4.0), "share, nose lengths, 1/squared nose lengths", "deidentify.expression"
    )


LIMITS = InnerMouthLimits()


class InnerMouth:
    """Paints it into the texture of an identity.

    rest : the identity's shape (81, 2) at rest.
    """

    def __init__(self, reference: ReferenceFrame, rest: F64) -> None:
        self._part = PaintedPart.of(reference, INNER_LIPS)
        about = _AboutMouth(rest)
        nose, lip, chin = (float(about(rest[point])[1]) for point in (NOSE_BASE, INNER_LIPS[2], CHIN))
        self._from_nose, self._to_chin = lip - nose + LIMITS.teeth, chin - lip - LIMITS.teeth

    def paint(self, face: FaceInFrame, memory: Memory) -> None:
        """Paint it between the drawn lips."""
        mesh = face.mesh
        about = _AboutMouth(mesh)
        lips, ends = about(mesh[INNER_LIPS]), about(mesh[[NOSE_BASE, CHIN]])[:, 1]
        x, y = about(self._part.places(mesh)).T
        below, above = y - np.interp(x, *lips[:5].T), np.interp(x, *lips[[0, 7, 6, 5, 4]].T) - y
        from_upper, from_lower = (
            y + LIMITS.arc * x * x - end for end in (ends[0] + self._from_nose, ends[1] - self._to_chin)
        )
        flesh, tooth = np.array(LIMITS.flesh), np.array(LIMITS.tooth)
        dark = LIMITS.dark * flesh
        parted = np.clip((below + above) / LIMITS.parted, 0, 1)
        lit = tooth * (parted * _shade(x, below))[:, None]
        colours = dark + _tongue(x, above)[:, None] * (flesh - dark)
        colours += _reached(from_lower)[:, None] * (LIMITS.lower * lit - colours)
        colours += _reached(-from_upper)[:, None] * (lit - colours)
        inside = np.clip(np.minimum(below, above) / LIMITS.edge, 0, 1)
        self._part.paint(face.canvas.texture, colours.astype(np.float32), inside.astype(np.float32))


def _reached(beyond: F64) -> F64:
    """(n,) share in [0, 1] of teeth at places beyond their end."""
    return np.asarray(np.clip(beyond / LIMITS.edge + 0.5, 0, 1))


def _tongue(x: F64, above: F64) -> F64:
    """(n,) share in [0, 1] of the tongue at places beside the middle and above the lower lip."""
    share, height, narrow = LIMITS.tongue
    return np.asarray(share * np.clip(1 - above / height, 0, 1) * np.exp(-narrow * x * x))


def _shade(x: F64, below: F64) -> F64:
    """(n,) how bright teeth are at places beside the middle and below the upper lip."""
    lip, reach = LIMITS.below_lip
    return np.asarray(np.exp(-LIMITS.to_sides * x * x) * (1 - lip * np.exp(-np.maximum(below, 0) / reach)))


class _AboutMouth:
    """Places about the middle of a mesh's mouth, x from corner to corner, y down, in lengths of the nose."""

    def __init__(self, mesh: F64) -> None:
        first, last = mesh[[INNER_LIPS[0], INNER_LIPS[4]]]
        self._middle = (first + last) / 2
        x, y = (last - first) / max(float(np.hypot(*(last - first))), 1e-3)
        length = max(float(np.hypot(*(mesh[NOSE_BASE] - mesh[NOSE_ROOT]))), 1e-3)
        self._axes = np.array([[x, -y], [y, x]]) / length

    def __call__(self, points: Floating) -> F64:
        return np.asarray((points - self._middle) @ self._axes)
