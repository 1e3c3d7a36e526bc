"""The contents of a mesh file of any format, and the files that belong to it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol
from urllib.parse import unquote

import numpy as np

from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.materials import Material, library_paths, read_materials, texture_paths
from guise.analogy.formats.obj import ObjDocument, read_obj_positions
from guise.analogy.formats.ply import PlyDocument
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import MeshError
from guise.common.arrays import F64, Int

MAX_FILE_BYTES = 1 << 30  # bytes of a file
GLTF_SUFFIXES = (".glb", ".gltf", ".vrm")


class Document(Protocol):
    """The contents of a mesh file."""

    vertices: F64  # (n, 3)
    polygons: Polygons

    @property
    def normals(self) -> F64 | None:
        """(k, 3)."""

    @property
    def normal_ids(self) -> Int | None:
        """(c,) index of the normal of each corner of the polygons."""

    @property
    def uvs(self) -> F64 | None:
        """(m, 2) texture coordinates."""

    @property
    def uv_ids(self) -> Int | None:
        """(c,) index of the texture coordinates of each corner."""

    @property
    def colours(self) -> F64 | None:
        """(n, 3) from 0 to 1."""

    def encode(self, vertices: F64, normals: F64 | None) -> bytes:
        """The bytes of the file with other vertices and normals."""


def read_document(path: Path) -> Document:
    """An OBJ, PLY, glTF, GLB or VRM file; MeshError when it cannot be read."""
    if not path.exists():
        raise MeshError("the file does not exist")
    kind = path.suffix.lower()
    if kind == ".obj":
        return ObjDocument(_read_bytes(path))
    if kind == ".ply":
        return PlyDocument(_read_bytes(path))
    if kind in GLTF_SUFFIXES:
        return GltfDocument(read_gltf_bytes(path), path.parent)
    raise MeshError("its suffix must be .obj, .ply, .glb, .gltf or .vrm")


def read_positions(path: Path) -> F64:
    """The vertices (n, 3) of a file; its faces are skipped where that saves time."""
    kind = path.suffix.lower()
    if kind == ".obj" and path.is_file():
        return read_obj_positions(_read_bytes(path))
    if kind == ".ply" and path.is_file():
        return PlyDocument(_read_bytes(path), positions_only=True).vertices
    return read_document(path).vertices


def read_gltf_bytes(path: Path) -> bytes:
    """The bytes of a glTF, GLB or VRM file; MeshError for a VRM that is no GLB."""
    data = _read_bytes(path)
    if path.suffix.lower() == ".vrm" and data[:4] != b"glTF":
        raise MeshError(
            "it is no VRM file, or an encrypted one: export it again from the program that made it"
        )
    return data


def _read_bytes(path: Path) -> bytes:
    if not path.is_file():
        raise MeshError("it is not a file")
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise MeshError(
            f"it has {size >> 20} MB, but at most {MAX_FILE_BYTES >> 20} MB are read: decimate the mesh first"
        )
    if not size:
        raise MeshError("it is empty: export the mesh again")
    return path.read_bytes()


def document_materials(held: Document, folder: Path) -> tuple[list[Material], Int]:
    """The materials of a document in `folder`, and (p,) the index for each polygon; not for glTF."""
    if isinstance(held, ObjDocument):
        names, ids = held.material_ids()
        known = read_materials(library_paths(folder, held.libraries()))
        return [known.get(name, Material(name)) for name in names], ids
    picture = folder / held.texture if isinstance(held, PlyDocument) and held.texture else None
    return [Material(picture=picture)], np.zeros(len(held.polygons.sizes), np.intp)


def document_names(held: Document) -> tuple[list[str], Int]:
    """What a document calls its parts, by object or node, group and material, and (n,) the index for each vertex."""
    if isinstance(held, GltfDocument):
        return held.part_names()
    if not isinstance(held, ObjDocument):
        return [""], np.zeros(len(held.vertices), np.intp)
    known = held.part_ids()
    keys, ids = np.unique(np.stack([ids for _, ids in known], axis=1), axis=0, return_inverse=True)
    said = [[names[k] for (names, _), k in zip(known, key, strict=True)] for key in keys.tolist()]
    of_vertices = np.zeros(len(held.vertices), np.intp)
    of_vertices[held.polygons.corners] = np.repeat(ids.ravel(), held.polygons.sizes)
    return [" / ".join(filter(None, dict.fromkeys(names))) for names in said], of_vertices


def companion_files(held: Document, folder: Path) -> list[Path]:
    """The material files and textures in `folder` that a document names."""
    named: list[Path] = []
    if isinstance(held, ObjDocument):
        named = library_paths(folder, held.libraries())
        named += texture_paths(named)
    elif isinstance(held, PlyDocument) and held.texture:
        named = [folder / held.texture]
    elif isinstance(held, GltfDocument):
        addresses = [image.get("uri", "data:") for image in held.container.json.get("images", [])]
        named = [folder / unquote(address) for address in addresses if not address.startswith("data:")]
    inside = [path for path in named if path.is_file() and path.resolve().is_relative_to(folder.resolve())]
    return list(dict.fromkeys(inside))
