"""The sample head of the tests: the mean of the rendered people's heads, with their mean expressions.

    python -m training.mean_head ../shared/data/synthetic/mesh tests/data/mean_head.npz

All heads have the vertices and faces of one base, so that a mean is taken vertex by vertex; it is nobody's head.
Kept are vertices (V, 3) at rest, x to the person's left, y up, z forward; quads (Q, 4); names (E,) and displacements
(E, V, 3) of the expressions; lengths in hundredths of a millimetre, int16.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from analogy.mesh_io import read_mesh

PEOPLE = ("p01", "p02", "p04", "p05", "p07", "p10")
EXPRESSIONS = ("smile", "surprise")
UNIT = 1e4  # hundredths of a millimetre in a decimetre, the unit of the heads


def main() -> None:
    """Make the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    heads = [read_mesh(options.meshes / name / "neutral.obj").mesh for name in PEOPLE]
    rest = np.mean([head.vertices for head in heads], axis=0)
    moved = []
    for name in PEOPLE:
        told = np.load(options.meshes / name / "expressions.npz")
        moved.append([told["vertices"][list(told["names"]).index(expression)] for expression in EXPRESSIONS])
    ways = np.mean(moved, axis=0) - rest
    options.output.parent.mkdir(exist_ok=True)
    np.savez_compressed(
        options.output, vertices=(UNIT * rest).round().astype(np.int16), quads=heads[0].quads.astype(np.uint16),
        names=np.array(EXPRESSIONS), displacements=(UNIT * ways).round().astype(np.int16),
    )  # fmt: skip


if __name__ == "__main__":
    main()
