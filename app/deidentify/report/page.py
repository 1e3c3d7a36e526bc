"""NAME.report.html: the report as a page to read, print and sign; and the page of a batch.

A page is one file that requests nothing from anywhere.  It may be shared: it shows the output, never the input.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

import cv2

from guise.app.deidentify.reach import reach_of
from guise.app.deidentify.report.html import data_uri, render_page
from guise.app.deidentify.report.report import (
    FAILED,
    KINDS,
    NO_OUTCOME,
    NOT_VERIFIED,
    VERIFIED,
    BatchEntry,
    Span,
    clock,
    kind,
    outcome,
    spans,
    verdict,
)
from guise.app.deidentify.report.timeline import LABELS, SCALE, Timeline, column_times
from guise.app.deidentify.tracks import BYSTANDERS, FileReport, Track, TrackOutcome
from guise.app.media.pictures import Picture, shrunk
from guise.app.swapping.donors import bare, titled
from guise.app.swapping.policy import DONE
from guise.common.files import fitting_name, write_whole
from guise.common.text import counted, printable
from guise.common.version import VERSION


@dataclass(frozen=True)
class PageLimits:
    """How much a page shows; the JSON report has the rest."""

    max_tracks: int = 150  # those that are seen longest
    max_table_rows: int = 200  # of spans or findings
    thumbnail_pixels: int = 160  # the longer side
    thumbnail_jpeg_quality: int = 75


LIMITS = PageLimits()
HEADLINES = {
    VERIFIED: ("good", "✓ Every face that was found is swapped, covered, or left as you chose"),
    NOT_VERIFIED: ("fair", "◧ Some frames are not verified: watch them"),
    FAILED: ("bad", "✕ A face may be visible"),
}
COUNTS = {
    "swapped": "every face found is swapped",
    "covered": "a face covered",
    "left": "a face left as it is, as you said",
    "without face": "no face found",
}
_CHANGED = {
    "face": "The face is changed from the forehead to the chin; the expressions are kept on purpose. A viewer may "
    "still recognise a person by hair, ears, neck, the outline and size of the head;",
    "head": "The head is changed with hair, ears and outline, as far as it is above the shoulders; the expressions are "
    "kept on purpose. A viewer may still recognise a person by the neck, by long hair below the chin, by the size of "
    "the head;",
}
_FILE_SETTINGS = {"donor", "gallery", "keyfile", "certificate", "key"}
_VOICE = {
    "keep": "the voice: the sound is that of the input",
    "mask": "the voice: it is changed, which may be undone, and its rhythm and words are the same",
    "disguise": "the voice: it is a whisper in which a simple recogniser who knows how it is made still finds some of "
    "who speaks, and its rhythm and words are the same",
    "drop": "what can be read from the lips, as there is no sound",
}


@dataclass(frozen=True)
class FrameShare:
    """Frames of one kind: what they have, their fill on the page, number and percent, and place in the bar."""

    words: str
    fill: str
    frames: int
    percent: float
    x: float
    width: float


@dataclass(frozen=True)
class TrackCard:
    """What the page shows of a track: `thumbnails` are URIs; `spans` are the first of `span_count`."""

    title: str
    done: str
    about: str
    timeline: Timeline
    thumbnails: tuple[str, ...]
    spans: tuple[Span, ...]
    span_count: int


@dataclass(frozen=True)
class FileRow:
    """A file of a batch: `link` leads to its report, "" without one; `counts` are words, "" where unknown."""

    name: str
    link: str
    sentence: str
    counts: tuple[str, ...]


def write_page(path: Path, report: FileReport, thumbnails: Mapping[int, Sequence[Picture]]) -> None:
    """Write the page of a file.

    thumbnails : pictures of the output, RGB uint8 (h, w, 3), for each track and BYSTANDERS, in the order of time.
    """
    output = PurePath(report.output).name
    tone, headline = HEADLINES[outcome(report)]
    by_track = {one.track: one for one in report.outcomes}
    page = render_page(
        "report.html",
        script="timeline.js",
        title=f"{printable(output)}: de-identification report",
        report=report,
        input=PurePath(report.input).name,
        output=output,
        length=report.seconds[-1],
        times=column_times(report),
        tone=tone,
        headline=headline,
        sentence=verdict(report),
        shares=frame_shares(report.counts),
        scale=SCALE,
        labels=LABELS,
        cards=list(_cards(report, by_track, thumbnails)),
        omitted_tracks=max(0, len(report.tracks) - LIMITS.max_tracks),
        bystanders=_bystanders(report, by_track.get(BYSTANDERS, NO_OUTCOME), thumbnails),
        covers=report.covers[: LIMITS.max_table_rows],
        findings=sorted(report.audit, key=lambda f: (f.covered, f.frame))[: LIMITS.max_table_rows],
        settings=[(name.replace("_", " ").capitalize(), value) for name, value in _flat(report.settings)],
        reach=f"In the benchmark of Guise {reach_of(report.settings.get('region', 'face'))}.",
        changed=_CHANGED[report.settings.get("region", "face")],
        voice=_VOICE[report.settings.get("audio", "keep")],
        today=_today(),
        version=VERSION,
    )
    write_whole(path, page)


def write_batch_page(path: Path, entries: Sequence[BatchEntry]) -> None:
    """Write the page of a batch: the failures first, with links to the reports of the files."""
    titles = ("Done", "Done, with faces covered", "Done, not verified", "Failed")
    kinds = {
        title: [e for e in entries if kind(e) == name]
        for name, title in reversed(list(zip(KINDS, titles, strict=True)))
    }
    summary = ", ".join(f"{title.lower()}: {len(group):,}" for title, group in kinds.items())
    page = render_page(
        "batch.html",
        title="De-identification report",
        entries=entries,
        summary=summary.capitalize(),
        shares=frame_shares({name: sum(e.counts.get(name, 0) for e in entries) for name in COUNTS}),
        scale=SCALE,
        groups={title: [_file_row(entry, path.parent) for entry in group] for title, group in kinds.items()},
        today=_today(),
        version=VERSION,
    )
    write_whole(path, page)


def frame_shares(counts: Mapping[str, int]) -> list[FrameShare]:
    """Frames by their least hidden face, side by side over the width of the bar."""
    total, x, shares = max(sum(counts.get(name, 0) for name in COUNTS), 1), 0.0, []
    for name, words in COUNTS.items():
        count = counts.get(name, 0)
        width = SCALE.width * count / total
        fill = name if name in DONE else "ground"
        shares.append(FrameShare(words, fill, count, 100 * count / total, round(x, 2), round(width, 2)))
        x += width
    return shares


# -- tracks ---------------------------------------------------------------------------------------------------


def _cards(
    report: FileReport, by_track: Mapping[int, TrackOutcome], thumbnails: Mapping[int, Sequence[Picture]]
) -> Iterator[TrackCard]:
    longest = sorted(report.tracks, key=lambda t: -t.seen)[: LIMITS.max_tracks]
    for track in sorted(longest, key=lambda t: t.number):
        one, pictures = by_track.get(track.number, NO_OUTCOME), thumbnails.get(track.number, ())
        yield _card(f"Track {track.number}", _about(track, report), one, report, pictures)


def _about(track: Track, report: FileReport) -> str:
    first, last = (clock(float(report.seconds[frame])) for frame in (track.first, track.last))
    seen = f"{first} to {last}, seen in {track.seen:,} frames, {track.width:.0f} pixels wide"
    donor = f", with the face of {printable(titled(track.donor))}" if track.donor else ""
    why = f", because {printable(track.reason)}" if track.reason and track.action == track.proposed else ""
    return f"Person {track.person}, {seen}. Action: {track.action}{donor}{why}."


def _bystanders(
    report: FileReport, one: TrackOutcome, thumbnails: Mapping[int, Sequence[Picture]]
) -> TrackCard | None:
    if not len(one.frames):
        return None
    about = "Faces that were too small, too brief or too unclear to track, or that the audit found, and boxes of yours."
    if one.counts["left"]:
        about += " What you refused is left."
    return _card("Bystanders", about, one, report, thumbnails.get(BYSTANDERS, ()))


def _card(
    title: str, about: str, one: TrackOutcome, report: FileReport, thumbnails: Sequence[Picture]
) -> TrackCard:  # fmt: skip
    done = ", ".join(f"{LABELS[name]} in {counted(n, 'frame')}" for name, n in one.counts.items() if n)
    runs = spans(one)
    return TrackCard(
        title, done, about, Timeline.of(one, report, f"{title} over the video: {done}"),
        tuple(map(_jpeg, thumbnails)), tuple(runs[: LIMITS.max_table_rows]), len(runs),
    )  # fmt: skip


def _jpeg(picture: Picture) -> str:
    """A picture as a URI that holds it, made smaller."""
    scale = min(1.0, LIMITS.thumbnail_pixels / max(picture.shape[:2]))
    quality = [cv2.IMWRITE_JPEG_QUALITY, LIMITS.thumbnail_jpeg_quality]
    _, data = cv2.imencode(".jpg", cv2.cvtColor(shrunk(picture, scale), cv2.COLOR_RGB2BGR), quality)
    return data_uri(data.tobytes(), "image/jpeg")


# -- settings, and files of a batch ---------------------------------------------------------------------------


def _flat(settings: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names and values to show."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from ((f"{name} {inner}", shown) for inner, shown in _flat(value))
        elif value not in (None, "", []):
            values = value if isinstance(value, list) else [value]
            yield name, ", ".join(_setting(name, v) for v in values)


def _setting(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return bare(value) if name in _FILE_SETTINGS else str(value)


def _file_row(entry: BatchEntry, folder: Path) -> FileRow:
    counts = tuple(f"{entry.counts[name]:,}" if name in entry.counts else "" for name in COUNTS)
    return FileRow(PurePath(entry.input).name, _report_link(entry, folder), entry.sentence, counts)


def _report_link(entry: BatchEntry, folder: Path) -> str:
    """Where the report of a file is, relative to a folder; "" without one."""
    if entry.output is None:
        return ""
    output = Path(entry.output)
    report = output.with_name(fitting_name(output.stem, ".report.html"))
    place = quote(os.fsencode(Path(os.path.relpath(report, folder)).as_posix()))
    return place if report.exists() else ""


def _today() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%d")
