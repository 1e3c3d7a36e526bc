"""What hides a face: it is found by its colour, not by light or shadow, and its pixels come back unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file
from numpy.testing import assert_array_equal

from guise.aam.landmarks.schemes import CHIN, LOWER_LIP_BOTTOM, NOSE_ROOT, NOSE_TIP
from guise.aam.light import grid_places
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.app.media import Frame, open_input
from guise.app.swapping.engine import Engine
from guise.app.swapping.occlusion import Occlusion
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F32, F64, U8

BLUE = np.array([30, 60, 200], np.uint8)
FRAMES = 6  # by which the memory has faded


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


class Scene:
    """The neutral face of a model at the texels, under any light and with anything in front of it."""

    def __init__(self, person: Identity) -> None:
        model = self.model = person.appearance
        self.texels = ParameterEstimator(model).texels
        self.parameters = model.neutral_parameters
        self.own = model.texture_of(model.components.synthesise(self.parameters))[self.texels]
        self.places = grid_places(model.reference)[self.texels]
        self.occlusion = Occlusion(model, self.texels)

    def show(self, seen: F32, frames: int = FRAMES) -> F32:
        for _ in range(frames):
            self.occlusion.update(self.parameters, np.float32(seen))
        return self.occlusion.visible


@pytest.fixture
def scene(p01: Identity) -> Scene:
    return Scene(p01)


def test_a_face_in_another_light_is_all_visible(scene: Scene) -> None:
    light = np.float32([0.9, 0.8, 0.6]) * (1 + 0.6 * scene.places[:, :1])
    assert scene.show(scene.own * light).min() == 1
    assert not scene.occlusion.found


def test_a_shadow_is_not_taken_for_an_object(scene: Scene) -> None:
    shadow = np.where(scene.places[:, :1] > 0, 0.5, 1.0)
    assert scene.show(scene.own * shadow).min() > 0.9


def test_a_lamp_that_is_switched_on_hides_nothing(scene: Scene) -> None:
    scene.show(scene.own * 0.4)
    assert scene.show(scene.own * np.float32([0.9, 0.8, 0.65]), 1).min() > 0.9


def test_an_object_hides_what_is_behind_it_and_nothing_else(scene: Scene) -> None:
    scene.show(scene.own)
    at = scene.places[:, 1]
    visible = scene.show(np.where(at[:, None] > 0.2, np.float32(BLUE), scene.own))
    assert scene.occlusion.found
    assert visible[at > 0.27].max() == 0
    assert visible[at < 0.08].min() == 1


def test_an_object_that_leaves_leaves_nothing(scene: Scene) -> None:
    scene.show(np.where(scene.places[:, 1:] > 0.2, np.float32(BLUE), scene.own))
    scene.show(scene.own, 2 * FRAMES)
    assert not scene.occlusion.found


def test_the_share_is_taken_where_the_mesh_lies_on_the_head(scene: Scene) -> None:
    scene.show(np.where(scene.places[:, 1:] > 0.2, np.float32(BLUE), scene.own))
    head = scene.model.reference.points
    still = scene.occlusion.uncovered(head, head)
    lower = scene.occlusion.uncovered(head + np.array([0, 5.0]), head)  # drawn five grid pixels lower
    away = np.abs(lower[20:-10, 20:-20] - still[25:-5, 20:-20])
    assert away.mean() < 0.01
    assert away.max() < 0.2


def frames_with_an_object() -> tuple[list[U8], F64]:
    """Frames of the first person's second clip with a blue square over mouth and chin; and the true landmarks."""
    shapes = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"].astype(np.float64)
    pictures = []
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        for frame in clip:
            rgb = frame.rgb()
            if frame.index:
                x, y = square(shapes[frame.index])
                rgb[y:, x - 30 : x + 30] = BLUE
            pictures.append(rgb)
            if frame.index == FRAMES:
                return pictures, shapes
    raise AssertionError


def square(shape: F64) -> tuple[int, int]:
    """The middle of the upper edge of the object."""
    x, y = (shape[NOSE_TIP] + shape[LOWER_LIP_BOTTOM]) / 2
    return round(x), round(y)


def drawn(source: Identity, options: EngineOptions) -> tuple[U8, U8, F64]:
    """The last frame before and after a swap by p06, and its true landmarks."""
    pictures, shapes = frames_with_an_object()
    with Engine(source, Identity.load(model_file("p06")), None, options) as engine:
        for rgb, shape in zip(pictures, shapes, strict=False):
            frame = Frame.from_rgb(rgb.copy())
            engine.draw(frame, shape)
    return pictures[-1], frame.rgb(), shapes[len(pictures) - 1]


@pytest.mark.parametrize("renderer", ["cpu", pytest.param("gl", marks=pytest.mark.egl)])
def test_the_pixels_of_an_object_come_back_unchanged(p01: Identity, renderer: str) -> None:
    before, after, shape = drawn(p01, EngineOptions(renderer=renderer))  # type: ignore[arg-type]
    x, y = square(shape)
    chin = int(shape[CHIN, 1])
    assert chin - y > 30
    assert_array_equal(after[y + 20 : chin, x - 12 : x + 12], before[y + 20 : chin, x - 12 : x + 12])
    root = np.round(shape[NOSE_ROOT]).astype(int)
    assert (
        np.abs(
            after[root[1] - 5 : root[1] + 5, root[0] - 5 : root[0] + 5].astype(int)
            - before[root[1] - 5 : root[1] + 5, root[0] - 5 : root[0] + 5]
        ).mean()
        > 1
    )


@pytest.mark.egl
def test_both_renderers_draw_an_occlusion_alike(p01: Identity) -> None:
    on_cpu, on_gl = (drawn(p01, EngineOptions(renderer=r))[1].astype(int) for r in ("cpu", "gl"))
    assert np.abs(on_cpu - on_gl).max() <= 4


@pytest.mark.parametrize("changes", [{"light": "paper"}, {"disguise": True}])
def test_a_disguise_and_the_papers_light_cover_everything(p01: Identity, changes: dict[str, object]) -> None:
    options = replace(EngineOptions(renderer="cpu"), **changes)  # type: ignore[arg-type]
    before, after, shape = drawn(p01, options)
    x, y = square(shape)
    assert (after[y + 20 : y + 30, x - 12 : x + 12] != before[y + 20 : y + 30, x - 12 : x + 12]).any()
