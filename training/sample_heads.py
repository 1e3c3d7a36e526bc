"""The sample heads: the mean of the rendered people's heads with their mean expressions, and a head of another shape.

    python -m training.sample_heads ../shared/data/synthetic/mesh sample_videos/heads

All heads share the vertices and quads of one base, so the mean is taken vertex by vertex; it is a fictional head.
Decimetres, x to the person's left, y up, z forward.  Writes mean.obj, mean_smile.obj and mean_surprise.obj; mean.glb,
with all of EXPRESSIONS; and other.obj, the dual of the mean, with one vertex per face.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from guise.analogy.formats.files import read_mesh, write_rig
from guise.common.arrays import F64

Faces = list[list[int]]

PEOPLE = ("p01", "p02", "p04", "p05", "p07", "p10")
EXPRESSIONS = ("anger", "blink", "open", "pucker", "smile", "surprise")
OBJ_EXPRESSIONS = ("smile", "surprise")  # that are also written as OBJ files


def mean_head(meshes: Path) -> tuple[F64, Faces, F64]:
    """Vertices (V, 3) at rest, quads, and the vertices (E, V, 3) with each expression."""
    heads = [read_mesh(meshes / name / "neutral.obj").mesh for name in PEOPLE]
    faces = []
    for name in PEOPLE:
        told = np.load(meshes / name / "expressions.npz")
        faces.append([told["vertices"][list(told["names"]).index(one)] for one in EXPRESSIONS])
    return np.mean([head.vertices for head in heads], axis=0), heads[0].quads.tolist(), np.mean(faces, axis=0)


def other_head(rest: F64, quads: Faces) -> tuple[F64, Faces]:
    """The dual of a head, with one vertex per face, in another shape."""
    x, y, z = rest[np.array(quads)].mean(axis=1).T
    shaped = np.stack([x * (1.06 + 0.05 * np.sin(3 * y)), 0.95 * y, 1.05 * z], axis=1)
    beside = {(quad[k], quad[k - 1]): f for f, quad in enumerate(quads) for k in range(4)}
    begun = {vertex: f for f, quad in enumerate(quads) for vertex in quad}
    rings = (_ring(vertex, first, quads, beside) for vertex, first in begun.items())
    return shaped, [ring for ring in rings if len(ring) > 2]


def _ring(vertex: int, first: int, quads: Faces, beside: dict[tuple[int, int], int]) -> list[int]:
    """The faces around a vertex in order; none if it lies on a border."""
    ring, face = [], first
    while face >= 0:
        ring.append(face)
        face = beside.get((quads[face][quads[face].index(vertex) - 1], vertex), -1)
        if face == first:
            return ring
    return []


def write_obj(path: Path, vertices: F64, faces: Faces) -> None:
    """Write an OBJ file, to the hundredth of a millimetre."""
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in faces]
    path.write_text("\n".join(lines) + "\n")


def main() -> None:
    """Write the sample heads."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("folder", type=Path)
    options = parser.parse_args()
    rest, quads, faces = mean_head(options.meshes)
    options.folder.mkdir(exist_ok=True)
    write_obj(options.folder / "mean.obj", rest, quads)
    for name in OBJ_EXPRESSIONS:
        write_obj(options.folder / f"mean_{name}.obj", faces[EXPRESSIONS.index(name)], quads)
    write_obj(options.folder / "other.obj", *other_head(rest, quads))
    write_rig(options.folder / "mean.glb", read_mesh(options.folder / "mean.obj"), EXPRESSIONS, faces)


if __name__ == "__main__":
    main()
