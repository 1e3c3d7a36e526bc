"""The last stage of a segment: faces are swapped and covered, the frames encoded, and the result audited.

What the audit finds is covered too, and the segment is rendered again.  Pixels as shown; boxes ``x0 y0 x1 y1``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import iou
from guise.aam.parsing import HeadParser
from guise.app.deidentify.stages.audit import AuditDetection, DrawnFace, FaceTreatment
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.gaps import Gaps
from guise.app.deidentify.stages.head import Behind, HeadPainter, Plate
from guise.app.deidentify.stages.head_matte import Gap, find_head
from guise.app.deidentify.stages.label import Label
from guise.app.deidentify.stages.plate import plate_of
from guise.app.deidentify.stages.smooth import FILTER_CONTEXT_FRAMES, smooth
from guise.app.deidentify.tracks import Track
from guise.app.media import Frame
from guise.app.swapping.cover import cover
from guise.app.swapping.decide import COVERED, SWAPPED
from guise.app.swapping.donors import open_donor
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F64


@dataclass(frozen=True)
class RenderLimits:
    """How far a swap reaches beyond the face's outline, and what follows what the audit finds."""

    jaw_face_widths: float = 0.05  # hides the own outline even where a rolled head is found less exactly
    forehead_face_widths: float = 0.28  # with the region "face": a head brings its own hairline
    audit_grid_step: int = 4  # pixels of the reference grid, of what the audit is told of objects in front
    audit_margin_frames: int = 3  # covered before and after a detection of the audit
    same_place_iou: float = 0.5  # of two detections
    max_repeats: int = 3  # of a segment in which the audit found faces


LIMITS = RenderLimits()


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
        self._segment = segment
        self._engines: dict[int, Engine] = {}
        self._heads: dict[int, HeadPainter] = {}
        self._plates: dict[int, Plate | None] = {}  # by shot
        self._gaps = _gaps(case, segment)
        self._label: Label | None = None
        self._last = {
            e.track: frame for frame in sorted(entries) for e in entries[frame] if e.done == SWAPPED
        }
        self.drawn: dict[int, list[DrawnFace]] = defaultdict(list)  # by frame
        self.renderer = ""

    def draw(self, frame: Frame) -> None:
        """Change a frame in place: swaps first, so that covers lie over them."""
        entries = self.entries.get(frame.index, [])
        self.drawn[frame.index].clear()
        swapped = [entry for entry in entries if entry.done == SWAPPED]
        heads = self._heads_in(frame, swapped) if self._case.options.region == "head" else {}
        for entry in swapped:
            self._swap(frame, entry, heads)
            if frame.index == self._last[entry.track]:
                self._release(entry.track)
        for entry in entries:
            if entry.done == COVERED:
                cover(frame, entry.region, self._case.options.cover)
        if self._case.options.label:
            self._label = self._label or Label(frame.width, frame.height)
            self._label.draw(frame)

    def _swap(self, frame: Frame, entry: FaceTreatment, heads: dict[int, tuple[Gap, Behind]]) -> None:
        shape, track = self._shape(frame, entry), self._tracks[entry.track]
        if shape is None:
            cover(frame, entry.region, self._case.options.cover)
            return
        engine = self._engine(track)
        mesh = engine.draw(frame, shape)
        if track.number in heads:
            self._head(track).draw(frame, mesh, *heads[track.number])
        self.drawn[frame.index].append(_drawn(track.number, engine, mesh))

    def _shape(self, frame: Frame, entry: FaceTreatment) -> F64 | None:
        return self._shapes.get((self._tracks[entry.track].origin, frame.index))

    def _heads_in(self, frame: Frame, swapped: list[FaceTreatment]) -> dict[int, tuple[Gap, Behind]]:
        """By track, what its head leaves in a frame and what is behind, before anything is drawn."""
        shapes = {entry.track: self._shape(frame, entry) for entry in swapped}
        known = {number: shape for number, shape in shapes.items() if shape is not None}
        gaps = {number: self._gap(frame, self._tracks[number], shape) for number, shape in known.items()}
        shot = int(np.searchsorted(self._case.cuts, frame.index, "right"))
        if gaps and shot not in self._plates:
            self._plates[shot] = plate_of(self._case, self._segment, shot, self._gaps)
        found = {}
        for number, gap in gaps.items():
            others = [other for k, other in gaps.items() if k != number]
            width, painter = float(np.ptp(known[number][:, 0])), self._head(self._tracks[number])
            found[number] = gap, painter.behind(frame, width, gap, others, self._plates[shot])
        return found

    def _gap(self, frame: Frame, track: Track, shape: F64) -> Gap:
        """What the head of a track leaves; found now if another region was to be replaced, as before a review."""
        kept = self._gaps.get((track.origin, frame.index))
        return kept or Gap.of(find_head(HeadParser(), frame, shape))

    def _head(self, track: Track) -> HeadPainter:
        if track.number not in self._heads:
            donor = open_donor(self._case.heads[track.person])
            self._heads[track.number] = HeadPainter(donor, self._case.options.renderer)
        return self._heads[track.number]

    def _engine(self, track: Track) -> Engine:
        if track.number not in self._engines:
            options = self._case.options
            engine = Engine(
                self._case.model_of(track.origin),
                open_donor(track.donor),
                None,
                EngineOptions(
                    alpha=options.alpha,
                    renderer=options.renderer,
                    jaw=LIMITS.jaw_face_widths,
                    forehead=LIMITS.forehead_face_widths if options.region == "face" else 0.0,
                    occluders="objects",
                    disguise=True,
                    # The privacy figures are measured with it: narrower means of light cost some privacy, and so
                    # would the learned light, which knows the person at rest.
                    light="classical",
                ),
            )
            self._engines[track.number] = engine
            self.renderer = engine.painter.renderer
        return self._engines[track.number]

    def _release(self, track: int) -> None:
        """Let go of what draws a face, 40 MB or more: many come and go in a street."""
        for drawing in (self._engines.pop(track, None), self._heads.pop(track, None)):
            if drawing is not None:
                drawing.close()

    def close(self) -> None:
        """Release the engines and heads."""
        for track in {*self._engines, *self._heads}:
            self._release(track)

    def __enter__(self) -> SegmentRenderer:
        return self

    def __exit__(self, *problem: object) -> None:
        self.close()


def _drawn(track: int, engine: Engine, mesh: F64) -> DrawnFace:
    """What an engine has drawn on a mesh (81, 2), for the audit."""
    box, uncovered = np.concatenate([mesh.min(0), mesh.max(0)]), engine.uncovered
    if uncovered is None:
        return DrawnFace(track, box)
    step, place = LIMITS.audit_grid_step, engine.target.reference.to_grid(mesh)
    small = cv2.resize(uncovered, None, fx=1 / step, fy=1 / step, interpolation=cv2.INTER_AREA)
    shift = (place.apply(np.zeros((1, 2)))[0] + 0.5) / step - 0.5
    to_grid = np.column_stack([place.linear.T / step, shift])
    return DrawnFace(track, box, np.round(255 * small).astype(np.uint8), to_grid)


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


def _gaps(case: Case, segment: int) -> Gaps:
    """What the heads in the frames of a rendered segment leave."""
    near = [k for k in (segment, segment + 1) if k < len(case.scan.segments)]
    return {key: gap for k in near for key, gap in case.gaps(k).items()}


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


def with_detections(
    entries: dict[int, list[FaceTreatment]], detections: Sequence[AuditDetection], first: int, last: int
) -> dict[int, list[FaceTreatment]]:
    """The entries, with the faces that the audit found covered in the frames about each.

    What is found once more at the same place, beyond those frames, rests there: it is covered in all of them, unless it
    is a face that is followed, whose every frame is judged.
    """
    more = defaultdict(list, {frame: list(these) for frame, these in entries.items()})
    for one in detections:
        is_followed = any(
            entry.done == SWAPPED and iou(entry.box, one.box) > LIMITS.same_place_iou
            for entry in entries.get(one.frame, [])
        )
        rests = not is_followed and _rests(one, detections)
        margin = last - first if rests else LIMITS.audit_margin_frames
        for frame in range(max(first, one.frame - margin), min(last, one.frame + margin + 1)):
            more[frame].append(FaceTreatment(0, COVERED, one.box, 1.0, one.turn))
    return more


def _rests(one: AuditDetection, detections: Sequence[AuditDetection]) -> bool:
    """Whether something is found at the same place in a frame beyond those covered about this one."""
    return any(
        abs(one.frame - other.frame) > LIMITS.audit_margin_frames
        and iou(one.box, other.box) > LIMITS.same_place_iou
        for other in detections
    )
