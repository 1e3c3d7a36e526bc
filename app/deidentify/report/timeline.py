"""A track over the video as a picture (SVG): what was done above, confidence below; figures for the pointer.

The video is cut into at most COLUMNS equal parts; a part shows the least hidden of what was done in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.report.html import Html, tag
from guise.app.deidentify.report.report import clock
from guise.app.deidentify.tracks import DONE, FileReport, Outcome

COLUMNS = 500
WIDTH, HEIGHT = 1000, 80  # units of the picture
BAND = 30  # height of what was done
BOTTOM = HEIGHT - 2
CURVE = 42  # height of confidence 1
WORDS = {"swapped": "swapped", "covered": "covered", "left": "left as it is"}


@dataclass(frozen=True, eq=False)
class Columns:
    """Parts of the video: (n,) done, index into DONE or -1 for nothing; (n,) mean confidence; (n + 1,) first frames."""

    done: NDArray[np.int8]
    confidence: NDArray[np.float64]
    edges: NDArray[np.int64]


def columns(one: Outcome, frames: int) -> Columns:
    """What was done in each part of a video of so many frames."""
    count = min(COLUMNS, frames)
    place = one.frames.astype(np.int64) * count // frames
    done = np.full(count, -1, np.int8)
    np.maximum.at(done, place, one.done.astype(np.int8))
    rows = np.bincount(place, minlength=count)
    sums = np.bincount(place, one.confidence.astype(np.float64), minlength=count)
    edges = -(-np.arange(count + 1) * frames // count)
    return Columns(done, sums / np.maximum(rows, 1), edges)


def times(report: FileReport) -> str:
    """The times of the parts' beginnings, for the script."""
    count = min(COLUMNS, report.frames)
    return " ".join(clock(float(report.seconds[-(-k * report.frames // count)])) for k in range(count))


def timeline(one: Outcome, report: FileReport, label: str) -> Html:
    """The figure of a track.   label : what it is of."""
    parts = columns(one, report.frames)
    picture = tag(
        "svg",
        tag("rect", class_="ground", width=WIDTH, height=BAND),
        *_bands(parts, report),
        tag("line", class_="half", x1=0, x2=WIDTH, y1=BOTTOM - CURVE / 2, y2=BOTTOM - CURVE / 2),
        tag("path", class_="curve", d=" ".join(_curve(parts))),
        tag("line", class_="cursor", y1=0, y2=HEIGHT),
        viewBox=f"0 0 {WIDTH} {HEIGHT}", preserveAspectRatio="none", role="img", aria_label=label,
    )  # fmt: skip
    return tag(
        "figure", picture, axis(report), tag("p", class_="readout"), class_="timeline",
        data_done="".join("-scl"[k + 1] for k in parts.done.tolist()),
        data_confidence=" ".join(f"{100 * c:.0f}" for c in parts.confidence.tolist()),
    )  # fmt: skip


def axis(report: FileReport) -> Html:
    """Times at quarters of the frames."""
    last = report.frames - 1
    marks = [clock(float(report.seconds[last * k // 4])) for k in range(5)]
    return tag("div", *(tag("span", mark) for mark in marks), class_="axis", aria_hidden="true")


def patterns() -> Html:
    """What the fills of the classes swapped, covered and left refer to; once on a page."""
    marks = {
        "swapped": None,
        "covered": tag("path", class_="mark-covered", d="M-2 2 2 -2M0 10 10 0M8 12 12 8"),
        "left": tag("circle", class_="mark-left", cx=5, cy=5, r=2),
    }
    made = (
        tag(
            "pattern", tag("rect", class_=f"base-{done}", width=10, height=10), mark,
            id=done, width=10, height=10, patternUnits="userSpaceOnUse",
        )
        for done, mark in marks.items()
    )  # fmt: skip
    return tag("svg", tag("defs", *made), class_="defs", aria_hidden="true")


def key(done: str) -> Html:
    """A swatch for a legend."""
    swatch = tag("rect", class_=done, width=32, height=20)
    return tag("svg", swatch, class_="key", viewBox="0 0 32 20", aria_hidden="true")


def bar(counts: list[tuple[str, int]], label: str) -> Html:
    """Shares side by side; a class and a number for each."""
    total, x, pieces = max(sum(n for _, n in counts), 1), 0.0, []
    for name, n in counts:
        width = WIDTH * n / total
        pieces.append(tag("rect", class_=name, x=round(x, 2), width=round(width, 2), height=28))
        x += width
    view = f"0 0 {WIDTH} 28"
    return tag(
        "figure",
        tag("svg", *pieces, viewBox=view, preserveAspectRatio="none", role="img", aria_label=label),
        class_="bar",
    )


def _bands(parts: Columns, report: FileReport) -> Iterator[Html]:
    """A rectangle for each run of parts in which the same was done."""
    for a, b in _runs(parts.done):
        done = DONE[int(parts.done[a])]
        first, last = int(parts.edges[a]), int(parts.edges[b]) - 1
        said = f"{WORDS[done]}, {clock(float(report.seconds[first]))} to {clock(float(report.seconds[last]))}"
        x0, x1 = _x(parts, a), _x(parts, b)
        title = tag("title", f"{said}, frames {first} to {last}")
        yield tag("rect", title, class_=done, x=x0, width=round(x1 - x0, 2), height=BAND)


def _curve(parts: Columns) -> Iterator[str]:
    """The path's steps over the parts in which there is a face."""
    heights = BOTTOM - np.round(CURVE * parts.confidence).astype(int)
    for a, b in _runs(np.where(parts.done < 0, -1, 0)):
        yield f"M{_x(parts, a)} {BOTTOM}"
        for start, stop in _runs(heights[a:b]):
            yield f"V{heights[a + start]}H{_x(parts, a + stop)}"
        yield f"V{BOTTOM}Z"


def _runs(values: NDArray[np.integer]) -> Iterator[tuple[int, int]]:
    """First and behind the last of each run of equal values that are not negative."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    for a, b in pairwise(edges):
        if values[a] >= 0:
            yield a, b


def _x(parts: Columns, place: int) -> float:
    return round(WIDTH * place / len(parts.done), 2)
