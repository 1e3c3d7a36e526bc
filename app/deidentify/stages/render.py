"""The last stage of a segment: faces are swapped and covered, the frames encoded, and the result audited.

What the detector still finds in the encoded pictures is covered too, unless it is a face that was swapped in or one
that the user wants to leave, and the segment is rendered again.  Pixels as shown; boxes ``x0 y0 x1 y1``.
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
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import SCHEDULE_FRAMES
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.label import Label
from guise.app.deidentify.stages.smooth import FILTER_CONTEXT_FRAMES, smooth
from guise.app.deidentify.tracks import Track
from guise.app.media import Frame
from guise.app.people.faces import detect_boxes
from guise.app.swapping.cover import cover
from guise.app.swapping.decide import COVERED, LEFT, SWAPPED
from guise.app.swapping.donors import open_donor
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class RenderLimits:
    """How far a swap reaches beyond the face's outline, and what the audit takes for a face."""

    jaw_face_widths: float = 0.035
    forehead_face_widths: float = 0.16
    min_audit_score: float = 0.5  # of the detector, and
    min_audit_likeness: float = 0.0  # of the landmarker
    audit_margin_frames: int = 3  # covered before and after a detection of the audit
    max_repeats: int = 2  # of a segment in which the audit found faces


LIMITS = RenderLimits()
# Of the rolls that are searched in turn: other frames than in the first stage are searched turned, so that the two
# together search every roll in any five frames in a row.
AUDIT_PHASE = SCHEDULE_FRAMES // 2


@dataclass(frozen=True, eq=False)
class FaceTreatment:
    """What is done with a face in a frame: track (0 for a bystander), code, box (4,), growth of a cover, turn."""

    track: int
    done: int
    box: F32
    growth: float
    turn: float = 0.0

    @property
    def region(self) -> F64:
        """The rectangle (4,) that is covered, if the face is."""
        return region(self.box, self.growth, self.turn)


@dataclass(frozen=True, eq=False)
class AuditDetection:
    """A face that the audit found."""

    frame: int
    box: F32
    score: float
    turn: float = 0.0


class SegmentRenderer:
    """Draws what was decided into the frames of a segment.

    Parameters
    ----------
    case : Case.
    segment : its number.
    entries : by frame; may be replaced between two passes.
    """

    def __init__(self, case: Case, segment: int, entries: dict[int, list[FaceTreatment]]) -> None:
        self._case, self.entries = case, entries
        self._tracks = {track.number: track for track in case.tracks}
        self._shapes = _shapes(case, segment)
        self._engines: dict[int, Engine] = {}
        self._label: Label | None = None
        self.swapped_boxes: dict[int, list[F64]] = defaultdict(list)  # by frame
        self.renderer = ""

    def draw(self, frame: Frame) -> None:
        """Change a frame in place: swaps first, so that covers lie over them."""
        entries = self.entries.get(frame.index, [])
        self.swapped_boxes[frame.index].clear()
        for entry in entries:
            if entry.done == SWAPPED:
                self._swap(frame, entry)
        for entry in entries:
            if entry.done == COVERED:
                cover(frame, entry.region, self._case.options.cover)
        if self._case.options.label:
            self._label = self._label or Label(frame.width, frame.height)
            self._label.draw(frame)

    def _swap(self, frame: Frame, entry: FaceTreatment) -> None:
        shape = self._shapes.get((entry.track, frame.index))
        if shape is None:
            cover(frame, entry.region, self._case.options.cover)
            return
        mesh = self._engine(self._tracks[entry.track]).draw(frame, shape)
        self.swapped_boxes[frame.index].append(np.concatenate([mesh.min(0), mesh.max(0)]))

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
                    alpha=options.alpha,
                    renderer=options.renderer,
                    jaw=LIMITS.jaw_face_widths,
                    forehead=LIMITS.forehead_face_widths,
                    occluders="objects",
                    disguise=True,
                    # The privacy figures are measured with these; others need a new measurement.
                    light="paper",
                    transfer="paper",
                ),
            )
            self._engines[track.number] = engine
            self.renderer = engine.painter.renderer
        return self._engines[track.number]

    def close(self) -> None:
        """Release the engines."""
        for engine in self._engines.values():
            engine.close()

    def __enter__(self) -> SegmentRenderer:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def _shapes(case: Case, segment: int) -> dict[tuple[int, int], F64]:
    """The filtered shape of each track in each frame of a segment."""
    first, last = case.span(segment)
    near = [k for k in (segment - 1, segment, segment + 1) if 0 <= k < len(case.scan.segments)]
    fits = [case.fits(k) for k in near]
    shapes = {}
    for track in {int(n) for one in fits for n in np.unique(one.track)}:
        rows = [np.flatnonzero(one.track == track) for one in fits]
        frames = np.concatenate([one.frame[r] for one, r in zip(fits, rows, strict=True)])
        seen = np.concatenate([one.shape[r] for one, r in zip(fits, rows, strict=True)])
        inside = (frames >= first - FILTER_CONTEXT_FRAMES) & (frames < last + FILTER_CONTEXT_FRAMES)
        for frame, shape in zip(frames[inside], smooth(frames[inside], seen[inside], case.cuts), strict=True):
            shapes[track, int(frame)] = shape
    return shapes


def entries_of(plan: dict[str, NDArray[Any]], first: int, last: int) -> dict[int, list[FaceTreatment]]:
    """What is to be done in the frames [first, last)."""
    low, high = np.searchsorted(plan["frame"], [first, last])
    entries: dict[int, list[FaceTreatment]] = defaultdict(list)
    for i in range(low, high):
        entries[int(plan["frame"][i])].append(
            FaceTreatment(
                int(plan["track"][i]),
                int(plan["done"][i]),
                plan["box"][i],
                float(plan["growth"][i]),
                float(plan["turn"][i]),
            )
        )
    return entries


def audit(frames: Iterable[Frame], segment_renderer: SegmentRenderer) -> Iterator[AuditDetection]:
    """The faces in the output that were neither swapped in nor left on purpose and that no cover hides."""
    landmarker = BuiltinLandmarker()
    for seen in detect_boxes(frames, FaceDetector(min_score=LIMITS.min_audit_score), phase=AUDIT_PHASE):
        entries = segment_renderer.entries.get(seen.index, [])
        known: list[NDArray[np.floating]] = [*segment_renderer.swapped_boxes.get(seen.index, [])]
        known += [e.box for e in entries if e.done == LEFT]
        known += [e.region for e in entries if e.done == COVERED]
        for box, score, turn in zip(seen.found.boxes, seen.found.scores, seen.found.turns, strict=True):
            unknown = not any(_inside(box, place) for place in known)
            if unknown and landmarker.likeness(seen.rgb, box, turn) >= LIMITS.min_audit_likeness:
                yield AuditDetection(seen.index, box, float(score), float(turn))


def _inside(box: F32, place: NDArray[np.floating]) -> bool:
    """Whether a box is at a place: its centre lies in the place, or the centre of the place in the box."""
    centre, middle = (box[:2] + box[2:]) / 2, (place[:2] + place[2:]) / 2
    return bool(
        ((centre > place[:2]) & (centre < place[2:])).all() or ((middle > box[:2]) & (middle < box[2:])).all()
    )


def with_detections(
    entries: dict[int, list[FaceTreatment]], detections: Iterable[AuditDetection], first: int, last: int
) -> dict[int, list[FaceTreatment]]:
    """The entries, with the faces that the audit found covered in the frames about each."""
    more = defaultdict(list, {frame: list(these) for frame, these in entries.items()})
    for one in detections:
        for frame in range(
            max(first, one.frame - LIMITS.audit_margin_frames),
            min(last, one.frame + LIMITS.audit_margin_frames + 1),
        ):
            more[frame].append(FaceTreatment(0, COVERED, one.box, 1.0, one.turn))
    return more
