"""What a command says: results on stdout, notes, progress and errors on stderr.

With --json stdout holds one JSON object and nothing else; with --quiet only errors are said.
"""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress

Advance = Callable[[float], None]

_REFRESH = 0.1  # seconds between two drawings of a bar


class Console:
    """Speaks to the user as the options ask.

    Parameters
    ----------
    quiet : say errors only.
    json : one JSON object on stdout, notes on stderr, no progress.
    """

    def __init__(self, *, quiet: bool = False, json: bool = False) -> None:
        self.quiet, self.json = quiet, json
        self._bars: Progress | None = None
        self._said: set[str] = set()

    def say(self, text: str) -> None:
        """A line of the result, for people; with --json the object holds it instead."""
        if not (self.quiet or self.json):
            self._print(text, sys.stdout)

    def note(self, text: str) -> None:
        """Something to know, once, on stderr."""
        if not self.quiet and text not in self._said:
            self._said.add(text)
            self._print(text, sys.stderr)

    def table(self, title: str, rows: Mapping[str, object]) -> None:
        """Names and values in two columns."""
        if self.quiet or self.json:
            return
        from rich import box, console, table, text

        grid = table.Table(title=title, title_justify="left", show_header=False, box=box.SIMPLE)
        for name, value in rows.items():
            grid.add_row(text.Text(name), text.Text(str(value)))
        console.Console().print(grid)

    def grid(self, title: str, columns: list[str], rows: list[list[str]]) -> None:
        """A table with headed columns; all but the first are aligned right."""
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
        """The JSON object of a run, with --json."""
        if self.json:
            print(json.dumps(facts, default=str))

    @contextlib.contextmanager
    def progress(self, label: str) -> Iterator[Advance]:
        """A bar with the time that is left; the block calls what it gets with the share done, 0..1."""
        if self._bars is not None or not self._shows_bars():
            yield lambda share: None
            return
        bars = _make_bars()
        task = bars.add_task(label, total=1.0)
        last = 0.0

        def advance(share: float) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last > _REFRESH or share >= 1:
                last = now
                bars.update(task, completed=min(max(share, 0.0), 1.0), refresh=True)

        self._bars = bars
        try:
            with bars:
                yield advance
        finally:
            self._bars = None

    def _shows_bars(self) -> bool:
        return not (self.quiet or self.json) and sys.stderr.isatty()

    def _print(self, text: str, stream: Any) -> None:
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
    """Progress bars of a work that has named stages one after the other.

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
        """Show that `share` of a stage is done."""
        if stage != self._stage:
            self._bar.close()
            self._stage = stage
            self._advance = self._bar.enter_context(self._console.progress(stage))
        self._advance(share)

    def __exit__(self, *problem: object) -> None:
        self._bar.close()


def _nothing(share: float) -> None:
    """Progress that nobody sees."""
