"""Rendered people not seen in training, against ground truth: data/synthetic, and held-out parts with --parts.

Errors are mean distances to the true points in % of the true distance between the outer eye corners, over the faces
found; hidden points count, and "visible" leaves them out.  The brows of data/synthetic are on the skin below the hair,
those of the parts on the hair's upper edge, as training has them: "without brows" is free of that.  The meshes' points
are brought to the landmarker's definition first (training/definitions.py); the last column is without that.

Groups are those of the parts' attributes: sex and age as the renderer mixes them (0 to 1), and for the skin the largest
of the three ancestries that are mixed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.metrics import Bools, face_errors, matches, mean_of, percent_errors
from guise.aam.landmarks.schemes import BELOW_BROWS, FOREHEAD, IBUG68, INNER51, JAW
from training import definitions

NAME, TITLE = "landmarks.rendered", "Landmarks on rendered people not seen in training"
FRAME_STEP, PICTURES = 10, 1500
ANCESTRIES = ("caucasian", "african", "asian")
NO_BROWS = np.r_[JAW, BELOW_BROWS, FOREHEAD]


@dataclass(frozen=True, eq=False)
class Known:
    """A picture and its true faces: points (f, 81, 2) pixels, visible (f, 81)."""

    rgb: Picture
    points: F64
    visible: Bools


@dataclass(frozen=True, eq=False)
class Found:
    """Of all faces of a set: found and true points (n, 81, 2), NaN where not found, and visibility (n, 81)."""

    points: F64
    truth: F64
    visible: Bools

    @property
    def defined(self) -> Found:
        """The same with the truth in the landmarker's definition."""
        jaw, move = definitions.load_alignment("rendered")
        return replace(
            self, truth=definitions.align_labels(self.truth.astype(np.float32), jaw, move).astype(np.float64)
        )

    @property
    def errors(self) -> F64:
        """(n, 81), %."""
        return percent_errors(self.points, self.truth)

    @property
    def each(self) -> F64:
        """Mean error (n,) of each face, %."""
        return face_errors(self.errors)

    def row(self) -> tuple[object, ...]:
        """Faces, found, errors of all, visible, without brows, inner points, 95th percentile."""
        errors, each = self.errors, self.each
        finite = each[np.isfinite(each)]
        return (
            len(each), 100 * len(finite) / max(len(each), 1), mean_of(each),
            mean_of(face_errors(np.where(self.visible, errors, np.nan))), mean_of(face_errors(errors[:, NO_BROWS])),
            mean_of(face_errors(errors, INNER51)), float(np.quantile(finite, 0.95)) if len(finite) else float("nan"),
        )  # fmt: skip

    def both(self) -> tuple[object, ...]:
        """`row` in the landmarker's definition, and the mean error against the mesh's own points."""
        return (*self.defined.row(), mean_of(self.each))


def found_in(landmarker: Any, pictures: Iterable[Known], true_box: bool = False) -> Found:
    """Search all pictures; faces that are mostly hidden are left out."""
    points, truth, visible = [], [], []
    for known in pictures:
        asked = known.visible.mean(1) >= 0.5
        given, boxes = known.points[asked], setting.boxes_of(known.points[asked, IBUG68])
        answer = np.full(given.shape, np.nan)
        if true_box:
            faces = [landmarker.points_in_box(known.rgb, box) for box in boxes]
            for index, face in enumerate(faces):
                answer[index] = np.nan if face is None else face.points
        else:
            found = setting.points_of(setting.sure(landmarker.detect(known.rgb)), 81)
            for index, match in enumerate(matches(setting.boxes_of(found[:, IBUG68]), boxes)):
                answer[index] = np.nan if match is None else found[match]
        points.append(answer)
        truth.append(given)
        visible.append(known.visible[asked])
    return Found(np.concatenate(points), np.concatenate(truth), np.concatenate(visible))


def clip_pictures(video: Path, every: int) -> Iterator[Known]:
    """Frames of a clip of data/synthetic; a clip of several people has an npz for each."""
    files = [video.with_suffix(".npz")]
    files = files if files[0].is_file() else sorted(video.parent.glob(f"{video.stem}_*.npz"))
    truths = [np.load(file) for file in files]
    points = np.stack([t["landmarks"] for t in truths], axis=1).astype(np.float64)
    visible = np.stack([t["visibility"] for t in truths], axis=1)
    for frame in common.frames(common.Clip(video.stem, video, points[:, 0])):
        if frame.index % every == 0:
            yield Known(frame.rgb(), points[frame.index], visible[frame.index])


def still_pictures(folder: Path) -> Iterator[Known]:
    """The stills of a person of data/synthetic."""
    with np.load(folder / "stills.npz") as truth:
        for index, name in enumerate(truth["names"]):
            points, visible = truth["landmarks"][index], truth["visibility"][index]
            yield Known(
                setting.picture(folder / f"{name}.jpg"), points[None].astype(np.float64), visible[None]
            )


def synthetic_sets(shared: Path, every: int) -> Iterator[tuple[str, Iterator[Known]]]:
    """Each person, then each hard clip."""
    folder = shared / "data" / "synthetic"
    for person in common.synthetic_people(shared):
        yield (
            person,
            (
                known
                for source in (
                    clip_pictures(folder / "people" / person / "talk2.mp4", every),
                    still_pictures(folder / "people" / person),
                )
                for known in source
            ),
        )
    for video in sorted((folder / "hard").glob("*.mp4")):
        yield f"hard/{video.stem}", clip_pictures(video, every)


def held_out(folder: Path, count: int) -> Any:
    """Plain pictures of rendered people whom training never sees, about so many (training.data.Pictures)."""
    from training.data import by_hands, load_parts, part_files

    files = len(part_files(folder))
    first = load_parts(folder, held_out=True, limit=1)
    read = min(files, -(-count // max(len(first), 1)))
    return by_hands(load_parts(folder, held_out=True, limit=read))[0]


def part_pictures(pictures: Any) -> Iterator[Known]:
    """One after the other."""
    for image, points, visible in zip(pictures.images, pictures.points, pictures.visible, strict=True):
        yield Known(image, points[None].astype(np.float64), visible[None])


def groups(attributes: NDArray[Any], names: tuple[str, ...]) -> dict[str, Bools]:
    """Which pictures (n,) belong to each group, of attributes (n, k)."""
    of = {name: attributes[:, index] for index, name in enumerate(names)}
    ancestry = np.stack([of[name] for name in ANCESTRIES]).argmax(0)
    made = {"female": of["male"] < 0.5, "male": of["male"] >= 0.5}
    made |= {"younger third": of["age"] < 1 / 3, "older third": of["age"] >= 2 / 3}
    made["middle third"] = ~(made["younger third"] | made["older third"])
    return made | {f"mostly {name}": ancestry == index for index, name in enumerate(ANCESTRIES)}


def measure(options: argparse.Namespace) -> Report:
    """data/synthetic, then the parts."""
    landmarker = setting.landmarker(options)
    every = 60 if options.quick else options.every
    report, rows, people = Report(NAME, TITLE), [], []
    for name, pictures in synthetic_sets(options.shared, every):
        result = found_in(landmarker, pictures)
        rows.append((name, *result.both()))
        if not name.startswith("hard/"):
            people.append(face_errors(result.defined.errors[:, NO_BROWS]))
        common.say(str(rows[-1]))
    if people:
        error = mean_of(np.concatenate(people))
        report.criteria.append(
            Criterion("mean error without brows, people of data/synthetic", error, "<=", 3.0, "%")
        )
    else:
        report.notes.append(f"Skipped: no people in {options.shared / 'data' / 'synthetic'}.")
    columns = (
        "set", "faces", "found, %", "mean error, %", "visible, %", "without brows, %", "inner 51, %",
        "95th percentile, %", "mesh's own points, %",
    )  # fmt: skip
    if options.parts:
        pictures = held_out(options.parts, 100 if options.quick else options.pictures)
        result = found_in(landmarker, part_pictures(pictures))
        rows.append(("held-out parts", *result.both()))
        if hasattr(landmarker, "points_in_box"):
            rows.append(("the same, true box", *found_in(landmarker, part_pictures(pictures), True).both()))
        add_groups(report, result.defined, pictures)
    else:
        report.notes.append("Skipped: held-out parts and the groups; give --parts.")
    report.tables.insert(0, Table("Each set", columns, rows))
    return report


def add_groups(report: Report, result: Found, pictures: Any) -> None:
    """Error by group, of the parts."""
    each = result.each
    chosen = groups(pictures.attributes, pictures.attribute_names)
    rows = []
    for name, members in chosen.items():
        chosen = each[members]
        people = len(np.unique(pictures.person[members]))
        rows.append(
            (
                name,
                people,
                len(chosen),
                100 * float(np.isfinite(chosen).mean()) if len(chosen) else 0.0,
                mean_of(chosen),
            )
        )
    mean = mean_of(each)
    worst = max((row for row in rows if np.isfinite(row[-1])), key=lambda row: row[-1])
    report.criteria.append(Criterion("mean error, held-out parts", mean, "<=", 3.0, "%"))
    report.criteria.append(Criterion(f"worst group ({worst[0]}) over the mean", worst[-1] / mean, "<=", 1.3))
    report.tables.append(
        Table("Groups of the held-out parts", ("group", "people", "faces", "found, %", "mean error, %"), rows)
    )


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--every", type=int, default=FRAME_STEP, help="take one frame of the clips in so many")
    made.add_argument("--pictures", type=int, default=PICTURES, help="about so many pictures of the parts")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
