"""Writes morph targets into a glTF document, and reads the weights of its animation."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from guise.analogy.formats.gltf import (
    GltfDocument,
    GltfPart,
    damage_as_mesh_error,
    scene_parts,
    scene_roots,
    target_names,
)
from guise.analogy.formats.gltf_container import GL_ELEMENT_ARRAY_BUFFER, GltfContainer, Json, read_uri
from guise.analogy.formats.humanoid import add_standing_bones, bones_of
from guise.analogy.formats.vrm import VrmMeta, Weights, add_vrm, clear_expressions, write_expressions
from guise.analogy.mesh import MeshError
from guise.analogy.normals import StoredNormals, any_coordinate, polygon_vertex_normals
from guise.common.arrays import F32, F64, Bool


@dataclass(frozen=True)
class SparseSettings:
    """What a morph target leaves out."""

    min_motion_sizes: float = 1e-4  # of a vertex, of the size of its part: 0.03 mm on a head
    min_normal_turn: float = 2e-2  # of a unit normal: one degree


SPARSE = SparseSettings()


@dataclass(frozen=True)
class Avatar:
    """What a VRM is given besides its morph targets.

    expressions : of the head that they come from.   meta : where the document is no VRM yet, and becomes one.
    """

    expressions: Mapping[str, Weights]
    meta: VrmMeta | None = None


def build_rig_glb(
    document: GltfDocument,
    normals: StoredNormals | None,
    shapes: Iterable[tuple[str, F64]],
    moving: Bool,
    folder: Path,
    scale: float = 1.0,
    *,
    inside_out: bool = False,
    avatar: Avatar | None = None,
) -> bytes:
    """A GLB of a document with new morph targets in place of its own.

    normals : of the document, None if it has none.   shapes : names and vertices (n, 3) in the scene.
    moving : (n,) whether any shape moves a vertex; meshes that do not move get no targets.
    folder : of the textures that the document names; they are embedded.   scale : of the whole scene.
    inside_out : whether the document is, so that its faces are wound the other way.
    avatar : for a VRM: it keeps its morph targets but those of the same names, and gets expressions.
    """
    with damage_as_mesh_error():
        made = document.container.copy()
        keeps = avatar is not None and document.vrm is not None
        _drop_animations(made)
        if not keeps:
            _drop_targets(made)
        pairs = zip(document.parts, scene_parts(made), strict=True)
        parts = [
            (part, own, _extent(document, part))
            for part, own in pairs
            if _moves(part, document.parts, moving)
        ]
        side = _turn(made, document) if inside_out else 1.0
        listed = {own.mesh: target_names(made, own) for _, own, _ in parts}
        names: list[str] = []
        for name, vertices in shapes:
            names.append(name)
            for own_names in listed.values():
                own_names += [] if name in own_names else [name]
            turned = None if normals is None else normals.updated(vertices)
            for part, own, extent in parts:
                target = _target(made, document, part, extent, vertices, turned, side)
                at = listed[own.mesh].index(name)
                for primitive in own.primitives:
                    primitive.setdefault("targets", [])[at : at + 1] = [target]
        for mesh, own_names in listed.items():
            _name_targets(made.json, mesh, own_names)
        _embed_textures(made, folder)
        if scale != 1:
            _scale_scene(made, scale)
        if avatar is not None and avatar.meta is not None:
            low, high = (scale * end for end in (document.vertices.min(0), document.vertices.max(0)))
            bones = bones_of(made) or add_standing_bones(made, scene_roots(made), low, high)
            add_vrm(made, avatar.meta, bones)
        if avatar is not None and (keeps or avatar.meta is not None):
            write_expressions(made, names, avatar.expressions)
        return made.to_glb()


def _name_targets(held: Json, number: int, names: list[str]) -> None:
    """Name the morph targets of a mesh, in its primitives too where they are named, and let new ones start at 0."""
    mesh = held["meshes"][number]
    for place in (mesh, *mesh["primitives"]):
        extras = place.get("extras") if isinstance(place.get("extras"), dict) else {}
        if place is mesh or "targetNames" in extras:
            place["extras"] = {**extras, "targetNames": names}
    mesh["weights"] = _extended(mesh.get("weights", []), len(names))
    for node in held["nodes"]:
        if node.get("mesh") == number and "weights" in node:
            node["weights"] = _extended(node["weights"], len(names))


def _extended(weights: list[float], count: int) -> list[float]:
    return [*weights, *[0.0] * (count - len(weights))]


def _turn(made: GltfContainer, document: GltfDocument) -> float:
    """Wind all faces the other way, and turn normals that look inwards as they did; -1 if they were turned."""
    inwards = polygon_vertex_normals(document.vertices, document.polygons)
    agree = document.normals is not None and float((document.normals * inwards).sum()) > 0
    for part, own in zip(document.parts, scene_parts(made), strict=True):
        count = part.rows.stop - part.rows.start
        for primitive in own.primitives:
            given = primitive.get("indices")
            faces = np.arange(count) if given is None else made.read_accessor(given)
            backwards = faces.astype(np.uint32).reshape(-1, 3)[:, ::-1].reshape(-1, 1)
            primitive["indices"] = made.append_accessor(backwards, GL_ELEMENT_ARRAY_BUFFER)
        if agree and own.has_attribute("NORMAL"):
            index = own.primitives[0]["attributes"]["NORMAL"]
            outwards = -made.read_accessor(index).astype(np.float64)
            own.write_attribute(made, "NORMAL", outwards, np.ones(count, bool))
    return -1.0 if agree else 1.0


def _scale_scene(made: GltfContainer, scale: float) -> None:
    """Put the whole scene under a node that scales it."""
    scene = made.json.setdefault("scenes", [{"nodes": scene_roots(made)}])[made.json.setdefault("scene", 0)]
    made.entries("nodes").append({"name": "unit", "scale": [scale] * 3, "children": scene.get("nodes", [])})
    scene["nodes"] = [len(made.json["nodes"]) - 1]


def _moves(part: GltfPart, parts: list[GltfPart], moving: Bool) -> bool:
    return any(moving[other.rows].any() for other in parts if other.mesh == part.mesh)


def _extent(held: GltfDocument, part: GltfPart) -> float:
    return float(np.ptp(held.vertices[part.rows], axis=0).max())


def _target(
    made: GltfContainer,
    held: GltfDocument,
    part: GltfPart,
    extent: float,
    vertices: F64,
    normals: F64 | None,
    side: float,
) -> dict[str, int]:
    """The accessors of the displacements of a part of an extent, sparse where most of it stays.

    side : -1 where the normals of the document are written turned.
    """
    way = vertices[part.rows] - held.vertices[part.rows]
    least = SPARSE.min_motion_sizes * extent
    columns = {"POSITION": (part.from_scene(way, is_position=False), any_coordinate(np.abs(way) > least))}
    if normals is not None and held.normals is not None and part.has_attribute("NORMAL"):
        turn = part.normals_from_scene(normals[part.rows]) - part.normals_from_scene(held.normals[part.rows])
        columns["NORMAL"] = side * turn, any_coordinate(np.abs(turn) > SPARSE.min_normal_turn)
    return {
        name: made.append_sparse_accessor(values.astype(np.float32), np.flatnonzero(moves))
        for name, (values, moves) in columns.items()
    }


def _drop_targets(made: GltfContainer) -> None:
    """Remove morph targets, their names and weights, and what expressions say of them."""
    clear_expressions(made.json)
    for mesh in made.json["meshes"]:
        mesh.pop("weights", None)
        for primitive in mesh["primitives"]:
            primitive.pop("targets", None)
        for held in (mesh, *mesh["primitives"]):
            if isinstance(held.get("extras"), dict):
                held["extras"].pop("targetNames", None)
    for node in made.json["nodes"]:
        node.pop("weights", None)


def _drop_animations(made: GltfContainer) -> None:
    """Remove the animations of morph targets."""
    animations = made.json.pop("animations", [])
    for animation in animations:
        animation["channels"] = [c for c in animation["channels"] if c["target"]["path"] != "weights"]
    kept = [animation for animation in animations if animation["channels"]]
    if kept:
        made.json["animations"] = kept


def _embed_textures(made: GltfContainer, folder: Path) -> None:
    """Embed textures from separate files."""
    for image in made.json.get("images", []):
        address = image.get("uri", "data:")
        if not address.startswith("data:"):
            data = read_uri(address, folder)
            image["bufferView"] = made.append_view(data)
            image["mimeType"] = "image/png" if data[:4] == b"\x89PNG" else "image/jpeg"
            del image["uri"]


def animation_frames(document: GltfDocument, rate: float | None) -> Iterator[F64]:
    """Vertices (n, 3) in the scene for each frame of the first animation of morph targets.

    rate : frames per second; None for the times of the keys.  Nodes do not move.

    Raises
    ------
    MeshError
        When there is no such animation.
    """
    with damage_as_mesh_error():
        count, weights = _read_animation(document.container, rate)
        deltas = [_deltas(document, part) for part in document.parts]
        given = [weights.get(part.node, _rest_weights(document.container, part)) for part in document.parts]
        tracks = [np.broadcast_to(w, (count, len(d))) for w, d in zip(given, deltas, strict=True)]
    parts = list(zip(document.parts, deltas, tracks, strict=True))
    return (_frame(document, parts, i) for i in range(count))


def _frame(document: GltfDocument, parts: list[tuple[GltfPart, F32, F64]], frame: int) -> F64:
    vertices = document.vertices.copy()
    for part, delta, weights in parts:
        vertices[part.rows] += (weights[frame].astype(np.float32) @ delta).reshape(-1, 3)
    return vertices


def _read_animation(container: GltfContainer, rate: float | None) -> tuple[int, dict[int, F64]]:
    """The number f of frames, and the weights (f, k) of each animated node."""
    for candidate in container.json.get("animations", []):
        channels = [c for c in candidate["channels"] if c["target"]["path"] == "weights"]
        if channels:
            samplers = {c["target"]["node"]: candidate["samplers"][c["sampler"]] for c in channels}
            keys = {node: _read_floats(container, held["input"])[:, 0] for node, held in samplers.items()}
            times = np.unique(np.concatenate(list(keys.values())))
            if rate is not None:
                times = times[0] + np.arange(int((times[-1] - times[0]) * rate + 1e-6) + 1) / rate
            made = {
                node: _sample_weights(container, held, keys[node], times) for node, held in samplers.items()
            }
            return len(times), made
    raise MeshError("it has no animation of morph targets")


def _deltas(document: GltfDocument, part: GltfPart) -> F32:
    """(k, 3 m) displacements of the morph targets of a part, in the scene."""
    count = part.rows.stop - part.rows.start
    found = np.zeros((len(part.targets()), 3 * count), np.float32)
    for row, target in zip(found, part.targets(), strict=True):
        row[:] = part.read_displacement(document.container, target).ravel()
    return found


def _rest_weights(container: GltfContainer, part: GltfPart) -> F64:
    """(1, k) the weights of a part without animation."""
    mesh = container.json["meshes"][part.mesh].get("weights", [0.0] * len(part.targets()))
    return np.array([container.json["nodes"][part.node].get("weights", mesh)], np.float64)


def _sample_weights(container: GltfContainer, sampler: Json, keys: F64, times: F64) -> F64:
    """(f, k) the weights of a sampler at times (f,)."""
    method = sampler.get("interpolation", "LINEAR")
    values = _read_floats(container, sampler["output"])
    at = np.clip(np.searchsorted(keys, times, "right") - 1, 0, max(len(keys) - 2, 0))
    after = np.minimum(at + 1, len(keys) - 1)
    span = keys[after] - keys[at]
    s = np.clip((times - keys[at]) / np.where(span > 0, span, 1.0), 0, 1)[:, None]
    if method == "CUBICSPLINE":
        into, value, out = values.reshape(len(keys), 3, -1).transpose(1, 0, 2)
        start, end = value[at], value[after]
        slopes = (s**3 - 2 * s**2 + s) * out[at] + (s**3 - s**2) * into[after]
        return (2 * s**3 - 3 * s**2 + 1) * start + (3 * s**2 - 2 * s**3) * end + span[:, None] * slopes
    grid = values.reshape(len(keys), -1)
    if method == "STEP":
        s = np.floor(s)
    return (1 - s) * grid[at] + s * grid[after]


def _read_floats(container: GltfContainer, accessor: int) -> F64:
    return np.asarray(container.read_accessor(accessor), np.float64)
