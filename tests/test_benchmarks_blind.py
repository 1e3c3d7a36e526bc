"""Blind verdicts: names tell nothing, the key stays closed until all are judged, and tables count what was judged."""

import csv
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.common import F64, Clip
from benchmarks.picture import blind
from guise.aam.landmarks.schemes import LOWER_LIP_INNER

CLIPS = [Clip(f"person{k}__donor{k}", Path(), np.zeros((1, 81, 2))) for k in range(8)]
FOOLS = {"aa": ("yes", ""), "bb": ("no", "irises seam"), "cc": ("almost", "soft"), "dd": ("yes", "")}
DONORS = {"ee": ("A",), "ff": ("B",)}
KEY = {
    "fools": {"aa": "x__y", "bb": "x__Mei", "cc": "x", "dd": "z"},
    "donors": {"ee": "x__y", "ff": "x__Mei"},
    "letters": {"ee": "A", "ff": "D"},
}


def points() -> F64:
    """(60, 81, 2) of a sample clip."""
    return np.asarray(np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:60], np.float64)


def judged(folder: Path, test: str, rows: Mapping[str, Sequence[str]], key: object = KEY) -> list[str]:
    """A folder of sheets with these verdicts.  Returns the command that scores it."""
    blind.write_empty(folder / "blind" / test, test, rows)
    for name in rows:
        (folder / "blind" / test / f"{name}.png").touch()
    with (folder / "blind" / test / blind.VERDICTS).open("w", newline="") as file:
        csv.writer(file).writerows([blind.COLUMNS[test], *([name, *row] for name, row in rows.items())])
    (folder / "blind_key.json").write_text(json.dumps(key))
    return ["score", "--work", str(folder)]


def refusal(command: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """What the command says when it refuses."""
    with pytest.raises(SystemExit) as ended:
        blind.main(command)
    assert ended.value.code == 2
    return capsys.readouterr().err.splitlines()[-1]


def test_names_and_their_order_tell_nothing() -> None:
    first, second = blind.named(CLIPS), blind.named(CLIPS)
    assert first.keys().isdisjoint(second)
    for found in (first, second):
        assert sorted(found) == list(
            found
        )  # sheets are drawn in this order, so times of files tell nothing either
        assert {clip.name for clip in found.values()} == {clip.name for clip in CLIPS}
    orders = {tuple(clip.name for clip in blind.named(CLIPS).values()) for _ in range(4)}
    assert len(orders) > 1


@pytest.mark.slow
def test_a_sheet_depends_on_pixels_and_landmarks_alone(tmp_path: Path) -> None:
    video = SAMPLES / "p01" / "talk.mp4"
    key = blind.write_fools([Clip("a__b", video, points()), Clip("a", video, points())], tmp_path)
    assert sorted(key.values()) == ["a", "a__b"]
    for kind, rows in (("frames", 2), ("strip", 2)):
        first, second = (cv2.imread(str(tmp_path / f"{name}_{kind}.png")) for name in key)
        assert (first == second).all()
        assert first.std() > 10
        assert first.shape[1] / first.shape[0] == pytest.approx(
            (6 if kind == "frames" else 8) / rows / rows, abs=0.1
        )
    assert (tmp_path / blind.VERDICTS).read_text().split() == ["name,fools,faults", *(f"{n},," for n in key)]


def test_the_strip_is_where_the_face_moves_most() -> None:
    still = np.repeat(points()[:1], 60, axis=0)
    still[31:37, LOWER_LIP_INNER, 1] += 10 * np.array([1, 2, 1, 3, 1, 2])
    assert 29 <= blind.liveliest(still) <= 31
    with pytest.raises(blind.BlindError, match="no 8 successive frames show a face, of 7"):
        blind.liveliest(np.full((7, 81, 2), np.nan))


def test_portraits_are_of_others_of_the_same_sex() -> None:
    unit = dict(
        zip(("webcam_a1", "franck", "talk_r1", "talk_r2", "phone_d13", "room_s18"), np.eye(6), strict=True)
    )
    near = {name: vector.astype(np.float32) + 0.1 for name, vector in unit.items()}
    near["room_s18"] = near["franck"]
    found = blind.nearest("franck", "webcam_a2", near)
    assert sorted(found) == ["phone_d13", "talk_r1", "talk_r2"]
    near["talk_r2"] = near["franck"]
    assert blind.nearest("franck", "webcam_a2", near)[0] == "talk_r2"


def test_verdicts_are_counted_by_what_the_names_stand_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    judged(tmp_path, "fools", FOOLS)
    blind.main(judged(tmp_path, "donors", DONORS))
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "| swaps that fool | 0.5 share | | >= 0.4667 share | met |" in said
    assert "| swaps judged no for irises, ghosts, brows or objects | 1 | | <= 0 | NOT MET |" in said
    assert "| donors recognised among four | 0.5 share | | >= 0.9333 share | NOT MET |" in said
    assert "| untouched | 1 | 1 | 0 |" in said
    assert "| swaps | 1 | 0 | 0 | 0 | 1 | 0 | 0 |" in said
    assert "| x__Mei | no | irises seam | no |" in said
    assert any(line.startswith("Untouched clips not taken for untouched: 0.50") for line in said)


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        (("", ""), "bb: fools must be one of yes almost no, got ''"),
        (("perhaps", ""), "got 'perhaps'"),
        (("no", ""), "'no' needs a fault"),
        (("no", "hair"), "got 'hair'"),
    ],
)
def test_the_key_stays_closed_until_every_verdict_is_there(
    row: tuple[str, str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    judged(tmp_path, "fools", FOOLS | {"bb": row})
    command = judged(tmp_path, "donors", DONORS, "no key: it is not read")
    assert reason in (said := refusal(command, capsys))
    assert "the key stays closed" in said
    judged(tmp_path, "fools", FOOLS)
    assert "ff: letter must be one of A B C D" in refusal(
        judged(tmp_path, "donors", DONORS | {"ff": ("E",)}), capsys
    )


def test_a_key_of_other_sheets_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    judged(tmp_path, "fools", FOOLS)
    assert "is no key" in refusal(judged(tmp_path, "donors", DONORS, []), capsys)
    other = KEY | {"fools": {"00": "x__y"}}
    assert "belongs to other sheets" in refusal(judged(tmp_path, "donors", DONORS, other), capsys)


def test_what_is_missing_is_said_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make = ["make", "--shared", str(tmp_path), "--work", str(tmp_path / "work")]
    assert "is missing; --shared names the folder" in refusal(make, capsys)
    assert "is no file of verdicts" in refusal(["score", "--work", str(tmp_path)], capsys)
    assert not (tmp_path / "work").exists()


def test_verdicts_are_not_overwritten_and_the_key_is_kept_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for needed in ("data/real", "data/synthetic", "models/mobilefacenet.onnx"):
        (tmp_path / needed).mkdir(parents=True)
    make = ["make", "--shared", str(tmp_path), "--work", str(tmp_path)]
    beside = [*make, "--key", str(tmp_path / "blind" / "key.json")]
    assert "lies beside the sheets" in refusal(beside, capsys)
    judged(tmp_path, "fools", FOOLS)
    assert "holds sheets already" in refusal(make, capsys)
