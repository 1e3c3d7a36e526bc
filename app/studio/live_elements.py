"""Elements of the page Live that know nothing of it: pictures, choices, figures and their graph."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from guise.app.live.stats import PipelineStats

GREY = "#808080"  # readable in light and in dark


def video(name: str) -> ui.element:
    """A video element."""
    video = ui.element("video").props("autoplay muted playsinline")
    video.props["aria-label"] = name
    return video.classes("w-full rounded bg-black aspect-[4/3] object-contain")


def select(label: str, options: dict[Any, str], value: Any, change: Callable[[Any], Any]) -> ui.select:
    return (
        ui.select(options, label=label, value=value, on_change=change)
        .classes("w-full")
        .props("outlined dense")
    )


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
