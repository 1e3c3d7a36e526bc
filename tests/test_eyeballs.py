"""The eyeballs of a disguise: the identity's, but they look where the source looks."""

import numpy as np
import pytest
from models import model_file

from guise.aam.landmarks.schemes import EYES, LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.model import Identity
from guise.app.swapping.eyeballs import Eyeballs
from guise.common.arrays import F32, F64


@pytest.fixture(scope="module")
def identity() -> Identity:
    return Identity.load(model_file("p06"))


@pytest.fixture
def eyeballs(identity: Identity) -> Eyeballs:
    return Eyeballs(Identity.load(model_file("p01")), identity)


def _middles(shape: F64, x: float, y: float = 0.0) -> F64:
    """(2, 2) pixels of irises at a place in both eyes, eye widths."""
    corners = shape[[RIGHT_EYE[0], RIGHT_EYE[3], LEFT_EYE[0], LEFT_EYE[3]]].reshape(2, 2, 2)
    return np.asarray(corners.mean(1) + np.ptp(corners, axis=1) * (x, 0) + (0, y))


def _drawn(eyeballs: Eyeballs, identity: Identity, x: float, mesh: F64 | None = None) -> F32:
    """The brightness (h, w) of a texture whose eyes look at a place; of skin is 200."""
    shape = identity.appearance.neutral_shape
    source = Identity.load(model_file("p01")).appearance.neutral_shape
    for _ in range(9):
        eyeballs.look(_middles(source, x), source)
    texture = np.full((identity.reference.mask.sum(), 3), 200, np.float32)
    eyeballs.paint(texture, shape if mesh is None else mesh)
    return np.asarray(identity.reference.scatter(texture) @ LUMA)


def _dark(picture: F32, identity: Identity, eye: tuple[int, ...]) -> float:
    """Column of what is dark in an eye, eye widths from its middle."""
    points = identity.reference.points[list(eye)]
    low, high = np.round(points.min(0)).astype(int), np.round(points.max(0)).astype(int)
    window = picture[low[1] + 1 : high[1], low[0] + 3 : high[0] - 2]
    weights = np.clip(np.median(window) - window, 0, None).sum(0)
    return float(weights @ np.arange(window.shape[1]) / weights.sum()) / np.ptp(points[:, 0])


def test_both_irises_are_where_the_source_has_them(eyeballs: Eyeballs, identity: Identity) -> None:
    left, right = (_drawn(eyeballs, identity, x) for x in (-0.1, 0.1))
    for eye in (tuple(RIGHT_EYE), tuple(LEFT_EYE)):
        assert _dark(right, identity, eye) - _dark(left, identity, eye) == pytest.approx(0.2, abs=0.07)


def test_only_eyes_are_drawn(eyeballs: Eyeballs, identity: Identity) -> None:
    picture = _drawn(eyeballs, identity, 0.0)
    changed = (np.abs(picture - 200) > 1) & identity.reference.mask
    ys, xs = np.nonzero(changed)
    eyes = identity.reference.points[EYES]
    near = 0.06 * identity.reference.resolution
    assert (np.column_stack([xs, ys]) > eyes.min(0) - near).all()
    assert (np.column_stack([xs, ys]) < eyes.max(0) + near).all()
    assert changed.sum() > 150


def test_a_shut_eye_shows_no_iris(eyeballs: Eyeballs, identity: Identity) -> None:
    shape = identity.appearance.neutral_shape
    shut = shape.copy()
    for eye in (RIGHT_EYE, LEFT_EYE):
        shut[eye, 1] = shape[eye, 1].max() - 0.02 * (shape[eye, 1].max() - shape[eye, 1])
    of_gaze = [
        np.abs(np.diff([_drawn(eyeballs, identity, x, mesh) for x in (-0.1, 0.1)], axis=0)).sum()
        for mesh in (shape, shut)
    ]
    assert of_gaze[1] < 0.5 * of_gaze[0]


def test_after_a_loss_eyes_look_as_at_rest(eyeballs: Eyeballs, identity: Identity) -> None:
    shape = identity.appearance.neutral_shape

    def drawn() -> F32:
        texture = np.full((identity.reference.mask.sum(), 3), 200, np.float32)
        eyeballs.paint(texture, shape)
        return texture

    before = drawn()
    _drawn(eyeballs, identity, 0.15)
    assert np.abs(drawn() - before).max() > 20
    eyeballs.reset()
    np.testing.assert_array_equal(drawn(), before)
