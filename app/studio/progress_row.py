"""A bar with the stage of some work, its percentage and the time left, as the terminal shows them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from nicegui import ui

MIN_SECONDS = 1.0  # that a stage is watched before its pace says anything


class TimeLeft:
    """Estimates how long a stage still takes, from its pace since it was first seen."""

    def __init__(self) -> None:
        self._stage = ""
        self._began = self._share = 0.0

    def __call__(self, stage: str, share: float, now: float) -> float | None:
        """Seconds left, or None while that is not known.

        >>> left = TimeLeft()
        >>> left("rendering", 0.2, now=0.0), left("rendering", 0.4, now=10.0)
        (None, 30.0)
        """
        if stage != self._stage or share < self._share:
            self._stage, self._began, self._share = stage, now, share
        gained = share - self._share
        if gained <= 0 or now - self._began < MIN_SECONDS:
            return None
        return (1 - share) * (now - self._began) / gained


class ProgressRow:
    """A row with the bar, and a button that ends the work.   ends : what it says."""

    def __init__(self, end: Callable[[], Any], ends: str = "Cancel") -> None:
        self._left = TimeLeft()
        with ui.column().classes("w-full gap-1") as self.row:
            with ui.row().classes("w-full items-center no-wrap gap-2"):
                self._stage = ui.label().classes("grow min-w-0").props('role="status"')
                self._figures = ui.label().classes("tabular-nums shrink-0")
                button = ui.button(icon="close", color=None, on_click=end).props("flat round dense")
                button.props["aria-label"] = ends
                button.tooltip(ends)
            self._bar = ui.linear_progress(show_value=False).props('aria-label="Progress" rounded size=8px')

    def show(self, stage: str, share: float) -> None:
        """Show the finished share of a stage."""
        self._bar.value = share
        self._stage.text = stage
        self._figures.text = figures(share, self._left(stage, share, time.monotonic()))


def figures(share: float, seconds: float | None) -> str:
    """The percentage, and the time left where it is known.

    >>> figures(0.256, 83.4), figures(0.0, None)
    ('26 % · 1:23 left', '0 %')
    """
    left = "" if seconds is None else f" · {int(seconds) // 60}:{int(seconds) % 60:02d} left"
    return f"{100 * share:.0f} %{left}"
