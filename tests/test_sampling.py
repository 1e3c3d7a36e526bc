"""Bilinear samples at points: any number of them, of pictures with any number of channels."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from guise.common.sampling import remap_points


def ramp(height: int, width: int) -> np.ndarray:
    """A picture (h, w, 2) float32 whose value at a pixel is its x and y: bilinear samples of it are exact."""
    ys, xs = np.mgrid[:height, :width]
    return np.stack([xs, ys], axis=-1).astype(np.float32)


def test_many_points_in_a_long_list_are_all_sampled() -> None:
    places = np.random.default_rng(0).uniform(0, 49, (70_000, 2)).astype(np.float32)
    assert_allclose(remap_points(ramp(50, 50), places), places, atol=0.04)  # cv2.remap: 1/32 pixel


def test_points_outside_a_picture_take_its_border_or_zero() -> None:
    places = np.array([[-5, 3], [99, 3]], np.float32)
    assert_allclose(remap_points(ramp(10, 20), places), [[0, 3], [19, 3]])
    assert not remap_points(ramp(10, 20), places, cv2.BORDER_CONSTANT).any()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_each_channel_is_sampled_as_if_alone(channels: tuple[int, ...], dtype: type) -> None:
    rng = np.random.default_rng(1)
    image = rng.uniform(0, 255, (30, 40, *channels)).astype(dtype)
    places = rng.uniform(-2, 42, (50, 2)).astype(np.float32)
    found = remap_points(image, places)
    assert found.shape == (50, *channels)
    assert found.dtype == np.float32
    for k in range(sum(channels)):
        alone = np.ascontiguousarray(image[..., k])
        assert_array_equal(found[:, k], remap_points(alone, places))
