"""The page of a report is one safe file that says what was done, and what is not hidden."""

import base64
import hashlib
import re
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np
import pytest
from deidentify_reports import (
    HOSTILE,
    SECRET,
    STILL,
    entries_of,
    long_report,
    outcome_of,
    report_of,
    three_faces,
)
from hypothesis import given
from hypothesis import strategies as st

from guise.app.deidentify.report.page import LIMITS, write_batch_page, write_page
from guise.app.deidentify.report.report import (
    BatchEntry,
    verdict,
    write_report,
)
from guise.app.deidentify.report.timeline import MAX_COLUMNS, columns
from guise.app.deidentify.tracks import BYSTANDERS, FileReport

VOID = frozenset({"meta", "link", "img", "br"})
RED = np.full((90, 60, 3), (250, 10, 10), np.uint8)


@pytest.fixture
def report() -> FileReport:
    return three_faces()


class Page(HTMLParser):
    """A page taken apart: (tag, attributes) in order, text by tag; fails on an element that is not closed."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.texts: list[tuple[str, str]] = []
        self._open: list[str] = []
        self.feed(self.source)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {key: value or "" for key, value in attrs}))
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self._open[-1] if self._open else "", data))

    def all(self, tag: str, class_: str | None = None) -> list[dict[str, str]]:
        return [a for t, a in self.elements if t == tag and class_ in (None, a.get("class"))]

    def text(self, tag: str | None = None) -> str:
        return "".join(data for t, data in self.texts if tag in (None, t) and t not in ("style", "script"))


def page_of(path: Path, report: FileReport, thumbnails: dict[int, list[np.ndarray]] | None = None) -> Page:
    write_page(path, report, thumbnails or {})
    return Page(path)


def batch(path: Path, *entries: BatchEntry) -> Page:
    write_batch_page(path, entries)
    return Page(path)


@pytest.fixture
def pages(tmp_path: Path, report: FileReport) -> Iterator[Page]:
    """A page of a file and one of a batch, whose names try to be HTML."""
    report = replace(
        report, input=HOSTILE, output=HOSTILE, problems=(HOSTILE,), settings={"donor": HOSTILE, "audio": "drop"},
        tracks=tuple(replace(t, reason=HOSTILE, donor=HOSTILE, proposed="swap") for t in report.tracks),
    )  # fmt: skip
    entries = [BatchEntry(HOSTILE, HOSTILE, 0, HOSTILE, {}), BatchEntry(HOSTILE, None, 2, HOSTILE, {})]
    return iter([page_of(tmp_path / "a.html", report, {1: [RED]}), batch(tmp_path / "b.html", *entries)])


def test_hostile_names_are_text(pages: Iterator[Page]) -> None:
    for page in pages:
        assert len(page.all("script")) <= 1
        assert not any(key.startswith("on") for _, attributes in page.elements for key in attributes)
        assert r"""'><script>alert(1)</script>\u202e\n</style>\udcff&amp;.mp4""" in page.text()
        assert "\u202e" not in page.source


def test_nothing_is_asked_from_anywhere(pages: Iterator[Page]) -> None:
    for page in pages:
        fetched = [
            a[key]
            for _, a in page.elements
            for key in ("src", "srcset", "data", "action", "poster")
            if key in a
        ]
        linked = [a["href"] for a in page.all("link")]
        assert all(place.startswith("data:") for place in fetched + linked)
        assert not re.search(r"url\((?!#)|@import|https?:|fetch\(|XMLHttp|\beval\b", page.source)


def test_the_policy_lets_in_this_style_and_script_alone(pages: Iterator[Page]) -> None:
    for page in pages:
        policy = next(
            a["content"] for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy"
        )
        assert policy.startswith("default-src 'none'; img-src data:; ")
        for kind in ("style", "script"):
            inside = "".join(data for tag, data in page.texts if tag == kind)
            digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
            assert f"{kind}-src 'sha256-{digest}';" in policy
        assert not any("style" in attributes for _, attributes in page.elements), "the policy forbids these"


def test_headings_do_not_skip_a_level_and_names_are_unique(pages: Iterator[Page]) -> None:
    for page in pages:
        levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h\d", tag)]
        assert levels[0] == 1
        assert levels.count(1) == 1
        assert max(np.diff(levels)) <= 1
        named = [a["id"] for _, a in page.elements if "id" in a]
        assert len(set(named)) == len(named) > 0
        assert set(re.findall(r"url\(#(\w+)\)", page.source)) <= set(named)
        assert all("scope" in a for a in page.all("th"))
        assert all(a.get("aria-label") for a in page.all("svg") if a.get("role") == "img")


@pytest.mark.parametrize(
    ("done", "audit", "words"),
    [
        ([0] * 40, (), "Every face that was found is swapped, covered, or left as you chose"),
        ([1], (), "Some frames are not verified: watch them"),
        ([0], (STILL,), "A face may be visible"),
    ],
)
def test_the_headline_is_the_outcome(tmp_path: Path, done: list[int], audit: Any, words: str) -> None:
    report = report_of(outcome_of(1, done), audit=audit)
    page = page_of(tmp_path / "p.html", report)
    headline = next(text for tag, text in page.texts if tag == "strong")
    assert headline.endswith(words)
    assert verdict(report) in page.text("p")


def test_thumbnails_are_in_the_page(tmp_path: Path, report: FileReport) -> None:
    page = page_of(tmp_path / "p.html", report, {1: [RED, np.tile(RED, (9, 9, 1))], BYSTANDERS: [RED]})
    images = page.all("img")
    assert [a["alt"] for a in images] == [
        "Track 1 in the output, picture 1 of 2",
        "Track 1 in the output, picture 2 of 2",
        "Bystanders in the output, picture 1 of 1",
    ]
    for image, size in zip(images, [(90, 60), (160, 107), (90, 60)], strict=True):
        data = base64.b64decode(image["src"].removeprefix("data:image/jpeg;base64,"))
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        assert picture.shape[:2] == size
        np.testing.assert_allclose(picture.mean((0, 1)), (250, 10, 10), atol=6)


def test_the_page_names_the_file_its_digest_and_problems_but_no_folder_or_person(
    tmp_path: Path, report: FileReport
) -> None:
    tracks = tuple(replace(track, donor=SECRET) for track in report.tracks)
    page = page_of(tmp_path / "p.html", replace(report, tracks=tracks))
    for word in (
        "out.mp4",
        "in.mp4",
        "0" * 64,
        "A frame was damaged.",
        "key.json",
        "covered afterwards",
        "Signature",
    ):
        assert word in page.text()
    assert page.text().count("the average of Luca and a.guise") == len(tracks)
    settings = ("mean:p01+a.guise", "b.guise", "Encode crf20", "Encode losslessno", "GL: card/SSE2")
    assert all(value in page.text() for value in settings)
    for word in ("dir/", "secret", "Ann of the user"):
        assert word not in page.source
    write_report(tmp_path / "r.json", report)
    assert "Ann of the user" not in (tmp_path / "r.json").read_text()


def test_a_timeline_says_what_was_done_in_each_frame(tmp_path: Path, report: FileReport) -> None:
    figures = page_of(tmp_path / "p.html", report).all("figure", "timeline")
    assert [figure["data-done"].strip("-") for figure in figures] == ["ccsssc", "l" * 10, "cc--c"]
    confidence = figures[0]["data-confidence"].split()
    assert [int(c) for c in confidence[3:9]] == [3, 4, 5, 6, 7, 8]


@given(st.integers(1, 3000), st.integers(0, 2999), st.integers(0, 2))
def test_parts_of_a_long_video_lose_nothing(frames: int, place: int, done: int) -> None:
    """A single frame in which a face is less hidden shows, however long the video is."""
    place = min(place, frames - 1)
    codes = np.zeros(frames, np.uint8)
    codes[place] = done
    parts = columns(outcome_of(1, codes), frames)
    count = len(parts.done)
    assert count == min(frames, MAX_COLUMNS)
    assert (parts.edges[0], parts.edges[-1]) == (0, frames)
    here = int(np.searchsorted(parts.edges, place, side="right")) - 1
    assert parts.done[here] == done
    assert int((parts.done > 0).sum()) == (done > 0)
    middle = np.arange(parts.edges[here], parts.edges[here + 1]) % 100 / 100
    assert parts.confidence[here] == pytest.approx(middle.mean(), abs=1e-6)


def test_the_page_of_a_long_video_is_small(tmp_path: Path) -> None:
    page_of(tmp_path / "p.html", long_report())
    assert (tmp_path / "p.html").stat().st_size < 500e3


def test_of_very_many_tracks_the_longest_have_cards(tmp_path: Path) -> None:
    report = report_of(*(outcome_of(n, [0] * (1 if n <= 7 else 2)) for n in range(1, LIMITS.max_tracks + 8)))
    page = page_of(tmp_path / "p.html", report)
    titles = [text for tag, text in page.texts if tag == "h3"]
    assert [title.split(":")[0] for title in titles] == [
        f"Track {n}" for n in range(8, LIMITS.max_tracks + 8)
    ]
    assert "7 shorter tracks are in the JSON report only." in page.text()


@pytest.mark.parametrize(
    ("audio", "words"), [("keep", "sound is that of the input"), ("drop", "there is no sound")]
)
def test_the_page_says_what_is_not_hidden(tmp_path: Path, report: FileReport, audio: str, words: str) -> None:
    text = page_of(tmp_path / "p.html", replace(report, settings={"audio": audio})).text("p")
    for word in ("hair", "ears", "hands", "tattoos", "gait", "the place", words):
        assert word in text


def test_the_page_of_a_batch_has_failures_first_and_links_to_reports_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    there = tmp_path / "sub" / "javascript:a #1?%.report.html"
    there.write_text("")
    page = batch(tmp_path / "all.html", *entries_of(tmp_path / "sub"))
    assert [text for tag, text in page.texts if tag == "h2"] == [
        "Frames", "Failed: 2", "Done, not verified: 1", "Done: 1",
    ]  # fmt: skip
    (link,) = page.all("a")
    assert tmp_path / unquote(link["href"]) == there
    assert not re.search(r"[:#?]", link["href"])
    text = page.text()
    assert text.index("c.mp4") < text.index("d.mp4") < text.index("b.mp4") < text.index("a.mp4")
    assert "It is empty." in text
