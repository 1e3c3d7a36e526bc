"""The studio's video connection, with aiortc at both ends, and the run behind it."""

import asyncio
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from made_up import SAMPLES

pytest.importorskip("aiortc")
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from guise.aam.model import Identity
from guise.app.live.capture import Capture, FileCapture
from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.session import SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame, MediaError
from guise.app.media.frame import plane_arrays
from guise.app.studio.live_run import LiveRun
from guise.app.studio.rtc import BrowserCamera, Peer, PeerOutput, ResultTrack, picture
from guise.app.studio.store import StudioError
from guise.app.swapping.donors import open_donor

TIMEOUT_SECONDS = 20.0
CLIP = SAMPLES / "p01" / "talk2.mp4"


def grey(value: int, pts: int = 0, size: tuple[int, int] = (320, 240)) -> av.VideoFrame:
    """A picture of one brightness."""
    video = av.VideoFrame.from_ndarray(np.full((size[1] * 3 // 2, size[0]), 128, np.uint8), "yuv420p")
    np.frombuffer(video.planes[0], np.uint8)[:] = value
    video.pts, video.time_base = pts, Fraction(1, 90_000)
    return video


def brightness(video: av.VideoFrame) -> float:
    return float(plane_arrays(video)[0].mean())


class Camera(MediaStreamTrack):
    """Sends pictures of one brightness, thirty a second."""

    kind = "video"

    def __init__(self, value: int = 90) -> None:
        super().__init__()
        self._value, self._count = value, 0

    async def recv(self) -> av.VideoFrame:
        await asyncio.sleep(1 / 30)
        self._count += 1
        return grey(self._value, 3000 * self._count)


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
async def connected(camera: MediaStreamTrack | None) -> AsyncIterator[tuple[Peer, RTCPeerConnection, Any]]:
    """A peer and a browser's end that is connected to it, and the track that the browser gets."""
    peer, browser = Peer(), RTCPeerConnection(RTCConfiguration(iceServers=[]))
    track = asyncio.get_running_loop().create_future()
    browser.on("track", track.set_result)
    browser.addTransceiver(camera or "video", direction="sendrecv" if camera else "recvonly")
    await browser.setLocalDescription(await browser.createOffer())
    offer = browser.localDescription
    answer = await peer.answer({"type": offer.type, "sdp": offer.sdp})
    await browser.setRemoteDescription(RTCSessionDescription(**answer))
    try:
        yield peer, browser, await track
    finally:
        await browser.close()
        await peer.close()


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


def test_the_camera_gives_the_latest_picture_only() -> None:
    camera = BrowserCamera()
    for value in (10, 20, 30):
        camera.put(grey(value))
    frame = next(iter(camera))
    assert frame.luma.mean() == 30
    camera.close()
    assert list(camera) == []


def test_the_track_sends_the_latest_picture_only() -> None:
    async def test() -> None:
        track = ResultTrack()
        for value in (10, 20, 30):
            track.offer(grey(value))
        assert brightness(await track.recv()) == 30
        assert track.dropped == 2
        track.offer(None)
        with pytest.raises(MediaStreamError):
            await track.recv()

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_pictures_come_back_worked_on_and_a_dropped_connection_ends_all() -> None:
    async def test() -> None:
        async with connected(Camera(90)) as (peer, browser, track):
            running = run_pipeline(peer)
            seen = [brightness(await track.recv()) for _ in range(5)]
            assert np.allclose(seen, 150, atol=4)
            await browser.close()
            stats = await asyncio.wait_for(running, TIMEOUT_SECONDS)
            assert stats.frames >= 5
            await until(lambda: not peer.alive())
            assert peer.track.readyState == "ended"

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_a_camera_of_the_computer_is_sent_without_one_of_the_browser() -> None:
    async def test() -> None:
        async with connected(None) as (peer, _, track):
            frame = Frame.from_rgb(np.full((240, 320, 3), 200, np.uint8))
            sender = PeerOutput(peer, Controls())
            sender.show(OutputFrame(frame, FaceResult("off"), PipelineStats(), 1.0))
            received = asyncio.ensure_future(track.recv())
            while not received.done():  # a picture comes out at the other end when the next one goes in
                sender.show(
                    OutputFrame(frame, FaceResult("off"), PipelineStats(), asyncio.get_running_loop().time())
                )
                await asyncio.sleep(0.05)
            rgb = received.result().to_ndarray(format="rgb24")
            assert np.allclose(rgb.mean((0, 1)), 200, atol=5)

    ran(test)


@pytest.mark.usefixtures("no_thread_left")
def test_another_run_takes_the_camera_over() -> None:
    async def test() -> None:
        async with connected(Camera()) as (peer, _, track):
            first = run_pipeline(peer)
            await track.recv()
            second = run_pipeline(peer)
            await asyncio.wait_for(first, TIMEOUT_SECONDS)
            await track.recv()
            await peer.close()
            assert (await asyncio.wait_for(second, TIMEOUT_SECONDS)).frames > 0
            assert list(peer.camera()) == []

    ran(test)


@pytest.mark.parametrize(
    "offer",
    [
        {},
        {"type": "offer"},
        {"type": "offer", "sdp": "nonsense"},
        {"type": "answer", "sdp": ""},
        {"type": 3, "sdp": 4},
    ],
)
def test_what_is_no_offer_is_one_sentence_and_ends_the_peer(offer: dict[str, Any]) -> None:
    async def test() -> None:
        peer = Peer()
        with pytest.raises(StudioError, match="connection offer was not understood: reload the page"):
            await peer.answer(offer)
        assert not peer.alive()

    ran(test)


def test_the_answer_names_no_address_elsewhere_and_a_rate_for_vp8() -> None:
    async def test() -> None:
        browser, peer = RTCPeerConnection(RTCConfiguration(iceServers=[])), Peer()
        browser.addTransceiver("video", direction="recvonly")
        await browser.setLocalDescription(await browser.createOffer())
        sdp = (await peer.answer({"type": "offer", "sdp": browser.localDescription.sdp}))["sdp"]
        await browser.close()
        await peer.close()
        assert re.search(r"rtpmap:(\d+) VP8/90000\r\na=fmtp:\1 x-google-min-bitrate=2500", sdp)
        assert set(re.findall(r" typ (\w+)", sdp)) == {"host"}

    ran(test)


def test_overlays_are_drawn_on_a_copy_and_any_picture_suits_the_codec() -> None:
    mesh = np.stack([np.linspace(40, 200, 81), np.linspace(20, 100, 81) ** 1.1], 1)
    frame = Frame.from_rgb(np.full((121, 241, 3), 90, np.uint8))
    shown = OutputFrame(frame, FaceResult("swapped", mesh), PipelineStats(), 0.0)
    plain, drawn = picture(shown, mask=False, mesh=False), picture(shown, mask=True, mesh=True)
    assert (plain.width, plain.height, plain.format.name) == (242, 122, "yuv420p")
    assert plain.to_ndarray().std() < drawn.to_ndarray().std()
    assert (frame.rgb() == 90).all()


def test_what_is_sent_is_a_copy_of_what_others_are_shown() -> None:
    frame = Frame(grey(50), pts=0, time_base=Fraction(1, 90_000), index=0)
    sent = picture(OutputFrame(frame, FaceResult("off"), PipelineStats(), 0.0), mask=False, mesh=False)
    np.frombuffer(sent.planes[0], np.uint8)[:] = 0
    assert (frame.luma == 50).all()


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
def test_a_run_swaps_records_and_takes_snapshots(tmp_path: Path, p01: Identity) -> None:
    kept = Kept()
    run = run_of(tmp_path, kept, p01)
    try:
        wait(lambda: run.latest is not None and run.latest.result.outcome == "swapped")
        run.toggle_recording()
        wait(lambda: kept.shown[-1].recording)
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
def test_without_a_model_no_picture_is_sent_bare(tmp_path: Path) -> None:
    kept = Kept()
    run = run_of(tmp_path, kept, None)
    try:
        wait(lambda: len(kept.shown) > 5)
    finally:
        run.stop()
    assert {shown.result.outcome for shown in kept.shown} == {"enrolling"}
    with av.open(str(CLIP)) as clip:
        bare = [video.to_ndarray(format="gray") for video in clip.decode(video=0)]
    for shown in kept.shown:
        assert alike(shown.frame.luma, bare[shown.frame.index]) < 0.3
        assert alike(bare[shown.frame.index], bare[shown.frame.index + 1]) > 0.6


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
