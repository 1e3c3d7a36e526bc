"""`guise analogy mesh landmarks`, and the feature points for the other commands."""

from __future__ import annotations

from pathlib import Path

from guise.aam.similarity import Failed
from guise.analogy.feature_point_search import refine_feature_points
from guise.analogy.feature_points import (
    FEATURE_POINT_NAMES,
    FeaturePoints,
    find_feature_points,
    load_feature_points,
)
from guise.analogy.formats.files import MeshFile
from guise.analogy.mesh import Mesh, MeshError
from guise.app.media.pictures import save_picture
from guise.app.meshes.context import RunContext
from guise.app.meshes.parts import name_parts, parts_toml
from guise.app.meshes.pictures import draw_feature_points as drawn
from guise.app.meshes.reports import LandmarksReport
from guise.common.files import fitting_name, require_outputs, write_whole

AUTO = "auto"


def feature_points_of(head: MeshFile, given: str = AUTO) -> FeaturePoints:
    """Feature points of a head: from a file, or detected.

    Raises
    ------
    MeshError, FeaturePointsError
        When they are not found, or the file cannot be used.
    """
    if given != AUTO:
        return load_feature_points(given, file_mesh(head))
    found = find_feature_points(head.mesh)
    if isinstance(found, Failed):
        raise MeshError(
            f"{head.path}: {_short_reason(found)}; give its feature points with --landmarks, from a file that "
            "`guise analogy mesh landmarks MESH --edit FILE` writes"
        )
    return found


def write_feature_points(
    path: Path,
    output: Path | None,
    edit: Path | None,
    template: tuple[Path, str] | None,
    parts_file: Path | None,
    context: RunContext,
) -> LandmarksReport:
    """Write the feature points of a head: detected, corrected by a file, or refined.

    template : a head and the file of its points or "auto"; points that match those are searched.
    parts_file : where what its parts are is written, too.

    Raises
    ------
    MeshError, FeaturePointsError, RegistrationError, OutputError
    """
    output = output or path.with_name(fitting_name(path.stem, ".landmarks.json"))
    like = () if template is None else (template[0],)
    require_outputs(
        [output, parts_file, context.picture], [path, *filter(None, [edit]), *like], force=context.force
    )
    with context.stage("reading"):
        head = context.read(path)
    with context.stage("landmarks"):
        points = _find_or_load(head, edit)
        if template is not None:
            points = _refine_by_template(head, points, context.read(template[0]), template[1])
    parts = name_parts(head, points.positions).parts
    write_whole(output, points.save)
    if parts_file is not None:
        write_whole(parts_file, parts_toml(path, parts))
    if context.picture is not None:
        with context.stage("drawing"):
            save_picture(context.picture, drawn(head.mesh, points.positions))
    confidence = dict(zip(FEATURE_POINT_NAMES, points.confidence.round(3).tolist(), strict=True))
    return LandmarksReport(
        path, output, points.as_json(), confidence, parts, parts_file, context.picture, context.seconds
    )


def _find_or_load(head: MeshFile, edit: Path | None) -> FeaturePoints:
    found = find_feature_points(head.mesh)
    if edit is not None:
        return load_feature_points(edit, file_mesh(head), None if isinstance(found, Failed) else found)
    if isinstance(found, Failed):
        raise MeshError(f"{head.path}: {_short_reason(found)}; give all 20 points with --edit")
    return found


def _refine_by_template(
    head: MeshFile, points: FeaturePoints, template: MeshFile, given: str
) -> FeaturePoints:
    """Points of a head near the given ones that match those of a template."""
    like = feature_points_of(template, given)
    places = refine_feature_points(template.mesh, like.positions, head.mesh, points.positions)
    return FeaturePoints.from_positions(file_mesh(head), places, points.confidence)


def file_mesh(head: MeshFile) -> Mesh:
    """The faces of the clean mesh over all vertices of the file, so that vertices are numbered as in the file."""
    kept = head.cleaned.kept
    return Mesh(head.document.vertices, kept[head.mesh.triangles], kept[head.mesh.quads])


def _short_reason(failure: Failed) -> str:
    """Why no points were found, without the advice, which depends on the command."""
    return failure.reason.partition(":")[0]
