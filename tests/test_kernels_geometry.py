"""The compiled kernels of points and samples beside their NumPy twins, as in `test_kernels.py`."""

from dataclasses import astuple
from typing import Any

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from test_kernels import assert_alike, both, compiled, seeds

from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.tracker import FEATURE_RESOLUTION, Cascade
from guise.aam.tracker import LIMITS as TRACKER

MOST_PIXELS = 1e-3  # between a kernel and its twin in places


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
