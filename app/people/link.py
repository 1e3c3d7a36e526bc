"""The tracklets of all segments linked to tracks of the whole video.

A track continues from one segment to the next and over a gap in which its face was not seen (a hand, a turn of the
head), but not over a cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from guise.app.people.cuts import is_cut
from guise.app.people.faces import SegmentFaces
from guise.common.arrays import F32


@dataclass(frozen=True)
class LinkLimits:
    """What may lie between two tracklets of one track.

    Distances are of the boxes' centres, in sizes of the earlier box.
    """

    max_gap_seconds: float = 1.5
    max_shift_sizes: float = 0.6  # from one frame to the next, and
    shift_sizes_per_frame: float = 0.08  # more for each further frame of the gap,
    max_gap_shift_sizes: float = 2.0  # up to this
    max_size_ratio: float = 1.7


LIMITS = LinkLimits()


@dataclass(frozen=True, eq=False)
class Tracklet:
    """A tracklet: segment, number in it, first and last frame, and the boxes (4,) there."""

    segment: int
    number: int
    first: int
    last: int
    start: F32
    end: F32


def link(
    found: Sequence[SegmentFaces], starts: Sequence[int], rate: float
) -> tuple[list[list[Tracklet]], list[int]]:
    """Join tracklets.

    Parameters
    ----------
    found : the faces of each segment.   starts : first frame of each segment.   rate : frames a second.

    Returns
    -------
    chains, cuts
        The tracklets of each track in the order of time, tracks in the order of appearance (larger faces first); and
        the frames with which new shots begin.
    """
    cuts = all_cuts(found, starts)
    tracklets = [t for segment, one in enumerate(found) for t in _tracklets(segment, one)]
    tracklets.sort(key=lambda t: (t.first, -_size(t.start), t.segment, t.number))
    chains: list[list[Tracklet]] = []
    for tracklet in tracklets:
        costs = [_cost(chain[-1], tracklet, cuts, LIMITS.max_gap_seconds * rate) for chain in chains]
        best = int(np.argmin(costs)) if costs else -1
        if best >= 0 and np.isfinite(costs[best]):
            chains[best].append(tracklet)
        else:
            chains.append([tracklet])
    return chains, cuts


def all_cuts(found: Sequence[SegmentFaces], starts: Sequence[int]) -> list[int]:
    """The first frames of new shots, also those with which a segment begins."""
    cuts = {int(c) for one in found for c in one.cuts}
    for n in range(1, len(found)):
        if is_cut(found[n - 1].ends[1], found[n].ends[0]):
            cuts.add(int(starts[n]))
    return sorted(cuts)


def _tracklets(segment: int, found: SegmentFaces) -> list[Tracklet]:
    tracklets = []
    for number in np.unique(found.tracklet):
        rows = np.flatnonzero(found.tracklet == number)
        frames, boxes = found.frame[rows], found.box[rows]
        tracklets.append(Tracklet(segment, int(number), int(frames[0]), int(frames[-1]), boxes[0], boxes[-1]))
    return tracklets


def _cost(before: Tracklet, after: Tracklet, cuts: Sequence[int], max_gap: float) -> float:
    """Distance in sizes of the face, or infinity when the two cannot be one face.   max_gap : frames."""
    gap = after.first - before.last
    if not 0 < gap <= max_gap or any(before.last < cut <= after.first for cut in cuts):
        return np.inf
    size, other = _size(before.end), _size(after.start)
    if not 1 / LIMITS.max_size_ratio < other / size < LIMITS.max_size_ratio:
        return np.inf
    centres = (after.start[:2] + after.start[2:] - before.end[:2] - before.end[2:]) / 2
    distance = float(np.hypot(*centres)) / size
    shift = LIMITS.max_shift_sizes + LIMITS.shift_sizes_per_frame * (gap - 1)
    return distance if distance < min(shift, LIMITS.max_gap_shift_sizes) else np.inf


def _size(box: F32) -> float:
    return float(max(np.sqrt(max((box[2] - box[0]) * (box[3] - box[1]), 0.0)), 1.0))
