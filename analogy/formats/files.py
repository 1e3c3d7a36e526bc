"""Reads and writes mesh files: OBJ, PLY, glTF, GLB and VRM.

A file is read as a whole; computations use its clean mesh (`guise.analogy.cleaning`).  It is written as it was read,
with new positions and, if it has normals, new normals: order, quads, groups, texture coordinates, materials, colours
and comments stay.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from guise.analogy.cleaning import CleanedMesh
from guise.analogy.formats.documents import (
    Document,
    companion_files,
    document_materials,
    document_names,
    read_document,
    read_positions,
)
from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.gltf_build import build_glb
from guise.analogy.formats.gltf_rig import Avatar, animation_frames, build_rig_glb
from guise.analogy.formats.humanoid import bones_of
from guise.analogy.formats.polygons import Polygons
from guise.analogy.formats.vrm import VrmMeta, Weights
from guise.analogy.mesh import Mesh, MeshError, printable_excerpt
from guise.analogy.normals import StoredNormals, any_coordinate
from guise.common.arrays import F64, Int
from guise.common.files import natural_key, write_whole

T = TypeVar("T")

MIN_MOTION_SIZES = 1e-5  # of the size of a mesh, up to which a vertex does not move


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file and its clean mesh."""

    path: Path
    document: Document
    cleaned: CleanedMesh

    @property
    def mesh(self) -> Mesh:
        return self.cleaned.mesh

    @property
    def notes(self) -> list[str]:
        """What the user should know of the file, a sentence each."""
        found = []
        if self.cleaned.turned:
            found.append(
                f"{self.path} is inside out, as a mirrored head is: its faces are turned for the work, and stay as "
                "they are in files of its own format"
            )
        repeated = self.document.repeated_names if isinstance(self.document, GltfDocument) else []
        if repeated:
            names = ", ".join(printable_excerpt(name) for name in repeated)
            found.append(
                f"{self.path} has several morph targets of one name ({names}): all but the first are numbered"
            )
        return found

    @property
    def part_names(self) -> list[str]:
        """What the file calls the part of each vertex (N) of the clean mesh; "" where it says nothing."""
        names, ids = _with_file_name(self.path, document_names, self.document)
        return [names[k] for k in ids[self.cleaned.kept]]

    def with_mesh(self, mesh: Mesh) -> MeshFile:
        """The file with more said about its clean mesh."""
        return replace(self, cleaned=replace(self.cleaned, mesh=mesh))

    def write(self, path: Path, vertices: F64) -> None:
        """Write the file with the vertices (N, 3) of the clean mesh to `path`, in the same format.

        Material files and pictures that it names are copied along unless they exist.

        Raises
        ------
        MeshError
            When the suffix differs, or the vertices are too few, too many or not finite.
        """
        if path.suffix.lower() != self.path.suffix.lower():
            raise MeshError(
                f"cannot write {path}: its suffix must be {self.path.suffix}, as that of {self.path}"
            )
        placed = self.to_file_vertices(self.mesh.with_vertices(vertices).vertices)
        normals = None if self._normals is None else self._normals.updated(placed)
        _write(path, self.document.encode(placed, normals))
        for own in self._companions:
            other = path.parent / own.resolve().relative_to(self.path.parent.resolve())
            if not other.exists():
                other.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(own, other)

    def to_file_vertices(self, vertices: F64) -> F64:
        """All vertices (n, 3) of the file, given those (N, 3) of the clean mesh."""
        own, ids = self.document.vertices, self.cleaned.ids
        with_nearest = own + (vertices - self.mesh.vertices)[ids]
        return np.where(own == self.mesh.vertices[ids], vertices[ids], with_nearest)

    def read_expression(self, path: Path) -> F64:
        """The vertices (N, 3) of the clean mesh as they are in another file with the same vertices.

        Raises
        ------
        MeshError
            When their number differs, or one is not finite.
        """
        found = _with_file_name(path, read_positions, path)
        self.require_vertex_count(path, len(found))
        return _with_file_name(path, self.mesh.with_vertices, found[self.cleaned.kept]).vertices

    def require_vertex_count(self, path: Path, count: int) -> None:
        """Raise MeshError when another file has a different number of vertices."""
        if count != len(self.document.vertices):
            own = f"its neutral {self.path} has {len(self.document.vertices)}"
            raise MeshError(f"{path} has {count} vertices, but {own}: both must have the same topology")

    @cached_property
    def _companions(self) -> list[Path]:
        return companion_files(self.document, self.path.parent)

    @cached_property
    def _normals(self) -> StoredNormals | None:
        return _stored_normals(self.document, self.cleaned.ids)


def read_mesh(path: Path) -> MeshFile:
    """The mesh of an OBJ, PLY, glTF, GLB or VRM file.

    Raises
    ------
    MeshError
        When it cannot be read or used.
    """
    document = _with_file_name(path, read_document, path)
    return MeshFile(path, document, _with_file_name(path, _clean, document))


@dataclass(frozen=True, eq=False)
class Rig:
    """A mesh with named shapes.

    Parameters
    ----------
    file : of the neutral mesh, N clean vertices.   names : k.   shapes : (k, N, 3), absolute positions.
    expressions : of a VRM, by name: weights of shapes.
    """

    file: MeshFile
    names: tuple[str, ...]
    shapes: F64
    expressions: Mapping[str, Weights]


def read_rig(path: Path) -> Rig:
    """The morph targets of a glTF, GLB or VRM file.

    Raises
    ------
    MeshError
        When the file cannot be used, or has no morph targets.
    """
    found = read_mesh(path)
    document, kept = found.document, found.cleaned.kept
    shapes = document.displacements if isinstance(document, GltfDocument) else {}
    if not shapes:
        raise MeshError(
            f"cannot use {path}: it has no morph targets: give a GLB, glTF or VRM file that has some"
        )
    moved = np.stack([found.mesh.vertices + way[kept] for way in shapes.values()])
    return Rig(
        found, tuple(shapes), moved, document.expressions if isinstance(document, GltfDocument) else {}
    )


def vrm_version(file: MeshFile) -> int | None:
    """0 or 1 for a file that is a VRM."""
    held = file.document.vrm if isinstance(file.document, GltfDocument) else None
    return None if held is None else held.version


def has_skeleton(file: MeshFile) -> bool:
    """Whether a file has the bones that VRM asks for; MeshError when some are missing."""
    held = file.document
    return isinstance(held, GltfDocument) and bool(_with_file_name(file.path, bones_of, held.container))


def write_rig(
    path: Path,
    target: MeshFile,
    names: Sequence[str],
    shapes: Sequence[F64] | F64,
    scale: float = 1.0,
    *,
    expressions: Mapping[str, Weights] | None = None,
    authors: Sequence[str] = (),
) -> None:
    """Write a target of any format as GLB or VRM, with a morph target for each of its k named shapes (N, 3).

    Normals and materials are kept.  Earlier morph targets are dropped, but for a VRM with `expressions`, whose version
    and own expressions stay; another file is made VRM 1.0 where the suffix asks for it.

    scale : metres per unit of the target.   expressions : of the rig, for a VRM.   authors : of a new VRM.

    Raises
    ------
    MeshError
        When the suffix is another, names and shapes do not fit together or are not finite, or bones are missing.
    """
    if path.suffix.lower() not in (".glb", ".vrm"):
        raise MeshError(f"cannot write {path}: the suffix of a rig must be .glb or .vrm")
    avatar = None
    if expressions is not None:
        is_new = path.suffix.lower() == ".vrm" and vrm_version(target) is None
        avatar = Avatar(expressions, VrmMeta(target.path.stem, tuple(authors)) if is_new else None)
    rest = target.mesh.vertices
    if len(names) != len(shapes) or any(shape.shape != rest.shape for shape in shapes):
        got = (len(shapes), *shapes[0].shape) if len(shapes) else (0,)
        raise MeshError(f"shapes must be ({len(names)}, {len(rest)}, 3) for these names, got {got}")
    if not all(np.isfinite(shape).all() for shape in shapes):
        raise MeshError("shapes must be finite, but some contain NaN or infinity")
    document, origin = _as_glb(target)
    normals = _stored_normals(document, target.cleaned.ids[origin])
    size = target.mesh.extent
    moving = np.zeros(len(rest), bool)
    for shape in shapes:  # one by one, as all together may take a gigabyte
        moving |= any_coordinate(np.abs(shape - rest) > MIN_MOTION_SIZES * size)
    moves = moving[target.cleaned.ids[origin]]
    own = document is target.document  # what was made of another format is wound right already
    build = partial(build_rig_glb, inside_out=own and target.cleaned.turned, avatar=avatar)
    placed = (
        (name, target.to_file_vertices(shape)[origin]) for name, shape in zip(names, shapes, strict=True)
    )
    _write(
        path,
        _with_file_name(target.path, build, document, normals, placed, moves, target.path.parent, scale),
    )


def read_frames(path: Path, neutral: MeshFile, rate: float | None = None) -> Iterator[tuple[str, F64]]:
    """Names and vertices (N, 3) of the frames of a sequence, one read at a time.

    path : a folder of OBJ or PLY files, in natural order; or a glTF, GLB or VRM file with animated morph targets.
    neutral : with the vertices of all frames, N of them clean.
    rate : frames per second of an animation; None for its keys.

    Raises
    ------
    MeshError
        When there are no frames, or the vertices of one differ from the neutral.
    """
    if not path.is_dir():
        yield from _animation_frames(path, neutral, rate)
        return
    files = [file for file in path.iterdir() if file.suffix.lower() in (".obj", ".ply")]
    if not files:
        raise MeshError(f"the folder {path} holds no OBJ or PLY files")
    for file in sorted(files, key=lambda file: natural_key(file.name)):
        yield file.stem, neutral.read_expression(file)


def _animation_frames(path: Path, neutral: MeshFile, rate: float | None) -> Iterator[tuple[str, F64]]:
    held = _with_file_name(path, read_document, path)
    if not isinstance(held, GltfDocument):
        raise MeshError(
            f"cannot use {path}: a sequence is a folder of OBJ or PLY files, or an animated GLB or glTF file"
        )
    neutral.require_vertex_count(path, len(held.vertices))
    for i, vertices in enumerate(_with_file_name(path, animation_frames, held, rate)):
        yield (
            f"{i:04d}",
            _with_file_name(path, neutral.mesh.with_vertices, vertices[neutral.cleaned.kept]).vertices,
        )


def _as_glb(target: MeshFile) -> tuple[GltfDocument, Int]:
    """A target as GLB, and (m,) the original vertex of each of its vertices."""
    held = target.document
    if isinstance(held, GltfDocument):
        return held, np.arange(len(held.vertices))
    materials, ids = document_materials(held, target.path.parent)
    places, turned = target.cleaned.kept[target.cleaned.ids], target.cleaned.turned
    data, origin = build_glb(held, places, materials, ids, turned=turned)
    return GltfDocument(data, target.path.parent), origin


def _stored_normals(held: Document, places: Int) -> StoredNormals | None:
    if held.normals is None or held.normal_ids is None:
        return None
    return StoredNormals(held.normals, held.normal_ids, held.vertices, held.polygons, places)


def _clean(held: Document) -> CleanedMesh:
    count = len(held.vertices)
    shapes = list(held.displacements.values()) if isinstance(held, GltfDocument) else []
    return CleanedMesh.of(
        held.vertices,
        held.polygons,
        normals=_per_vertex(held.normals, held.normal_ids, held.polygons, count),
        apart=_split_reasons(held, count),
        together=np.concatenate(shapes, axis=1) if shapes else None,
    )


def _split_reasons(held: Document, count: int) -> F64 | None:
    """(n, d) reasons for split vertices: texture coordinates, and parts of glTF, if there are any.

    Zeros when vertices have several texture coordinates: then no seam needs to split them.
    """
    if held.uvs is None:
        return None
    found = _per_vertex(held.uvs, held.uv_ids, held.polygons, count)
    if isinstance(held, GltfDocument) and found is not None:
        return np.column_stack([found, held.part_ids])
    return np.zeros((count, 2)) if found is None else found


def _per_vertex(values: F64 | None, ids: Int | None, polygons: Polygons, count: int) -> F64 | None:
    """(n, d) values of the corners per vertex, if all corners of each vertex agree."""
    if values is None or ids is None:
        return None
    one = np.zeros(count, np.intp)
    one[polygons.corners] = ids
    return values[one] if (one[polygons.corners] == ids).all() else None


def _write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)


def _with_file_name(path: Path, step: Callable[..., T], *args: object) -> T:
    """The result of a step; its error names the file."""
    try:
        return step(*args)
    except MeshError as error:
        raise MeshError(f"cannot use {path}: {error}") from error
