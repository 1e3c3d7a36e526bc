"""Commands in child processes: wall time, peak memory, and memory over time."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 2**20
GUISE = (sys.executable, "-c", "from guise.app.cli.main import main; raise SystemExit(main())")


class CommandError(RuntimeError):
    """A command that failed; its last words."""


@dataclass(frozen=True)
class Ran:
    """Wall and processor seconds, peak resident memory in MB, and (seconds, MB) samples if they were asked for."""

    seconds: float
    processor: float
    peak_mb: float
    samples: tuple[tuple[float, float], ...] = ()


def ran(
    command: Sequence[str | Path], sample_every: float | None = None, *, allowed: Collection[int] = (0,)
) -> Ran:
    """Run a command to its end.

    Parameters
    ----------
    sample_every : seconds between samples of its resident memory; None takes none.
    allowed : exit codes that are no failure.

    Raises
    ------
    CommandError
        When it exits with another code.
    """
    samples: list[tuple[float, float]] = []
    start = time.perf_counter()
    process = subprocess.Popen(
        [str(part) for part in command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
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
            raise CommandError(
                f"{Path(str(command[0])).name} failed: {words.read().decode(errors='replace')[-400:]}"
            )
    return Ran(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024, tuple(samples))


def _resident_mb(pid: int) -> float:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_MB
    except (OSError, IndexError):
        return 0.0


def ffmpeg(*arguments: str | Path) -> Sequence[str | Path]:
    """An ffmpeg command that replaces its output and says errors only."""
    return ("ffmpeg", "-nostdin", "-v", "error", "-y", *arguments)


def looped(video: Path, seconds: float, output: Path) -> Path:
    """A video repeated to a length without encoding it again."""
    ran(ffmpeg("-stream_loop", "-1", "-i", video, "-map", "0", "-c", "copy", "-t", f"{seconds:g}", output))
    return output
