"""The reports say what was done, all of it and no more; the page is one safe file; the docs name every field."""

import base64
import hashlib
import json
import re
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.deidentify.report.page import LIMITS, write_batch_page, write_page
from guise.app.deidentify.report.report import (
    BatchEntry,
    frames_with,
    outcome,
    spans,
    verdict,
    write_batch,
    write_report,
)
from guise.app.deidentify.report.timeline import MAX_COLUMNS, columns
from guise.app.deidentify.tracks import BYSTANDERS, AuditFinding, FileReport, Track, TrackOutcome
from guise.app.swapping.decide import DONE

ROOT = Path(__file__).parents[1]
SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))
SWAPPED, COVERED, LEFT = range(3)
VOID = frozenset({"meta", "link", "img", "br"})
HOSTILE = "\"'><script>alert(1)</script>\u202e\n</style>\udcff&amp;.mp4"
SECRET = "mean:p01+/secret/a.guise"
RED = np.full((90, 60, 3), (250, 10, 10), np.uint8)


def outcome_of(track: int, done: Any, first: int = 0, frames: Any = None) -> TrackOutcome:
    """An outcome with these codes in consecutive frames, or in these."""
    done = np.asarray(done, np.uint8)
    place = np.arange(first, first + len(done)) if frames is None else np.asarray(frames)
    boxes = np.stack([place, place + 1, place + 50, place + 60], axis=1).reshape(-1, 4)
    confidence = (place % 100 / 100).astype(np.float32)
    return TrackOutcome(track, place.astype(np.int32), done, confidence, boxes.astype(np.int32))


def report_of(*outcomes: TrackOutcome, frames: int = 40, **more: Any) -> FileReport:
    """A report of 25 frames a second with a track for each outcome."""
    tracks = tuple(
        Track(
            one.track, one.track, int(one.frames[0]), int(one.frames[-1]), len(one.frames), 80.0, (0.5,), "swap",
            action="swap", donor="f3", name="Ann of the user",
        )
        for one in outcomes if one.track != BYSTANDERS
    )  # fmt: skip
    worst = np.full(frames, -1)
    for one in outcomes:
        np.maximum.at(worst, one.frames, one.done.astype(int))
    names = ("without face", *DONE)
    counts = {name: int((worst == rank).sum()) for rank, name in enumerate(names, start=-1)}
    return replace(
        FileReport(
            "dir/in.mp4",
            "dir/out.mp4",
            frames,
            np.arange(frames) / 25,
            640,
            360,
            tracks,
            outcomes,
            (),
            counts,
        ),
        **more,
    )


@pytest.fixture
def report() -> FileReport:
    """Two tracks and bystanders, of which two are in one frame."""
    return report_of(
        outcome_of(1, [1, 1, 0, 0, 0, 1], first=3),
        outcome_of(2, [2] * 10, first=20),
        outcome_of(BYSTANDERS, [1] * 4, frames=[5, 5, 6, 9]),
        audit=(AuditFinding(31, (1, 2, 30, 40), 0.75, True),),
        settings={
            "donor": SECRET,
            "audio": "keep",
            "keyfile": "/secret/place/key.json",
            "gallery": ["/secret/b.guise"],
            "encode": {"crf": 20, "lossless": False},
            "renderer": "GL: card/SSE2",
        },
        problems=("A frame was damaged.",),
        wall_seconds=2.5,
        digest="0" * 64,
    )


def long_report() -> FileReport:
    """Half an hour at 30 frames a second with three tracks that change every fourth second."""
    frames = 54_000
    done = np.arange(frames) // 100 % 2
    return report_of(*(outcome_of(n, done) for n in (1, 2, 3)), frames=frames)


def loaded(path: Path, report: FileReport) -> dict[str, Any]:
    write_report(path, report)
    value: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(SCHEMA).validate(value)
    return value


# -- NAME.report.json -----------------------------------------------------------------------------------------


def test_the_schema_is_a_schema_and_refuses_what_is_none(tmp_path: Path, report: FileReport) -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    value = loaded(tmp_path / "r.json", report)
    value["tracks"][0]["rows"]["confidence"][0] = 1.5
    with pytest.raises(jsonschema.ValidationError, match="maximum"):
        jsonschema.Draft202012Validator(SCHEMA).validate(value)


def test_every_row_of_every_face_is_written(tmp_path: Path, report: FileReport) -> None:
    value = loaded(tmp_path / "r.json", report)
    for entry, one in zip([*value["tracks"], value["bystanders"]], report.outcomes, strict=True):
        rows = entry["rows"]
        assert rows["frame"] == one.frames.tolist()
        assert rows["done"] == one.done.tolist()
        np.testing.assert_allclose(rows["confidence"], one.confidence, atol=0.005)
        np.testing.assert_array_equal(np.transpose([rows[k] for k in ("x0", "y0", "x1", "y1")]), one.boxes)
        assert entry["counts"] == {name: rows["done"].count(code) for code, name in enumerate(DONE)}


def test_the_report_says_what_is_known_of_the_file(tmp_path: Path, report: FileReport) -> None:
    value = loaded(tmp_path / "r.json", report)
    same = ("input", "output", "frames", "width", "height", "counts", "settings")
    assert {key: value[key] for key in same} == {key: getattr(report, key) for key in same}
    assert value["seconds"] == report.seconds.tolist()
    assert (value["outcome"], value["sentence"]) == (3, verdict(report))
    assert value["audit"] == [
        {"frame": 31, "seconds": 1.24, "box": [1, 2, 30, 40], "score": 0.75, "covered": True}
    ]
    assert value["problems"] == ["A frame was damaged."]
    assert value["tracks"][0]["spans"][1] == {
        "first": 5,
        "last": 7,
        "done": "swapped",
        "seconds": [0.2, 0.28],
    }


def test_two_reports_of_one_run_differ_in_the_run_only(tmp_path: Path, report: FileReport) -> None:
    one, other = (loaded(tmp_path / "r.json", replace(report, wall_seconds=s)) for s in (1.0, 9.0))
    assert one.pop("run") != other.pop("run")
    assert one == other


def test_names_that_are_no_unicode_are_written(tmp_path: Path, report: FileReport) -> None:
    assert loaded(tmp_path / "r.json", replace(report, input=HOSTILE))["input"] == HOSTILE


def test_a_long_report_is_small(tmp_path: Path) -> None:
    write_report(tmp_path / "r.json", long_report())
    assert (tmp_path / "r.json").stat().st_size < 10e6
    assert len(json.loads((tmp_path / "r.json").read_text())["tracks"][2]["rows"]["x1"]) == 54_000


def test_a_report_is_written_piece_by_piece(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("guise.app.deidentify.report.report.NUMBERS_PER_WRITE", 100)
    report = report_of(outcome_of(1, [0] * 8000), frames=8000)
    write_report(tmp_path / "r.json", report)  # what is remembered from the first time does not count
    tracemalloc.start()
    write_report(tmp_path / "r.json", report)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < (tmp_path / "r.json").stat().st_size
    assert json.loads((tmp_path / "r.json").read_text())["tracks"][0]["rows"]["frame"] == list(range(8000))


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 2)), max_size=40))
def test_spans_say_for_each_frame_the_least_hidden_face(pairs: list[tuple[int, int]]) -> None:
    pairs.sort(key=lambda p: p[0])
    one = outcome_of(BYSTANDERS, [d for _, d in pairs], frames=np.array([f for f, _ in pairs], int))
    found = spans(one)
    said = {f: span.done for span in found for f in range(span.first, span.last + 1)}
    assert said == {f: DONE[max(d for g, d in pairs if g == f)] for f, _ in pairs}
    assert sum(span.last - span.first + 1 for span in found) == len(said)
    joined = pairwise(found)
    assert all(a.last + 1 < b.first or a.done != b.done for a, b in joined), "spans are as long as can be"


# -- the outcome ----------------------------------------------------------------------------------------------

FOUND, STILL = AuditFinding(2, (0, 0, 9, 9), 0.9, True), AuditFinding(4, (0, 0, 9, 9), 0.9, False)
UNVERIFIED = "In 1 frame after a face none was found: not verified."
OUTCOMES = [
    ([], (), 0, "No face was found in 40 frames."),
    ([0] * 40, (), 0, "The faces that were found are swapped, in 40 frames."),
    ([0] * 39, (), 3, "The faces that were found are swapped, in 39 frames. " + UNVERIFIED),
    (
        [0] * 39 + [2],
        (),
        0,
        "The faces that were found are swapped, in 39 frames. A face is left as it is in 1 frame, as you said.",
    ),
    ([2] * 40, (), 0, "No face is changed. A face is left as it is in 40 frames, as you said."),
    (
        [0] * 38 + [1],
        (),
        3,
        "The faces that were found are swapped or covered; a covered one is in 1 frame. " + UNVERIFIED,
    ),
    (
        [0] * 40,
        (FOUND,),
        3,
        "The faces that were found are swapped or covered; a covered one is in 1 frame.",
    ),
    (
        [0] * 5,
        (FOUND, STILL),
        1,
        "A face may be visible in the output, first in frame 4 (0:00.2): do not share it.",
    ),
    ([1], (STILL,), 1, "A face may be visible in the output, first in frame 4 (0:00.2): do not share it."),
]


@pytest.mark.parametrize(("done", "audit", "code", "sentence"), OUTCOMES)
def test_the_exit_code_and_the_sentence(done: list[int], audit: Any, code: int, sentence: str) -> None:
    report = report_of(*([outcome_of(1, done)] if done else []), audit=audit)
    assert (outcome(report), verdict(report)) == (code, sentence)


def test_frames_before_the_first_face_need_no_verification() -> None:
    assert outcome(report_of(outcome_of(1, [0] * 5, first=35))) == 0


def test_a_cover_beside_a_face_that_is_left_counts() -> None:
    """The frame counts as left; a face of it is covered all the same."""
    report = report_of(outcome_of(1, [2] * 5), outcome_of(2, [1] * 5), frames=5)
    assert report.counts["covered"] == 0
    assert frames_with(report, "covered").tolist() == [0, 1, 2, 3, 4]
    assert outcome(report) == 3


# -- the page -------------------------------------------------------------------------------------------------


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
        ([0] * 40, (), "All faces that were found are swapped"),
        ([1], (), "Faces covered, or frames not verified"),
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


# -- a batch --------------------------------------------------------------------------------------------------


def entries_of(folder: Path) -> list[BatchEntry]:
    counts = {"swapped": 5, "covered": 0, "left": 0, "without face": 1}
    return [
        BatchEntry("a.mp4", str(folder / "javascript:a #1?%.mp4"), 0, "Good.", counts),
        BatchEntry("b.mp4", str(folder / "b.mp4"), 3, "Covered.", counts | {"covered": 2}),
        BatchEntry("c.mp4", None, 2, "It is empty.", {}),
        BatchEntry("d.mp4", None, 130, "Interrupted.", {}),
    ]


def test_the_page_of_a_batch_has_failures_first_and_links_to_reports_that_are_there(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    there = tmp_path / "sub" / "javascript:a #1?%.report.html"
    there.write_text("")
    page = batch(tmp_path / "all.html", *entries_of(tmp_path / "sub"))
    assert [text for tag, text in page.texts if tag == "h2"] == [
        "Frames", "Failed: 2", "Done, with faces covered: 1", "Done: 1",
    ]  # fmt: skip
    (link,) = page.all("a")
    assert tmp_path / unquote(link["href"]) == there
    assert not re.search(r"[:#?]", link["href"])
    text = page.text()
    assert text.index("c.mp4") < text.index("d.mp4") < text.index("b.mp4") < text.index("a.mp4")
    assert "It is empty." in text


def test_the_json_of_a_batch(tmp_path: Path) -> None:
    write_batch(tmp_path / "b.json", entries_of(tmp_path))
    value = json.loads((tmp_path / "b.json").read_text())
    assert (value["format"], value["version"]) == ("guise-batch-report", 1)
    assert [value[key] for key in ("files", "all_swapped", "some_covered", "failed")] == [4, 1, 1, 2]
    assert [BatchEntry(**entry) for entry in value["entries"]] == entries_of(tmp_path)


# -- docs -----------------------------------------------------------------------------------------------------


def fields(schema: Any) -> Iterator[str]:
    """Names of all properties anywhere in a schema."""
    if isinstance(schema, dict):
        yield from schema.get("properties", {})
        for value in schema.values():
            yield from fields(value)


def test_the_docs_name_every_field_and_no_other(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "deidentify-report.md").read_text(encoding="utf-8")
    quoted = set(re.findall(r"`([^`\n]+)`", text))
    assert set(fields(SCHEMA)) <= quoted
    for heading, known in (
        ("## The fields of NAME.report.json", SCHEMA["properties"]),
        ("Of each track:", None),
    ):
        table = text.split(heading)[1].split("\n\n| field")[1].split("\n\n")[0]
        named = {name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
        assert named == set(known or SCHEMA["properties"]["tracks"]["items"]["properties"])
    write_batch(tmp_path / "b.json", entries_of(tmp_path))
    value = json.loads((tmp_path / "b.json").read_text())
    assert {*value, *value["entries"][0]} <= quoted


def test_every_field_of_the_schema_is_described() -> None:
    def undescribed(schema: Any) -> Iterator[str]:
        if isinstance(schema, dict):
            for name, value in schema.get("properties", {}).items():
                known = (
                    value
                    if "$ref" not in value
                    else {**SCHEMA["$defs"][value["$ref"].split("/")[-1]], **value}
                )
                if "description" not in known:
                    yield name
            for value in schema.values():
                yield from undescribed(value)

    assert set(undescribed(SCHEMA)) <= set(DONE), "the words of `faces` speak for themselves"
