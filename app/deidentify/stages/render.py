"""The last stage of a segment: faces swapped and covered, encoded, and the result looked at again.

What the detector still finds in the encoded pictures, and what is neither a face that was put there nor one that the
user wants to leave, is covered too, and the segment is made anew.  Pixels as shown; boxes ``x0 y0 x1 y1``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.decide import COVERED, LEFT, SWAPPED
from guise.app.deidentify.stages.detect import look
from guise.app.deidentify.stages.label import Label
from guise.app.deidentify.stages.smooth import CONTEXT, smooth
from guise.app.deidentify.tracks import Track
from guise.app.media import Frame
from guise.app.swapping.cover import cover, region
from guise.app.swapping.donors import open_donor
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import Options as EngineOptions
from guise.common.arrays import F32, F64

JAW, FOREHEAD = 0.035, 0.16  # face widths by which a swap reaches beyond the face's outline
AUDIT_SCORE = 0.5  # of the detector, from which the audit takes a box for a face if
AUDIT_LIKE = 0.0  # it also looks like one to the landmarker
AGAIN = 2  # times that a segment is made anew at most
AUDIT_REACH = 3  # frames about a find that are covered with it


@dataclass(frozen=True, eq=False)
class Entry:
    """What happens to a face in a frame: track (0 for a bystander), code, box (4,) of the face, growth of a cover."""

    track: int
    done: int
    box: F32
    growth: float


@dataclass(frozen=True, eq=False)
class Find:
    """What the audit found."""

    frame: int
    box: F32
    score: float


class Artist:
    """Draws what was decided into the frames of a segment.

    Parameters
    ----------
    case : Case.
    segment : its number.
    entries : by frame; may be exchanged between two passes.
    """

    def __init__(self, case: Case, segment: int, entries: dict[int, list[Entry]]) -> None:
        self._case, self.entries = case, entries
        self._tracks = {track.number: track for track in case.tracks}
        self._shapes = _shapes(case, segment)
        self._engines: dict[int, Engine] = {}
        self._label: Label | None = None
        self.drawn: dict[int, list[F64]] = defaultdict(
            list
        )  # boxes of the faces that were put into each frame
        self.renderer = ""

    def draw(self, frame: Frame) -> None:
        """Change a frame in place: swaps first, so that a cover always wins."""
        entries = self.entries.get(frame.index, [])
        self.drawn[frame.index].clear()
        for entry in entries:
            if entry.done == SWAPPED:
                self._swap(frame, entry)
        for entry in entries:
            if entry.done == COVERED:
                cover(frame, region(entry.box, entry.growth), self._case.options.cover)
        if self._case.options.label:
            self._label = self._label or Label(frame.width, frame.height)
            self._label.draw(frame)

    def _swap(self, frame: Frame, entry: Entry) -> None:
        shape = self._shapes.get((entry.track, frame.index))
        if shape is None:
            cover(frame, region(entry.box, entry.growth), self._case.options.cover)
            return
        mesh = self._engine(self._tracks[entry.track]).draw(frame, shape)
        self.drawn[frame.index].append(np.concatenate([mesh.min(0), mesh.max(0)]))

    def _engine(self, track: Track) -> Engine:
        if track.number not in self._engines:
            person = self._case.model_of(track.number)
            assert person is not None
            options = self._case.options
            engine = Engine(
                person,
                open_donor(track.donor),
                None,
                EngineOptions(
                    alpha=options.alpha, renderer=options.renderer, jaw=JAW, forehead=FOREHEAD, disguise=True
                ),
            )
            self._engines[track.number] = engine
            self.renderer = engine.painter.renderer
        return self._engines[track.number]

    def close(self) -> None:
        """Release the engines."""
        for engine in self._engines.values():
            engine.close()

    def __enter__(self) -> Artist:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def _shapes(case: Case, segment: int) -> dict[tuple[int, int], F64]:
    """The steadied shape of each track in each frame of a segment."""
    first, last = case.span(segment)
    near = [k for k in (segment - 1, segment, segment + 1) if 0 <= k < len(case.scan.segments)]
    fits = [case.fits(k) for k in near]
    shapes = {}
    for track in {int(n) for one in fits for n in np.unique(one.track)}:
        rows = [np.flatnonzero(one.track == track) for one in fits]
        frames = np.concatenate([one.frame[r] for one, r in zip(fits, rows, strict=True)])
        seen = np.concatenate([one.shape[r] for one, r in zip(fits, rows, strict=True)])
        inside = (frames >= first - CONTEXT) & (frames < last + CONTEXT)
        for frame, shape in zip(frames[inside], smooth(frames[inside], seen[inside], case.cuts), strict=True):
            shapes[track, int(frame)] = shape
    return shapes


def entries_of(plan: dict[str, NDArray[Any]], first: int, last: int) -> dict[int, list[Entry]]:
    """What is to be done in the frames [first, last)."""
    low, high = np.searchsorted(plan["frame"], [first, last])
    entries: dict[int, list[Entry]] = defaultdict(list)
    for i in range(low, high):
        entries[int(plan["frame"][i])].append(
            Entry(int(plan["track"][i]), int(plan["done"][i]), plan["box"][i], float(plan["growth"][i]))
        )
    return entries


def audit(frames: Iterable[Frame], artist: Artist) -> Iterator[Find]:
    """The faces in the output that nobody put or left there and that no cover hides."""
    landmarker = BuiltinLandmarker()
    for seen in look(frames, FaceDetector(min_score=AUDIT_SCORE)):
        entries = artist.entries.get(seen.index, [])
        known: list[NDArray[np.floating]] = [*artist.drawn.get(seen.index, [])]
        known += [e.box for e in entries if e.done == LEFT]
        known += [region(e.box, e.growth) for e in entries if e.done == COVERED]
        for box, score in zip(seen.boxes, seen.scores, strict=True):
            strange = not any(_inside(box, place) for place in known)
            if strange and landmarker.likeness(seen.rgb, box) >= AUDIT_LIKE:
                yield Find(seen.index, box, float(score))


def _inside(box: F32, place: NDArray[np.floating]) -> bool:
    """Whether a box is about a place: its centre lies in it, or the place's centre in the box."""
    centre, middle = (box[:2] + box[2:]) / 2, (place[:2] + place[2:]) / 2
    return bool(
        ((centre > place[:2]) & (centre < place[2:])).all() or ((middle > box[:2]) & (middle < box[2:])).all()
    )


def with_finds(
    entries: dict[int, list[Entry]], finds: Iterable[Find], first: int, last: int
) -> dict[int, list[Entry]]:
    """The entries, with what was found covered in the frames about it."""
    more = defaultdict(list, {frame: list(these) for frame, these in entries.items()})
    for find in finds:
        for frame in range(max(first, find.frame - AUDIT_REACH), min(last, find.frame + AUDIT_REACH + 1)):
            more[frame].append(Entry(0, COVERED, find.box, 1.0))
    return more
