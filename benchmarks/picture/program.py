"""What the benchmarks of the picture share: the commands under test, the tools that judge, worst figures.

Clips are copied to the working folder without the landmarks beside them, so that the program finds its own.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.children import GUISE, CommandError, ran
from guise.app.measure.figures import mean_of
from guise.app.media import EncodeOptions, open_input, open_sink

WORK = Path(
    "out/benchmarks/picture"
)  # for models and videos unless --work tells another; delete them to enrol again
LOSSLESS = EncodeOptions(lossless=True, preset="ultrafast")
Figures = dict[str, float]
# How bad a figure is, for the worst of several.
HIGH: Callable[[float], float] = float
LOW: Callable[[float], float] = lambda v: -v  # noqa: E731
FAR_FROM_0: Callable[[float], float] = abs
FAR_FROM_1: Callable[[float], float] = lambda v: abs(v - 1)  # noqa: E731


@dataclass(frozen=True)
class Swapped:
    """A swapped video, its number of frames, and how many of them do not show the new face where the face is."""

    video: Path
    frames: int
    not_swapped: int


def alone(video: Path, output: Path) -> Path:
    """A copy of a clip without the landmarks beside it."""
    output.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(video, output)
    return output


def stretch(
    video: Path, output: Path, seconds: float, *, start: int = 0, options: EncodeOptions = LOSSLESS
) -> Path:
    """Some seconds of a clip from a frame on, without the landmarks beside it."""
    output.parent.mkdir(parents=True, exist_ok=True)
    with open_input(video) as source, open_sink(output, source, options, force=True) as sink:
        for frame in islice(source, start, start + round(seconds * source.frame_rate)):
            sink.write(frame)
    return output


def enrolled(clip: Path, *others: Path) -> Path:
    """The model beside a clip, enrolled from it, and others, with default options unless it is there."""
    model = clip.with_suffix(".guise")
    if not model.exists():
        common.say(f"enrolling {clip.stem}")
        ran([*GUISE, "enroll", clip, *others, "-o", model, "--quiet"])
    return model


def swapped(video: Path, source: Path, identity: Path | str, output: Path, *options: str) -> Swapped:
    """Swap a video, with default options but those given.  CommandError when the program refuses it."""
    output.parent.mkdir(parents=True, exist_ok=True)
    command = [*GUISE, "swap", video, "--source", source, "--identity", identity, "-o", output]
    report = json.loads(_output([*command, *options, "--force", "--json"]))
    return Swapped(output, report["frames"], report["frames"] - report["swapped"])


def judged(
    command: Sequence[str | Path], file: Path, environment: Mapping[str, str] | None = None
) -> Figures:
    """The figures that a tool writes as JSON; those without a value are NaN."""
    _output([*command, "--json", file], environment)
    found = json.loads(file.read_text())
    return {k: _number(v) for k, v in found.items() if not isinstance(v, str)}


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _output(command: Sequence[str | Path], environment: Mapping[str, str] | None = None) -> str:
    done = subprocess.run(
        [str(c) for c in command], capture_output=True, text=True, env=environment, check=False
    )
    if done.returncode:
        raise CommandError(f"{Path(str(command[0])).name} failed: {done.stderr.strip()[-400:]}")
    return done.stdout


def worst(values: Sequence[float], badness: Callable[[float], float]) -> float:
    """The worst of some figures; NaN ones are left out, and NaN without any.

    >>> worst([0.9, 1.2, float("nan")], FAR_FROM_1)
    1.2
    """
    return max((v for v in values if math.isfinite(v)), key=badness, default=math.nan)


def with_totals(
    rows: Sequence[Mapping[str, Any]], first: str, badness: Mapping[str, Callable[[float], float]]
) -> list[tuple[object, ...]]:
    """Rows of a table with the columns `first` and those of `badness`, then their means and worst figures."""
    lines = [(row[first], *(row[name] for name in badness)) for row in rows]
    columns = {name: [row[name] for row in rows] for name in badness}
    return [
        *lines,
        ("mean", *(mean_of(values) for values in columns.values())),
        ("worst", *(worst(columns[name], bad) for name, bad in badness.items())),
    ]
