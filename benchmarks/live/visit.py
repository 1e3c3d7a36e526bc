"""A studio of its own and a browser whose camera is a clip, for measuring the page Live and for its picture."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av

from benchmarks.threads import VARIABLES


@contextmanager
def studio(folder: Path, people: Path) -> Iterator[str]:
    """The address of a studio in a process of its own, with folders for its files and for whom it knows."""
    command = [
        sys.executable,
        "-m",
        "guise",
        "studio",
        "--port",
        "0",
        "--no-open",
        "--json",
        "--folder",
        str(folder),
    ]
    environment = os.environ | dict.fromkeys(VARIABLES, "1") | {"GUISE_PEOPLE": str(people)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None
            yield json.loads(process.stdout.readline())["address"]
        finally:
            process.send_signal(signal.SIGINT)


@contextmanager
def browser(clip: Path, folder: Path, **view: Any) -> Iterator[Any]:
    """A page of Chromium, without a window, whose camera shows a clip at 30 frames a second.

    folder : for the camera's file.   view : of Playwright's new page.
    """
    from playwright.sync_api import sync_playwright

    arguments = [
        "--no-sandbox", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-video-capture={_film(clip, folder / 'camera.y4m')}",
    ]  # fmt: skip
    executable = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=executable, args=arguments)
        yield chromium.new_page(**view)
        chromium.close()


def _film(clip: Path, path: Path) -> Path:
    """A clip as Chromium's fake camera reads it, YUV4MPEG2."""
    with av.open(str(clip)) as source, path.open("wb") as out:
        for i, frame in enumerate(source.decode(video=0)):
            if i == 0:
                out.write(b"YUV4MPEG2 W%d H%d F30:1 Ip C420jpeg\n" % (frame.width, frame.height))
            out.write(b"FRAME\n" + frame.to_ndarray(format="yuv420p").tobytes())
    return path
