"""A turned donor's far half is filled from the near one; a straight donor stays as they are."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import FRAME, appearance

from guise.aam.appearance import SHAPE_ENTRIES, Components
from guise.aam.landmarks.schemes import (
    CHIN,
    LEFT_EYE,
    LEFT_EYE_OUTER,
    LEFT_MOUTH_CORNER,
    LEFT_TEMPLE,
    NOSE_BASE,
    NOSE_ROOT,
    RIGHT_EYE_OUTER,
    RIGHT_MOUTH_CORNER,
    RIGHT_TEMPLE,
)
from guise.aam.model import Identity, RestFrame
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker import Quality, Tracker
from guise.aam.turned_texture import completed, mirrored_share, moving_share
from guise.common.arrays import F32, F64

PRIOR = SolidPrior.shipped()


def seen(yaw: float) -> F64:
    """The mean face turned by degrees, aligned with the grid."""
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return FRAME.align(HeadPose(rotation, 100.0, np.zeros(2)).apply(PRIOR.mean))


def enrolled(yaw: float, texture: F32) -> Identity:
    """Somebody with a texture (n, 3), enrolled turned by degrees."""
    nothing = np.zeros(0, np.float32)
    no_modes = Components(nothing, np.zeros((0, 0), np.float32), nothing, 0.0)
    tracker = Tracker(no_modes, (), no_modes, np.zeros(0, np.intp), Quality(1.0, 1.0, 2.0), np.zeros(3))
    shape = (seen(yaw) * FRAME.shape_weight).ravel()
    neutral = np.concatenate([shape, texture.ravel()]).astype(np.float32)
    detail = np.zeros((2 * FRAME.size[0], 2 * FRAME.size[1]), np.float32)
    still = RestFrame(np.zeros((8, 8, 3), np.uint8), seen(yaw))
    return Identity("somebody", replace(appearance(3), neutral=neutral), tracker, detail, still)


def halves(right: float, left: float) -> F32:
    """A texture (n, 3) that is one grey on the image's left, the person's right, and another on its right."""
    across = FRAME.pixels % FRAME.size[1] < FRAME.points[:, 0].mean()
    return np.repeat(np.where(across, right, left)[:, None], 3, axis=1).astype(np.float32)


@pytest.mark.parametrize("yaw", [0, 4, -4])
def test_who_looks_straight_stays_as_they_are(yaw: float) -> None:
    person = enrolled(yaw, halves(100, 180))
    assert completed(person) is person


def test_the_far_half_gets_the_mirror_image() -> None:
    for yaw, near, far in ((30, RIGHT_EYE_OUTER, LEFT_EYE_OUTER), (-30, LEFT_EYE_OUTER, RIGHT_EYE_OUTER)):
        share = mirrored_share(seen(yaw), FRAME)
        (x, y), (u, v) = np.round(FRAME.points[[near, far]]).astype(int)
        assert share[y, x] == 0
        assert share[v, u] > 0.9
        assert ((share >= 0) & (share <= 1)).all()


def test_a_mole_on_the_near_cheek_appears_on_the_far_one_in_its_light() -> None:
    texture = FRAME.scatter(halves(160, 80))
    x, y = np.round(0.5 * (FRAME.points[RIGHT_TEMPLE] + FRAME.points[RIGHT_MOUTH_CORNER])).astype(int)
    texture[y - 1 : y + 2, x - 1 : x + 2] = 40
    person = enrolled(30, texture[FRAME.mask])
    made = FRAME.scatter(completed(person).appearance.texture_of(completed(person).appearance.neutral))
    mirrored = round(2 * FRAME.points[NOSE_ROOT, 0] - x)
    assert made[y, mirrored].mean() < 0.6 * made[y + 6, mirrored].mean()
    assert made[y + 6, mirrored].mean() == pytest.approx(80, rel=0.35)
    np.testing.assert_allclose(made[:, : x + 2], texture[:, : x + 2], atol=0.01)


def test_shape_and_size_of_a_model_stay() -> None:
    person = enrolled(25, halves(100, 180))
    made = completed(person)
    np.testing.assert_array_equal(
        made.appearance.neutral[:SHAPE_ENTRIES], person.appearance.neutral[:SHAPE_ENTRIES]
    )
    assert made.detail.shape == person.detail.shape


def test_eyes_move_in_full_skin_by_half_and_what_was_mirrored_not_at_all() -> None:
    share = moving_share(enrolled(30, halves(100, 180)))
    cheeks = 0.5 * (
        FRAME.points[[RIGHT_TEMPLE, LEFT_TEMPLE]] + FRAME.points[[RIGHT_MOUTH_CORNER, LEFT_MOUTH_CORNER]]
    )
    places = np.round([FRAME.points[LEFT_EYE].mean(0), *cheeks]).astype(int)
    eye, near, far = (share[y, x] for x, y in places)
    assert eye > 0.9
    assert near == pytest.approx(0.5, abs=0.05)
    assert far < 0.05


def test_a_shadow_that_ends_at_the_middle_leaves_no_dark_line() -> None:
    """On the chin the near half darkens towards the middle."""
    x, y = np.round(FRAME.points[CHIN] - np.array([0, 0.12 * FRAME.resolution])).astype(int)
    away = np.abs(np.arange(FRAME.size[1]) - FRAME.points[NOSE_BASE, 0]) / FRAME.resolution
    across = np.interp(away, [0, 0.1], [90, 160])
    texture = np.repeat(np.broadcast_to(across, FRAME.size)[..., None], 3, axis=2).astype(np.float32)
    person = enrolled(30, texture[FRAME.mask])
    made = FRAME.scatter(completed(person).appearance.neutral_texture)
    beside = x + round(0.12 * FRAME.resolution)
    assert made[y, x, 0] > 0.8 * made[y, beside, 0] > 1.2 * texture[y, x, 0]
