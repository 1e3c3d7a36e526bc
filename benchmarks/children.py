"""Child processes: commands with their wall time and memory, and peers that answer requests."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

# Keeps MediaPipe quiet.
PEER_ENVIRONMENT = {"GLOG_minloglevel": "3", "TF_CPP_MIN_LOG_LEVEL": "3", "PATH": "/usr/bin:/bin"}
# Modules are compiled once, as they are where a package is installed.
AS_INSTALLED = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
GUISE = (sys.executable, "-c", "from guise.app.cli.main import main; raise SystemExit(main())")


class CommandError(RuntimeError):
    """A command that failed, with the end of its error output."""


@dataclass(frozen=True)
class Ran:
    """Wall and processor seconds, peak resident memory in MB, and (seconds, MB) samples if requested."""

    seconds: float
    processor: float
    peak_mb: float
    samples: tuple[tuple[float, float], ...] = ()


def ran(
    command: Sequence[str | Path], sample_every: float | None = None, *, allowed: Collection[int] = (0,),
    output: Path | None = None, environment: Mapping[str, str] | None = None,
) -> Ran:  # fmt: skip
    """Run a command to its end.

    Parameters
    ----------
    sample_every : seconds between samples of its resident memory; None takes none.
    allowed : exit codes that do not count as failures.
    output : a file for what it prints.   environment : variables that are added.

    Raises
    ------
    CommandError
        When it exits with another code.
    """
    samples: list[tuple[float, float]] = []
    start = time.perf_counter()
    with Path(output or os.devnull).open("wb") as printed:
        process = subprocess.Popen(
            [str(part) for part in command], stdin=subprocess.DEVNULL, stdout=printed, stderr=subprocess.PIPE,
            env=AS_INSTALLED | (environment or {}),
        )  # fmt: skip
    if sample_every is None:
        _, status, usage = os.wait4(process.pid, 0)
    else:
        while (ended := os.wait4(process.pid, os.WNOHANG))[0] == 0:
            samples.append((time.perf_counter() - start, _resident_mb(process.pid)))
            time.sleep(sample_every)
        _, status, usage = ended
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.stderr is not None
    with process.stderr as words:
        if process.returncode not in allowed:
            said = words.read().decode(errors="replace")[-400:]
            raise CommandError(f"{Path(str(command[0])).name} failed ({process.returncode}): {said}")
    return Ran(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, tuple(samples))


def _resident_mb(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_MB
    except (OSError, IndexError):
        return 0.0


class PeerProcess:
    """A process of the peers' environment that is ready when its first line comes, and ends with its stdin.

    Parameters
    ----------
    python : of that environment.
    script : that it runs, of ours, with these arguments.   environment : of the process, all of it.
    """

    def __init__(
        self, python: Path, script: Path, *arguments: object, environment: Mapping[str, str] = PEER_ENVIRONMENT
    ) -> None:  # fmt: skip
        self._process = subprocess.Popen(
            [str(python), str(script), *map(str, arguments)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment,
        )  # fmt: skip
        self.line()

    def send(self, data: bytes) -> None:
        """Write to its stdin."""
        assert self._process.stdin is not None
        self._process.stdin.write(data)
        self._process.stdin.flush()

    def line(self) -> bytes:
        """The next line of its stdout.  RuntimeError when it has stopped."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise RuntimeError("a peer stopped; is the peers' environment complete?")
        return line

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait(timeout=30)


def ffmpeg(*arguments: str | Path) -> Sequence[str | Path]:
    """An ffmpeg command that replaces its output and prints errors only."""
    return ("ffmpeg", "-nostdin", "-v", "error", "-y", *arguments)


def looped(video: Path, seconds: float, output: Path) -> Path:
    """A video repeated to a length without re-encoding."""
    ran(ffmpeg("-stream_loop", "-1", "-i", video, "-map", "0", "-c", "copy", "-t", f"{seconds:g}", output))
    return output
