"""`guise analogy mesh rig`: all morph targets of one head for another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from guise.analogy.formats.files import read_mesh, read_rig, write_rig
from guise.app.meshes.pair import How, open_carrier
from guise.app.meshes.reports import TransferReport
from guise.app.meshes.transferring import READING, WRITING, carry_all, draw, report_of
from guise.app.meshes.work import Work
from guise.common.errors import OutputError
from guise.common.files import require_outputs


def rig_file(source: Path, target: Path, output: Path, how: How, work: Work) -> TransferReport:
    """Carry all morph targets of a rig over, and write the target with them as GLB.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        Before anything is written.
    """
    if output.suffix.lower() != ".glb":
        raise OutputError(f"{output} must end in .glb, which holds morph targets")
    require_outputs([output, work.picture, work.report], [source, target], force=work.force)
    with work.stage(READING):
        rig, head = read_rig(source), read_mesh(target)
    carrier = open_carrier(rig.file, head, how, work)
    made, carried = carry_all(carrier, list(rig.shapes), [(name, name) for name in rig.names], work)
    with work.stage(WRITING):
        write_rig(output, head, rig.names, np.array(made))
    draw(carrier, list(rig.shapes), made, rig.names, work)
    return report_of(carrier, how, output, "morph target", carried, work)
