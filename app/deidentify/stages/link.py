"""The second stage: tracklets of all segments joined to tracks of the whole video.

A track goes on through a joint of two segments and over a gap in which its face was not seen (a hand, a turn of the
head), but not over a cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.app.deidentify.stages.detect import Found, is_cut
from guise.common.arrays import F32

GAP = 1.5  # seconds for which a face may be away and still be the same track
REACH = 0.6  # sizes of the box that its centre may have moved by then, and
DRIFT = 0.08  # for each frame of the gap beyond the first
MOST_DRIFT = 2.0  # sizes
GROWTH = 1.7  # ratio of sizes


@dataclass(frozen=True, eq=False)
class Piece:
    """A tracklet: segment, number in it, first and last frame, and the boxes (4,) there."""

    segment: int
    number: int
    first: int
    last: int
    start: F32
    end: F32


def link(found: Sequence[Found], starts: Sequence[int], rate: float) -> tuple[list[list[Piece]], list[int]]:
    """Join tracklets.

    Parameters
    ----------
    found : what each segment holds.   starts : first frame of each segment.   rate : frames a second.

    Returns
    -------
    chains, cuts
        The pieces of each track in the order of time, tracks in the order of appearance (larger faces first); and the
        frames with which new shots begin.
    """
    cuts = all_cuts(found, starts)
    pieces = [p for segment, one in enumerate(found) for p in _pieces(segment, one)]
    pieces.sort(key=lambda p: (p.first, -_size(p.start), p.segment, p.number))
    chains: list[list[Piece]] = []
    for piece in pieces:
        costs = [_cost(chain[-1], piece, cuts, GAP * rate) for chain in chains]
        best = int(np.argmin(costs)) if costs else -1
        if best >= 0 and np.isfinite(costs[best]):
            chains[best].append(piece)
        else:
            chains.append([piece])
    return chains, cuts


def all_cuts(found: Sequence[Found], starts: Sequence[int]) -> list[int]:
    """The first frames of new shots, also those with which a segment begins."""
    cuts = {int(c) for one in found for c in one.cuts}
    for n in range(1, len(found)):
        if is_cut(found[n - 1].ends[1], found[n].ends[0]):
            cuts.add(int(starts[n]))
    return sorted(cuts)


def _pieces(segment: int, found: Found) -> list[Piece]:
    pieces = []
    for number in np.unique(found.tracklet):
        rows = np.flatnonzero(found.tracklet == number)
        frames, boxes = found.frame[rows], found.box[rows]
        pieces.append(Piece(segment, int(number), int(frames[0]), int(frames[-1]), boxes[0], boxes[-1]))
    return pieces


def _cost(before: Piece, after: Piece, cuts: Sequence[int], most: float) -> float:
    """Distance in sizes of the face, or infinity when the two cannot be one face."""
    gap = after.first - before.last
    if not 0 < gap <= most or any(before.last < cut <= after.first for cut in cuts):
        return np.inf
    size, other = _size(before.end), _size(after.start)
    if not 1 / GROWTH < other / size < GROWTH:
        return np.inf
    centres = (after.start[:2] + after.start[2:] - before.end[:2] - before.end[2:]) / 2
    distance = float(np.hypot(*centres)) / size
    return distance if distance < min(REACH + DRIFT * (gap - 1), MOST_DRIFT) else np.inf


def _size(box: F32) -> float:
    return float(max(np.sqrt(max((box[2] - box[0]) * (box[3] - box[1]), 0.0)), 1.0))
