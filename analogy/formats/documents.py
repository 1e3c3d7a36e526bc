"""A mesh file's contents, whichever format it has, and the files that belong to it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol
from urllib.parse import unquote

import numpy as np

from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.materials import Material, libraries, read_materials, textures
from guise.analogy.formats.obj import ObjDocument, positions
from guise.analogy.formats.ply import PlyDocument
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64, Int

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

    @property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1."""

    def replaced(self, vertices: F64, normals: F64 | None) -> bytes:
        """The file with other vertices and normals."""


def read_document(path: Path) -> Document:
    """An OBJ, PLY, glTF or GLB file; MeshError when it cannot be read."""
    if not path.exists():
        raise MeshError("there is no such file")
    kind = path.suffix.lower()
    if kind == ".obj":
        return ObjDocument(_bytes(path))
    if kind == ".ply":
        return PlyDocument(_bytes(path))
    if kind in (".glb", ".gltf"):
        return GltfDocument(_bytes(path), path.parent)
    raise MeshError("its suffix must be .obj, .ply, .glb or .gltf")


def read_positions(path: Path) -> F64:
    """The vertices (n, 3) of a file, whose faces are not looked at where that saves time."""
    kind = path.suffix.lower()
    if kind == ".obj" and path.is_file():
        return positions(_bytes(path))
    if kind == ".ply" and path.is_file():
        return PlyDocument(_bytes(path), positions_only=True).vertices
    return read_document(path).vertices


def _bytes(path: Path) -> bytes:
    if not path.is_file():
        raise MeshError("it is no file")
    size = path.stat().st_size
    if size > LARGEST:
        raise MeshError(
            f"it has {size >> 20} MB, and more than {LARGEST >> 20} MB are not read; decimate it first"
        )
    return path.read_bytes()


def materials_of(held: Document, folder: Path) -> tuple[list[Material], Int]:
    """The materials of a document that lies in `folder`, and (p,) that of each polygon; of glTF none."""
    if isinstance(held, ObjDocument):
        names, ids = held.material_ids()
        known = read_materials(libraries(folder, held.libraries()))
        return [known.get(name, Material(name)) for name in names], ids
    picture = folder / held.texture if isinstance(held, PlyDocument) and held.texture else None
    return [Material(picture=picture)], np.zeros(len(held.polygons.sizes), np.intp)


def companions(held: Document, folder: Path) -> list[Path]:
    """The files in `folder` that a document there names for its looks."""
    named: list[Path] = []
    if isinstance(held, ObjDocument):
        named = libraries(folder, held.libraries())
        named += textures(named)
    elif isinstance(held, PlyDocument) and held.texture:
        named = [folder / held.texture]
    elif isinstance(held, GltfDocument):
        addresses = [image.get("uri", "data:") for image in held.container.json.get("images", [])]
        named = [folder / unquote(address) for address in addresses if not address.startswith("data:")]
    inside = [path for path in named if path.is_file() and path.resolve().is_relative_to(folder.resolve())]
    return list(dict.fromkeys(inside))
