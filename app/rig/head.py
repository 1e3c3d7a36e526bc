"""A head that coefficients drive: a GLB or VRM with ARKit's shapes, maybe with nodes for head and eyes.

Morph targets have ARKit's names, whatever their case, and with `_L` or `_R` for the side; or the expressions of a VRM
have, and tell the morph targets and their weights.  Rotations are about the nodes, on top of their rest, in the axes of
the scene, whose head looks along z, or backwards in VRM 0.x.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, coefficient_of
from guise.analogy.formats.documents import GLTF_SUFFIXES, read_gltf_bytes
from guise.analogy.formats.gltf import damage_as_mesh_error, scene_parts, target_names
from guise.analogy.formats.gltf_container import GltfContainer
from guise.analogy.formats.vrm import Vrm, read_vrm
from guise.analogy.mesh import MeshError
from guise.app.meshes.animated_glb import append_floats
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions, Unit
from guise.app.meshes.transferring import transfer_rig
from guise.app.rig.curves import RigCurves
from guise.app.rig.turns import gltf_rotation, inverse, rotated
from guise.common.arrays import F64
from guise.common.progress import Progress, Say, mute, silent
from guise.common.samples import samples_folder

SHIPPED = "heads/arkit.glb"  # of the samples
_BONES = {
    "head": r"(.*[_:.])?head",
    "leftEye": r"(.*[_:.])?(left_?eye|eye_?l(eft)?|l_?eye|l_faceeye|eye\.l)",
    "rightEye": r"(.*[_:.])?(right_?eye|eye_?r(ight)?|r_?eye|r_faceeye|eye\.r)",
}


@dataclass(frozen=True, eq=False)
class RigHead:
    """A head.

    Parameters
    ----------
    path : that the user gave.   data : bytes of its GLB.
    weights : by node with a mesh, (52, k) of each of its morph targets where a coefficient is 1.
    nodes : of "head", "leftEye" and "rightEye", those that there are.
    vrm : its version, 0 or 1, if it is a VRM.
    """

    path: Path
    data: bytes
    weights: dict[int, F64]
    nodes: dict[str, int]
    vrm: int | None = None

    @property
    def shapes(self) -> int:
        """How many of the 52 it has."""
        return (
            int(np.any([weights.any(1) for weights in self.weights.values()], 0).sum()) if self.weights else 0
        )

    def animated(self, curves: RigCurves) -> bytes:
        """The GLB with an animation of its morph targets and nodes, in place of those it had."""
        held = GltfContainer.read(self.data, self.path.parent)
        times = append_floats(held, curves.seconds - curves.seconds[0])
        samplers: list[dict[str, object]] = []
        channels: list[dict[str, object]] = []
        for node, path, values in self._driven(held, curves):
            channels.append({"sampler": len(samplers), "target": {"node": node, "path": path}})
            samplers.append({"input": times, "output": append_floats(held, values)})
        held.json["animations"] = [{"name": "face", "samplers": samplers, "channels": channels}]
        return held.to_glb()

    def _driven(self, held: GltfContainer, curves: RigCurves) -> Iterator[tuple[int, str, F64]]:
        for node, weights in self.weights.items():
            yield node, "weights", (curves.weights @ weights).ravel()
        backwards = (-1, 1, -1, 1) if self.vrm == 0 else (1, 1, 1, 1)
        above = _rotations_above(held)
        turns = {"head": curves.head, "leftEye": curves.eyes[:, 0], "rightEye": curves.eyes[:, 1]}
        for part, node in self.nodes.items():
            parent, own = above[node]
            yield (
                node,
                "rotation",
                rotated(
                    own, rotated(parent, rotated(gltf_rotation(turns[part]) * backwards, inverse(parent)))
                ),
            )


def open_head(
    path: Path | None, unit: Unit | None = None, progress: Progress = silent, say: Say = mute
) -> RigHead:
    """A head from a file, or the one that ships; one without ARKit's morph targets is given those of that one.

    unit : of the file's lengths, where it is given them.

    Raises
    ------
    MeshError
        When it cannot be read, or given them.
    """
    if path is None:
        return _read(shipped_head(), shipped_head())
    if not path.is_file():
        raise MeshError(f"{path} does not exist: give a head (.glb, .gltf, .vrm, .obj, .ply)")
    if path.suffix.lower() in GLTF_SUFFIXES:
        found = _read(path, path)
        if found.shapes:
            return found
    say(f"{path} has none of ARKit's 52 shapes: they are made for it from the head that ships")
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "rig.glb"
        transfer_rig(shipped_head(), path, made, TransferOptions(), RunContext(True, progress, say), unit)
        return _read(made, path)


def read_rig_head(path: Path) -> RigHead:
    """A head that has some of ARKit's morph targets.

    Raises
    ------
    MeshError
        When it has none, or cannot be read.
    """
    found = _read(path, path)
    if not found.shapes:
        raise MeshError(
            f"{path} has none of ARKit's 52 shapes, such as jawOpen: `guise analogy mesh rig` makes them for a head"
        )
    return found


def shipped_head() -> Path:
    """The head that ships with Guise."""
    return samples_folder() / SHIPPED


def _read(file: Path, path: Path) -> RigHead:
    try:
        with damage_as_mesh_error():
            held = GltfContainer.read(read_gltf_bytes(file), file.parent)
            vrm = read_vrm(held.json)
            weights = {
                part.node: _weights(target_names(held, part), part.node, vrm)
                for part in scene_parts(held)
                if part.targets()
            }
    except MeshError as error:
        raise MeshError(f"cannot use {path}: {error}") from error
    driven = {node: own for node, own in weights.items() if own.any()}
    return RigHead(path, held.to_glb(), driven, _bones(held, vrm), None if vrm is None else vrm.version)


def _weights(names: list[str], node: int, vrm: Vrm | None) -> F64:
    """(52, k) of the morph targets of a node: by expressions, and for other coefficients by names."""
    found = np.zeros((len(ARKIT_NAMES), len(names)))
    told = [(coefficient_of(name), binds) for name, binds in ({} if vrm is None else vrm.expressions).items()]
    for place, binds in told:
        for bind in binds:
            if place >= 0 and bind.node == node:
                found[place, bind.index] += bind.weight
    by_expression = {place for place, binds in told if binds}
    for index, name in enumerate(names):
        if (place := coefficient_of(name)) >= 0 and place not in by_expression:
            found[place, index] = 1.0
    return found


def _bones(held: GltfContainer, vrm: Vrm | None) -> dict[str, int]:
    """The nodes of head and eyes that can be turned: those with a matrix can't be animated."""
    nodes = held.json.get("nodes", [])
    names = ["" if "matrix" in node else str(node.get("name", "")).lower() for node in nodes]
    told = {} if vrm is None else {part: k for part, k in vrm.bones.items() if part in _BONES and names[k]}
    found = {
        part: next((k for k, name in enumerate(names) if re.fullmatch(pattern, name)), None)
        for part, pattern in _BONES.items()
    }
    return {part: k for part, k in {**found, **told}.items() if k is not None}


def _rotations_above(held: GltfContainer) -> dict[int, tuple[F64, F64]]:
    """By node the rotation of its parent in the scene, and its own, quaternions x y z w."""
    nodes = held.json.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    found: dict[int, tuple[F64, F64]] = {}
    waiting = [(k, np.array([0.0, 0, 0, 1])) for k in range(len(nodes)) if k not in children]
    while waiting:
        k, parent = waiting.pop()
        own = _own_rotation(nodes[k])
        found[k] = parent, own
        waiting += [(child, rotated(own, parent)) for child in nodes[k].get("children", [])]
    return found


def _own_rotation(node: dict[str, object]) -> F64:
    if "matrix" not in node:
        return np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    from scipy.spatial.transform import Rotation

    turned = np.array(node["matrix"], np.float64).reshape(4, 4).T[:3, :3]
    return np.asarray(Rotation.from_matrix(turned / np.linalg.norm(turned, axis=0)).as_quat())
