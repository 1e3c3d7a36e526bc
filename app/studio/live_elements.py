"""Elements of the page Live that know nothing of it: pictures, choices, and figures with their graph."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from nicegui import ui

from guise.app.live.stats import PipelineStats

GRAPH_POINTS = 120  # of the latency graph, one for each update
GREY = "#808080"  # readable in light and in dark


def video(name: str) -> ui.element:
    """A video element."""
    video = ui.element("video").props("autoplay muted playsinline")
    video.props["aria-label"] = name
    return video


def select(label: str, options: dict[Any, str], value: Any, change: Callable[[Any], Any]) -> ui.select:
    return (
        ui.select(options, label=label, value=value, on_change=change)
        .classes("w-full")
        .props("outlined dense")
    )


class Performance:
    """Frame rate and latency in words and, once it is asked for, in a graph."""

    def __init__(self) -> None:
        self._latencies: deque[float] = deque([0.0] * GRAPH_POINTS, GRAPH_POINTS)
        self._graph: ui.echart | None = None
        self._figures = ui.label().classes("tabular-nums opacity-70")
        self._box = ui.expansion("Performance", icon="speed", on_value_change=self._plot).classes("w-full")

    def show(self, stats: PipelineStats) -> None:
        """Show the current figures."""
        self._latencies.append(round(stats.latency, 1))
        self._figures.set_visibility(True)
        ui.run_javascript(f"guiseLive.write({self._figures.id}, '{figures(stats)}')")
        if self._graph is not None and self._box.value:  # it costs the browser several pictures
            self._graph.options["series"][0]["data"] = list(self._latencies)
            self._graph.update()

    def end(self) -> None:
        """The run has ended."""
        self._figures.set_visibility(False)

    def _plot(self) -> None:
        """Draw the graph once it is asked for: its library is as large as the rest of the page."""
        if self._graph is None:
            with self._box:
                self._graph = ui.echart(graph(list(self._latencies))).classes("w-full h-40")
            self._graph.props('role=img aria-label="Recent latency from the camera on"')


def graph(latencies: list[float]) -> dict[str, Any]:
    """Options of a line graph of latencies, milliseconds."""
    return {
        "animation": False,
        "grid": {"left": 45, "right": 10, "top": 30, "bottom": 10},
        "xAxis": {"type": "category", "show": False},
        "yAxis": {
            "type": "value",
            "name": "ms",
            "min": 0,
            "splitNumber": 3,
            "axisLabel": {"color": GREY},
            "nameTextStyle": {"color": GREY},
            "splitLine": {"lineStyle": {"color": GREY, "opacity": 0.4}},
        },
        "series": [{"type": "line", "data": latencies, "showSymbol": False}],
    }


def figures(stats: PipelineStats) -> str:
    """The readout in words."""
    return (
        f"{stats.fps:.0f} frames per second · median latency {stats.latency:.0f} ms, 95th percentile "
        f"{stats.latency_95:.0f} ms · {stats.dropped + stats.skipped} dropped"
    )
