"""NAME.report.html: the report as a page to read, print and sign; and the page of a batch.

A page is one file that asks for nothing from anywhere.  It may be shared: it shows the output alone, never the input.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any
from urllib.parse import quote

import cv2

from guise.app.deidentify.report.html import Html, data_uri, document, join, printable, tag, visible
from guise.app.deidentify.report.page_style import SCRIPT, STYLE
from guise.app.deidentify.report.report import (
    ALL_SWAPPED,
    FAILED,
    NOTHING,
    SOME_COVERED,
    BatchEntry,
    clock,
    outcome,
    spans,
    verdict,
)
from guise.app.deidentify.report.timeline import WORDS, bar, key, patterns, timeline, times
from guise.app.deidentify.tracks import BYSTANDERS, DONE, FileReport, Outcome, Track
from guise.app.media.pictures import Picture
from guise.app.swapping.donors import bare
from guise.common.files import write_whole
from guise.common.version import version

CARDS = 150  # tracks shown one by one, those that are seen longest
ROWS = 200  # of a table of spans or finds
THUMB = 160  # pixels, the longer side
QUALITY = 75  # of JPEG
HEADLINES = {
    ALL_SWAPPED: ("good", "✓ All faces swapped"),
    SOME_COVERED: ("fair", "◧ Some faces covered"),
    FAILED: ("bad", "✕ A face may be visible"),
}
COUNTS = {
    "swapped": "every face swapped",
    "covered": "a face covered",
    "left": "a face left as it is, as you said",
    "without face": "no face found",
}
FILES = {"donor", "gallery", "keyfile", "certificate", "key"}  # settings
VOICE = {
    "keep": "the voice: the sound is that of the input",
    "mask": "the voice: it is changed, which may be undone, and its rhythm and words are the same",
    "drop": "what can be read from the lips, as there is no sound",
}


def write_page(path: Path, report: FileReport, thumbnails: Mapping[int, Sequence[Picture]]) -> None:
    """Write the page of a file.

    thumbnails : pictures of the output, RGB uint8 (h, w, 3), for each track and BYSTANDERS, in the order of time.
    """
    name = PurePath(report.output).name
    body = tag(
        "main",
        tag("h1", "De-identification report"),
        tag("p", visible(name), class_="name"),
        *_headline(outcome(report), verdict(report)),
        _facts(report),
        *_counts(report.counts),
        *_tracks(report, thumbnails),
        *_audit(report),
        *_settings(report),
        *_limits(report),
        *_sign(),
        data_times=times(report),
        data_frames=report.frames,
    )
    page = document(f"{printable(name)}: de-identification report", join(patterns(), body), STYLE, SCRIPT)
    write_whole(path, page)


def write_batch_page(path: Path, entries: Sequence[BatchEntry]) -> None:
    """Write the page of a batch: the failures first, with links to the reports of the files."""
    groups = {
        "Failed": [e for e in entries if e.code not in (ALL_SWAPPED, SOME_COVERED)],
        "Done, with faces covered": [e for e in entries if e.code == SOME_COVERED],
        "Done": [e for e in entries if e.code == ALL_SWAPPED],
    }
    said = ", ".join(f"{title.lower()}: {len(group):,}" for title, group in groups.items())
    frames = {name: sum(entry.counts.get(name, 0) for entry in entries) for name in COUNTS}
    body = tag(
        "main",
        tag("h1", "De-identification report"),
        tag("p", f"{len(entries):,} file{'' if len(entries) == 1 else 's'}", class_="name"),
        tag("p", f"{said.capitalize()}. Made with Guise {version()}, {_today()}."),
        *_counts(frames),
        *(_group(title, group, path.parent) for title, group in groups.items() if group),
    )
    page = document("De-identification report", join(patterns(), body), STYLE)
    write_whole(path, page)


# -- what came out --------------------------------------------------------------------------------------------


def _headline(code: int, sentence: str) -> Iterator[Html]:
    tone, words = HEADLINES[code]
    yield tag("div", tag("strong", words), tag("p", sentence), class_=f"verdict {tone}")


def _facts(report: FileReport) -> Html:
    length = f"{clock(float(report.seconds[-1]))}, {report.frames:,} frames of {report.width} x {report.height} pixels"
    digest = tag("code", report.digest) if report.digest else None
    return _pairs(
        ("Input", visible(PurePath(report.input).name)),
        ("Output", visible(PurePath(report.output).name)),
        ("SHA-256 of the output", digest),
        ("Length", length),
        ("Made", f"{_today()}, with Guise {version()}, in {clock(report.wall_seconds)}"),
        ("Problems", join(*(tag("div", printable(p)) for p in report.problems)) if report.problems else None),
    )


def _counts(counts: Mapping[str, int]) -> Iterator[Html]:
    yield tag("h2", "Frames")
    shares = [(name, counts.get(name, 0)) for name in COUNTS]
    total = max(sum(n for _, n in shares), 1)
    said = ", ".join(f"{COUNTS[name]}: {n:,} frames" for name, n in shares)
    yield bar([(_fill(name), n) for name, n in shares], said)
    rows = [
        (join(key(_fill(name)), COUNTS[name]), f"{n:,}", f"{100 * n / total:.1f} %") for name, n in shares
    ]
    yield _table("Frames", ("Frames with", "Number", "Share"), (None, "number", "number"), rows)
    yield tag("p", "Each frame counts once, by its least hidden face.", class_="dim")


def _fill(name: str) -> str:
    return name if name in DONE else "ground"


# -- tracks ---------------------------------------------------------------------------------------------------


def _tracks(report: FileReport, thumbnails: Mapping[int, Sequence[Picture]]) -> Iterator[Html]:
    yield tag("h2", "Faces")
    yield tag("ul", *(tag("li", key(done), WORDS[done]) for done in DONE), class_="legend")
    hint = (
        "Above: what was done; below: confidence. Point at a timeline, or move along it with the arrow keys."
    )
    yield tag("p", hint, class_="dim hint")
    done = {one.track: one for one in report.outcomes}
    longest = sorted(report.tracks, key=lambda t: -t.seen)[:CARDS]
    for track in sorted(longest, key=lambda t: t.number):
        one = done.get(track.number, NOTHING)
        yield _card(
            f"Track {track.number}", _about(track, report), one, report, thumbnails.get(track.number, ())
        )
    if len(report.tracks) > CARDS:
        yield tag("p", f"{len(report.tracks) - CARDS:,} shorter tracks are in the JSON report only.")
    if not report.tracks:
        yield tag("p", "No face was followed.")
    if others := len(done.get(BYSTANDERS, NOTHING).frames):
        about = f"{others:,} sights of faces too small, too brief or too unclear to follow; covered wherever they were."
        yield _card("Bystanders", about, done[BYSTANDERS], report, thumbnails.get(BYSTANDERS, ()))


def _about(track: Track, report: FileReport) -> str:
    first, last = (clock(float(report.seconds[frame])) for frame in (track.first, track.last))
    seen = f"{first} to {last}, seen in {track.seen:,} frames, {track.width:.0f} pixels wide"
    donor = f", with the face of {printable(bare(track.donor))}" if track.donor else ""
    why = f", because {printable(track.reason)}" if track.reason and track.action == track.proposed else ""
    return f"Person {track.person}, {seen}. To do: {track.action}{donor}{why}."


def _card(
    title: str, about: str, one: Outcome, report: FileReport, thumbnails: Sequence[Picture]
) -> Html:  # fmt: skip
    counts = [(done, int((one.done == code).sum())) for code, done in enumerate(DONE)]
    done = ", ".join(f"{WORDS[name]} {n:,} times" for name, n in counts if n)
    return tag(
        "section",
        tag("h3", title, ": " if done else None, done),
        tag("p", about, class_="facts"),
        timeline(one, report, f"{title} over the video: {done}"),
        _thumbs(title, thumbnails),
        _spans(one, report),
        class_="card",
    )


def _thumbs(title: str, thumbnails: Sequence[Picture]) -> Html | None:
    items = (
        tag(
            "li",
            tag("img", src=_jpeg(picture), alt=f"{title} in the output, picture {n} of {len(thumbnails)}"),
        )
        for n, picture in enumerate(thumbnails, 1)
    )
    return tag("ul", *items, class_="thumbs") if thumbnails else None


def _jpeg(picture: Picture) -> str:
    scale = min(1.0, THUMB / max(picture.shape[:2]))
    size = [max(1, round(side * scale)) for side in picture.shape[1::-1]]
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(
        ".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
    )
    return data_uri(data.tobytes(), "image/jpeg")


def _spans(one: Outcome, report: FileReport) -> Html | None:
    runs = spans(one)
    rows = [
        (
            WORDS[run.done],
            *(clock(float(report.seconds[f])) for f in (run.first, run.last)),
            run.first,
            run.last,
        )
        for run in runs
    ]
    if not rows:
        return None
    head = ("What", "From", "To", "First frame", "Last frame")
    title = f"{len(rows):,} span{'' if len(rows) == 1 else 's'} of frames"
    shown, more = _most(rows)
    return tag("details", tag("summary", title), _table(title, head, (None, *["number"] * 4), shown), more)


# -- the rest -------------------------------------------------------------------------------------------------


def _audit(report: FileReport) -> Iterator[Html]:
    yield tag("h2", "A last look at the output")
    if not report.audit:
        yield tag(
            "p", "The finished video was searched once more. No face was found that should not be there."
        )
        return
    yield tag(
        "p", "The finished video was searched once more. Where a face was found that should not be there:"
    )
    rows = [
        (
            find.frame, clock(float(report.seconds[find.frame])), ", ".join(map(str, find.box)), f"{find.score:.2f}",
            "covered then" if find.covered else tag("strong", "may be visible", class_="bad"),
        )
        for find in sorted(report.audit, key=lambda f: (f.covered, f.frame))
    ]  # fmt: skip
    shown, more = _most(rows)
    yield _table("Finds", ("Frame", "Time", "Box, pixels", "Score", "What was done"), (None,) * 5, shown)
    yield more or join()


def _settings(report: FileReport) -> Iterator[Html]:
    yield tag("h2", "Settings")
    yield _pairs(*((name.replace("_", " ").capitalize(), value) for name, value in _flat(report.settings)))


def _flat(settings: Mapping[str, Any]) -> Iterator[tuple[str, Html]]:
    """Names and values to show."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from ((f"{name} {inner}", shown) for inner, shown in _flat(value))
        elif value not in (None, "", []):
            values = value if isinstance(value, list) else [value]
            yield name, visible(", ".join(_setting(name, v) for v in values))


def _setting(name: str, value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return bare(value) if name in FILES else str(value)


def _limits(report: FileReport) -> Iterator[Html]:
    yield tag("h2", "What this does not hide")
    voice = VOICE[report.settings.get("audio", "keep")]
    yield tag(
        "p",
        "The face is changed from the forehead to the chin; the expressions are kept on purpose. A viewer may still "
        "recognise a person by hair, ears, neck, the outline and size of the head; by body, hands, clothes, jewellery "
        f"and tattoos; by {voice}; by what is said and how, gestures, gait and the way the head moves; by the place, "
        "other people, reflections and text in the picture; and by the name of the file. The report counts what the "
        "detector found: a face that it never found is in no count. Watch the output before it is shared.",
    )


def _sign() -> Iterator[Html]:
    yield tag("h2", "Release")
    yield tag("p", "I have watched the output from beginning to end and release it.")
    yield tag("div", *(tag("p", line) for line in ("Name", "Date", "Signature")), class_="sign")


# -- a batch --------------------------------------------------------------------------------------------------


def _group(title: str, entries: Sequence[BatchEntry], folder: Path) -> Html:
    head = ("File", "What happened", "Swapped", "Covered", "Left", "No face")
    rows = [
        (
            _linked(entry, folder), printable(entry.sentence),
            *(f"{entry.counts[name]:,}" if name in entry.counts else "" for name in COUNTS),
        )
        for entry in entries
    ]  # fmt: skip
    words = f"{title}: {len(entries):,}"
    return join(tag("h2", words), _table(words, head, ("text", "text", *["number"] * 4), rows))


def _linked(entry: BatchEntry, folder: Path) -> Html:
    """The file's name, with a link to its report if there is one."""
    name = visible(PurePath(entry.input).name)
    if entry.output is None:
        return name
    output = Path(entry.output)
    report = output.with_name(output.stem + ".report.html")
    place = quote(os.fsencode(Path(os.path.relpath(report, folder)).as_posix()))
    return tag("a", name, href=place) if report.exists() else name


# -- pieces ---------------------------------------------------------------------------------------------------


def _pairs(*pairs: tuple[str, Html | str | None]) -> Html:
    return tag("dl", *(join(tag("dt", k), tag("dd", v)) for k, v in pairs if v is not None))


def _table(
    label: str, head: Sequence[str], kinds: Sequence[str | None], rows: Sequence[Sequence[object]]
) -> Html:  # fmt: skip
    """A table that can be moved aside where it is too wide.   label : what it is.   kinds : of the columns' cells."""
    titles = (tag("th", title, scope="col", class_=kind) for title, kind in zip(head, kinds, strict=True))
    body = (
        tag("tr", *(tag("td", cell, class_=k) for cell, k in zip(row, kinds, strict=True))) for row in rows
    )
    table = tag("table", tag("thead", tag("tr", *titles)), tag("tbody", *body))
    return tag("div", table, class_="scroll", tabindex=0, role="group", aria_label=label)


def _most(rows: Sequence[Sequence[object]]) -> tuple[Sequence[Sequence[object]], Html | None]:
    """The first ROWS, and where the others are."""
    more = f"{len(rows) - ROWS:,} more are in the JSON report."
    return rows[:ROWS], tag("p", more, class_="dim") if len(rows) > ROWS else None


def _today() -> str:
    return datetime.now(UTC).strftime("%Y-%m-%d")
