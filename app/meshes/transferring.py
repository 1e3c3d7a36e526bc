"""`guise analogy mesh transfer`: expressions of one head as files of another."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from guise.analogy.formats.files import MeshFile, read_mesh
from guise.analogy.mesh import Mesh
from guise.app.media.pictures import save_picture
from guise.app.meshes.pair import Carrier, How, open_carrier
from guise.app.meshes.pictures import Head, Picture, Stand, carried_over, strip
from guise.app.meshes.reports import AmountError, Carried, TransferReport, versions
from guise.app.meshes.work import Work
from guise.common.arrays import F64
from guise.common.errors import Interrupted
from guise.common.files import require_outputs

STILL = 1e-6  # of a head's size, which vertices move by rounding
MOST_DRAWN = 6  # expressions in a picture
SIDE = 25.0  # degrees from which several are seen
READING, CARRYING, WRITING, DRAWING = "reading", "carrying", "writing", "drawing"


def transfer_files(
    source: Path, expressions: Sequence[Path], target: Path, folder: Path | None, how: How, work: Work
) -> TransferReport:
    """Carry expressions over, each to a file in `folder` named after it, in the target's format.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        Before anything is written.
    """
    folder = folder or target.with_name(f"{target.stem}_expressions")
    outputs = [folder / f"{path.stem}{target.suffix}" for path in expressions]
    extra = [work.picture, work.report]
    require_outputs([*outputs, *extra], [source, target, *expressions], force=work.force, made=folder)
    with work.stage(READING):
        neutral, head = read_mesh(source), read_mesh(target)
        faces = [neutral.expression(path) for path in expressions]
    carrier = open_carrier(neutral, head, how, work)
    names = [(str(path), str(output)) for path, output in zip(expressions, outputs, strict=True)]
    made, carried = carry_all(carrier, faces, names, work)
    with work.stage(WRITING):
        _write_all(head, made, outputs)
    draw(carrier, faces, made, [path.stem for path in expressions], work)
    return report_of(carrier, how, folder, "expression", carried, work)


def _write_all(head: MeshFile, made: Sequence[F64], outputs: Sequence[Path]) -> None:
    count = 0
    try:
        for vertices, output in zip(made, outputs, strict=True):
            head.write(output, vertices)
            count += 1
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; {count} of {len(outputs)} files are written") from None


def carry_all(
    carrier: Carrier, faces: Sequence[F64], names: Sequence[tuple[str, str]], work: Work
) -> tuple[list[F64], list[Carried]]:
    """The target (N_t, 3) with each expression (N_s, 3), and what is told of it.

    names : input and output of each.
    """
    made, carried = [], []
    with work.stage(CARRYING):
        for number, (expressive, (name, output)) in enumerate(zip(faces, names, strict=True)):
            start = time.perf_counter()
            made.append(carrier.transfer(expressive))
            seconds = round(time.perf_counter() - start, 4)
            carried.append(told(carrier, expressive, made[-1], name, output, seconds))
            work.progress(CARRYING, (number + 1) / len(faces))
    return made, carried


def told(carrier: Carrier, expressive: F64, made: F64, name: str, output: str, seconds: float) -> Carried:
    """What is told of one expression."""
    neutral = carrier.pair.target.mesh.vertices
    way = np.linalg.norm(made - neutral, axis=1)
    if way.max() <= STILL * float(np.ptp(neutral, axis=0).max()):
        return Carried(name, output, 0.0, None, seconds)
    return Carried(
        name, output, float(f"{way.max():.6g}"), AmountError.of(carrier.error(expressive, made)), seconds
    )


def draw(
    carrier: Carrier, faces: Sequence[F64], made: Sequence[F64], names: Sequence[str], work: Work
) -> None:
    """The picture, if one is wanted: the source with those that move most above the target."""
    if work.picture is None:
        return
    source, target, points = carrier.pair.source.mesh, carrier.pair.target.mesh, carrier.pair.points
    places = None if points is None else (points[0].positions, points[1].positions)
    with work.stage(DRAWING):
        if len(faces) == 1:
            picture = carried_over(source, faces[0], target, made[0], places)
        else:
            first, second = places or (None, None)
            chosen = _most_moved(target, made)
            above = _row(source, [(faces[k], names[k]) for k in chosen], first)
            below = _row(target, [(made[k], names[k]) for k in chosen], second)
            picture = np.concatenate([above, below])
        save_picture(work.picture, picture)


def _most_moved(head: Mesh, made: Sequence[F64]) -> list[int]:
    """The expressions that are drawn, in their order."""
    ways = [float(np.square(face - head.vertices).sum()) for face in made]
    return sorted(int(k) for k in np.argsort(ways)[::-1][:MOST_DRAWN])


def _row(head: Mesh, faces: Sequence[tuple[F64, str]], points: F64 | None) -> Picture:
    """A head at rest and with expressions, which have names."""
    stand = Stand.of(head.vertices, points)
    still = Head(head.vertices, head.faces, "at rest", stand)
    return strip([still, *(Head(face, head.faces, name, stand) for face, name in faces)], [SIDE])


def report_of(
    carrier: Carrier,
    how: How,
    output: Path,
    kind: str,
    carried: Sequence[Carried],
    work: Work,
    skipped: int = 0,
) -> TransferReport:
    """What was done; kind: what was carried over."""
    return TransferReport(
        carrier.pair.source.path, carrier.pair.target.path, output, how.method, carrier.pair.facts, kind,
        tuple(carried), skipped, work.seconds, work.picture, versions(),
    )  # fmt: skip
