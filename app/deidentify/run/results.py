"""What lies beside an output: the reports, and the tracks to review."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.options import DeidentifyOptions
from guise.app.deidentify.report.page import write_page
from guise.app.deidentify.report.report import write_report
from guise.app.deidentify.report.review import write_tracks
from guise.app.deidentify.report.sheet import contact_sheet
from guise.app.deidentify.stages.case import Case, track_from
from guise.app.deidentify.tracks import BYSTANDERS, AuditFinding, FileReport, TrackOutcome
from guise.app.media.pictures import save_picture
from guise.app.swapping.donors import bare
from guise.app.swapping.policy import (
    COVERED,
    LEFT,
    SWAPPED,
)
from guise.common.files import fitting_name


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
    plan, covered = case.plan, [frame for r in renders for frame in r["covered"]]
    with case.open_input() as media:
        width, height = media.width, media.height
    return FileReport(
        *names, case.scan.frames, case.times, width, height, case.tracks,
        tuple(_outcome(plan, n) for n in [*(t.number for t in case.tracks), BYSTANDERS]), tuple(findings),
        _counts(plan, case.scan.frames, covered), {**_settings(case.options), "renderer": renders[0]["renderer"]},
        tuple(dict.fromkeys(problems)), round(seconds, 3), _digest(output), sum(r["searched"] for r in renders),
        any(found["damage"] for found in read),
    )  # fmt: skip


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


def _outcome(plan: dict[str, NDArray[Any]], track: int) -> TrackOutcome:
    mine = np.flatnonzero(plan["track"] == track)
    boxes = np.round(plan["box"][mine]).astype(np.int32)
    return TrackOutcome(track, plan["frame"][mine], plan["done"][mine], plan["confidence"][mine], boxes)


def _counts(plan: dict[str, NDArray[Any]], frames: int, covered: Sequence[int]) -> dict[str, int]:
    """Of the frames, by the worst that was done in each.   covered : those with a cover for what the audit found."""
    worst = np.full(frames, -1)
    for rank, code in enumerate((SWAPPED, COVERED, LEFT)):
        these = plan["frame"][plan["done"] == code]
        worst[these] = np.maximum(worst[these], rank)
    these = np.array(covered, np.intp)
    worst[these] = np.maximum(worst[these], 1)
    names = ("without face", "swapped", "covered", "left")
    return {name: int((worst == rank).sum()) for rank, name in enumerate(names, start=-1)}


def pictures(case: Case, kind: Literal["pictures", "output"]) -> dict[int, list[NDArray[np.uint8]]]:
    """The tracks' pictures of the input or of the output, in the order of time."""
    found: dict[int, list[NDArray[np.uint8]]] = {track.number: [] for track in case.linked}
    for k in range(len(case.scan.segments)):
        for name, picture in case.work.load_arrays(f"{kind}.{k}.npz").items():
            found.setdefault(int(name.split(".")[0]), []).append(picture)
    return found


def write_review(case: Case, output: Path, splits: Mapping[int, Sequence[int]] | None = None) -> None:
    """The tracks to edit and their pictures, readable by their owner only, as they show faces of the input.

    splits : which tracks are split, see `split_tracks`.
    """
    tracks = [track_from(entry) for entry in case.work.load_json("proposed.json")]
    table, sheet = beside(output, ".tracks.json"), beside(output, ".tracks.jpg")
    write_tracks(
        table, tracks, input_name=case.manifest["name"], fingerprint=case.manifest["fingerprint"],
        frames=case.scan.frames, seconds=case.times, splits=splits,
    )  # fmt: skip
    save_picture(sheet, contact_sheet(pictures(case, "pictures"), tracks, case.times))
    for path in (table, sheet):
        path.chmod(0o600)


def write_reports(case: Case, report: FileReport, output: Path) -> None:
    """Write NAME.report.json and NAME.report.html."""
    write_report(beside(output, ".report.json"), report)
    write_page(beside(output, ".report.html"), report, pictures(case, "output"))
