"""Frames of a head as one GLB: morph targets, and an animation of their weights.

The morph targets are the principal components of the displacements of the frames, as many as are needed to reproduce
every vertex of every frame to within a ten-thousandth of the size of the head.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from guise.analogy.formats.files import MeshFile, write_rig
from guise.analogy.formats.gltf_container import GltfContainer
from guise.common.arrays import F32, F64
from guise.common.files import write_whole

MAX_ERROR_SIZES = 1e-4  # of a vertex, in sizes of the head
GL_FLOAT = 5126  # of glTF: float32


def write_animated_glb(
    path: Path, target: MeshFile, frames: Sequence[F32], rate: float, scale: float = 1.0
) -> int:
    """Write frames (N, 3) of a target as an animated GLB at `rate` frames per second; the number of morph targets.

    scale : metres per unit of the target.
    """
    neutral = target.mesh.vertices
    ways = np.stack(frames).reshape(len(frames), -1) - neutral.ravel().astype(np.float32)
    modes, weights = principal_components(ways, MAX_ERROR_SIZES * float(np.ptp(neutral, axis=0).max()))
    shapes = neutral + modes.reshape(len(modes), -1, 3)
    names = [f"component {k + 1}" for k in range(len(modes))]
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / "rig.glb"
        write_rig(rig, target, names, shapes, scale)
        data = add_weight_animation(rig.read_bytes(), weights, rate)
    write_whole(path, data)
    return len(modes)


def principal_components(ways: F32, exact: float) -> tuple[F64, F64]:
    """Modes (k, 3 N) and weights (f, k) <= 1 whose product gives displacements (f, 3 N) to within `exact` per vertex.

    >>> modes, weights = principal_components(np.outer([1, -2, 0.5], np.arange(6)).astype(np.float32), 1e-3)
    >>> modes.shape, weights.round(3).ravel().tolist()
    ((1, 6), [-0.5, 1.0, -0.25])
    """
    exactly = ways.astype(np.float64)  # in float32 the small components would drown in noise
    values, vectors = np.linalg.eigh(exactly @ exactly.T)
    order = np.argsort(values)[::-1]
    count = 1
    while True:
        own = vectors[:, order[:count]]
        modes = own.T @ exactly
        off = (exactly - own @ modes).reshape(len(ways), -1, 3)
        if count >= len(ways) or float(np.square(off).sum(2).max()) <= exact**2:
            break
        count = min(count + max(1, count // 4), len(ways))
    most = np.take_along_axis(own, np.abs(own).argmax(0)[None], 0)[0]
    return np.asarray(modes * most[:, None], np.float64), np.asarray(own / most)


def add_weight_animation(data: bytes, weights: F64, rate: float) -> bytes:
    """A GLB with morph targets, with an animation of their weights (f, k) at `rate` frames per second."""
    held = GltfContainer.read(data, Path())
    times = append_floats(held, np.arange(len(weights)) / rate)
    sampler = {"input": times, "output": append_floats(held, weights.ravel())}
    moving = [k for k, mesh in enumerate(held.json["meshes"]) if "targets" in mesh["primitives"][0]]
    nodes = [k for k, node in enumerate(held.json["nodes"]) if node.get("mesh") in moving]
    channels = [{"sampler": 0, "target": {"node": node, "path": "weights"}} for node in nodes]
    held.entries("animations").append({"name": "expressions", "samplers": [sampler], "channels": channels})
    return held.to_glb()


def append_floats(held: GltfContainer, numbers: F64) -> int:
    """Append values (n,), or quaternions (n, 4), as float32; the index of the accessor."""
    values = np.ascontiguousarray(numbers, np.float32)
    rows = values.reshape(len(values), -1)
    ends = {"min": rows.min(0).tolist(), "max": rows.max(0).tolist()}
    entry = {
        "bufferView": held.append_view(values.tobytes()),
        "componentType": GL_FLOAT,
        "count": len(values),
        "type": "VEC4" if values.ndim == 2 else "SCALAR",
        **ends,
    }
    held.entries("accessors").append(entry)
    return len(held.json["accessors"]) - 1
