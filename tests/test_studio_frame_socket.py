"""The studio's connection to a browser's tab, with a socket that a test holds, and the run behind it."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from starlette.websockets import WebSocketDisconnect

from guise.aam.model import Identity
from guise.app.live.capture import Capture, FileCapture
from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult
from guise.app.live.options import LiveSettings
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.session import SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame, MediaError
from guise.app.media.frame import plane_arrays
from guise.app.studio.frame_socket import HEADER, BrowserCamera, Peer, PeerOutput, packed, picture, unpacked
from guise.app.studio.live_run import LiveRun
from guise.app.swapping.donors import open_donor

TIMEOUT_SECONDS = 20.0
CLIP = SAMPLES / "p01" / "talk2.mp4"


def grey(value: int, size: tuple[int, int] = (320, 240)) -> av.VideoFrame:
    """A picture of one brightness."""
    video = av.VideoFrame.from_ndarray(np.full((size[1] * 3 // 2, size[0]), 128, np.uint8), "yuv420p")
    np.frombuffer(video.planes[0], np.uint8)[:] = value
    return video


def brightness(video: av.VideoFrame) -> float:
    return float(plane_arrays(video)[0].mean())


class Tab:
    """A browser's end: what it sends, and what comes back."""

    def __init__(self) -> None:
        self.messages: asyncio.Queue[bytes | None] = asyncio.Queue()
        self.received: asyncio.Queue[bytes] = asyncio.Queue()
        self.closed = False

    async def accept(self) -> None:
        pass

    async def receive_bytes(self) -> bytes:
        message = await self.messages.get()
        if message is None:
            raise WebSocketDisconnect
        return message

    async def send_bytes(self, message: bytes) -> None:
        self.received.put_nowait(message)

    async def close(self) -> None:
        self.closed = True
        self.messages.put_nowait(None)

    async def shown(self) -> tuple[av.VideoFrame, int]:
        """The next picture that comes back, and its number."""
        return unpacked(await asyncio.wait_for(self.received.get(), TIMEOUT_SECONDS))


class Brighter:
    """A processor whose effect can be seen in the picture."""

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        brighter = np.full((frame.height, frame.width, 3), 128, np.uint8)
        brighter[..., 0] = frame.luma + 60
        frame.write_roi(0, 0, brighter)
        return OutputFrame(frame, FaceResult("off"), stats, arrived)

    def close(self) -> None:
        pass


@asynccontextmanager
async def connected(value: int | None = 90) -> AsyncIterator[tuple[Peer, Tab]]:
    """A peer and the tab that is connected to it; its camera sends thirty pictures of one brightness a second."""
    peer, tab = Peer(), Tab()
    serving = asyncio.create_task(peer.serve(tab))  # type: ignore[arg-type]
    sending = asyncio.create_task(film(tab, value))
    try:
        yield peer, tab
    finally:
        peer.close()
        sending.cancel()
        await asyncio.wait_for(serving, TIMEOUT_SECONDS)


async def film(tab: Tab, value: int | None) -> None:
    number = 0
    while value is not None and not tab.closed:
        tab.messages.put_nowait(packed(grey(value), number, number / 30))
        number += 1
        await asyncio.sleep(1 / 30)


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(TIMEOUT_SECONDS):
        while not condition():
            await asyncio.sleep(0.02)


def ran(test: Callable[[], Awaitable[None]]) -> None:
    async def limited() -> None:
        await asyncio.wait_for(test(), 3 * TIMEOUT_SECONDS)

    asyncio.run(limited())


def run_pipeline(peer: Peer) -> "asyncio.Task[PipelineStats]":
    """The pipeline of a browser's camera, in threads."""
    outputs = [PeerOutput(peer, Controls())]
    return asyncio.create_task(asyncio.to_thread(Pipeline(peer.camera(), Brighter, outputs).run))


def test_the_camera_gives_the_latest_picture_and_counts_the_others() -> None:
    camera = BrowserCamera()
    for number, value in enumerate((10, 20, 30)):
        camera.put(grey(value), 7 + number, number / 30)
    frame = next(iter(camera))
    assert (frame.luma.mean(), frame.index) == (30, 9)
    camera.put(grey(40), 12, 1.0)
    assert camera.dropped == 4  # two that were replaced, two that the browser kept
    camera.close()
    assert next(iter(camera)).index == 12
    assert list(camera) == []


def test_the_browser_gets_the_latest_picture_only() -> None:
    async def test() -> None:
        peer, tab = Peer(), Tab()
        for number, value in enumerate((10, 20, 30)):
            peer.send(packed(grey(value), number))
        await asyncio.sleep(0)
        serving = asyncio.create_task(peer.serve(tab))  # type: ignore[arg-type]
        video, number = await tab.shown()
        assert (brightness(video), number) == (30, 2)
        peer.close()
        await serving
        assert tab.received.empty()
        assert tab.closed

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_pictures_come_back_worked_on_and_a_dropped_connection_ends_all() -> None:
    async def test() -> None:
        async with connected(90) as (peer, tab):
            running = run_pipeline(peer)
            seen = [await tab.shown() for _ in range(5)]
            assert [brightness(video) for video, _ in seen] == [150] * 5
            assert [number for _, number in seen] == sorted({number for _, number in seen})
            tab.messages.put_nowait(None)
            stats = await asyncio.wait_for(running, TIMEOUT_SECONDS)
            assert stats.frames >= 5
            await until(lambda: not peer.alive())

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_a_camera_of_the_computer_is_sent_without_one_of_the_browser() -> None:
    async def test() -> None:
        async with connected(None) as (peer, tab):
            frame = Frame.from_rgb(np.full((240, 320, 3), 200, np.uint8))
            PeerOutput(peer, Controls()).show(OutputFrame(frame, FaceResult("off"), PipelineStats(), 1.0))
            video, _ = await tab.shown()
            assert np.allclose(video.to_ndarray(format="rgb24"), 200, atol=2)

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_another_run_takes_the_camera_over() -> None:
    async def test() -> None:
        async with connected() as (peer, tab):
            first = run_pipeline(peer)
            await tab.shown()
            second = run_pipeline(peer)
            await asyncio.wait_for(first, TIMEOUT_SECONDS)
            tab.received = asyncio.Queue()
            for _ in range(2):  # the first one may be on its way since before
                await tab.shown()
            peer.close()
            assert (await asyncio.wait_for(second, TIMEOUT_SECONDS)).frames > 0
            assert list(peer.camera()) == []

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_sound_goes_to_the_microphone_beside_the_pictures() -> None:
    async def test() -> None:
        async with connected() as (peer, tab):
            block = np.linspace(-1, 1, 64, dtype=np.float32)
            tab.messages.put_nowait(HEADER.pack(b"PCM ", 0, 0, 0, 0, 0.0, 4800) + block.tobytes())
            await until(lambda: peer.microphone.is_on)
            (_, samples), *others = peer.microphone.take()
            assert not others
            np.testing.assert_array_equal(samples, block.reshape(-1, 2))

    ran(test)


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"I420",
        HEADER.pack(b"I420", 320, 240, 1, 0, 0.0, 0) + bytes(100),
        HEADER.pack(b"I420", 0, 240, 1, 0, 0.0, 0),
        HEADER.pack(b"I420", 320, 240, 1, 0, float("nan"), 0) + bytes(115_200),
        HEADER.pack(b"NV21", 320, 240, 1, 0, 0.0, 0) + bytes(115_200),
        HEADER.pack(b"I420", 65_535, 65_535, 1, 0, 0.0, 0) + bytes(100),
    ],
)
def test_what_is_no_picture_ends_the_connection(message: bytes) -> None:
    async def test() -> None:
        peer, tab = Peer(), Tab()
        tab.messages.put_nowait(message)
        await asyncio.wait_for(peer.serve(tab), TIMEOUT_SECONDS)  # type: ignore[arg-type]
        assert not peer.alive()
        assert tab.closed
        assert peer.fault.endswith("reload the page")

    ran(test)


@pytest.mark.parametrize("size", [(320, 240), (321, 241), (6, 4)])
@pytest.mark.parametrize(("matrix", "span"), [(1, 2), (1, 1), (5, 1), (5, 2)])
def test_planes_and_their_colours_travel_unchanged(size: tuple[int, int], matrix: int, span: int) -> None:
    noise = np.random.default_rng(0)
    video = av.VideoFrame(*size, "yuv420p")
    for plane in plane_arrays(video):
        plane[:] = noise.integers(0, 256, plane.shape)
    video.colorspace, video.color_range = matrix, span
    same, number = unpacked(packed(video, 123))
    assert (same.width, same.height, number) == (*size, 123)
    assert (int(same.colorspace), int(same.color_range)) == (matrix, span)
    for one, other in zip(plane_arrays(video), plane_arrays(same), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("name", "order"), [(b"RGBA", "rgb"), (b"BGRX", "bgr")])
def test_a_browser_that_has_no_planes_sends_colours(name: bytes, order: str) -> None:
    pixels = np.full((48, 64, 4), 255, np.uint8)
    pixels[..., :3] = [{"r": 200, "g": 90, "b": 40}[channel] for channel in order]
    video, _ = unpacked(HEADER.pack(name, 64, 48, 5, 0, 0.0, 0) + pixels.tobytes())
    rgb = Frame(video, pts=0, time_base=Fraction(1), index=0).rgb()
    assert np.allclose(rgb, (200, 90, 40), atol=3)


def test_planes_that_are_interleaved_are_used_as_they_are() -> None:
    luma, chroma = np.full((48, 64), 100, np.uint8), np.full((24, 32, 2), (90, 160), np.uint8)
    video, _ = unpacked(HEADER.pack(b"NV12", 64, 48, 5, 0, 0.0, 0) + luma.tobytes() + chroma.tobytes())
    assert [int(plane.mean()) for plane in plane_arrays(video)] == [100, 90, 160]


def test_overlays_are_drawn_on_a_copy_and_any_picture_suits_the_codec() -> None:
    mesh = np.stack([np.linspace(40, 200, 81), np.linspace(20, 100, 81) ** 1.1], 1)
    frame = Frame.from_rgb(np.full((121, 241, 3), 90, np.uint8))
    shown = OutputFrame(frame, FaceResult("swapped", mesh), PipelineStats(), 0.0)
    plain, drawn = picture(shown, LiveSettings()), picture(shown, LiveSettings(mask=True, mesh=True))
    assert (plain.width, plain.height, plain.format.name) == (242, 122, "yuv420p")
    assert plain.to_ndarray().std() < drawn.to_ndarray().std()
    assert (frame.rgb() == 90).all()


class Kept(Output):
    """Keeps what is shown."""

    def __init__(self) -> None:
        self.shown: list[OutputFrame] = []

    def show(self, shown: OutputFrame) -> None:
        self.shown.append(shown)


def run_of(
    folder: Path, output: Output, person: Identity | None, open_capture: Callable[[], Capture] | None = None
) -> LiveRun:
    faces = [open_donor("p02")]
    config = SessionConfig(faces, person)
    capture = open_capture or (lambda: FileCapture(CLIP, loop=True))
    return LiveRun(capture, config, Controls(len(faces)), [output], folder)


def wait(condition: Callable[[], bool]) -> None:
    asyncio.run(until(condition))


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.slow
def test_a_run_swaps_records_and_takes_snapshots(tmp_path: Path, p01: Identity) -> None:
    kept = Kept()
    run = run_of(tmp_path, kept, p01)
    try:
        wait(lambda: run.latest is not None and run.latest.result.outcome == "swapped")
        run.toggle_recording()
        wait(lambda: kept.shown[-1].recording is not None)
        count = len(kept.shown)
        wait(lambda: len(kept.shown) > count + 5)
        still = run.snapshot()
        run.toggle_recording()
        wait(lambda: bool(run.recorded()))
    finally:
        run.stop()
    assert not run.running
    assert still is not None
    assert still.suffix == ".png"
    with av.open(str(run.recorded()[0])) as film:
        assert len(list(film.decode(video=0))) >= 2
    notes = [run.notes.get() for _ in range(run.notes.qsize())]
    assert notes == ["Recording to guise-001.mp4.", "Recorded guise-001.mp4."]


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.slow
def test_without_a_model_no_picture_is_sent_bare(tmp_path: Path) -> None:
    kept = Kept()
    run = run_of(tmp_path, kept, None)
    try:
        wait(lambda: len(kept.shown) > 5)
    finally:
        run.stop()
    assert kept.shown[0].result.outcome == "enrolling"
    assert all(shown.ring is not None for shown in kept.shown)
    with av.open(str(CLIP)) as clip:
        bare = [video.to_ndarray(format="gray") for video in clip.decode(video=0)]
    for shown in kept.shown:
        hidden = 0.3 if shown.result.outcome == "enrolling" else 0.85  # hair and ears are their own
        assert alike(shown.frame.luma, bare[shown.frame.index]) < hidden
    assert alike(bare[0], bare[1]) > 0.6


def alike(luma: np.ndarray, other: np.ndarray) -> float:
    """Correlation of the fine detail in the middle of two pictures."""
    middle = np.s_[120:360, 200:440]
    fine = [
        (v[middle] - cv2.GaussianBlur(v, (0, 0), 2.0)[middle].astype(float)).ravel() for v in (luma, other)
    ]
    return float(np.corrcoef(*fine)[0, 1])


@pytest.mark.usefixtures("no_thread_left")
def test_a_camera_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    def missing() -> Capture:
        raise MediaError("there is no camera")

    run = run_of(tmp_path, Kept(), None, missing)
    wait(lambda: not run.running)
    assert run.notes.get_nowait() == "there is no camera"
    run.stop()


@pytest.mark.usefixtures("no_thread_left")
def test_a_run_ends_when_it_is_not_wanted_any_more(tmp_path: Path, p01: Identity) -> None:
    wanted = [True]
    run = LiveRun(
        lambda: FileCapture(CLIP, loop=True), SessionConfig([open_donor("p02")], p01), Controls(),
        [Kept()], tmp_path, lambda: wanted[0],
    )  # fmt: skip
    wait(lambda: run.latest is not None)
    wanted[0] = False
    wait(lambda: not run.running)
