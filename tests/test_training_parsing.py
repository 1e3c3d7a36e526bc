"""Labels of what a crop shows stay exact: maps, occluders, beards and glasses; how they are measured."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from guise.aam.landmarks.schemes import (
    CHIN,
    IBUG68,
    INNER_LIPS,
    LEFT_EYE,
    LOWER_LIP_BOTTOM,
    NOSE_ROOT,
    NOSE_TIP,
    OUTER_LIPS,
    RIGHT_EYE,
    RIGHT_EYE_INNER,
    RIGHT_EYE_OUTER,
    UPPER_LIP_TOP,
    mean_geometry,
)
from guise.aam.parsing import CELLS, HEAD_FRAMING
from training import occluders
from training.augment import HEADS, Props, plain, sample
from training.canvas import SIZE, Canvas, Sample, class_maps, possible_maps
from training.clutter import clutter
from training.data import Labelled
from training.hair import dye
from training.hands import HandBeforeFace, view
from training.measure import Answers, figures_of, iou, iris_errors
from training.parsing_labels import (
    BACKGROUND,
    CLASSES,
    EYES,
    FACIAL_HAIR,
    HAIR,
    INNER_MOUTH,
    LIPS,
    OCCLUDER,
    SKIN,
    decode,
    encode,
    skin_regions,
)
from training.props import STYLES, _outwards, beard_area, beard_texture, rim, tube
from training.real_occluders import load_outlined, outlined_figures

SIDE = 176
PROPS = Props(np.stack([clutter(np.random.default_rng(k), 192) for k in range(3)]))


def points(size: float = 70.0, centre: float = SIDE / 2) -> np.ndarray:
    mean = mean_geometry().mean
    shape = size * np.stack([mean.real, mean.imag], axis=-1)
    return (shape + centre - (shape.min(0) + shape.max(0)) / 2).astype(np.float32)


def labelled() -> Labelled:
    """A face whose skin is grey, eyes white and lips dark, labels to match at 1.5 times the size."""
    shape = points()
    labels = np.full((3 * SIDE // 2,) * 2, BACKGROUND, np.uint8)
    image = np.full((SIDE, SIDE, 3), 200, np.uint8)
    iris = []
    for outline, kind, grey in (
        (cv2.convexHull(shape)[:, 0], SKIN, 120),
        (shape[RIGHT_EYE], EYES, 250),
        (shape[LEFT_EYE], EYES, 250),
        (shape[OUTER_LIPS], LIPS, 30),
    ):
        places = np.round(((outline + 0.5) * 1.5 - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(labels, [places], kind, shift=4)
        cv2.fillPoly(image, [np.round(outline * 16).astype(np.int32)], (grey,) * 3, shift=4)
    for eye in (shape[RIGHT_EYE], shape[LEFT_EYE]):
        iris.append((*eye.mean(0), 3.0))
    visible = np.ones(81, bool)
    mask = np.ones((SIDE, SIDE), np.uint8)
    return Labelled(image, shape, visible, mask, labels, np.array(iris, np.float32))


def test_maps_lie_on_what_they_mark() -> None:
    labels = np.zeros((264, 264), np.uint8)
    cv2.circle(labels, (150, 90), 20, LIPS, -1)
    matrix = np.array([[0.8, -0.1, 10.0], [0.1, 0.8, -5.0]])
    maps = class_maps(labels, SIDE, matrix, cv2.BORDER_REPLICATE)
    np.testing.assert_allclose(maps.sum(0), 1, atol=1e-5)
    ys, xs = np.mgrid[:CELLS, :CELLS]
    weight = maps[LIPS] / maps[LIPS].sum()
    found = 2 * np.array([(xs * weight).sum(), (ys * weight).sum()]) + 0.5  # cells to pixels of the crop
    true = (np.array([150, 90]) + 0.5) / 1.5 - 0.5
    np.testing.assert_allclose(found, matrix[:, :2] @ true + matrix[:, 2], atol=0.15)


def test_samples_of_labelled_people_are_exact_and_sum_to_one() -> None:
    rng, one = np.random.default_rng(0), labelled()
    opened = 0
    for _ in range(40):
        made = sample(rng, one, PROPS)
        assert made.exact
        np.testing.assert_allclose(made.maps.sum(0), 1, atol=2e-3)
        assert made.maps.min() >= 0
        opened += int(made.iris_seen.sum())
    assert 20 < opened <= 80


def test_a_crop_of_a_head_holds_what_is_around_it() -> None:
    made = plain(np.random.default_rng(2), labelled(), framing=HEAD_FRAMING)
    size = np.ptp(made.points, axis=0).max()
    assert size == pytest.approx(SIZE / HEAD_FRAMING.side, rel=0.2)
    middle = (made.points.min(0) + made.points.max(0)) / 2
    raised = (SIZE - 1) / 2 - HEAD_FRAMING.drop / HEAD_FRAMING.side * SIZE
    np.testing.assert_allclose(middle, [(SIZE - 1) / 2, raised], atol=9)


def test_longer_and_other_hair_is_labelled_as_hair() -> None:
    rng, longer = np.random.default_rng(3), replace(HEADS, hair=1.0, hidden=0.0)
    shares = []
    for _ in range(12):
        made = sample(rng, labelled(), PROPS, longer)
        np.testing.assert_allclose(made.maps.sum(0), 1, atol=2e-3)
        shares.append(made.maps[HAIR].mean())
    assert np.median(shares) > 0.02
    canvas = canvas_of_hair(40)
    dye(np.random.default_rng(0), canvas)
    left, right = canvas.crop[:, :60].mean((0, 1)), canvas.crop[:, 70:].mean((0, 1))
    assert np.abs(left - 40).max() > 10
    np.testing.assert_allclose(right, 40, atol=1)


def canvas_of_hair(grey: int) -> Canvas:
    """A grey crop whose left half is hair."""
    maps = np.zeros((len(CLASSES), CELLS, CELLS), np.float32)
    maps[HAIR, :, : CELLS // 2] = 1
    maps[BACKGROUND, :, CELLS // 2 :] = 1
    crop = np.full((SIZE, SIZE, 3), grey, np.uint8)
    return Canvas(crop, points(), np.ones(81, bool), np.zeros((2, 3), np.float32), False, maps, True)


def test_an_open_iris_lies_in_the_eyes_of_the_map() -> None:
    made = plain(np.random.default_rng(1), labelled())
    assert made.iris_seen.all()
    for x, y, _ in made.iris:
        assert made.maps[EYES, round((y + 0.5) / 2 - 0.5), round((x + 0.5) / 2 - 0.5)] > 0.9


def test_what_is_put_before_a_face_hides_it() -> None:
    canvas = start()
    alpha = np.zeros((SIZE, SIZE), np.uint8)
    alpha[:, : SIZE // 2] = 255
    canvas.put(np.full((SIZE, SIZE, 3), 77, np.uint8), alpha, OCCLUDER)
    made = canvas.finish()
    assert (made.crop[:, :60] == 77).all()
    np.testing.assert_allclose(made.maps[OCCLUDER, :, :31], 1, atol=1e-3)
    assert not made.seen[made.points[:, 0] < 60].any()
    assert made.seen[made.points[:, 0] > 68].all()
    assert list(made.iris_seen) == [False, True]


def start() -> Canvas:
    shape = points(50.0, SIZE / 2)
    maps = np.zeros((len(CLASSES), CELLS, CELLS), np.float32)
    maps[EYES] = 1
    iris = np.array([(*shape[RIGHT_EYE].mean(0), 3), (*shape[LEFT_EYE].mean(0), 3)], np.float32)
    crop = np.full((SIZE, SIZE, 3), 128, np.uint8)
    return Canvas(crop, shape, np.ones(81, bool), iris, True, maps, True)


@pytest.mark.parametrize(
    "maker",
    [
        occluders._fingers, occluders._mug, occluders._microphone, occluders._card, occluders._blob, occluders._mask,
        occluders._cloth,
    ],
)  # fmt: skip
def test_every_thing_is_a_picture_with_an_opacity(maker: Any) -> None:
    rng, shares = np.random.default_rng(5), []
    for _ in range(20):
        picture, alpha = maker(rng, start(), lambda: np.full((SIZE, SIZE, 3), 9, np.uint8))
        assert picture.shape == (SIZE, SIZE, 3)
        assert picture.dtype == alpha.dtype == np.uint8
        assert alpha.shape == (SIZE, SIZE)
        shares.append((alpha > 127).mean())
    assert 0.01 < np.mean(shares) < 0.8


def test_the_map_of_an_occluder_is_what_changed_in_the_picture() -> None:
    rng = np.random.default_rng(8)
    hand = occluders.Cutout(np.full((60, 40, 4), 255, np.uint8), 40.0, np.array([20.0, 20.0]))
    for _ in range(20):
        canvas = start()
        occluders.occluder(rng, canvas, lambda: np.full((SIZE, SIZE, 3), 9, np.uint8), [hand])
        shown = cv2.resize(canvas.maps[OCCLUDER], (SIZE, SIZE), interpolation=cv2.INTER_NEAREST)
        clear = shown < 1e-3
        assert (canvas.crop[clear] <= 129).all()  # at most a shadow


def test_hands_are_as_large_as_they_are_before_a_face_however_finely_drawn() -> None:
    rng, canvas, shares = np.random.default_rng(3), start(), []
    extent = np.linalg.norm(canvas.points[CHIN] - canvas.points[NOSE_ROOT])
    for side in (50, 150):
        decimetre = occluders.Cutout(np.full((side, side, 4), 255, np.uint8), side, np.full(2, side / 2))
        layers = [occluders._hand(rng, canvas, decimetre, canvas.points[NOSE_TIP]) for _ in range(60)]
        shares.append(np.sqrt(np.mean([(alpha > 127).sum() for _, alpha in layers])))
    assert shares[0] == pytest.approx(shares[1], rel=0.1)
    assert shares[0] == pytest.approx(extent / occluders.EXTENT_DECIMETRES, rel=0.25)


def test_possible_maps_allow_what_the_points_say() -> None:
    shape = points(60.0, SIZE / 2)
    shape[INNER_LIPS] += (shape[INNER_LIPS] - shape[INNER_LIPS].mean(0)) * (0, 3)  # an open mouth
    shape[OUTER_LIPS] += (shape[OUTER_LIPS] - shape[OUTER_LIPS].mean(0)) * (0, 1.5)
    maps = possible_maps(shape)
    assert set(np.unique(maps)) == {0, 1}
    assert (maps.sum(0) > 0).all()

    def at(place: np.ndarray) -> list[int]:
        x, y = np.round((place + 0.5) / 2 - 0.5).astype(int)
        return list(np.flatnonzero(maps[:, y, x]))

    assert at(shape[INNER_LIPS].mean(0)) == [INNER_MOUTH]
    assert SKIN in at(shape[NOSE_TIP])
    assert BACKGROUND not in at(shape[NOSE_TIP])
    assert BACKGROUND in at(np.array([1.0, 1.0]))
    assert OCCLUDER not in np.flatnonzero(maps.any((1, 2)))


def test_iou_counts_what_both_share() -> None:
    truth = np.array([0, 0, 1, 1, 9])
    found = np.array([0, 1, 1, 1, 0])
    each = iou(found, truth)
    np.testing.assert_allclose(each[[0, 1, 9]], [1 / 3, 2 / 3, 0])
    assert np.isnan(each[2])


def test_perfect_answers_have_no_error() -> None:
    made = [plain(np.random.default_rng(k), labelled()) for k in range(3)]
    figures = figures_of(lambda crops: perfect(made), made)
    assert figures["points"] == 0
    assert figures["iris"] == pytest.approx(0, abs=1e-4)
    assert figures["iou"] == 1
    off = perfect(made)
    assert off.iris is not None
    off.iris[:, :, 0] += np.linalg.norm(made[0].points[RIGHT_EYE_OUTER] - made[0].points[RIGHT_EYE_INNER])
    centre, _ = iris_errors(off, made)
    assert centre.mean() == pytest.approx(100, rel=0.15)


def perfect(samples: list[Sample]) -> Answers:
    n = len(samples)
    iris = np.concatenate([np.stack([s.iris for s in samples]), np.ones((n, 2, 1), np.float32)], 2)
    places = np.stack([s.points for s in samples])
    maps = np.stack([s.maps for s in samples])
    return Answers(places, np.ones((n, 81), np.float32), np.ones(n, np.float32), iris, maps)


def test_labels_survive_their_encoding() -> None:
    labels = np.random.default_rng(0).integers(0, 10, (66, 50)).astype(np.uint8)
    np.testing.assert_array_equal(decode(np.frombuffer(encode(labels), np.uint8)), labels)


def test_regions_of_the_skin_hold_lips_about_the_mouth() -> None:
    uv = points(0.3, 0.5)[IBUG68].astype(float) * (1, -1) + (0, 1)
    regions = skin_regions(uv)
    x, y = ((uv[[UPPER_LIP_TOP, LOWER_LIP_BOTTOM]].mean(0) * (1, -1) + (0, 1)) * len(regions)).astype(int)
    assert regions[y, x] in (LIPS, INNER_MOUTH)
    assert regions[0, 0] == SKIN
    assert (regions == LIPS).sum() > (regions == INNER_MOUTH).sum()


@pytest.mark.parametrize("style", STYLES)
def test_beards_grow_about_the_lips_and_not_on_them(style: str) -> None:
    uv = points(0.3, 0.5)[IBUG68].astype(float) * (1, -1) + (0, 1)
    area = beard_area(uv, style, 512)
    texture = beard_texture(np.random.default_rng(0), area, 0.1)
    assert 0.0005 < (area > 0.5).mean() < 0.2

    def there(place: np.ndarray) -> float:
        x, y = ((place * (1, -1) + (0, 1)) * 512).astype(int)
        return float(area[y, x])

    assert there(uv[OUTER_LIPS].mean(0)) < 0.2
    assert there(uv[NOSE_ROOT]) == 0
    assert (there(uv[CHIN]) > 0.5) == (style != "moustache")
    assert texture.shape == (512, 512, 4)
    assert (texture[..., 3] <= np.ceil(255 * area)).all()


def test_tubes_face_outwards() -> None:
    flat = rim(2.0, 1.0, 3.0, 0.1)
    path = np.column_stack([flat, np.zeros(len(flat))])
    places, normals, tri = tube(path, 0.1, 0.1, closed=True)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    tri = _outwards(places, normals, tri)
    a, b, c = (places[tri[:, k]] for k in range(3))
    assert ((np.cross(b - a, c - a) * normals[tri].mean(1)).sum(1) > 0).all()
    np.testing.assert_allclose(
        np.linalg.norm(places.reshape(len(path), 8, 3) - path[:, None], axis=2), 0.05, atol=1e-6
    )


def test_facial_hair_does_not_hide_points() -> None:
    canvas = start()
    canvas.put(np.zeros((SIZE, SIZE, 3), np.uint8), np.full((SIZE, SIZE), 255, np.uint8), FACIAL_HAIR)
    assert canvas.finish().seen.all()


def test_outlined_crops_are_measured_without_what_is_left_out(tmp_path: Path) -> None:
    square = [[-0.5, -0.5], [63.5, -0.5], [63.5, 127.5], [-0.5, 127.5]]
    beyond = [[63.5, -0.5], [95.5, -0.5], [95.5, 127.5], [63.5, 127.5]]
    whole = [[-0.5, -0.5], [127.5, -0.5], [127.5, 127.5], [-0.5, 127.5]]
    row = {
        "clip": "one",
        "frame": 0,
        "crop": [100, 100, 64, 0],
        "hull": whole,
        "occluder": [square],
        "ignore": [beyond],
    }
    (tmp_path / "labels.json").write_text(json.dumps([row, row | {"clip": "absent"}]))
    writer = cv2.VideoWriter(str(tmp_path / "one.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (200, 200))
    writer.write(np.full((200, 200, 3), 50, np.uint8))
    writer.release()
    given = load_outlined(tmp_path, tmp_path / "labels.json")
    assert given.crops.shape == (1, SIZE, SIZE, 3)
    parsing = np.zeros((1, len(CLASSES), CELLS, CELLS), np.float32)
    parsing[:, SKIN] = 0.5
    parsing[:, OCCLUDER, :, 2:44] = 1
    figures = outlined_figures(parsing, given)
    assert figures["occluder_iou"] == pytest.approx(30 / 32, abs=0.04)
    assert figures["false_occluder"] < 1
    with pytest.raises(FileNotFoundError, match=r"labels\.json"):
        load_outlined(tmp_path / "nowhere", tmp_path / "labels.json")


def euler(yaw: float, pitch: float, roll: float) -> np.ndarray:
    turns = ((0, yaw, 0), (-pitch, 0, 0), (0, 0, roll))
    rotations = [cv2.Rodrigues(np.radians(turn))[0] for turn in turns]
    return np.asarray(rotations[0] @ rotations[1] @ rotations[2])


class FlatHand:
    """Four fingers along x, the palm down, as an arm that is stretched out sideways."""

    middle, along, palm = np.array([6.0, 4.0, 0.0]), np.array([1.0, 0, 0]), np.array([0, -1.0, 0])

    def __init__(self) -> None:
        self.surface = SimpleNamespace(positions=lambda v: v, normals=lambda v: v)

    def posed(self, rng: np.random.Generator) -> np.ndarray:
        tips = self.middle + self.along + np.array([0, 0, 1.0]) * np.linspace(-0.4, 0.4, 4)[:, None]
        return np.vstack([self.middle, tips])


def test_hands_are_seen_with_their_fingers_up() -> None:
    rng = np.random.default_rng(0)
    facing = []
    for _ in range(20):
        turn = view(rng, FlatHand(), euler, (0, 0, 0))
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1)
        np.testing.assert_allclose(turn @ FlatHand.along, (0, 1, 0), atol=1e-9)
        facing.append((turn @ FlatHand.palm)[2])
    assert {round(z) for z in facing} == {-1, 1}


def test_rendered_hands_are_held_before_the_face() -> None:
    rng, uploads = np.random.default_rng(1), []
    actor = SimpleNamespace(upload=lambda surfaces, camera: uploads.append(surfaces["prop"][0]))
    mean = mean_geometry().mean
    face = np.column_stack([mean.real, -mean.imag, np.zeros(81)])
    face[NOSE_TIP, 2] = 0.3
    before = HandBeforeFace(FlatHand(), actor, euler)
    for _ in range(200):
        before.place(rng, face, None)
    v = np.array(uploads)
    spans = np.linalg.norm(v[:, 1:] - v[:, :1], axis=2)
    np.testing.assert_allclose(spans, spans[:1].repeat(200, 0))  # as large as it is
    assert (v[:, :, 2].max(1) > face[:, 2].min()).all()
    assert v[:, 1:, 1].mean() > v[:, 0, 1].mean()  # mostly from below
    low, high = face[:, :2].min(0) - 1, face[:, :2].max(0) + 1
    assert ((v[..., :2] > low) & (v[..., :2] < high)).all(2).any(1).mean() > 0.95
