"""The studio's round trip: a clock burnt into the pictures of a camera, over WebRTC to the studio and back.

640 x 480, 30 frames a second, aiortc at both ends on loopback, the browser's end and the studio's each in a process of
its own.  The time is written into a frame before it is encoded, and read when the returned one is decoded; the studio
tracks and swaps in between.  Alternating runs that send frames back unchanged measure WebRTC alone.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from fractions import Fraction
from itertools import cycle
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.live import clock
from benchmarks.live.runs import Scene, small
from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult
from guise.app.live.output import OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.session import SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame
from guise.app.studio.live_run import LiveRun
from guise.app.studio.rtc import Peer, PeerOutput

ROUNDS = 3
ROUND_SECONDS = 15.0
WARM_UP_SECONDS = 3.0  # that are not counted
DECODED_FRAMES = 150  # of the clip, decoded beforehand
FRAME_TICKS = 3000  # of a 90 kHz clock, from frame to frame
FPS_TARGET, MEDIAN_TARGET_MS = 25.0, 150.0
WAYS = ("swapped", "sent back as it came")


class Camera(MediaStreamTrack):
    """Frames at thirty a second, each with the time at which it is handed to the encoder."""

    kind = "video"

    def __init__(self, frames: list[Frame]) -> None:
        super().__init__()
        self._frames, self._count = cycle(frames), 0
        self._begun = time.perf_counter()

    async def recv(self) -> Any:
        """The next frame, at its time."""
        self._count += 1
        await asyncio.sleep(max(0.0, self._begun + self._count / 30 - time.perf_counter()))
        frame = next(self._frames).copy()
        clock.burn(frame, clock.now())
        video = frame.video_frame
        assert video is not None
        video.pts, video.time_base = FRAME_TICKS * self._count, Fraction(1, 90_000)
        return video


class Echo:
    """A processor that leaves frames unchanged."""

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """Pass a frame on."""
        return OutputFrame(frame, FaceResult("shown"), stats, arrived)

    def close(self) -> None:
        """Nothing to release."""


def serve(pipe: Connection, scene: Scene | None) -> None:
    """The studio's process: answer an offer, run until asked to end, and send the pipeline's figures."""
    asyncio.run(_serve(pipe, scene))


async def _serve(pipe: Connection, scene: Scene | None) -> None:
    peer = Peer()
    pipe.send(await peer.answer(await asyncio.to_thread(pipe.recv)))
    controls = Controls()
    with tempfile.TemporaryDirectory() as folder:
        if scene is not None:
            config = SessionConfig([scene.donor], scene.person)
            show = LiveRun(
                peer.camera, config, controls, [PeerOutput(peer, controls)], Path(folder), peer.alive
            )
            await asyncio.to_thread(pipe.recv)
            stats = show.stats
            await asyncio.to_thread(show.stop)
        else:
            pipeline = Pipeline(peer.camera(), Echo, [PeerOutput(peer, controls)], peer.alive)
            running = asyncio.create_task(asyncio.to_thread(pipeline.run))
            await asyncio.to_thread(pipe.recv)
            pipeline.stop()
            stats = await running
    pipe.send(stats)
    await peer.close()


async def look(track: MediaStreamTrack, seen: Callable[[float, float], None]) -> None:
    """Give the time and the delay, milliseconds, of each picture that comes back with a code."""
    with contextlib.suppress(MediaStreamError):
        while True:
            video = await track.recv()
            at, code = (
                clock.now(),
                clock.read(Frame(video, pts=0, time_base=Fraction(1, 90_000), index=0).luma),
            )
            if code is not None:
                seen(time.perf_counter(), clock.passed(code, at))


async def browse(pipe: Connection, frames: list[Frame], seconds: float) -> tuple[list[float], float]:
    """The browser's end for some seconds: delays in milliseconds, and frames a second that came back."""
    found: list[tuple[float, float]] = []
    browser = RTCPeerConnection(RTCConfiguration(iceServers=[]))
    browser.addTrack(Camera(frames))
    looking: list[asyncio.Task[None]] = []
    browser.on(
        "track",
        lambda track: looking.append(asyncio.create_task(look(track, lambda *seen: found.append(seen)))),
    )
    await browser.setLocalDescription(await browser.createOffer())
    pipe.send({"type": browser.localDescription.type, "sdp": browser.localDescription.sdp})
    answer = await asyncio.to_thread(pipe.recv)
    await browser.setRemoteDescription(RTCSessionDescription(**answer))
    await asyncio.sleep(WARM_UP_SECONDS + seconds)
    await browser.close()
    await asyncio.gather(*looking)
    counted = [(at, delay) for at, delay in found if at > found[-1][0] - seconds]
    return [delay for _, delay in counted], (len(counted) - 1) / (counted[-1][0] - counted[0][0])


def round_trip(
    frames: list[Frame], scene: Scene | None, seconds: float
) -> tuple[list[float], float, PipelineStats]:
    """One round: delays, frames a second, and the pipeline's figures."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, scene))
    process.start()
    try:
        delays, fps = asyncio.run(browse(ours, frames, seconds))
        ours.send("end")
        return delays, fps, ours.recv()
    finally:
        process.join(10)
        process.kill()


def measure(options: argparse.Namespace) -> Report:
    """Both ways, in turns."""
    scene, seconds = small(), 4.0 if options.quick else ROUND_SECONDS
    frames = [
        frame.copy() for frame, _ in zip(common.frames(scene.clip), range(DECODED_FRAMES), strict=False)
    ]
    found: dict[str, list[tuple[list[float], float, PipelineStats]]] = {way: [] for way in WAYS}
    for _ in range(1 if options.quick else ROUNDS):
        for way, work in zip(WAYS, (scene, None), strict=True):
            found[way].append(round_trip(frames, work, seconds))
            common.say(f"{way}: {found[way][-1][1]:.1f} fps, median {np.median(found[way][-1][0]):.0f} ms")
    return report(found)


def report(found: dict[str, list[tuple[list[float], float, PipelineStats]]]) -> Report:
    """From the rounds of each way."""
    rows = []
    for way, rounds in found.items():
        delays = np.concatenate([delays for delays, _, _ in rounds])
        fps = float(np.median([fps for _, fps, _ in rounds]))
        swapped = sum(stats.outcomes.get("swapped", 0) for _, _, stats in rounds)
        worked = sum(stats.frames for _, _, stats in rounds)
        dropped = sum(stats.dropped + stats.skipped for _, _, stats in rounds)
        quantiles = (float(np.quantile(delays, share)) for share in (0.5, 0.95, 1.0))
        rows.append((way, len(delays), fps, *quantiles, swapped / worked, dropped))
    (_, _, fps, median, *_), (_, _, _, plain, *_) = rows
    columns = ("way", "frames", "frames a second", "median, ms", "95 %, ms", "most, ms", "swapped", "dropped")
    return Report(
        "live.studio", "Live: the studio's round trip over WebRTC, 640x480",
        [
            Criterion("frames a second that come back", fps, ">=", FPS_TARGET),
            Criterion("round trip, median", median, "<=", MEDIAN_TARGET_MS, "ms"),
        ],
        [Table("By a clock in the pictures", columns, rows)],
        [f"Of the median, {plain / median:.0%} is WebRTC's own: encoding, decoding and sending, both ways."],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
