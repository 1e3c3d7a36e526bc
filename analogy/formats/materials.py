"""Materials of OBJ files (MTL): the properties that glTF can represent, and the files they are in."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True)
class Material:
    """A material: name, colour (r, g, b, opacity) from 0 to 1, and the texture that multiplies it."""

    name: str = ""
    colour: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    picture: Path | None = None


def read_materials(paths: list[Path]) -> dict[str, Material]:
    """The materials of MTL files by name; missing files and unreadable lines are ignored."""
    found: dict[str, Material] = {}
    for path in paths:
        current = Material()
        for line in path.read_text("utf-8", "replace").splitlines() if path.is_file() else ():
            keyword, _, rest = line.strip().partition(" ")
            if keyword == "newmtl":
                current = Material(rest.strip())
            else:
                current = _with_statement(current, keyword, rest.strip(), path.parent)
            found[current.name] = current
    found.pop("", None)
    return found


def library_paths(folder: Path, names: list[str]) -> list[Path]:
    """The files that `mtllib` lines name: each line one file, or several separated by spaces."""
    whole = [folder / name for name in names]
    return [
        one
        for path, name in zip(whole, names, strict=True)
        for one in ([path] if path.is_file() else [folder / word for word in name.split()])
    ]


def texture_paths(paths: list[Path]) -> list[Path]:
    """The textures of all kinds that MTL files name."""
    found = []
    for path in paths:
        for line in path.read_text("utf-8", "replace").splitlines() if path.is_file() else ():
            keyword, _, rest = line.strip().partition(" ")
            if keyword.lower().startswith(("map_", "bump", "norm", "disp", "decal", "refl")):
                found.append(path.parent / _picture_name(rest.strip()))
    return found


def _picture_name(rest: str) -> str:
    """The name of a picture, without the options before it."""
    return (rest.split()[-1] if rest.startswith("-") else rest).replace("\\", "/")


def _with_statement(material: Material, keyword: str, rest: str, folder: Path) -> Material:
    red, green, blue, opacity = material.colour
    try:
        if keyword == "Kd":
            red, green, blue = (float(word) for word in rest.split()[:3])
        elif keyword in ("d", "Tr"):
            opacity = float(rest.split()[-1]) if keyword == "d" else 1 - float(rest.split()[-1])
        elif keyword == "map_Kd" and rest:
            return replace(material, picture=folder / _picture_name(rest))
    except (ValueError, IndexError):
        return material
    return replace(material, colour=(red, green, blue, opacity))
