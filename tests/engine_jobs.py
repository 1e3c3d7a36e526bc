"""Jobs for the tests of engines: what a worker process can import and do."""

import os
import signal
import threading
import time
from pathlib import Path

from guise.app.deidentify.stages.jobs import Job
from guise.app.media import MediaError


class Odd(Exception):
    """An error that holds what cannot be sent to another process."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.lock = threading.Lock()


def write(job: Job) -> None:
    """Leave a file with the process's number."""
    (Path(job.work) / f"{job.index}.done").write_text(str(os.getpid()))


def act(job: Job) -> None:
    """What the stage says, then `write`."""
    folder = Path(job.work)
    if job.stage == "bad":
        if job.index == 2:
            raise MediaError("clip.mp4 is not a video.")
        time.sleep(0.02)  # so that not all are done before the others are called off
    if job.stage == "odd":
        raise Odd("ab")
    if job.stage == "slow":
        (folder / f"{job.index}.begun").write_text(str(os.getpid()))
        time.sleep(0.2)
    if job.stage == "killed once" and job.index == 1 and not (folder / "killed").exists():
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if job.stage == "killed" and job.index == 1:
        with (folder / "kills").open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    if job.stage == "endless":
        (folder / f"{job.index}.begun").write_text(str(os.getpid()))
        time.sleep(600)
    if job.stage == "alone":
        os.close(os.open(folder / "inside", os.O_CREAT | os.O_EXCL))
        time.sleep(0.3)
        (folder / "inside").unlink()
    if job.stage == "environment":
        (folder / "threads").write_text(os.environ["OPENBLAS_NUM_THREADS"])
    write(job)
