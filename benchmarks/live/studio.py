"""The studio's round trip: a clock burnt into the pictures of a camera, over a websocket to the studio and back.

640 x 480, 30 frames a second, on loopback, the browser's end and the studio's each in a process of its own.  The time
is written into a frame before it is sent, and read when it has come back; the studio tracks and swaps in between.  As
the page does, the browser's end sends a frame only while the studio has fewer than two.  Alternating runs that send
frames back unchanged measure the connection alone.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import multiprocessing
import socket
import tempfile
import time
from collections.abc import AsyncIterator
from itertools import count, cycle
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import uvicorn
import websockets
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocket

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
from guise.app.studio.frame_socket import HEADER, TIME_BASE, Peer, PeerOutput, packed, unpacked
from guise.app.studio.live_run import LiveRun

ROUNDS = 3
ROUND_SECONDS = 15.0
WARM_UP_SECONDS = 3.0  # that are not counted
DECODED_FRAMES = 150  # of the clip, decoded beforehand
IN_FLIGHT = 2  # frames that the studio has at once, as in live.js
FPS_TARGET, MEDIAN_TARGET_MS = 25.0, 60.0
WAYS = ("swapped", "sent back as it came")


class Echo:
    """A processor that leaves frames unchanged."""

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """Pass a frame on."""
        return OutputFrame(frame, FaceResult("shown"), stats, arrived)

    def close(self) -> None:
        """Nothing to release."""


def serve(pipe: Connection, scene: Scene | None) -> None:
    """The studio's process: tell the port, run until asked to end, and send the pipeline's figures."""
    asyncio.run(_serve(pipe, scene))


async def _serve(pipe: Connection, scene: Scene | None) -> None:
    peer, controls = Peer(), Controls()
    async with _listening(pipe, peer):
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
        peer.close()


@contextlib.asynccontextmanager
async def _listening(pipe: Connection, peer: Peer) -> AsyncIterator[None]:
    """A server of one websocket, the peer's."""

    async def connect(browser: WebSocket) -> None:
        await peer.serve(browser)

    config = uvicorn.Config(
        Starlette(routes=[WebSocketRoute("/", connect)]), log_level="error", ws_per_message_deflate=False
    )
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        pipe.send(listener.getsockname()[1])
        serving = asyncio.create_task(server.serve([listener]))
        yield
        server.should_exit = True
        await serving


async def browse(port: int, frames: list[Frame], seconds: float) -> tuple[list[float], float]:
    """The browser's end for some seconds: delays in milliseconds, and frames a second that came back."""
    found: list[tuple[float, float]] = []
    out: set[int] = set()
    async with websockets.connect(f"ws://127.0.0.1:{port}/", max_size=None, compression=None) as browser:
        sending = asyncio.create_task(film(browser, frames, out))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(WARM_UP_SECONDS + seconds):
                async for message in browser:
                    assert isinstance(message, bytes)
                    out -= {number for number in out if number <= HEADER.unpack_from(message)[-1]}
                    frame = Frame(unpacked(message)[0], pts=0, time_base=TIME_BASE, index=0)
                    if (code := clock.read(frame.luma)) is not None:
                        found.append((time.perf_counter(), clock.passed(code, clock.now())))
        sending.cancel()
    counted = [(at, delay) for at, delay in found if at > found[-1][0] - seconds]
    return [delay for _, delay in counted], (len(counted) - 1) / (counted[-1][0] - counted[0][0])


async def film(browser: websockets.ClientConnection, frames: list[Frame], out: set[int]) -> None:
    """Send the frames at thirty a second, each with its time, those that the studio has room for."""
    begun = time.perf_counter()
    for number, one in zip(count(), cycle(frames), strict=False):
        await asyncio.sleep(max(0.0, begun + number / 30 - time.perf_counter()))
        if len(out) < IN_FLIGHT:
            frame = one.copy()
            clock.burn(frame, clock.now())
            assert frame.video_frame is not None
            out.add(number)
            await browser.send(packed(frame.video_frame, number, time.perf_counter()))


def round_trip(
    frames: list[Frame], scene: Scene | None, seconds: float
) -> tuple[list[float], float, PipelineStats]:
    """One round: delays, frames a second, and the pipeline's figures."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, scene))
    process.start()
    try:
        delays, fps = asyncio.run(browse(ours.recv(), frames, seconds))
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
        "live.studio", "Live: the studio's round trip, 640x480",
        [
            Criterion("frames a second that come back", fps, ">=", FPS_TARGET),
            Criterion("round trip, median", median, "<=", MEDIAN_TARGET_MS, "ms"),
        ],
        [Table("By a clock in the pictures", columns, rows)],
        [f"Of the median, {plain / median:.0%} is the connection's own, both ways."],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
