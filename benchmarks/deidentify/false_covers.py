"""False covers: frames of real clips in which something is covered that is no face.

A cover is false where no face is near it: one that MediaPipe found in the clip within a second, or, as it misses some,
a face that a person has seen there (FACES_BY_EYE).  `--show` keeps a picture of each false cover.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.deidentify.guise import deidentified
from benchmarks.landmarks.clips import RealClip, real_clips
from guise.aam.landmarks.schemes import IBUG68
from guise.app.media import open_input

NEAR_FRAMES = 25  # before and after, in which a face explains a cover
MIN_SHARE = 0.15  # of a face's box, within the covered region
SIGNER, NEIGHBOUR = (255.0, 85.0, 350.0, 190.0), (575.0, 140.0, 640.0, 290.0)
FACES_BY_EYE = {
    "gesture_bird": [NEIGHBOUR],
    **{f"gesture_{name}": [SIGNER] for name in ("book", "learn", "school", "walk")},
}


def true_boxes(clip: RealClip, frame: int) -> F64:
    """Boxes (n, 4) of faces that explain a cover in a frame."""
    with np.load(clip.video.with_suffix(".landmarks.npz")) as stored:
        points = stored["face81"][max(0, frame - NEAR_FRAMES) : frame + NEAR_FRAMES + 1][:, :, IBUG68]
    boxes = np.concatenate([points.min(2), points.max(2)], axis=-1).reshape(-1, 4)
    by_eye = np.reshape(FACES_BY_EYE.get(clip.name, []), (-1, 4))
    return np.concatenate([boxes[np.isfinite(boxes).all(1)], by_eye]).astype(np.float64)


def is_false(region: F64, faces: F64) -> bool:
    """Whether a covered region (4,) holds a part of no face (n, 4)."""
    low, high = np.maximum(region[:2], faces[:, :2]), np.minimum(region[2:], faces[:, 2:])
    shared = np.prod(np.clip(high - low, 0, None), axis=1) / np.prod(faces[:, 2:] - faces[:, :2], axis=1)
    return not (shared >= MIN_SHARE).any()


def covers(report: dict[str, Any]) -> Iterator[tuple[int, str, F64]]:
    """Frame, reason and region (4,) of all that is covered, of the report of a run."""
    covered = report["done"].index("covered")
    for one in [*report["tracks"], report["bystanders"]]:
        rows = one["rows"]
        for k in np.flatnonzero(np.array(rows["done"]) == covered).tolist():
            region = np.array([rows[side][k] for side in ("x0", "y0", "x1", "y1")], np.float64)
            yield rows["frame"][k], report["reasons"][rows["reason"][k]], region


def show(clip: RealClip, found: list[tuple[int, str, F64]], folder: Path) -> None:
    """Write a picture of the first false cover of each reason."""
    wanted = {reason: (frame, region) for frame, reason, region in reversed(found)}
    with open_input(clip.video) as media:
        for frame in media:
            for reason, (index, region) in wanted.items():
                if index == frame.index:
                    x0, y0, x1, y1 = region.astype(int).tolist()
                    picture = cv2.cvtColor(frame.rgb(), cv2.COLOR_RGB2BGR)
                    cv2.rectangle(picture, (x0, y0), (x1, y1), (0, 0, 255), 2)
                    cv2.imwrite(str(folder / f"{clip.name} {index} {reason}.png"), picture)


def measure(options: argparse.Namespace) -> Report:
    """All clips, or some."""
    rows: list[tuple[object, ...]] = []
    for clip in real_clips(options.shared):
        if not clip.name.startswith(tuple(options.only or [""])):
            continue
        with tempfile.TemporaryDirectory() as folder:
            report = deidentified(clip.video, Path(folder) / "out.mkv", "--to", str(options.seconds))
        found = [one for one in covers(report) if is_false(one[2], true_boxes(clip, one[0]))]
        reasons = {why: len({f for f, r, _ in found if r == why}) for why in sorted({r for _, r, _ in found})}
        words = ", ".join(f"{why} {count}" for why, count in reasons.items())
        rows.append((clip.name, report["frames"], len({frame for frame, _, _ in found}), words))
        common.say(f"{rows[-1]}")
        if options.show:
            options.show.mkdir(parents=True, exist_ok=True)
            show(clip, found, options.show)
    frames, false = (sum(int(str(row[k])) for row in rows) for k in (1, 2))
    return Report(
        "deidentify.false_covers", "De-identification: covers of what is no face",
        [Criterion("frames with a false cover", 100 * false / max(frames, 1), "<=", 0.3, "%")],
        [Table("False covers", ("clip", "frames", "false", "frames by reason"), rows)],
        [f"{false} of {frames} frames."],
    )  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--only", nargs="*", help="beginnings of names of clips; all by default")
    made.add_argument("--seconds", type=float, default=5.0, help="of each clip, from its beginning")
    made.add_argument("--show", type=Path, help="folder for pictures of false covers")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
