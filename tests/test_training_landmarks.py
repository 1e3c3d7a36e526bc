"""What the networks are trained on: samples, crops, parts."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from guise.aam.landmarks import MIRROR, interocular
from guise.aam.landmarks.schemes import (
    CHIN,
    LEFT_EYE_OUTER,
    NOSE_ROOT,
    NOSE_TIP,
    RIGHT_EYE_OUTER,
    mean_geometry,
)
from training import augment
from training.clutter import clutter
from training.crops import plain_crops
from training.data import Pictures, by_hands, load_parts, square
from training.parsing_labels import encode

RNG = np.random.default_rng(0)
COLOURS = RNG.integers(60, 256, (81, 3))


def face(size: int = 176, scale: float = 70.0) -> np.ndarray:
    mean = mean_geometry().mean
    points = scale * np.stack([mean.real, mean.imag], axis=-1)
    return (points + size / 2 - (points.min(0) + points.max(0)) / 2).astype(np.float32)


def pictures(count: int = 3, size: int = 176) -> Pictures:
    """Grey squares with a bright dot at point 30 only."""
    points = np.stack([face(size) + 3 * k for k in range(count)])
    images = np.full((count, size, size, 3), 60, np.uint8)
    for image, shape in zip(images, points, strict=True):
        cv2.circle(
            image,
            tuple(np.round(shape[NOSE_TIP] * 16).astype(int)),
            3 * 16,
            (255, 255, 255),
            -1,
            cv2.LINE_AA,
            4,
        )
    seen = np.ones((count, 81), bool)
    masks = np.packbits(np.ones((count, size, size), np.uint8), axis=2)
    person = np.array(["r00001"] * count)
    return Pictures(images, points, seen, masks, person, np.zeros((count, 0), np.float32))


BACKGROUNDS = np.stack([clutter(np.random.default_rng(k), 192) for k in range(4)])


PROPS = augment.Props(BACKGROUNDS)


def test_a_sample_is_the_same_for_the_same_seed() -> None:
    source = pictures()
    both = []
    for _ in range(2):
        cv2.setRNGSeed(3)
        rng = np.random.default_rng(11)
        both.append([augment.sample(rng, source[0], PROPS) for _ in range(8)])
    for first, second in zip(*both, strict=True):
        for name in ("crop", "points", "seen", "maps"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_points_stay_on_what_they_mark_through_turns_and_mirrors() -> None:
    source = pictures()
    rng = np.random.default_rng(2)
    handed = set()
    for _ in range(20):
        matrix, mirrored = augment.crop_matrix(rng, source.points[0], augment.Strength())
        crop = cv2.warpAffine(source.images[0], matrix, (augment.SIZE, augment.SIZE))
        ys, xs = np.nonzero(crop[..., 0] > 200)
        place = matrix @ (*source.points[0][NOSE_TIP], 1)
        assert np.hypot(xs.mean() - place[0], ys.mean() - place[1]) < 0.6
        handed.add(mirrored)
        points = source.points[0] @ matrix[:, :2].T + matrix[:, 2]
        points = points[list(MIRROR)] if mirrored else points
        across, down = points[LEFT_EYE_OUTER] - points[RIGHT_EYE_OUTER], points[CHIN] - points[NOSE_ROOT]
        assert across[0] * down[1] - across[1] * down[0] > 0  # the person's right eye is on the left again
    assert handed == {True, False}


def test_samples_vary_and_stay_pictures() -> None:
    source = pictures()
    rng = np.random.default_rng(4)
    crops = []
    for k in range(60):
        made = augment.sample(rng, source[k % 3], PROPS)
        assert made.crop.shape == (128, 128, 3)
        assert made.crop.dtype == np.uint8
        assert np.isfinite(made.points).all()
        inside = (made.points > -0.5).all(1) & (made.points < 127.5).all(1)
        assert not (made.seen & ~inside).any()
        assert not made.exact  # nothing is known of what these pictures show
        assert (made.maps.sum(0) > 0).all()
        crops.append(made.crop)
    assert len({c.tobytes() for c in crops}) == 60
    for _ in range(30):
        assert augment.negative(rng, source.images[0], source.points[0], BACKGROUNDS).shape == (128, 128, 3)


def test_plain_crops_hold_the_whole_face_upright() -> None:
    crops, points = plain_crops(pictures(), 3)
    assert crops.shape == (3, 128, 128, 3)
    assert points.min() > 0
    assert points.max() < 127
    slope = (points[:, LEFT_EYE_OUTER] - points[:, RIGHT_EYE_OUTER]) / interocular(points)[:, None]
    assert np.abs(slope[:, 1]).max() < 0.3


def test_a_square_keeps_face_and_points_together() -> None:
    image = np.zeros((900, 1200, 3), np.uint8)
    shape = face(176, 250.0) + 400
    cv2.circle(image, tuple(np.round(shape[CHIN]).astype(int)), 25, (255, 255, 255), -1)
    small, points = square(image, shape)
    ys, xs = np.nonzero(small[..., 0] > 128)
    assert np.hypot(xs.mean() - points[CHIN, 0], ys.mean() - points[CHIN, 1]) < 1
    assert np.ptp(points, axis=0).max() == pytest.approx(208 / (1.29 * 1.25))


def write_part(file: Path, source: Pictures, person: list[int]) -> None:
    """A part as the renderer writes it: labels are 1.5 times the picture's size."""
    jpegs = [cv2.imencode(".jpg", np.asarray(image)[..., ::-1])[1].tobytes() for image in source.images]
    size = source.images[0].shape[0]
    labels = [encode(np.full((3 * size // 2,) * 2, 1 + k, np.uint8)) for k in range(len(source))]
    up = ["eyebrows-left-up", "eyebrows-right-up", "eyebrows-left-down", "eyebrows-right-down"]
    np.savez(
        file, jpeg=np.frombuffer(b"".join(jpegs), np.uint8), length=np.array([len(j) for j in jpegs], np.int32),
        labels=np.frombuffer(b"".join(labels), np.uint8),
        labels_length=np.array([len(b) for b in labels], np.int32), face81=source.points, visible=source.visible,
        mask=source.masks, person=np.array(person), attributes=np.zeros((len(source), 2), np.float32),
        attribute_names=np.array(["male", "age"]), iris=np.ones((len(source), 2, 3), np.float32),
        pose=np.zeros((len(source), 3), np.float32), expression_names=np.array(up),
        expression=np.tile(np.array([0.5, 1, 0, 0], np.float16), (len(source), 1)),
    )  # fmt: skip


def test_parts_are_read_and_held_out_people_kept_apart(tmp_path: Path) -> None:
    source = pictures(4)
    write_part(tmp_path / "part_00000.npz", source, [0, 1, 2, 10])
    training, unseen = load_parts(tmp_path, held_out=False), load_parts(tmp_path, held_out=True)
    assert list(training.person) == ["r00001", "r00002"]
    assert list(unseen.person) == ["r00000", "r00010"]
    assert np.abs(training.images[0].astype(int) - source.images[1]).mean() < 2
    np.testing.assert_array_equal(training.points, source.points[1:3])
    one = training[1]
    assert one.labels is not None
    assert (one.labels == 3).all()
    assert one.mask is not None
    assert one.mask.shape == (176, 176)
    assert training.attribute_names[2:] == ("brows_up", "brows_down")
    np.testing.assert_array_equal(training.attributes[:, 2:], [[1, 0]] * 2)
    assert list(training.only(np.array([False, True])).person) == ["r00002"]
    with pytest.raises(FileNotFoundError, match="render_people"):
        load_parts(tmp_path / "nothing", held_out=False)


def test_pictures_with_a_rendered_hand_are_told_from_those_without() -> None:
    source = pictures(3)
    assert [len(part) for part in by_hands(source)] == [3, 0]
    known = replace(source, attributes=np.array([[0.0], [1.0], [0.0]], np.float32), attribute_names=("hand",))
    clear, held = by_hands(known)
    np.testing.assert_array_equal(clear.points, source.points[[0, 2]])
    np.testing.assert_array_equal(held.points, source.points[[1]])
