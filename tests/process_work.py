"""For the tests of child processes: what a new process can import and call, and what watches it."""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

from guise.common.processes import ChildProcess


def echo(pipe: Connection, word: str) -> None:
    """Send back what comes, until None does."""
    while (message := pipe.recv()) is not None:
        pipe.send((word, message, multiprocessing.current_process().name))


def hang(pipe: Connection, stubborn: bool = False) -> None:
    """Send the process's number and stay; a stubborn one refuses to terminate."""
    if stubborn:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    pipe.send(os.getpid())
    time.sleep(600)


def start_another(pipe: Connection) -> None:
    """Send what a process of this process says."""
    other = ChildProcess(echo, "said")
    other.send("by another")
    said, text, _ = other.receive()
    pipe.send(f"{said} {text}")
    other.kill()


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and that nobody has waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_until(holds: Callable[[], bool], seconds: float = 60) -> None:
    """Wait until a condition holds; AssertionError when it never does."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)
