"""Swapping several people: who is meant, what each gets, and what happens to everybody else."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clips import two_people
from models import model_file

from guise.aam.model import Identity
from guise.aam.recognition import signature
from guise.app.cli.main import main
from guise.app.drawing.look import SWAP
from guise.app.enrolment.enrol import EnrolError
from guise.app.media import EncodeOptions, open_input
from guise.app.people.found import UnknownFaces, VideoPeople, VideoPerson
from guise.app.swapping.report import SwapError, SwapSettings
from guise.app.swapping.several import Casting, choose, swap_people

FRAMES = 30
FAST = SwapSettings(replace(SWAP, renderer="cpu"), EncodeOptions(lossless=True))
LEFT, RIGHT = np.s_[:, :240], np.s_[:, 240:]


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """p01 on the left, p06 on the right."""
    path = tmp_path_factory.mktemp("pair") / "pair.mp4"
    two_people(path, FRAMES, lambda time: (120, 360))
    return path


@pytest.fixture
def enrolled(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Whoever is enrolled is p01, which is quick."""
    monkeypatch.setenv("GUISE_PEOPLE", str(tmp_path_factory.mktemp("people")))
    monkeypatch.setattr("guise.app.enrolment.enrol.enrol", lambda *_, **__: Identity.load(model_file("p01")))


def person(number: int, x: float, width: float, looks: np.ndarray) -> VideoPerson:
    boxes = np.tile(np.array([x - width / 2, 0, x + width / 2, width], np.float32), (20, 1))
    rows = np.arange(20, dtype=np.int32)
    return VideoPerson(
        number, rows, boxes, np.zeros(20, np.float32), np.zeros((20, 81, 2), np.float32), np.ones(20, np.float32),
        looks, np.zeros((160, 160, 3), np.uint8),
    )  # fmt: skip


@pytest.fixture(scope="module")
def found() -> VideoPeople:
    """Number 1 on the right, and number 2, who is larger and looks like p01, on the left."""
    looks = signature(Identity.load(model_file("p01")))
    nobody = UnknownFaces(
        np.zeros(0, np.int32), np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32)
    )
    return VideoPeople((person(1, 300, 50, -looks), person(2, 100, 80, looks)), nobody, (), 20)


def there(who: str) -> str:
    """The path of a person's model, or the name as it is."""
    return str(model_file(who.removesuffix(".guise"))) if who.endswith(".guise") else who


@pytest.mark.parametrize(
    ("who", "number"), [("left", 2), ("right", 1), ("largest", 2), ("1", 1), ("p01.guise", 2)]
)
def test_a_person_is_named_by_place_number_or_model(found: VideoPeople, who: str, number: int) -> None:
    chosen, model = choose(found, there(who), "pair.mp4")
    assert chosen.number == number
    assert (model is not None) == who.endswith(".guise")


@pytest.mark.parametrize(
    ("who", "sentence"),
    [
        ("3", "there is no person 3 in pair.mp4: choose from 1, 2"),
        ("Bob", "Bob is nobody who could be in pair.mp4"),
        ("p06.guise", "nobody in pair.mp4 looks enough like"),
    ],
)
def test_who_is_not_there_is_one_sentence(found: VideoPeople, who: str, sentence: str) -> None:
    with pytest.raises(SwapError, match=sentence):
        choose(found, there(who), "pair.mp4")


def test_a_video_without_people_is_one_sentence(found: VideoPeople) -> None:
    with pytest.raises(SwapError, match="nobody is seen long enough"):
        choose(replace(found, people=()), "left", "empty.mp4")


def changed(before: Path, after: Path, half: tuple[slice, slice]) -> float:
    """The share of a half of all frames in which the luma differs."""
    with open_input(before) as one, open_input(after) as other:
        pairs = [(a.luma[half], b.luma[half]) for a, b in zip(one, other, strict=True)]
    return float(np.mean([np.mean(a != b) for a, b in pairs]))


@pytest.mark.usefixtures("enrolled")
@pytest.mark.slow
def test_each_gets_their_face_and_the_others_what_is_asked(pair: Path, tmp_path: Path) -> None:
    left = swap_people(pair, Casting({"left": "p03"}), tmp_path / "left.mp4", settings=FAST)
    assert {(p.face, p.swapped, p.left) for p in left.people} == {("p03", FRAMES, 0), ("", 0, FRAMES)}
    assert (left.frames, left.swapped, left.faces) == (FRAMES, FRAMES, 2)
    assert changed(pair, tmp_path / "left.mp4", LEFT) > 0.05
    assert changed(pair, tmp_path / "left.mp4", RIGHT) == 0

    covered = swap_people(pair, Casting({"left": "p03"}, "cover"), tmp_path / "covered.mp4", settings=FAST)
    assert {(p.swapped, p.covered) for p in covered.people} == {(FRAMES, 0), (0, FRAMES)}
    assert covered.swapped == FRAMES
    assert changed(pair, tmp_path / "covered.mp4", RIGHT) > 0.2


@pytest.mark.slow
def test_who_cannot_be_learned_is_covered_and_not_left(
    pair: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    learned = [Identity.load(model_file("p01"))]

    def once(*_: object, **__: object) -> Identity:
        if not learned:
            raise EnrolError("too few frames")
        return learned.pop()

    monkeypatch.setattr("guise.app.enrolment.enrol.enrol", once)
    settings = replace(FAST, say=said.append)
    report = swap_people(pair, Casting({"1": "p03"}, "fictional"), tmp_path / "out.mp4", settings=settings)
    assert [(p.swapped, p.covered) for p in report.people] == [(FRAMES, 0), (0, FRAMES)]
    assert any(
        "person 2 of pair.mp4 cannot be learned: too few frames; they are covered" in text for text in said
    )


@pytest.mark.slow
def test_two_names_of_one_person_are_refused_and_nothing_is_left(pair: Path, tmp_path: Path) -> None:
    faces = {"left": "p03", "right": "p04", "largest": "p05"}
    with pytest.raises(SwapError, match="and largest are the same person"):
        swap_people(pair, Casting(faces), tmp_path / "out.mp4", settings=FAST)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ([], "give --identity FACE, or --map"),
        (["--identity", "p03", "--map", "left=p03"], "give --identity FACE, or --map"),
        (["--identity", "p03", "--others", "cover"], "--others goes with --map"),
        (["--map", "left"], "--map takes SOURCE=FACE"),
        (["--map", "left=p03", "--map", "left=p04"], "--map takes SOURCE=FACE"),
        (["--map", "left=p03", "--source", "x.guise"], "are for one person"),
        (["--map", "left=p99"], "there is no face p99"),
    ],
)
def test_a_mistake_is_one_sentence(
    pair: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], sentence: str
) -> None:
    assert main(["swap", str(pair), *options, "-o", str(tmp_path / "out.mp4")]) == 2
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("enrolled")
@pytest.mark.slow
def test_the_command_says_what_everybody_got(
    pair: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out.mp4")
    assert main(["swap", str(pair), "--map", "1=p03", "-o", out, "--json"]) == 0
    people = json.loads(capsys.readouterr().out)["people"]
    assert [(p["number"], p["face"], p["swapped"]) for p in people] == [(1, "p03", FRAMES), (2, "", 0)]
