"""Rims of glasses are found whole in the picture, follow the head, and stay in front of the drawn face."""

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks.schemes import LEFT_EYE, RIGHT_EYE
from guise.aam.model import Identity
from guise.aam.parsing import FaceParser
from guise.app.media import Frame, open_input
from guise.app.swapping import rims
from guise.app.swapping.engine import Engine
from guise.app.swapping.occlusion import parse_frame
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.rims import Rims, best_rings
from guise.common.arrays import F64, U8

SIZE_EYES = 0.33, 0.25  # half the width and the height of a lens, distances between the eyes


def moved(rgb: U8, shape: F64, degrees: float, scale: float) -> tuple[U8, F64]:
    """A picture and the points in it, turned about their middle."""
    x, y = shape.mean(0)
    to = cv2.getRotationMatrix2D((x, y), degrees, scale)
    picture = cv2.warpAffine(rgb, to, rgb.shape[1::-1], flags=cv2.INTER_AREA)
    return np.asarray(picture, np.uint8), shape @ to[:, :2].T + to[:, 2]


def lenses(shape: F64, points: int = 120) -> F64:
    """(2, n, 2) the lines of the rims of glasses on a face (81, 2)."""
    right, left = shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0)
    along = left - right
    down = np.array([-along[1], along[0]])
    turns = np.linspace(0, 2 * np.pi, points, endpoint=False)[:, None]
    across, up = SIZE_EYES
    circle = across * np.cos(turns) * along + up * np.sin(turns) * down
    return np.array([middle + 0.07 * down + circle for middle in (right, left)])


def with_glasses(rgb: U8, shape: F64, colour: tuple[int, int, int]) -> U8:
    """A person who wears thin glasses."""
    out = rgb.copy()
    lines = lenses(shape)
    ends = [lines[0, 0], lines[1, len(lines[1]) // 2]]
    for line, closed in ((lines[0], True), (lines[1], True), (np.array(ends), False)):
        corners = np.round(16 * line).astype(np.int32)
        cv2.polylines(out, [corners], closed, colour, 2, cv2.LINE_AA, shift=4)
    return out


@pytest.fixture(scope="module")
def scene() -> tuple[U8, F64]:
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    return rgb, np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)


@pytest.fixture
def worn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: True)


def look(found: Rims, rgb: U8, shape: F64, *, parsed: bool = True) -> None:
    frame = Frame.from_rgb(rgb)
    found.see(frame.luma, shape, parse_frame(FaceParser(), frame, shape) if parsed else None)


def shares(found: Rims, shape: F64) -> tuple[np.ndarray, np.ndarray]:
    """Shares along the rims, and in and below the lenses' lower halves."""
    lines = lenses(shape)
    middle = lines.mean(1)
    half = lines[:, len(lines[0]) // 4] - middle  # to the lowest place
    bare = np.concatenate([middle + half * away for away in (0.6, 1.5, 2.0)])
    return found.at(lines.reshape(-1, 2)), found.at(bare)


@pytest.mark.usefixtures("worn")
@pytest.mark.parametrize(
    ("degrees", "scale", "colour"),
    [(0, 1.0, (40, 35, 30)), (25, 1.0, (40, 35, 30)), (-10, 0.6, (40, 35, 30)), (0, 1.0, (250, 245, 240))],
)
def test_thin_rims_are_found_whole_and_nothing_else(
    scene: tuple[U8, F64], degrees: float, scale: float, colour: tuple[int, int, int]
) -> None:
    rgb, shape = moved(*scene, degrees, scale)
    found = Rims()
    look(found, with_glasses(rgb, shape, colour), shape)
    assert found.seen
    along, bare = shares(found, shape)
    assert (along > 0.7).mean() > 0.9
    assert bare.max() < 0.1


def test_who_wears_no_glasses_has_no_rims(scene: tuple[U8, F64]) -> None:
    found = Rims()
    look(found, *scene)
    assert not found.seen
    assert (found.at(scene[1]) == 0).all()


@pytest.mark.usefixtures("worn")
def test_rims_move_with_the_head_between_parsed_frames_and_are_forgotten(scene: tuple[U8, F64]) -> None:
    rgb, shape = scene
    found = Rims()
    look(found, with_glasses(rgb, shape, (40, 35, 30)), shape)
    then = found.at(lenses(shape).reshape(-1, 2))
    other, there = moved(rgb, shape, 6, 0.97)
    look(found, with_glasses(other, there, (40, 35, 30)), there, parsed=False)
    now = found.at(lenses(there).reshape(-1, 2))
    assert np.abs(now - then).mean() < 0.1
    found.reset()
    look(found, rgb, shape, parsed=False)
    assert not found.seen


@pytest.mark.usefixtures("worn")
def test_one_frame_without_glasses_does_not_take_them_off(
    scene: tuple[U8, F64], monkeypatch: pytest.MonkeyPatch
) -> None:
    rgb = with_glasses(*scene, (40, 35, 30))
    found = Rims()
    look(found, rgb, scene[1])
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: False)
    look(found, rgb, scene[1])
    assert found.seen
    for _ in range(4):
        look(found, rgb, scene[1])
    assert not found.seen


def test_the_best_ring_is_closed_and_passes_gaps() -> None:
    rng = np.random.default_rng(3)
    angles = np.arange(72)
    truth = np.round(20 + 8 * np.sin(angles * 2 * np.pi / 72 + np.array([[0.5], [2.0]]))).astype(int)
    reward = rng.uniform(0, 0.1, (2, 72, 39)).astype(np.float32)
    np.put_along_axis(reward, truth[..., None], 0.5, axis=2)
    reward[:, 30:36] = 0
    rings = best_rings(reward, 0.04)
    assert (np.delete(rings - truth, np.s_[30:36], axis=1) == 0).all()
    assert np.abs(rings - truth).max() <= 3
    assert (np.abs(np.diff(rings, axis=1, append=rings[:, :1])) <= 2).all()


@pytest.mark.usefixtures("worn")
@pytest.mark.parametrize(("disguise", "kept"), [(False, True), (True, False)])
@pytest.mark.slow
def test_rims_stay_in_front_of_the_drawn_face(scene: tuple[U8, F64], disguise: bool, kept: bool) -> None:
    source, target = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    rgb, shape = with_glasses(*scene, (40, 35, 30)), scene[1]
    frame = Frame.from_rgb(rgb)
    with Engine(source, target, None, EngineOptions(disguise=disguise, renderer="cpu")) as engine:
        engine.draw(frame, shape)
    lower = lenses(shape)[:, 15:45].reshape(-1, 2).round().astype(int)
    before, after = (picture[lower[:, 1], lower[:, 0]].mean() for picture in (rgb, frame.rgb()))
    bare = scene[0][lower[:, 1], lower[:, 0]].mean()
    assert (abs(after - before) < 0.25 * (bare - before)) == kept
