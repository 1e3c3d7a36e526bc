"""Time of one picture of 311 x 419 pixels after set-up, and frames a second of a clip's expressions on a photograph.

Wall time on a computer that does nothing else, and the processor's time, which others' work hardly changes.  Beside it
the reference operation: SuperLU's factorisation of a Laplacian system on a 160 x 160 grid.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import islice

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.image.photos import METHODS, Photo, rendered
from guise.analogy.photo import PhotoAnalogy

PAPER_SIZE_PX = (311, 419)  # the paper's
CROP_CORNER_PX = (160, 30)  # of the pictures' faces
MAX_PICTURE_MS = 100.0
MIN_FPS = 10.0


def crop(photo: Photo) -> Photo:
    """The part of a synthetic person's picture that has the paper's size."""
    (x, y), (width, height) = CROP_CORNER_PX, PAPER_SIZE_PX
    return Photo(
        np.ascontiguousarray(photo.rgb[y : y + height, x : x + width]), photo.points - CROP_CORNER_PX
    )


def time_work(work: Callable[[], object], times: int) -> tuple[float, float]:
    """Median wall and mean processor time in milliseconds."""
    work()
    walls, before = [], time.process_time()
    for _ in range(times):
        start = time.perf_counter()
        work()
        walls.append(time.perf_counter() - start)
    return 1000 * float(np.median(walls)), 1000 * (time.process_time() - before) / times


def reference() -> None:
    """The reference operation."""
    line = sp.diags_array([-np.ones(159), 2 * np.ones(160), -np.ones(159)], offsets=[-1, 0, 1])  # type: ignore[list-item]
    eye = sp.eye_array(160)
    laplacian = sp.kron(line, eye) + sp.kron(eye, line)
    splu(sp.csc_matrix(laplacian + sp.eye_array(160 * 160)), permc_spec="MMD_AT_PLUS_A")


def measure(options: argparse.Namespace) -> Report:
    """One picture by each method; a clip by tents."""
    report = Report("image.speed", "Speed of expression analogy between photographs")
    times = 5 if options.quick else 20
    s, s1, t = (
        crop(rendered(options.shared, *key))
        for key in (("p01", "neutral"), ("p01", "smile"), ("p05", "neutral"))
    )
    rows = [("reference operation", *time_work(reference, 3))]
    for method in METHODS:
        carry = PhotoAnalogy(s.rgb, s.points, t.rgb, t.points, method)
        rows.append((method, *time_work(lambda carry=carry: carry(s1.rgb, s1.points), times)))  # type: ignore[misc]
    rows.append(("tents, set-up", *time_work(lambda: PhotoAnalogy(s.rgb, s.points, t.rgb, t.points), 3)))
    report.criteria.append(Criterion("one picture by tents, wall", rows[1][1], "<=", MAX_PICTURE_MS, "ms"))
    report.criteria.append(
        Criterion("one picture by tents, processor", rows[1][2], "<=", MAX_PICTURE_MS, "ms")
    )
    report.criteria.append(
        Criterion("clip of 640 x 480 on a photo", rate(options, 3 * times), ">=", MIN_FPS, "frames/s")
    )
    report.tables.append(
        Table(f"{PAPER_SIZE_PX[0]} x {PAPER_SIZE_PX[1]}", ("what", "wall, ms", "processor, ms"), rows)
    )
    return report


def rate(options: argparse.Namespace, count: int) -> float:
    """Frames a second of p01's talk on p05, decoding included."""
    source, target = (rendered(options.shared, name, "neutral") for name in ("p01", "p05"))
    carry = PhotoAnalogy(source.rgb, source.points, target.rgb, target.points)
    clip = common.synthetic_clip(options.shared, "p01")
    start = time.perf_counter()
    for frame, points in zip(islice(common.frames(clip), count), clip.points, strict=False):
        carry(frame.rgb(), points)
    return count / (time.perf_counter() - start)


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
