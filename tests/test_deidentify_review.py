"""NAME.tracks.json takes sensible edits and refuses others in a sentence; the sheet shows every track."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.deidentify.options import DeidentifyError
from guise.app.deidentify.report.review import read_tracks, write_tracks
from guise.app.deidentify.report.sheet import ACTION_COLOURS, LAYOUT, contact_sheet
from guise.app.deidentify.tracks import Track

SECONDS = np.arange(500) / 25
RED = np.full((90, 60, 3), (255, 0, 0), np.uint8)
TRACKS = (
    Track(1, 1, 0, 99, 95, 120.4, (0.91, 0.8, 0.0), "swap", action="swap", can_swap=True),
    Track(2, 2, 10, 40, 31, 31.0, (0.5,), "cover", "the face is only 31 pixels wide"),
    Track(3, 1, 200, 499, 290, 118.0, (0.9, 0.95), "swap", action="swap", can_swap=True),
)


def written(path: Path, tracks: tuple[Track, ...] = TRACKS, name: str = "in.mp4") -> Path:
    write_tracks(path, tracks, input_name=name, fingerprint="abc", frames=500, seconds=SECONDS)
    return path


def edited(path: Path, edit: Callable[[dict[str, Any]], object]) -> Path:
    value = json.loads(written(path).read_text(encoding="utf-8"))
    edit(value)
    path.write_text(json.dumps(value), encoding="utf-8")
    return path


def refused(path: Path, fingerprint: str = "abc") -> str:
    with pytest.raises(DeidentifyError) as error:
        read_tracks(path, TRACKS, fingerprint)
    assert str(error.value).count("\n") == 0
    return str(error.value)


def test_unedited_tracks_are_as_before(tmp_path: Path) -> None:
    assert read_tracks(written(tmp_path / "t.json"), TRACKS, "abc") == TRACKS


@given(st.text(st.characters(exclude_categories=())), st.text())
@pytest.mark.slow
def test_any_name_survives(tmp_path_factory: pytest.TempPathFactory, name: str, person: str) -> None:
    """File names that are no Unicode among them."""
    path = tmp_path_factory.mktemp("names") / "t.json"
    tracks = (replace(TRACKS[0], name=person),)
    assert read_tracks(written(path, tracks, name), tracks, "abc") == tracks
    assert json.loads(path.read_text(encoding="utf-8"))["input"] == name


def test_the_file_says_when_a_track_is_seen_and_how_to_edit(tmp_path: Path) -> None:
    text = written(tmp_path / "t.json").read_text(encoding="utf-8")
    value = json.loads(text)
    assert value["tracks"][2]["frames"] == [200, 499]
    assert value["tracks"][2]["seconds"] == [8.0, 19.96]
    assert [t["can_swap"] for t in value["tracks"]] == [True, False, True]
    assert all(
        any(line.startswith(key) for line in value["how_to_edit"])
        for key in ("action", "person", "donor", "name")
    )
    assert '      "confidence": [0.91, 0.8, 0.0]\n' in text.replace(",\n", "\n"), "a list stays on its line"


def test_edits_are_taken(tmp_path: Path) -> None:
    def edit(value: dict[str, Any]) -> None:
        value["tracks"][0] |= {"action": "cover"}
        value["tracks"][1] |= {"action": "leave", "name": "Ann"}
        value["tracks"][2] |= {"person": 3}
        value["tracks"].reverse()

    assert read_tracks(edited(tmp_path / "t.json", edit), TRACKS, "abc") == (
        replace(TRACKS[0], action="cover"),
        replace(TRACKS[1], action="leave", name="Ann"),
        replace(TRACKS[2], person=3),
    )


def test_a_file_saved_by_an_old_editor_is_read(tmp_path: Path) -> None:
    path = written(tmp_path / "t.json")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_tracks(path, TRACKS, "abc") == TRACKS


def test_tracks_of_a_person_share_an_edited_donor_and_name(tmp_path: Path) -> None:
    path = edited(tmp_path / "t.json", lambda v: v["tracks"][2].update(donor="mine.guise", name="Ann"))
    tracks = read_tracks(path, TRACKS, "abc")
    assert [(t.donor, t.name) for t in tracks] == [("mine.guise", "Ann"), ("", ""), ("mine.guise", "Ann")]


def test_a_track_that_joins_a_person_gets_their_donor(tmp_path: Path) -> None:
    before = tuple(replace(t, donor=f"donor {t.person}") for t in TRACKS)
    path = written(tmp_path / "t.json", before)
    path.write_text(path.read_text("utf-8").replace('"person": 2', '"person": 1'), "utf-8")
    assert [t.donor for t in read_tracks(path, before, "abc")] == ["donor 1"] * 3


def test_two_donors_for_one_person_are_refused(tmp_path: Path) -> None:
    def edit(value: dict[str, Any]) -> None:
        value["tracks"][0]["donor"], value["tracks"][2]["donor"] = "a", "b"

    said = refused(edited(tmp_path / "t.json", edit))
    assert said.endswith(
        'tracks 1 and 3 are person 1 but have donor "a" and "b": give both the same, or another person'
    )


MISTAKES: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (
        lambda v: v["tracks"][1].update(action="hide"),
        'track 2: action must be one of swap, cover, leave, got "hide"',
    ),
    (
        lambda v: v["tracks"][1].update(action=["cover"]),
        'track 2: action must be one of swap, cover, leave, got ["cover"]',
    ),
    (
        lambda v: v["tracks"][1].update(action="swap"),
        "track 2: action is swap, but this face can't be swapped (the face",
    ),
    (
        lambda v: v["tracks"][1].update(action="swap", can_swap=True),
        "track 2: can_swap must not be edited: put it back",
    ),
    (lambda v: v["tracks"][0].update(person=0), "track 1: person must be the number of a track, got 0"),
    (
        lambda v: v["tracks"][0].update(person=True),
        "track 1: person must be a whole number, got true",
    ),
    (
        lambda v: v["tracks"][0].update(person=1.5),
        "track 1: person must be a whole number, got 1.5",
    ),
    (
        lambda v: v["tracks"][0].update(name=None),
        'track 1: name must be text in quotes, "" for none, got null',
    ),
    (lambda v: v["tracks"][0].update(donor=5), 'track 1: donor must be text in quotes, "" for any, got 5'),
    (
        lambda v: v["tracks"][0].update(actoin="cover"),
        'track 1: there is no field "actoin"; the fields to edit are action',
    ),
    (lambda v: v["tracks"][0].pop("action"), 'track 1: action is missing: put it back (it was "swap")'),
    (
        lambda v: v["tracks"][0].update(frames=[0, 50]),
        "track 1: frames must not be edited: put it back (it was [0, 99])",
    ),
    (lambda v: v["tracks"].pop(1), "track 2 is missing: put it back; to hide the face use action cover"),
    (lambda v: v["tracks"].append(v["tracks"][0]), "track 1 appears twice: delete one of the two"),
    (lambda v: v["tracks"][0].update(track=9), "entry 1: track is 9, which this video does not have"),
    (lambda v: v["tracks"].insert(0, "cover"), "entry 1: track is null, which this video does not have"),
    (lambda v: v.pop("tracks"), "isn't a file of tracks: --review writes one as NAME.tracks.json"),
    (
        lambda v: v.update(version=2),
        "has version 2 of the format, and this Guise reads version 1: write a new one with --review",
    ),
]


@pytest.mark.parametrize(("edit", "sentence"), MISTAKES, ids=[sentence for _, sentence in MISTAKES])
def test_a_mistake_is_named_with_file_track_and_field(
    tmp_path: Path, edit: Callable[[dict[str, Any]], object], sentence: str
) -> None:
    said = refused(edited(tmp_path / "t.json", edit))
    assert said.startswith(str(tmp_path / "t.json"))
    assert sentence in said


def test_the_file_of_another_video_is_refused(tmp_path: Path) -> None:
    said = refused(written(tmp_path / "t.json"), fingerprint="abd")
    assert 'was written for another video ("in.mp4"), or this one has changed since' in said


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"action": "swap",', '"action": "swap"', "isn't valid JSON at line"),
        (
            '"action": "swap",',
            '"action": "leave",\n"action": "swap",',
            "action appears twice in track 1: delete one",
        ),
        ('"person": 1', '"person": NaN', "person must be a whole number, got NaN"),
        ("[", "[" * 100_000, "can't be read"),
        ("in.mp4", "in\udcff.mp4", "isn't UTF-8 text"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = written(tmp_path / "t.json")
    path.write_bytes(path.read_text("utf-8").replace(old, new).encode("utf-8", "surrogateescape"))
    assert sentence in refused(path)


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    assert refused(tmp_path / "no.json") == f"{tmp_path / 'no.json'} does not exist: --review writes one"


# -- the sheet ------------------------------------------------------------------------------------------------


def count(sheet: np.ndarray, colour: tuple[int, int, int]) -> int:
    return int((sheet == colour).all(axis=2).sum())


def some(number: int) -> tuple[Track, ...]:
    return tuple(replace(TRACKS[0], number=n, seen=n) for n in range(1, number + 1))


@pytest.mark.parametrize("number", [0, 1, 17, 100, 5000])
@pytest.mark.slow
def test_the_sheet_stays_within_its_size(number: int) -> None:
    height, width = contact_sheet({}, some(number), SECONDS).shape[:2]
    assert height <= 11_000
    assert width <= 3_100
    assert (height > 500) == (number > 5)


def test_each_track_has_its_pictures() -> None:
    one = count(contact_sheet({1: [RED]}, TRACKS, SECONDS), (255, 0, 0))
    assert one > 5000
    assert count(contact_sheet({1: [RED] * 2, 3: [RED]}, TRACKS, SECONDS), (255, 0, 0)) == 3 * one
    assert count(contact_sheet({9: [RED]}, TRACKS, SECONDS), (255, 0, 0)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (3, 900), (900, 3), (40, 40)])
def test_pictures_of_any_shape_fit(shape: tuple[int, int]) -> None:
    sheet = contact_sheet({1: [np.full((*shape, 3), (255, 0, 0), np.uint8)] * 9}, TRACKS, SECONDS)
    assert sheet.shape == contact_sheet({}, TRACKS, SECONDS).shape
    assert count(sheet, (255, 0, 0)) > 100


def test_the_action_is_seen_by_its_colour() -> None:
    for action, colour in ACTION_COLOURS.items():
        sheets = [contact_sheet({}, [replace(TRACKS[0], action=a)], SECONDS) for a in ACTION_COLOURS]
        assert [count(sheet, colour) > 700 for sheet in sheets] == [a == action for a in ACTION_COLOURS]


def test_the_curve_is_higher_for_more_confidence() -> None:
    half = tuple(c // 2 for c in ACTION_COLOURS["swap"])
    sheets = [contact_sheet({}, [replace(TRACKS[0], confidence=(c,) * 50)], SECONDS) for c in (0.0, 0.4, 0.8)]
    none, some, more = (count(sheet, half) for sheet in sheets)
    assert none == 0
    assert more == pytest.approx(2 * some, rel=0.15)


def test_long_words_are_cut_off_at_the_end_of_their_line() -> None:
    track = replace(TRACKS[0], name="x" * 500, reason="y" * 500)
    plain, wordy = (contact_sheet({1: [RED]}, [t], SECONDS) for t in (TRACKS[0], track))
    assert not np.array_equal(plain, wordy)
    red = (plain == (255, 0, 0)).all(axis=2)
    np.testing.assert_array_equal(plain[:, red.any(0)], wordy[:, red.any(0)])
    changed = (plain != wordy).any(axis=2)[40:]  # of the card
    assert changed[:55].any()
    assert not changed[56:].any()


@pytest.mark.slow
def test_of_too_many_tracks_the_longest_are_shown() -> None:
    tracks = some(LAYOUT.max_cards + 3)
    shown = contact_sheet({1: [RED], 2: [RED], 3: [RED]}, tracks, SECONDS)
    assert count(shown, (255, 0, 0)) == 0
    assert count(contact_sheet({4: [RED]}, tracks, SECONDS), (255, 0, 0)) > 5000


def test_a_split_track_has_an_entry_for_each_part(tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    splits = {1: [30, 60], 3: [400]}
    write_tracks(
        path, TRACKS, input_name="in.mp4", fingerprint="abc", frames=500, seconds=SECONDS, splits=splits
    )
    value = json.loads(path.read_text(encoding="utf-8"))
    assert [(row["track"], *row["frames"], row.get("part_of")) for row in value["tracks"]] == [
        (1, 0, 29, 1), (4, 30, 59, 1), (5, 60, 99, 1), (2, 10, 40, None), (3, 200, 399, 3), (6, 400, 499, 3),
    ]  # fmt: skip
    value["tracks"][1] |= {"action": "leave", "person": 5}
    path.write_text(json.dumps(value), encoding="utf-8")
    parts = read_tracks(path, TRACKS, "abc")
    assert [(part.number, part.origin, part.action, part.person) for part in parts[:3]] == [
        (1, 1, "swap", 1), (4, 1, "leave", 5), (5, 1, "swap", 5),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("splits", "words"),
    [
        ([30], "splits must be like"),
        ({"9": [30]}, 'there is no track "9"'),
        ({"1": [0]}, "ascending frames from 1 to 99"),
        ({"1": [60, 30]}, "ascending frames from 1 to 99"),
        ({"1": [100]}, "ascending frames from 1 to 99"),
        ({"1": "30"}, "ascending frames"),
        ({"1": [30]}, "track 4 is missing"),
    ],
)
def test_a_split_that_is_not_sensible_is_refused(tmp_path: Path, splits: object, words: str) -> None:
    path = edited(tmp_path / "t.json", lambda value: value.update(splits=splits))
    if isinstance(splits, dict) and splits == {"1": [30]}:
        value = json.loads(path.read_text(encoding="utf-8"))
        value["tracks"][0] |= {"frames": [0, 29], "part_of": 1, "seen": 28, "confidence": [0.91]}
        path.write_text(json.dumps(value), encoding="utf-8")
    assert words in refused(path)
