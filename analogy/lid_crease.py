"""The crease of an upper lid: the line above its margin along which the skin bends inwards most.

In a blink the lid unfolds from below this line, so a match that misses it leaves a ridge.  Lengths are in widths of the
eye.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from guise.common.arrays import F64, Int


@dataclass(frozen=True)
class CreaseSettings:
    """Settings of the search for creases; widths are the eye's, from corner to corner."""

    height_widths: tuple[float, float] = (0.05, 0.32)  # above the margin
    step_widths: float = 0.07  # to the skin above and below, behind whose middle a crease lies
    max_depth_widths: float = 0.06  # beyond which a crease is no clearer
    min_depth_widths: float = 0.008  # mean, below which a lid has no crease
    slope_cost: float = 1.0  # of a squared step along the crease, against depth


CREASE = CreaseSettings()


def find_crease(depth: F64, margin: tuple[Int, Int], px: float) -> tuple[Int, Int] | None:
    """Rows and columns (k,) of the pixels of the crease above a margin; None if the lid has none.

    Parameters
    ----------
    depth : (h, w) of the skin towards the viewer.   margin : rows and columns (k,).   px : pixels in a width.
    """
    rows, columns = margin[0][:, None], margin[1][:, None]
    solid = np.maximum(depth, depth[np.isfinite(depth)].min())
    heights = np.arange(*(round(end * px) for end in CREASE.height_widths))
    step = np.minimum(round(CREASE.step_widths * px), heights)
    at, above, below = ((rows - heights + move).clip(0, len(depth) - 1) for move in (0, -step, step))
    bend = (solid[above, columns] + solid[below, columns]) / 2 - solid[at, columns]
    bend = bend.clip(0, CREASE.max_depth_widths)
    path = _best_path(bend, CREASE.slope_cost * np.square(np.subtract.outer(heights, heights) / px))
    every = np.arange(len(path))
    return (at[every, path], margin[1]) if bend[every, path].mean() >= CREASE.min_depth_widths else None


def _best_path(gains: F64, costs: F64) -> Int:
    """(k,) the states of the largest gains (k, n) less the costs (n, n) of steps between them; Viterbi's algorithm."""
    best, back = gains[0], []
    for gain in gains[1:]:
        reached = best - costs
        back.append(reached.argmax(1))
        best = reached.max(1) + gain
    path = [int(best.argmax())]
    for before in back[::-1]:
        path.append(int(before[path[-1]]))
    return np.array(path[::-1])
