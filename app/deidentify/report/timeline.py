"""A track over the video as a picture (SVG): what was done above, confidence below, and figures for the pointer.

The video is divided into at most MAX_COLUMNS equal parts; a part shows the least hidden face in it.  templates/ holds
the markup, templates/timeline.js what the pointer does.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.report.html import render_fragment
from guise.app.deidentify.report.report import clock
from guise.app.deidentify.tracks import FileReport, TrackOutcome
from guise.app.swapping.policy import DONE

MAX_COLUMNS = 500
LABELS = {"swapped": "swapped", "covered": "covered", "left": "left as it is"}


@dataclass(frozen=True)
class TimelineScale:
    """Sizes in units of the picture; y points down."""

    width: int = 1000
    height: int = 80
    band_height: int = 30  # of what was done
    baseline: int = 78  # y of confidence 0
    curve_height: int = 42  # of confidence 1

    @property
    def half(self) -> float:
        """Y of confidence 0.5."""
        return self.baseline - self.curve_height / 2


SCALE = TimelineScale()


@dataclass(frozen=True, eq=False)
class Columns:
    """Parts of the video: (n,) done, index into DONE or -1 for nothing; (n,) mean confidence; (n + 1,) first frames."""

    done: NDArray[np.int8]
    confidence: NDArray[np.float64]
    edges: NDArray[np.int64]


@dataclass(frozen=True)
class Band:
    """Consecutive parts in which the same was done: a rectangle, and its tooltip."""

    done: str
    x: float
    width: float
    title: str


@dataclass(frozen=True)
class Timeline:
    """What the template draws.

    label : what the picture shows, for a screen reader.   bands, curve : of the picture; the curve is an SVG path.
    done : a letter for each part.   confidence : percent of each part.   marks : times at quarters of the frames.
    """

    LETTERS: ClassVar = "-scl"  # nothing, then as DONE

    label: str
    bands: tuple[Band, ...]
    curve: str
    done: str
    confidence: str
    marks: tuple[str, ...]

    @classmethod
    def of(cls, one: TrackOutcome, report: FileReport, label: str) -> Timeline:
        """The timeline of a track."""
        parts = columns(one, report.frames)
        last = report.frames - 1
        return cls(
            label,
            tuple(_bands(parts, report)),
            " ".join(_curve(parts)),
            "".join(cls.LETTERS[k + 1] for k in parts.done.tolist()),
            " ".join(f"{100 * c:.0f}" for c in parts.confidence.tolist()),
            tuple(clock(float(report.seconds[last * k // 4])) for k in range(5)),
        )


def columns(one: TrackOutcome, frames: int) -> Columns:
    """What was done in each part of a video of so many frames."""
    count = min(MAX_COLUMNS, frames)
    place = one.frames.astype(np.int64) * count // frames
    done = np.full(count, -1, np.int8)
    np.maximum.at(done, place, one.done.astype(np.int8))
    rows = np.bincount(place, minlength=count)
    sums = np.bincount(place, one.confidence.astype(np.float64), minlength=count)
    edges = -(-np.arange(count + 1) * frames // count)
    return Columns(done, sums / np.maximum(rows, 1), edges)


def column_times(report: FileReport) -> str:
    """The times at which the parts begin, for the script."""
    count = min(MAX_COLUMNS, report.frames)
    return " ".join(clock(float(report.seconds[-(-k * report.frames // count)])) for k in range(count))


def confidence_svg(
    confidence: list[float], span: tuple[float, float], colour: str, title: str
) -> str:  # fmt: skip
    """A small picture of a track's confidence for a page of the studio.

    confidence : in equal parts of the track.   span : where the track begins and ends, as shares of the video.
    """
    x, width = 1000 * span[0], 1000 * (span[1] - span[0])
    tops = "".join(f"V{38 - 34 * c:.1f}h{width / len(confidence):.2f}" for c in confidence)
    return render_fragment(
        "track.svg", title=title, colour=colour, curve=f"M{x:.1f} 38{tops}V38Z", x=f"{x:.1f}", width=f"{width:.1f}"
    )  # fmt: skip


def _bands(parts: Columns, report: FileReport) -> Iterator[Band]:
    """A rectangle for each run of parts in which the same was done."""
    for a, b in _runs(parts.done):
        done = DONE[int(parts.done[a])]
        first, last = int(parts.edges[a]), int(parts.edges[b]) - 1
        times = f"{clock(float(report.seconds[first]))} to {clock(float(report.seconds[last]))}"
        x0, x1 = _x(parts, a), _x(parts, b)
        yield Band(done, x0, round(x1 - x0, 2), f"{LABELS[done]}, {times}, frames {first} to {last}")


def _curve(parts: Columns) -> Iterator[str]:
    """The path's segments over the parts in which there is a face."""
    heights = SCALE.baseline - np.round(SCALE.curve_height * parts.confidence).astype(int)
    for a, b in _runs(np.where(parts.done < 0, -1, 0)):
        yield f"M{_x(parts, a)} {SCALE.baseline}"
        for start, stop in _runs(heights[a:b]):
            yield f"V{heights[a + start]}H{_x(parts, a + stop)}"
        yield f"V{SCALE.baseline}Z"


def _runs(values: NDArray[np.integer]) -> Iterator[tuple[int, int]]:
    """First and behind the last of each run of equal values that are not negative."""
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    for a, b in pairwise(edges):
        if values[a] >= 0:
            yield a, b


def _x(parts: Columns, place: int) -> float:
    return round(SCALE.width * place / len(parts.done), 2)
