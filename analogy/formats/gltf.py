"""glTF and GLB: the triangles of a scene as one mesh, written back to their places in the document.

Coordinates are those of the scene: the transformations of the nodes are applied, and undone for writing.  A mesh with
a skeleton stands as it is bound.  The vertices of the file are those of its primitives, node after node.  Tangents stay
as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from guise.analogy.formats.gltf_container import Container, Json
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError, shown
from guise.analogy.normals import sound, unit
from guise.common.arrays import F64, Bool, Int

TRIANGLES = 4
BOUND = 1e-3  # of the size of a joint's matrix, up to which all joints stand as bound


@dataclass(frozen=True, eq=False)
class Part:
    """The vertices that primitives of a mesh share.

    Parameters
    ----------
    rows : of them among the file's.   node, mesh : ids of theirs.   primitives : those of the mesh.
    matrix : (4, 4) from the mesh's coordinates to the scene's.
    """

    rows: slice
    node: int
    mesh: int
    primitives: list[Json]
    matrix: F64

    def targets(self) -> list[dict[str, int]]:
        """The morph targets: accessors by attribute."""
        found: list[dict[str, int]] = self.primitives[0].get("targets", [])
        return found

    def displacement(self, container: Container, target: dict[str, int]) -> F64:
        """(m, 3) of a morph target, in the scene."""
        if "POSITION" not in target:
            return np.zeros((self.rows.stop - self.rows.start, 3))
        return self.to_scene(container.array(target["POSITION"]).astype(np.float64), place=False)

    def has(self, name: str) -> bool:
        """Whether it has an attribute."""
        return name in self.primitives[0]["attributes"]

    def change(self, container: Container, name: str, values: F64, rows: Bool) -> None:
        """Other numbers (m, 3) in those rows of an attribute, if it has it."""
        index = self.primitives[0]["attributes"].get(name)
        if index is not None and rows.any():
            now = container.change(index, values, rows)
            for primitive in self.primitives:
                primitive["attributes"][name] = now

    def to_scene(self, values: F64, *, place: bool) -> F64:
        """Positions (place) or displacements (m, 3) of the mesh, in the scene."""
        turned = values @ self.matrix[:3, :3].T
        return turned + self.matrix[:3, 3] if place else turned

    def from_scene(self, values: F64, *, place: bool) -> F64:
        """The inverse."""
        moved = values - self.matrix[:3, 3] if place else values
        return moved @ np.linalg.inv(self.matrix[:3, :3]).T

    def normals_to_scene(self, normals: F64) -> F64:
        """Normals (m, 3) of the mesh, in the scene."""
        return unit(normals @ np.linalg.inv(self.matrix[:3, :3]))

    def normals_from_scene(self, normals: F64) -> F64:
        """The inverse."""
        return unit(normals @ self.matrix[:3, :3])


class GltfDocument:
    """A glTF or GLB file.

    Parameters
    ----------
    data : its bytes.   folder : where other files that it names are.

    Attributes
    ----------
    vertices : (n, 3) in the scene.   polygons : its triangles.   container, parts : what it is made of.

    Raises
    ------
    MeshError
        When it is none, damaged, compressed, or one mesh is in the scene twice.
    """

    def __init__(self, data: bytes, folder: Path) -> None:
        self._data = data
        with undamaged():
            self.container = Container.read(data, folder)
            self.parts = parts_of(self.container)
            self.vertices = self._gathered("POSITION", 3)
            for part in self.parts:
                self.vertices[part.rows] = part.to_scene(self.vertices[part.rows], place=True)
            self.polygons = self._polygons()

    @cached_property
    def normals(self) -> F64 | None:
        """(n, 3) in the scene; 0 for parts without."""
        if not self._has("NORMAL"):
            return None
        found = sound(self._gathered("NORMAL", 3))
        for part in self.parts:
            found[part.rows] = part.normals_to_scene(found[part.rows])
        return found

    @property
    def normal_ids(self) -> Int | None:
        return None if self.normals is None else self.polygons.corners

    @cached_property
    def uvs(self) -> F64 | None:
        """(n, 2); 0 for parts without."""
        return self._gathered("TEXCOORD_0", 2) if self._has("TEXCOORD_0") else None

    @property
    def uv_ids(self) -> Int | None:
        return None if self.uvs is None else self.polygons.corners

    @property
    def part_ids(self) -> Int:
        """(n,) the part of each vertex."""
        return np.repeat(
            np.arange(len(self.parts)), [part.rows.stop - part.rows.start for part in self.parts]
        )

    @cached_property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1, linear; 0 for parts without."""
        return self._gathered("COLOR_0", 3) if self._has("COLOR_0") else None

    @cached_property
    def displacements(self) -> dict[str, F64]:
        """Of each morph target (n, 3), by name; a name that several meshes have is one."""
        found: dict[str, F64] = {}
        with undamaged(), np.errstate(invalid="ignore"):
            for part in self.parts:
                for name, target in zip(target_names(self.container, part), part.targets(), strict=True):
                    held = found.setdefault(name, np.zeros(self.vertices.shape))
                    held[part.rows] = part.displacement(self.container, target)
        bad = next((name for name, way in found.items() if not np.isfinite(way).all()), None)
        if bad is not None:
            raise MeshError(f"its morph target {shown(bad)} is not finite (NaN or infinite)")
        return found

    def replaced(self, vertices: F64, normals: F64 | None) -> bytes:
        """The file with other vertices (n, 3) and normals (n, 3)."""
        if (vertices == self.vertices).all():
            return self._data
        made = self.container.copy()
        for part, own in zip(self.parts, parts_of(made), strict=True):
            rows = part.rows
            moved = (vertices[rows] != self.vertices[rows]).any(axis=1)
            own.change(made, "POSITION", part.from_scene(vertices[rows], place=True), moved)
            if normals is not None and self.normals is not None:
                turned = (normals[rows] != self.normals[rows]).any(axis=1)
                own.change(made, "NORMAL", part.normals_from_scene(normals[rows]), turned)
        return made.glb() if self._data[:4] == b"glTF" else made.gltf()

    def _has(self, name: str) -> bool:
        return any(part.has(name) for part in self.parts)

    def _gathered(self, name: str, width: int) -> F64:
        """(n, width) an attribute of all parts."""
        found = np.zeros((self.parts[-1].rows.stop if self.parts else 0, width))
        with undamaged(), np.errstate(invalid="ignore"):  # of NaN, which is found later
            for part in self.parts:
                index = part.primitives[0]["attributes"].get(name)
                if index is not None:
                    found[part.rows] = self.container.array(index)[:, :width]
        return found

    def _polygons(self) -> Polygons:
        triangles = [np.zeros((0, 3), np.intp)]
        for part in self.parts:
            count = part.rows.stop - part.rows.start
            for primitive in part.primitives:
                held = (
                    self.container.array(primitive["indices"]) if "indices" in primitive else np.arange(count)
                )
                faces = held.astype(np.intp).reshape(-1, 3)
                if faces.size and faces.max() >= count:
                    raise MeshError(f"a face names vertex {faces.max()}, but its part has {count}")
                mirrored = np.linalg.det(part.matrix[:3, :3]) < 0
                triangles.append((faces[:, ::-1] if mirrored else faces) + part.rows.start)
        return Polygons.of(np.concatenate(triangles))


@contextmanager
def undamaged() -> Iterator[None]:
    """What goes wrong within, in reading a document that does not hold what it should, is a MeshError."""
    try:
        yield
    except MeshError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise MeshError(
            f"its glTF document is damaged ({type(error).__name__}: {shown(str(error))})"
        ) from error


def target_names(container: Container, part: Part) -> list[str]:
    """The names of a part's morph targets; of one that has none, its number."""
    mesh = container.json["meshes"][part.mesh]
    given = [str(name) for name in (mesh.get("extras") or {}).get("targetNames", [])]
    count = len(part.targets())
    return [*given[:count], *(f"target_{i:02d}" for i in range(len(given), count))]


def parts_of(container: Container) -> list[Part]:
    """The parts of the scene, in the order of its nodes."""
    found: list[Part] = []
    users: dict[int, int] = {}
    for node, matrix in _placed_meshes(container).items():
        mesh = container.json["nodes"][node]["mesh"]
        groups: dict[int, list[Json]] = {}
        for primitive in container.json["meshes"][mesh]["primitives"]:
            if primitive.get("mode", TRIANGLES) > TRIANGLES:
                raise MeshError("it draws triangles as strips or fans; export it as plain triangles")
            if primitive.get("mode", TRIANGLES) == TRIANGLES:
                groups.setdefault(primitive["attributes"]["POSITION"], []).append(primitive)
        for accessor, primitives in groups.items():
            if users.setdefault(accessor, node) != node:
                name = container.json["meshes"][mesh].get("name", mesh)
                raise MeshError(
                    f"its mesh {name} is in the scene more than once; give each object a mesh of its own"
                )
            start = found[-1].rows.stop if found else 0
            rows = slice(start, start + len(container.array(accessor)))
            found.append(Part(rows, node, mesh, primitives, matrix))
    return found


def _placed_meshes(container: Container) -> dict[int, F64]:
    """Nodes with a mesh, and the matrix (4, 4) from its coordinates to the scene's."""
    nodes = container.json.get("nodes", [])
    world = _world(container)
    found = {}
    for node, matrix in world.items():
        if "mesh" in nodes[node]:
            skin = nodes[node].get("skin")
            found[node] = matrix if skin is None else _bound(container, skin, world)
            if abs(np.linalg.det(found[node][:3, :3])) < 1e-30:
                raise MeshError(f"its node {nodes[node].get('name', node)} is scaled to nothing")
    return found


def _world(container: Container) -> dict[int, F64]:
    """The matrix (4, 4) of each node of the scene, parents first."""
    nodes, scenes = container.json.get("nodes", []), container.json.get("scenes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [i for i in range(len(nodes)) if i not in children]
    if scenes:
        roots = scenes[container.json.get("scene", 0)].get("nodes", [])
    world: dict[int, F64] = {}
    waiting = [(node, np.eye(4)) for node in reversed(roots)]
    while waiting:
        node, above = waiting.pop()
        if node not in world:
            world[node] = above @ _matrix(nodes[node])
            waiting += [(child, world[node]) for child in reversed(nodes[node].get("children", []))]
    return world


def _matrix(node: Json) -> F64:
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


def _bound(container: Container, skin: int, world: dict[int, F64]) -> F64:
    """The matrix (4, 4) that all joints of a skeleton at rest give."""
    held = container.json["skins"][skin]
    joints = [world.get(joint, np.eye(4)) for joint in held["joints"]]
    if "inverseBindMatrices" in held:
        inverse = container.array(held["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4)
        joints = [joint @ bind.T for joint, bind in zip(joints, inverse, strict=False)]
    if np.abs(np.array(joints) - joints[0]).max() > BOUND * np.abs(joints[0]).max():
        raise MeshError("its skeleton is posed; export it in the pose in which it is bound (rest pose)")
    return joints[0]
