"""The built-in landmarker on the sample people, on crowds, rolled, small and cut faces, and on what is no face."""

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import skimage.data

from guise.aam.landmarks import Face, LandmarkError, interocular, open_landmarker
from guise.aam.landmarks.builtin import DATA, BuiltinLandmarker, Calibration, calibration, cut
from guise.aam.landmarks.schemes import BELOW_BROWS, FOREHEAD, JAW, LIPS, NOSE_ROOT, NOSE_TIP
from guise.app.media import open_input
from training import definitions

SAMPLES = Path(__file__).parents[1] / "sample_videos"
SHARED = Path(__file__).parents[2] / "shared"
PEOPLE = ("p01", "p02", "p06")
FRAMES = (5, 60, 150)


@cache
def landmarker() -> BuiltinLandmarker:
    return BuiltinLandmarker()


@cache
def frames(person: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures (h, w, 3) and true points (81, 2) of some frames of a person's first clip."""
    truth = np.load(SAMPLES / person / "talk.npz")["landmarks"]
    truth = definitions.align_labels(truth, *definitions.load_alignment("rendered")).astype(float)
    with open_input(SAMPLES / person / "talk.mp4") as source:
        return [(f.rgb().copy(), truth[f.index]) for f in source if f.index in FRAMES]


def error(points: np.ndarray, truth: np.ndarray) -> float:
    """Mean distance in inter-ocular distances; the brows left out, whose points lie on the hair here."""
    rest = np.r_[JAW, BELOW_BROWS, FOREHEAD]
    return float(np.linalg.norm(points - truth, axis=1)[rest].mean() / interocular(truth))


def turned(picture: np.ndarray, points: np.ndarray, degrees: float, scale: float = 1.0):
    """A picture and points turned and scaled about the picture's middle."""
    h, w = picture.shape[:2]
    matrix = cv2.getRotationMatrix2D((w / 2 - 0.5, h / 2 - 0.5), degrees, scale)
    moved = cv2.warpAffine(picture, matrix, (w, h), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    return moved, points @ matrix[:, :2].T + matrix[:, 2]


@pytest.mark.parametrize("person", PEOPLE)
@pytest.mark.slow
def test_a_sample_person_is_found(person: str) -> None:
    for picture, truth in frames(person):
        faces = landmarker().detect(picture)
        assert len(faces) == 1
        assert error(faces[0].points, truth) < 0.045
        assert faces[0].confidence > 0.5
        assert faces[0].point_confidence is not None


@pytest.mark.parametrize("person", PEOPLE)
def test_refining_finds_the_face_again_from_a_rough_guess(person: str) -> None:
    for picture, truth in frames(person):
        eyes = interocular(truth)
        start = (truth - truth.mean(0)) * 1.08 + truth.mean(0) + 0.08 * eyes
        face = landmarker().refine(picture, Face.around(start, 0.9))
        assert face is not None
        assert error(face.points, truth) < min(0.045, 0.6 * error(start, truth))


def test_what_a_face_looks_like_is_asked_only_where_it_may_be_none(monkeypatch: pytest.MonkeyPatch) -> None:
    picture, truth = frames("p02")[0]
    asked, run = list[bool](), landmarker()._session.run
    monkeypatch.setattr(
        landmarker()._session, "run", lambda _, given: (asked.append(bool(given["looks"])), run(_, given))[1]
    )
    sure, unsure = (landmarker().refine(picture, Face.around(truth, known)) for known in (0.95, 0.5))
    assert asked == [False, True]
    assert sure is not None
    assert unsure is not None
    np.testing.assert_array_equal(sure.points, unsure.points)
    assert min(sure.confidence, unsure.confidence) >= 0.9
    assert abs(sure.confidence - unsure.confidence) < 0.02
    landmarker().refine(np.zeros_like(picture), Face.around(truth, 1.0))
    assert asked[2:] == [False, True]


@pytest.mark.parametrize("degrees", [-30, 30])
def test_a_rolled_head_is_found(degrees: float) -> None:
    picture, truth = turned(*frames("p06")[0], degrees)
    faces = landmarker().detect(picture)
    assert faces
    assert error(faces[0].points, truth) < 0.06


def test_a_small_face_is_found() -> None:
    picture, truth = frames("p01")[0]
    scale = 44 / np.ptp(truth[:, 0])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    face = landmarker().detect(small)[0]
    assert error(face.points, (truth + 0.5) * scale - 0.5) < 0.08


def test_a_huge_face_is_found() -> None:
    picture, truth = frames("p02")[0]
    scale = 1000 / np.ptp(truth[:, 0])
    huge = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    face = landmarker().detect(huge)[0]
    assert error(face.points, (truth + 0.5) * scale - 0.5) < 0.045


def test_every_face_of_a_group_is_found() -> None:
    row = np.concatenate([frames(person)[0][0] for person in PEOPLE], axis=1)
    faces = landmarker().detect(row)
    width = frames("p01")[0][0].shape[1]
    assert sorted(int(f.points[NOSE_TIP, 0] // width) for f in faces) == [0, 1, 2]
    areas = [f.area for f in faces]
    assert areas == sorted(areas, reverse=True)


@pytest.mark.slow
def test_a_hundred_faces_are_all_found() -> None:
    small = cv2.resize(frames("p02")[0][0][60:400, 150:490], (110, 110), interpolation=cv2.INTER_AREA)
    faces = landmarker().detect(np.ascontiguousarray(np.tile(small, (10, 10, 1))))
    assert len([face for face in faces if face.confidence >= 0.5]) == 100


@pytest.mark.parametrize("animal", ["cat", "chelsea"])
def test_an_animal_is_not_a_face(animal: str) -> None:
    faces = landmarker().detect(np.ascontiguousarray(getattr(skimage.data, animal)()[..., :3]))
    assert not [face for face in faces if face.confidence >= 0.5]


def test_a_face_cut_by_the_edge_keeps_its_visible_points() -> None:
    picture, truth = frames("p01")[0]
    edge = int(truth[NOSE_ROOT, 0] + 0.55 * interocular(truth))
    face = landmarker().refine(np.ascontiguousarray(picture[:, :edge]), Face.around(truth, 0.9))
    assert face is not None
    seen = truth[:, 0] < edge - 4
    miss = np.linalg.norm(face.points - truth, axis=1)[seen].mean() / interocular(truth)
    assert miss < 0.06


def test_hidden_points_have_less_confidence() -> None:
    picture, truth = frames("p02")[0]
    before = landmarker().refine(picture, Face.around(truth, 0.9))
    covered = picture.copy()
    low = truth[LIPS].min(0).astype(int) - 12
    high = truth[LIPS].max(0).astype(int) + 12
    covered[low[1] : high[1], low[0] : high[0]] = (70, 110, 60)
    after = landmarker().refine(covered, Face.around(truth, 0.9))
    assert before is not None
    assert before.point_confidence is not None
    assert after is not None
    assert after.point_confidence is not None
    assert after.point_confidence[LIPS].mean() < 0.8 * before.point_confidence[LIPS].mean()
    assert after.confidence < before.confidence


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((1, 1, 3), np.uint8),
        np.full((2, 300, 3), 255, np.uint8),
        np.zeros((480, 640, 3), np.uint8),
        np.full((480, 640, 3), 128, np.uint8),
        np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8),
        np.tile(np.arange(640, dtype=np.uint8)[None, :, None], (480, 1, 3)),
    ],
    ids=["pixel", "line", "black", "grey", "noise", "ramp"],
)
def test_no_face_is_invented(picture: np.ndarray) -> None:
    assert [f for f in landmarker().detect(picture) if f.confidence >= 0.5] == []


def test_refining_where_there_is_no_face_gives_none_or_a_low_confidence() -> None:
    _, truth = frames("p01")[0]
    empty = np.full((480, 640, 3), 90, np.uint8)
    face = landmarker().refine(empty, Face.around(truth, 0.9))
    assert face is None or face.confidence < 0.5


def test_a_cartoon_is_not_a_face() -> None:
    picture = np.full((300, 300, 3), 255, np.uint8)
    cv2.circle(picture, (150, 150), 100, (255, 220, 60), -1)
    for x in (115, 185):
        cv2.circle(picture, (x, 125), 12, (0, 0, 0), -1)
    cv2.ellipse(picture, (150, 180), (50, 30), 0, 0, 180, (0, 0, 0), 6)
    assert [f for f in landmarker().detect(picture) if f.confidence >= 0.5] == []


def test_grey_pictures_work() -> None:
    picture, truth = frames("p02")[1]
    grey = np.repeat(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    assert error(landmarker().detect(grey)[0].points, truth) < 0.05


def test_the_same_picture_gives_the_same_points() -> None:
    picture, _ = frames("p01")[0]
    first, second = landmarker().detect(picture)[0], BuiltinLandmarker().detect(picture)[0]
    np.testing.assert_array_equal(first.points, second.points)
    assert first.confidence == second.confidence


def test_it_opens_by_its_name_and_takes_another_detector() -> None:
    picture, truth = frames("p01")[0]
    other = open_landmarker("builtin@lbp")
    assert open_landmarker("builtin").name == other.name == "builtin"
    assert error(other.detect(picture)[0].points, truth) < 0.045
    with pytest.raises(LandmarkError, match="takes no argument"):
        open_landmarker("builtin:large")


def test_all_weights_are_small_and_described() -> None:
    models = sorted(DATA.glob("*.onnx"))
    assert sum(p.stat().st_size for p in models) <= 8e6
    for path in models:
        assert "Licence" in path.with_suffix(".md").read_text()
    assert set(json.loads((DATA / "landmarks.json").read_text())) == {"face", "sigma"}


def test_confidence_rises_with_certainty() -> None:
    table = calibration()
    sure = table.confidence(np.full(81, 1.0), 100, 6)
    assert sure > table.confidence(np.full(81, 6.0), 100, 6) > table.confidence(np.full(81, 6.0), 100, -6)
    points = Calibration((0, -1, 1), 1.0).of_points(np.array([1.0, 5.0, 50.0]), 100)
    np.testing.assert_allclose(points, 1 - np.exp(-0.5 * np.array([25, 1, 0.01])), rtol=1e-5)


@pytest.mark.parametrize(("side", "turn"), [(90, 0.0), (128, 0.4), (700, -0.3)])
def test_a_crop_and_its_map_agree(side: float, turn: float) -> None:
    ys, xs = np.mgrid[:800, :800]
    picture = np.stack([xs * 0.3, ys * 0.3, 0 * xs], axis=-1).astype(np.float32)
    crop, inverse = cut(np.asarray(picture, np.uint8), np.array([400.0, 380.0]), side, turn)
    for u, v in ((20, 30), (64, 64), (110, 90)):
        x, y = inverse @ (u, v, 1)
        np.testing.assert_allclose(crop[v, u, :2], (0.3 * x, 0.3 * y), atol=1.6)


@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="the shared data are not there")
def test_real_people_are_found() -> None:
    labels = np.load(SHARED / "data" / "real" / "room_s18.landmarks.npz")["face81"]
    with open_input(SHARED / "data" / "real" / "room_s18.mp4") as source:
        for frame in source:
            if frame.index % 60:
                continue
            faces = landmarker().detect(frame.rgb())
            assert len(faces) == 1
            assert error(faces[0].points, labels[frame.index, 0].astype(float)) < 0.08


@pytest.mark.parametrize("side", [90.0, 150.0, 700.0])
def test_a_view_of_a_grey_picture_is_cut_like_its_copy(side: float) -> None:
    grey = np.random.default_rng(0).integers(0, 256, (480, 640), np.uint8)
    view = np.broadcast_to(grey[..., None], (*grey.shape, 3))
    for turn in (0.0, 0.4):
        one, two = (cut(rgb, np.array([300.0, 200.0]), side, turn) for rgb in (view, view.copy()))
        np.testing.assert_array_equal(one[0], two[0])
        np.testing.assert_array_equal(one[1], two[1])


def test_a_look_in_a_box_gives_its_points_and_its_likeness_by_one_pass(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    landmarker = BuiltinLandmarker()
    with open_input(SAMPLES / "p01" / "talk.mp4") as media:
        rgb = next(iter(media)).rgb()
    [face] = landmarker.detect(rgb)
    boxes = [face.box, np.array([0, 0, 60, 60], np.float32)]
    known = [(landmarker.points_in_box(rgb, box), landmarker.likeness(rgb, box)) for box in boxes]
    first, calls = landmarker._first, []
    monkeypatch.setattr(landmarker, "_first", lambda *given: calls.append(given) or first(*given))
    looked = [landmarker.look_in_box(rgb, box) for box in boxes]
    assert len(calls) == 2
    assert [likeness for _, likeness in looked] == [likeness for _, likeness in known]
    assert looked[1][0] is known[1][0] is None
    np.testing.assert_array_equal(looked[0][0].points, known[0][0].points)


def test_the_likeness_alone_needs_no_points() -> None:
    picture, truth = frames("p02")[0]
    box = Face.around(truth, 1.0).box
    likeness = landmarker().likeness(picture, box)
    found, less = (landmarker()._first(picture, box, 0.0, points=points) for points in (True, False))
    assert found.is_usable
    assert np.isnan(less.points).all()
    assert less.logit == found.logit == likeness
