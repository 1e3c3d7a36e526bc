"""What lies beside an output: the reports, and the tracks to review."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.heads import region
from guise.app.deidentify.covers import FOUND, THING, CoverSpan, Rows, covers_of, rows_of
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.report.page import write_page
from guise.app.deidentify.report.report import write_report
from guise.app.deidentify.report.review import write_tracks
from guise.app.deidentify.report.sheet import contact_sheet
from guise.app.deidentify.run.planning import plan_faces
from guise.app.deidentify.stages.case import Case, track_from
from guise.app.deidentify.stages.jobs import picture
from guise.app.deidentify.tracks import BYSTANDERS, AuditFinding, FileReport, TrackOutcome
from guise.app.media.pictures import save_picture
from guise.app.swapping.donors import bare
from guise.app.swapping.policy import COVERED
from guise.common.files import fitting_name

MAX_COVER_PICTURES = 100


def beside(output: Path, suffix: str) -> Path:
    """A file beside the output under its name: NAME.report.json and the like."""
    return output.with_name(fitting_name(output.stem, suffix))


def report_of(case: Case, names: tuple[str, str], output: Path, seconds: float) -> FileReport:
    """The report of a rendered case.

    names : of input and output.   seconds : that the run took.
    """
    renders = [case.work.load_json(f"render.{k}.json") for k in range(len(case.scan.segments))]
    read = [case.work.load_json(f"problems.{k}.json") for k in range(len(case.scan.segments))]
    problems = [p for found in read for p in found["all"]]
    problems += [p for r in renders for p in r["problems"]] + case.work.load_json("published.json")
    findings = [
        AuditFinding(a["frame"], tuple(a["box"]), a["score"], a["covered"])
        for r in renders
        for a in r["audit"]
    ]
    rows = drawn_rows(case)
    with case.open_input() as media:
        width, height = media.width, media.height
    return FileReport(
        *names, case.scan.frames, case.times, width, height, case.tracks,
        outcomes_of(rows, [track.number for track in case.tracks]), tuple(findings),
        tuple(covers_of(rows)), {**_settings(case.options), "renderer": renderers_of(renders)},
        tuple(dict.fromkeys(problems)), round(seconds, 3), _digest(output), sum(r["searched"] for r in renders),
        any(found["damage"] for found in read), tuple(frame for r in renders for frame in r["unclear"]),
    )  # fmt: skip


def renderers_of(renders: Sequence[dict[str, Any]]) -> str:
    """What drew the faces of the jobs; several where machines differ, whose drawings are rounded differently."""
    return " and ".join(dict.fromkeys(job["renderer"] for job in renders if job["renderer"]))


def drawn_rows(case: Case) -> dict[str, NDArray[Any]]:
    """What was drawn, in the columns of `guise.app.deidentify.covers`; finds of the audit are numbered last."""
    parts, used = [], int(case.plan["cover"].max(initial=0))
    for k in range(len(case.scan.segments)):
        rows = case.work.load_arrays(f"drawn.{k}.npz")
        found = rows["reason"] == FOUND
        rows["cover"][found] += used
        used = max(used, int(rows["cover"].max(initial=0)))
        parts.append(rows)
    return rows_of(parts)


def _settings(options: DeidentifyOptions) -> dict[str, Any]:
    """The options as reported: files without their folders, whose names may identify somebody."""
    named = {
        k: v and Path(v).name for k, v in options.as_json().items() if k in ("keyfile", "certificate", "key")
    }
    gallery = [path.name for path in options.gallery]
    cover = options.cover.partition(":")[0]
    detector = options.detector and options.detector.partition(":")[0]
    return (
        options.as_json()
        | named
        | {"donor": bare(options.donor), "gallery": gallery, "detector": detector, "cover": cover}
    )


def _digest(path: Path) -> str:
    """SHA-256 of a file, "" for a folder."""
    if path.is_dir():
        return ""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def outcomes_of(rows: Rows, tracks: Sequence[int]) -> tuple[TrackOutcome, ...]:
    """What was done with each track, by number, and with all other faces."""
    return tuple(_outcome(rows, number) for number in (*tracks, BYSTANDERS))


def _outcome(rows: Rows, track: int) -> TrackOutcome:
    is_bare = (rows["reason"] == THING) & (rows["done"] != COVERED)
    mine = np.flatnonzero((rows["track"] == track) & ~is_bare)
    boxes = rows["box"][mine].copy()
    for place, row in enumerate(mine.tolist()):
        if rows["done"][row] == COVERED:
            boxes[place] = region(rows["box"][row], float(rows["growth"][row]), float(rows["turn"][row]))
    frames, done, confidence, reasons = (rows[k][mine] for k in ("frame", "done", "confidence", "reason"))
    return TrackOutcome(track, frames, done, confidence, reasons, np.round(boxes).astype(np.int32))


def pictures(case: Case, kind: Literal["pictures", "output"]) -> dict[int, list[NDArray[np.uint8]]]:
    """The tracks' pictures of the input or of the output, in the order of time."""
    found: dict[int, list[NDArray[np.uint8]]] = {track.number: [] for track in case.linked}
    for k in range(len(case.scan.segments)):
        for name, one in case.work.load_arrays(f"{kind}.{k}.npz").items():
            found.setdefault(int(name.split(".")[0]), []).append(one)
    return found


def cover_pictures(case: Case, covers: Sequence[CoverSpan]) -> dict[CoverSpan, NDArray[np.uint8]]:
    """Pictures of the input of the covers of faces without a track; of the longest ones, if there are many."""
    longest = sorted((one for one in covers if not one.track), key=lambda one: one.first - one.last)
    chosen = longest[:MAX_COVER_PICTURES]
    shown = {}
    for one in chosen:
        for frame in case.frames(one.shown, one.shown + 1):
            shown[one] = picture(frame, np.array(one.box, np.float32), 0.0)
    return dict(sorted(shown.items(), key=lambda pair: pair[0].number))


def write_review(case: Case, output: Path, splits: Mapping[int, Sequence[int]] | None = None) -> None:
    """The tracks to edit and their pictures, readable by their owner only, as they show faces of the input.

    splits : which tracks are split, see `split_tracks`.
    """
    tracks = [track_from(entry) for entry in case.work.load_json("proposed.json")]
    covers = covers_of(plan_faces(case, tracks))
    table, sheet = beside(output, ".tracks.json"), beside(output, ".tracks.jpg")
    write_tracks(
        table, tracks, input_name=case.manifest["name"], fingerprint=case.manifest["fingerprint"],
        frames=case.scan.frames, seconds=case.times, covers=covers, splits=splits,
    )  # fmt: skip
    shown = cover_pictures(case, covers)
    save_picture(sheet, contact_sheet(pictures(case, "pictures"), tracks, case.times, shown))
    for path in (table, sheet):
        path.chmod(0o600)


def write_reports(case: Case, report: FileReport, output: Path) -> None:
    """Write NAME.report.json and NAME.report.html."""
    write_report(beside(output, ".report.json"), report)
    write_page(beside(output, ".report.html"), report, pictures(case, "output"))
