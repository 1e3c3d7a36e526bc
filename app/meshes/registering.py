"""`guise analogy mesh register`: a head deformed onto another, and their correspondence."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from guise.analogy.correspondence import Correspondence
from guise.analogy.formats.files import MeshFile
from guise.analogy.registration import register
from guise.app.media.pictures import save_picture
from guise.app.meshes import pictures
from guise.app.meshes.context import RunContext
from guise.app.meshes.pair import MATCHING, feature_points_of_both
from guise.app.meshes.parts import name_parts
from guise.app.meshes.reports import RegisterReport, versions
from guise.common.errors import OutputError
from guise.common.files import fitting_name, require_outputs, write_arrays


def register_files(
    template: Path, target: Path, output: Path | None, landmarks: tuple[str, str] | None, context: RunContext
) -> RegisterReport:
    """Deform the template onto the target; write it in its own format, and the correspondence beside it.

    Raises
    ------
    MeshError, FeaturePointsError, RegistrationError, SolverError, OutputError
        Before anything is written.
    """
    output = output or template.with_name(fitting_name(template.stem, f"_fitted{template.suffix}"))
    if output.suffix.lower() != template.suffix.lower():
        raise OutputError(f"{output} must end in {template.suffix}, as {template} does")
    table = output.with_suffix(".npz")
    require_outputs([output, table, context.picture, context.report], [template, target], force=context.force)
    with context.stage("reading"):
        own, other = context.read(template), context.read(target)
    points = feature_points_of_both(own, other, landmarks, context)
    with context.stage(MATCHING):
        own, other = (
            name_parts(head, found.positions).file for head, found in zip((own, other), points, strict=True)
        )
        done = register(own.mesh, other.mesh, (points[0].positions, points[1].positions))
        link = done.correspondence()
    with context.stage("writing"):
        own.write(output, done.fitted)
        save_correspondence(table, link, own, other)
    if context.picture is not None:
        with context.stage("drawing"):
            places = points[0].positions, points[1].positions
            save_picture(context.picture, pictures.draw_chessboard(own.mesh, other.mesh, link, places))
    return RegisterReport(
        template, target, output, table, asdict(done.quality), context.seconds, context.picture, versions()
    )


def save_correspondence(path: Path, link: Correspondence, source: MeshFile, target: MeshFile) -> None:
    """Write the correspondence, with vertices numbered from 0 as in their files.

    corners (n, 3) int64 vertices of the source, weights (n, 3) float64, found (n,) bool, for the n vertices of the
    target.
    """
    rows = target.cleaned.ids
    corners = source.cleaned.kept[link.corners[rows]]
    arrays = {"corners": corners, "weights": link.weights[rows], "found": link.found[rows]}
    write_arrays(path, arrays)
