"""The work behind the page Analogy: an expression carried to another photo, and expressions to another head.

A photo's folder holds result.png or result.mp4, and montage.png; a head's source.glb and target.glb, both with all
expressions as morph targets, and result.zip, the target's file once for each.
"""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from guise.analogy.formats.files import MeshFile, read_mesh, read_rig, write_rig
from guise.app.media import EncodeOptions
from guise.app.meshes.pair import Carrier, open_carrier
from guise.app.meshes.pair import How as HeadHow
from guise.app.meshes.pictures import Stand
from guise.app.meshes.transferring import WRITING, carry_all
from guise.app.meshes.work import Work
from guise.app.photos.animate import animate_file
from guise.app.photos.image import How as PhotoHow
from guise.app.photos.image import analogy_image
from guise.app.studio.naming import called
from guise.common.arrays import F64
from guise.common.files import write_whole
from guise.common.progress import Progress

SOURCE, TARGET, ZIP = "source.glb", "target.glb", "result.zip"
PICTURE, VIDEO, MONTAGE = "result.png", "result.mp4", "montage.png"


def photo(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Put the expression of a photo, or of a clip, on another photo.

    about : files {path: name}; s (or None, for a clip), s1, t, paths; moves, whether s1 is a clip; method, mouth,
        strength.
    Returns the output's file name, a sentence, and notes.
    """
    s, s1, t = (about[role] and Path(about[role]) for role in ("s", "s1", "t"))
    how = PhotoHow(about["method"], about["mouth"], about["strength"])
    notes: list[str] = []
    with called(_names(about)):
        if about["moves"]:
            done = animate_file(
                s, s1, t, folder / VIDEO, how, encode=EncodeOptions(), progress=progress, say=notes.append
            )
            words = f"{done.animated:,} of {done.frames:,} frames move."
            return {"output": VIDEO, "sentence": words, "notes": _told(notes, about)}
        progress("working", 0.0)
        made = analogy_image(s, s1, t, folder / PICTURE, how, montage=folder / MONTAGE, say=notes.append)
    words = f"{made.width} x {made.height} pixels, in {made.setup_seconds + made.seconds:.1f} s."
    return {"output": PICTURE, "sentence": words, "notes": _told(notes, about)}


def head(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Carry expressions of a head over to another.

    about : files {path: name}; source, expressions (empty: its morph targets), target, paths; method, keep_rigid.
    Returns the names of the expressions, how both heads stand, a sentence, and notes.
    """
    notes: list[str] = []
    work = Work(False, progress, notes.append)
    with called(_names(about)):
        source, names, faces = _expressions(about)
        target = read_mesh(Path(about["target"]))
        carrier = open_carrier(source, target, HeadHow(about["method"], keep_rigid=about["keep_rigid"]), work)
        made, carried = carry_all(carrier, faces, [(name, name) for name in names], work)
        with work.stage(WRITING):
            write_rig(folder / SOURCE, source, names, np.array(faces))
            write_rig(folder / TARGET, target, names, np.array(made))
            write_whole(folder / ZIP, lambda part: _pack(part, target, names, made, folder))
    found = carrier.pair.correspondence.found.mean()
    seconds = sum(work.seconds.values())
    words = f"{len(names)} expressions, {found:.0%} of the target found on the source, {seconds:.1f} s."
    return {
        "names": names, "stands": _stands(carrier), "sentence": words, "notes": _told(notes, about),
        "told": [one.words() for one in carried],
    }  # fmt: skip


def _names(about: dict[str, Any]) -> dict[Path, str]:
    return {Path(path): name for path, name in about["files"].items()}


def _told(notes: list[str], about: dict[str, Any]) -> list[str]:
    """Notes with the user's names for the files."""
    for path, name in _names(about).items():
        notes = [note.replace(str(path), name).replace(path.name, name) for note in notes]
    return notes


def _expressions(about: dict[str, Any]) -> tuple[MeshFile, list[str], list[F64]]:
    """The source at rest, the names of its expressions, and its vertices (N, 3) with each."""
    source = Path(about["source"])
    if not about["expressions"]:
        rig = read_rig(source)
        return rig.file, list(rig.names), list(rig.shapes)
    file, paths = read_mesh(source), list(map(Path, about["expressions"]))
    return file, [about["files"][str(path)] for path in paths], [file.expression(path) for path in paths]


def _pack(part: Path, target: MeshFile, names: list[str], made: list[F64], folder: Path) -> None:
    """A zip of the target's file with each expression."""
    suffix = target.path.suffix
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as packed:
        for number, (name, vertices) in enumerate(zip(names, made, strict=True)):
            one = folder / f"one{suffix}"
            target.write(one, vertices)
            packed.write(one, f"{number + 1:03d}_{name.replace('/', '_')}{suffix}")
            one.unlink()


def _stands(carrier: Carrier) -> list[dict[str, Any]]:
    """How source and target are to be shown: `turned`, rows that lead to right, up and forward; `centre`, `height`."""
    pair = carrier.pair
    points = pair.points or (None, None)
    return [
        _stand(file.mesh.vertices, None if point is None else point.positions)
        for file, point in zip((pair.source, pair.target), points, strict=True)
    ]


def _stand(vertices: F64, points: F64 | None) -> dict[str, Any]:
    turned = Stand.of(vertices, points).turned
    low, high = (turned @ vertices.T).min(1), (turned @ vertices.T).max(1)
    return {
        "turned": turned.tolist(), "centre": ((low + high) / 2).tolist(), "height": float(high[1] - low[1]),
    }  # fmt: skip
