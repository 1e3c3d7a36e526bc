"""The compiled kernels of points and samples beside their NumPy twins, as in `test_kernels.py`."""

from dataclasses import astuple
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from test_kernels import MOST_LEVELS, MOST_PIXELS, assert_alike, both, compiled, seeds

from guise.aam.landmarks.builtin import SIZE, calibration
from guise.aam.landmarks.correction import FULL_TURN, MAX_FEATURE, PARTS, shipped
from guise.aam.landmarks.crops import crop_to_picture
from guise.aam.landmarks.detector import MIDDLE_GREY
from guise.aam.landmarks.plausible import _MOTION as MOTION
from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS, RIGID_WEIGHTS
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.relief import BEYOND_HULL, Relief
from guise.aam.shape_filter import ShapeFilter
from guise.aam.shape_transfer import ShapeTransfer
from guise.aam.solid_shape import HeadPose, SolidFit, SolidPrior
from guise.aam.tracker import FEATURE_RESOLUTION, Cascade
from guise.aam.tracker import LIMITS as TRACKER
from guise.common.arrays import F64, side_by_side


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 60))
def test_mesh_positions(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points, vertices = (
        rng.uniform(-50, 2000, (POINTS, 2)),
        rng.integers(0, POINTS, (3, count)).astype(np.intp),
    )
    weights = rng.dirichlet(np.ones(3), count).T.astype(np.float32, order="C")

    def arguments() -> tuple[Any, ...]:
        return points, vertices, weights, np.zeros((count, 2), np.float32)

    assert_alike(both("mesh_positions", arguments, (3,)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(0.2, 9), st.integers(0, 3), st.floats(-1, 1))
def test_fit_cascade(seed: int, zoom: float, steps: int, aside: float) -> None:
    rng = np.random.default_rng(seed)
    reference = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    sampler = reference.sampler[np.sort(rng.permutation(len(reference.pixels))[:200])]
    luma = cv2.GaussianBlur(rng.integers(0, 256, (300, 350), np.uint8), (0, 0), 2)
    luma = cv2.normalize(luma, None, 0, 255, cv2.NORM_MINMAX)[3:, :340]  # type: ignore[call-overload]
    # of all sizes, some of them partly or wholly beside the picture
    start = (reference.points - reference.points.mean(0)) * zoom + (170 + 300 * aside, 150)
    modes, features = 5, len(sampler.weights[0])
    known = Cascade(
        reference.points, RIGID_WEIGHTS, sampler.vertices, sampler.weights,
        reference.points.ravel().astype(np.float32), rng.normal(0, 0.1, (2 * POINTS, modes)).astype(np.float32),
        rng.uniform(0.5, 3, modes).astype(np.float32),
        rng.normal(0, 0.0003, (steps, 4 + modes, 1 + features)).astype(np.float32),
        rng.normal(0, 1, features).astype(np.float32),
        np.linalg.qr(rng.normal(size=(features, 9)))[0].T.astype(np.float32, order="C"), np.array(astuple(TRACKER)),
    )  # fmt: skip

    def arguments() -> tuple[Any, ...]:
        return luma, start, *known, np.zeros((POINTS, 2)), np.zeros(modes)

    assert_alike(both("fit_cascade", arguments, (13, 14)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(3, 81))
def test_planar_similarity(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = rng.uniform(-50, 2000, (2, count, 2))
    weights = rng.dirichlet(np.ones(count))

    def arguments() -> tuple[Any, ...]:
        return source, target, weights, np.zeros(4)

    assert_alike(both("planar_similarity", arguments, (3,)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.sampled_from([0, 0.3, 30, 300]))
def test_relief_seen(seed: int, across: float) -> None:
    rng = np.random.default_rng(seed)
    relief = Relief.shipped(ReferenceFrame.canonical(96))
    flat, depth = relief._on_flat, relief.depth[POINTS:]
    points = 3 * relief.reference.points + rng.normal(0, 5, (POINTS, 2))
    aside = across * rng.normal(size=2)

    def arguments() -> tuple[Any, ...]:
        return points, flat.vertices, flat.weights, depth, aside, BEYOND_HULL, np.zeros(relief.points.shape)

    assert_alike(both("relief_seen", arguments, (6,)), MOST_PIXELS)


@compiled
def test_points_on_a_line_and_as_one_have_no_hull() -> None:
    relief = Relief.shipped(ReferenceFrame.canonical(96))
    flat, depth = relief._on_flat, relief.depth[POINTS:]
    for points in (np.ones((POINTS, 2)), np.linspace((3, 4), (9, 4), POINTS)):
        given = (
            points,
            flat.vertices,
            flat.weights,
            depth,
            np.ones(2),
            BEYOND_HULL,
            np.zeros(relief.points.shape),
        )
        assert np.isfinite(both("relief_seen", lambda given=given: given, (6,))).all()  # type: ignore[misc]


def a_face(rng: np.random.Generator, scale: float = 1.0) -> F64:
    """(81, 2) points of a turned face in a picture of about 300 pixels."""
    turn, points = rng.uniform(-3, 3), ReferenceFrame.canonical(96).points
    linear = scale * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.asarray((points - points.mean(0)) @ linear + 150 + rng.normal(0, scale, points.shape))


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(0.1, 20))
def test_upright_box(seed: int, scale: float) -> None:
    points = a_face(np.random.default_rng(seed), scale)

    def arguments() -> tuple[Any, ...]:
        return points, OUTER_EYE_CORNERS, np.zeros(4)

    assert_alike(both("upright_box", arguments, (2,)), 1e-6)


@compiled
@settings(max_examples=50, deadline=None)
@given(seeds, st.sampled_from([0.0, 0.01, 1.5, 4.0]), st.floats(-4, 9), st.booleans())
def test_judge_points(seed: int, scale: float, bias: float, is_finite: bool) -> None:
    rng = np.random.default_rng(seed)
    points, sigma = a_face(rng, scale), rng.uniform(0, 4, POINTS)
    if not is_finite:
        points[rng.integers(POINTS)] = np.nan
    rules = calibration().rules

    def arguments() -> tuple[Any, ...]:
        return points, sigma, bias, 200.0, 180.0, OUTER_EYE_CORNERS, rules, np.zeros(POINTS, np.float32)

    assert_alike(both("judge_points", arguments, (7,)), 1e-6)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(0.5, 9))
def test_correct_points(seed: int, scale: float) -> None:
    points, found = a_face(np.random.default_rng(seed), scale), shipped()
    known = found._centre, found._axes, found._scale, found._weights

    def arguments() -> tuple[Any, ...]:
        return points, PARTS, *known, MAX_FEATURE, FULL_TURN, np.zeros((POINTS, 2))

    assert_alike(both("correct_points", arguments, (8,)), MOST_PIXELS)


@compiled
@settings(max_examples=50, deadline=None)
@given(seeds, st.floats(0.7, 1.4), st.floats(0, 60), st.sampled_from([1.0, 20.0]))
def test_plausible_motion(seed: int, growth: float, shift: float, noise: float) -> None:
    rng = np.random.default_rng(seed)
    before = a_face(rng, 2.0)
    after = growth * before + shift + rng.normal(0, noise, before.shape)

    def arguments() -> tuple[Any, ...]:
        return before, after, OUTER_EYE_CORNERS, MOTION

    assert_alike(both("plausible_motion", arguments, ()), 0)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.sampled_from([(1, 1), (2, 1), (2, 2)]), st.integers(1, 60))
def test_samples(seed: int, step: tuple[int, int], count: int) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (30, 44, 3), np.uint8)[2:, 3:]
    luma, *chroma = (rng.integers(0, 256, shape, np.uint8) for shape in ((28, 40), (14, 20), (14, 20)))
    points = rng.uniform(-9, 50, (count, 2)).astype(np.float32)
    to_chroma = np.array([1 / step[0], 1 / step[1], 0, (step[1] - 1) / 2], np.float32)
    to_rgb = rng.normal(0, 0.6, (3, 4)).astype(np.float32)

    def of_picture() -> tuple[Any, ...]:
        return side_by_side(picture), points, np.zeros((count, 3), np.float32)

    def of_planes() -> tuple[Any, ...]:
        return luma, *chroma, points, to_chroma, to_rgb, np.zeros((count, 3), np.float32)

    assert_alike(both("sample_picture", of_picture, (2,)), 0.01)
    assert_alike(both("sample_planes", of_planes, (6,)), 0.01)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.booleans(), st.integers(0, 4), st.floats(-40, 40))
def test_solid_fit(seed: int, is_known: bool, steps: int, yaw: float) -> None:
    rng = np.random.default_rng(seed)
    prior, turn = SolidPrior.shipped(), np.radians(yaw)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    points = HeadPose(rotation, 150.0, np.array([200.0, 180.0])).apply(prior.mean) + rng.normal(
        0, 3, (POINTS, 2)
    )
    modes = prior.movement if is_known else prior._modes
    middle, precision = rng.normal(0, 0.3, len(modes)), rng.uniform(0.5, 9, len(modes))

    def arguments() -> tuple[Any, ...]:
        return (
            points, prior.mean, modes, prior.noise, middle, precision, steps, 3.0,
            np.eye(3), np.array([140.0, 190.0, 190.0]), middle.copy(), np.zeros((POINTS, 3)),
        )  # fmt: skip

    assert_alike(both("solid_fit", arguments, (8, 9, 10, 11)), 1e-6)


@compiled
@settings(max_examples=40, deadline=None)
@given(seeds, st.sampled_from([1, 3]), st.floats(4, 900), st.floats(-4, 4))
def test_upright_crop(seed: int, parts: int, side: float, turn: float) -> None:
    rng = np.random.default_rng(seed)
    picture = rng.integers(0, 256, (*(int(side) for side in rng.integers(3, 150, 2)), parts), np.uint8)
    centre = rng.uniform(-20, 170, 2)
    to_picture = crop_to_picture(centre, side, turn, (SIZE, SIZE))

    def arguments() -> tuple[Any, ...]:
        return picture, to_picture, np.zeros((SIZE, SIZE, 3), np.uint8)

    assert_alike(both("upright_crop", arguments, (2,)), MOST_LEVELS)


@compiled
@settings(max_examples=40, deadline=None)
@given(seeds, st.floats(20, 400), st.floats(-4, 4), st.integers(0, 1), st.integers(0, 1))
def test_upright_planes(seed: int, side: float, turn: float, shift_x: int, shift_y: int) -> None:
    rng = np.random.default_rng(seed)
    size = rng.integers(200, 300, 2)
    luma = rng.integers(0, 256, size, np.uint8)
    first, second = rng.integers(0, 256, (2, *(-(-size // (1 << np.array([shift_y, shift_x]))))), np.uint8)
    to_picture = crop_to_picture(rng.uniform(60, 200, 2), side, turn, (SIZE, SIZE))
    to_chroma = np.array([1 / (1 << shift_x), 1 / (1 << shift_y), shift_x / 2, shift_y / 2])
    to_rgb = np.array(
        [[0, 0, 1, 0], [0.8, 0, 0, 20], [0, 1, 0, -3]], np.float32
    )  # so that they are told apart

    def arguments() -> tuple[Any, ...]:
        return luma, first, second, to_chroma, to_rgb, to_picture, np.zeros((SIZE, SIZE, 3), np.uint8)

    assert_alike(both("upright_planes", arguments, (6,)), MOST_LEVELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.booleans(), st.floats(0, 4))
def test_transfer_shape(seed: int, learned: bool, noise: float) -> None:
    rng = np.random.default_rng(seed)
    reference, prior = ReferenceFrame.canonical(96), SolidPrior.shipped()
    pose = HeadPose(np.linalg.qr(np.eye(3) + rng.normal(0, 0.2, (3, 3)))[0], 280.0, np.zeros(2))
    people = [SolidFit(pose, *2 * [np.zeros(0)], *2 * [prior.at_rest(rng.normal(size=32))]) for _ in range(2)]
    transfer = ShapeTransfer(people[0], people[1], reference, learned=learned)
    shape = 3 * reference.points + rng.normal(0, noise, (POINTS, 2))
    given: list[Any] = []
    with patch("guise.aam.shape_transfer.transfer_shape", lambda *arguments: given.extend(arguments)):
        transfer.apply(shape, pose)

    def arguments() -> tuple[Any, ...]:
        return *given[:-1], np.zeros((POINTS, 2))

    assert_alike(both("transfer_shape", arguments, (20,)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(1, 900))
def test_place_points(seed: int, side: float) -> None:
    rng = np.random.default_rng(seed)
    found, deviations = (rng.uniform(0, SIZE, shape).astype(np.float32) for shape in ((POINTS, 2), POINTS))
    to_picture = crop_to_picture(rng.uniform(0, 900, 2), side, rng.uniform(-3, 3), (SIZE, SIZE))

    def arguments() -> tuple[Any, ...]:
        return found, deviations, to_picture, np.zeros((POINTS, 2)), np.zeros(POINTS)

    assert_alike(both("place_points", arguments, (3, 4)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.floats(0.01, 30))
def test_filter_shape(seed: int, noise: float) -> None:
    rng = np.random.default_rng(seed)
    shape, gain = a_face(rng, 2.0), ShapeFilter()._gain
    last, steps = shape + rng.normal(0, noise, shape.shape), rng.normal(0, noise, shape.shape)

    def arguments() -> tuple[Any, ...]:
        return shape, gain, OUTER_EYE_CORNERS, steps.copy(), last.copy()

    assert_alike(both("filter_shape", arguments, (3, 4)), MOST_PIXELS)


@compiled
@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(1, 40), st.integers(1, 9))
def test_colour_planes(seed: int, width: int, height: int) -> None:
    wide = np.random.default_rng(seed).integers(0, 256, (height, width + 3, 3), np.uint8)

    def arguments() -> tuple[Any, ...]:
        return wide[:, 1 : width + 1], MIDDLE_GREY, np.zeros((3, height, width), np.float32)

    assert_alike(both("colour_planes", arguments, (2,)), 0)
