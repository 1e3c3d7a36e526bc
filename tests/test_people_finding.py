"""People in a video: told apart by their looks, through crossings and cuts; what is not certain stays unknown."""

from pathlib import Path

import numpy as np
import pytest
from clips import two_people

from guise.aam.landmarks.schemes import FOREHEAD
from guise.aam.recognition import MIN_SAME_PERSON_SIMILARITY, SIGNATURE_RESOLUTION
from guise.aam.reference import ReferenceFrame
from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions
from guise.app.cli.main import main
from guise.app.enrolment.enrol import EnrolError, enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import open_input
from guise.app.people import finding
from guise.app.people.finding import MIN_ALIKE, Piece, find_people, group, people_followed
from guise.app.people.found import VideoPeople, load_people, save_people

pytestmark = pytest.mark.slow

FRAMES = 72
SMALL = TrainingOptions(frames=14, resolution=64, tracker=TrackerOptions(stages=2, copies=4, folds=2))


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    path = tmp_path_factory.mktemp("crossing") / "crossing.mp4"

    def places(time: float) -> tuple[float, float]:
        way = float(np.clip((time - 0.3) / 0.4, 0, 1))
        return 120 + 240 * way, 360 - 240 * way

    return path, two_people(path, FRAMES, places)


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """p01 in the first 40 frames, p06 at the same place in the others."""
    path = tmp_path_factory.mktemp("cut") / "cut.mp4"
    two_people(path, FRAMES, lambda time: (240, -300) if time < 40 / (FRAMES - 1) else (-300, 240))
    return path


def found_in(path: Path) -> VideoPeople:
    with open_input(path) as media:
        return find_people(media)


def test_everybody_keeps_their_number_through_a_crossing(crossing: tuple[Path, np.ndarray]) -> None:
    path, truth = crossing
    found = found_in(path)
    assert (len(found.people), found.count) == (2, FRAMES)
    for person in found.people:
        middle = person.boxes.reshape(-1, 2, 2).mean(1)
        away = np.linalg.norm(np.delete(truth, FOREHEAD, axis=2)[:, person.frames].mean(2) - middle, axis=2)
        assert len(set(away.argmin(0).tolist())) == 1
        assert person.frames[0] == 0
        assert person.frames[-1] == FRAMES - 1
        assert person.thumbnail.shape == (160, 160, 3)
    first, second = (person.landmarks(FRAMES) for person in found.people)
    assert first.shape == (FRAMES, 81, 2)
    assert np.isfinite(first[0]).all()
    assert not np.allclose(first[0], second[0], atol=50)


def test_a_cut_parts_two_people(cut: Path) -> None:
    found = found_in(cut)
    assert [(p.frames[0], p.frames[-1]) for p in found.people] == [(0, 39), (40, FRAMES - 1)]
    assert found.cuts == (40,)
    assert len(found.unknown.frames) == 0


def test_a_clip_cut_from_two_people_is_told_and_one_is_learned(cut: Path) -> None:
    said: list[str] = []
    made = enrol([cut], LandmarkSource(), name="one", options=SMALL, say=said.append)
    assert "cut.mp4 shows 2 people: 1 in 40 frames, 2 in 32 frames; enrolling 1" in said[0]
    assert made.facts["frames"] <= 40
    with pytest.raises(EnrolError, match=r"there is no person 3 in .*: choose from 1, 2"):
        enrol([cut], LandmarkSource(), name="nobody", person=3, options=SMALL)


def given_points(found: VideoPeople) -> np.ndarray:
    points = np.full((FRAMES, 81, 2), np.nan)
    for person in found.people:
        points[person.frames] = person.points
    return points


def test_a_cut_to_a_face_that_would_pass_within_a_shot_is_told(
    cut: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(finding, "MIN_ALIKE", 0.40)  # so that p01 and p06 count as alike
    found = found_in(cut)
    first, second = found.people
    assert first.signature @ second.signature > 0.40
    with open_input(cut) as media:
        assert people_followed(media, given_points(found)) == 2


def test_somebody_who_is_elsewhere_after_a_cut_is_one_person(tmp_path: Path) -> None:
    path = tmp_path / "cut.mp4"
    two_people(path, FRAMES, lambda time: (120 if time < 40 / (FRAMES - 1) else 360, -300))
    found = found_in(path)
    assert found.cuts == (40,)
    assert [len(person.frames) for person in found.people] == [FRAMES]
    with open_input(path) as media:
        assert people_followed(media, given_points(found)) == 1


def test_only_frames_of_the_person_are_left(cut: Path) -> None:
    people = found_in(cut).people
    assert [np.isfinite(person.landmarks(FRAMES)[:, 0, 0]).nonzero()[0].tolist() for person in people] == [
        list(range(40)),
        list(range(40, FRAMES)),
    ]


def test_landmarks_that_are_given_are_kept_of_one_person_only(cut: Path) -> None:
    points = given_points(found_in(cut))
    with open_input(cut) as media:
        assert people_followed(media, points) == 2
    with open_input(cut) as media:
        assert people_followed(media, points[:40]) == 1


def test_the_command_draws_them(cut: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sheet = tmp_path / "people.png"
    assert main(["people", str(cut), "-o", str(sheet)]) == 0
    assert "32 of 72" in capsys.readouterr().out
    assert sheet.is_file()
    assert main(["people", "find", str(cut), "-o", str(sheet)]) == 2


def piece(track: int, frames: range, looks: np.ndarray, *, crossing: bool = False) -> Piece:
    made = Piece(track, crossing)
    for frame in frames:
        made.add(frame, looks)
    return made


@pytest.fixture(scope="module")
def looks() -> list[np.ndarray]:
    """The textures (t, 3) of two people, and of one between them."""
    rng = np.random.default_rng(3)
    size = len(ReferenceFrame.canonical(SIGNATURE_RESOLUTION).pixels)
    one, other = (rng.uniform(40, 220, (size, 3)).astype(np.float32) for _ in range(2))
    return [one, other, (one + other) / 2]


def test_a_track_that_went_on_with_another_head_is_parted(looks: list[np.ndarray]) -> None:
    pieces = [piece(0, range(20), looks[0]), piece(0, range(20, 40), looks[1])]
    assert len(group(pieces)) == 2
    assert [p.person for p in pieces] == [0, 1]


def test_over_a_cut_faces_must_be_more_alike(looks: list[np.ndarray]) -> None:
    similar = 0.6 * looks[0] + 0.4 * looks[1]
    pieces = [
        piece(0, range(20), looks[0]),
        piece(1, range(20, 40), similar),
        piece(2, range(40, 60), looks[0]),
    ]
    own, other = pieces[0].signature, pieces[1].signature
    assert own is not None
    assert other is not None
    assert MIN_ALIKE < own @ other < MIN_SAME_PERSON_SIMILARITY
    group(pieces)
    assert [p.person for p in pieces] == [0, 0, 0]
    for one in pieces:
        one.person = -1
    group(pieces, [20, 40])
    assert [p.person for p in pieces] == [0, 1, 0]


def test_who_is_in_a_short_shot_is_known_from_the_others(looks: list[np.ndarray]) -> None:
    pieces = [
        piece(0, range(20), looks[0]),
        piece(1, range(20, 25), looks[0]),
        piece(2, range(25, 30), looks[1]),
    ]
    group(pieces, [20, 25])
    assert [p.person for p in pieces] == [0, 0, -1]


def test_who_comes_back_on_another_track_is_known(looks: list[np.ndarray]) -> None:
    pieces = [piece(0, range(20), looks[0]), piece(1, range(50, 70), looks[0])]
    group(pieces)
    assert [p.person for p in pieces] == [0, 0]


def test_faces_that_are_seen_at_once_are_of_different_people(looks: list[np.ndarray]) -> None:
    pieces = [piece(0, range(20), looks[0]), piece(1, range(20), looks[0])]
    group(pieces)
    assert sorted(p.person for p in pieces) == [0, 1]


def test_a_crossing_belongs_to_nobody_unless_both_sides_agree(looks: list[np.ndarray]) -> None:
    crossing = Piece(0, True, frames=list(range(20, 25)))
    same = [piece(0, range(20), looks[0]), crossing, piece(0, range(25, 45), looks[0])]
    group(same)
    assert crossing.person == 0
    crossing = Piece(0, True, frames=list(range(20, 25)))
    changed = [piece(0, range(20), looks[0]), crossing, piece(0, range(25, 45), looks[1])]
    group(changed)
    assert crossing.person == -1


def test_what_was_found_is_read_as_it_was_written(cut: Path, tmp_path: Path) -> None:
    found = found_in(cut)
    save_people(tmp_path / "people.npz", found)
    again = load_people(tmp_path / "people.npz")
    assert (again.cuts, again.count, len(again.people)) == (found.cuts, found.count, 2)
    for one, other in zip((found.unknown, *found.people), (again.unknown, *again.people), strict=True):
        for name, value in vars(one).items():
            np.testing.assert_array_equal(value, vars(other)[name])
