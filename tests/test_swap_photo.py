"""Photos as videos: one photo of the donor, one to draw on, and nothing else."""

import json
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.mask import skin_mask
from guise.aam.one_photo import at_rest, person_in_photo
from guise.aam.recognition import cosine_similarity
from guise.aam.reference import ReferenceFrame
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker_training import turn_head
from guise.app.cli.main import main
from guise.app.media import Frame, open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import save_picture
from guise.app.people.found import people_in_photo
from guise.app.photos.swap import swap_photo
from guise.app.swapping.donors import anybody, open_face
from guise.app.swapping.several import Casting
from guise.common.arrays import U8


def first_frame(person: str) -> U8:
    with open_input(SAMPLES / person / "talk.mp4") as source:
        return next(iter(source)).rgb()


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """p01 and p06 alone, and both, p01 on the left and larger."""
    folder = tmp_path_factory.mktemp("photos")
    one, six = first_frame("p01"), first_frame("p06")
    pictures = {
        "p01": one,
        "p06": six,
        "both": np.hstack([one, np.pad(six[::2, ::2], ((0, len(one) - len(six[::2])), (0, 0), (0, 0)))]),
    }
    for name, picture in pictures.items():
        save_picture(folder / f"{name}.png", picture)
    return {name: folder / f"{name}.png" for name in pictures}


def likeness(picture: U8, other: U8) -> float:
    """Of the largest faces in two pictures."""
    one, two = (people_in_photo(Frame.from_rgb(p)).people[0].signature for p in (picture, other))
    return cosine_similarity(one, two)


@pytest.mark.slow
def test_a_photo_gets_the_face_of_another_photo(
    photos: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.png"
    assert main(["swap", str(photos["p01"]), "--identity", str(photos["p06"]), "-o", str(out)]) == 0
    assert "p06 was enrolled from one photo: use it only with the person's consent" in capsys.readouterr().err
    made, before, donor = (read_deep(path).rgb8() for path in (out, photos["p01"], photos["p06"]))
    assert likeness(made, donor) > likeness(made, before)
    changed = np.flatnonzero((made != before).any(axis=(1, 2)))
    assert len(changed) < 0.8 * len(made)
    assert b"rainedAlgorithmicMedia" in out.read_bytes()


def test_people_of_a_group_get_faces_by_place(
    photos: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, width = tmp_path / "out.png", first_frame("p01").shape[1]
    assert main(["swap", str(photos["both"]), "--map", "right=Mei", "-o", str(out), "--json", "--force"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [(one["number"], one["swapped"], one["left"]) for one in told["people"]] == [(1, 0, 1), (2, 1, 0)]
    made, before = (read_deep(path).rgb8() for path in (out, photos["both"]))
    assert (made[:, :width] == before[:, :width]).all()
    assert (made[:, width:] != before[:, width:]).any()


def test_an_array_is_swapped_as_a_file_is(photos: dict[str, Path]) -> None:
    picture = first_frame("p01")
    before = picture.copy()
    done = swap_photo(picture, Casting({"1": "Mei"}))
    assert (picture == before).all()
    assert (done.picture != before).any()
    assert [one.swapped for one in done.people] == [1]
    assert (swap_photo(picture, open_face("Mei")).picture == done.picture).all()


@pytest.mark.parametrize("arguments", [["--identity", "Mei"], ["--map", "left=Mei"]])
def test_a_photo_without_a_face_is_one_sentence(
    tmp_path: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    save_picture(tmp_path / "wall.png", np.full((90, 120, 3), 90, np.uint8))
    assert main(["swap", str(tmp_path / "wall.png"), *arguments, "-o", str(tmp_path / "out.png")]) == 2
    assert capsys.readouterr().err.startswith("error: no face is seen in wall.png")
    assert [path.name for path in tmp_path.iterdir()] == ["wall.png"]


def test_a_donor_without_a_face_is_one_sentence(
    photos: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_picture(tmp_path / "wall.png", np.full((90, 120, 3), 90, np.uint8))
    arguments = [str(photos["p01"]), "--identity", str(tmp_path / "wall.png")]
    assert main(["swap", *arguments, "-o", str(tmp_path / "out.png")]) == 2
    assert capsys.readouterr().err.startswith("error: no face found in wall.png")


def test_a_turned_face_is_skin_all_over() -> None:
    rgb = first_frame("p01")
    points = people_in_photo(Frame.from_rgb(rgb)).people[0].points[0].astype(np.float64)
    turned, shape = rgb.copy(), points.copy()
    frame = ReferenceFrame.canonical()
    for channel in range(3):
        turned[..., channel], shape = turn_head(rgb[..., channel], points, frame, 30.0)
    texture = person_in_photo(turned, shape, "Ann", anybody()).appearance.neutral_texture
    skin = skin_mask(anybody().reference)[anybody().reference.mask]
    assert texture[skin].max(1).min() > 0.3 * np.median(texture[skin])


@pytest.mark.parametrize("mode", range(3))
def test_an_expression_is_told_from_who_somebody_is(mode: int) -> None:
    prior = SolidPrior.shipped()
    pose = HeadPose(np.eye(3), 200.0, np.array([300.0, 300.0]))
    still = pose.apply(prior.mean)
    moved = pose.apply(prior.mean + 2 * prior.movement[mode])
    assert np.abs(at_rest(moved) - still).mean() < 0.5 * np.abs(moved - still).mean()
    assert np.abs(at_rest(still) - still).max() < 0.5
