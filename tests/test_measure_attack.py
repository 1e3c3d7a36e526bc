"""`guise measure --attack`: attackers that must find the people, some that must not, and what it says to mistakes."""

import json
from pathlib import Path
from unittest.mock import create_autospec

import numpy as np
import pytest
from clips import cut
from made_up import SAMPLES
from test_measure import recogniser, rewritten

from guise.aam.landmarks import open_landmarker
from guise.app.cli.main import main
from guise.app.measure.attack import AttackRequest, AttackResult, attack, roll_degrees, turned_face
from guise.app.measure.attackers import Evidence, Guesses, Head, attacks, guessed, luck
from guise.app.measure.table import rank_rows, similarity_rows, worst_sentence
from guise.app.measure.views import embedders, face_only, head_pixels, outline_only
from guise.app.media import open_input

PEOPLE, DIMENSION = 20, 24


def unit(rows: np.ndarray) -> np.ndarray:
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def faces(places: np.ndarray, noise: float, seed: int, count: int = 10) -> list[np.ndarray]:
    """For each of some people (n, d) a few noisy embeddings."""
    rng = np.random.default_rng(seed)
    return [unit(place + noise * rng.normal(size=(count, len(place)))) for place in places]


def evidence(before: np.ndarray, after: np.ndarray, noise: float = 0.05) -> list[Evidence]:
    """People at places before and after de-identification."""
    parts = zip(*(faces(p, noise, k) for k, p in enumerate((before, after, after, before))), strict=True)
    return [Evidence(*part) for part in parts]


def places(seed: int) -> np.ndarray:
    return unit(np.random.default_rng(seed).normal(size=(PEOPLE, DIMENSION)))


def test_every_attacker_finds_people_who_are_not_changed() -> None:
    own = places(0)
    assert {guesses.rank_one for guesses in attacks(evidence(own, own)).values()} == {1.0}


def test_only_the_parrot_finds_people_who_are_changed_alike_in_all_their_pictures() -> None:
    found = attacks(evidence(places(0), places(1)))
    assert found["naive", "clip"].rank_one <= 0.2
    assert found["reverse", "clip"].rank_one <= 0.2
    assert found["parrot", "clip"].rank_one == 1.0


def test_nobody_is_found_where_all_are_shown_alike() -> None:
    found = attacks(evidence(places(0), np.repeat(places(1)[:1], PEOPLE, axis=0)))
    assert max(guesses.rank_one for guesses in found.values()) <= 0.3
    assert np.mean([guesses.rank_one for guesses in found.values()]) == pytest.approx(1 / PEOPLE, abs=0.06)


def test_rows_of_guesses_sum_to_one_and_ties_are_shared() -> None:
    same = np.ones((PEOPLE, DIMENSION))
    for guesses in attacks(evidence(same, same, noise=0.0)).values():
        assert guesses.shares.sum(1) == pytest.approx(np.ones(PEOPLE))
        assert guesses.rank_one == pytest.approx(1 / PEOPLE)


def test_the_head_ignores_what_varies_within_people() -> None:
    rng = np.random.default_rng(3)
    own, wind = 0.3 * places(2), places(4)[0]
    people = [
        unit(place + 2 * rng.normal(size=(12, 1)) * wind + 0.02 * rng.normal(size=(12, DIMENSION)))
        for place in own
    ]
    head = Head.trained([rows[:6] for rows in people])
    right = [
        guessed([f(rows[:6]) for rows in people], [f(rows[6:]) for rows in people], "frame").rank_one
        for f in (np.asarray, head)
    ]
    assert right[1] > right[0] + 0.2


def test_the_interval_holds_the_share_and_is_wider_with_fewer_people() -> None:
    many, few = (Guesses(np.diag([1.0, 0.0] * n)) for n in (40, 5))
    for one in (many, few):
        low, high = one.interval()
        assert low < one.rank_one < high
    assert np.ptp(few.interval()) > 2 * np.ptp(many.interval())


def test_where_nobody_is_found_the_interval_says_how_few_were_asked() -> None:
    low, high = Guesses(np.roll(np.eye(PEOPLE), 1, axis=1)).interval()
    assert low == 0
    assert high == pytest.approx(1 - 0.05 ** (1 / PEOPLE))


def test_luck_of_many_attackers_is_above_chance_and_that_of_one_is_chance() -> None:
    rng = np.random.default_rng(5)
    blind = [Guesses(np.eye(PEOPLE)[rng.integers(0, PEOPLE, PEOPLE)]) for _ in range(8)]
    assert luck(blind[:1])[0] == pytest.approx(1 / PEOPLE, abs=0.01)
    mean, high = luck(blind)
    assert 1.5 / PEOPLE < mean < high


@pytest.fixture(scope="module")
def picture() -> tuple[np.ndarray, np.ndarray]:
    """A sample person's first frame and landmarks."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as media:
        rgb = next(iter(media)).rgb()
    return rgb, open_landmarker("builtin").detect(rgb)[0].points


def test_views_see_only_what_they_say(picture: tuple[np.ndarray, np.ndarray]) -> None:
    rgb, points = picture
    by_name = {view.name: view.embed for view in embedders([])}
    noise = np.random.default_rng(0).integers(0, 256, rgb.shape).astype(np.uint8)
    inside = outline_only(np.zeros_like(rgb), points).any(2)
    other_face, other_head = rgb.copy(), noise.copy()
    other_face[inside] = noise[inside]
    other_head[inside] = rgb[inside]
    face, outline = by_name["built-in, face"], by_name["built-in, outline"]
    assert outline(other_face, points) == pytest.approx(outline(rgb, points), abs=0.05)
    assert outline(other_head, points) @ outline(rgb, points) < 0.7
    assert face(other_head, points) @ face(rgb, points) > 0.95
    assert face(other_face, points) @ face(rgb, points) < 0.7
    assert (face_only(other_head, points) == face_only(rgb, points)).all()


def test_a_head_of_one_colour_gives_no_embedding(picture: tuple[np.ndarray, np.ndarray]) -> None:
    assert head_pixels(np.full_like(picture[0], 128), picture[1]) is None


@pytest.mark.parametrize("degrees", [-60, 30, 120])
def test_a_turned_face_is_rolled_by_the_angle(picture: tuple[np.ndarray, np.ndarray], degrees: int) -> None:
    rgb, points = picture
    turned, moved = turned_face(rgb, points, degrees)
    assert turned.shape == rgb.shape
    assert (roll_degrees(moved) - roll_degrees(points) - degrees + 180) % 360 - 180 == pytest.approx(
        0, abs=0.1
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """people/ with three people, copied/ as they are and covered/ with grey faces, and a recogniser."""
    folder = tmp_path_factory.mktemp("attack")
    (folder / "people" / "first").mkdir(parents=True)
    cut("p01", folder / "people" / "first" / "a.mp4", 5)
    cut("p01", folder / "people" / "first" / "b.mp4", 5, clip="talk.mp4")
    for person in ("p02", "p06"):
        cut(person, folder / "people" / f"{person}.mp4", 10)
    for original in sorted((folder / "people").rglob("*.mp4")):
        for name, covered in (("copied", False), ("covered", True)):
            target = folder / name / original.relative_to(folder / "people")
            target.parent.mkdir(parents=True, exist_ok=True)
            rewritten(original, target.with_stem(f"{target.stem}_deidentified"), cover=covered)
    recogniser(folder)
    return folder


@pytest.fixture(scope="module")
def result(folder: Path) -> AttackResult:
    return attack(
        AttackRequest(folder / "people", [folder / "copied", folder / "covered"], (folder / "card.toml",))
    )


@pytest.mark.slow
def test_people_are_found_in_a_copy_and_not_by_covered_faces(result: AttackResult) -> None:
    copied, covered = result.outputs
    assert result.people == 3
    assert {by["clip"].share for view in copied.views for by in view.attackers.values()} == {1.0}
    assert copied.worst.rank_one.share == 1.0
    face = next(view for view in covered.views if view.view == "built-in, face")
    assert all(by["frame"].share < 1 for by in face.attackers.values())
    assert any("few" in note for note in result.notes)
    assert "naive" in worst_sentence(result, copied)
    assert len(rank_rows(copied)) == len(similarity_rows(copied)) == 5


@pytest.mark.slow
def test_the_command_writes_and_prints_the_figures(
    folder: Path, result: AttackResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    attacked = create_autospec(attack, return_value=result)
    monkeypatch.setattr("guise.app.measure.attack.attack", attacked)
    originals, outputs = folder / "people", [folder / "copied", folder / "covered"]
    words = ["measure", originals, *outputs, "--attack", "--json", "--recogniser", folder / "card.toml"]
    assert main([*map(str, words), "-o", str(folder / "attack.json")]) == 0
    assert attacked.call_args.args == (AttackRequest(originals, outputs, (folder / "card.toml",)),)
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((folder / "attack.json").read_text())
    assert printed["format"] == "guise-attack"
    assert printed["outputs"][0]["worst"]["rank_one"] == {"share": 1.0, "interval": [1.0, 1.0]}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["people", "missing", "--attack"], "missing must hold"),
        (["people/p02.mp4", "copied", "--attack"], "needs a folder with a video"),
        (["people", "copied", "--attack", "--plot", "a.png"], "--attack does not take --plot"),
        (["people/p02.mp4", "copied/p02_deidentified.mp4", "--recogniser", "card.toml", "--recogniser", "card.toml"],
         "with --attack only"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_sentence(
    folder: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    assert main(["measure", *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
