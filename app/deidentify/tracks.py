"""Tracks of faces through a video, what is proposed for them and done with them, and the report's figures.

A track is one face seen without a long break; a person has one or more tracks (they leave and return).  Boxes are
``x0 y0 x1 y1`` pixels as shown; frames are counted from 0 in the order of the input's pictures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.app.deidentify.covers import CoverSpan, counts_of
from guise.app.swapping.policy import DONE, Action

BYSTANDERS = 0  # number of the track that stands for all faces that are covered without being tracked


@dataclass(frozen=True)
class Track:
    """A face tracked through a video.

    Parameters
    ----------
    number : from 1, in the order of appearance.   person : from 1; tracks of one person share it.
    first, last : frames, inclusive, in which it was seen for the first and the last time.
    seen : number of frames in which it was seen.   width : median width of the face, pixels.
    confidence : mean confidence in [0, 1] over at most 100 equal parts of first..last; 0 where it was not seen.
    proposed, reason : what Guise proposes, and why not to swap ("" for a swap).
    action : what to do, which the user may change.
    donor : whose face is shown, see `guise.app.swapping.donors.open_donor`; "" unless swapped.
    name : the user's name for the person, or "".
    can_swap : whether there is a model of the face, without which it can only be covered or left.
    part_of : number of the track that the user has split, of which this is a part; 0 for a whole track.
    """

    number: int
    person: int
    first: int
    last: int
    seen: int
    width: float
    confidence: tuple[float, ...]
    proposed: Action
    reason: str = ""
    action: Action = "cover"
    donor: str = ""
    name: str = ""
    can_swap: bool = False
    part_of: int = 0

    @property
    def origin(self) -> int:
        """The number under which the track was found."""
        return self.part_of or self.number


def split_tracks(tracks: Sequence[Track], splits: Mapping[int, Sequence[int]]) -> list[Track]:
    """The tracks, some of them split.

    splits : by number of a track, the frames with which its next parts begin, ascending, inside of it.
    The first part keeps the number, the others get new ones and are people of their own; what is seen of a part is
    taken from its share of the whole.
    """
    new = max((track.number for track in tracks), default=0)
    found: list[Track] = []
    for track in tracks:
        edges = [track.first, *splits.get(track.number, ()), track.last + 1]
        for place, (first, end) in enumerate(pairwise(edges)):
            if len(edges) == 2:
                found.append(track)
                continue
            new += place > 0
            part = _part(track, first, end - 1)
            found.append(replace(part, number=new, person=new) if place else part)
    return found


def _part(track: Track, first: int, last: int) -> Track:
    length = track.last - track.first + 1
    curve = np.array(track.confidence)
    at = (np.arange(len(curve)) + 0.5) / len(curve) * length + track.first
    inside = curve[(at >= first) & (at <= last)]
    if not len(inside):
        inside = curve[[int(np.abs(at - (first + last) / 2).argmin())]]
    seen = max(1, round(track.seen * (last - first + 1) / length))
    return replace(
        track, first=first, last=last, seen=seen, confidence=tuple(inside.tolist()), part_of=track.number
    )


@dataclass(frozen=True)
class MarkedPlace:
    """What the user says of a place in some frames.

    Parameters
    ----------
    first, last : frames, inclusive.   at : one of them, in which the face's box is `box`; it is followed from there.
    action : "cover" or "swap" a face that was missed there, or "leave" what is taken for one and is none.
    cover : number of the cover that it is about; 0 of a box that the user has drawn.
    """

    first: int
    last: int
    at: int
    box: tuple[float, float, float, float]
    action: Action
    cover: int = 0


@dataclass(frozen=True, eq=False)
class TrackOutcome:
    """What was done with a track, a row for each frame in which a region was changed or left.

    Parameters
    ----------
    track : number, or BYSTANDERS.
    frames : (n,) int32, ascending (repeated only for BYSTANDERS, several in a frame).
    done : (n,) uint8, index into DONE.
    confidence : (n,) float32 in [0, 1], of the fit or of the detector; 0 where the face was not seen itself.
    reasons : (n,) uint8, index into `guise.app.deidentify.covers.REASONS`, why it is covered.
    boxes : (n, 4) int32 of the swapped face, or of the region that is covered.
    """

    track: int
    frames: NDArray[np.int32]
    done: NDArray[np.uint8]
    confidence: NDArray[np.float32]
    reasons: NDArray[np.uint8]
    boxes: NDArray[np.int32]

    @property
    def counts(self) -> dict[str, int]:
        """In how many frames each of DONE was done."""
        return {name: len(np.unique(self.frames[self.done == code])) for code, name in enumerate(DONE)}


@dataclass(frozen=True)
class AuditFinding:
    """A face that the audit found in the output: where, its score, and whether it was covered afterwards."""

    frame: int
    box: tuple[int, int, int, int]
    score: float
    covered: bool


@dataclass(frozen=True, eq=False)
class FileReport:
    """All that is known about a de-identified file.

    Parameters
    ----------
    input, output : names, without their folders.   frames : number written.
    seconds : (frames,) float64, time of each frame.
    width, height : pixels as shown.
    tracks, outcomes : the tracks, and what was done with each and with bystanders.
    audit : what the audit of the output found.
    covers : as a viewer sees them, by number.
    settings : what was asked for, as JSON holds it.
    problems : sentences about what was tolerated in the input, or could not be kept.
    damaged : whether parts of the input could not be read, so that faces in them may be in the output unseen.
    wall_seconds : time of the work.
    searched : number of frames that the audit searched for faces in another way than the first stage.
    unclear : frames in which nobody can tell whether there is a face.
    digest : SHA-256 of the output file in hexadecimal digits, so that a signed report is of this file; "" for a folder.
    """

    input: str
    output: str
    frames: int
    seconds: NDArray[np.float64]
    width: int
    height: int
    tracks: tuple[Track, ...]
    outcomes: tuple[TrackOutcome, ...]
    audit: tuple[AuditFinding, ...]
    covers: tuple[CoverSpan, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    wall_seconds: float = 0.0
    digest: str = ""
    searched: int = 0
    damaged: bool = False
    unclear: tuple[int, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """Frames by the least hidden face in each: "swapped" (all faces), "covered", "left", or "without face"."""
        return counts_of(self.frames, ((one.frames, one.done) for one in self.outcomes))
