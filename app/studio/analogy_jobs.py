"""The jobs behind the page Analogy: transfer an expression to another photo, or expressions to another head.

The folder of a photo holds result.png or result.mp4, and montage.png; that of a head source.glb and target.glb, both
with all expressions as morph targets, and result.zip with the target's file once for each expression.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from guise.analogy.formats.files import MeshFile, write_rig
from guise.app.media import EncodeOptions
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions as HeadOptions
from guise.app.meshes.pair import TransferPair, prepare_pair
from guise.app.meshes.parts import parts_line
from guise.app.meshes.pictures import HeadView
from guise.app.meshes.transferring import WRITING, transfer_all
from guise.app.photos.animate import animate_file
from guise.app.photos.image import analogy_image
from guise.app.photos.options import AnalogyOptions as PhotoOptions
from guise.app.studio.jobs import with_user_names
from guise.common.arrays import F64
from guise.common.files import write_whole
from guise.common.progress import Progress

SOURCE, TARGET, ZIP = "source.glb", "target.glb", "result.zip"
PICTURE, VIDEO, MONTAGE = "result.png", "result.mp4", "montage.png"


def photo(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Transfer the expression of a photo, or of a clip, to another photo.

    about : files {path: name}; s (or None, for a clip), s1, t, paths; moves, whether s1 is a clip; method, mouth,
        strength.
    Returns the output's file name, a sentence, and notes.
    """
    s, s1, t = (about[role] and Path(about[role]) for role in ("s", "s1", "t"))
    options = PhotoOptions(about["method"], about["mouth"], about["strength"])
    notes: list[str] = []
    if about["moves"]:
        done = animate_file(
            s, s1, t, folder / VIDEO, options, encode=EncodeOptions(), progress=progress, say=notes.append
        )
        sentence = f"{done.animated:,} of {done.frames:,} frames animated."
        return {"output": VIDEO, "sentence": sentence, "notes": _translated(notes, about)}
    progress("working", 0.0)
    made = analogy_image(s, s1, t, folder / PICTURE, options, montage=folder / MONTAGE, say=notes.append)
    sentence = f"{made.width} x {made.height} pixels, in {made.setup_seconds + made.seconds:.1f} s."
    return {"output": PICTURE, "sentence": sentence, "notes": _translated(notes, about)}


def head(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Transfer expressions of a head to another.

    about : files {path: name}; source, expressions (empty: its morph targets), target, paths; method, keep_rigid;
        landmarks, of both, files or "auto", or None; parts, of the target, a file, or None.
    Returns the names of the expressions, the views of both heads, a sentence, and notes.
    """
    notes: list[str] = []
    context = RunContext(False, progress, notes.append)
    source, names, faces = _expressions(about, context)
    target = context.read(Path(about["target"]))
    landmarks, parts = about.get("landmarks"), about.get("parts")
    options = HeadOptions(
        about["method"], landmarks=landmarks and tuple(landmarks), keep_rigid=about["keep_rigid"],
        parts=parts and Path(parts),
    )  # fmt: skip
    pair = prepare_pair(source, target, options, context)
    made, carried = transfer_all(pair, faces, [(name, name) for name in names], context)
    with context.stage(WRITING):
        write_rig(folder / SOURCE, source, names, np.array(faces))
        write_rig(folder / TARGET, target, names, np.array(made))
        write_whole(folder / ZIP, lambda part: _pack(part, target, names, made, folder))
    found = pair.heads.correspondence.found.mean()
    seconds = sum(context.seconds.values())
    sentence = f"{len(names)} expressions, {found:.0%} of the target found on the source, {seconds:.1f} s."
    if pair.heads.parts:
        notes.append(f"Parts of the target: {parts_line(pair.heads.parts)}.")
    return {
        "names": names, "stands": _views(pair), "sentence": sentence, "notes": _translated(notes, about),
        "told": [one.summary() for one in carried],
    }  # fmt: skip


def _translated(notes: list[str], about: dict[str, Any]) -> list[str]:
    """Notes with the user's names for the files."""
    return [with_user_names(note, about) for note in notes]


def _expressions(about: dict[str, Any], context: RunContext) -> tuple[MeshFile, list[str], list[F64]]:
    """The source at rest, the names of its expressions, and its vertices (N, 3) with each."""
    source = Path(about["source"])
    if not about["expressions"]:
        rig = context.read_rig(source)
        return rig.file, list(rig.names), list(rig.shapes)
    file, paths = context.read(source), list(map(Path, about["expressions"]))
    return file, [about["files"][str(path)] for path in paths], [file.read_expression(path) for path in paths]


def _pack(part: Path, target: MeshFile, names: list[str], made: Sequence[F64], folder: Path) -> None:
    """Write a ZIP of the target's file with each expression."""
    suffix = target.path.suffix
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as packed:
        for number, (name, vertices) in enumerate(zip(names, made, strict=True)):
            one = folder / f"one{suffix}"
            target.write(one, vertices)
            packed.write(one, f"{number + 1:03d}_{name.replace('/', '_')}{suffix}")
            one.unlink()


def _views(pair: TransferPair) -> list[dict[str, Any]]:
    """Views of source and target: `turned`, rotation to right, up and forward; `centre` and `height` after it."""
    heads = pair.heads
    points = heads.points or (None, None)
    return [
        view_of(file.mesh.vertices, None if point is None else point.positions)
        for file, point in zip((heads.source, heads.target), points, strict=True)
    ]


def view_of(vertices: F64, points: F64 | None) -> dict[str, Any]:
    """How a head (N, 3) is turned upright, by its feature points (20, 3) if they are known, as in `head`'s result."""
    turned = HeadView.of(vertices, points).turned
    low, high = (turned @ vertices.T).min(1), (turned @ vertices.T).max(1)
    return {
        "turned": turned.tolist(), "centre": ((low + high) / 2).tolist(), "height": float(high[1] - low[1]),
    }  # fmt: skip
