"""The reports say what was done, all of it and no more; the docs name every field."""

import json
import re
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from deidentify_reports import (
    FOUND,
    HOSTILE,
    STILL,
    entries_of,
    long_report,
    outcome_of,
    report_of,
    three_faces,
)
from hypothesis import given
from hypothesis import strategies as st

from guise.app.deidentify.report.report import (
    KINDS,
    BatchEntry,
    frames_with,
    outcome,
    spans,
    times,
    verdict,
    write_batch,
    write_report,
)
from guise.app.deidentify.tracks import BYSTANDERS, FileReport
from guise.app.swapping.policy import DONE

ROOT = Path(__file__).parents[1]
SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))


@pytest.fixture
def report() -> FileReport:
    return three_faces()


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
        pairs = set(zip(rows["frame"], rows["done"], strict=True))
        assert entry["counts"] == {name: [d for _, d in pairs].count(k) for k, name in enumerate(DONE)}


def test_the_report_says_what_is_known_of_the_file(tmp_path: Path, report: FileReport) -> None:
    value = loaded(tmp_path / "r.json", report)
    same = ("input", "output", "frames", "width", "height", "counts", "settings")
    assert {key: value[key] for key in same} == {key: getattr(report, key) for key in same}
    assert value["seconds"] == report.seconds.tolist()
    assert (value["outcome"], value["sentence"]) == (3, verdict(report))
    assert value["not_verified"] == [10, 11, 12, 13, 14, 15, 16, 17, 18, 19, *range(30, 40)]
    assert value["covers"] == [
        vars(one) | {"box": [1, 2, 3, 4], "seconds": [one.first / 25, one.last / 25]} for one in report.covers
    ]
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

UNVERIFIED = "In 1 frame after a face none was found: not verified. Watch 0:01.6."
OUTCOMES = [
    ([], (), 0, "No face was found in 40 frames."),
    ([0] * 40, (), 0, "The faces that were found are swapped in 40 frames."),
    ([0] * 39, (), 3, "The faces that were found are swapped in 39 frames. " + UNVERIFIED),
    (
        [0] * 39 + [2],
        (),
        0,
        "The faces that were found are swapped in 39 frames. A face is left as it is in 1 frame, as you said.",
    ),
    ([2] * 40, (), 0, "No face is changed. A face is left as it is in 40 frames, as you said."),
    ([1] * 40, (), 0, "The faces that were found are covered in 40 frames. Covers: 0:00.0 to 0:01.6."),
    (
        [0] * 38 + [1],
        (),
        3,
        "The faces that were found are swapped in 38 frames and covered in 1 frame. Covers: 0:01.5. "
        + UNVERIFIED,
    ),
    ([0] * 40, (FOUND,), 0, "The faces that were found are swapped in 40 frames."),
    ([0] * 5, (FOUND, STILL), 1, "A face may be visible in the output, at 0:00.2: do not share it."),
    ([1], (STILL,), 1, "A face may be visible in the output, at 0:00.2: do not share it."),
]


@pytest.mark.parametrize(("done", "audit", "code", "sentence"), OUTCOMES)
def test_the_exit_code_and_the_sentence(done: list[int], audit: Any, code: int, sentence: str) -> None:
    report = report_of(*([outcome_of(1, done)] if done else []), audit=audit)
    assert (outcome(report), verdict(report)) == (code, sentence)


def test_a_damaged_input_is_never_verified() -> None:
    whole = report_of(outcome_of(1, [0] * 40))
    damaged = replace(whole, damaged=True)
    assert (outcome(whole), outcome(damaged)) == (0, 3)
    assert verdict(damaged) == f"{verdict(whole)} The input is damaged, see the problems: not verified."


def test_frames_before_the_first_face_need_no_verification() -> None:
    assert outcome(report_of(outcome_of(1, [0] * 5, first=35))) == 0


def test_a_cover_beside_a_face_that_is_left_counts() -> None:
    """The frame counts as left; a face of it is covered all the same."""
    report = report_of(outcome_of(1, [2] * 5), outcome_of(2, [1] * 5), frames=5)
    assert report.counts["covered"] == 0
    assert frames_with(report, "covered").tolist() == [0, 1, 2, 3, 4]
    assert outcome(report) == 0


def test_where_nobody_can_tell_is_not_verified_and_said() -> None:
    report = replace(report_of(outcome_of(1, [0] * 40)), unclear=(10, 11, 12))
    assert outcome(report) == 3
    said = "In 3 frames nobody can tell if there is a face: not verified. Watch 0:00.4 to 0:00.5."
    assert verdict(report).endswith(said)


def test_times_are_the_longest_runs_in_order_and_short_pauses_do_not_part_them() -> None:
    report = report_of(outcome_of(1, [0] * 400), frames=400)
    frames = [0, *range(50, 60), *range(62, 70), *range(120, 140), 200, *range(300, 310)]
    assert times(report, frames) == "0:02.0 to 0:02.8, 0:04.8 to 0:05.6, 0:12.0 to 0:12.4 and 2 times more"


# -- a batch --------------------------------------------------------------------------------------------------


def test_the_json_of_a_batch(tmp_path: Path) -> None:
    write_batch(tmp_path / "b.json", entries_of(tmp_path))
    value = json.loads((tmp_path / "b.json").read_text())
    assert (value["format"], value["version"]) == ("guise-batch-report", 1)
    assert [value[key] for key in ("files", *KINDS)] == [4, 1, 0, 1, 2]
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
