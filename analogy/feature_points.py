"""The 20 MPEG-4 feature points of a head mesh: detected in pictures of it, or read from a file.

The landmarker sees pictures of the mesh from many sides.  Each point is triangulated from its lines of sight, whatever
the surface does there (holes for eyes, nostrils, a nose that hides its own wing).  It is then moved by the difference
between the definitions of the landmark and the feature point, and projected onto the visible surface.  Left and right
are the person's.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.landmarks.schemes import (
    CHIN,
    LEFT_BROW_INNER,
    LEFT_BROW_OUTER,
    LEFT_EYE_INNER,
    LEFT_EYE_OUTER,
    LEFT_MOUTH_CORNER,
    LEFT_NOSTRIL,
    LOWER_LIP_BOTTOM,
    LOWER_LIP_INNER,
    NOSE_BASE,
    NOSE_ROOT,
    NOSE_TIP,
    RIGHT_BROW_INNER,
    RIGHT_BROW_OUTER,
    RIGHT_EYE_INNER,
    RIGHT_EYE_OUTER,
    RIGHT_MOUTH_CORNER,
    RIGHT_NOSTRIL,
    UPPER_LIP_INNER,
    UPPER_LIP_TOP,
)
from guise.aam.similarity import Failed
from guise.analogy.carriers import carriers
from guise.analogy.face_views import find_face_views
from guise.analogy.mesh import Mesh
from guise.analogy.triangulation import TriangulatedFace, triangulate_face
from guise.analogy.views import ViewedMesh
from guise.common.arrays import F64, Int
from guise.common.errors import GuiseError

# Name -> the landmark of scheme `face81`, and the offset from it in hundredths of the eye width: to the person's left,
# up, forward.  Offsets are the means of two definitions, those of the rendered people and of the ICT head, made
# symmetric (`benchmarks/mesh/landmarks.py --shifts`); the outer ends of the brows, which differ most, use the people's.
DEFINITIONS: dict[str, tuple[int, tuple[float, float, float]]] = {
    "mouth_corner_right": (RIGHT_MOUTH_CORNER, (-0.2, -0.5, -1.1)),
    "mouth_corner_left": (LEFT_MOUTH_CORNER, (0.2, -0.5, -1.1)),
    "upper_lip_top": (UPPER_LIP_TOP, (0.0, 1.6, 0.7)),
    "lower_lip_bottom": (LOWER_LIP_BOTTOM, (0.0, 0.1, -0.6)),
    "upper_lip_inner": (UPPER_LIP_INNER, (0.0, -0.6, 0.5)),
    "lower_lip_inner": (LOWER_LIP_INNER, (0.0, -0.3, -1.6)),
    "nose_tip": (NOSE_TIP, (0.0, -1.2, 2.3)),
    "nose_bridge": (NOSE_ROOT, (0.0, -0.9, 3.9)),
    "nose_base": (NOSE_BASE, (0.0, -1.5, -0.3)),
    "nose_wing_right": (RIGHT_NOSTRIL, (-3.4, -3.8, -0.3)),
    "nose_wing_left": (LEFT_NOSTRIL, (3.4, -3.8, -0.3)),
    "eye_right_outer": (RIGHT_EYE_OUTER, (-1.9, 0.6, -0.7)),
    "eye_right_inner": (RIGHT_EYE_INNER, (-2.6, 0.5, -1.1)),
    "eye_left_inner": (LEFT_EYE_INNER, (2.6, 0.5, -1.1)),
    "eye_left_outer": (LEFT_EYE_OUTER, (1.9, 0.6, -0.7)),
    "chin": (CHIN, (0.0, -0.2, 4.5)),
    "brow_right_outer": (RIGHT_BROW_OUTER, (16.1, 5.5, 16.5)),
    "brow_right_inner": (RIGHT_BROW_INNER, (-1.1, 6.9, 4.1)),
    "brow_left_inner": (LEFT_BROW_INNER, (1.1, 6.9, 4.1)),
    "brow_left_outer": (LEFT_BROW_OUTER, (-16.1, 5.5, 16.5)),
}
FEATURE_POINT_NAMES = tuple(DEFINITIONS)
LANDMARK_INDICES = np.array([point for point, _ in DEFINITIONS.values()])
LANDMARK_OFFSETS = np.array([shift for _, shift in DEFINITIONS.values()]) / 100


MAX_DISTANCE_DIAGONALS = 0.05  # of a given position from the mesh, in diagonals of the mesh
MAX_FACE_VIEWS = 8  # views that look like a face which are tried
AGREEMENT_EYE_WIDTHS = 0.05  # distance of a line of sight from a point, up to which it agrees


class FeaturePointsError(GuiseError):
    """Feature points that cannot be read or found; one sentence."""


@dataclass(frozen=True, eq=False)
class FeaturePoints:
    """Feature points in the order of `FEATURE_POINT_NAMES`.

    Parameters
    ----------
    positions : (20, 3) on the surface, in the mesh's unit.   vertices : (20,) the nearest vertices.
    confidence : (20,) in [0, 1], the share of pictures that agree about the point.
    """

    positions: F64
    vertices: Int
    confidence: F64

    @classmethod
    def from_positions(cls, mesh: Mesh, positions: F64, confidence: F64) -> FeaturePoints:
        """From positions (20, 3) on the surface of a mesh."""
        _, nearest = cKDTree(mesh.vertices).query(positions)
        return cls(positions, np.asarray(nearest, np.intp), confidence)

    @property
    def eye_width(self) -> float:
        """Distance between the outer eye corners, the unit of errors."""
        right, left = (
            self.positions[FEATURE_POINT_NAMES.index(f"eye_{side}_outer")] for side in ("right", "left")
        )
        return float(np.linalg.norm(left - right))

    def as_json(self) -> dict[str, list[float]]:
        """Name -> position, as in a file."""
        return {
            name: [float(f"{x:.7g}") for x in at]
            for name, at in zip(FEATURE_POINT_NAMES, self.positions, strict=True)
        }

    def save(self, path: str | Path) -> None:
        """Write a file that `load_feature_points` reads."""
        lines = (f"  {json.dumps(name)}: {json.dumps(at)}" for name, at in self.as_json().items())
        Path(path).write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def find_feature_points(mesh: Mesh) -> FeaturePoints | Failed:
    """The feature points of a head in any orientation; `Failed` when no face is seen on it.

    Works on heads, busts and masks, with or without eyes; eyes and teeth may be separate parts.
    """
    tried = (triangulate_face(facing) for facing in islice(find_face_views(mesh), MAX_FACE_VIEWS))
    seen = next((one for one in tried if not isinstance(one, Failed)), None)
    if seen is None:
        return Failed(
            "no face was found on the mesh from any direction: give the points with --landmarks FILE"
        )
    wanted = seen.points[LANDMARK_INDICES] + seen.eye_width * LANDMARK_OFFSETS @ seen.axes
    agreed = (seen.distances[:, LANDMARK_INDICES] < AGREEMENT_EYE_WIDTHS * seen.eye_width).mean(0)
    places = seen.on_surface(wanted)
    if mesh.components.any():
        seen = _on_components(seen, mesh, carriers(mesh, places, seen.eye_width))
        places = seen.on_surface(wanted)
    return FeaturePoints.from_positions(mesh, places, agreed)


def _on_components(seen: TriangulatedFace, mesh: Mesh, chosen: list[int]) -> TriangulatedFace:
    """The face on some components alone: eyes, glasses and hair carry no points."""
    _, nearest = cKDTree(mesh.vertices).query(seen.surface.vertices)
    on = np.isin(mesh.components[nearest], chosen)
    kept = np.asarray(on[seen.surface.faces].all(1))
    return replace(seen, surface=seen.surface.submesh(kept)) if kept.any() else seen


def load_feature_points(path: str | Path, mesh: Mesh, found: FeaturePoints | None = None) -> FeaturePoints:
    """Points from a JSON file: name -> 0-based vertex of the mesh, or position [x, y, z] near its surface.

    found : supplies the points that the file leaves out; without it the file must give all 20.

    Raises
    ------
    FeaturePointsError
        When the file cannot be read, a name or vertex is unknown, a position is far from the mesh, or a name is
        missing.
    """
    given = _read_json(Path(path))
    _check_names(given, Path(path), complete=found is None)
    positions = np.zeros((len(FEATURE_POINT_NAMES), 3)) if found is None else found.positions.copy()
    confidence = np.ones(len(FEATURE_POINT_NAMES)) if found is None else found.confidence.copy()
    for name, at in given.items():
        positions[FEATURE_POINT_NAMES.index(name)] = _read_position(name, at, mesh, Path(path))
        confidence[FEATURE_POINT_NAMES.index(name)] = 1
    return FeaturePoints.from_positions(mesh, positions, confidence)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FeaturePointsError(f"{path} cannot be read: give a JSON file of feature points") from error
    except ValueError as error:
        raise FeaturePointsError(f"{path} must be JSON, name -> vertex or [x, y, z], got: {error}") from error
    if not isinstance(given, dict):
        raise FeaturePointsError(
            f"{path} must hold a JSON object, name -> vertex or [x, y, z], got a {type(given).__name__}"
        )
    return given


def _check_names(given: dict[str, Any], path: Path, *, complete: bool) -> None:
    unknown = [name for name in given if name not in FEATURE_POINT_NAMES]
    if unknown:
        raise FeaturePointsError(
            f"{path}: {unknown[0]!r} is not a feature point; the names are {', '.join(FEATURE_POINT_NAMES)}"
        )
    missing = [name for name in FEATURE_POINT_NAMES if name not in given]
    if complete and missing:
        raise FeaturePointsError(
            f"{path} must give all {len(FEATURE_POINT_NAMES)} feature points, {', '.join(missing)} missing"
        )


def _read_position(name: str, at: Any, mesh: Mesh, path: Path) -> F64:
    """The position (3,) that an entry of a file gives."""
    count = len(mesh.vertices)
    if isinstance(at, int) and not isinstance(at, bool):
        if not 0 <= at < count:
            raise FeaturePointsError(f"{path}: {name} must be a vertex from 0 to {count - 1}, got {at}")
        return np.asarray(mesh.vertices[at])
    numbers = isinstance(at, list) and len(at) == 3 and all(type(x) in (int, float) for x in at)
    if not numbers or not np.isfinite(at).all():
        raise FeaturePointsError(
            f"{path}: {name} must be a vertex or three finite numbers [x, y, z], got {at!r}"
        )
    place = np.array(at, np.float64)
    off = float(np.linalg.norm(ViewedMesh.of(mesh).closest_points(place[None])[0] - place))
    size = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    if off > MAX_DISTANCE_DIAGONALS * size:
        raise FeaturePointsError(
            f"{path}: {name} is {off:.3g} away from a mesh that is {size:.3g} across: does the file belong to "
            "another mesh?"
        )
    return place
