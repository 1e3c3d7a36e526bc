"""Time of one picture of 311 x 419 pixels after set-up, and frames a second of a clip's expressions on a photograph.

Wall time on a computer that does nothing else, and the processor's time, which others' work hardly changes.  Beside it
the reference operation: SuperLU's factorisation of a Laplacian system on a 160 x 160 grid.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import islice

import cv2
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.image.photos import METHODS, Photo, rendered
from guise.analogy.photo import PhotoAnalogy
from guise.analogy.photo.grid import ANIMATED_FACE_PX

PAPER_SIZE_PX = (311, 419)  # the paper's
CROP_CORNER_PX = (160, 30)  # of the pictures' faces
MAX_PICTURE_MS = 100.0
MIN_FPS = {1.0: 25.0, 2.8125: 8.0}  # by enlargement of the photo: 640 x 480, and a square of 1350


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
    for times_as_large, least in MIN_FPS.items():
        fps = rate(options, times_as_large, 3 * times)
        what = f"clip of 640 x 480 on a photo {times_as_large:g} times as large, one core"
        report.criteria.append(Criterion(what, fps, ">=", least, "frames/s"))
    report.tables.append(
        Table(f"{PAPER_SIZE_PX[0]} x {PAPER_SIZE_PX[1]}", ("what", "wall, ms", "processor, ms"), rows)
    )
    return report


def enlarged(photo: Photo, times: float) -> Photo:
    """The middle square of a photo, so many times as large; itself for 1."""
    if times == 1:
        return photo
    side = min(photo.rgb.shape[:2])
    left = int(np.clip(photo.points[:, 0].mean() - side / 2, 0, photo.rgb.shape[1] - side))
    square = np.ascontiguousarray(photo.rgb[:side, left : left + side])
    size = round(times * side)
    large = np.asarray(cv2.resize(square, (size, size), interpolation=cv2.INTER_CUBIC), np.uint8)
    return Photo(large, (photo.points - (left, 0) + 0.5) * times - 0.5)


def rate(options: argparse.Namespace, times: float, count: int) -> float:
    """Frames per second of the processor: p01's talk on p05 as `guise analogy animate` computes it, decoded."""
    source, target = (rendered(options.shared, name, "neutral") for name in ("p01", "p05"))
    target = enlarged(target, times)
    carry = PhotoAnalogy(source.rgb, source.points, target.rgb, target.points, max_face_px=ANIMATED_FACE_PX)
    clip = common.synthetic_clip(options.shared, "p01")
    start = time.process_time()
    for frame, points in zip(islice(common.frames(clip), count), clip.points, strict=False):
        carry(frame.rgb(), points)
    return count / (time.process_time() - start)


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
