"""The drawn face's texture: of a turned head it is the view that was seen of it, and it is as fine as it is drawn."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawing import drawn_on, turned_head
from models import model_file
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.model import Identity
from guise.aam.solid_shape import SolidPrior, SolidTracker
from guise.aam.view_prior import SideViews
from guise.aam.view_textures import ViewTextures
from guise.app.drawing.donor import Donor
from guise.app.drawing.face import NOWHERE, FaceInFrame, Fold
from guise.app.drawing.look import PAPER, SWAP
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.texture import LIMITS, Enlargement
from guise.app.drawing.plan import Plan
from guise.app.media import Frame
from guise.common.arrays import F32

PRIOR = SolidPrior.shipped()
SIZE = 96, 84
GREY = np.full((*SIZE, 3), 120, np.uint8)


@pytest.fixture
def person() -> Identity:
    """An enrolled person with made-up views."""
    p01 = Identity.load(model_file("p01"))
    n = len(p01.reference.pixels)
    changes = np.random.default_rng(0).uniform(-0.5, 0.5, (2, n)).astype(np.float32)
    return replace(p01, views=ViewTextures(np.array([-20.0, 35.0]), changes, np.ones_like(changes)))


class Made:
    """Textures of a face over itself."""

    def __init__(self, person: Identity) -> None:
        self.person = person
        self.plan = Plan.of(person, Donor.of(person), replace(SWAP, renderer="cpu"))
        self.texture = self.plan.texture

    def __call__(self, yaw: float, away: float = 0.0) -> F32:
        """(n, 3) of a head turned by degrees from how it was enrolled, its expression so far from rest."""
        pose = turned_head(yaw + self.texture.transfer.target.pose.angles[0], 100.0, (80.0, 80.0))
        shape = pose.apply(PRIOR.mean)
        face = FaceInFrame(Frame.from_rgb(GREY), shape, shape, SolidTracker().update(shape).pose)
        rest = self.person.appearance.neutral_parameters
        face.seen.parameters = rest + np.float32(away) * self.person.appearance.components.deviations
        self.texture.synthesise(face, Memory())
        return face.canvas.texture


def test_a_turned_head_gets_the_view_and_a_straight_one_does_not(
    person: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = Made(person)
    straight, turned = made(0), made(35)
    sides = made.texture._sides
    monkeypatch.setattr(SideViews, "at", lambda views, yaw: np.ones(len(person.reference.pixels), np.float32))
    assert_allclose(straight, made(0), rtol=0.05)
    ratio = (turned / made(35)).mean(1)
    monkeypatch.undo()
    assert np.corrcoef(np.log(ratio), np.log(sides.at(35)))[0, 1] > 0.98


def test_the_texture_of_a_turned_head_does_not_move(person: Identity) -> None:
    """There it would be the turn that it shows, not an expression."""
    made = Made(person)
    changes = [np.abs(made(yaw, 1.5) - made(yaw)).mean() for yaw in (0, 20, 40)]
    assert changes[0] > 1
    assert 0 < changes[1] < changes[0]
    assert changes[2] == 0


def test_what_the_frame_shows_is_read_where_the_head_is(person: Identity) -> None:
    rgb = np.zeros((240, 240, 3), np.uint8)
    rgb[..., 0], rgb[..., 1] = np.arange(240)[None], np.arange(240)[:, None]
    pose = turned_head(0, 100.0, (110.0, 120.0))
    shape = pose.apply(PRIOR.mean)
    for look in (SWAP, PAPER):
        texture = Plan.of(person, Donor.of(person), replace(look, renderer="cpu")).texture
        face = FaceInFrame(Frame.from_rgb(rgb), shape, shape, pose)
        texture.look(face, Memory())
        assert_allclose(face.seen.rgb[:, :2], face.seen.places, atol=1)
        low, high = shape.min(0) - 1, shape.max(0) + 1
        assert ((face.seen.places > low) & (face.seen.places < high)).all()
        texture.measure(face, Memory())
        assert face.seen.parameters.shape == person.appearance.neutral_parameters.shape


def test_by_the_papers_the_shape_is_that_of_the_appearance(person: Identity) -> None:
    texture = Plan.of(person, Donor.of(person), replace(PAPER, renderer="cpu")).texture
    face = FaceInFrame(Frame.from_rgb(GREY), NOWHERE, NOWHERE)
    face.seen.parameters = person.appearance.neutral_parameters
    texture.synthesise(face, Memory())
    assert_allclose(face.shape, person.appearance.neutral_shape, atol=1e-3)
    assert_allclose(face.canvas.texture, person.appearance.neutral_texture, atol=0.1)


def enlarged(zoom: float, picture: np.ndarray = GREY, fold: Fold | None = None) -> np.ndarray:
    detail = np.zeros((2 * SIZE[0], 2 * SIZE[1]), np.float32)
    detail[::2] = 10
    face, enlargement = drawn_on(GREY, NOWHERE, picture, zoom=zoom), Enlargement(detail, cv2.INTER_CUBIC)
    face.canvas.fold = fold
    enlargement.choose(face, Memory())
    enlargement.enlarge(face, Memory())
    return face.canvas.picture


def test_a_face_larger_than_the_grid_gets_detail() -> None:
    made = enlarged(LIMITS.min_detail_zoom + 0.1)
    assert made.shape == (2 * SIZE[0], 2 * SIZE[1], 3)
    assert (made[::2, :, 0] == 130).all()
    assert (made[1::2, :, 0] == 120).all()
    assert (made[..., 1:] == 120).all()


def test_where_the_mesh_is_folded_no_detail_is_added() -> None:
    fold = Fold(np.s_[10:20, 30:40], np.ones((10, 10), np.float32), 3, np.zeros((0, 2, 2)))
    made = enlarged(2.0, fold=fold)
    assert (made[20:40, 60:80, 0] == 120).all()
    assert (made[:20:2, :, 0] == 130).all()


def test_a_face_as_large_as_the_grid_stays_and_a_smaller_one_is_blurred() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    assert_array_equal(enlarged(1.0, noise), noise)
    deviations = [enlarged(zoom, noise).std() for zoom in (0.6, 0.3)]
    assert noise.std() > deviations[0] > deviations[1]
