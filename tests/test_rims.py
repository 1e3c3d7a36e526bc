"""Rims of glasses are found whole in the picture, follow the head, and stay in front of the drawn face."""

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from worn_rims import lenses, with_rims

from guise.aam import rims
from guise.aam.parsing import FaceParser
from guise.aam.rims import LIMITS, RimFinder, RimMemory, best_rings
from guise.app.drawing.face import parse_frame
from guise.app.media import Frame, open_input
from guise.common.arrays import F64, U8

DARK = (40, 35, 30)


def moved(rgb: U8, shape: F64, degrees: float, scale: float) -> tuple[U8, F64]:
    """A picture and the points in it, turned about their middle."""
    x, y = shape.mean(0)
    to = cv2.getRotationMatrix2D((x, y), degrees, scale)
    picture = cv2.warpAffine(rgb, to, rgb.shape[1::-1], flags=cv2.INTER_AREA)
    return np.asarray(picture, np.uint8), shape @ to[:, :2].T + to[:, 2]


@pytest.fixture(scope="module")
def scene() -> tuple[U8, F64]:
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    return rgb, np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)


@pytest.fixture
def worn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: True)


class Rims:
    """A finder with what it remembers."""

    def __init__(self) -> None:
        self.finder, self.memory, self.now, self.parsed_at = RimFinder(), RimMemory(), 0.0, -np.inf

    def look(
        self, rgb: U8, shape: F64, *, parsed: bool = True, seconds: float = LIMITS.pause_seconds
    ) -> None:
        """See the next frame, so much later."""
        self.now += seconds
        frame = Frame.from_rgb(rgb)
        parsing = parse_frame(FaceParser(), frame, shape) if parsed else None
        self.finder.see(self.memory, frame.luma, shape, parsing, self.now, self.now - self.parsed_at)
        if parsed:
            self.parsed_at = self.now

    @property
    def seen(self) -> bool:
        return self.memory.share is not None

    def at(self, places: F64) -> np.ndarray:
        return self.memory.at(places)


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
    [(0, 1.0, DARK), (25, 1.0, DARK), (-10, 0.6, DARK), (0, 1.0, (250, 245, 240))],
)
def test_thin_rims_are_found_whole_and_nothing_else(
    scene: tuple[U8, F64], degrees: float, scale: float, colour: tuple[int, int, int]
) -> None:
    rgb, shape = moved(*scene, degrees, scale)
    found = Rims()
    found.look(with_rims(rgb, shape, colour), shape)
    assert found.seen
    along, bare = shares(found, shape)
    assert (along > 0.7).mean() > 0.9
    assert bare.max() < 0.1


def test_who_wears_no_glasses_has_no_rims(scene: tuple[U8, F64]) -> None:
    found = Rims()
    found.look(*scene)
    assert not found.seen
    assert (found.at(scene[1]) == 0).all()


@pytest.mark.usefixtures("worn")
def test_rims_move_with_the_head_between_parsed_frames_and_are_forgotten(scene: tuple[U8, F64]) -> None:
    rgb, shape = scene
    found = Rims()
    found.look(with_rims(rgb, shape, DARK), shape)
    then = found.at(lenses(shape).reshape(-1, 2))
    other, there = moved(rgb, shape, 6, 0.97)
    found.look(with_rims(other, there, DARK), there, parsed=False)
    now = found.at(lenses(there).reshape(-1, 2))
    assert np.abs(now - then).mean() < 0.1
    found.memory = RimMemory()
    found.look(rgb, shape, parsed=False)
    assert not found.seen


@pytest.mark.usefixtures("worn")
def test_one_frame_without_glasses_does_not_take_them_off(
    scene: tuple[U8, F64], monkeypatch: pytest.MonkeyPatch
) -> None:
    rgb = with_rims(*scene, DARK)
    found = Rims()
    found.look(rgb, scene[1])
    monkeypatch.setattr(rims, "wears_glasses", lambda *_: False)
    found.look(rgb, scene[1])
    assert found.seen
    for _ in range(4):
        found.look(rgb, scene[1])
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
