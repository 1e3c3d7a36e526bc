"""The page Live in Chromium, with the browser on the same processor: frames a second and latency as the user has them.

Chromium's camera shows the sample clip in a loop, 640 x 480, 30 frames a second.  Frames are counted where the page
shows them; the latency is the page's own, from a frame's arrival at the studio until it is handed back.  Processor
seconds a frame of the studio and of the browser say what a machine that does nothing else could show.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.live.runs import Scene, small
from benchmarks.people.studio import studio
from guise.app.studio.store import Store

NAME, TITLE = "live.browser", "Live: the studio in Chromium, 640x480"
ROUNDS, ROUND_SECONDS, WARM_UP_SECONDS = 3, 15.0, 5.0
FPS_TARGET, MEDIAN_TARGET_MS = 25.0, 60.0
FIGURES = re.compile(r"median latency (\d+) ms, 95th percentile (\d+) ms · (\d+) dropped")
COUNT = """(seconds) => new Promise((done) => {
  const video = document.querySelector('video[aria-label="The result"]');
  let count = 0;
  const next = () => { count += 1; video.requestVideoFrameCallback(next); };
  video.requestVideoFrameCallback(next);
  setTimeout(() => done(count / seconds), 1000 * seconds);
})"""


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


def one_round(page: Any, address: str, studio_pid: int, seconds: float) -> tuple[float, ...]:
    """Frames a second, median and 95th percentile of the latency, ms, and processor ms a frame of both ends."""
    page.goto(address.replace("/?", "/live?"))
    page.get_by_role("combobox", name="Who is at the camera", exact=True).click()
    page.get_by_role("option", name="Robin").click()
    page.get_by_role("button", name="Start").click()
    page.wait_for_function(
        "() => document.querySelector(`video[aria-label='The result']`).videoWidth > 0", timeout=60_000
    )
    page.wait_for_timeout(1000 * WARM_UP_SECONDS)
    ends = {studio_pid}, family(os.getpid()) - {os.getpid()} - family(studio_pid)
    before = [processor(end) for end in ends]
    fps = float(page.evaluate(COUNT, seconds))
    spent = [1000 * (processor(end) - start) for end, start in zip(ends, before, strict=True)]
    told = FIGURES.search(page.locator("body").inner_text())
    assert told is not None
    page.get_by_role("button", name="Stop").click()
    page.get_by_role("button", name="Start").wait_for()
    return fps, float(told[1]), float(told[2]), *(part / max(1.0, fps * seconds) for part in spent)


def measure(options: argparse.Namespace) -> Report:
    """Rounds, one after the other."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        return skipped(NAME, TITLE, "Chromium is missing.")
    from playwright.sync_api import sync_playwright

    scene = small()
    with tempfile.TemporaryDirectory(prefix="guise-") as name, sync_playwright() as playwright:
        folder = Path(name)
        arguments = [
            "--no-sandbox", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
            f"--use-file-for-fake-video-capture={camera(scene.clip.video, folder / 'camera.mjpeg')}",
        ]  # fmt: skip
        keep(folder / "studio", scene)
        browser = playwright.chromium.launch(executable_path=chromium, args=arguments)
        page = browser.new_page()
        with studio(folder / "studio") as (address, process):
            rounds = [
                one_round(page, address, process, 5.0 if options.quick else ROUND_SECONDS)
                for _ in range(1 if options.quick else ROUNDS)
            ]
            page.close()
        browser.close()
    return report(rounds)


def keep(folder: Path, scene: Scene) -> None:
    """A studio's folder with the person of the clip."""
    store = Store(folder)
    scene.person.save(store.add_person("Robin", None).path)
    store.close()


def report(rounds: list[tuple[float, ...]]) -> Report:
    """From the rounds."""
    middle = np.median(rounds, axis=0)
    columns = ("frames a second", "median, ms", "95 %, ms", "studio, processor ms a frame", "browser, ms")
    return Report(
        NAME,
        TITLE,
        [
            Criterion("frames a second that the page shows", float(middle[0]), ">=", FPS_TARGET),
            Criterion("latency in the studio, median", float(middle[1]), "<=", MEDIAN_TARGET_MS, "ms"),
            Criterion("processor of both a frame, of two cores' at 25 a second",
                      float(middle[3:].sum()), "<=", 2 * 1000 / FPS_TARGET, "ms"),
        ],
        [Table("Rounds", columns, [tuple(row) for row in rounds])],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
