"""Automatic feature points on heads: how many are near their true place, upright and turned in any way, and how fast.

Errors are distances to the true points in % of the eye width, the distance between the true outer eye corners.  The
heads come from two sources that define the outer ends of the brows, and a little the inner ones and the chin,
differently; `--shifts` prints how each source's points lie to those of the landmarker, of which
`guise.analogy.feature_points.DEFINITIONS` is made.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.mesh.marked_heads import Head, heads
from guise.aam.similarity import Failed
from guise.analogy.face_views import find_face_views, landmarker
from guise.analogy.feature_points import (
    FEATURE_POINT_NAMES,
    LANDMARK_INDICES,
    FeaturePoints,
    find_feature_points,
)
from guise.analogy.mesh import Mesh
from guise.analogy.triangulation import triangulate_face

NAME, TITLE = "mesh.landmarks", "Feature points of head meshes"
MAX_ERROR_EYE_WIDTHS = 0.08  # eye widths
OUTER_EYE_POINTS = [FEATURE_POINT_NAMES.index("eye_right_outer"), FEATURE_POINT_NAMES.index("eye_left_outer")]


@dataclass(frozen=True, eq=False)
class Detection:
    """What was found on a head: distances from the truth (20,) in eye widths, NaN where it is not known."""

    points: FeaturePoints | Failed
    errors: F64
    seconds: float

    @property
    def wrong(self) -> int:
        """How many of the known points are not near."""
        return int(np.count_nonzero(self.errors >= MAX_ERROR_EYE_WIDTHS))


def detect_points(mesh: Mesh, truth: F64) -> Detection:
    """The points of a mesh that was not seen before; the time is the processor's, as one thread does all."""
    start = time.process_time()
    points = find_feature_points(mesh)
    seconds = time.process_time() - start
    known = np.isfinite(truth[:, 0])
    if isinstance(points, Failed):
        return Detection(points, np.where(known, np.inf, np.nan), seconds)
    width = float(np.linalg.norm(truth[OUTER_EYE_POINTS[1]] - truth[OUTER_EYE_POINTS[0]]))
    return Detection(points, np.linalg.norm(points.positions - truth, axis=1) / width, seconds)


def randomly_posed(head: Head, seed: int) -> tuple[Mesh, F64]:
    """The head turned and scaled at random, and its truth."""
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=rng).as_matrix() * 10 ** rng.uniform(-2, 2)
    return Mesh(head.mesh.vertices @ turn.T, head.mesh.triangles, head.mesh.quads), head.truth @ turn.T


def measure(options: argparse.Namespace) -> Report:
    """All heads, or every fifth."""
    chosen = list(heads(options.shared))[:: 5 if options.quick else 1]
    if options.shifts:
        return definition_offsets(chosen)
    landmarker()
    rows, upright, rolled = [], [], []
    for number, head in enumerate(chosen):
        fresh = Mesh(head.mesh.vertices, head.mesh.triangles, head.mesh.quads)
        upright.append(detect_points(fresh, head.truth))
        rolled.append(detect_points(*randomly_posed(head, number)))
        rows.append(row(head, upright[-1], rolled[-1]))
        common.say(" ".join(map(common.shown, rows[-1])))
    columns = (
        "head", "faces", "points known", "within 8 %", "mean error, %", "worst", "s",
        "turned: within 8 %", "mean error, %", "s",
    )  # fmt: skip
    slowest = max(a.seconds for a, head in zip(upright, chosen, strict=True) if len(head.mesh.faces) <= 40000)
    criteria = [
        Criterion("upright: points not within 8 %, most of any head", max(a.wrong for a in upright), "<=", 3),
        Criterion("turned: points not within 8 %, most of any head", max(a.wrong for a in rolled), "<=", 3),
        Criterion("slowest upright head of at most 40 000 faces", slowest, "<=", 1.5, "s"),
    ]
    return Report(NAME, TITLE, criteria, [Table("Heads", columns, rows)])


def row(head: Head, upright: Detection, rolled: Detection) -> tuple[object, ...]:
    """A head's line of the table."""
    known = int(np.isfinite(head.truth[:, 0]).sum())
    if known == 0:
        missing = ["-" if isinstance(a.points, FeaturePoints) else "none found" for a in (upright, rolled)]
        counts, means, worst = missing, ["-", "-"], "-"
    else:
        counts = [str(known - a.wrong) for a in (upright, rolled)]
        means = [common.shown(100 * float(np.nanmean(a.errors))) for a in (upright, rolled)]
        far = int(np.nanargmax(upright.errors))
        worst = f"{FEATURE_POINT_NAMES[far]} {100 * upright.errors[far]:.0f}"
    return (
        head.name, len(head.mesh.faces), known, counts[0], means[0], worst, upright.seconds, counts[1], means[1],
        rolled.seconds,
    )  # fmt: skip


def definition_offsets(chosen: Iterable[Head]) -> Report:
    """How far the true points are from the landmarker's, in % of the eye width: to the left, up, forward."""
    found: dict[str, list[F64]] = {}
    for head in chosen:
        if np.isfinite(head.truth).all():
            seen = triangulate_face(next(find_face_views(head.mesh)))
            if not isinstance(seen, Failed):
                way = (head.truth - seen.points[LANDMARK_INDICES]) @ seen.axes.T
                found.setdefault(head.source, []).append(100 * way / seen.eye_width)
    rows = [
        (name, *(mean_and_deviation(np.array(ways)[:, number]) for ways in found.values()))
        for number, name in enumerate(FEATURE_POINT_NAMES)
    ]
    columns = ("point", *(f"{source}, {len(ways)} heads" for source, ways in found.items()))
    return Report(NAME, TITLE, tables=[Table("Mean and deviation between heads", columns, rows)])


def mean_and_deviation(ways: F64) -> str:
    """Means of (n, 3) and the deviation."""
    return f"{', '.join(f'{x:.1f}' for x in ways.mean(0))} ± {np.sqrt(ways.var(0).sum()):.1f}"


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--shifts", action="store_true", help="print the sources' definitions instead")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
