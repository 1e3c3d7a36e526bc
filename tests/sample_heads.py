"""Heads for tests, in decimetres: the mean head (training/mean_head.py) at rest and with expressions, and another head.

head.obj, head_smile.obj, head_surprise.obj   quads, the same vertices
other.obj                                     of another shape, with its vertices where the first has its faces
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

FILE = Path(__file__).parent / "data" / "mean_head.npz"
UNIT = 1e-4  # decimetres in a hundredth of a millimetre


@cache
def mean_head() -> tuple[F64, list[list[int]], dict[str, F64]]:
    """Vertices (V, 3) at rest, quads, and the vertices with each expression."""
    held = np.load(FILE)
    rest = UNIT * held["vertices"]
    faces = dict(zip(held["names"].tolist(), rest + UNIT * held["displacements"], strict=True))
    return rest, held["quads"].tolist(), faces


@cache
def other_head() -> tuple[F64, list[list[int]]]:
    """The dual of the mean head, of which each face is a vertex, in another shape."""
    rest, quads, _ = mean_head()
    x, y, z = rest[np.array(quads)].mean(axis=1).T
    shaped = np.stack([x * (1.06 + 0.05 * np.sin(3 * y)), 0.95 * y, 1.05 * z], axis=1)
    after = {
        (quad[k], quad[k - 1]): f for f, quad in enumerate(quads) for k in range(4)
    }  # by edge, backwards
    begun = {vertex: f for f, quad in enumerate(quads) for vertex in quad}
    rings = (_ring(vertex, first, quads, after) for vertex, first in begun.items())
    return shaped, [ring for ring in rings if len(ring) > 2]


def _ring(vertex: int, first: int, quads: list[list[int]], after: dict[tuple[int, int], int]) -> list[int]:
    """The faces about a vertex in their order; none when it lies at an edge of the mesh."""
    ring, face = [first], first
    while True:
        at = quads[face].index(vertex)
        face = after.get((quads[face][at - 1], vertex), -1)
        if face == first:
            return ring
        if face < 0 or len(ring) > 20:
            return []
        ring.append(face)


def write_obj(path: Path, vertices: F64, faces: list[list[int]]) -> Path:
    """An OBJ file."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_heads(folder: Path) -> Path:
    """All files into a folder, which is returned."""
    rest, quads, faces = mean_head()
    write_obj(folder / "head.obj", rest, quads)
    for name, vertices in faces.items():
        write_obj(folder / f"head_{name}.obj", vertices, quads)
    write_obj(folder / "other.obj", *other_head())
    return folder
