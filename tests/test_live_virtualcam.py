"""The virtual camera: a steady rate, whole pictures, and one sentence where there is none."""

from __future__ import annotations

import platform
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pyvirtualcam = pytest.importorskip("pyvirtualcam", reason="extra virtualcam")

from pyvirtualcam.camera import BACKENDS  # noqa: E402

from guise.app.live import virtualcam  # noqa: E402
from guise.app.live.face import FaceResult  # noqa: E402
from guise.app.live.output import OutputFrame  # noqa: E402
from guise.app.live.stats import PipelineStats  # noqa: E402
from guise.app.live.virtualcam import VirtualCamera  # noqa: E402
from guise.app.media import Frame  # noqa: E402
from guise.common.errors import OutputError  # noqa: E402


class Kept:
    """A device that keeps what it gets; pyvirtualcam sees a backend like any other."""

    last: Kept
    most = 10_000

    def __init__(self, *, width: int, height: int, fps: float, fourcc: int, device: str | None) -> None:
        if device not in (None, "kept"):
            raise RuntimeError(f"no device {device}")
        Kept.last = self
        self.size, self.fps = (width, height), fps
        self.frames: list[np.ndarray] = []
        self.times: list[float] = []
        self.enough, self.wanted, self.closed = threading.Event(), 1, False

    def send(self, frame: np.ndarray) -> None:
        if len(self.frames) >= self.most:
            raise RuntimeError("the cable is out")
        width, height = self.size
        self.frames.append(frame.reshape(height, width, 3).copy())
        self.times.append(time.perf_counter())
        if len(self.frames) >= self.wanted:
            self.enough.set()

    def wait_for(self, count: int) -> None:
        self.wanted = count
        self.enough.clear()
        assert len(self.frames) >= count or self.enough.wait(30)

    def close(self) -> None:
        self.closed = True

    def device(self) -> str:
        return "kept"

    def native_fourcc(self) -> None:
        return None


@pytest.fixture
def backend() -> Iterator[type[Kept]]:
    """The only backend there is."""
    old = dict(BACKENDS)
    BACKENDS.clear()
    pyvirtualcam.register_backend("kept", type("Kept", (Kept,), {}))
    yield BACKENDS["kept"]
    BACKENDS.clear()
    BACKENDS.update(old)


def shown(rgb: np.ndarray) -> OutputFrame:
    return OutputFrame(Frame.from_rgb(rgb), FaceResult("swapped"), PipelineStats(), time.perf_counter())


def plain(level: int, width: int = 64, height: int = 48) -> np.ndarray:
    return np.full((height, width, 3), level, np.uint8)


@pytest.mark.usefixtures("backend", "no_thread_left")
def test_the_device_gets_the_pictures_as_rgb_at_the_size_and_rate_shown() -> None:
    rgb = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    camera = VirtualCamera()
    camera.open(64, 48, 30000 / 1001)
    camera.show(shown(rgb))
    device = Kept.last
    device.wait_for(2)
    camera.close()
    assert device.size == (64, 48)
    assert device.fps == 30000 / 1001
    assert all((frame == rgb).all() for frame in device.frames)
    assert device.closed


@pytest.mark.usefixtures("backend", "no_thread_left")
def test_a_picture_is_repeated_until_the_next_comes_and_nothing_is_sent_before_the_first() -> None:
    camera = VirtualCamera("kept")
    camera.open(64, 48, 200)
    device = Kept.last
    time.sleep(0.05)
    assert device.frames == []
    for level in (10, 20):
        camera.show(shown(plain(level)))
        device.wait_for(len(device.frames) + 5)
    camera.close()
    levels = [int(frame[0, 0, 0]) for frame in device.frames]
    assert levels == sorted(levels)
    assert min(levels.count(10), levels.count(20)) >= 4


@pytest.mark.usefixtures("backend", "no_thread_left")
def test_no_more_is_sent_than_the_rate_however_fast_pictures_come() -> None:
    camera = VirtualCamera()
    camera.open(64, 48, 50)
    device = Kept.last
    start = time.perf_counter()
    while len(device.frames) < 15:
        camera.show(shown(plain(0)))
        time.sleep(0.001)
    camera.close()
    assert len(device.frames) <= 2 + 50 * (time.perf_counter() - start)
    assert device.times[14] - device.times[0] >= 12 / 50


@pytest.mark.usefixtures("backend", "no_thread_left")
def test_a_picture_of_another_size_is_shown_whole() -> None:
    camera = VirtualCamera()
    camera.open(65, 49, 100)  # odd: pixel formats of cameras halve the chroma
    camera.show(shown(plain(200, 128, 48)))
    device = Kept.last
    device.wait_for(1)
    camera.close()
    bright = device.frames[0][:, 32, 0] == 200
    assert device.size == (64, 48)
    assert (bright.sum(), bright[24], bright[0], bright[-1]) == (24, True, False, False)


@pytest.mark.usefixtures("no_thread_left")
def test_a_device_that_goes_away_is_said_in_one_sentence(backend: type[Kept]) -> None:
    backend.most = 2
    camera = VirtualCamera()
    camera.open(64, 48, 200)
    camera.show(shown(plain(0)))
    camera._sender.join(30)
    with pytest.raises(OutputError, match="virtual camera kept no longer accepts pictures: the cable is out"):
        camera.show(shown(plain(0)))
    camera.close()


@pytest.mark.usefixtures("backend", "no_thread_left")
def test_every_attempt_is_listed_with_its_reason_and_what_to_do() -> None:
    camera = VirtualCamera("/dev/video77")
    with pytest.raises(
        OutputError, match=r"no virtual camera /dev/video77 .*no device /dev/video77.*: "
    ) as caught:
        camera.open(64, 48, 30)
    camera.close()
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("backend", "no_thread_left")
@pytest.mark.parametrize(
    ("system", "todo"),
    [("Linux", "modprobe v4l2loopback"), ("Darwin", "OBS"), ("Windows", "OBS"), ("Plan9", "only")],
)
def test_the_advice_is_for_the_system_at_hand(
    monkeypatch: pytest.MonkeyPatch, system: str, todo: str
) -> None:
    monkeypatch.setattr(platform, "system", lambda: system)
    with pytest.raises(OutputError, match=todo):
        VirtualCamera("none").open(64, 48, 30)


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.skipif(sys.platform != "linux" or Path("/dev/video0").exists(), reason="there may be a device")
def test_the_real_library_without_a_device() -> None:
    camera = VirtualCamera()
    with pytest.raises(OutputError, match=r"no virtual camera .*v4l2loopback.*: .*modprobe v4l2loopback"):
        camera.open(640, 480, 30)
    camera.close()


def test_a_linux_without_a_device_is_told_before_anything_else_is_done(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.setattr(virtualcam, "_LINUX_DEVICES", tmp_path)
    with pytest.raises(OutputError, match=r"no virtual camera: .*modprobe v4l2loopback"):
        VirtualCamera().check()
    (tmp_path / "video9").mkdir()
    VirtualCamera().check()


def test_a_missing_extra_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyvirtualcam", None)
    with pytest.raises(OutputError, match=r'pip install "guise-video\[virtualcam\]"'):
        VirtualCamera().open(64, 48, 30)
