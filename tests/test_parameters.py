"""The parameter estimator finds the parameters behind a shape and texels, whatever the light."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import appearance
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.appearance import AppearanceModel
from guise.aam.parameters import ParameterEstimator
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Similarity

FRAME = ReferenceFrame.canonical(48)
MODEL = appearance(5, modes=5, reference=FRAME, spread=900.0)
ESTIMATOR = ParameterEstimator(MODEL, places=900)
SEEDS = st.integers(0, 10_000)


def seen(parameters: np.ndarray, estimator: ParameterEstimator = ESTIMATOR) -> tuple[np.ndarray, np.ndarray]:
    """The shape in a frame, and the texels there, of a face with these parameters."""
    model: AppearanceModel = estimator.model
    vector = model.components.synthesise(parameters)
    pose = Similarity(2.5, np.array([[0.8, -0.6], [0.6, 0.8]]), np.array([200.0, 100.0]))
    return pose.apply(model.shape_of(vector)), model.texture_of(vector)[estimator.texels]


def some_parameters(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=5) * MODEL.components.deviations).astype(np.float32)


def deviations_off(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs((found - truth) / MODEL.components.deviations).max())


@given(SEEDS)
def test_parameters_come_back(seed: int) -> None:
    rho = some_parameters(seed)
    assert deviations_off(ESTIMATOR(*seen(rho)), rho) < 0.1
    assert np.corrcoef(ESTIMATOR(*seen(rho)), rho)[0, 1] > 0.99


def test_the_mean_face_has_no_parameters() -> None:
    assert_allclose(ESTIMATOR(*seen(np.zeros(5, np.float32))), 0, atol=0.05)


@given(SEEDS, st.floats(-15, 15), st.floats(0.85, 1.15))
def test_light_is_not_taken_for_expression(seed: int, offset: float, gain: float) -> None:
    """An offset and a gain of the mean face's colours change the parameters far less than one deviation."""
    shape, texels = seen(some_parameters(seed))
    mean = MODEL.texture_of(MODEL.components.mean)[ESTIMATOR.texels]
    lit = texels + offset + (gain - 1) * mean
    moved = ESTIMATOR(shape, lit) - ESTIMATOR(shape, texels)
    assert np.abs(moved / MODEL.components.deviations).max() < 0.3


@given(SEEDS)
def test_the_estimate_is_affine_in_the_texels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, a = seen(some_parameters(seed))
    b = a + rng.normal(size=a.shape).astype(np.float32) * 10
    middle = ESTIMATOR(shape, (a + b) / 2)
    assert_allclose(middle, (ESTIMATOR(shape, a) + ESTIMATOR(shape, b)) / 2, atol=0.2)


def test_noise_in_the_texels_moves_the_estimate_little() -> None:
    rng = np.random.default_rng(0)
    shape, texels = seen(some_parameters(1))
    quiet, noisy = ESTIMATOR(shape, texels), ESTIMATOR(shape, texels + rng.normal(size=texels.shape) * 6)
    assert deviations_off(noisy, quiet) < 0.3
    assert deviations_off(noisy, quiet) > 0


def test_texels_are_face_and_their_choice_is_repeatable() -> None:
    mask = FRAME.mask.copy()
    mask[:, : FRAME.size[1] // 2] = False
    half = AppearanceModel(FRAME, MODEL.components, MODEL.neutral, mask)
    estimator = ParameterEstimator(half, places=300)
    assert len(estimator.texels) == len(set(estimator.texels.tolist())) == 300
    assert mask[FRAME.mask][estimator.texels].all()
    assert_array_equal(estimator.texels, ParameterEstimator(half, places=300).texels)
    assert not np.array_equal(estimator.texels, ParameterEstimator(half, places=300, seed=1).texels)


def test_more_places_than_there_are_take_them_all() -> None:
    estimator = ParameterEstimator(MODEL, places=10**6)
    assert len(estimator.texels) == len(FRAME.pixels)


def test_skin_texels_are_skin() -> None:
    from guise.aam.mask import skin_mask

    skin = skin_mask(FRAME)[FRAME.mask]
    assert skin[ESTIMATOR.texels[ESTIMATOR.skin]].all()
    assert len(ESTIMATOR.skin) > 100


@pytest.mark.parametrize("places", [200, 900])
def test_samples_are_taken_under_the_shape(places: int) -> None:
    """The sampler's places on the aligned shape are the texels' grid pixels."""
    estimator = ParameterEstimator(MODEL, places=places)
    ys, xs = np.divmod(FRAME.pixels[estimator.texels], FRAME.size[1])
    assert_allclose(estimator.sampler.positions(FRAME.points), np.column_stack([xs, ys]), atol=1e-3)
