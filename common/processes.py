"""A function in a process of its own, with a pipe to whoever started it.

The process is spawned, so that it inherits neither threads nor locks.  It leaves Ctrl-C to the program that started it
and ends at once when that program does, however that comes about.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

_SPAWN = multiprocessing.get_context("spawn")


class ChildProcess:
    """Calls function(pipe, *arguments) in a new process; the pipe leads to `send` and `receive` here.

    One thread talks to the process; any thread may call `terminate` or `kill`, upon which `receive` raises EOFError.

    Parameters
    ----------
    function : at the top level of a module.   arguments : what pickle can hold.
    name : of the process, for debuggers.
    daemon : end the process with this program's interpreter.  False lets it start processes of its own.
    """

    def __init__(
        self, function: Callable[..., None], *arguments: Any, name: str | None = None, daemon: bool = True
    ) -> None:
        self._pipe, theirs = _SPAWN.Pipe()
        self._process = _SPAWN.Process(
            target=_run, args=(function, theirs, arguments), name=name, daemon=daemon
        )
        self._process.start()
        theirs.close()  # so that receiving ends when the process does

    @property
    def exit_code(self) -> int | None:
        """The exit status, negative for a signal; None while the process runs."""
        return self._process.exitcode

    def send(self, message: Any) -> None:
        """Send a message; OSError when the process has ended."""
        self._pipe.send(message)

    def receive(self) -> Any:
        """Wait for the next message; EOFError or another OSError when the process has ended."""
        return self._pipe.recv()

    def terminate(self, grace_seconds: float) -> None:
        """Ask the process to end, and kill it if it has not by then."""
        self._process.terminate()
        self._process.join(grace_seconds)
        if self._process.is_alive():
            self._process.kill()

    def kill(self) -> None:
        """End the process at once and wait until it has."""
        self._process.kill()
        self._process.join()

    def close(self) -> None:
        """Close the pipe and wait until the process has ended, as it does when it next uses its own end."""
        self._pipe.close()
        self._process.join()


def _run(function: Callable[..., None], pipe: Connection, arguments: tuple[Any, ...]) -> None:
    """What the child process does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends Ctrl-C to both; the parent decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    function(pipe, *arguments)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
