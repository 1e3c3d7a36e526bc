"""Landmark definitions: converts the points of rendered meshes and of MediaPipe to one definition close to iBUG's.

A vertex of a rendered mesh, a vertex of MediaPipe's mesh and a point placed by hand have the same number, but not quite
the same position. A network trained on rendered people alone measures the differences: its predictions on real photos
minus their labels, averaged over many people in the frame of the face. With these differences,

- the jaw's points are spread evenly along the jaw, as hand-placed ones are, for both kinds of labels;
- rendered eyes, nose, mouth and the height of the brows move to where MediaPipe, and people, put them;
- along the brows MediaPipe's points move to the rendered ones, which follow the hair;
- MediaPipe's forehead moves to the rendered one, which defines the package's reference frame.

Everything is a linear map of the 81 points, so it turns with the head.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from guise.aam.landmarks.schemes import (
    BELOW_BROWS,
    BROWS,
    FOREHEAD,
    JAW,
    LEFT_EYE_OUTER,
    MIRROR,
    MOUTH_CORNERS,
    OUTER_EYE_CORNERS,
    RIGHT_EYE_OUTER,
)
from guise.common.arrays import F32, F64

if TYPE_CHECKING:
    from training.data import Pictures

_EYES_TO_MOUTH = (
    0.78  # from the eyes' middle to the mouth's, in outer-eye distances, of a face seen from the front
)


def face_axes(points: NDArray[Any]) -> tuple[F64, F64]:
    """Vectors across and down the face (n, 1, 2), one outer-eye distance long when seen from the front."""
    points = np.asarray(points, np.float64)
    eyes, lips = points[:, OUTER_EYE_CORNERS].mean(1), points[:, MOUTH_CORNERS].mean(1)
    across = points[:, LEFT_EYE_OUTER] - points[:, RIGHT_EYE_OUTER]
    return across[:, None], ((lips - eyes) / _EYES_TO_MOUTH)[:, None]


def difference(found: NDArray[Any], labels: NDArray[Any]) -> F64:
    """Mean of found minus labels (n, 81, 2), across and down the faces, made symmetric: (81, 2)."""
    across, down = face_axes(labels)
    basis = np.concatenate([across, down], axis=1)  # (n, 2, 2), rows are the axes
    parts = np.einsum("nki,nij->nkj", found - labels, np.linalg.inv(basis))
    mean = np.median(parts, axis=0)
    return np.asarray((mean + mean[list(MIRROR)] * (-1, 1)) / 2)


def even_spacing(jaws: NDArray[Any]) -> F64:
    """Matrix (17, 17) that spreads the points of jaws (n, 17, 2) evenly along their mean course."""
    steps = np.linalg.norm(np.diff(np.asarray(jaws, np.float64), axis=1), axis=2)
    course = np.concatenate([[0], np.cumsum(steps.mean(0))])
    course = course / course[-1]
    course = (course + 1 - course[::-1]) / 2
    return np.asarray(CubicSpline(course, np.eye(17))(np.linspace(0, 1, 17)))


def align_labels(points: F32, jaw: F64, move: F64) -> F32:
    """Labels (n, 81, 2), the jaw respaced by a matrix (17, 17) and points moved (81, 2) across and down the face."""
    across, down = face_axes(points)
    out = points + move[:, :1] * across + move[:, 1:] * down
    out[:, JAW] = np.einsum("ij,njk->nik", jaw, points[:, JAW].astype(np.float64))
    return np.asarray(out, np.float32)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Jaw matrices (17, 17) and moves (81, 2) that bring rendered points and real labels to one definition."""

    rendered_jaw: F64
    rendered_moves: F64
    real_jaw: F64
    real_moves: F64

    def rendered(self, pictures: Pictures) -> Pictures:
        """Rendered pictures with their points in the common definition."""
        return replace(pictures, points=align_labels(pictures.points, self.rendered_jaw, self.rendered_moves))

    def real(self, pictures: Pictures) -> Pictures:
        """Real pictures with their points in the common definition."""
        return replace(pictures, points=align_labels(pictures.points, self.real_jaw, self.real_moves))

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        rounded = {name: np.round(value, 5).tolist() for name, value in asdict(self).items()}
        path.write_text(json.dumps(rounded) + "\n", encoding="utf-8")


def read_alignment(path: Path | None = None) -> Alignment:
    """Read the output of `align_definitions.py`; by default the alignment the built-in landmarker was trained with."""
    stored = json.loads((path or Path(__file__).parent / "alignment.json").read_text(encoding="utf-8"))
    return Alignment(**{name: np.array(value) for name, value in stored.items()})


def load_alignment(kind: str) -> tuple[F64, F64]:
    """Jaw matrix and moves with which the built-in landmarker was trained; kind: rendered or real."""
    stored = asdict(read_alignment())
    return stored[f"{kind}_jaw"], stored[f"{kind}_moves"]


def definition_moves(mesh_less_label: F64) -> tuple[F64, F64]:
    """How rendered points and real labels move (81, 2 each), from the `difference` of the definitions."""
    rendered, real = np.zeros((81, 2)), np.zeros((81, 2))
    rendered[BELOW_BROWS] = -mesh_less_label[BELOW_BROWS]
    rendered[BROWS, 1] = -mesh_less_label[BROWS, 1]
    real[BROWS, 0] = mesh_less_label[BROWS, 0]
    real[FOREHEAD] = mesh_less_label[FOREHEAD]
    return rendered, real
