"""Masks: what is always face, where skin is compared, and what is learned to stay out."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from guise.aam.landmarks.schemes import (
    BELOW_BROWS,
    HAIRLINE,
    JAW,
    LEFT_EYE,
    LEFT_MOUTH_CORNER,
    LIPS,
    NOSE_BRIDGE,
    NOSE_ROOT,
    RIGHT_BROW_TOP,
    RIGHT_EYE,
    RIGHT_MOUTH_CORNER,
    UPPER_LIP_INNER,
    UPPER_LIP_TOP,
)
from guise.aam.mask import core_mask, expressive_mask, learn_mask, skin_mask
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame

FRAME = ReferenceFrame.canonical(96)
SKIN = np.array([200.0, 160.0, 140.0])
HAIR = np.array([40.0, 30.0, 25.0])


def at(mask: np.ndarray, point: np.ndarray) -> bool:
    x, y = np.round(point).astype(int)
    return bool(mask[y, x])


def faces(rng: np.random.Generator, count: int = 12) -> np.ndarray:
    """Textures (m, h, w, 3) of shaded skin with dark eyes and red lips, and a little noise."""
    ys, xs = np.mgrid[: FRAME.size[0], : FRAME.size[1]] / FRAME.resolution
    picture = SKIN * (1 + 0.25 * (xs - 0.5))[..., None] * (1 - 0.1 * (ys - 0.5))[..., None]
    features = ~skin_mask(FRAME) & core_mask(FRAME)
    picture[features] = 0.5 * picture[features] + [30, 0, 0]
    return picture + rng.normal(size=(count, *picture.shape)) * 2


def learned(pictures: np.ndarray, parsed: np.ndarray | None = None) -> np.ndarray:
    return learn_mask(pictures[:, FRAME.mask].astype(np.float32), FRAME, parsed)


def test_core_holds_eyes_nose_and_mouth_and_not_the_jaw() -> None:
    core = core_mask(FRAME)
    assert all(at(core, p) for p in FRAME.points[BELOW_BROWS])
    assert not any(at(core, p) for p in FRAME.points[JAW[4:13:4]])
    assert not (core & ~FRAME.mask).any()


def test_skin_holds_cheeks_and_nose_and_no_feature_or_rim() -> None:
    skin, p = skin_mask(FRAME), FRAME.points
    cheeks = [
        (p[RIGHT_EYE].mean(0) + p[RIGHT_MOUTH_CORNER]) / 2,
        (p[LEFT_EYE].mean(0) + p[LEFT_MOUTH_CORNER]) / 2,
    ]
    assert all(at(skin, place) for place in [*cheeks, p[NOSE_BRIDGE[2]]])
    eyes_lips_rim = [
        p[RIGHT_EYE].mean(0),
        p[LEFT_EYE].mean(0),
        p[UPPER_LIP_INNER],
        p[UPPER_LIP_TOP],
        p[RIGHT_BROW_TOP],
        *p[JAW],
    ]
    assert not any(at(skin, place) for place in eyes_lips_rim)
    assert not (skin & ~FRAME.mask).any()


def test_expressive_parts_are_eyes_and_mouth_with_a_soft_edge() -> None:
    weight, p = expressive_mask(FRAME), FRAME.points
    assert weight.min() >= 0
    assert weight.max() <= 1 + 1e-6
    for part in (RIGHT_EYE, LEFT_EYE, LIPS):
        x, y = np.round(p[part].mean(0)).astype(int)
        assert weight[y, x] > 0.95
    x, y = np.round((p[RIGHT_EYE].mean(0) + p[RIGHT_MOUTH_CORNER]) / 2).astype(int)
    assert weight[y, x] < 0.05
    assert np.abs(np.diff(weight, axis=1)).max() < 0.5


def test_plain_skin_is_face_nearly_to_the_rim() -> None:
    mask = learned(faces(np.random.default_rng(0)))
    assert mask[FRAME.mask].mean() > 0.95


@pytest.mark.parametrize("side", [-1, 1])
def test_hair_over_one_temple_is_left_out(side: int) -> None:
    pictures, hair = faces(np.random.default_rng(1)), hair_at(side)
    pictures[:, hair] = HAIR
    mask = learned(pictures)
    assert mask[hair].mean() < 0.1
    assert mask[FRAME.mask & ~hair].mean() > 0.85


def hair_at(side: int) -> np.ndarray:
    """The outer eighth of the face from the brows up, on the image's left (-1) or right (1)."""
    ys, xs = np.mgrid[: FRAME.size[0], : FRAME.size[1]]
    middle, brow = FRAME.points[NOSE_ROOT, 0], FRAME.points[RIGHT_BROW_TOP, 1]
    return (
        FRAME.mask & ((xs - middle) * side > 0.36 * FRAME.resolution) & (ys < brow + 0.1 * FRAME.resolution)
    )


def test_what_the_parsing_calls_face_may_be_darker_but_not_of_any_colour() -> None:
    pictures, temple = faces(np.random.default_rng(1)), hair_at(1)
    pictures[:, temple] *= 0.85
    parsed = np.ones(FRAME.size, np.float32)
    assert learned(pictures)[temple].mean() < 0.2
    assert learned(pictures, 0 * parsed)[temple].mean() < 0.2
    assert learned(pictures, parsed)[temple].mean() > 0.8
    pictures[:, temple] = [0, 0, 255]
    assert learned(pictures, parsed)[temple].mean() < 0.2


def test_a_fringe_that_the_parsing_sees_is_left_out_whatever_its_colour() -> None:
    pictures = faces(np.random.default_rng(1))
    x, y = np.round(FRAME.points[HAIRLINE]).astype(int)
    fringe = np.zeros(FRAME.size, bool)
    fringe[: y + round(0.08 * FRAME.resolution), x - 4 : x + 5] = True
    fringe &= FRAME.mask
    parsed = np.where(fringe, 0.1, 1).astype(np.float32)
    assert learned(pictures)[fringe].mean() > 0.9
    mask = learned(pictures, parsed)
    assert mask[fringe].mean() < 0.2
    assert mask[FRAME.mask & ~fringe].mean() > 0.9


def test_background_that_flickers_at_the_rim_is_left_out() -> None:
    rng = np.random.default_rng(2)
    pictures, rim = faces(rng), hair_at(1)
    flicker = SKIN * (1 + 0.25 * 0.4) + rng.normal(size=(len(pictures), rim.sum(), 3)) * 60
    pictures[:, rim] = flicker
    assert learned(pictures)[rim].mean() < 0.35


def test_the_core_is_kept_whatever_it_looks_like() -> None:
    pictures, core = faces(np.random.default_rng(3)), core_mask(FRAME)
    pictures[:, core & ~skin_mask(FRAME)] = [20, 240, 20]
    mask = learned(pictures)
    assert mask[core].all()


def test_the_mask_is_one_piece_without_holes_inside_the_frame(p01: Identity) -> None:
    from scipy.ndimage import binary_fill_holes, label

    mask = p01.appearance.mask
    assert label(mask)[1] == 1
    assert_array_equal(binary_fill_holes(mask) & p01.reference.mask, mask)
    assert not (mask & ~p01.reference.mask).any()
    assert mask[core_mask(p01.reference)].all()
