"""The page Live in Chromium, with the browser on the same processor: frames a second and latency as the user has them.

Chromium's camera shows the sample clip in a loop, 640 x 480, 30 frames a second.  Frames are counted where the page
shows them; one latency is the page's own figure, from the time the camera gave a frame until it is handed back, the
other the browser's, from the camera's frame to its return.  Nothing watches the browser while it is measured: with its
developer tools connected it copies every message.

Processor time says what a machine that does nothing else could show.  What goes by the second (the camera, the own
picture, the page) is measured while the page sends nothing, and taken off before dividing by frames.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.live.runs import Scene, small
from benchmarks.people.studio import studio
from guise.app.studio.store import Store

NAME, TITLE = "live.browser", "Live: the studio in Chromium, 640x480"
ROUNDS, ROUND_SECONDS, WARM_UP_SECONDS, START_SECONDS = 3, 15.0, 5.0, 30.0
FPS_TARGET, MEDIAN_TARGET_MS = 25.0, 60.0
FIGURES = re.compile(r"median latency (\d+) ms, 95th percentile (\d+) ms")
# Counts the frames that are shown and times those that come back, between two moments.
WATCH = """([from, to]) => {
  const video = document.querySelector('video[aria-label="The result"]');
  const { offer, take } = guiseLive, sent = new Map(), trips = [];
  let shown = 0;
  const next = () => { shown += 1; video.requestVideoFrameCallback(next); };
  video.requestVideoFrameCallback(next);
  guiseLive.offer = function (session, frame) {
    sent.set(session.count, performance.now());
    return offer.call(this, session, frame);
  };
  guiseLive.take = function (session, data) {
    trips.push(performance.now() - sent.get(new DataView(data).getUint32(20, true)));
    return take.call(this, session, data);
  };
  setTimeout(() => { shown = trips.length = 0; }, 1000 * from);
  setTimeout(() => { window.watched = { shown, trips: [...trips].sort((a, b) => a - b) }; }, 1000 * to);
}"""
SILENT = (
    "(yes) => Object.assign(guiseLive, yes ? { most: 0, patience: Infinity } : { most: 2, patience: 1000 })"
)


def camera(clip: Path, output: Path) -> Path:
    """A clip as Chromium's fake camera takes it: JPEG pictures one after the other."""
    with av.open(str(clip)) as source, av.open(str(output), "w", format="mjpeg") as out:
        stream = out.add_stream("mjpeg", Fraction(30), {"qmin": "2", "qmax": "4"})
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuvj420p"
        for frame in source.decode(video=0):
            picture = frame.reformat(640, 480, "yuvj420p")
            picture.pict_type = 0
            out.mux(stream.encode(picture))
        out.mux(stream.encode(None))
    return output


def processor(pids: set[int]) -> float:
    """Processor seconds of processes so far."""
    ticks = 0
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        ticks += sum(map(int, fields[11:13]))
    return ticks / os.sysconf("SC_CLK_TCK")


def family(pid: int) -> set[int]:
    """A process and what it has started."""
    found = {pid}
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            found |= family(int(child))
    return found


@dataclass(frozen=True, eq=False)
class Chromium:
    """A running browser.  `page` connects to its page, and disconnects again."""

    playwright: Any
    process: int
    address: str

    @contextmanager
    def page(self) -> Iterator[Any]:
        """Its page, while developer tools are connected."""
        browser = self.playwright.chromium.connect_over_cdp(self.address)
        yield browser.contexts[0].pages[0]
        browser.close()


@contextmanager
def chromium(playwright: Any, executable: str, folder: Path, camera: Path) -> Iterator[Chromium]:
    """A browser of its own, whose camera shows a file."""
    command = [
        executable, "--headless", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={folder}",
        "--window-size=1440,1000", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-video-capture={camera}", "about:blank",
    ]  # fmt: skip
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
        try:
            port = folder / "DevToolsActivePort"
            end = time.monotonic() + START_SECONDS
            while not (port.exists() and port.read_text().count("\n")) and time.monotonic() < end:
                time.sleep(0.1)
            yield Chromium(playwright, process.pid, f"http://127.0.0.1:{port.read_text().split()[0]}")
        finally:
            process.terminate()


def begin(page: Any, address: str) -> None:
    """Go live."""
    page.goto(address.replace("/?", "/live?"))
    page.get_by_role("combobox", name="Who is at the camera", exact=True).click()
    page.get_by_role("option", name="Robin").click()
    page.get_by_role("button", name="Start").click()
    page.wait_for_function(
        "() => document.querySelector(`video[aria-label='The result']`).videoWidth > 0", timeout=120_000
    )


def spent(ends: tuple[set[int], set[int]], seconds: float) -> F64:
    """Processor ms a second of both ends (2,), over some seconds."""
    before = [processor(end) for end in ends]
    time.sleep(seconds)
    return (
        np.array([1000 * (processor(end) - start) for end, start in zip(ends, before, strict=True)]) / seconds
    )


def one_round(browser: Chromium, address: str, studio_pid: int, seconds: float) -> tuple[float, ...]:
    """Frames a second; the studio's median and 95th percentile of latency and the browser's, ms; processor ms.

    The last: of studio and browser a second while nothing is sent, and a frame beyond that.
    """
    with browser.page() as page:
        begin(page, address)
        page.evaluate(SILENT, True)
    time.sleep(WARM_UP_SECONDS)
    ends = {studio_pid}, family(browser.process)
    idle = spent(ends, seconds / 2)
    with browser.page() as page:
        page.evaluate(SILENT, False)
        page.evaluate(WATCH, [WARM_UP_SECONDS, WARM_UP_SECONDS + seconds])
    time.sleep(WARM_UP_SECONDS)
    busy = spent(ends, seconds)
    with browser.page() as page:
        page.wait_for_function("() => window.watched", timeout=60_000)
        watched = page.evaluate("watched")
        told = FIGURES.search(page.locator("body").inner_text())
        assert told is not None
        page.get_by_role("button", name="Stop").click()
        page.get_by_role("button", name="Start").wait_for()
    fps = watched["shown"] / seconds
    trips = np.quantile(watched["trips"], [0.5, 0.95])
    return fps, float(told[1]), float(told[2]), *trips, *idle, *((busy - idle) / fps)


def measure(options: argparse.Namespace) -> Report:
    """Rounds, one after the other."""
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    if executable is None:
        return skipped(NAME, TITLE, "Chromium is missing.")
    from playwright.sync_api import sync_playwright

    scene = small()
    with (
        tempfile.TemporaryDirectory(prefix="guise-", ignore_cleanup_errors=True) as name,
        sync_playwright() as tools,
    ):
        folder = Path(name)
        keep(folder / "studio", scene)
        film = camera(scene.clip.video, folder / "camera.mjpeg")
        with (
            studio(folder / "studio") as (address, process),
            chromium(tools, executable, folder / "browser", film) as browser,
        ):
            rounds = [
                one_round(browser, address, process, 5.0 if options.quick else ROUND_SECONDS)
                for _ in range(1 if options.quick else ROUNDS)
            ]
    return report(rounds)


def keep(folder: Path, scene: Scene) -> None:
    """A studio's folder with the person of the clip."""
    store = Store(folder)
    scene.person.save(store.add_person("Robin", None).path)
    store.close()


def report(rounds: list[tuple[float, ...]]) -> Report:
    """From the rounds."""
    fps, latency, _, _, _, *work = map(float, np.median(rounds, axis=0))
    second, frame = sum(work[:2]), sum(work[2:])
    columns = (
        "frames a second", "studio, median ms", "95 %", "there and back, median ms", "95 %",
        "idle studio, processor ms a second", "idle browser", "studio, processor ms a frame", "browser",
    )  # fmt: skip
    return Report(
        NAME,
        TITLE,
        [
            Criterion("frames a second that the page shows", fps, ">=", FPS_TARGET),
            Criterion("latency from the camera, median", latency, "<=", MEDIAN_TARGET_MS, "ms"),
            Criterion("processor of both at 25 a second, of two cores'",
                      second + FPS_TARGET * frame, "<=", 2000.0, "ms a second"),
        ],
        [Table("Rounds", columns, rounds)],
        [f"Two cores that do nothing else have time for {(2000 - second) / frame:.0f} frames a second."],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
