"""Covers: the box of a face is hidden whole, nothing of it can be read back, and the rest stays as it was."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from guise.aam.landmarks.heads import region
from guise.app.media import Frame
from guise.app.media.pictures import save_picture
from guise.app.swapping.cover import Covering, cover

BOX = np.array([60, 70, 120, 140], np.float32)
STYLES = ("solid", "mosaic", "blur", Covering.of("emoji"), Covering.of("mosaic", 5))


def noise(width: int = 200, height: int = 220, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize("style", STYLES)
def test_no_pixel_of_the_face_is_left(style: Any) -> None:
    rgb = noise()
    frame = Frame.from_rgb(rgb)
    cover(frame, region(BOX), style)
    inner = np.s_[70:141, 60:121]
    after, before = frame.rgb()[inner].astype(float), rgb[inner].astype(float)
    for channel in range(3):
        if np.ptp(after[..., channel]):
            assert abs(np.corrcoef(after[..., channel].ravel(), before[..., channel].ravel())[0, 1]) < 0.25
    assert (np.abs(after - before).max(-1) > 0).mean() > 0.99


def test_a_solid_cover_is_the_same_for_every_face() -> None:
    covered = []
    for seed in (1, 2):
        frame = Frame.from_rgb(noise(seed=seed))
        cover(frame, region(BOX), "solid")
        covered.append(frame.rgb()[70:141, 60:121])
    np.testing.assert_array_equal(*covered)
    assert np.ptp(covered[0]) <= 1


@pytest.mark.parametrize("style", STYLES)
def test_pixels_far_from_the_face_stay(style: Any) -> None:
    rgb = noise()
    frame = Frame.from_rgb(rgb)
    changed = cover(frame, region(BOX), style)
    assert changed is not None
    x0, y0, x1, y1 = changed
    same = (frame.rgb() == rgb).all(-1)
    same[y0:y1, x0:x1] = True
    assert same.all()


def test_the_region_grows_when_the_face_was_not_seen() -> None:
    near, far = region(BOX), region(BOX, 1.5)
    assert (far[:2] < near[:2]).all()
    assert (far[2:] > near[2:]).all()


def test_forehead_ears_and_chin_are_in_the_region() -> None:
    x0, y0, x1, y1 = region(BOX)
    width, height = BOX[2:] - BOX[:2]
    assert y0 <= BOX[1] - 0.5 * height
    assert y1 >= BOX[3] + 0.2 * height
    assert x0 <= BOX[0] - 0.25 * width
    assert x1 >= BOX[2] + 0.25 * width


def test_what_lies_beyond_the_picture_is_no_error() -> None:
    frame = Frame.from_rgb(noise(64, 64))
    assert cover(frame, region(np.array([-300, -300, -250, -250])), "solid") is None
    assert cover(frame, region(np.array([-20, -20, 30, 30])), "mosaic") is not None


def test_what_a_mosaic_keeps_is_too_little_for_a_face() -> None:
    frame = Frame.from_rgb(noise())
    cover(frame, region(BOX), "mosaic")
    colours = {tuple(c) for c in frame.rgb()[75:135:2, 65:115:2].reshape(-1, 3).tolist()}
    assert len(colours) <= 30


def test_a_picture_lies_on_the_cover_and_the_strongest_mosaic_leaves_two_cells(tmp_path: Path) -> None:
    save_picture(tmp_path / "red.png", np.full((30, 60, 3), (255, 0, 0), np.uint8))
    shown = {}
    for name in (f"image:{tmp_path / 'red.png'}", "emoji", "mosaic"):
        frame = Frame.from_rgb(noise())
        cover(frame, region(BOX), Covering.of(name, 5))
        shown[name[:5]] = frame.rgb()[75:135, 65:115].astype(int)
    middle = shown["image"][20:40]
    assert (np.abs(middle - (254, 0, 0)).max(-1) < 8).all()
    assert np.ptp(shown["image"][:5], axis=(0, 1)).max() <= 1, "above and below it is solid"
    assert (shown["emoji"][..., 0] - shown["emoji"][..., 2]).max() > 150, "yellow"
    assert len({tuple(c) for c in shown["mosai"][::2, ::2].reshape(-1, 3).tolist()}) <= 4
    for name in ("pixels", "image:", "smiley"):
        with pytest.raises(ValueError, match="it must be one of solid, mosaic, blur, emoji and image:FILE"):
            Covering.of(name)
