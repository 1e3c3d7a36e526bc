"""What a head's turn shows of its skin is learnt from turned frames, kept with the model and drawn on turned heads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_turned_texture import PRIOR

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.landmarks.schemes import LEFT_EYE, NOSE, NOSE_BASE
from guise.aam.mask import soft_parts
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity, ModelError
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.solid_shape import HeadPose, SolidTracker
from guise.aam.view_textures import LIMITS, ViewTextures, learn_views
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F64, U8

GRID = ReferenceFrame.canonical(64)
SIZE, SKIN = 160, 150
RIGHT_OF_MIDDLE = GRID.pixels % GRID.size[1] > GRID.points[NOSE_BASE, 0]
EDGE = (soft_parts(GRID, (NOSE,), 0.0)[GRID.mask] > 0.5) & RIGHT_OF_MIDDLE  # darker on a turned head


def pose(yaw: float) -> HeadPose:
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return HeadPose(rotation, 100.0, np.full(2, SIZE / 2.0))


def face(yaw: float, light: float = 1.0) -> tuple[U8, F64]:
    """A head turned by degrees whose nose is darker the more it is turned, in a light of that strength."""
    shape = pose(yaw).apply(PRIOR.mean)
    relief = Relief.shipped(GRID)
    ys, xs = np.divmod(GRID.pixels, GRID.size[1])
    places = MeshSampler.build(relief.mesh, np.column_stack([xs, ys]).astype(float)).positions(
        relief.seen(shape, pose(yaw).linear[2] * min(abs(yaw) / 22, 1))
    )
    picture = np.full((SIZE, SIZE, 3), SKIN * light, np.float32)
    xs, ys = np.round(places[EDGE]).astype(int).T
    picture[ys, xs] = SKIN * light * (1 - abs(yaw) / 100)
    return picture.astype(np.uint8), shape


def learnt(yaws: tuple[float, ...], light: float = 1.0) -> ViewTextures | None:
    faces = [face(yaw, light if yaw else 1.0) for yaw in yaws for _ in range(4)]
    return learn_views(faces, face(0)[1], GRID.mask, GRID)


def test_a_turned_nose_is_drawn_as_the_turned_frames_show_it() -> None:
    views = learnt((0, -35, 35))
    assert views is not None
    assert views.yaws.tolist() == [-35, 0, 35]
    assert_allclose(views.at(0), 1)
    skin = ~EDGE & (soft_parts(GRID, (NOSE,), 0.1)[GRID.mask] < 0.01)
    assert views.at(35)[EDGE].mean() < 0.9 < 0.97 < views.at(35)[skin].mean()
    assert views.at(0)[EDGE].mean() > views.at(17)[EDGE].mean() > views.at(35)[EDGE].mean()
    assert_allclose(views.at(60), views.at(35))


def test_another_light_on_turned_frames_is_not_learnt() -> None:
    views, bright = learnt((0, 35)), learnt((0, 35), 1.4)
    assert views is not None
    assert bright is not None
    assert (
        np.abs(bright.changes - views.changes).mean() < 0.002 < 0.05 < np.abs(views.changes[:, EDGE]).mean()
    )


def test_the_side_that_was_not_seen_is_the_mirror_image_of_the_other() -> None:
    views = learnt((0, 35))
    assert views is not None
    assert views.yaws.tolist() == [-35, 0, 35]
    assert views.at(35)[EDGE].mean() < 0.9 < 0.98 < views.at(-35)[EDGE].mean()
    mirrored = mirror_image(GRID.scatter(views.changes[2]), GRID, 1)[GRID.mask]
    assert_allclose(views.changes[0], mirrored)


def test_eyes_stay() -> None:
    views = learnt((0, 35))
    assert views is not None
    eye = soft_parts(GRID, (LEFT_EYE,), 0.0)[GRID.mask] > 0.9
    assert_allclose(views.at(35)[eye], 1, atol=0.01)


@pytest.mark.parametrize("yaws", [(0,), (0, 4, -4), (35,), (35, 50)])
def test_without_turned_frames_or_without_frames_near_the_front_there_are_no_views(
    yaws: tuple[float, ...],
) -> None:
    assert learnt(yaws) is None


@pytest.fixture
def person(p01: Identity) -> Identity:
    """An enrolled person with made-up views."""
    n = len(p01.reference.pixels)
    changes = np.random.default_rng(0).uniform(-0.5, 0.5, (3, n, 3)).astype(np.float32)
    changes[1] = 0
    return replace(p01, views=ViewTextures(np.array([-20.0, 0.0, 35.0]), changes))


def test_views_come_back_from_a_file(person: Identity, tmp_path: Path) -> None:
    person.save(tmp_path / "m.guise")
    again = Identity.load(tmp_path / "m.guise")
    assert person.views is not None
    assert again.views is not None
    assert again.views.yaws.tolist() == [-20, 0, 35]
    assert_allclose(again.views.changes, person.views.changes, atol=LIMITS.max_change / 250)


def test_views_of_another_length_are_refused(person: Identity, tmp_path: Path) -> None:
    assert person.views is not None
    replace(person, views=replace(person.views, changes=person.views.changes[:, :-1])).save(
        tmp_path / "m.guise"
    )
    with pytest.raises(ModelError, match="damaged"):
        Identity.load(tmp_path / "m.guise")


def test_views_follow_another_resolution(person: Identity) -> None:
    finer = person.at_resolution(64)
    assert finer.views is not None
    assert finer.views.changes.shape == (3, len(GRID.pixels), 3)


def test_a_turned_head_gets_the_view_and_a_straight_one_does_not(person: Identity) -> None:
    plain, views = replace(person, views=None), person.views
    assert views is not None

    def texture(target: Identity, yaw: float) -> np.ndarray:
        with Engine(plain, target, None, EngineOptions(renderer="cpu")) as engine:
            enrolled = engine._shape_transfer.target.pose.angles[0]
            shape = pose(yaw + enrolled).apply(PRIOR.mean)
            parameters = plain.appearance.neutral_parameters
            solid = SolidTracker().update(shape)
            return engine.synthesise(parameters, shape, solid)[SHAPE_ENTRIES:].reshape(-1, 3)

    assert_allclose(texture(person, 0), texture(plain, 0), rtol=0.05)
    assert_allclose(texture(person, 35), texture(plain, 35) * views.at(35), rtol=0.05)
