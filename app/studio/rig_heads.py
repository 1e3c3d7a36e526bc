"""The head of the page Rig: the one that ships or the user's own, as the browser draws it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from guise.analogy.formats.gltf import scene_parts, scene_roots
from guise.analogy.formats.gltf_container import GltfContainer, Json
from guise.app.rig.head import RigHead, read_rig_head, shipped_head
from guise.app.studio.head_dialog import Standing
from guise.app.studio.uploads import MESH
from guise.common.arrays import F64
from guise.common.files import write_whole

NODES = ("head", "leftEye", "rightEye")  # in the order of a message's rotations
BACKWARDS = [0.0, 1.0, 0.0, 0.0]  # half a turn about the height, x y z w
MOVED_SHARE = 0.05  # of the farthest way of a vertex, from which on it belongs to the face
HEAD_FACES = 1.45  # heights of what moves in a face, of a head
RISE_FACES = 0.1  # the same, of a head's middle above that of what moves


def _check_rig(path: Path, preview: Path) -> None:
    read_rig_head(path)
    MESH.check(path, preview)


RIG = replace(
    MESH,
    name="rig",
    noun="a rig",
    suffixes=frozenset({".glb", ".vrm"}),
    advice="use a .glb or .vrm.",
    check=_check_rig,
)


@dataclass(frozen=True, eq=False)
class DrawnRig:
    """A head.   file : that the browser draws.   centre (3,), height : of the head in it."""

    head: RigHead
    file: Path
    centre: F64
    height: float

    @classmethod
    def of(cls, path: Path | None, file: Path) -> DrawnRig:
        """Write the file of the user's head, or of the one that ships."""
        head = read_rig_head(path or shipped_head())
        held = GltfContainer.read(head.data, file.parent)
        nodes, meshes = held.json["nodes"], held.json["meshes"]
        for node, weights in head.weights.items():
            shapes = [[[int(k), float(one[k])] for k in np.flatnonzero(one)] for one in weights.T]
            _add_extra(meshes[nodes[node]["mesh"]], "guiseShapes", shapes)
        for part, node in head.nodes.items():
            _add_extra(nodes[node], "guiseNode", NODES.index(part))
        if head.vrm == 0:  # which looks backwards
            nodes.append({"rotation": BACKWARDS, "children": scene_roots(held)})
            held.json |= {"scene": 0, "scenes": [{"nodes": [len(nodes) - 1]}]}
        write_whole(file, held.to_glb())
        low, high = _face(held, head)
        face = float(high[1] - low[1])
        return cls(head, file, (low + high) / 2 + (0, RISE_FACES * face, 0), HEAD_FACES * face)

    def place(self, scene: ui.scene, url: str, *, mirror: bool) -> str:
        """Put it into a scene, maybe as in a mirror; its id there."""
        view = {"turned": np.eye(3), "centre": self.centre, "height": self.height}
        return Standing(view).place(scene, url, mirror=mirror)


def _add_extra(entry: Json, name: str, value: Any) -> None:
    """Tell the browser something of a node or mesh."""
    extras = entry.get("extras")
    entry["extras"] = {**(extras if isinstance(extras, dict) else {}), name: value}


def _face(held: GltfContainer, head: RigHead) -> tuple[F64, F64]:
    """The corners (3,) of the box around what coefficients move."""
    vertices, ways = [], []
    for part in scene_parts(held):
        if part.node in head.weights:
            here = held.read_accessor(part.primitives[0]["attributes"]["POSITION"]).astype(np.float64)
            vertices.append(part.to_scene(here, is_position=True))
            moves = [
                part.read_displacement(held, target)
                for target, one in zip(part.targets(), head.weights[part.node].T, strict=True)
                if one.any()
            ]
            ways.append(np.max([np.linalg.norm(way, axis=1) for way in moves], axis=0))
    far = np.concatenate(ways)
    moved = np.concatenate(vertices)[far > MOVED_SHARE * far.max()]
    return moved.min(0), moved.max(0)
