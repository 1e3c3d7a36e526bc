"""Jobs for the studio's tests; they run in a process of their own, which imports this module."""

import fcntl
import os
import signal
import time
from pathlib import Path
from typing import Any

from guise.app.studio.jobs import JobQueue
from guise.app.studio.store import Store, StudioError
from guise.common.progress import Progress


def write(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Leave a file and say in which process."""
    progress("writing", 0.5)
    (folder / "out.txt").write_text(about["text"])
    return {"process": os.getpid()}


def wait(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Wait until the file `about["until"]` is there; NAME.begun is locked meanwhile and counts the beginnings."""
    with Path(about["until"]).with_suffix(".begun").open("a") as begun:
        fcntl.flock(begun, fcntl.LOCK_EX)
        begun.write("x")
        begun.flush()
        (folder / "part").write_text("")
        progress("waiting", 0.25)
        while not Path(about["until"]).exists():
            time.sleep(0.01)
    return {}


def leave(about: dict[str, Any], folder: Path) -> None:
    """Put what `write` has made where it was told to."""
    Path(about["at"]).write_text((folder / "out.txt").read_text())


def mistake(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """What the user got wrong."""
    (folder / "part").write_text("")
    raise StudioError("there is no face: use another clip")


def fault(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """What Guise got wrong."""
    raise KeyError("x")


def crash(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """End without a word."""
    (folder / "part").write_text("")
    os._exit(7)


def die(folder: Path) -> None:
    """A studio that is killed while a job runs."""
    jobs = JobQueue(Store(folder / "studio"))
    jobs.register("wait", wait)
    jobs.open()
    id = jobs.start("wait", {"until": str(folder / "never")})
    while not jobs.store.job(id).share:
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGKILL)
