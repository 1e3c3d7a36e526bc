"""Outputs are written whole or not at all, and names are put in natural order."""

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.enrolment.landmark_source import landmark_file
from guise.common.errors import OutputError
from guise.common.files import WholeOutput, fitting_name, natural_key, part_of, write_json, write_whole


@pytest.mark.parametrize("content", [b"\xc3\xa9", "é", lambda part: part.write_bytes(b"\xc3\xa9")])
def test_bytes_text_or_a_function_fill_a_file(tmp_path: Path, content: object) -> None:
    path = tmp_path / "out.txt"
    path.write_bytes(b"old")
    write_whole(path, content)  # type: ignore[arg-type]
    assert path.read_bytes() == "é".encode()
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_bytes(b"old")

    def fails(part: Path) -> None:
        part.write_bytes(b"half")
        assert part == part_of(path) == tmp_path / "out.txt.part"
        raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_whole(path, fails)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_report_that_json_cannot_hold_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "report.json", {"error": float("nan")})
    assert not list(tmp_path.iterdir())


def test_a_part_is_claimed_once(tmp_path: Path) -> None:
    mine = WholeOutput(tmp_path / "out.mp4")
    mine.claim()
    with pytest.raises(OutputError, match=r"out\.mp4\.part exists, from another run .* --force$"):
        WholeOutput(tmp_path / "out.mp4").claim()
    WholeOutput(tmp_path / "out.mp4", force=True).claim()
    mine.part.write_bytes(b"whole")
    mine.publish()
    mine.discard()
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == {"out.mp4": b"whole"}


def test_a_folder_is_claimed_once_and_removed_with_what_is_in_it(tmp_path: Path) -> None:
    mine = WholeOutput(tmp_path / "out", folder=True)
    mine.claim()
    (mine.part / "a.png").write_bytes(b"")
    with pytest.raises(OutputError, match=r"out\.part exists"):
        WholeOutput(tmp_path / "out", folder=True).claim()
    taken = WholeOutput(tmp_path / "out", force=True, folder=True)
    taken.claim()
    assert not list(taken.part.iterdir())
    taken.discard()
    assert not list(tmp_path.iterdir())


def test_an_output_is_completed_once_or_removed(tmp_path: Path) -> None:
    with WholeOutput(tmp_path / "a") as output:
        output.claim()
    output.abort()
    assert (tmp_path / "a").exists()
    broken = WholeOutput(tmp_path / "b")
    broken.claim()
    broken.__exit__(KeyError, KeyError(), None)
    with WholeOutput(tmp_path / "c") as output:
        output.claim()
        output.abort()
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize(
    "names",
    [
        ["f1", "f2", "f10"],
        ["F1.png", "f2.png", "F10.png"],
        ["1", "2a", "10", "a", "b1", "b1c"],
        ["clip2_frame9", "clip2_frame10", "clip10_frame1"],
        ["a", "a0", "a1"],
        ["x²", "x³"],  # digits that are no decimals are text
        ["v\u0662", "v3", "v\u0661\u0660"],  # other scripts' decimals are numbers
        ["f01", "f1"],  # equal numbers: by the name as it stands
        ["Same", "same"],
    ],
)
def test_numbers_in_names_count_as_numbers(names: list[str]) -> None:
    backwards = names[::-1]
    assert sorted(backwards, key=natural_key) == names


@given(st.text(st.characters(exclude_characters="/\0", exclude_categories=("Cs",)), min_size=1, max_size=300),
       st.sampled_from([".part", ".work", "_deidentified.mp4", ".report.json"]))  # fmt: skip
def test_a_derived_name_fits_and_keeps_its_ending(stem: str, ending: str) -> None:
    name = fitting_name(stem, ending)
    assert len(os.fsencode(name)) <= 255
    assert name.endswith(ending)
    assert fitting_name(stem + "x", ending) != name
    assert name == stem + ending or len(os.fsencode(stem + ending)) > 255


def test_a_file_with_the_longest_name_is_written_whole(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 251 + ".txt")
    write_whole(path, "text")
    assert path.read_text() == "text"
    assert list(tmp_path.iterdir()) == [path]


def test_files_beside_one_with_the_longest_name_are_looked_for(tmp_path: Path) -> None:
    clip = tmp_path / ("n" * 251 + ".mp4")
    assert landmark_file(clip) is None
    beside = clip.with_name(fitting_name(clip.stem, ".npz"))
    beside.touch()
    assert landmark_file(clip) == beside
