"""`guise analogy mesh transfer` and `rig`: expressions of one head as files, or as morph targets, of another."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from guise.analogy.formats.files import MeshFile, has_skeleton, vrm_version, write_rig
from guise.analogy.mesh import Mesh
from guise.app.media.pictures import save_picture
from guise.app.meshes.context import RunContext
from guise.app.meshes.options import TransferOptions, Unit
from guise.app.meshes.pair import MatchedPair, TransferPair, prepare_pair
from guise.app.meshes.pictures import DrawnHead, HeadView, Picture, draw_strip, draw_transfer
from guise.app.meshes.reports import MotionError, TransferredExpression, TransferReport, versions
from guise.common.arrays import F32, F64
from guise.common.errors import Interrupted, OutputError
from guise.common.files import fitting_name, require_outputs

METRES: dict[Unit, float] = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "in": 0.0254}
MIN_HEAD_METRES, MAX_HEAD_METRES = (
    0.05,
    3.0,
)  # of the whole file, which may hold a body: beyond them, a note says so
MIN_MOTION_SIZES = 1e-6  # in sizes of the head, up to which motion is rounding error
MAX_MOTION_RATIO = 1.5  # of the furthest vertex to the source's, scaled, above which a note says so
SOLVED_AT_ONCE = 4  # expressions
VRM = ".vrm"
MAX_DRAWN_EXPRESSIONS = 6  # in a picture
PICTURE_YAW_DEG = 25.0  # of pictures with several expressions
READING, TRANSFERRING, WRITING, DRAWING = "reading", "carrying", "writing", "drawing"


def transfer_files(
    source: Path,
    expressions: Sequence[Path],
    target: Path,
    folder: Path | None,
    options: TransferOptions,
    context: RunContext,
) -> TransferReport:
    """Transfer expressions, each to a file in `folder` named after it, in the target's format.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        Before anything is written.
    """
    folder = folder or target.with_name(fitting_name(target.stem, "_expressions"))
    outputs = [folder / f"{path.stem}{target.suffix}" for path in expressions]
    extra = [context.picture, context.report]
    require_outputs([*outputs, *extra], [source, target, *expressions], force=context.force, made=folder)
    with context.stage(READING):
        neutral, head = context.read(source), context.read(target)
        faces = [neutral.read_expression(path) for path in expressions]
    pair = prepare_pair(neutral, head, options, context)
    names = [(str(path), str(output)) for path, output in zip(expressions, outputs, strict=True)]
    made, carried = transfer_all(pair, faces, names, context)
    with context.stage(WRITING):
        _write_all(head, made, outputs)
    draw_report_picture(pair.heads, faces, made, [path.stem for path in expressions], context)
    return make_report(pair.heads, options, folder, "expression", carried, context)


class CarriedShapes(Sequence[F64]):
    """Shapes (N, 3) of a head, each kept as what moves, float32: half of the memory, and what stays stays exactly."""

    def __init__(self, rest: F64) -> None:
        self._rest = rest
        self._ways: list[F32] = []

    def append(self, shape: F64) -> None:
        """Keep a shape (N, 3)."""
        self._ways.append((shape - self._rest).astype(np.float32))

    def __len__(self) -> int:
        return len(self._ways)

    def __getitem__(self, at: Any) -> Any:
        return self._rest + self._ways[at]


def _write_all(head: MeshFile, made: Sequence[F64], outputs: Sequence[Path]) -> None:
    count = 0
    try:
        for vertices, output in zip(made, outputs, strict=True):
            head.write(output, vertices)
            count += 1
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; {count} of {len(outputs)} files are written") from None


def transfer_rig(
    source: Path,
    target: Path,
    output: Path,
    options: TransferOptions,
    context: RunContext,
    unit: Unit | None = None,
    authors: Sequence[str] = (),
) -> TransferReport:
    """Transfer all morph targets of a rig, and write the target, whose lengths are in `unit`, with them as GLB or VRM.

    authors : named in a VRM that is made of another format.

    Raises
    ------
    MeshError, FeaturePointsError, SolverError, OutputError
        Before anything is written.
    """
    if output.suffix.lower() not in (".glb", VRM):
        raise OutputError(f"{output} must end in .glb or .vrm, formats with morph targets")
    require_outputs([output, context.picture, context.report], [source, target], force=context.force)
    with context.stage(READING):
        rig, head = context.read_rig(source), context.read(target)
    if output.suffix.lower() == VRM:
        _require_avatar(head, authors, context)
    pair = prepare_pair(rig.file, head, options, context)
    made, carried = transfer_all(pair, list(rig.shapes), [(name, name) for name in rig.names], context)
    heads = pair.heads
    del pair  # and with it the systems of the transfer, before the file is made
    with context.stage(WRITING):
        scale = metres_per_unit(head, unit, context)
        write_rig(output, head, rig.names, made, scale, expressions=rig.expressions, authors=authors)
    draw_report_picture(heads, list(rig.shapes), made, rig.names, context)
    return make_report(heads, options, output, "morph target", carried, context)


def _require_avatar(head: MeshFile, authors: Sequence[str], context: RunContext) -> None:
    """Raise when a head cannot become a VRM; notes on what becomes of it."""
    version = vrm_version(head)
    if version is None and not any(name.strip() for name in authors):
        raise OutputError(f"a VRM names its authors, and {head.path} is no VRM yet: give --author NAME")
    if version is None and not has_skeleton(head):
        context.say(
            f"{head.path} has no skeleton, and VRM asks for one: it gets 15 bones of a standing person, of which the "
            "head turns it"
        )
    if version == 0:
        context.say(f"{head.path} is VRM 0.x, and stays so: everything else in it is kept")


def metres_per_unit(head: MeshFile, unit: Unit | None, context: RunContext) -> float:
    """The scale at which a head is written as GLB, whose unit is the metre; a note when no head is of that size."""
    scale = METRES[unit or "m"]
    size = head.mesh.extent * scale
    if not MIN_HEAD_METRES <= size <= MAX_HEAD_METRES:
        context.say(
            f"{head.path} would be {size:.2g} m tall, as GLB counts in metres: give the unit of the file with --unit "
            f"{', '.join(name for name in METRES if name != (unit or 'm'))}"
        )
    return scale


def transfer_all(
    pair: TransferPair, faces: Sequence[F64], names: Sequence[tuple[str, str]], context: RunContext
) -> tuple[CarriedShapes, list[TransferredExpression]]:
    """The target (N_t, 3) with each expression (N_s, 3), and its report entry.

    names : input and output of each.
    """
    made = CarriedShapes(pair.heads.target.mesh.vertices)
    carried: list[TransferredExpression] = []
    with context.stage(TRANSFERRING):
        for first in range(0, len(faces), SOLVED_AT_ONCE):
            several = faces[first : first + SOLVED_AT_ONCE]
            start = time.perf_counter()
            shapes = pair.transfer.each(several)
            seconds = round((time.perf_counter() - start) / len(several), 4)
            for number, (expressive, shape) in enumerate(zip(several, shapes, strict=True), first):
                carried.append(summarise(pair, expressive, shape, *names[number], seconds))
                made.append(shape)
                warn_of_flights(pair, expressive, carried[-1], context)
            context.progress(TRANSFERRING, len(made) / len(faces))
    return made, carried


def summarise(
    pair: TransferPair, expressive: F64, made: F64, name: str, output: str, seconds: float
) -> TransferredExpression:
    """The report entry of one expression."""
    neutral = pair.heads.target.mesh.vertices
    way = np.linalg.norm(made - neutral, axis=1)
    if way.max() <= MIN_MOTION_SIZES * pair.heads.target.mesh.extent:
        return TransferredExpression(name, output, 0.0, None, seconds)
    return TransferredExpression(
        name, output, float(f"{way.max():.6g}"), MotionError.of(pair.motion_error(expressive, made)), seconds
    )


def warn_of_flights(
    pair: TransferPair, expressive: F64, carried: TransferredExpression, context: RunContext
) -> None:
    """A note when a vertex of the target moves much farther than any of the source, scaled."""
    way = np.linalg.norm(expressive - pair.heads.source.mesh.vertices, axis=1).max()
    limit = MAX_MOTION_RATIO * pair.transfer.pose.scale * float(way)
    if carried.furthest > limit:
        context.say(
            f"{carried.input}: a vertex moves {carried.furthest:.3g}, the source's at most "
            f"{limit / MAX_MOTION_RATIO:.3g} at this scale: check the result, and correct the feature points if lips "
            "or lids are torn"
        )


def draw_report_picture(
    heads: MatchedPair, faces: Sequence[F64], made: Sequence[F64], names: Sequence[str], context: RunContext
) -> None:
    """Draw the picture, if requested: the expressions that move most, on the source above and the target below."""
    if context.picture is None:
        return
    source, target, points = heads.source.mesh, heads.target.mesh, heads.points
    places = None if points is None else (points[0].positions, points[1].positions)
    with context.stage(DRAWING):
        if len(faces) == 1:
            picture = draw_transfer(source, faces[0], target, made[0], places)
        else:
            first, second = places or (None, None)
            chosen = _most_moved(target, made)
            above = _draw_row(source, [(faces[k], names[k]) for k in chosen], first)
            below = _draw_row(target, [(made[k], names[k]) for k in chosen], second)
            picture = np.concatenate([above, below])
        save_picture(context.picture, picture)


def _most_moved(head: Mesh, made: Sequence[F64]) -> list[int]:
    """Indices of the expressions to draw, in order."""
    ways = [float(np.square(face - head.vertices).sum()) for face in made]
    return sorted(int(k) for k in np.argsort(ways)[::-1][:MAX_DRAWN_EXPRESSIONS])


def _draw_row(head: Mesh, faces: Sequence[tuple[F64, str]], points: F64 | None) -> Picture:
    """A head at rest and with named expressions, in a row."""
    view = HeadView.of(head.vertices, points)
    still = DrawnHead(head.vertices, head.faces, "at rest", view)
    return draw_strip(
        [still, *(DrawnHead(face, head.faces, name, view) for face, name in faces)], [PICTURE_YAW_DEG]
    )


def make_report(
    heads: MatchedPair,
    options: TransferOptions,
    output: Path,
    kind: str,
    carried: Sequence[TransferredExpression],
    context: RunContext,
    skipped: int = 0,
) -> TransferReport:
    """The report; kind : of what was transferred."""
    return TransferReport(
        heads.source.path, heads.target.path, output, options.method, heads.facts, kind,
        tuple(carried), skipped, context.seconds, context.picture, versions(), heads.parts,
    )  # fmt: skip
