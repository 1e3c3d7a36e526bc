"""How well irises and the turn of the head tell where the eyes look, against ground truth of rendered people.

An eyeball turns about a centre behind the middle of its eye corners, and its iris lies on a sphere about that; where
the iris is seen then says how the eyeball is turned in the head. EYEBALL was fitted to first clips of p01, p02 and p06
and to single rendered pictures of other people; measured are second clips. The error is the mean distance of yaw and
pitch from the true ones, degrees, over the frames in which the true lids are open. Beside it stands that of eyes that
always look straight ahead: nothing of Guise uses a gaze yet.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks import setting
from guise.aam.landmarks import FaceTracker, Landmarker
from guise.aam.landmarks.landmark_filter import LandmarkFilter
from guise.aam.landmarks.schemes import (
    EYE_CORNERS,
    LEFT_EYE_CORNERS,
    LOWER_LIDS,
    RIGHT_EYE_CORNERS,
    UPPER_LIDS,
)
from guise.aam.parsing import FaceParser
from guise.aam.solid_shape import HeadPose, SolidTracker
from guise.app.media import open_input

NAME, TITLE = "landmarks.gaze", "Gaze"
MIN_OPENING = 0.15  # of the lids, in widths of the eye
EYEBALL = np.array([0.0, -0.022, 0.075])  # face widths from the middle of the eye's corners, and
EYEBALL_RADIUS = 0.1  # in face widths, about twice that of an eye: the irises found move too little
MAX_SINE = 0.98


def true_gaze(file: Path) -> tuple[F64, F64]:
    """Yaw and pitch (t, 2), degrees, and how far the lids are open (t,), eye widths."""
    with np.load(file) as stored:
        names = [str(name) for name in stored["weight_names"]]
        turned = stored["weights"][:, [names.index("gaze-yaw-deg"), names.index("gaze-pitch-deg")]]
        points = stored["landmarks"].astype(np.float64)
    opening = np.linalg.norm(points[:, UPPER_LIDS] - points[:, LOWER_LIDS], axis=2).min(1)
    corners = points[:, EYE_CORNERS].reshape(len(points), 2, 2, 2)
    width = np.linalg.norm(corners[:, :, 0] - corners[:, :, 1], axis=2).mean(1)
    return turned.astype(np.float64), opening / width


def eye_turn(iris: F64, middle: F64, head: HeadPose) -> F64:
    """Yaw to the image's right and pitch up (2,) of an eye in the head, degrees.

    iris, middle : (2,) pixels, centre of the iris and middle of the eye's corners.
    """
    sideways = (iris - middle - EYEBALL @ head.linear) / (head.scale * EYEBALL_RADIUS)
    sideways /= max(float(np.linalg.norm(sideways)) / MAX_SINE, 1.0)
    x, y, z = head.rotation.T @ [*sideways, -np.sqrt(1 - sideways @ sideways)]
    return np.degrees([np.arctan2(x, -z), np.arcsin(np.clip(-y, -1, 1))])


def found_gaze(landmarker: Landmarker, video: Path) -> F64:
    """Yaw and pitch (t, 2) of a clip's face, the mean of both eyes, degrees; NaN where there is none."""
    tracker, smooth, solid, parser = FaceTracker(landmarker), LandmarkFilter(), SolidTracker(), FaceParser()
    rows = []
    with open_input(video) as media:
        for frame in media:
            rgb = frame.rgb()
            face = tracker.update(rgb)
            if face is None:
                rows.append(np.full(2, np.nan))
                continue
            seen = smooth.update(face.points, face.point_confidence, float(frame.pts * frame.time_base))
            points = seen.astype(np.float64)
            head, irises = solid.update(points).pose, parser.parse(rgb, points).irises
            eyes = zip(irises, (RIGHT_EYE_CORNERS, LEFT_EYE_CORNERS), strict=True)
            rows.append(np.mean([eye_turn(i[:2], points[c].mean(0), head) for i, c in eyes], axis=0))
    return np.array(rows)


def measure(options: argparse.Namespace) -> Report:
    """All second clips."""
    landmarker, rows = setting.landmarker(options), []
    for name in common.synthetic_people(options.shared)[: 2 if options.quick else None]:
        clip = options.shared / "data" / "synthetic" / "people" / name / "talk2"
        truth, opening = true_gaze(clip.with_suffix(".npz"))
        away = found_gaze(landmarker, clip.with_suffix(".mp4")) - truth
        seen = (opening > MIN_OPENING) & np.isfinite(away).all(1)
        errors, still = np.linalg.norm(away[seen], axis=1), np.linalg.norm(truth[seen], axis=1)
        yaw, pitch = np.abs(away[seen]).mean(0)
        rows.append(
            (name, int(seen.sum()), float(errors.mean()), float(yaw), float(pitch), float(still.mean()))
        )
        common.say(str(rows[-1]))
    columns = ("person", "frames", "error", "yaw", "pitch", "straight ahead")
    error = float(np.mean([row[2] for row in rows])) if rows else float("nan")
    criteria = [Criterion("gaze, mean of people", error, "<=", 5.0, "degrees")]
    return Report(NAME, TITLE, criteria, [Table("Mean errors, degrees", columns, rows)])


if __name__ == "__main__":
    common.run(measure, setting.arguments(__doc__))
