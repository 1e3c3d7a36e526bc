"""`guise analogy mesh rig`: all morph targets of one head transferred to another."""

from __future__ import annotations

from pathlib import Path

from guise.analogy.formats.files import read_mesh, read_rig, write_rig
from guise.app.meshes.context import RunContext
from guise.app.meshes.pair import TransferOptions, prepare_pair
from guise.app.meshes.reports import TransferReport
from guise.app.meshes.transferring import READING, WRITING, draw_report_picture, make_report, transfer_all
from guise.common.errors import OutputError
from guise.common.files import require_outputs


def transfer_rig(
    source: Path, target: Path, output: Path, options: TransferOptions, context: RunContext
) -> TransferReport:
    """Transfer all morph targets of a rig, and write the target with them as GLB.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        Before anything is written.
    """
    if output.suffix.lower() != ".glb":
        raise OutputError(f"{output} must end in .glb, the format with morph targets")
    require_outputs([output, context.picture, context.report], [source, target], force=context.force)
    with context.stage(READING):
        rig, head = read_rig(source), read_mesh(target)
    pair = prepare_pair(rig.file, head, options, context)
    made, carried = transfer_all(pair, list(rig.shapes), [(name, name) for name in rig.names], context)
    with context.stage(WRITING):
        write_rig(output, head, rig.names, made)
    draw_report_picture(pair, list(rig.shapes), made, rig.names, context)
    return make_report(pair, options, output, "morph target", carried, context)
