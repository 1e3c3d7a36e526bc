"""A picture of a measurement: similarities, expression curves, and the similarity over time (extra: plots)."""

from __future__ import annotations

import io
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from guise.app.measure.curves import CURVES
from guise.app.measure.figures import MeasureResult, OutputFigures
from guise.app.measure.privacy import BINS, Scores
from guise.app.measure.table import number
from guise.common.errors import OutputError
from guise.common.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Colours that colour-blind people can tell apart (Okabe and Ito 2008); donors are dashed.
PLOT_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY, BLACK = "#999999", "#000000"
WIDTH_INCHES, ROW_INCHES = 13.0, 1.2


def require_plots(path: Path) -> None:
    """Raise OutputError, before any work, when matplotlib is missing or the name isn't that of a PNG file."""
    if path.suffix.lower() != ".png":
        raise OutputError(f"a plot must be a .png file, got {path}: choose another name")
    if find_spec("matplotlib") is None:
        raise OutputError("a plot needs matplotlib, which is not installed: pip install 'guise-video[plots]'")


def draw(result: MeasureResult, path: Path) -> None:
    """Write the picture; it appears only when it is complete."""
    from matplotlib.figure import Figure

    private = result.recogniser is not None
    names = list(CURVES)
    heights = [*([2.4, 1.6] if private else []), *[1.0] * len(names)]
    figure = Figure(figsize=(WIDTH_INCHES, ROW_INCHES * sum(heights) + 0.6), layout="constrained")
    axes = list(figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
    figure.suptitle(result.original, fontsize=11)
    if private:
        _histograms(axes.pop(0), result)
        _timeline(axes.pop(0), result)
    for axis, name in zip(axes, names, strict=True):
        _curves(axis, result, name)
    axes[-1].set_xlabel("seconds")
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    write_whole(path, data.getvalue())


def _histograms(axis: Axes, result: MeasureResult) -> None:
    """How alike faces are: of different people, of the same person, of the outputs with their source and donor."""
    _histogram(axis, result.impostors, "other people of the gallery", GREY, filled=True)
    first = result.outputs[0].privacy
    _histogram(axis, first.unswapped if first else None, "the same person, unswapped", BLACK, filled=True)
    for one, colour in _coloured(result):
        if one.privacy is not None:
            _histogram(axis, one.privacy.to_source, f"{one.name} to source", colour)
            _histogram(axis, one.privacy.to_donor, f"{one.name} to donor", colour, linestyle="--")
    limit = result.gallery.get("threshold")
    if limit is not None:
        rate = result.gallery["false_accept_rate"]
        axis.axvline(limit, color=GREY, linestyle=":", label=f"false accepts {rate:.1%}")
    axis.set(xlim=(-0.5, 1.0), xlabel=f"similarity (cosine, {result.recogniser})", ylabel="share of faces")
    _beside(axis)


def _histogram(
    axis: Axes, scores: Scores | None, label: str, colour: str, *, filled: bool = False, **style: Any
) -> None:
    if scores is None:
        return
    shares = np.array(scores.histogram) / scores.count
    if filled:
        axis.stairs(shares, BINS, fill=True, color=colour, alpha=0.35, label=label)
    else:
        axis.stairs(shares, BINS, color=colour, label=label, linewidth=1.6, **style)


def _timeline(axis: Axes, result: MeasureResult) -> None:
    """Similarity to the source over time, of the person seen most; frames that were not swapped are marked below."""
    for place, (one, colour) in enumerate(_coloured(result)):
        curves = one.plot_curves
        axis.plot(curves.similarity_seconds, curves.similarity, color=colour, linewidth=1, label=one.name)
        if curves.states is not None:
            other = curves.similarity_seconds[curves.states != "swapped"]
            axis.plot(other, np.full(len(other), -0.25 - 0.05 * place), "|", color=colour, markersize=4)
    if result.gallery.get("threshold") is not None:
        axis.axhline(result.gallery["threshold"], color=GREY, linestyle=":")
    axis.set(ylim=(-0.5, 1.05), xlim=(0, result.seconds), ylabel="similarity\nto source")
    _beside(axis)


def _curves(axis: Axes, result: MeasureResult, name: str) -> None:
    """A curve of the person seen most, in the original and in the outputs."""
    first, own = result.outputs[0].plot_curves, result.faces.index(max(result.faces))
    axis.plot(first.seconds, first.before[name], color=BLACK, linewidth=1.4, label="original")
    for one, colour in _coloured(result):
        text = f"r = {number(one.people[own].correlation[name])}"
        axis.plot(one.plot_curves.seconds, one.plot_curves.after[name], color=colour, linewidth=1, label=text)
    axis.set(xlim=(0, result.seconds), ylabel=name.replace(" ", "\n"))
    _beside(axis)


def _beside(axis: Axes) -> None:
    """The legend, to the right of the axis."""
    axis.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.05), borderaxespad=0.5)


def _coloured(result: MeasureResult) -> list[tuple[OutputFigures, str]]:
    return [(one, PLOT_COLOURS[i % len(PLOT_COLOURS)]) for i, one in enumerate(result.outputs)]
