"""Detail of a face at rest: frames are registered before they are averaged."""

import cv2
import numpy as np
import pytest

from guise.aam.detail import FINE, LIMITS, FineGrid, registered_mean, with_detail
from guise.aam.landmarks.schemes import INNER_LIPS
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.reference import ReferenceFrame

FRAME = ReferenceFrame.canonical(64)
SIZE = FINE * FRAME.size[0], FINE * FRAME.size[1]


def skin(seed: int, sigma: float = 1.2) -> np.ndarray:
    """A luma picture of blobs, on the fine grid."""
    noise = np.random.default_rng(seed).normal(size=SIZE).astype(np.float32)
    blobs = cv2.GaussianBlur(noise, (0, 0), sigma)
    return 120 + 15 * blobs / blobs.std()


def shifted(picture: np.ndarray, x: float, y: float) -> np.ndarray:
    matrix = np.array([[1, 0, x], [0, 1, y]])
    return cv2.warpAffine(
        picture, matrix, picture.shape[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
    )


def likeness(a: np.ndarray, b: np.ndarray) -> float:
    """Slope of a picture over another, in what is finer than a blur: 1 is as sharp."""
    fine_a, fine_b = (p - cv2.GaussianBlur(p, (0, 0), 3) for p in (a, b))
    inside = np.s_[16:-16, 16:-16]
    return float((fine_a[inside] * fine_b[inside]).sum() / (fine_b[inside] ** 2).sum())


def test_misplaced_frames_are_averaged_without_loss_of_sharpness() -> None:
    truth = skin(0)
    frames = [shifted(truth, x, y) for x, y in [(2, 0.5), (-2, 0.5), (0.5, -2), (-0.5, 1)]]
    plain = np.mean(frames, axis=0)
    assert likeness(plain, truth) < 0.6
    assert likeness(registered_mean(plain, frames, SIZE[1]), truth) > 0.85


@pytest.fixture(scope="module")
def sharpened() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The true luma, a blurred neutral texture, and that texture and its detail after `with_detail`."""
    truth = skin(1)
    blurred = cv2.resize(cv2.GaussianBlur(truth, (0, 0), 3), FRAME.size[::-1], interpolation=cv2.INTER_AREA)
    texture = np.repeat(blurred[FRAME.mask][:, None], 3, axis=1)
    frames = [1.2 * truth - 10, truth + 20, truth]
    mask = FRAME.mask.copy()
    mask[: FRAME.size[0] // 4] = False
    return truth, texture, *with_detail(texture, frames, mask, FRAME)


def test_the_neutral_face_gets_the_frames_sharpness_but_not_their_light(
    sharpened: tuple[np.ndarray, ...],
) -> None:
    truth, before, after, detail = sharpened
    drawn = cv2.resize(FRAME.scatter(after @ LUMA), SIZE[::-1], interpolation=cv2.INTER_LINEAR) + detail
    cheek = np.s_[60:80, 20:40]
    fine, true = (p - cv2.GaussianBlur(p, (0, 0), 3) for p in (drawn, truth))
    assert np.corrcoef(fine[cheek].ravel(), true[cheek].ravel())[0, 1] > 0.8
    assert fine[cheek].std() > 0.75 * true[cheek].std()
    assert abs((after - before).mean()) < 0.5


def test_nothing_is_added_in_hair_and_between_the_lips(sharpened: tuple[np.ndarray, ...]) -> None:
    _, before, after, detail = sharpened
    change = FRAME.scatter(np.abs(after - before).max(1))
    assert change[: FRAME.size[0] // 4 - 2].max() == 0
    assert change[soft_parts(FRAME, (INNER_LIPS,), 0.0) > 0.999].max(initial=0) < 0.1
    assert np.abs(detail[: FINE * (FRAME.size[0] // 4 - 2)]).max() == 0


def test_a_bright_background_beside_the_face_stays_outside() -> None:
    reach = round(0.03 * SIZE[1])  # by which landmarks and flow may miss
    face = cv2.erode(
        cv2.resize(FRAME.mask.astype(np.uint8), SIZE[::-1], interpolation=cv2.INTER_NEAREST),
        np.ones((2 * reach + 1,) * 2, np.uint8),
    )
    frames = [np.where(shifted(face, x, 0) > 0, 60.0, 240.0).astype(np.float32) for x in (-1.0, 0.5, 1.0)]
    texture = np.full((FRAME.mask.sum(), 3), 60, np.float32)
    after, detail = with_detail(texture, frames, FRAME.mask, FRAME)
    assert np.abs(after - texture).max() < 8
    assert np.abs(detail).max() < 8


def test_a_face_larger_than_the_grid_is_reduced_by_area() -> None:
    checkers = np.indices((800, 800)).sum(0) % 2 * 255
    picture = np.repeat(checkers[..., None], 3, axis=2).astype(np.uint8)
    luma = FineGrid(FRAME)(picture, FRAME.points * 10 + 40)
    inside = cv2.resize(FRAME.mask.astype(np.uint8), SIZE[::-1], interpolation=cv2.INTER_NEAREST) > 0
    assert np.abs(luma[inside] - 127.5).max() < 12


def test_only_the_sharpest_frames_count() -> None:
    truth = skin(2)
    soft = cv2.GaussianBlur(truth, (0, 0), 4)
    texture = np.full((len(FRAME.pixels), 3), 120, np.float32)
    alone = with_detail(texture, [truth] * LIMITS.max_frames, FRAME.mask, FRAME)
    mixed = with_detail(texture, [soft, *[truth] * LIMITS.max_frames, soft], FRAME.mask, FRAME)
    np.testing.assert_array_equal(alone[0], mixed[0])
