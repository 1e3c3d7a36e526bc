"""A rig of 52 shapes for a head of 200 000 vertices: size of the file, processor time and memory of the command.

The source is the ICT head with 52 of its expressions; the target another identity on an even mesh, as a scan has.
The solver is the one installed: with the extra `sparse`, METIS orders the unknowns.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
import trimesh

from benchmarks import common
from benchmarks.children import GUISE, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.full_heads import IctHeads
from guise.analogy.formats.files import read_mesh, write_rig
from guise.analogy.solver import solver_name
from guise.common.arrays import F64, Int

NAME, TITLE = "mesh.large_rig", "A rig for a head of 200 000 vertices"
VERTICES, SHAPES, IDENTITY = 200_000, 52, 9
MAX_MB, MAX_SECONDS, MAX_GB = 60.0, 48.0, 2.5


def refined(vertices: F64, faces: Int, count: int) -> tuple[F64, Int]:
    """A mesh of triangles subdivided once, and by middles of random ones until it has `count` vertices."""
    vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    chosen = np.random.default_rng(0).choice(len(faces), count - len(vertices), replace=False)
    a, b, c = faces[chosen].T
    middle = np.arange(len(vertices), count)
    around = [np.stack([one, other, middle], axis=1) for one, other in ((a, b), (b, c), (c, a))]
    return (
        np.concatenate([vertices, vertices[faces[chosen]].mean(1)]),
        np.concatenate([np.delete(faces, chosen, axis=0), *around]),
    )


def write_obj(path: Path, vertices: F64, faces: Int) -> None:
    """As few bytes as an OBJ needs."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}\n" for a, b, c in (faces + 1).tolist()]
    path.write_text("".join(lines))


def measure(options: argparse.Namespace) -> Report:
    """The command `guise analogy mesh rig`, as users run it."""
    model, report = IctHeads(options.shared / "data" / "mesh"), Report(NAME, TITLE)
    source, target = model.plain(), model.remeshed(IDENTITY, 37500)
    shapes = 3 if options.quick else SHAPES
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        write_obj(here / "neutral.obj", source.mesh.vertices, source.mesh.faces)
        neutral = read_mesh(here / "neutral.obj")
        assert source.shapes is not None
        write_rig(here / "source.glb", neutral, model.names[:shapes], source.shapes[:shapes])
        write_obj(here / "target.obj", *refined(target.mesh.vertices, target.mesh.faces, VERTICES))
        rig = here / "rig.glb"
        command = [
            *GUISE,
            "analogy",
            "mesh",
            "rig",
            here / "source.glb",
            "--target",
            here / "target.obj",
            "-o",
            rig,
        ]
        done = ran(command)
        size = rig.stat().st_size / 1e6
    report.criteria = [
        Criterion(f"GLB with {shapes} shapes", size, "<=", MAX_MB, "MB"),
        Criterion("processor", done.processor, "<=", MAX_SECONDS, "s"),
        Criterion("memory", done.peak_mb / 1000, "<=", MAX_GB, "GB"),
    ]
    report.tables.append(
        Table(
            "The command",
            ("solver", "wall, s", "processor, s"),
            [(solver_name(), done.seconds, done.processor)],
        )
    )
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
