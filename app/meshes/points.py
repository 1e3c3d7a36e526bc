"""`guise analogy mesh landmarks`, and where the other commands have feature points from."""

from __future__ import annotations

from pathlib import Path

from guise.aam.similarity import Failed
from guise.analogy.feature_points import NAMES, FeaturePoints, find, load
from guise.analogy.formats.files import MeshFile, read_mesh
from guise.analogy.landmark_search import refine_points
from guise.analogy.mesh import Mesh, MeshError
from guise.app.media.pictures import save_picture
from guise.app.meshes.pictures import landmarks as drawn
from guise.app.meshes.reports import LandmarksReport
from guise.app.meshes.work import Work
from guise.common.files import require_outputs, write_whole

AUTO = "auto"


def points_of(head: MeshFile, given: str = AUTO) -> FeaturePoints:
    """Feature points of a head: from a file, or found.

    Raises
    ------
    MeshError, FeaturePointsError
        When they are not found, or the file is none of feature points.
    """
    if given != AUTO:
        return load(given, of_file(head))
    found = find(head.mesh)
    if isinstance(found, Failed):
        raise MeshError(
            f"{head.path}: {_bare(found)}; give its feature points with --landmarks, from a file that "
            "`guise analogy mesh landmarks MESH --edit FILE` writes"
        )
    return found


def landmarks_file(
    path: Path, output: Path | None, edit: Path | None, template: tuple[Path, str] | None, work: Work
) -> LandmarksReport:
    """Find the feature points of a head, or put corrected ones in their place, and write them.

    template : a head and the file of its points, or "auto": points are searched that look like those.

    Raises
    ------
    MeshError, FeaturePointsError, RegistrationError, OutputError
    """
    output = output or path.with_name(f"{path.stem}.landmarks.json")
    like = () if template is None else (template[0],)
    require_outputs([output, work.picture], [path, *filter(None, [edit]), *like], force=work.force)
    with work.stage("reading"):
        head = read_mesh(path)
    with work.stage("landmarks"):
        points = _edited(head, edit)
        if template is not None:
            points = _searched(head, points, read_mesh(template[0]), template[1])
    write_whole(output, points.save)
    if work.picture is not None:
        with work.stage("drawing"):
            save_picture(work.picture, drawn(head.mesh, points.positions))
    confidence = dict(zip(NAMES, points.confidence.round(3).tolist(), strict=True))
    return LandmarksReport(path, output, points.as_json(), confidence, work.picture, work.seconds)


def _edited(head: MeshFile, edit: Path | None) -> FeaturePoints:
    found = find(head.mesh)
    if edit is not None:
        return load(edit, of_file(head), None if isinstance(found, Failed) else found)
    if isinstance(found, Failed):
        raise MeshError(f"{head.path}: {_bare(found)}; give all 20 points with --edit")
    return found


def _searched(head: MeshFile, points: FeaturePoints, template: MeshFile, given: str) -> FeaturePoints:
    """Points of a head near the present ones that look like those of a template."""
    like = points_of(template, given)
    places = refine_points(template.mesh, like.positions, head.mesh, points.positions)
    return FeaturePoints.on(of_file(head), places, points.confidence)


def of_file(head: MeshFile) -> Mesh:
    """The faces of the clean mesh over all vertices of the file, so that vertices have the file's numbers."""
    kept = head.cleaned.kept
    return Mesh(head.document.vertices, kept[head.mesh.triangles], kept[head.mesh.quads])


def _bare(failure: Failed) -> str:
    """Why no points were found, without advice that is not for every command."""
    return failure.reason.partition(":")[0]
