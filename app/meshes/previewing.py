"""`guise analogy mesh preview`: a head, or two with the same vertices, as a picture or a turntable video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from guise.aam.similarity import Failed
from guise.analogy.feature_points import find_feature_points
from guise.analogy.mesh import Mesh
from guise.analogy.tents import vertex_error
from guise.app.media.file_kind import has_image_name
from guise.app.media.pictures import save_picture
from guise.app.meshes import pictures
from guise.app.meshes.context import RunContext
from guise.app.meshes.pictures import DrawnHead, HeadView, Picture
from guise.app.meshes.reports import Distances, MotionError, PreviewReport
from guise.common.arrays import F64
from guise.common.errors import OutputError
from guise.common.files import fitting_name, require_outputs

SIDES = (-40.0, 0.0, 40.0)  # degrees
DRAWING = "drawing"


def preview_files(
    head: Path, after: Path | None, output: Path | None, context: RunContext, truth: Path | None = None
) -> PreviewReport:
    """Draw a head, or a head before and after with the distances between the vertices.

    truth : what `after` should be, beside which it is drawn, with its error in bands.

    Raises
    ------
    MeshError, OutputError, MediaError
    """
    output = output or head.with_name(fitting_name(head.stem, "_preview.png"))
    names = [path for path in (head, after, truth) if path]
    if truth is not None and (after is None or not has_image_name(output)):
        raise OutputError(
            "a truth is compared in a picture: give the result as well, and a picture as output"
        )
    require_outputs([output], names, force=context.force)
    with context.stage("reading"):
        file = context.read(head)
        moved, true = (None if path is None else file.read_expression(path) for path in (after, truth))
    titles = [path.name for path in names]
    with context.stage(DRAWING):
        found = find_feature_points(file.mesh)
        points = None if isinstance(found, Failed) else found.positions
        if true is not None and moved is not None:
            save_picture(output, pictures.draw_bands(file.mesh, true, moved, points))
        elif has_image_name(output):
            save_picture(output, _draw_picture(file.mesh, moved, titles, points))
        else:
            heads = _drawn_heads(file.mesh, moved, titles, points)
            pictures.write_turntable(
                output, heads, force=True, progress=lambda share: context.progress(DRAWING, share)
            )
    rest = file.mesh.vertices
    far = None if moved is None else Distances.between(rest if true is None else true, moved)
    error = None if true is None or moved is None else MotionError.of(vertex_error(rest, true, moved))
    return PreviewReport(head, after, output, far, context.seconds, truth, error)


def _draw_picture(mesh: Mesh, moved: F64 | None, titles: list[str], points: F64 | None) -> Picture:
    if moved is not None:
        return pictures.draw_distances(mesh, moved, (titles[0], titles[1]), points=points)
    (one,) = _drawn_heads(mesh, None, titles, points)
    named = {yaw: replace(one, title="" if yaw else one.title) for yaw in SIDES}
    return np.concatenate([pictures.draw_strip([head], [yaw]) for yaw, head in named.items()], axis=1)


def _drawn_heads(mesh: Mesh, moved: F64 | None, titles: list[str], points: F64 | None) -> list[DrawnHead]:
    if moved is not None:
        return pictures.distance_heads(mesh, moved, (titles[0], titles[1]), points)
    return [DrawnHead(mesh.vertices, mesh.faces, titles[0], HeadView.of(mesh.vertices, points))]
