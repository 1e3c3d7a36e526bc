"""Principal components, texture sampling, and which frames count as a face at rest."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import FRAME, SAMPLES, appearance
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.appearance import (
    SHAPE_ENTRIES,
    appearance_vectors,
    neutral_frames,
    openness,
    principal_components,
    sample_texture,
)
from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    LEFT_EYE_OUTER,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    RIGHT_EYE_OUTER,
)
from guise.aam.similarity import Similarity

SEEDS = st.integers(0, 10_000)


def cloud(seed: int, m: int = 30, n: int = 12) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(m, n)) * np.geomspace(20, 0.1, n) @ rng.normal(size=(n, n)) + 50).astype(
        np.float32
    )


@given(SEEDS, st.floats(0.3, 1))
@pytest.mark.slow
def test_basis_is_orthonormal_and_deviations_fall(seed: int, retain: float) -> None:
    pca = principal_components(cloud(seed), retain)
    assert_allclose(pca.basis.T @ pca.basis, np.eye(pca.modes), atol=1e-5)
    assert (np.diff(pca.deviations) <= 1e-4).all()


@given(SEEDS, st.floats(0.3, 0.999))
@pytest.mark.slow
def test_retained_variance_is_reached_with_as_few_modes_as_possible(seed: int, retain: float) -> None:
    pca = principal_components(cloud(seed), retain)
    assert pca.retained >= retain - 1e-6
    fewer = (pca.deviations[:-1].astype(float) ** 2).sum() / pca.total_variance
    assert fewer < retain + 1e-6


@given(SEEDS, st.integers(1, 12))
@pytest.mark.slow
def test_variance_outside_the_basis_is_what_retained_says(seed: int, modes: int) -> None:
    vectors = cloud(seed)
    pca = principal_components(vectors, modes)
    assert pca.modes == modes
    residual = vectors - pca.synthesise(pca.project(vectors))
    total = ((vectors - vectors.mean(0)) ** 2).sum()
    assert 1 - (residual**2).sum() / total == pytest.approx(pca.retained, abs=1e-3)


@given(SEEDS)
@pytest.mark.slow
def test_deviations_are_those_of_the_parameters(seed: int) -> None:
    vectors = cloud(seed)
    pca = principal_components(vectors, 5)
    assert_allclose(pca.project(vectors).std(0), pca.deviations, rtol=1e-2, atol=1e-3)


@given(SEEDS)
@pytest.mark.slow
def test_projection_undoes_synthesis(seed: int) -> None:
    pca = principal_components(cloud(seed), 4)
    parameters = np.random.default_rng(seed).normal(size=(3, 4)).astype(np.float32)
    assert_allclose(pca.project(pca.synthesise(parameters)), parameters, atol=1e-3)


def test_first_mode_is_the_direction_of_most_variance() -> None:
    rng = np.random.default_rng(0)
    direction = np.array([3, 4, 0]) / 5
    vectors = (rng.normal(size=(50, 1)) * 10 * direction + rng.normal(size=(50, 3)) * 0.1).astype(np.float32)
    assert abs(principal_components(vectors, 1).basis[:, 0] @ direction) > 0.999


def test_vectors_all_alike_have_one_empty_mode() -> None:
    pca = principal_components(np.ones((4, 6), np.float32), 0.9)
    assert pca.modes == 1
    assert pca.retained == 1
    assert_allclose(pca.project(np.ones(6, np.float32)), 0)


@pytest.mark.parametrize(
    ("retain", "message"),
    [
        (0, "the number of modes must be at least 1, got 0"),
        (0.0, r"the retained variance must be in \(0, 1\], got 0.0"),
        (1.5, r"the retained variance must be in \(0, 1\], got 1.5"),
    ],
)
def test_wrong_share_to_retain(retain: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        principal_components(cloud(0), retain)


def smooth_picture(seed: int, height: int = 240, width: int = 320) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width, 3))
    blurred = cv2.GaussianBlur(noise, (0, 0), 8)
    return cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def test_texture_on_the_reference_shape_is_the_picture_itself() -> None:
    picture = smooth_picture(0, *FRAME.size)
    assert_allclose(sample_texture(picture, FRAME.points, FRAME), picture[FRAME.mask], atol=0.01)


@given(st.floats(-30, 30), st.floats(0.9, 1.2), st.integers(0, 20))
@pytest.mark.slow
def test_texture_moves_with_picture_and_shape(angle: float, scale: float, seed: int) -> None:
    """Turn, scale and shift a picture and the shape in it alike: the texture stays."""
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    about = np.array([160.0, 120.0])
    turn = Similarity(scale, np.array([[c, -s], [s, c]]), np.zeros(2))
    pose = Similarity(scale, turn.rotation, about - turn.apply(about[None])[0] + [3.3, -2.7])
    picture, shape = smooth_picture(seed), FRAME.points * 2 + [120, 80]
    moved = cv2.warpAffine(picture, np.column_stack([pose.linear, pose.translation]), (320, 240))
    before, after = sample_texture(picture, shape, FRAME), sample_texture(moved, pose.apply(shape), FRAME)
    assert np.abs(after - before).mean() < 1.5


def test_large_faces_are_reduced_by_area_not_by_picking_pixels() -> None:
    """A chequered face of single pixels has the mean everywhere; bilinear picking would show a pattern."""
    ys, xs = np.mgrid[:400, :400]
    chequered = np.repeat((((xs + ys) % 2) * 255).astype(np.uint8)[..., None], 3, axis=2)
    texture = sample_texture(chequered, FRAME.points * 8 + 30, FRAME)
    assert_allclose(texture, 127.5, atol=30)
    assert texture.std() < 10


def test_a_face_outside_the_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="the face lies outside the picture"):
        sample_texture(smooth_picture(0), FRAME.points + 900, FRAME)


@given(SEEDS)
@pytest.mark.slow
def test_vectors_come_apart_into_shape_and_texture(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = appearance(1)
    shapes = FRAME.points + rng.normal(size=(4, 81, 2))
    textures = rng.uniform(0, 255, (4, len(FRAME.pixels), 3)).astype(np.float32)
    vectors = appearance_vectors(shapes, textures, FRAME)
    assert vectors.shape == (4, SHAPE_ENTRIES + textures[0].size)
    for vector, shape, texture in zip(vectors, shapes, textures, strict=True):
        assert_allclose(model.shape_of(vector), FRAME.align(shape), atol=1e-3)
        assert_array_equal(model.texture_of(vector), texture)


def test_pixels_of_no_weight_show_the_mean_in_every_frame() -> None:
    rng = np.random.default_rng(0)
    textures = rng.uniform(0, 255, (5, len(FRAME.pixels), 3)).astype(np.float32)
    weights = np.ones(len(FRAME.pixels), np.float32)
    weights[:7] = 0
    vectors = appearance_vectors(np.stack([FRAME.points] * 5), textures, FRAME, weights)
    damped = vectors[:, SHAPE_ENTRIES:].reshape(textures.shape)
    assert_allclose(damped[:, :7], np.broadcast_to(textures[:, :7].mean(0), (5, 7, 3)), rtol=1e-4)
    assert_allclose(damped[:, 7:], textures[:, 7:], rtol=1e-4)


def test_picture_is_the_texture_on_the_grid() -> None:
    model = appearance(1)
    picture = model.picture(model.components.mean)
    assert picture.dtype == np.uint8
    assert_allclose(picture[FRAME.mask], model.texture_of(model.components.mean).clip(0, 255), atol=0.51)


def test_neutral_parameters_are_the_projection_of_the_neutral_face() -> None:
    model = appearance(4)
    assert_allclose(
        model.components.synthesise(model.neutral_parameters), model.neutral, rtol=1e-4, atol=1e-2
    )


@pytest.fixture(scope="module")
def talk() -> np.ndarray:
    return np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(float)


def test_openness_measures_mouth_lids_and_brows_apart(talk: np.ndarray) -> None:
    rest = talk[neutral_frames(talk, FRAME)[0]]
    iod = np.linalg.norm(rest[LEFT_EYE_OUTER] - rest[RIGHT_EYE_OUTER])
    down, mouth, lids, brows = np.array([0, iod]), rest.copy(), rest.copy(), rest.copy()
    mouth[LOWER_INNER_LIP] += 0.1 * down
    lids[LOWER_LIDS] += 0.05 * down
    brows[BROW_TOPS] -= 0.2 * down
    changes = openness(np.stack([mouth, lids, brows])) - openness(rest[None])
    assert_allclose(np.diag(changes), [0.1, 0.05, 0.2], atol=0.02)
    assert_allclose(changes - np.diag(np.diag(changes)), 0, atol=1e-9)


@given(st.floats(0.3, 4), st.floats(-90, 90))
def test_openness_does_not_depend_on_size_or_roll(scale: float, angle: float) -> None:
    shapes = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][:5].astype(float)
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    moved = np.stack([Similarity(scale, np.array([[c, -s], [s, c]]), np.ones(2)).apply(x) for x in shapes])
    assert_allclose(openness(moved), openness(shapes), atol=1e-9)


@pytest.mark.parametrize("person", ["p01", "p02", "p06"])
def test_neutral_frames_have_the_mouth_shut_and_the_eyes_open(person: str) -> None:
    shapes = np.load(SAMPLES / person / "talk.npz")["landmarks"].astype(float)
    openings, chosen = openness(shapes), neutral_frames(shapes, FRAME)
    assert len(set(chosen)) == len(chosen) == 7
    assert openings[chosen, 0].max() < np.quantile(openings[:, 0], 0.2)
    assert openings[chosen, 1].min() > 0.9 * np.median(openings[:, 1])
    assert len(neutral_frames(shapes, FRAME, 3)) == 3
