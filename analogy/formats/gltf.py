"""glTF and GLB: the triangles of a scene as one mesh, written back into the document.

Coordinates are those of the scene: node transformations are applied, and inverted for writing.  A mesh with a skeleton
stands as the joint that moves most of it puts it: morph targets act before the skeleton, so the pose of other joints,
such as the arms of an avatar, does not matter.  The vertices of the file are those of its primitives, node by node.
Tangents are left unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from guise.analogy.formats.gltf_container import GltfContainer, Json
from guise.analogy.formats.polygons import Polygons
from guise.analogy.formats.vrm import read_vrm
from guise.analogy.mesh import MeshError, printable_excerpt
from guise.analogy.normals import finite_or_zero, unit_vectors
from guise.common.arrays import F64, Bool, Int

GL_TRIANGLES = 4


@dataclass(frozen=True, eq=False)
class GltfPart:
    """The vertices that primitives of a mesh share.

    Parameters
    ----------
    rows : their range in the file.   node, mesh : ids.   primitives : that share them.
    matrix : (4, 4) from mesh to scene coordinates.
    """

    rows: slice
    node: int
    mesh: int
    primitives: list[Json]
    matrix: F64

    def targets(self) -> list[dict[str, int]]:
        """The morph targets: accessor by attribute."""
        found: list[dict[str, int]] = self.primitives[0].get("targets", [])
        return found

    def read_displacement(self, container: GltfContainer, target: dict[str, int]) -> F64:
        """(m, 3) of a morph target, in the scene."""
        if "POSITION" not in target:
            return np.zeros((self.rows.stop - self.rows.start, 3))
        return self.to_scene(
            container.read_accessor(target["POSITION"]).astype(np.float64), is_position=False
        )

    def has_attribute(self, name: str) -> bool:
        """Whether it has an attribute."""
        return name in self.primitives[0]["attributes"]

    def write_attribute(self, container: GltfContainer, name: str, values: F64, rows: Bool) -> None:
        """Replace values (m, 3) in the given rows of an attribute, if it exists."""
        index = self.primitives[0]["attributes"].get(name)
        if index is not None and rows.any():
            now = container.update_accessor(index, values, rows)
            for primitive in self.primitives:
                primitive["attributes"][name] = now

    def to_scene(self, values: F64, *, is_position: bool) -> F64:
        """Positions or displacements (m, 3) of the mesh in scene coordinates."""
        turned = values @ self.matrix[:3, :3].T
        return turned + self.matrix[:3, 3] if is_position else turned

    def from_scene(self, values: F64, *, is_position: bool) -> F64:
        """The inverse."""
        moved = values - self.matrix[:3, 3] if is_position else values
        return moved @ np.linalg.inv(self.matrix[:3, :3]).T

    def normals_to_scene(self, normals: F64) -> F64:
        """Normals (m, 3) of the mesh in scene coordinates."""
        return unit_vectors(normals @ np.linalg.inv(self.matrix[:3, :3]))

    def normals_from_scene(self, normals: F64) -> F64:
        """The inverse."""
        return unit_vectors(normals @ self.matrix[:3, :3])


class GltfDocument:
    """A glTF or GLB file.

    Parameters
    ----------
    data : its bytes.   folder : of other files that it names.

    Attributes
    ----------
    vertices : (n, 3) in the scene.   polygons : its triangles.   container, parts : its contents.
    vrm : the avatar that it is, if it is one.

    Raises
    ------
    MeshError
        When it is not glTF 2.0, damaged, or compressed without the library for it, or a mesh occurs twice in the scene.
    """

    def __init__(self, data: bytes, folder: Path) -> None:
        self._data = data
        with damage_as_mesh_error():
            self.container = GltfContainer.read(data, folder)
            self.vrm = read_vrm(self.container.json)
            self.parts = scene_parts(self.container)
            self.vertices = self._gather_attribute("POSITION", 3)
            for part in self.parts:
                self.vertices[part.rows] = part.to_scene(self.vertices[part.rows], is_position=True)
            self.polygons = self._polygons()

    @cached_property
    def normals(self) -> F64 | None:
        """(n, 3) in the scene; 0 for parts without normals."""
        if not self._has_attribute("NORMAL"):
            return None
        found = finite_or_zero(self._gather_attribute("NORMAL", 3))
        for part in self.parts:
            found[part.rows] = part.normals_to_scene(found[part.rows])
        return found

    @property
    def normal_ids(self) -> Int | None:
        return None if self.normals is None else self.polygons.corners

    @cached_property
    def uvs(self) -> F64 | None:
        """(n, 2); 0 for parts without texture coordinates."""
        return self._gather_attribute("TEXCOORD_0", 2) if self._has_attribute("TEXCOORD_0") else None

    @property
    def uv_ids(self) -> Int | None:
        return None if self.uvs is None else self.polygons.corners

    @property
    def part_ids(self) -> Int:
        """(n,) the part of each vertex."""
        return np.repeat(
            np.arange(len(self.parts)), [part.rows.stop - part.rows.start for part in self.parts]
        )

    def part_names(self) -> tuple[list[str], Int]:
        """The names of node, mesh and material of each primitive, and (n,) the index for each vertex."""
        names: list[str] = []
        found = np.zeros(len(self.vertices), np.intp)
        materials = self.container.json.get("materials", [])
        for part in self.parts:
            node, mesh = self.container.json["nodes"][part.node], self.container.json["meshes"][part.mesh]
            for primitive in part.primitives:
                material = materials[primitive["material"]] if "material" in primitive else {}
                said = [str(held.get("name", "")) for held in (node, mesh, material)]
                found[part.rows][self._local_faces(part, primitive)] = len(names)
                names.append(" / ".join(filter(None, dict.fromkeys(said))))
        return names, found

    def _local_faces(self, part: GltfPart, primitive: Json) -> Int:
        """The faces (m, 3) of a primitive, by vertices of its part."""
        count = part.rows.stop - part.rows.start
        held = (
            self.container.read_accessor(primitive["indices"]) if "indices" in primitive else np.arange(count)
        )
        return np.asarray(held.astype(np.intp).reshape(-1, 3))

    @cached_property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1, linear; 0 for parts without colours."""
        return self._gather_attribute("COLOR_0", 3) if self._has_attribute("COLOR_0") else None

    @cached_property
    def displacements(self) -> dict[str, F64]:
        """Displacements (n, 3) of each morph target by name; meshes may share a name."""
        found: dict[str, F64] = {}
        with damage_as_mesh_error(), np.errstate(invalid="ignore"):
            for part in self.parts:
                for name, target in zip(target_names(self.container, part), part.targets(), strict=True):
                    held = found.setdefault(name, np.zeros(self.vertices.shape))
                    held[part.rows] = part.read_displacement(self.container, target)
        bad = next((name for name, way in found.items() if not np.isfinite(way).all()), None)
        if bad is not None:
            raise MeshError(f"its morph target {printable_excerpt(bad)} is not finite (NaN or infinite)")
        return found

    @property
    def expressions(self) -> dict[str, dict[str, float]]:
        """Those of an avatar by name: weights of morph targets by name."""
        names = {part.node: target_names(self.container, part) for part in self.parts}
        given = {} if self.vrm is None else self.vrm.expressions
        return {
            name: {names[bind.node][bind.index]: bind.weight for bind in binds if bind.node in names}
            for name, binds in given.items()
        }

    @property
    def repeated_names(self) -> list[str]:
        """Names that several morph targets of one mesh share."""
        given = [_given_names(self.container, part)[: len(part.targets())] for part in self.parts]
        return list(
            dict.fromkeys(name for names in given for name in names if name and names.count(name) > 1)
        )

    def encode(self, vertices: F64, normals: F64 | None) -> bytes:
        """The file with other vertices (n, 3) and normals (n, 3)."""
        if (vertices == self.vertices).all():
            return self._data
        made = self.container.copy()
        for part, own in zip(self.parts, scene_parts(made), strict=True):
            rows = part.rows
            moved = (vertices[rows] != self.vertices[rows]).any(axis=1)
            own.write_attribute(made, "POSITION", part.from_scene(vertices[rows], is_position=True), moved)
            if normals is not None and self.normals is not None:
                turned = (normals[rows] != self.normals[rows]).any(axis=1)
                own.write_attribute(made, "NORMAL", part.normals_from_scene(normals[rows]), turned)
        return made.to_glb() if self._data[:4] == b"glTF" else made.to_gltf()

    def _has_attribute(self, name: str) -> bool:
        return any(part.has_attribute(name) for part in self.parts)

    def _gather_attribute(self, name: str, width: int) -> F64:
        """(n, width) an attribute of all parts; 0 where it is missing."""
        found = np.zeros((self.parts[-1].rows.stop if self.parts else 0, width))
        with damage_as_mesh_error(), np.errstate(invalid="ignore"):  # NaN is reported later
            for part in self.parts:
                index = part.primitives[0]["attributes"].get(name)
                if index is not None:
                    found[part.rows] = self.container.read_accessor(index)[:, :width]
        return found

    def _polygons(self) -> Polygons:
        triangles = [np.zeros((0, 3), np.intp)]
        for part in self.parts:
            count = part.rows.stop - part.rows.start
            for primitive in part.primitives:
                faces = self._local_faces(part, primitive)
                if faces.size and faces.max() >= count:
                    raise MeshError(f"a face names vertex {faces.max()}, but its part has {count}")
                mirrored = np.linalg.det(part.matrix[:3, :3]) < 0
                triangles.append((faces[:, ::-1] if mirrored else faces) + part.rows.start)
        return Polygons.of(np.concatenate(triangles))


@contextmanager
def damage_as_mesh_error() -> Iterator[None]:
    """Turn errors caused by a malformed document into MeshError."""
    try:
        yield
    except MeshError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise MeshError(
            f"its glTF document is damaged ({type(error).__name__}: {printable_excerpt(str(error))})"
        ) from error


def target_names(container: GltfContainer, part: GltfPart) -> list[str]:
    """The names of the morph targets of a part, each once; unnamed ones and further ones of a name are numbered."""
    given = _given_names(container, part)
    count = len(part.targets())
    named = [given[i] if i < len(given) and given[i] else f"target_{i:02d}" for i in range(count)]
    found: list[str] = []
    for name in named:
        again = (f"{name}_{number}" for number in range(2, count + 2))
        found.append(next(one for one in again if one not in {*named, *found}) if name in found else name)
    return found


def _given_names(container: GltfContainer, part: GltfPart) -> list[str]:
    """The names in a part's mesh, or else in its primitive, where UniVRM and others write them."""
    for held in (container.json["meshes"][part.mesh], part.primitives[0]):
        extras = held.get("extras")
        if isinstance(extras, dict) and isinstance(extras.get("targetNames"), list):
            return [str(name) for name in extras["targetNames"]]
    return []


def scene_parts(container: GltfContainer) -> list[GltfPart]:
    """The parts of the scene, in the order of its nodes."""
    found: list[GltfPart] = []
    users: dict[int, int] = {}
    for node, matrix in _mesh_matrices(container).items():
        mesh = container.json["nodes"][node]["mesh"]
        groups: dict[int, list[Json]] = {}
        for primitive in container.json["meshes"][mesh]["primitives"]:
            if primitive.get("mode", GL_TRIANGLES) > GL_TRIANGLES:
                raise MeshError("it contains triangle strips or fans: export it as plain triangles")
            if primitive.get("mode", GL_TRIANGLES) == GL_TRIANGLES:
                groups.setdefault(primitive["attributes"]["POSITION"], []).append(primitive)
        for accessor, primitives in groups.items():
            if users.setdefault(accessor, node) != node:
                name = container.json["meshes"][mesh].get("name", mesh)
                raise MeshError(
                    f"its mesh {name} occurs in the scene more than once: give each object a mesh of its own"
                )
            start = found[-1].rows.stop if found else 0
            rows = slice(start, start + len(container.read_accessor(accessor)))
            found.append(GltfPart(rows, node, mesh, primitives, matrix))
    return found


def _mesh_matrices(container: GltfContainer) -> dict[int, F64]:
    """Nodes with a mesh, and the matrix (4, 4) from mesh to scene coordinates."""
    nodes = container.json.get("nodes", [])
    world = _world_matrices(container)
    found = {}
    for node, matrix in world.items():
        if "mesh" in nodes[node]:
            skin = nodes[node].get("skin")
            found[node] = matrix if skin is None else _joint_matrix(container, nodes[node], world)
            if abs(np.linalg.det(found[node][:3, :3])) < 1e-30:
                raise MeshError(f"its node {nodes[node].get('name', node)} is scaled to zero")
    return found


def scene_roots(container: GltfContainer) -> list[int]:
    """The nodes at the top of the scene; without a scene, all that are nobody's children."""
    nodes, scenes = container.json.get("nodes", []), container.json.get("scenes", [])
    if scenes:
        return list(scenes[container.json.get("scene", 0)].get("nodes", []))
    children = {child for node in nodes for child in node.get("children", [])}
    return [i for i in range(len(nodes)) if i not in children]


def _world_matrices(container: GltfContainer) -> dict[int, F64]:
    """The matrix (4, 4) of each node of the scene, parents first."""
    nodes = container.json.get("nodes", [])
    world: dict[int, F64] = {}
    waiting = [(node, np.eye(4)) for node in reversed(scene_roots(container))]
    while waiting:
        node, above = waiting.pop()
        if node not in world:
            world[node] = above @ _local_matrix(nodes[node])
            waiting += [(child, world[node]) for child in reversed(nodes[node].get("children", []))]
    return world


def _local_matrix(node: Json) -> F64:
    """A node's own transformation (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    turn = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    found = np.eye(4)
    found[:3, :3] = np.array(turn) * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    found[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return found


def _joint_matrix(container: GltfContainer, node: Json, world: dict[int, F64]) -> F64:
    """The matrix (4, 4) of the joint that moves most of a node's mesh."""
    skin, mesh = container.json["skins"][node["skin"]], container.json["meshes"][node["mesh"]]
    joint = _dominant_joint(container, mesh, len(skin["joints"]))
    matrix = world.get(skin["joints"][joint], np.eye(4))
    if "inverseBindMatrices" not in skin:
        return matrix
    inverse = container.read_accessor(skin["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4)
    return np.asarray(matrix @ inverse[joint].T)


def _dominant_joint(container: GltfContainer, mesh: Json, count: int) -> int:
    """The joint, of `count`, with the largest sum of weights over the vertices of a mesh; the first without weights."""
    total = np.zeros(count)
    for primitive in mesh["primitives"]:
        held = primitive["attributes"]
        for name in filter(held.__contains__, ("JOINTS_0", "JOINTS_1")):
            joints = container.read_accessor(held[name]).astype(np.intp)
            weights = container.read_accessor(held[name.replace("JOINTS", "WEIGHTS")]).astype(np.float64)
            total += np.bincount(joints.ravel(), weights.ravel(), minlength=count)
    return int(total.argmax())
