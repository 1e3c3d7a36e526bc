"""`guise analogy mesh register`: a head deformed onto another, and what corresponds to what."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np

from guise.analogy.correspondence import Correspondence
from guise.analogy.formats.files import MeshFile, read_mesh
from guise.analogy.register import register
from guise.app.media.pictures import save_picture
from guise.app.meshes import pictures
from guise.app.meshes.pair import MATCHING, both_points
from guise.app.meshes.reports import RegisterReport, versions
from guise.app.meshes.work import Work
from guise.common.errors import OutputError
from guise.common.files import require_outputs, write_whole


def register_files(
    template: Path, target: Path, output: Path | None, landmarks: tuple[str, str] | None, work: Work
) -> RegisterReport:
    """Deform the template onto the target; write it, in its own format, and the correspondence beside it.

    Raises
    ------
    MeshError, FeaturePointsError, RegistrationError, SolverError, OutputError
        Before anything is written.
    """
    output = output or template.with_name(f"{template.stem}_fitted{template.suffix}")
    if output.suffix.lower() != template.suffix.lower():
        raise OutputError(f"{output} must end in {template.suffix}, as {template} does")
    table = output.with_suffix(".npz")
    require_outputs([output, table, work.picture, work.report], [template, target], force=work.force)
    with work.stage("reading"):
        own, other = read_mesh(template), read_mesh(target)
    points = both_points(own, other, landmarks, work)
    with work.stage(MATCHING):
        done = register(own.mesh, other.mesh, (points[0].positions, points[1].positions))
        link = done.correspondence()
    with work.stage("writing"):
        own.write(output, done.fitted)
        save_correspondence(table, link, own, other)
    if work.picture is not None:
        with work.stage("drawing"):
            places = points[0].positions, points[1].positions
            save_picture(work.picture, pictures.chessboard(own.mesh, other.mesh, link, places))
    return RegisterReport(
        template, target, output, table, asdict(done.quality), work.seconds, work.picture, versions()
    )


def save_correspondence(path: Path, link: Correspondence, source: MeshFile, target: MeshFile) -> None:
    """Write the places of a target's vertices on a source, vertices numbered as in their files from 0.

    corners (n, 3) int64 vertices of the source's file, weights (n, 3) float64, found (n,) bool; n vertices of the
    target's file.
    """
    rows = target.cleaned.ids
    corners = source.cleaned.kept[link.corners[rows]]
    weights, found = link.weights[rows], link.found[rows]

    def write(part: Path) -> None:
        with part.open("wb") as file:
            np.savez_compressed(file, corners=corners, weights=weights, found=found)

    write_whole(path, write)
