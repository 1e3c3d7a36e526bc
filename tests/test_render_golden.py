"""Golden pictures through EGL: the committed PNG is what was once looked at and found right.

After a wanted change: GUISE_UPDATE_GOLDEN=1 pytest tests/test_render_golden.py, then look at tests/golden.
"""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import Delaunay

from guise.render import feather, make_compositor

GOLDEN = Path(__file__).parent / "golden"
LANDMARKS = Path(__file__).parents[1] / "sample_videos" / "p01" / "talk.npz"
SIDE = 128
SCENES = {  # frame, scale and shift of the face, opacity
    "straight": (0, 1.0, (0.0, 0.0), 1.0),
    "turned": (100, 1.0, (1.3, -0.6), 1.0),
    "cut_and_half": (250, 1.4, (-40.0, 20.5), 0.5),
}


def landmarks(frame: int) -> np.ndarray:
    with np.load(LANDMARKS) as data:
        points = data["landmarks"][frame]
    points = points - points.min(0)
    return points * ((SIDE - 12) / points.max()) + 6


def texture() -> np.ndarray:
    """Coloured cells with soft borders: position and orientation can be read off."""
    y, x = np.mgrid[:SIDE, :SIDE]
    cells = ((x // 12 + y // 12) % 2) * 110
    image = np.stack([cells + 60, x * 255 // SIDE, y * 255 // SIDE], -1).astype(np.uint8)
    return cv2.GaussianBlur(image, (0, 0), 1.5)


def backdrop() -> np.ndarray:
    y, x = np.mgrid[:SIDE, :SIDE]
    return np.stack([x + y // 2, 200 - y, (x // 8 % 2) * 40 + 40], -1).astype(np.uint8)


def draw(renderer: str, scene: str) -> np.ndarray:
    frame, scale, shift, opacity = SCENES[scene]
    uv = landmarks(0).astype(np.float32)
    mask = np.zeros((SIDE, SIDE), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(uv).astype(np.int32), 1)
    triangles = Delaunay(uv).simplices.astype(np.int32)
    with make_compositor(renderer, triangles, uv, feather(mask > 0, 3)) as compositor:
        return compositor.composite(backdrop(), texture(), landmarks(frame) * scale + shift, opacity)


def golden(scene: str) -> np.ndarray:
    image = cv2.imread(str(GOLDEN / f"render_{scene}.png"), cv2.IMREAD_COLOR_RGB)
    assert image is not None, "no golden picture: run with GUISE_UPDATE_GOLDEN=1 and look at it"
    return image


@pytest.mark.egl
@pytest.mark.parametrize("scene", SCENES)
def test_gl_draws_the_golden_picture(scene: str) -> None:
    drawn = draw("gl", scene)
    if os.environ.get("GUISE_UPDATE_GOLDEN") == "1":
        cv2.imwrite(str(GOLDEN / f"render_{scene}.png"), drawn[..., ::-1])
    assert np.abs(drawn.astype(int) - golden(scene)).max() <= 1


@pytest.mark.parametrize("scene", SCENES)
def test_cpu_draws_the_golden_picture(scene: str) -> None:
    difference = np.abs(draw("cpu", scene).astype(int) - golden(scene))
    assert difference.max() <= 4
    assert difference.mean() <= 1
