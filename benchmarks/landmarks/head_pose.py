"""Yaw, pitch and roll as `guise landmarks` writes them, against ground truth, by how far the head is turned.

Rendered clips are tracked from frame to frame; `--parts` adds single pictures of other rendered people, turned by up to
60 degrees and nodding by up to 30. Angles are those between the face and the line of sight to it: who stands beside
the middle of the picture and looks straight ahead is turned. Noise is the median second difference in
time of the yaw's error.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks import setting
from guise.aam.landmarks import Face, Landmarker
from guise.aam.landmarks.landmark_filter import LandmarkFilter
from guise.aam.landmarks.schemes import INNER51
from guise.aam.landmarks.tracking import FaceTracker
from guise.aam.solid_shape import HeadPose, SolidTracker
from guise.app.media import open_input

NAME, TITLE = "landmarks.head_pose", "Yaw, pitch and roll"
BINS_DEGREES = (0, 15, 30, 45, 60)
MAX_PITCH_DEGREES = 30
EVERY_PICTURE = 4
IMAGE_AXES = np.array([1, -1, -1])  # of the truth's head: x right, y up, z to the viewer
SCENES = ("hard/yaw40", "hard/light_change", "hard/small_scale")


def clips(shared: Path) -> list[tuple[str, Path, Path]]:
    """Names, videos and truths."""
    data = shared / "data" / "synthetic"
    people = [(name, data / "people" / name / "talk2") for name in common.synthetic_people(shared)]
    scenes = [(name, data / name) for name in SCENES]
    swaps = [(f.parent.name, f.parent / "source") for f in sorted((data / "swap").glob("*/source.mp4"))]
    return [(n, p.with_suffix(".mp4"), p.with_suffix(".npz")) for n, p in (*people, *scenes, *swaps)]


def of_clip(landmarker: Landmarker, video: Path) -> F64:
    """(t, 3) angles of the face, NaN where it is lost."""
    tracker, smooth, solid, rows = FaceTracker(landmarker), LandmarkFilter(), SolidTracker(), []
    with open_input(video) as media:
        for frame in media:
            face = tracker.update(frame.rgb())
            if face is None:
                rows.append((np.nan,) * 3)
                continue
            points = smooth.update(face.points, face.point_confidence, float(frame.pts * frame.time_base))
            rows.append(solid.update(points.astype(np.float64)).pose.angles)
    return np.array(rows)


def true_angles(truth: Path) -> F64:
    """(t, 3) of a clip, as seen along the line of sight to the face."""
    with np.load(truth) as stored:
        rotations = stored["R"].astype(np.float64) * IMAGE_AXES
        ways = stored["landmarks3d_cam"].astype(np.float64)[:, INNER51].mean(1)
    return np.array(
        [HeadPose(_facing(w) @ r, 1.0, np.zeros(2)).angles for r, w in zip(rotations, ways, strict=True)]
    )


def _facing(way: F64) -> F64:
    """(3, 3) the smallest rotation that takes a direction (3,) to the camera's own, z."""
    x, y, z = way / np.linalg.norm(way)
    vector = np.array([[0, 0, -x], [0, 0, -y], [x, y, 0]])
    return np.asarray(np.eye(3) + vector + vector @ vector / (1 + z))


def of_pictures(landmarker: Landmarker, parts: Path) -> Iterator[tuple[F64, F64]]:
    """Angles found and true (3,) of rendered pictures."""
    for path in sorted(parts.glob("part_*.npz")):
        part = np.load(path)
        ends = np.cumsum(part["length"])
        for i in range(0, len(ends), EVERY_PICTURE):
            true = part["pose"][i].astype(np.float64)
            if abs(true[0]) > BINS_DEGREES[-1] or abs(true[1]) > MAX_PITCH_DEGREES:
                continue
            coded = part["jpeg"][ends[i] - part["length"][i] : ends[i]]
            picture = cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
            face = landmarker.refine(np.asarray(picture, np.uint8), Face.around(part["face81"][i], 1.0))
            if face is not None:
                yield np.array(SolidTracker().update(face.points.astype(np.float64)).pose.angles), true


def noise(errors: F64) -> float:
    """Median second difference in time of the yaw's error (t, 3), degrees."""
    return float(np.nanmedian(np.abs(np.diff(errors[:, 0], 2)))) if len(errors) > 2 else float("nan")


def rows(name: str, errors: F64, yaw: F64) -> list[tuple[str, str, int, float, float, float]]:
    """Mean absolute errors (n, 3) by how far the head is turned, and of all."""
    ends = [*pairwise(BINS_DEGREES), (0, BINS_DEGREES[-1])]
    found = np.isfinite(errors).all(1)
    out = []
    for low, high in ends:
        inside = found & (np.abs(yaw) >= low) & (np.abs(yaw) < high)
        if inside.any():
            mean = np.abs(errors[inside]).mean(0)
            out.append((name, f"{low}-{high}", int(inside.sum()), *map(float, mean)))
    return out


def measure(options: argparse.Namespace) -> Report:
    """All clips, and the pictures of the parts."""
    landmarker = setting.landmarker(options)
    table, errors, noises, yaws = [], [], [], []
    for name, video, truth in clips(options.shared)[:: 6 if options.quick else 1]:
        found, true = of_clip(landmarker, video), true_angles(truth)
        away = found - true[: len(found)]
        errors.append(away)
        yaws.append(true[: len(found), 0])
        noises.append(noise(away))
        table.append((name, noises[-1], *map(float, np.nanmean(np.abs(away), axis=0))))
        common.say(str(table[-1]))
    kinds = {"clips": (np.concatenate(errors), np.concatenate(yaws))}
    if options.parts:
        pairs = list(of_pictures(landmarker, options.parts))
        found, true = (np.array(side) for side in zip(*pairs, strict=True))
        kinds["pictures"] = (found - true, true[:, 0])
    by_turn = [row for kind, (away, yaw) in kinds.items() for row in rows(kind, away, yaw)]
    worst = [max(row[3:]) for row in by_turn if row[1] == f"0-{BINS_DEGREES[-1]}"]
    criteria = [
        Criterion("mean absolute error of the worst angle, yaw within 60", max(worst), "<=", 3.0, "degrees"),
        Criterion("noise of the yaw, median of the clips", float(np.median(noises)), "<=", 0.3, "degrees"),
    ]
    angles = ("yaw, degrees", "pitch", "roll")
    tables = [
        Table("By how far the head is turned", ("what", "yaw, degrees ", "faces", *angles), by_turn),
        Table("Clips", ("clip", "noise, degrees", *angles), table),
    ]
    return Report(NAME, TITLE, criteria, tables)


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
