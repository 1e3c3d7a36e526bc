"""What the live benchmarks share: the people in the clips, an output that times frames, and a display."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks import common
from benchmarks.common import Clip
from benchmarks.speed import enlarged
from guise.aam.model import Identity
from guise.app.live.capture import Capture
from guise.app.live.controls import Controls
from guise.app.live.output import Output, OutputFrame
from guise.app.live.overlay import Overlay
from guise.app.live.pipeline import Pipeline
from guise.app.live.session import LiveProcessor, SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.live.window import Window
from guise.app.swapping.donors import open_donor

SAMPLES = Path(__file__).parents[2] / "sample_videos"
DONOR = "p03"
SCREEN = "1600x1000x24"
PARTS = {
    "guise-live-processor": "faces",
    "guise-detector": "search for others",
    "guise-live-capture": "decoding",
    "av:": "decoding",
}  # by the beginning of a thread's name; the others are outputs'


@dataclass(frozen=True, eq=False)
class Scene:
    """A clip, the model of who is in it, and the face that is shown instead."""

    label: str
    clip: Clip
    person: Identity
    donor: Identity


def small() -> Scene:
    """640 x 480, 30 frames a second."""
    return _scene("640x480", common.clip_at(SAMPLES / "p01" / "talk.mp4", "p01"))


def large(shared: Path) -> Scene:
    """1280 x 720, 30 frames a second."""
    return _scene("1280x720", common.real_clip(shared, "room_s18"))


def larger(scene: Scene, folder: Path) -> Scene:
    """1920 x 1080, 30 frames a second, made of a smaller one in a folder."""
    video = enlarged(scene.clip, (1920, 1080), 420, 10, folder / "larger.mp4")
    return replace(scene, label="1920x1080", clip=replace(scene.clip, video=video))


def _scene(label: str, clip: Clip) -> Scene:
    return Scene(label, clip, common.enrolled(clip), open_donor(DONOR))


def used() -> Counter[str]:
    """Milliseconds of the processor that this process has used, and its threads by their part, where Linux tells."""
    names = {thread.native_id: thread.name for thread in threading.enumerate()}
    spent = Counter({"all": 1e3 * time.process_time()})
    for task in Path("/proc/self/task").glob("*"):
        with contextlib.suppress(OSError):  # it has just ended
            name = names.get(int(task.name)) or (task / "comm").read_text()
            part = next((part for begin, part in PARTS.items() if name.startswith(begin)), "output")
            spent[part] += int((task / "schedstat").read_text().split()[0]) / 1e6
    return spent


class Noted(Output):
    """Passes on to another output, if there is one, and notes when a picture was shown.

    Parameters
    ----------
    inner : Output or None.   after : called when a picture was shown.

    Attributes
    ----------
    times : when each picture had been shown, `time.perf_counter`.   covered : pictures with a cover.
    """

    def __init__(self, inner: Output | None, after: Callable[[], None]) -> None:
        self.main_thread = inner is not None and inner.main_thread
        self.times: list[float] = []
        self.covered = 0
        self._inner, self._after = inner, after

    def open(self, width: int, height: int, fps: float) -> None:
        if self._inner is not None:
            self._inner.open(width, height, fps)

    def show(self, shown: OutputFrame) -> None:
        if self._inner is not None:
            self._inner.show(shown)
        self.times.append(time.perf_counter())
        self.covered += shown.result.covered > 0
        self._after()

    def pump(self) -> bool:
        return self._inner is None or self._inner.pump()

    def close(self) -> None:
        if self._inner is not None:
            self._inner.close()


def window() -> Window:
    """As `guise live` opens it."""
    return Window(Controls(), Overlay([DONOR]))


def played(scene: Scene, capture: Capture, outputs: Sequence[Output]) -> PipelineStats:
    """Swap what a capture gives until it ends."""
    config, controls = SessionConfig([scene.donor], scene.person), Controls()
    return Pipeline(capture, lambda: LiveProcessor(config, controls), outputs).run()


@contextlib.contextmanager
def display() -> Iterator[None]:
    """An X display without a screen, for what opens windows inside; without Xvfb it ends the program."""
    if shutil.which("Xvfb") is None:
        print(
            "The window needs a virtual display: install Xvfb (Debian: apt-get install xvfb).",
            file=sys.stderr,
        )
        raise SystemExit(2)
    read, write = os.pipe()
    command = f"Xvfb -displayfd {write} -screen 0 {SCREEN} -nolisten tcp -noreset"
    server = subprocess.Popen(command.split(), pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as pipe:
            number = pipe.readline().strip()
        os.environ.pop("WAYLAND_DISPLAY", None)
        os.environ.update(DISPLAY=f":{number}", PYGLFW_LIBRARY_VARIANT="x11")
        yield
    finally:
        server.terminate()
        server.wait()
