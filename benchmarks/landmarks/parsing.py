"""What hides a face, and irises: against exact truth of rendered scenes, outlines by hand, and held-out parts.

- Scenes `hand` and `mug` of synthetic/swap: a hand of the person's own skin, and a mug, which training never sees.  The
  crop lies about the true points.  Counted are the parsing's cells within the hull of the points.
- 44 frames of real clips, a third of them with hands outlined by hand (training/real_occluders.json); the others show
  faces in plain view, one with glasses.
- Held-out parts, with --parts: irises, all classes, and objects as training draws them, of held-out hands.

IoU is of the most likely class.
"""

from __future__ import annotations

from benchmarks.threads import one_thread

if __name__ == "__main__":
    one_thread("benchmarks.landmarks.parsing")

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.builtin import DATA
from guise.aam.parsing import CELLS, FaceClass, FaceParser, FaceParsing
from guise.common.arrays import Bool
from training.real_occluders import load_outlined, outlined_figures

NAME, TITLE = "landmarks.parsing", "Parsing of faces, and irises"
SCENES = ("hand", "mug")
EVERY, PICTURES, RUNS = 5, 600, 60
MAX_BYTES = 8_000_000


def frames_of(scene: Path, every: int) -> Iterator[tuple[Picture, F64, Bool]]:
    """Frames of a rendered scene, the true points (81, 2), and where its object is to be seen (h, w)."""
    truth = np.load(scene / "truth.npz")
    points = np.load(scene / "source.npz")["landmarks"].reshape(-1, 81, 2).astype(np.float64)
    width, height = (int(n) for n in truth["image_size"])
    for frame in common.frames(common.Clip(scene.name, scene / "source.mp4", points)):
        if frame.index % every == 0:
            bits = np.unpackbits(truth["occluder"][frame.index])[: width * height]
            yield frame.rgb(), points[frame.index], bits.reshape(height, width) > 0


def in_cells(parsing: FaceParsing, points: F64, shown: Bool) -> tuple[Bool, Bool]:
    """The cells (64, 64) within the hull of the points, and those that show the object."""
    places = points @ parsing.to_cells[:, :2].T + parsing.to_cells[:, 2]
    hull = np.zeros((CELLS, CELLS), np.uint8)
    cv2.fillConvexPoly(
        hull, np.round(cv2.convexHull(places.astype(np.float32)) * 16).astype(np.int32), 1, shift=4
    )
    size = float(np.hypot(*parsing.to_picture[:, 0]))
    soft = cv2.GaussianBlur(shown.astype(np.float32), (0, 0), max(0.4 * size, 0.1))
    return hull > 0, np.asarray(cv2.warpAffine(soft, parsing.to_cells, (CELLS, CELLS)) > 0.5)


def scene_row(parser: FaceParser, scene: Path, every: int) -> tuple[str, float, float]:
    """A scene's name, IoU of its object, and the percentage of the face's other cells called occluder."""
    both = either = wrong = clear = 0
    for rgb, points, shown in frames_of(scene, every):
        parsing = parser.parse(rgb, points)
        called = parsing.shares.argmax(0) == FaceClass.OCCLUDER
        hull, there = in_cells(parsing, points, shown)
        both += int((called & there & hull).sum())
        either += int(((called | there) & hull).sum())
        wrong += int((called & ~there & hull).sum())
        clear += int((~there & hull).sum())
    return scene.name, both / max(either, 1), 100 * wrong / max(clear, 1)


def milliseconds(parser: FaceParser, rgb: Picture, points: F64) -> float:
    """Median processor time of parsing one face."""
    times = []
    for _ in range(RUNS):
        start = time.thread_time()
        parser.parse(rgb, points)
        times.append(1e3 * (time.thread_time() - start))
    return float(np.median(times[5:]))


def cost(report: Report, parser: FaceParser, rgb: Picture, points: F64) -> None:
    """Time of landmarks and parsing together, and the bytes of all weights."""
    landmarker = open_landmarker("builtin")
    face = landmarker.detect(rgb)[0]
    refined = []
    for _ in range(RUNS):
        start = time.thread_time()
        landmarker.refine(rgb, face)
        refined.append(1e3 * (time.thread_time() - start))
    parsed = milliseconds(parser, rgb, points)
    size = sum(file.stat().st_size for file in DATA.iterdir())
    report.criteria += [
        Criterion("points, irises and parsing of a face", float(np.median(refined[5:])) + parsed, "<=", 3.5, "ms"),
        Criterion("all weights", size / 1e6, "<=", MAX_BYTES / 1e6, "MB"),
    ]  # fmt: skip
    report.notes.append(f"Of the time, parsing and irises: {parsed:.2f} ms.")


def parts(report: Report, folder: Path, count: int) -> None:
    """Irises and all classes of rendered people whom training never sees."""
    from training.cutouts import make_props
    from training.data import by_hands, load_parts
    from training.measure import answers_of_file
    from training.report import by_class, by_group

    answer = answers_of_file(DATA / "face.onnx")
    unseen, held = by_hands(load_parts(folder, held_out=True))
    hands = folder.parent / "hands.npz"
    props = make_props(99, hands if hands.exists() else None, held_out=True, backgrounds=300)
    irises = by_group(answer, unseen, count)
    plain, behind = by_class(answer, unseen, count, None), by_class(answer, unseen, count, props)
    report.criteria += [
        Criterion("centres of irises, held-out parts", irises["all"]["iris"], "<=", 6.0, "% of the eye's width"),
        Criterion("mean IoU, held-out parts", plain["mean"], ">=", 0.85),
        Criterion("IoU of objects, held-out parts", behind["occluder"], ">=", 0.9),
    ]  # fmt: skip
    rows = [
        (group, row["pictures"], row["iris"], row["radius"]) for group, row in irises.items() if "iris" in row
    ]
    report.tables += [
        Table("Irises of held-out parts", ("group", "pictures", "centre, % of the eye's width", "radius, %"), rows),
        Table("IoU, held-out parts", ("class", "plain", "behind an object"), [(n, plain[n], behind[n]) for n in plain]),
    ]  # fmt: skip
    if len(held):
        iou = by_class(answer, held, count, None)["occluder"]
        report.criteria.append(Criterion("IoU of rendered hands, held-out parts", iou, ">=", 0.9))


def measure(options: argparse.Namespace) -> Report:
    """Scenes, outlined frames, cost, parts."""
    report, parser = Report(NAME, TITLE), FaceParser()
    cv2.setNumThreads(1)
    data = options.shared / "data"
    scenes = [s for kind in SCENES for s in sorted((data / "synthetic" / "swap").glob(f"{kind}_*"))]
    rows = [scene_row(parser, scene, 4 * EVERY if options.quick else EVERY) for scene in scenes]
    for name, iou, wrong in rows:
        report.criteria += [
            Criterion(f"IoU of the object, {name}", iou, ">=", 0.9),
            Criterion(f"face called occluder, {name}", wrong, "<=", 2.0, "%"),
        ]
    outlined = load_outlined(data / "real")
    identity = np.eye(3)[:2]
    real = outlined_figures(
        np.stack([parser.of_crop(crop, identity).shares for crop in outlined.crops]), outlined
    )
    report.criteria += [
        Criterion(f"IoU of hands, {real['crops']} real frames", real["occluder_iou"], ">=", 0.8),
        Criterion("face called occluder, the same", real["false_occluder"], "<=", 2.0, "%"),
    ]
    if scenes:
        rgb, points, _ = next(frames_of(scenes[0], EVERY))
        cost(report, parser, rgb, points)
    else:
        report.notes.append(f"Skipped: no scenes in {data / 'synthetic' / 'swap'}.")
    if options.parts:
        parts(report, options.parts, 60 if options.quick else PICTURES)
    else:
        report.notes.append("Skipped: held-out parts; give --parts.")
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
