"""Output of the commands: results on stdout; notes, progress and errors on stderr.

With --json stdout holds one JSON object and nothing else, and progress is lines of JSON on stderr, for programs:

    {"event": "progress", "file": "a.mp4", "stage": "drawing", "share": 0.25, "seconds_left": 31.5}

With --quiet only errors are printed.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from guise.common.option import option
from guise.common.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

Advance = Callable[[float], None]

_REFRESH_SECONDS = 0.1  # between two redraws of a bar
_LINE_SECONDS = 1.0  # between two lines of JSON on a stage


@dataclass(frozen=True)
class _Told:
    """What was last told of a file: its stage and the share of it, since when it lasts, and when that was told."""

    stage: str
    share: float
    began: float
    said: float


@dataclass(kw_only=True, eq=False)
class Console:
    """Prints for the user as the options ask."""

    quiet: bool = option(False, "Print errors only.", name="--quiet -q")
    json: bool = option(
        False, "Print one JSON object on stdout; notes, and progress as lines of JSON, on stderr."
    )
    piped: bool = field(default=False, init=False)  # stdout holds pictures, and stderr the rest
    _bars: Progress | None = field(default=None, init=False)
    _said: set[str] = field(default_factory=set, init=False)
    _told: dict[str | None, _Told] = field(default_factory=dict, init=False)  # by file

    def say(self, text: str) -> None:
        """Print a line of the result for people; with --json the object holds it instead."""
        if not (self.quiet or self.json):
            self._print(text, sys.stderr if self.piped else sys.stdout)

    def note(self, text: str) -> None:
        """Print a note on stderr, the same one only once."""
        if not self.quiet and text not in self._said:
            self._said.add(text)
            self._print(text, sys.stderr)

    def error(self, text: str) -> None:
        """Print on stderr what went wrong with a part of the work."""
        self._print(f"error: {text}", sys.stderr)

    def table(self, title: str, rows: Mapping[str, object]) -> None:
        """Print names and values in two columns."""
        if self.quiet or self.json:
            return
        from rich import box, console, table, text

        grid = table.Table(title=title, title_justify="left", show_header=False, box=box.SIMPLE)
        for name, value in rows.items():
            grid.add_row(text.Text(name), text.Text(str(value)))
        console.Console().print(grid)

    def grid(self, title: str, columns: list[str], rows: list[list[str]]) -> None:
        """Print a table with column heads; all columns but the first are right-aligned."""
        if self.quiet or self.json:
            return
        from rich import box, console, table, text

        grid = table.Table(title=title, title_justify="left", box=box.SIMPLE)
        for number, column in enumerate(columns):
            grid.add_column(column, justify="right" if number else "left")
        for row in rows:
            grid.add_row(*(text.Text(cell) for cell in row))
        console.Console().print(grid)

    def result(self, facts: Mapping[str, Any]) -> None:
        """Print the JSON object of a run, with --json."""
        if self.json:
            print(json.dumps(facts, default=str), file=sys.stderr if self.piped else sys.stdout)

    def tell(self, stage: str, share: float, file: str | None = None) -> None:
        """With --json, print that `share` of a stage is done: when it begins, when it ends, and once a second."""
        if not self.json or self.quiet:
            return
        now, last = time.monotonic(), self._told.get(file)
        fresh = last is None or last.stage != stage or share < last.share
        began = now if last is None or fresh else last.began
        if last is None or fresh or now - last.said >= _LINE_SECONDS or share >= 1 > last.share:
            self._told[file] = _Told(stage, share, began, now)
            left = None if share <= 0 or fresh else round((now - began) * (1 - share) / share, 1)
            facts = {
                "event": "progress",
                "file": file,
                "stage": stage,
                "share": round(share, 3),
                "seconds_left": left,
            }
            sys.stderr.write(json.dumps(facts) + "\n")
            sys.stderr.flush()

    @contextlib.contextmanager
    def progress(self, label: str) -> Iterator[Advance]:
        """Show a bar with the remaining time; the block calls what it gets with the finished share, 0..1."""
        if self._bars is not None or not self._shows_bars():
            yield lambda share: None
            return
        bars = _make_bars()
        task = bars.add_task(label, total=1.0)
        last = 0.0

        def advance(share: float) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last > _REFRESH_SECONDS or share >= 1:
                last = now
                bars.update(task, completed=min(max(share, 0.0), 1.0), refresh=True)

        self._bars = bars
        try:
            with bars:
                yield advance
        finally:
            self._bars = None

    def show_bars(self) -> Progress | None:
        """Bars for `Board`, until `hide_bars`; None where nobody would see them."""
        if self._shows_bars():
            self._bars = _make_bars()
            self._bars.start()
        return self._bars

    def hide_bars(self) -> None:
        """Remove the bars."""
        if self._bars is not None:
            self._bars.stop()
            self._bars = None

    def _shows_bars(self) -> bool:
        return not (self.quiet or self.json) and sys.stderr.isatty()

    def _print(self, text: str, stream: Any) -> None:
        text = printable(text)
        if self._bars is not None:
            self._bars.console.print(text, markup=False, highlight=False, soft_wrap=True)
        else:
            print(text, file=stream, flush=True)


def _make_bars() -> Progress:
    from rich.console import Console as Terminal
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn()
    return Progress(*columns, console=Terminal(stderr=True), transient=True, auto_refresh=False)


class Stages:
    """Progress bars for work in named stages, one after the other.

    >>> with Stages(Console(quiet=True)) as stages:
    ...     stages("training", 0.5)
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = contextlib.ExitStack()
        self._stage = ""
        self._advance: Advance = _nothing

    def __enter__(self) -> Stages:
        return self

    def __call__(self, stage: str, share: float) -> None:
        """Show that `share` of a stage is finished."""
        if stage != self._stage:
            self._bar.close()
            self._stage = stage
            self._advance = self._bar.enter_context(self._console.progress(stage))
        self._advance(share)
        self._console.tell(stage, share)

    def __exit__(self, *problem: object) -> None:
        self._bar.close()


class Board:
    """Progress bars of several files at a time: one for all of them, and one for each with its stage.

    total : number of files; a single one has only its own bar.
    """

    def __init__(self, console: Console, total: int) -> None:
        self._console, self._total = console, total
        self._lock = threading.Lock()
        self._tasks: dict[str, tuple[TaskID, str]] = {}
        self._drawn = 0.0

    def __enter__(self) -> Board:
        self._bars = self._console.show_bars()
        if self._total > 1 and self._bars is not None:
            self._all = self._bars.add_task(f"0 of {self._total} files", total=self._total)
        return self

    def show(self, name: str, stage: str, share: float) -> None:
        """Show that a file has finished `share` of a stage."""
        with self._lock:
            self._console.tell(stage, share, name)
            if self._bars is None:
                return
            task, before = self._tasks.get(name, (None, ""))
            label = stage if self._total == 1 else f"{PurePath(name).name}: {stage}"
            label = printable(label).replace("[", r"\[")  # rich's markup
            if task is None:
                task = self._bars.add_task(label, total=1.0)
            elif stage != before:
                self._bars.reset(task, description=label)  # restarts its time
            self._tasks[name] = task, stage
            self._bars.update(task, completed=share)
            self._draw()

    def finished(self, name: str, count: int) -> None:
        """Show that a file is finished, the `count`-th."""
        with self._lock:
            if self._bars is None:
                return
            if name in self._tasks:
                self._bars.remove_task(self._tasks.pop(name)[0])
            if self._total > 1:
                self._bars.update(self._all, description=f"{count} of {self._total} files", completed=count)
            self._draw()

    def _draw(self) -> None:
        now = time.monotonic()
        if self._bars is not None and now - self._drawn > _REFRESH_SECONDS:
            self._drawn = now
            self._bars.refresh()

    def __exit__(self, *problem: object) -> None:
        self._console.hide_bars()


def _nothing(share: float) -> None:
    """Show nothing."""
