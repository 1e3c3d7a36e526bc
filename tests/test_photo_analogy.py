"""Properties of expression analogy between photographs, on drawn faces and on rendered people."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_faces import NEUTRAL, OTHER, S1, SIZE, Picture, S, T, drawn, eight, smiling
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.landmarks.schemes import (
    IBUG68,
    INNER_LIPS,
    LEFT_EYE,
    LOWER_LIP_INNER,
    NOSE_ROOT,
    RIGHT_EYE,
    UPPER_LIP_INNER,
)
from guise.analogy.photo import METHODS, Method, PhotoAnalogy, PhotoError
from guise.analogy.photo.eyes import lid_shares, reopen_eyes
from guise.analogy.photo.grid import face_mask
from guise.analogy.photo.landmark_motion import LandmarkMotion
from guise.analogy.photo.template import anchor_ring
from guise.common.arrays import F64

PEOPLE = Path(__file__).parents[2] / "shared" / "data" / "synthetic" / "people"


def carry(method: Method = "tents", target: Picture = T) -> PhotoAnalogy:
    return PhotoAnalogy(S, NEUTRAL, target, OTHER, method)


@pytest.mark.parametrize("method", METHODS)
def test_no_expression_gives_the_target(method: Method) -> None:
    assert_array_equal(carry(method)(S, NEUTRAL), T)


@pytest.mark.parametrize("method", METHODS)
def test_strength_0_gives_the_target(method: Method) -> None:
    assert_array_equal(carry(method)(S1, smiling(NEUTRAL), 0.0), T)


def test_the_expression_moves_the_face_and_nothing_beyond_the_ring() -> None:
    made = carry()(S1, smiling(NEUTRAL))
    mask = np.zeros(SIZE, np.uint8)
    cv2.fillPoly(mask, [np.ceil(anchor_ring(OTHER)).astype(np.int32)], (1,))
    beyond = cv2.dilate(mask, np.ones((3, 3), np.uint8)) == 0
    assert beyond.sum() > 5000
    assert_array_equal(made[beyond], T[beyond])
    assert np.abs(made.astype(int) - T)[mask > 0].mean() > 1


@pytest.mark.parametrize("method", ["tents", "ratio"])
def test_a_furrow_is_carried_and_a_warp_has_none(method: Method) -> None:
    place = np.rint(OTHER[NOSE_ROOT] - (0, 21)).astype(int)
    at = np.s_[place[1] - 2 : place[1] + 3, place[0] - 5 : place[0] + 6]
    made, bare = (carry(m)(S1, smiling(NEUTRAL))[at].mean() for m in (method, METHODS[2]))
    assert made < 0.93 * bare


def test_onto_itself_it_is_its_own_answer() -> None:
    points = smiling(NEUTRAL)
    inside = cv2.erode(face_mask(points, SIZE[::-1]).astype(np.uint8), np.ones((9, 9), np.uint8)) > 0
    errors = [
        np.abs(PhotoAnalogy(S, NEUTRAL, S, NEUTRAL, m)(S1, points).astype(float) - S1)[inside].mean()
        for m in METHODS
    ]
    assert errors[0] < 1.0
    assert errors[0] < 0.5 * errors[1] < 0.5 * errors[2]


def test_half_the_strength_lies_between() -> None:
    whole = carry()
    made = [whole(S1, smiling(NEUTRAL), k).astype(float) for k in (0.0, 0.5, 1.0)]
    low, high = (np.abs(made[1] - made[k]).mean() for k in (0, 2))
    assert max(low, high) < np.abs(made[2] - made[0]).mean()
    assert min(low, high) > 0.1 * np.abs(made[2] - made[0]).mean()


@pytest.mark.parametrize("side", [1.0, 0.6])
def test_other_light_on_the_source_changes_little(side: float) -> None:
    """Of all of it, and from the right of the picture."""
    gain = 0.7 * np.linspace(side, 1, SIZE[1])[:, None]
    other = [np.asarray(np.rint(np.clip(p * gain + 12, 0, 255)), np.uint8) for p in (S, S1)]
    plain = carry()(S1, smiling(NEUTRAL))
    lit = PhotoAnalogy(other[0], NEUTRAL, T, OTHER)(other[1], smiling(NEUTRAL))
    changed = np.abs(plain.astype(float) - T).mean()
    assert np.abs(plain.astype(float) - lit).mean() < 0.15 * changed


def test_a_dimmer_expressive_picture_does_not_dim_the_target() -> None:
    dim = np.asarray(np.rint(S1 * 0.7), np.uint8)
    plain, lit = (carry()(p, smiling(NEUTRAL)).astype(float) for p in (S1, dim))
    shift = (lit - plain)[face_mask(OTHER, SIZE[::-1])].mean()
    assert abs(shift) < 3
    by_ratio = [carry("ratio")(p, smiling(NEUTRAL)).astype(float) for p in (S1, dim)]
    assert (by_ratio[1] - by_ratio[0])[face_mask(OTHER, SIZE[::-1])].mean() < -15


@pytest.mark.parametrize("level", [0, 128, 255])
@pytest.mark.parametrize("method", METHODS)
def test_flat_pictures_stay_finite(method: Method, level: int) -> None:
    flat = np.full((*SIZE, 3), level, np.uint8)
    made = PhotoAnalogy(flat / 255.0, NEUTRAL, flat / 255.0, OTHER, method)(flat / 255.0, smiling(NEUTRAL))
    assert np.isfinite(made).all()
    assert_allclose(made, level / 255, atol=0.01)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32, np.float64])
def test_type_and_size_are_the_targets(kind: type) -> None:
    top = np.iinfo(kind).max if np.issubdtype(kind, np.integer) else 1
    target = np.asarray(T / 255.0 * top, kind)
    made = carry(target=target)(S1, smiling(NEUTRAL))
    assert made.dtype == kind
    assert made.shape == T.shape
    assert_allclose(made / top, carry()(S1, smiling(NEUTRAL)) / 255, atol=0.02)


def test_a_grey_target_stays_grey() -> None:
    made = carry(target=cv2.cvtColor(T, cv2.COLOR_RGB2GRAY))(S1, smiling(NEUTRAL))
    assert made.shape == SIZE


def test_a_source_of_another_size_gives_about_the_same() -> None:
    large = [cv2.resize(p, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC) for p in (S, S1)]
    points = [(p + 0.5) * 2 - 0.5 for p in (NEUTRAL, smiling(NEUTRAL))]
    made = PhotoAnalogy(large[0], points[0], T, OTHER)(large[1], points[1])
    plain = carry()(S1, smiling(NEUTRAL))
    assert np.abs(made.astype(float) - plain).mean() < 0.1 * np.abs(plain.astype(float) - T).mean()


@pytest.mark.slow
def test_a_large_target_is_computed_on_a_coarser_grid() -> None:
    large = cv2.resize(T, None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
    whole = PhotoAnalogy(S, NEUTRAL, large, (OTHER + 0.5) * 6 - 0.5)
    made = whole(S1, smiling(NEUTRAL))
    assert made.shape == large.shape
    assert_array_equal(whole(S, NEUTRAL), large)
    small = cv2.resize(made, SIZE[::-1], interpolation=cv2.INTER_AREA)
    plain = carry()(S1, smiling(NEUTRAL))
    assert np.abs(small.astype(float) - plain).mean() < 0.2 * np.abs(plain.astype(float) - T).mean()


def test_a_face_partly_outside_its_picture() -> None:
    cut = np.ascontiguousarray(T[70:, 60:])
    made = PhotoAnalogy(S, NEUTRAL, cut, OTHER - (60, 70))(S1, smiling(NEUTRAL))
    assert made.shape == cut.shape
    assert np.abs(made.astype(float) - cut).mean() > 0.5


def test_the_inside_of_a_mouth_that_opens_is_the_sources() -> None:
    points = smiling(NEUTRAL, 2.0)
    expressive = drawn(points, 0)
    cv2.fillPoly(expressive, [np.rint(points[list(INNER_LIPS)]).astype(np.int32)], (0.1, 0.8, 0.1))
    middle = np.rint(
        LandmarkMotion(NEUTRAL, OTHER)(points, 1.0)[[UPPER_LIP_INNER, LOWER_LIP_INNER]].mean(0)
    ).astype(int)
    colours = [
        PhotoAnalogy(S, NEUTRAL, T, OTHER, mouth=mouth)(eight(expressive), points)[middle[1], middle[0]]
        for mouth in ("fill", "none")
    ]
    assert colours[0][1] > 2.0 * colours[0][0]
    assert colours[1][1] < 1.5 * colours[1][0]


def test_eyes_that_close_take_their_lids_from_the_source() -> None:
    points = NEUTRAL.copy()
    for eye in (RIGHT_EYE, LEFT_EYE):
        points[eye[1:3]] = points[[eye[5], eye[4]]] - (0, 0.3)
    assert_allclose(lid_shares(NEUTRAL, points, 1.0), 1)
    assert_allclose(lid_shares(NEUTRAL, points, 0.3), 0)
    assert_allclose(reopen_eyes(points, NEUTRAL, np.ones(2)), NEUTRAL)
    blinking = eight(drawn(points, 0))
    made = carry()(blinking, points)
    eye = OTHER[list(RIGHT_EYE)].mean(0).astype(int)
    assert T[eye[1], eye[0]].min() > 200
    assert made[eye[1], eye[0]].max() < 150


def test_a_coarser_grid_gives_nearly_the_same_picture() -> None:
    """As in clips, where light is computed on fewer pixels."""
    picture = np.random.default_rng(2).integers(90, 160, (*SIZE[::-1], 3), dtype=np.uint8)
    picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 4), np.uint8)
    fine, coarse = (
        PhotoAnalogy(picture, NEUTRAL, picture, NEUTRAL, max_face_px=most)(picture, NEUTRAL).astype(int)
        for most in (512, 48)
    )
    assert np.abs(fine - coarse).mean() < 1


def test_mistakes_are_one_sentence() -> None:
    with pytest.raises(
        PhotoError, match=r"source_points must be \(81, 2\) landmarks of scheme face81, got \(68, 2\)"
    ):
        PhotoAnalogy(S, NEUTRAL[IBUG68], T, OTHER)
    with pytest.raises(PhotoError, match="points must be finite"):
        carry()(S1, np.full((81, 2), np.nan))
    with pytest.raises(PhotoError, match="the landmarks do not form a face"):
        PhotoAnalogy(S, np.ones((81, 2)), T, OTHER)
    with pytest.raises(PhotoError, match="target's face is 10 pixels wide, but at least 32"):
        PhotoAnalogy(S, NEUTRAL, T, NEUTRAL * 10 / np.ptp(NEUTRAL[:, 0]))
    with pytest.raises(PhotoError, match="target's landmarks lie outside its picture"):
        PhotoAnalogy(S, NEUTRAL, T, OTHER + 1000)
    with pytest.raises(PhotoError, match=r"source must be \(h, w\) or \(h, w, 3\), got \(4, 4, 4\)"):
        PhotoAnalogy(np.zeros((4, 4, 4), np.uint8), NEUTRAL, T, OTHER)
    with pytest.raises(PhotoError, match="expressive holds values outside 0 to 1"):
        carry()(S1.astype(float), NEUTRAL)
    with pytest.raises(PhotoError, match="expressive must be uint8, uint16 or float in 0 to 1, got int64"):
        carry()(S1.astype(np.int64), NEUTRAL)
    with pytest.raises(PhotoError, match="method must be one of"):
        PhotoAnalogy(S, NEUTRAL, T, OTHER, "cloning")  # type: ignore[arg-type]


@pytest.mark.skipif(not PEOPLE.exists(), reason="the rendered people are not beside the repository")
@pytest.mark.parametrize(("person", "margin"), [("p01", 3.0), ("p05", 0.5)])
def test_of_rendered_people_tents_come_nearest(person: str, margin: float) -> None:
    """Margins in dB over the other methods, in the mean of all expressions: of p01 onto themselves, and onto p05."""
    (s, ps), (t, pt) = still("p01", "neutral"), still(person, "neutral")
    carries = [PhotoAnalogy(s, ps, t, pt, method) for method in METHODS]
    psnr = []
    for name in ("smile", "surprise", "anger", "disgust", "blink", "open"):
        truth, points = still(person, name)
        inside = face_mask(points, (truth.shape[1], truth.shape[0]))
        made = [carry(*still("p01", name)).astype(float) for carry in carries]
        psnr.append([-10 * np.log10(((one - truth)[inside] ** 2).mean()) for one in made])
    tents, *others = np.mean(psnr, axis=0)
    assert tents > max(others) + margin


def still(person: str, name: str) -> tuple[Picture, F64]:
    with np.load(PEOPLE / person / "stills.npz") as stills:
        points = stills["landmarks"][list(stills["names"]).index(name)].astype(np.float64)
    picture = cv2.imread(str(PEOPLE / person / f"{name}.jpg"))
    assert picture is not None
    return np.ascontiguousarray(picture[:, :, ::-1]), points
