"""The studio in Chromium: a newcomer's way to a swapped video, and a frame previewed at 1080p.

An empty studio is opened at its printed address.  Clicks are counted until the swapped sample clip is downloaded, and
the time from the first of them.  Then a clip of 1920 x 1080 is uploaded, and frames drawn with one face after another.
Both are also told in processor seconds of the studio and its jobs, which other work on the machine hardly changes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks import common
from benchmarks.children import GUISE
from benchmarks.common import Criterion, Report
from benchmarks.landmarks.setting import skipped
from benchmarks.people.clips import written
from guise.app.media import open_input

NAME, TITLE = "people.studio", "People: the studio's ways"
PATIENCE_MS = 600_000
FACES = ("Amara", "Walter", "Kofi", "Elena", "Kenji")
FRAMES = 45
SIZE = (1920, 1080)


@contextmanager
def studio(folder: Path) -> Iterator[tuple[str, int]]:
    """A studio; its address with the token, and its process."""
    command = [*GUISE, "studio", "--folder", folder, "--port", "0", "--no-open", "--json"]
    with subprocess.Popen([*map(str, command)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["address"], process.pid
        finally:
            process.terminate()


def processor(pid: int) -> float:
    """Processor seconds of a process and of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def newcomer(page: Any, address: str) -> tuple[int, float]:
    """Clicks and seconds from an empty studio to a downloaded video."""
    clicks, start = 0, 0.0
    page.goto(address)
    page.get_by_role("button", name="I agree").wait_for()
    start = time.perf_counter()
    for name in ("I agree", "Swap a sample clip"):
        page.get_by_role("button", name=name).click()
        clicks += 1
    link = page.get_by_role("link", name="Download video")
    link.wait_for(timeout=PATIENCE_MS)
    with page.expect_download() as waiting:
        link.click()
        clicks += 1
    assert waiting.value.path().stat().st_size > 0
    return clicks, time.perf_counter() - start


def large(video: Path, output: Path) -> Path:
    """The beginning of a clip, enlarged to SIZE."""
    with open_input(video) as source:
        cropped = (frame.rgb()[60:420] for frame in islice(source, FRAMES))
        return written((np.asarray(cv2.resize(one, SIZE), np.uint8) for one in cropped), output)


def previews(
    page: Any, address: str, clip: Path, clock: Callable[[], float]
) -> tuple[list[float], list[float]]:
    """Seconds from the choice of a face to the frame with it, by the wall and by a processor's clock."""
    page.goto(address.replace("/?", "/swap?"))
    page.locator("input[type=file]").first.set_input_files(str(clip))
    page.get_by_text("drawn in").wait_for(timeout=PATIENCE_MS)
    seconds, worked = [], []
    for face in FACES:
        before = page.get_by_role("img", name="After", exact=True).get_attribute("src")
        start, begun = time.perf_counter(), clock()
        page.get_by_role("group", name="Face of person 1").get_by_role("button", name=face).click()
        page.wait_for_function(
            "(old) => document.querySelector('img[alt=After]').src !== old", arg=before, timeout=PATIENCE_MS
        )
        seconds.append(time.perf_counter() - start)
        worked.append(clock() - begun)
    return seconds, worked


def measure(options: argparse.Namespace) -> Report:
    """Both ways."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        return skipped(NAME, TITLE, "Chromium is missing.")
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory(prefix="guise-") as name, sync_playwright() as playwright:
        folder = Path(name)
        clip = large(
            options.shared / "data" / "synthetic" / "people" / "p02" / "talk2.mp4", folder / "large.mp4"
        )
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        with studio(folder / "studio") as (address, process):
            worked = processor(process)
            clicks, seconds = newcomer(page, address)
            worked = processor(process) - worked
            common.say(f"{clicks} clicks, {seconds:.1f} s, {worked:.1f} s of a processor")
            drawn, drawing = previews(page, address, clip, lambda: processor(process))
            common.say(f"{drawn}, {drawing}")
            page.close()
        browser.close()
    return Report(
        NAME,
        TITLE,
        [
            Criterion("clicks of a newcomer", float(clicks), "<=", 3.0),
            Criterion("seconds of a newcomer", seconds, "<=", 60.0, "s"),
            Criterion("the same, of a processor", worked, "<=", 60.0, "s"),
            Criterion("preview of a frame of 1080p, median", float(np.median(drawn)), "<=", 2.0, "s"),
            Criterion("preview of a frame of 1080p, slowest", max(drawn), "<=", 2.0, "s"),
            Criterion("the same, of a processor", max(drawing), "<=", 2.0, "s"),
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
