"""Mesh files in and out: OBJ, PLY, glTF and GLB.

A file is read whole; what is computed with is its clean mesh (`guise.analogy.cleaning`).  What is written is
the file as it
was with other positions, and other normals where it has them: order, quads, groups, texture coordinates, materials,
colours and comments stay.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from guise.analogy.cleaning import Cleaned
from guise.analogy.formats.documents import Document, companions, materials_of, read_document, read_positions
from guise.analogy.formats.gltf import GltfDocument
from guise.analogy.formats.gltf_made import made_glb
from guise.analogy.formats.gltf_rig import frames, rigged
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import Mesh, MeshError
from guise.analogy.normals import Normals
from guise.common.arrays import F64, Int
from guise.common.files import natural_key, write_whole

T = TypeVar("T")

STILL = 1e-7  # of the size of a mesh, up to which a vertex does not move


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

        Material files and pictures that it names are copied along where they are not there yet.

        Raises
        ------
        MeshError
            When the suffix is another, or the vertices are not as many or not finite.
        """
        if path.suffix.lower() != self.path.suffix.lower():
            raise MeshError(f"cannot write {path}: its suffix must be {self.path.suffix}, as of {self.path}")
        placed = self.placed(self.mesh.moved(vertices).vertices)
        normals = None if self._normals is None else self._normals.moved(placed)
        _put(path, self.document.replaced(placed, normals))
        for own in self._companions:
            other = path.parent / own.resolve().relative_to(self.path.parent.resolve())
            if not other.exists():
                other.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(own, other)

    def placed(self, vertices: F64) -> F64:
        """All vertices (n, 3) of the file, for those (N, 3) of the clean mesh."""
        own, ids = self.document.vertices, self.cleaned.ids
        with_nearest = own + (vertices - self.mesh.vertices)[ids]
        return np.where(own == self.mesh.vertices[ids], vertices[ids], with_nearest)

    def expression(self, path: Path) -> F64:
        """The clean mesh's vertices (N, 3) as they stand in another file of the same vertices.

        Raises
        ------
        MeshError
            When they are not as many, or not finite.
        """
        found = _named(path, read_positions, path)
        self.check(path, len(found))
        return _named(path, self.mesh.moved, found[self.cleaned.kept]).vertices

    def check(self, path: Path, count: int) -> None:
        """MeshError when another file has not as many vertices."""
        if count != len(self.document.vertices):
            own = f"its neutral {self.path} has {len(self.document.vertices)}"
            raise MeshError(f"{path} has {count} vertices, but {own}; both must be of one topology")

    @cached_property
    def _companions(self) -> list[Path]:
        return companions(self.document, self.path.parent)

    @cached_property
    def _normals(self) -> Normals | None:
        return _normals(self.document, self.cleaned.ids)


def read_mesh(path: Path) -> MeshFile:
    """The mesh of an OBJ, PLY, glTF or GLB file.

    Raises
    ------
    MeshError
        When it cannot be read or used.
    """
    document = _named(path, read_document, path)
    return MeshFile(path, document, _named(path, _cleaned, document))


@dataclass(frozen=True, eq=False)
class Rig:
    """A mesh with named shapes.

    Parameters
    ----------
    file : of the neutral mesh, N vertices clean.   names : k.   shapes : (k, N, 3), absolute.
    """

    file: MeshFile
    names: tuple[str, ...]
    shapes: F64


def read_rig(path: Path) -> Rig:
    """The morph targets of a glTF or GLB file.

    Raises
    ------
    MeshError
        When the file cannot be used, or has none.
    """
    found = read_mesh(path)
    shapes = found.document.displacements if isinstance(found.document, GltfDocument) else {}
    if not shapes:
        raise MeshError(f"cannot use {path}: it has no morph targets; a rig is a GLB or glTF file with some")
    kept = found.cleaned.kept
    return Rig(found, tuple(shapes), np.stack([found.mesh.vertices + way[kept] for way in shapes.values()]))


def write_rig(path: Path, target: MeshFile, names: Sequence[str], shapes: F64) -> None:
    """A GLB of a target, of any format, with a morph target for each of its shapes (k, N, 3) and their names.

    Normals and materials go with it; morph targets that the target had are left out.

    Raises
    ------
    MeshError
        When the suffix is not .glb, or names and shapes do not fit or are not finite.
    """
    if path.suffix.lower() != ".glb":
        raise MeshError(f"cannot write {path}: a rig's suffix must be .glb")
    if len(names) != len(shapes) or shapes.shape[1:] != target.mesh.vertices.shape:
        raise MeshError(
            f"shapes must be ({len(names)}, {len(target.mesh.vertices)}, 3) for these names, got {shapes.shape}"
        )
    if not np.isfinite(shapes).all():
        raise MeshError("shapes must be finite, and some of them hold NaN or infinity")
    document, origin = _as_glb(target)
    normals = _normals(document, target.cleaned.ids[origin])
    size = float(np.ptp(target.mesh.vertices, axis=0).max())
    moving = np.abs(shapes - target.mesh.vertices).max(axis=(0, 2), initial=0) > STILL * size
    moves = moving[target.cleaned.ids[origin]]
    placed = ((name, target.placed(shape)[origin]) for name, shape in zip(names, shapes, strict=True))
    _put(path, _named(target.path, rigged, document, normals, placed, moves, target.path.parent))


def read_frames(path: Path, neutral: MeshFile, rate: float | None = None) -> Iterator[tuple[str, F64]]:
    """Names and vertices (N, 3) of the frames of a sequence, one read at a time.

    path : a folder of OBJ or PLY files, in natural order; or a glTF or GLB file with animated morph targets.
    neutral : of the same vertices as all frames, N of them clean.
    rate : in frames per second, of an animation; None for its keys.

    Raises
    ------
    MeshError
        When there are none, or one has other vertices than the neutral.
    """
    if not path.is_dir():
        yield from _animated(path, neutral, rate)
        return
    files = [file for file in path.iterdir() if file.suffix.lower() in (".obj", ".ply")]
    if not files:
        raise MeshError(f"the folder {path} holds no OBJ or PLY files")
    for file in sorted(files, key=lambda file: natural_key(file.name)):
        yield file.stem, neutral.expression(file)


def _animated(path: Path, neutral: MeshFile, rate: float | None) -> Iterator[tuple[str, F64]]:
    held = _named(path, read_document, path)
    if not isinstance(held, GltfDocument):
        raise MeshError(
            f"cannot use {path}: a sequence is a folder of OBJ or PLY files, or an animated GLB or glTF file"
        )
    neutral.check(path, len(held.vertices))
    for i, vertices in enumerate(_named(path, frames, held, rate)):
        yield f"{i:04d}", _named(path, neutral.mesh.moved, vertices[neutral.cleaned.kept]).vertices


def _as_glb(target: MeshFile) -> tuple[GltfDocument, Int]:
    """A target as a GLB, and (m,) which of its own vertices those are."""
    held = target.document
    if isinstance(held, GltfDocument):
        return held, np.arange(len(held.vertices))
    materials, ids = materials_of(held, target.path.parent)
    data, origin = made_glb(held, target.cleaned.kept[target.cleaned.ids], materials, ids)
    return GltfDocument(data, target.path.parent), origin


def _normals(held: Document, places: Int) -> Normals | None:
    if held.normals is None or held.normal_ids is None:
        return None
    return Normals(held.normals, held.normal_ids, held.vertices, held.polygons, places)


def _cleaned(held: Document) -> Cleaned:
    count = len(held.vertices)
    shapes = list(held.displacements.values()) if isinstance(held, GltfDocument) else []
    return Cleaned.of(
        held.vertices,
        held.polygons,
        normals=_of_vertices(held.normals, held.normal_ids, held.polygons, count),
        apart=_apart(held, count),
        together=np.concatenate(shapes, axis=1) if shapes else None,
    )


def _apart(held: Document, count: int) -> F64 | None:
    """(n, d) why vertices may be split: texture coordinates, and parts of glTF, where there are any.

    Zeros where a vertex has several texture coordinates: then no seam needs to split it.
    """
    if held.uvs is None:
        return None
    found = _of_vertices(held.uvs, held.uv_ids, held.polygons, count)
    if isinstance(held, GltfDocument) and found is not None:
        return np.column_stack([found, held.part_ids])
    return np.zeros((count, 2)) if found is None else found


def _of_vertices(values: F64 | None, ids: Int | None, polygons: Polygons, count: int) -> F64 | None:
    """(n, d) values of the corners as those of the vertices, if all corners of a vertex have the same."""
    if values is None or ids is None:
        return None
    one = np.zeros(count, np.intp)
    one[polygons.corners] = ids
    return values[one] if (one[polygons.corners] == ids).all() else None


def _put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)


def _named(path: Path, step: Callable[..., T], *args: object) -> T:
    """What a step returns; its error says which file it is about."""
    try:
        return step(*args)
    except MeshError as error:
        raise MeshError(f"cannot use {path}: {error}") from error
