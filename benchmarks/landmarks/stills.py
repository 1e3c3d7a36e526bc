"""Annotated stills: errors of the landmarker per data set, compared with PFLD and MediaPipe.

Errors are mean distances to the annotated points in % of the annotated distance between the outer eye corners, over
the faces that were found.  "Offset removed": each point's mean residual in the frame of the eyes is taken off,
two-fold (first and second half of the faces), because schemes put points of the same name to other places.  A face with
a mean error over 10 % is a failure, and so is one that was not found; those with less confidence than the
trackers require are unsure, and count as not found.

PFLD is started from the true box, enlarged by 1.1 and made square; it was probably trained on lfpw.  MediaPipe finds
the faces itself.  The landmarker does too, and with --faces true-box it is started from the true box.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.annotated import SETS, Still, stills
from benchmarks.landmarks.metrics import Accuracy, accuracy, matches
from benchmarks.landmarks.peers import MISSING, Peer, face81
from guise.aam.brows import BrowLift
from guise.aam.landmarks import Face, OnnxLandmarker
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.parsing import FaceParser

NAME, TITLE = "landmarks.stills", "Landmarks on annotated stills"
Finder = Callable[[Picture, Still], F64]  # points (n, 68, 2) of the faces of a still, NaN of those not found

PFLD_CARD = """
model = "{}"
scheme = "ibug68"
[input]
size = [112, 112]
[crop]
enlarge = 1.1
"""


def at_faces(found: F64, still: Still) -> F64:
    """Of points (m, 68, 2) those that lie on each of the still's faces (n, 68, 2), NaN where none does."""
    answer = np.full(still.points.shape, np.nan)
    for face, index in enumerate(matches(setting.boxes_of(found), still.boxes)):
        if index is not None:
            answer[face] = found[index]
    return answer


def lifted(parser: FaceParser, rgb: Picture, face: Face) -> Face:
    """A face with its brows on their hair, as `guise landmarks` writes it."""
    points, lift = face.points.astype(np.float64), BrowLift()
    lift.see(parser.parse(rgb, points), points)
    return replace(face, points=lift(points).astype(np.float32))


def own_faces(landmarker: Any) -> tuple[Finder, list[int]]:
    """A finder by detection, and the number of faces found with too little confidence for each still."""
    unsure: list[int] = []
    parser = FaceParser() if isinstance(landmarker, BuiltinLandmarker) else None

    def find(rgb: Picture, still: Still) -> F64:
        faces = landmarker.detect(rgb)
        if parser is not None:
            faces = [lifted(parser, rgb, face) for face in faces]
        every = at_faces(setting.points_of(faces), still)
        taken = at_faces(setting.points_of(setting.sure(faces)), still)
        unsure.append(int((np.isfinite(every).all((1, 2)) & ~np.isfinite(taken).all((1, 2))).sum()))
        return taken

    return find, unsure


def true_boxes(landmarker: Any) -> Finder:
    """A finder that gets the true boxes."""

    def find(rgb: Picture, still: Still) -> F64:
        faces = [landmarker.points_in_box(rgb, box) for box in still.boxes]
        missing = np.full((68, 2), np.nan)
        return np.array([missing if face is None else face.points[IBUG68] for face in faces]).reshape(
            -1, 68, 2
        )

    return find


def pfld(shared: Path) -> Finder | None:
    """PFLD in the true boxes; None without its file."""
    model = shared / "models" / "pfld.onnx"
    if not model.is_file():
        return None
    with tempfile.TemporaryDirectory() as folder:
        card = Path(folder) / "pfld.toml"
        card.write_text(PFLD_CARD.format(model.absolute()))
        network = OnnxLandmarker(card)
    return lambda rgb, still: np.array([network.points_in(rgb, box) for box in still.boxes]).reshape(
        -1, 68, 2
    )


def mediapipe(peer: Peer) -> Finder:
    """MediaPipe, which finds the faces itself."""
    return lambda rgb, still: at_faces(face81(peer.meshes(rgb))[:, IBUG68], still)


def evaluated(find: Finder, pictures: Sequence[Still]) -> Accuracy:
    """Accuracy of a finder on a data set."""
    found = np.concatenate([find(still.rgb(), still) for still in pictures])
    truth = np.concatenate([still.points for still in pictures])
    return accuracy(np.where(np.isfinite(truth), found, np.nan), truth)


def measure(options: argparse.Namespace) -> Report:
    """All data sets, all landmarkers."""
    landmarker = setting.landmarker(options)
    report, ours = Report(NAME, TITLE), {}
    true_box = options.faces == "true-box"
    if true_box and not hasattr(landmarker, "points_in_box"):
        return setting.skipped(NAME, TITLE, f"{landmarker.name} cannot start from a given box")
    network = pfld(options.shared)
    for name in SETS:
        pictures = stills(options.shared, name)[: 10 if options.quick else None]
        if not pictures:
            report.notes.append(f"Skipped: {name} is not in {options.shared}.")
            continue
        rows: dict[str, tuple[Accuracy, object]] = {}
        if true_box:
            rows[f"{landmarker.name}, true box"] = evaluated(true_boxes(landmarker), pictures), "-"
        else:
            find, unsure = own_faces(landmarker)
            rows[landmarker.name] = evaluated(find, pictures), 0
            rows[landmarker.name] = rows[landmarker.name][0], sum(unsure)
        ours[name] = next(iter(rows.values()))[0]
        if network is not None:
            rows["PFLD, true box"] = evaluated(network, pictures), "-"
        if options.peers_python:
            model = options.shared / "models" / setting.MEDIAPIPE
            with Peer(options.peers_python, "image", model) as peer:
                found = evaluated(mediapipe(peer), pictures)
            rows["MediaPipe"] = found, "-"
        report.tables.append(table(name, len(pictures), rows))
        common.say(common.markdown_table(report.tables[-1].columns, report.tables[-1].rows))
    report.criteria = criteria(ours)
    report.notes += [] if network else ["PFLD was not measured: models/pfld.onnx is not there."]
    report.notes += [] if options.peers_python else [MISSING.format("MediaPipe")]
    report.notes.append(
        "The points of dlib are another program's answers, those of the other sets are placed by hand."
    )
    return report


def table(name: str, pictures: int, rows: dict[str, tuple[Accuracy, object]]) -> Table:
    """One data set."""
    columns = (
        "landmarker", "faces", "68 raw, %", "inner 51 raw, %", "68 offset removed, %", "inner 51 offset removed, %",
        "failures", "not found", "unsure",
    )  # fmt: skip
    content = [
        (who, a.faces, a.raw, a.inner, a.removed, a.removed_inner, a.failures, a.missing, unsure)
        for who, (a, unsure) in rows.items()
    ]
    return Table(f"{name}, {pictures} pictures", columns, content)


def criteria(ours: dict[str, Accuracy]) -> list[Criterion]:
    """The targets, for lfpw."""
    if "lfpw" not in ours:
        return []
    lfpw = ours["lfpw"]
    return [
        Criterion("lfpw, 68 points, raw", lfpw.raw, "<=", 5.2, "%"),
        Criterion("lfpw, inner 51, raw", lfpw.inner, "<=", 4.2, "%"),
        Criterion("lfpw, 68 points, offset removed", lfpw.removed, "<=", 3.8, "%"),
        Criterion("lfpw, inner 51, offset removed", lfpw.removed_inner, "<=", 2.9, "%"),
        Criterion("lfpw, failures and faces not found", lfpw.failures, "<=", 0),
    ]


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument(
        "--faces", choices=("detected", "true-box"), default="detected", help="where to start from"
    )
    return made


if __name__ == "__main__":
    common.run(measure, parser())
