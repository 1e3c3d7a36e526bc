"""NAME.report.json, what was done with each face in every frame, and the summary of a batch.

docs/deidentify-report.md explains the fields.  The figures of frames are columns, written piece by piece, so that an
hour of video needs no more memory than its arrays do.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.covers import REASONS
from guise.app.deidentify.reach import PEOPLE, REACHES
from guise.app.deidentify.tracks import BYSTANDERS, FileReport, Track, TrackOutcome
from guise.app.swapping.donors import bare
from guise.app.swapping.policy import DONE
from guise.common.arrays import I32
from guise.common.files import write_whole
from guise.common.text import counted
from guise.common.version import VERSION

REPORT_FORMAT = "guise-report"
BATCH_FORMAT = "guise-batch-report"
REPORT_VERSION = 1
KINDS = ("all_swapped", "some_covered", "not_verified", "failed")
VERIFIED, FAILED, NOT_VERIFIED = 0, 1, 3
MAX_TIMES = 3  # in a sentence
NUMBERS_PER_WRITE = 8192


@dataclass(frozen=True)
class Span:
    """Consecutive frames first..last, inclusive, in which the same was done."""

    first: int
    last: int
    done: str


@dataclass(frozen=True)
class BatchEntry:
    """A file of a batch: names, exit code, what happened in words, `FileReport.counts` ({} if it failed), its page."""

    input: str
    output: str | None
    code: int
    sentence: str
    counts: dict[str, int]
    report: str = ""


def write_report(path: Path, report: FileReport) -> None:
    """Write the report of a file as JSON; settings must be what JSON can hold."""

    def write(part: Path) -> None:
        # A name that isn't valid Unicode holds lone surrogates, which only JSON escapes can represent.
        with part.open("w", encoding="utf-8", errors="backslashreplace") as file:
            _write(file, report)

    write_whole(path, write)


def write_batch(path: Path, entries: Sequence[BatchEntry]) -> None:
    """Write the summary of a batch as JSON."""
    kinds = [kind(entry) for entry in entries]
    value = {
        "format": BATCH_FORMAT,
        "version": REPORT_VERSION,
        "run": _run(),
        "files": len(entries),
        **{name: kinds.count(name) for name in KINDS},
        "entries": [vars(entry) for entry in entries],
    }
    text = json.dumps(value, indent=1, ensure_ascii=False) + "\n"
    write_whole(path, text.encode("utf-8", "backslashreplace"))


def kind(entry: BatchEntry) -> str:
    """Which of KINDS a file of a batch is."""
    if entry.code == VERIFIED:
        return "some_covered" if entry.counts.get("covered") else "all_swapped"
    return "not_verified" if entry.code == NOT_VERIFIED else "failed"


def outcome(report: FileReport) -> int:
    """The exit code.

    0: all faces are swapped, covered, or left as the user said.  3: not verified.  1: the last audit still
    finds a face, which is more than a doubt.
    """
    if any(not finding.covered for finding in report.audit):
        return FAILED
    return NOT_VERIFIED if len(unverified(report)) or report.damaged else VERIFIED


def verdict(report: FileReport) -> str:
    """The outcome in some sentences, with the times to look at."""
    if seen := sorted(finding.frame for finding in report.audit if not finding.covered):
        return f"A face may be visible in the output, at {times(report, seen)}: do not share it."
    return _done(report) + (" The input is damaged, see the problems: not verified." * report.damaged)


def _done(report: FileReport) -> str:
    """What was done, in some sentences."""
    swapped, covered, left = (frames_with(report, done) for done in DONE)
    sentence = f"No face was found in {counted(report.frames, 'frame')}."
    hidden = {"swapped": swapped, "covered": covered}
    if parts := [f"{done} in {counted(len(some), 'frame')}" for done, some in hidden.items() if len(some)]:
        sentence = f"The faces that were found are {' and '.join(parts)}."
    elif len(left):
        sentence = "No face is changed."
    if len(covered):
        sentence += f" Covers: {times(report, covered)}."
    if len(faces := frames_with(report, "left", but=BYSTANDERS)):
        sentence += f" A face is left as it is in {counted(len(faces), 'frame')}, as you said."
    if len(things := np.setdiff1d(left, faces)):
        sentence += f" What has no track is left as it is in {counted(len(things), 'frame')}, as you said."
    if len(without := without_face(report)):
        sentence += f" In {counted(len(without), 'frame')} after a face none was found: not verified."
    if report.unclear:
        sentence += (
            f" In {counted(len(report.unclear), 'frame')} nobody can tell if there is a face: not verified."
        )
    if len(watch := unverified(report)):
        sentence += f" Watch {times(report, watch)}."
    return sentence


def without_face(report: FileReport) -> I32:
    """The frames in which no face was found, after one that has one: it may have left, or was missed."""
    known = np.zeros(report.frames, bool)
    for one in report.outcomes:
        known[one.frames] = True
    if known.any():
        known[: int(known.argmax())] = True
    return np.flatnonzero(~known if known.any() else known).astype(np.int32)


def unverified(report: FileReport) -> I32:
    """The frames to watch, as a face in them may have been missed."""
    return np.union1d(without_face(report), np.array(report.unclear, np.int32)).astype(np.int32)


def frames_with(report: FileReport, done: str, but: int = -1) -> I32:
    """The frames, ascending, in which this was done with a face.   but : a track that doesn't count."""
    has = np.zeros(report.frames, bool)
    for one in report.outcomes:
        has[one.frames[(one.done == DONE.index(done)) & (one.track != but)]] = True
    return np.flatnonzero(has).astype(np.int32)


def times(report: FileReport, frames: Sequence[int] | I32) -> str:
    """When some frames (n,), ascending, are seen: the longest runs, those of less than a second apart as one."""
    at = report.seconds[np.asarray(frames)]
    runs = np.split(at, np.flatnonzero(np.diff(at) >= 1) + 1)
    chosen = sorted(sorted(runs, key=lambda run: run[0] - run[-1])[:MAX_TIMES], key=lambda run: float(run[0]))
    words = [
        clock(run[0]) if clock(run[0]) == clock(run[-1]) else f"{clock(run[0])} to {clock(run[-1])}"
        for run in chosen
    ]
    return ", ".join(words) + (
        f" and {counted(len(runs) - MAX_TIMES, 'time')} more" if len(runs) > MAX_TIMES else ""
    )


def spans(one: TrackOutcome) -> list[Span]:
    """What was done, in runs of frames; of several faces in a frame (bystanders) the least hidden one counts."""
    order = np.lexsort((one.done, one.frames))
    frames, done = one.frames[order], one.done[order]
    last_of_frame = np.append(np.diff(frames) > 0, True)[: len(frames)]
    frames, done = frames[last_of_frame], done[last_of_frame]
    new = np.flatnonzero((np.diff(frames) > 1) | (np.diff(done.astype(int)) != 0)) + 1
    edges = [0, *new.tolist(), len(frames)] if len(frames) else []
    return [Span(int(frames[a]), int(frames[b - 1]), DONE[int(done[a])]) for a, b in pairwise(edges)]


def clock(seconds: float) -> str:
    """A time in a video, to be read.

    >>> clock(62.34), clock(3661.0)
    ('1:02.3', '1:01:01.0')
    """
    minutes, tenths = divmod(round(10 * seconds), 600)
    hours, minutes = divmod(minutes, 60)
    rest = f"{tenths // 10:02}.{tenths % 10}"
    return f"{hours}:{minutes:02}:{rest}" if hours else f"{minutes}:{rest}"


def _write(file: TextIO, report: FileReport) -> None:
    for key, value in _head(report).items():
        file.write(f'{"{" if key == "format" else ","}\n"{key}": {_json(value)}')
    file.write(',\n"seconds": ')
    _write_column(file, report.seconds, 3)
    file.write(',\n"tracks": [')
    done = {one.track: one for one in report.outcomes}
    for place, track in enumerate(report.tracks):
        file.write(",\n" if place else "\n")
        _write_rows(file, _track(track), done.get(track.number, NO_OUTCOME), report.seconds)
    file.write('],\n"bystanders": ')
    _write_rows(file, {}, done.get(BYSTANDERS, NO_OUTCOME), report.seconds)
    file.write("\n}\n")


def _head(report: FileReport) -> dict[str, Any]:
    return {
        "format": REPORT_FORMAT,
        "version": REPORT_VERSION,
        "run": {**_run(), "wall_seconds": round(report.wall_seconds, 3)},
        "input": report.input,
        "output": report.output,
        "sha256": report.digest,
        "outcome": outcome(report),
        "sentence": verdict(report),
        "frames": report.frames,
        "width": report.width,
        "height": report.height,
        "counts": report.counts,
        "settings": report.settings,
        "problems": report.problems,
        "audit": [
            {
                **vars(finding),
                "seconds": round(float(report.seconds[finding.frame]), 3),
                "score": round(finding.score, 3),
            }
            for finding in report.audit
        ],
        "searched": report.searched,
        "attackers": {"people": PEOPLE, **vars(REACHES[report.settings.get("region", "face")])},
        "done": DONE,
        "reasons": REASONS,
        "covers": [vars(one) | {"seconds": _seconds(report, one.first, one.last)} for one in report.covers],
        "not_verified": unverified(report).tolist(),
    }


def _seconds(report: FileReport, *frames: int) -> list[float]:
    return [round(float(report.seconds[frame]), 3) for frame in frames]


def _run() -> dict[str, Any]:
    return {"guise": VERSION, "created": datetime.now(UTC).isoformat(timespec="seconds")}


def _track(track: Track) -> dict[str, Any]:
    """What is reported of a track; not the user's name for the person, because reports are shared."""
    return {
        "track": track.number,
        "person": track.person,
        "action": track.action,
        "proposed": track.proposed,
        "reason": track.reason,
        "donor": bare(track.donor),
        "seen": track.seen,
        "width": round(track.width, 1),
    }


def _write_rows(file: TextIO, head: dict[str, Any], one: TrackOutcome, seconds: NDArray[np.float64]) -> None:
    """An object with the values of `head`, what was done in spans, and a row for each frame in columns."""
    timed = [
        {**vars(span), "seconds": [round(float(seconds[f]), 3) for f in (span.first, span.last)]}
        for span in spans(one)
    ]
    text = _json({**head, "counts": one.counts, "spans": timed})
    file.write(text[:-1] + ',\n "rows": {')
    for place, (name, values, digits) in enumerate(_columns(one)):
        file.write(f'{"," if place else ""}\n  "{name}": ')
        _write_column(file, values, digits)
    file.write("}}")


def _columns(one: TrackOutcome) -> Iterator[tuple[str, NDArray[Any], int]]:
    yield "frame", one.frames, 0
    yield "done", one.done, 0
    yield "reason", one.reasons, 0
    yield "confidence", one.confidence, 2
    for k, name in enumerate(("x0", "y0", "x1", "y1")):
        yield name, one.boxes[:, k], 0


def _write_column(file: TextIO, values: NDArray[Any], digits: int) -> None:
    """A list of numbers, whole ones when digits is 0."""
    kind = np.float64 if digits else np.int64
    file.write("[")
    for start in range(0, len(values), NUMBERS_PER_WRITE):
        piece = np.round(values[start : start + NUMBERS_PER_WRITE].astype(kind), digits).tolist()
        file.write(("," if start else "") + ",".join(map(repr, piece)))
    file.write("]")


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


NO_OUTCOME = TrackOutcome(
    BYSTANDERS,
    np.zeros(0, np.int32),
    np.zeros(0, np.uint8),
    np.zeros(0, np.float32),
    np.zeros(0, np.uint8),
    np.zeros((0, 4), np.int32),
)
