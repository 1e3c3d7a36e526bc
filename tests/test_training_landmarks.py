"""What the landmarker is trained on: samples, crops, parts; the network where PyTorch is installed."""

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
from training.data import Pictures, load_parts, square

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
    masks = np.ones((count, size, size), np.uint8)
    return Pictures(
        images, points, seen, masks, np.array(["r00001"] * count), np.zeros((count, 0), np.float32)
    )


BACKGROUNDS = np.stack([clutter(np.random.default_rng(k), 192) for k in range(4)])


def test_a_sample_is_the_same_for_the_same_seed() -> None:
    source = pictures()
    both = []
    for _ in range(2):
        cv2.setRNGSeed(3)
        rng = np.random.default_rng(11)
        both.append(
            [
                augment.sample(rng, source.images[0], source.points[0], source.visible[0], None, BACKGROUNDS)
                for _ in range(5)
            ]
        )
    for first, second in zip(*both, strict=True):
        for a, b in zip(first, second, strict=True):
            np.testing.assert_array_equal(a, b)


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
        crop, points, seen = augment.sample(
            rng,
            source.images[k % 3],
            source.points[k % 3],
            source.visible[k % 3],
            source.masks[k % 3],
            BACKGROUNDS,
        )
        assert crop.shape == (128, 128, 3)
        assert crop.dtype == np.uint8
        assert np.isfinite(points).all()
        inside = (points > -0.5).all(1) & (points < 127.5).all(1)
        assert not (seen & ~inside).any()
        crops.append(crop)
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
    small, points = square(image, shape, 208)
    ys, xs = np.nonzero(small[..., 0] > 128)
    assert np.hypot(xs.mean() - points[CHIN, 0], ys.mean() - points[CHIN, 1]) < 1
    assert np.ptp(points, axis=0).max() == pytest.approx(0.62 * 208)


def test_parts_are_read_and_held_out_people_kept_apart(tmp_path: Path) -> None:
    source = pictures(4)
    jpegs = [cv2.imencode(".jpg", image[..., ::-1])[1].tobytes() for image in source.images]
    np.savez(
        tmp_path / "part_00000.npz", jpeg=np.frombuffer(b"".join(jpegs), np.uint8),
        length=np.array([len(j) for j in jpegs], np.int32), face81=source.points, visible=source.visible,
        mask=np.packbits(source.masks, axis=2), person=np.array([0, 1, 2, 10]), attributes=np.zeros((4, 2), np.float32),
        attribute_names=np.array(["male", "age"]),
    )  # fmt: skip
    training, unseen = load_parts(tmp_path, held_out=False), load_parts(tmp_path, held_out=True)
    assert list(training.person) == ["r00001", "r00002"]
    assert list(unseen.person) == ["r00000", "r00010"]
    assert np.abs(training.images[0].astype(int) - source.images[1]).mean() < 2
    np.testing.assert_array_equal(training.points, source.points[1:3])
    with pytest.raises(FileNotFoundError, match="render_people"):
        load_parts(tmp_path / "nothing", held_out=False)


def test_the_network_finds_a_dot_after_a_few_steps() -> None:
    torch = pytest.importorskip("torch", reason="PyTorch is for training only")
    from training.landmark_net import LandmarkNet
    from training.train_landmarks import loss_of

    torch.manual_seed(0)
    net = LandmarkNet(width=4, blocks=(0, 0, 0), head=8)
    crops, points = plain_crops(pictures(), 3)
    batch = torch.from_numpy(crops), torch.from_numpy(points), torch.ones(3)
    optimiser = torch.optim.Adam(net.parameters(), 3e-3)
    losses = []
    for _ in range(25):
        loss, figures = loss_of(net, *batch)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(figures["error_px"])
    assert losses[-1] < 0.7 * losses[0]
    points_out, sigma, logit = net.eval()(batch[0])
    assert points_out.shape == (3, 81, 2)
    assert sigma.shape == (3, 81)
    assert (sigma > 0).all()
    assert logit.shape == (3,)
