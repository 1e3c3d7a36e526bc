"""The inside of a disguise's mouth: teeth that stay with nose and chin, whatever the lips do."""

import numpy as np
import pytest
from drawing import face_at
from models import model_file

from guise.aam.landmarks.schemes import CHIN, INNER_LIPS, JAW, LIPS, NOSE, NOSE_BASE, NOSE_ROOT
from guise.aam.light import LUMA
from guise.aam.model import Identity
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.mouth import LIMITS, InnerMouth
from guise.common.arrays import F32, F64

SKIN = 120.0


@pytest.fixture(scope="module")
def identity() -> Identity:
    return Identity.load(model_file("p06"))


def _opened(identity: Identity, lips: float, jaw: float = 0.0) -> F64:
    """The shape at rest with its inner lips apart by a share of the face's height, the lower one and the jaw down."""
    shape = identity.appearance.neutral_shape.copy()
    height = np.ptp(shape[:, 1])
    corners = shape[[INNER_LIPS[0], INNER_LIPS[4]], 1].mean()
    shape[INNER_LIPS[1:4], 1] = corners - lips * height / 2
    shape[INNER_LIPS[5:], 1] = corners + (lips / 2 + jaw) * height
    shape[CHIN, 1] += jaw * height
    return shape


def _painted(identity: Identity, mesh: F64) -> F32:
    """(h, w) brightness of a texture of one tone in which the mouth is painted."""
    face = face_at(mesh)
    face.canvas.texture = np.full((identity.reference.mask.sum(), 3), SKIN, np.float32)
    InnerMouth(identity.reference, identity.appearance.neutral_shape).paint(face, Memory())
    return np.asarray(identity.reference.scatter(face.canvas.texture) @ LUMA)


def _teeth(picture: F32) -> int:
    return int((picture > SKIN + 15).sum())


@pytest.mark.slow
def test_between_shut_lips_nothing_is_painted(identity: Identity) -> None:
    painted = _painted(identity, _opened(identity, 0.0))
    np.testing.assert_allclose(painted[identity.reference.mask], SKIN, atol=0.05)


def test_only_the_mouth_is_painted(identity: Identity) -> None:
    painted = _painted(identity, _opened(identity, 0.06))
    ys, xs = np.nonzero((np.abs(painted - SKIN) > 1) & identity.reference.mask)
    lips = identity.reference.points[LIPS]
    assert (np.column_stack([xs, ys]) > lips.min(0) - 2).all()
    assert (np.column_stack([xs, ys]) < lips.max(0) + 2).all()
    assert len(xs) > 50


def test_a_smile_shows_teeth_and_a_dropped_jaw_the_dark(identity: Identity) -> None:
    smile, dropped = (_painted(identity, _opened(identity, *how)) for how in ((0.06,), (0.0, 0.12)))
    assert _teeth(smile) > 20
    dark = [int(((picture < SKIN - 50) & identity.reference.mask).sum()) for picture in (smile, dropped)]
    assert dark[1] > max(40, 2 * dark[0])


def test_little_light_falls_between_hardly_parted_lips(identity: Identity) -> None:
    at_rest = identity.appearance.neutral_shape
    nose = np.linalg.norm(at_rest[NOSE_BASE] - at_rest[NOSE_ROOT]) / np.ptp(at_rest[:, 1])
    for parted, shows_teeth in ((0.5, False), (2.0, True)):
        picture = _painted(identity, _opened(identity, parted * LIMITS.parted * nose))
        assert (picture[identity.reference.mask].max() > SKIN + 5) == shows_teeth


def test_teeth_do_not_depend_on_place_size_and_turn_in_the_picture(identity: Identity) -> None:
    turn = 1.7 * np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    mesh = _opened(identity, 0.06)
    np.testing.assert_allclose(
        _painted(identity, mesh @ turn + (300, -20)), _painted(identity, mesh), atol=0.5
    )


def test_upper_teeth_stay_with_the_nose(identity: Identity) -> None:
    mesh = _opened(identity, 0.06)
    lowered = mesh.copy()
    lowered[np.r_[NOSE, JAW]] += (0, 0.02 * np.ptp(mesh[:, 1]))
    assert _teeth(_painted(identity, lowered)) != _teeth(_painted(identity, mesh))
