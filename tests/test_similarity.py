"""Similarity alignment: axioms, weights on noisy data, optimality, both scales, and what it refuses."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from guise.aam.similarity import (
    Failed,
    PlanarSimilarity,
    Similarity,
    align,
    align_complex,
    align_planar,
    align_rigid,
)

SEEDS = st.integers(0, 2**32 - 1)
DIMENSIONS = st.integers(2, 4)


def some_similarity(rng: np.random.Generator, dimension: int) -> Similarity:
    q, r = np.linalg.qr(rng.normal(size=(dimension, dimension)))
    q *= np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return Similarity(float(np.exp(rng.normal())), q, rng.normal(size=dimension) * 10)


def noisy_pair(rng: np.random.Generator, n: int = 12, dimension: int = 2) -> tuple[np.ndarray, np.ndarray]:
    """Points and their image under a similarity, off by a tenth of their spread."""
    source = rng.normal(size=(n, dimension))
    moved = some_similarity(rng, dimension)
    return source, moved.apply(source + 0.1 * rng.normal(size=source.shape))


def found(source: object, target: object, weights: object = None, **options: object) -> Similarity:
    answer = align(source, target, weights, **options)
    assert isinstance(answer, Similarity), answer
    return answer


def cost(s: Similarity, source: np.ndarray, target: np.ndarray, weights: np.ndarray) -> float:
    return float(weights @ ((s.apply(source) - target) ** 2).sum(1))


def assert_same(a: Similarity, b: Similarity, atol: float = 1e-9) -> None:
    assert_allclose(a.linear, b.linear, atol=atol)
    assert_allclose(a.translation, b.translation, atol=atol * 10)


@given(SEEDS, DIMENSIONS)
def test_identity_leaves_points_and_maps(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    points, one, s = (
        rng.normal(size=(5, dimension)),
        Similarity.identity(dimension),
        some_similarity(rng, dimension),
    )
    assert_allclose(one.apply(points), points)
    assert_same(one @ s, s)
    assert_same(s @ one, s)


@given(SEEDS, DIMENSIONS)
def test_inverse_undoes(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    points, s = rng.normal(size=(5, dimension)), some_similarity(rng, dimension)
    assert_allclose(s.inverse().apply(s.apply(points)), points, atol=1e-9)
    assert_same(s @ s.inverse(), Similarity.identity(dimension))
    assert_same(s.inverse() @ s, Similarity.identity(dimension))


@given(SEEDS, DIMENSIONS)
def test_composition_is_one_after_the_other_and_associative(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = (some_similarity(rng, dimension) for _ in range(3))
    points = rng.normal(size=(5, dimension))
    assert_allclose((a @ b).apply(points), a.apply(b.apply(points)), rtol=1e-9, atol=1e-9)
    left, right = (a @ b) @ c, a @ (b @ c)
    assert_allclose(left.apply(points), right.apply(points), rtol=1e-9, atol=1e-9)


@given(SEEDS, DIMENSIONS, st.sampled_from(["least-squares", "symmetric"]))
def test_exact_data_gives_the_map_back(seed: int, dimension: int, scale: str) -> None:
    rng = np.random.default_rng(seed)
    source, truth = rng.normal(size=(10, dimension)), some_similarity(rng, dimension)
    assert_same(found(source, truth.apply(source), rng.random(10) + 0.1, scale=scale), truth, 1e-7)


@given(SEEDS, DIMENSIONS)
def test_rotations_are_proper(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    rotation = found(
        rng.normal(size=(6, dimension)), rng.normal(size=(6, dimension)), scale="symmetric"
    ).rotation
    assert_allclose(rotation @ rotation.T, np.eye(dimension), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1)


@given(SEEDS, DIMENSIONS)
def test_the_answer_beats_perturbations(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = noisy_pair(rng, dimension=dimension)
    weights = rng.random(len(source)) + 0.05
    best = found(source, target, weights)
    least = cost(best, source, target, weights)
    for size in (1e-3, 1e-1):
        for _ in range(10):
            turn = some_similarity(rng, dimension).rotation
            near = np.linalg.qr(np.eye(dimension) + size * (turn - turn.T))[0]
            near *= np.sign(np.diag(near))
            other = Similarity(
                best.scale * math.exp(size * rng.normal()),
                near @ best.rotation,
                best.translation + size * rng.normal(size=dimension),
            )
            assert np.linalg.det(other.rotation) > 0
            assert cost(other, source, target, weights) > least


@given(SEEDS)
def test_equal_weights_are_no_weights(seed: int) -> None:
    source, target = noisy_pair(np.random.default_rng(seed))
    assert_same(found(source, target, np.full(len(source), 3.0)), found(source, target))


@given(SEEDS, DIMENSIONS)
def test_a_point_of_no_weight_is_a_point_removed(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = noisy_pair(rng, dimension=dimension)
    target[0] += 5  # far off, so that it would show
    weights = np.ones(len(source))
    weights[0] = 0
    assert_same(found(source, target, weights), found(source[1:], target[1:]))
    weights[0] = 1e-12
    assert_same(found(source, target, weights), found(source[1:], target[1:]), 1e-6)
    assert not np.allclose(found(source, target).linear, found(source[1:], target[1:]).linear, atol=1e-3)


@given(SEEDS, DIMENSIONS)
def test_a_point_twice_is_a_point_of_weight_two(seed: int, dimension: int) -> None:
    source, target = noisy_pair(np.random.default_rng(seed), dimension=dimension)
    twice = found(np.vstack([source, source[:1]]), np.vstack([target, target[:1]]))
    weights = np.ones(len(source))
    weights[0] = 2
    assert_same(found(source, target, weights), twice)


@given(SEEDS, DIMENSIONS)
def test_reflected_data_gives_the_best_rotation_not_a_reflection(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(10, dimension)) * np.arange(dimension, 0, -1)
    mirrored = source * ([-1] + [1] * (dimension - 1))
    answer = align(source, mirrored)
    assert isinstance(answer, Similarity)
    assert np.linalg.det(answer.rotation) == pytest.approx(1)
    weights = np.full(10, 0.1)
    least = cost(answer, source, mirrored, weights)
    for _ in range(20):
        other = Similarity(answer.scale, some_similarity(rng, dimension).rotation, answer.translation)
        assert cost(other, source, mirrored, weights) >= least - 1e-9


@given(SEEDS)
def test_symmetric_scale_is_the_ratio_of_spreads_and_inverts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = noisy_pair(rng, dimension=3)
    weights = rng.random(len(source)) + 0.1
    there = found(source, target, weights, scale="symmetric")
    back = found(target, source, weights, scale="symmetric")
    assert_same(there @ back, Similarity.identity(3), 1e-7)
    share = weights / weights.sum()
    spread = [np.sqrt(share @ ((p - share @ p) ** 2).sum(1)) for p in (source, target)]
    assert there.scale == pytest.approx(spread[1] / spread[0])


@given(SEEDS)
def test_least_squares_scale_shrinks_on_noise_and_symmetric_does_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    colours = rng.normal(size=(500, 3)) * [40, 30, 20] + 120
    noisy = colours + rng.normal(size=colours.shape) * 20
    shrunk = found(noisy, colours)
    kept = found(noisy, colours, scale="symmetric")
    assert shrunk.scale < kept.scale
    assert (kept.apply(noisy).var(0).sum()) == pytest.approx(colours.var(0).sum())
    assert (shrunk.apply(noisy).var(0).sum()) < 0.95 * colours.var(0).sum()


def test_rgb_palette_is_carried_over() -> None:
    rng = np.random.default_rng(0)
    colours = rng.uniform(40, 200, (200, 3))
    warmer = Similarity(0.8, np.eye(3), np.array([30.0, 20.0, 10.0]))
    assert_same(found(colours, warmer.apply(colours)), warmer, 1e-7)


def test_prior_pulls_the_rotation_towards_the_identity() -> None:
    rng = np.random.default_rng(1)
    angle = np.deg2rad(50)
    turn = Similarity(
        1.0, np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), np.zeros(2)
    )
    source = rng.normal(size=(20, 2))
    angles = []
    for prior in (0.0, 0.5, 2.0, 1e6):
        rotation = found(source, turn.apply(source), scale="symmetric", prior=prior).rotation
        angles.append(np.rad2deg(np.arctan2(rotation[1, 0], rotation[0, 0])))
    assert angles[0] == pytest.approx(50)
    assert angles == sorted(angles, reverse=True)
    assert angles[-1] == pytest.approx(0, abs=1e-3)


@given(SEEDS)
def test_planar_closed_form_is_the_general_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, target = noisy_pair(rng)
    weights = rng.random(len(source)) + 0.01
    weights /= weights.sum()
    fit = align_planar(source, target, weights)
    a, b, tx, ty = fit
    general = found(source, target, weights)
    assert_allclose([[a, -b], [b, a]], general.linear, atol=1e-9)
    assert_allclose([tx, ty], general.translation, atol=1e-9)
    assert_allclose(fit.apply(source), general.apply(source), atol=1e-9)
    assert fit.scale == pytest.approx(general.scale)


def test_the_inverse_takes_points_back() -> None:
    points = np.random.default_rng(4).normal(50, 20, (9, 2))
    there = PlanarSimilarity(-0.4, 1.3, 20.0, -70.0)
    assert_allclose(there.inverse.apply(there.apply(points)), points, atol=1e-10)


@given(SEEDS, DIMENSIONS)
def test_rigid_motions_are_the_general_answer_without_its_scale(seed: int, dimension: int) -> None:
    rng = np.random.default_rng(seed)
    pairs = [noisy_pair(rng, dimension=dimension) for _ in range(3)]
    sources, targets = (np.stack(points) for points in zip(*pairs, strict=True))
    weights = rng.random(sources.shape[:2]) + 0.01
    for rotation, shift, source, target, own in zip(
        *align_rigid(sources, targets, weights), sources, targets, weights, strict=True
    ):
        general = found(source, target, own)
        assert_allclose(rotation, general.rotation, atol=1e-9)
        mean = own @ source / own.sum(), own @ target / own.sum()
        assert_allclose(rotation @ mean[0] + shift, mean[1], atol=1e-9)


@given(SEEDS)
def test_complex_similarities_of_a_batch_are_the_general_answers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source = noisy_pair(rng)[0]
    targets = rng.normal(size=(2, 3, *source.shape)) + source
    scale, shift = align_complex(source @ [1, 1j], targets @ [1, 1j])
    assert scale.shape == shift.shape == (2, 3, 1)
    for index in np.ndindex(2, 3):
        general = align(source, targets[index])
        if not general:  # which it says of a source with no direction in common, too
            continue
        (s,), (t,) = scale[index], shift[index]
        assert_allclose([[s.real, -s.imag], [s.imag, s.real]], general.linear, atol=1e-9)
        assert_allclose([t.real, t.imag], general.translation, atol=1e-9)


@pytest.mark.parametrize("units", [(1e-6, 1.0), (1.0, 1e-6), (1e6, 1e-6), (1e9, 1.0)])
def test_units_do_not_matter(units: tuple[float, float]) -> None:
    source, target = (
        points * unit for points, unit in zip(noisy_pair(np.random.default_rng(3))[:2], units, strict=True)
    )
    here, there = align(source, target), align(source / units[0], target / units[1])
    assert here
    assert there
    assert_allclose(here.apply(source) / units[1], there.apply(source / units[0]), atol=1e-9)


@pytest.mark.parametrize(
    ("source", "target", "weights", "reason"),
    [
        ([[1, 1], [1, 1]], [[0, 0], [1, 0]], None, "coincident points"),
        ([[0, 0], [1, 0]], [[7, 7], [7, 7]], None, "coincident points"),
        ([[0, 0], [1, 0], [0, 1]], [[0, 0], [1, 0], [0, 1]], [1, 0, 0], "coincident points"),
        ([[0, 0], [1, 0]], [[0, 0], [1, 0]], [0, 0], "all weights are zero"),
        (
            [[1.0, 0], [-1, 0], [0, 1], [0, -1]],
            [[1.0, 0], [-1, 0], [0, -1], [0, 1]],
            None,
            "no common direction",
        ),
    ],
)
def test_expected_failures_are_falsy_and_say_why(
    source: list, target: list, weights: list, reason: str
) -> None:
    answer = align(source, target, weights)
    assert isinstance(answer, Failed)
    assert not answer
    assert reason in answer.reason


@pytest.mark.parametrize(
    ("source", "target", "weights", "message"),
    [
        (
            [[0, 0], [1, 0]],
            [[0, 0]],
            None,
            r"source and target must be \(n, d\) alike, got \(2, 2\) and \(1, 2\)",
        ),
        ([0, 1], [0, 1], None, r"source and target must be \(n, d\) alike, got \(2,\) and \(2,\)"),
        ([[0, 0], [1, 0]], [[0, 0], [1, 0]], [1, 1, 1], r"weights must be \(2,\), got \(3,\)"),
        ([[0, 0], [1, 0]], [[0, 0], [1, 0]], [1, -1], "weights must be finite and not negative"),
        ([[0, 0], [1, 0]], [[0, 0], [1, 0]], [1, np.nan], "weights must be finite and not negative"),
    ],
)
def test_wrong_arguments_are_named(source: list, target: list, weights: list, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        align(source, target, weights)
