"""What a head's turn shows of its skin is learnt from turned frames, kept with the model and drawn on turned heads."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from test_turned_texture import PRIOR

from guise.aam.landmarks.schemes import NOSE, NOSE_BASE
from guise.aam.mask import soft_parts
from guise.aam.mirror import mirror_image
from guise.aam.model import Identity, ModelError
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.solid_shape import HeadPose
from guise.aam.view_prior import RESOLUTION, SideViews, mirrored, shipped
from guise.aam.view_textures import LIMITS, ViewTextures, changing, learn_views
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


def learnt(yaws: tuple[float, ...], light: float = 1.0, noise: float = 0.0) -> ViewTextures | None:
    rng, faces = np.random.default_rng(0), []
    for yaw in yaws:
        for _ in range(4):
            picture, shape = face(yaw, light if yaw else 1.0)
            noisy = picture * np.exp(rng.normal(0, noise, (SIZE, SIZE, 1)))
            faces.append((noisy.clip(0, 255).astype(np.uint8), shape))
    return learn_views(faces, face(0)[1], GRID)


def test_a_turned_nose_is_darker_as_the_turned_frames_show_it() -> None:
    views = learnt((0, -35, 35))
    assert views is not None
    assert views.yaws.tolist() == [-35, 35]
    skin = ~EDGE & (soft_parts(GRID, (NOSE,), 0.1)[GRID.mask] < 0.01)
    assert views.changes[1][EDGE].mean() < -0.1 < -0.03 < views.changes[1][skin].mean()
    assert views.sure[1][EDGE].mean() > 0.8


def test_another_light_on_turned_frames_is_not_learnt() -> None:
    views, bright = learnt((0, 35)), learnt((0, 35), light=1.4)
    assert views is not None
    assert bright is not None
    assert (
        np.abs(bright.changes - views.changes).mean() < 0.002 < 0.05 < np.abs(views.changes[:, EDGE]).mean()
    )


def test_frames_that_differ_are_trusted_less() -> None:
    still, noisy = learnt((0, 35)), learnt((0, 35), noise=0.2)
    assert still is not None
    assert noisy is not None
    assert noisy.sure[0][EDGE].mean() < 0.7 * still.sure[0][EDGE].mean()


def test_a_hidden_cheek_is_not_known() -> None:
    views = learnt((0, 50))
    assert views is not None
    far, near = (
        GRID.pixels % GRID.size[1] < 0.12 * GRID.size[1],
        GRID.pixels % GRID.size[1] > 0.7 * GRID.size[1],
    )
    far, near = (far, near) if views.sure[0][far].mean() < views.sure[0][near].mean() else (near, far)
    assert views.sure[0][far].mean() < 0.3 < 0.6 < views.sure[0][near].mean()


@pytest.mark.parametrize("yaws", [(0,), (0, 4, -4), (0, 11), (35,), (35, 50)])
def test_without_turned_frames_or_without_frames_near_the_front_there_are_no_views(
    yaws: tuple[float, ...],
) -> None:
    assert learnt(yaws) is None


@pytest.fixture
def person(p01: Identity) -> Identity:
    """An enrolled person with made-up views."""
    n = len(p01.reference.pixels)
    changes = np.random.default_rng(0).uniform(-0.5, 0.5, (2, n)).astype(np.float32)
    return replace(p01, views=ViewTextures(np.array([-20.0, 35.0]), changes, np.ones_like(changes)))


def rest_of(person: Identity) -> F64:
    return PRIOR.rest_of(person.appearance.neutral_shape).rest


def test_views_come_back_from_a_file(person: Identity, tmp_path: Path) -> None:
    person.save(tmp_path / "m.guise")
    again = Identity.load(tmp_path / "m.guise")
    assert person.views is not None
    assert again.views is not None
    assert again.views.yaws.tolist() == [-20, 35]
    assert_allclose(again.views.changes, person.views.changes, atol=LIMITS.max_change / 250)
    assert_allclose(again.views.sure, 1)


@pytest.mark.parametrize("part", ["changes", "sure"])
def test_views_of_another_length_are_refused(person: Identity, part: str, tmp_path: Path) -> None:
    short = replace(person.views, **{part: getattr(person.views, part)[:, :-1]})  # type: ignore[type-var]
    replace(person, views=short).save(tmp_path / "m.guise")
    with pytest.raises(ModelError, match="damaged"):
        Identity.load(tmp_path / "m.guise")


def test_views_of_other_yaws_are_refused(person: Identity, tmp_path: Path) -> None:
    assert person.views is not None
    replace(person, views=replace(person.views, yaws=np.array([-20.0, 36.0]))).save(tmp_path / "m.guise")
    with pytest.raises(ModelError, match="damaged"):
        Identity.load(tmp_path / "m.guise")


def test_views_follow_another_resolution(person: Identity) -> None:
    finer = person.at_resolution(64)
    assert finer.views is not None
    assert finer.views.changes.shape == finer.views.sure.shape == (2, len(GRID.pixels))


def test_what_was_seen_replaces_what_is_expected(person: Identity) -> None:
    views = person.views
    assert views is not None
    expected, known = (SideViews.of(person.appearance, one, rest_of(person)) for one in (None, views))
    assert_allclose(known.at(0), 1)
    assert_allclose(known.at(50), expected.at(50))
    mask = cv2.erode(person.appearance.mask.astype(np.uint8), np.ones((15, 15), np.uint8))
    inside = mask[person.reference.mask] > 0
    skin = inside & (changing(person.reference) > 0.99)
    assert_allclose(np.log(known.at(35)[skin]), views.changes[1][skin], atol=0.02)
    assert_allclose(np.log(known.at(-90)), np.log(known.at(-50)))
    halfway = (known.at(20) + known.at(35)) / 2
    assert_allclose(known.at(27.5), halfway, rtol=1e-5)


def test_the_mirror_image_of_a_face_is_expected_to_be_the_mirror_image() -> None:
    reference, prior = ReferenceFrame.canonical(RESOLUTION), shipped()
    rng = np.random.default_rng(1)
    luma = cv2.GaussianBlur(reference.scatter(rng.uniform(0, 255, len(reference.pixels))), (0, 0), 2)
    mirror = lambda values: mirror_image(values.astype(np.float32), reference, 1)  # noqa: E731
    rest = PRIOR.mean * [1, 1.02, 1]
    one, other = (
        prior(np.repeat(face[reference.mask][:, None], 3, 1), solid, reference)
        for face, solid in ((luma, rest), (mirror(luma), mirrored(rest)))
    )
    turned = np.array([mirror(reference.scatter(change))[reference.mask] for change in other[::-1]])
    inner = cv2.erode(reference.mask.astype(np.uint8), np.ones((7, 7), np.uint8))[reference.mask] > 0
    assert np.abs(one).max() > 0.03
    assert np.corrcoef(one[:, inner].ravel(), turned[:, inner].ravel())[0, 1] > 0.97
