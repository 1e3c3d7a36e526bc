"""Feathered alpha keeps inside the mask."""

import numpy as np
import pytest

from guise.render import RendererError, feather


def disc(radius: float, side: int = 120) -> np.ndarray:
    x, y = np.meshgrid(np.arange(side), np.arange(side))
    return np.hypot(x - side / 2, y - side / 2) <= radius


@pytest.mark.parametrize("sigma", [0.0, 0.5, 1.0, 3.3, 6.0])
def test_alpha_is_zero_outside_and_one_deep_inside(sigma: float) -> None:
    mask = disc(50)
    alpha = feather(mask, sigma)
    assert alpha.dtype == np.float32
    assert alpha[~mask].max() == 0
    assert alpha[60, 60] == 1
    assert alpha.min() >= 0
    assert alpha.max() <= 1


@pytest.mark.parametrize("sigma", [2.0, 6.0])
def test_alpha_rises_inwards_along_a_gaussian_edge(sigma: float) -> None:
    mask = np.zeros((80, 80), bool)
    mask[:, 10:] = True
    profile = np.pad(feather(np.pad(mask, 80, mode="edge"), sigma)[120, 80:160], 0)
    steps = np.diff(profile[: 10 + int(6 * sigma)])
    assert (steps >= -1e-6).all()
    at = np.arange(len(steps)) + 0.5
    centre = (steps * at).sum() / steps.sum()
    spread = np.sqrt((steps * (at - centre) ** 2).sum() / steps.sum())
    assert spread == pytest.approx(sigma, rel=0.1)
    assert profile[10] < 0.02


def test_the_border_of_the_picture_counts_as_outside() -> None:
    alpha = feather(np.ones((60, 60), bool), 4)
    assert alpha[0].max() < 0.01
    assert alpha[30, 30] == 1


def test_an_empty_mask_has_an_empty_alpha() -> None:
    assert not feather(np.zeros((20, 20), bool), 3).any()


@pytest.mark.parametrize(
    ("mask", "sigma", "message"),
    [
        (np.zeros((4, 4)), 1.0, r"mask must be \(h, w\) bool, got \(4, 4\) float64"),
        (np.zeros(4, bool), 1.0, "mask must be"),
        (disc(50), -1.0, "sigma must be a number of pixels >= 0, got -1.0"),
        (disc(50), float("nan"), "sigma must be"),
        (disc(5), 4.0, "too thin for a feather of sigma 4 px"),
    ],
)
def test_bad_arguments_are_refused(mask: np.ndarray, sigma: float, message: str) -> None:
    with pytest.raises(RendererError, match=message):
        feather(mask, sigma)
