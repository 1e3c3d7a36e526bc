"""People learned from photos: marked as such, and mistakes in one sentence."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import cut, tags
from made_up import SAMPLES

from guise.aam.appearance import SHAPE_ENTRIES, appearance_vectors, sample_texture
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import LEFT_MOUTH_CORNER, RIGHT_MOUTH_CORNER
from guise.aam.model import Identity
from guise.aam.one_photo import person_in_photo, tracked, with_photos
from guise.aam.recognition import cosine_similarity, signature
from guise.aam.tracker import Fit
from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions
from guise.app.cli.main import main
from guise.app.media import open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import save_picture
from guise.app.photos.enrol_photos import are_photos, enrol_photos
from guise.app.swapping.donors import anybody, open_donor
from guise.app.swapping.file import swap_file

SMALL = TrainingOptions(frames=14, resolution=96, tracker=TrackerOptions(stages=2, copies=4, folds=2))


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """p06, at rest."""
    path = tmp_path_factory.mktemp("photo") / "ann.png"
    with open_input(SAMPLES / "p06" / "talk.mp4") as source:
        save_picture(path, next(iter(source)).rgb())
    return path


def test_a_photo_becomes_a_model_and_says_so(photo: Path, tmp_path: Path) -> None:
    said: list[str] = []
    report = enrol_photos([photo], tmp_path / "ann.guise", name="Ann", options=SMALL, say=said.append)
    made = Identity.load(tmp_path / "ann.guise")
    assert (report.clips, made.name, made.facts["made_from"]) == (("ann.png",), "Ann", "one photo")
    assert said[0].startswith("Enrolled from one photo: teeth, closed eyes and turned views are guessed")
    own, others = (cosine_similarity(signature(made), signature(open_donor(p))) for p in ("p06", "p03"))
    assert own > others

    clip = cut("p06", tmp_path / "clip.mp4", 4)
    report = swap_file(clip, made, tmp_path / "out.mp4", source=made)
    assert (report.swapped, report.lost) == (4, 0)
    assert tags(tmp_path / "out.mp4")["comment"].endswith("from one photo")


def test_the_tracker_of_a_photo_finds_the_person_again(photo: Path) -> None:
    points = open_landmarker("builtin").detect(read_deep(photo).rgb8())[0].points.astype(np.float64)
    made = tracked(person_in_photo(read_deep(photo).rgb8(), points, "Ann", anybody()), SMALL.tracker)
    luma, (width, shape) = cv2.imread(str(photo), 0), (np.ptp(points[:, 0]), made.rest_frame.shape)
    fit = made.tracker.fit(np.asarray(luma, np.uint8), shape + 0.04 * width)
    assert isinstance(fit, Fit)
    assert np.linalg.norm(fit.shape - shape, axis=1).mean() < 0.4 * 0.04 * width * np.sqrt(2)


def test_more_photos_add_what_they_show(photo: Path) -> None:
    rgb = read_deep(photo).rgb8()
    points = open_landmarker("builtin").detect(rgb)[0].points.astype(np.float64)
    one = person_in_photo(rgb, points, "Ann", anybody())
    smile = points.copy()
    smile[[RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER]] += (
        0.1 * np.ptp(points[:, 0]) * np.array([[-1, -1], [1, -1]])
    )
    more = with_photos(one, [(rgb, smile)])
    texture = sample_texture(rgb, smile, one.reference)
    shown = appearance_vectors(smile[None], texture[None], one.reference)[0]

    def missed(person: Identity) -> float:
        components = person.appearance.components
        left = shown - components.synthesise(components.project(shown))
        return float(np.linalg.norm(left[:SHAPE_ENTRIES]))

    assert missed(more) < 0.5 * missed(one)


def test_what_counts_as_photos(photo: Path, tmp_path: Path) -> None:
    assert are_photos([photo])
    assert are_photos([photo] * 9)
    assert not are_photos([photo] * 10)
    assert not are_photos([photo, SAMPLES / "p06" / "talk.mp4"])
    assert not are_photos([tmp_path / "missing.png"])


def test_a_picture_without_a_face_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open_input(SAMPLES / "p06" / "talk.mp4") as source:
        save_picture(tmp_path / "wall.png", next(iter(source)).rgb()[:60, :60])
    assert main(["enroll", str(tmp_path / "wall.png"), "-o", str(tmp_path / "wall.guise")]) == 2
    assert "error: " in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["wall.png"]


def test_options_of_landmarks_do_not_go_with_photos(photo: Path, tmp_path: Path) -> None:
    assert main(["enroll", str(photo), "-o", str(tmp_path / "a.guise"), "--landmarker", "builtin"]) == 2
