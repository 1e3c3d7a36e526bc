"""What the parts of a head are: found, reported, written for the user to correct, and read again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from guise.analogy.anatomy import KINDS, Component, Kind, like_source, name_components, with_components
from guise.analogy.formats.files import MeshFile
from guise.analogy.mesh import MeshError, printable_excerpt
from guise.common.arrays import F64

HEAD = """# The parts of {path}: change `kind` where it is wrong, and pass this file to --parts.
# `vertices` holds one vertex of each component, counted from 0 as in the file.
# Kinds: {kinds}.
"""


@dataclass(frozen=True)
class NamedPart:
    """Components of a head that are called the same and are of one kind.

    by : what says so: the feature points, the name, the place in the face, the source's names, or the user's file.
    components : how many.   vertices : one of each, counted from 0 as in the file.   size : vertices in all.
    """

    kind: Kind
    name: str
    by: str
    components: int
    size: int
    vertices: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class NamedHead:
    """A head whose mesh says what its parts are.   components : of the clean mesh.   points : (20, 3) of the face."""

    file: MeshFile
    components: list[Component]
    points: F64

    @property
    def parts(self) -> tuple[NamedPart, ...]:
        """For reports: alike components together, the largest first."""
        return _listed(self.components, self.file)


def name_parts(
    head: MeshFile, points: F64, given: Path | None = None, source: NamedHead | None = None
) -> NamedHead:
    """The head with the kinds of its parts.

    points : feature points (20, 3).   given : a file of the user's with some of the kinds.
    source : whose names say what parts in the same places are.

    Raises
    ------
    MeshError
        When that file cannot be used.
    """
    parts = name_components(head.mesh, points, head.part_names)
    if source is not None:
        known = source.file.mesh, source.points
        parts = like_source(parts, (head.mesh, points), source.components, known)
    if given is not None:
        parts = _corrected(parts, head, given)
    return NamedHead(head.with_mesh(with_components(head.mesh, parts, points)), parts, points)


def parts_toml(path: Path, parts: Sequence[NamedPart]) -> str:
    """The text of a file that `--parts` reads."""
    tables = [
        f"[[part]]\nkind = {json.dumps(part.kind)}\nname = {json.dumps(part.name)}\n"
        f"vertices = {list(part.vertices)}  # {part.size} vertices; by {part.by}\n"
        for part in parts
    ]
    return "\n".join([HEAD.format(path=path.name, kinds=", ".join(KINDS)), *tables])


def parts_line(parts: Sequence[NamedPart]) -> str:
    """For people: the kinds, and how many components each has."""
    count: dict[str, int] = {}
    for part in parts:
        count[part.kind] = count.get(part.kind, 0) + part.components
    return ", ".join(f"{kind} ({number})" if number > 1 else kind for kind, number in count.items())


def _listed(parts: Sequence[Component], head: MeshFile) -> tuple[NamedPart, ...]:
    """Alike components together, the largest first."""
    groups: dict[tuple[Kind, str, str], list[Component]] = {}
    for part in parts:
        groups.setdefault((part.kind, part.name, part.by), []).append(part)
    kept = head.cleaned.kept
    found = [
        NamedPart(
            kind, name, by, len(alike), sum(len(part.rows) for part in alike),
            tuple(sorted(int(kept[part.rows[0]]) for part in alike)),
        )
        for (kind, name, by), alike in groups.items()
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda part: -part.size))


def _corrected(parts: Sequence[Component], head: MeshFile, path: Path) -> list[Component]:
    """The components with the kinds that a file gives them, by a vertex or by name."""
    where = np.zeros(len(head.mesh.vertices), np.intp)
    for number, part in enumerate(parts):
        where[part.rows] = number
    found = list(parts)
    for entry in _read(path):
        for number in _meant(entry, parts, where[head.cleaned.ids], path):
            found[number] = replace(found[number], kind=entry["kind"], by="file")
    if not any(part.kind == "face skin" for part in found):
        raise MeshError(f"{path} leaves no part of kind 'face skin': say which carries the face")
    return found


def _meant(entry: dict[str, Any], parts: Sequence[Component], where: Any, path: Path) -> list[int]:
    """The components that an entry names.   where : (n,) the component of each vertex of the file."""
    given = entry.get("vertices")
    if given is not None:
        bad = [k for k in given if type(k) is not int or not 0 <= k < len(where)]
        if bad:
            raise MeshError(f"{path}: a vertex must be from 0 to {len(where) - 1}, got {bad[0]!r}")
        return sorted({int(where[k]) for k in given})
    found = [number for number, part in enumerate(parts) if part.name == entry["name"]]
    if not found:
        named = ", ".join(dict.fromkeys(repr(printable_excerpt(part.name)) for part in parts[:20]))
        raise MeshError(f"{path}: no part is called {entry['name']!r}; there are {named}")
    return found


def _read(path: Path) -> list[dict[str, Any]]:
    """The entries of a file, checked."""
    import tomllib

    try:
        held = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise MeshError(f"{path} cannot be read: give a TOML file of parts") from error
    except ValueError as error:
        raise MeshError(f"{path} is not TOML: {error}") from error
    entries = held.get("part")
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise MeshError(f"{path} must hold [[part]] tables, each with a kind and vertices or a name")
    for entry in entries:
        if entry.get("kind") not in get_args(Kind):
            raise MeshError(f"{path}: a kind must be one of {', '.join(KINDS)}, got {entry.get('kind')!r}")
        if not isinstance(entry.get("vertices", []), list) or not isinstance(entry.get("name", ""), str):
            raise MeshError(f"{path}: vertices must be a list of numbers and a name a text, in {entry}")
        if "vertices" not in entry and "name" not in entry:
            raise MeshError(f"{path}: a part needs vertices or a name, got {entry}")
    return entries
