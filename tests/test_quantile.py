"""Quantiles are those of NumPy."""

import numpy as np
import pytest

from guise.common.quantile import quantile


@pytest.mark.parametrize("count", [1, 2, 7, 40])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.9, 1.0])
def test_a_quantile_is_that_of_numpy(count: int, share: float) -> None:
    values = np.random.default_rng(count).normal(100, 30, count).astype(np.float32)
    assert quantile(values, share) == pytest.approx(float(np.quantile(values, share)), rel=1e-6)
