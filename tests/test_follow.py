"""Following a person: tremble goes, motion stays."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from guise.aam.follow import Steadier
from guise.aam.reference import ReferenceFrame

FACE = ReferenceFrame.canonical(160).points
INTEROCULAR = float(np.linalg.norm(FACE[45] - FACE[36]))


def tremble(points: np.ndarray) -> float:
    """Root mean square second difference of points (t, 81, 2), inter-ocular distances."""
    second = points[:-2] - 2 * points[1:-1] + points[2:]
    return float(np.sqrt((second**2).sum(2).mean())) / INTEROCULAR


def test_noise_on_a_still_face_is_taken_out() -> None:
    noise = np.random.default_rng(0).normal(size=(200, 81, 2)) * 0.0005 * INTEROCULAR
    steadier = Steadier()
    steadied = np.stack([steadier(FACE + n) for n in noise])
    assert tremble(steadied[5:]) < 0.3 * tremble(FACE + noise)
    assert np.abs(steadied[5:].mean(0) - FACE).max() < 0.0005 * INTEROCULAR


def test_a_blink_passes_at_once() -> None:
    steadier, shut = Steadier(), FACE.copy()
    lids = [37, 38, 43, 44]
    shut[lids, 1] += 0.08 * INTEROCULAR
    for _ in range(10):
        steadier(FACE)
    done = (steadier(shut) - FACE)[lids, 1] / (0.08 * INTEROCULAR)
    assert (done > 0.95).all()
    assert ((steadier(FACE) - FACE)[lids, 1] / (0.08 * INTEROCULAR) < 0.1).all()


def test_a_slow_drift_is_followed_closely() -> None:
    steadier = Steadier()
    for t in range(100):
        here = FACE + np.array([0.002 * INTEROCULAR * t, 0])
        steadied = steadier(here)
    assert np.abs(steadied - here).max() < 0.006 * INTEROCULAR


def test_what_is_forgotten_does_not_hold_the_next_shape_back() -> None:
    steadier = Steadier()
    steadier(FACE)
    steadier.forget()
    assert_allclose(steadier(FACE + 3), FACE + 3)
