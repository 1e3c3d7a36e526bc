"""The finest structure of a frame's skin in a texture: pores, but no folds, and nothing on eyes."""

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    LEFT_EYE,
    LEFT_MOUTH_CORNER,
    LEFT_TEMPLE,
    RIGHT_MOUTH_CORNER,
    RIGHT_TEMPLE,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import Relief
from guise.app.swapping.own_skin import OwnSkin
from guise.common.arrays import F32, U8

REFERENCE = ReferenceFrame.canonical(96)
RELIEF = Relief.shipped(REFERENCE)
OWN = OwnSkin(RELIEF)
ZOOM = 2.0
MESH = (RELIEF.points + 0.5) * ZOOM - 0.5


def picture(luma: F32) -> U8:
    return np.repeat(luma[..., None].round().clip(0, 255), 3, axis=2).astype(np.uint8)


def shown(frame: F32, share: float = 1.0, factor: int = 2) -> F32:
    """What is added to a grey texture with so many pixels per grid pixel, of a frame (2 h, 2 w)."""
    h, w = REFERENCE.size
    texture = np.full((factor * h, factor * w, 3), 100, np.uint8)
    OWN.add(texture, picture(frame), MESH, ZOOM, share)
    assert (texture[..., 1:] == 100).all()
    return texture[..., 0].astype(np.float32) - 100


def pores() -> F32:
    h, w = REFERENCE.size
    noise = np.random.default_rng(1).standard_normal((2 * h, 2 * w)).astype(np.float32)
    return 100 + 6 * cv2.GaussianBlur(noise, (0, 0), 1)


def cheek(plane: F32, right: bool = True) -> F32:
    """A square of a plane (2 h, 2 w) on a cheek."""
    corners = (RIGHT_TEMPLE, RIGHT_MOUTH_CORNER) if right else (LEFT_TEMPLE, LEFT_MOUTH_CORNER)
    x, y = np.round(2 * REFERENCE.points[list(corners)].mean(0)).astype(int)
    return plane[y - 8 : y + 9, x - 8 : x + 9]


def test_pores_lie_where_they_are_in_the_frame() -> None:
    frame = pores()
    for right in (True, False):
        found, there = cheek(shown(frame), right), cheek(frame, right)
        assert np.corrcoef(found.ravel(), there.ravel())[0, 1] > 0.8
        assert found.std() > 0.3 * there.std()


def test_a_share_of_them_is_as_much_weaker() -> None:
    whole, half = (cheek(shown(pores(), share)).std() for share in (1.0, 0.5))
    assert 0.35 * whole < half < 0.65 * whole


def test_folds_stay_out() -> None:
    frame = pores()
    x, y = np.round(2 * REFERENCE.points[[RIGHT_TEMPLE, RIGHT_MOUTH_CORNER]].mean(0)).astype(int)
    frame[:, x - 1 : x + 2] -= 40
    assert np.abs(shown(frame)[y - 8 : y + 9, x - 1 : x + 2]).max() < 3


def test_light_and_eyes_stay_out() -> None:
    frame = pores() + np.linspace(-60, 60, 2 * REFERENCE.size[1], dtype=np.float32)
    added = shown(frame)
    assert abs(cheek(added).mean()) < 0.5
    x, y = np.round(2 * REFERENCE.points[LEFT_EYE].mean(0)).astype(int)
    assert np.abs(added[y - 3 : y + 4, x - 3 : x + 4]).max() <= 1


def test_a_texture_as_coarse_as_the_grid_gets_them_too() -> None:
    assert shown(pores(), factor=1).std() > 0.2
