"""`guise analogy mesh preview`: a head, or two of the same vertices, as a picture or turning in a video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from guise.aam.similarity import Failed
from guise.analogy.feature_points import find
from guise.analogy.formats.files import read_mesh
from guise.analogy.mesh import Mesh
from guise.app.media.images import looks_like_image
from guise.app.media.pictures import save_picture
from guise.app.meshes import pictures
from guise.app.meshes.pictures import Head, Picture, Stand
from guise.app.meshes.reports import Distances, PreviewReport
from guise.app.meshes.work import Work
from guise.common.arrays import F64
from guise.common.files import require_outputs

SIDES = (-40.0, 0.0, 40.0)  # degrees
DRAWING = "drawing"


def preview_files(head: Path, after: Path | None, output: Path | None, work: Work) -> PreviewReport:
    """Draw a head, or one before and after and how far its vertices are apart.

    Raises
    ------
    MeshError, OutputError, MediaError
    """
    output = output or head.with_name(f"{head.stem}_preview.png")
    names = [path for path in (head, after) if path]
    require_outputs([output], names, force=work.force)
    with work.stage("reading"):
        file = read_mesh(head)
        moved = None if after is None else file.expression(after)
    titles = [path.name for path in names]
    with work.stage(DRAWING):
        found = find(file.mesh)
        points = None if isinstance(found, Failed) else found.positions
        if looks_like_image(output):
            save_picture(output, _picture(file.mesh, moved, titles, points))
        else:
            heads = _heads(file.mesh, moved, titles, points)
            pictures.turntable(
                output, heads, force=True, progress=lambda share: work.progress(DRAWING, share)
            )
    far = None if moved is None else Distances.between(file.mesh.vertices, moved)
    return PreviewReport(head, after, output, far, work.seconds)


def _picture(mesh: Mesh, moved: F64 | None, titles: list[str], points: F64 | None) -> Picture:
    if moved is not None:
        return pictures.apart(mesh, moved, (titles[0], titles[1]), points=points)
    (one,) = _heads(mesh, None, titles, points)
    named = {yaw: replace(one, title="" if yaw else one.title) for yaw in SIDES}
    return np.concatenate([pictures.strip([head], [yaw]) for yaw, head in named.items()], axis=1)


def _heads(mesh: Mesh, moved: F64 | None, titles: list[str], points: F64 | None) -> list[Head]:
    stand = Stand.of(mesh.vertices, points)
    before = Head(mesh.vertices, mesh.faces, titles[0], stand)
    if moved is None:
        return [before]
    distance = np.linalg.norm(moved - mesh.vertices, axis=1)
    warm = pictures.heated(Head(moved, mesh.faces, "how far apart", stand), distance)
    return [before, Head(moved, mesh.faces, titles[1], stand), warm]
