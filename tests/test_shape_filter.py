"""The temporal filter of tracked shapes: jitter goes, motion stays."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER, UPPER_LIDS
from guise.aam.reference import ReferenceFrame
from guise.aam.shape_filter import ShapeFilter

FACE = ReferenceFrame.canonical(160).points
INTEROCULAR = float(np.linalg.norm(FACE[LEFT_EYE_OUTER] - FACE[RIGHT_EYE_OUTER]))


def jitter(points: np.ndarray) -> float:
    """Root mean square second difference of points (t, 81, 2), inter-ocular distances."""
    second = points[:-2] - 2 * points[1:-1] + points[2:]
    return float(np.sqrt((second**2).sum(2).mean())) / INTEROCULAR


def test_noise_on_a_face_at_rest_is_removed() -> None:
    noise = np.random.default_rng(0).normal(size=(200, 81, 2)) * 0.0005 * INTEROCULAR
    shape_filter = ShapeFilter()
    filtered = np.stack([shape_filter(FACE + n) for n in noise])
    assert jitter(filtered[5:]) < 0.3 * jitter(FACE + noise)
    assert np.abs(filtered[5:].mean(0) - FACE).max() < 0.0005 * INTEROCULAR


def test_a_blink_passes_at_once() -> None:
    shape_filter, shut = ShapeFilter(), FACE.copy()
    lids = UPPER_LIDS
    shut[lids, 1] += 0.08 * INTEROCULAR
    for _ in range(10):
        shape_filter(FACE)
    done = (shape_filter(shut) - FACE)[lids, 1] / (0.08 * INTEROCULAR)
    assert (done > 0.95).all()
    assert ((shape_filter(FACE) - FACE)[lids, 1] / (0.08 * INTEROCULAR) < 0.1).all()


def test_a_slow_drift_is_followed_closely() -> None:
    shape_filter = ShapeFilter()
    for t in range(100):
        here = FACE + np.array([0.002 * INTEROCULAR * t, 0])
        filtered = shape_filter(here)
    assert np.abs(filtered - here).max() < 0.006 * INTEROCULAR


def test_after_a_reset_the_next_shape_passes_unfiltered() -> None:
    shape_filter = ShapeFilter()
    shape_filter(FACE)
    shape_filter.reset()
    assert_allclose(shape_filter(FACE + 3), FACE + 3)
