"""Mesh files in and out: OBJ, PLY, glTF and GLB.

A file is read whole; what is computed with is its clean mesh (`analogy.cleaning`).  What is written is the file as it
was with other positions, and other normals where it has them: order, quads, groups, texture coordinates, materials,
colours and comments stay.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from analogy.cleaning import Cleaned
from analogy.gltf import GltfDocument
from analogy.mesh import Mesh, MeshError
from analogy.normals import Normals
from analogy.obj import ObjDocument, positions
from analogy.ply import PlyDocument
from analogy.polygons import Polygons

F64 = NDArray[np.float64]
Int = NDArray[np.intp]

T = TypeVar("T")

LARGEST = 1 << 30  # bytes of a file


class Document(Protocol):
    """A mesh file's contents."""

    vertices: F64  # (n, 3)
    polygons: Polygons

    @property
    def normals(self) -> F64 | None:
        """(k, 3)."""

    @property
    def normal_ids(self) -> Int | None:
        """(c,) the normal of each corner of the polygons."""

    @property
    def uvs(self) -> F64 | None:
        """(m, 2) texture coordinates."""

    @property
    def uv_ids(self) -> Int | None:
        """(c,) those of each corner."""

    def replaced(self, vertices: F64, normals: F64 | None) -> bytes:
        """The file with other vertices and normals."""


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file and the mesh to compute with."""

    path: Path
    document: Document
    cleaned: Cleaned

    @property
    def mesh(self) -> Mesh:
        return self.cleaned.mesh

    def write(self, path: Path, vertices: F64) -> None:
        """The file with the clean mesh's vertices (N, 3) moved there, as `path`, of the same format.

        Raises
        ------
        MeshError
            When the suffix is another, or the vertices are not as many or not finite.
        """
        if path.suffix.lower() != self.path.suffix.lower():
            raise MeshError(f"cannot write {path}: its suffix must be {self.path.suffix}, as of {self.path}")
        placed = self.placed(self.mesh.moved(vertices).vertices)
        normals = None if self._normals is None else self._normals.moved(self.document.vertices, placed)
        _put(path, self.document.replaced(placed, normals))

    def placed(self, vertices: F64) -> F64:
        """All vertices (n, 3) of the file, for those (N, 3) of the clean mesh."""
        ids = self.cleaned.ids
        return np.asarray(vertices[ids] + (self.document.vertices - self.mesh.vertices[ids]))

    def expression(self, path: Path) -> F64:
        """The clean mesh's vertices (N, 3) as they stand in another file of the same vertices.

        Raises
        ------
        MeshError
            When they are not as many, or not finite.
        """
        found = _named(path, _positions, path)
        if len(found) != len(self.document.vertices):
            raise MeshError(
                f"{path} has {len(found)} vertices, but its neutral {self.path} has {len(self.document.vertices)}"
            )
        return _named(path, self.mesh.moved, found[self.cleaned.kept]).vertices

    @cached_property
    def _normals(self) -> Normals | None:
        held = self.document
        if held.normals is None or held.normal_ids is None:
            return None
        return Normals(held.normals, held.normal_ids, held.polygons, self.cleaned.ids)


def read_mesh(path: Path) -> MeshFile:
    """The mesh of an OBJ, PLY, glTF or GLB file.

    Raises
    ------
    MeshError
        When it cannot be read or used.
    """
    document = _named(path, _document, path)
    return MeshFile(path, document, _named(path, _cleaned, document))


def _cleaned(held: Document) -> Cleaned:
    count = len(held.vertices)
    shapes = list(held.displacements.values()) if isinstance(held, GltfDocument) else []
    return Cleaned.of(
        held.vertices,
        held.polygons,
        normals=_of_vertices(held.normals, held.normal_ids, held.polygons, count),
        apart=None if held.uvs is None else _apart(held, count),
        together=np.concatenate(shapes, axis=1) if shapes else None,
    )


def _apart(held: Document, count: int) -> F64:
    """Texture coordinates (n, 2) of the vertices; zeros where one has several: then no seam needs to split it."""
    found = _of_vertices(held.uvs, held.uv_ids, held.polygons, count)
    return np.zeros((count, 2)) if found is None else found


def _of_vertices(values: F64 | None, ids: Int | None, polygons: Polygons, count: int) -> F64 | None:
    """(n, d) values of the corners as those of the vertices, if all corners of a vertex have the same."""
    if values is None or ids is None:
        return None
    one = np.zeros(count, np.intp)
    one[polygons.corners] = ids
    return values[one] if (one[polygons.corners] == ids).all() else None


def _document(path: Path) -> Document:
    kind = path.suffix.lower()
    if kind == ".obj":
        return ObjDocument(_bytes(path))
    if kind == ".ply":
        return PlyDocument(_bytes(path))
    if kind in (".glb", ".gltf"):
        return GltfDocument(_bytes(path), path.parent)
    raise MeshError(_UNKNOWN)


def _positions(path: Path) -> F64:
    kind = path.suffix.lower()
    if kind == ".obj":
        return positions(_bytes(path))
    if kind == ".ply":
        return PlyDocument(_bytes(path), positions_only=True).vertices
    return _document(path).vertices


_UNKNOWN = "its suffix must be .obj, .ply, .glb or .gltf"


def _bytes(path: Path) -> bytes:
    if not path.is_file():
        raise MeshError("there is no such file")
    size = path.stat().st_size
    if size > LARGEST:
        raise MeshError(
            f"it has {size >> 20} MB, and more than {LARGEST >> 20} MB are not read; decimate it first"
        )
    return path.read_bytes()


def _put(path: Path, data: bytes) -> None:
    """Written under another name first, so that a file is complete or not there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)


def _named(path: Path, step: Callable[..., T], *args: object) -> T:
    """What a step returns; its error says which file it is about."""
    try:
        return step(*args)
    except MeshError as error:
        raise MeshError(f"cannot use {path}: {error}") from error
