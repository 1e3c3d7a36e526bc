"""The last stage of a segment: faces are swapped and covered, the frames encoded, and the result audited.

What the audit finds is covered too, and the segment is rendered again.  Pixels as shown; boxes ``x0 y0 x1 y1``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import iou
from guise.aam.parsing import HeadParser
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.deidentify.covers import FOUND, NOT_DRAWN, THING, TURNED, numbered
from guise.app.deidentify.stages.alike import Signatures, signature_in
from guise.app.deidentify.stages.audit import AuditDetection, DrawnFace, share_within
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.gaps import Gaps
from guise.app.deidentify.stages.head import Behind, HeadPainter, Plate
from guise.app.deidentify.stages.head_matte import Gap, find_head
from guise.app.deidentify.stages.head_still import HeadStill
from guise.app.deidentify.stages.label import Label
from guise.app.deidentify.stages.loose import gap_of
from guise.app.deidentify.stages.plate import plate_of
from guise.app.deidentify.stages.smooth import FILTER_CONTEXT_FRAMES, smooth
from guise.app.deidentify.stages.things import Thing, known_things
from guise.app.deidentify.tracks import Track
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import DISGUISE
from guise.app.media import Frame
from guise.app.swapping.cover import Covering
from guise.app.swapping.donors import open_donor
from guise.app.swapping.policy import COVERED, LEFT, NOBODY, SWAPPED, FaceTreatment, frames_within
from guise.app.swapping.policy import LIMITS as POLICY
from guise.app.swapping.session import FaceRow, SwapSession
from guise.common.arrays import F32, F64
from guise.common.closing import Closing


@dataclass(frozen=True)
class RenderLimits:
    """How far a swap reaches beyond the face's outline, and what follows what the audit finds."""

    audit_grid_step: int = 4  # pixels of the reference grid, of what the audit is told of objects in front
    hidden_share: float = (
        0.5  # of the middle of a swapped face, or of a cover's opacity, from which it is covered
    )
    same_place_iou: float = 0.5  # of two detections of the audit
    max_repeats: int = 3  # of a segment in which the audit found faces


LIMITS = RenderLimits()
_QUARTER = np.pi / 2


class SegmentRenderer(Closing):
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
        covering = Covering.of(case.options.cover, case.options.cover_strength)
        self._session = SwapSession(self._open_engine, covering)
        self._heads: dict[int, HeadPainter] = {}
        self._plates: dict[int, Plate | None] = {}  # by shot
        self._gaps = _gaps(case, segment)
        self._label: Label | None = None
        self.things = known_things(case)
        self.treated: dict[
            int, list[FaceTreatment]
        ] = {}  # by frame, `entries` with what was decided by the picture
        self._last = {e.who: frame for frame in sorted(entries) for e in entries[frame] if e.done == SWAPPED}
        self.drawn: dict[int, list[DrawnFace]] = defaultdict(list)  # by frame
        self.signatures = Signatures()
        self.done: dict[int, list[FaceTreatment]] = {}  # by frame, as `entries`, but as it is in the picture

    def draw(self, frame: Frame) -> None:
        """Change a frame in place: swaps first, so that covers lie over them."""
        entries = [self._seen(frame, one) for one in self.entries.get(frame.index, [])]
        self.treated[frame.index] = entries
        drawn = self.drawn[frame.index] = []
        shapes = {one.who: self._shape(frame, one.who) for one in entries if one.done == SWAPPED}
        known = {who: shape for who, shape in shapes.items() if shape is not None}
        heads = self._heads_in(frame, known) if self._case.options.region == "head" else {}

        def after(engine: Engine, row: FaceRow) -> None:
            assert row.mesh is not None
            if row.who in heads:
                self._head(self._tracks[row.who]).draw(frame, row.mesh, *heads[row.who])
            drawn.append(_drawn(row.who, engine, row.mesh))

        fits: dict[int, Fit | Failed] = {
            who: Fit(shape, np.zeros(0), 0.0, 1.0) for who, shape in known.items()
        }
        seen = self._signatures(frame, known)
        rows = self._session.treat(frame, entries, fits, after)
        self.done[frame.index] = as_drawn(entries, rows)
        left = {one.who: known[one.who] for one in self.done[frame.index] if one.done == SWAPPED}
        for who, signature in self._signatures(
            frame, {who: left[who] for who in seen if who in left}
        ).items():
            self.signatures.add(self._tracks[who].person, seen[who], signature)
        for who in shapes:
            if frame.index == self._last[who]:
                self._release(who)
        if self._case.options.label:
            self._label = self._label or Label(frame.width, frame.height)
            self._label.draw(frame)

    def _signatures(self, frame: Frame, shapes: dict[int, F64]) -> dict[int, F32]:
        """By track, the signatures of faces that are due in a frame as it is now."""
        people = {who: self._tracks[who].person for who in shapes}
        due = [who for who, person in people.items() if self.signatures.is_due(frame, person)]
        return {who: signature_in(frame, shapes[who]) for who in due}

    def _seen(self, frame: Frame, one: FaceTreatment) -> FaceTreatment:
        """What is to be done with a face in a frame; a thing is left where nobody is before it."""
        if one.reason != THING:
            return one
        is_bare = any(thing.is_at(one.box) and thing.is_bare(frame.luma) for thing in self.things)
        return replace(one, done=LEFT) if is_bare else one

    @property
    def renderer(self) -> str:
        """What drew the faces."""
        return self._session.renderer

    def _shape(self, frame: Frame, track: int) -> F64 | None:
        return self._shapes.get((self._tracks[track].origin, frame.index))

    def _heads_in(self, frame: Frame, shapes: dict[int, F64]) -> dict[int, tuple[Gap, Behind]]:
        """By track, what its head leaves in a frame and what is behind, before anything is drawn."""
        gaps = {number: self._gap(frame, self._tracks[number], shape) for number, shape in shapes.items()}
        shot = int(np.searchsorted(self._case.cuts, frame.index, "right"))
        if gaps and shot not in self._plates:
            self._plates[shot] = plate_of(self._case, self._segment, shot, self._gaps)
        found = {}
        for number, gap in gaps.items():
            others = [other for k, other in gaps.items() if k != number]
            width, painter = float(np.ptp(shapes[number][:, 0])), self._head(self._tracks[number])
            found[number] = gap, painter.behind(frame, width, gap, others, self._plates[shot])
        return found

    def _gap(self, frame: Frame, track: Track, shape: F64) -> Gap:
        """What the head of a track leaves; found now if another region was to be replaced, as before a review."""
        kept = self._gaps.get((track.origin, frame.index))
        return kept or gap_of(frame, shape, find_head(HeadParser(), frame, shape))

    def _head(self, track: Track) -> HeadPainter:
        if track.number not in self._heads:
            still = HeadStill.of(self._case.heads[track.person])
            self._heads[track.number] = HeadPainter(still, self._case.options.renderer)
        return self._heads[track.number]

    def _open_engine(self, number: int) -> Engine:
        track, options = self._tracks[number], self._case.options
        look = (
            DISGUISE
            if options.region == "face"
            else replace(DISGUISE, in_front="objects", forehead=0.0, jaw=0.0)
        )
        return Engine(
            self._case.model_of(track.origin),
            Donor.of(open_donor(track.donor)),
            None,
            replace(
                look,
                alpha=options.alpha,
                renderer=options.renderer,
                hold_seconds=0.0,
                glasses="own" if options.own_glasses == "keep" else "off",
            ),
        )

    def _release(self, track: int) -> None:
        """Let go of what draws a face."""
        self._session.release(track)
        head = self._heads.pop(track, None)
        if head is not None:
            head.close()

    def close(self) -> None:
        """Release the engines and heads."""
        for track in list(self._heads):
            self._release(track)
        self._session.close()


def as_drawn(entries: Sequence[FaceTreatment], rows: Iterable[FaceRow]) -> list[FaceTreatment]:
    """What was done in a frame as a viewer sees it: a swap that was not possible, or lies under a cover, is covered.

    rows : what the session did.   What the audit found on such a face is that face.
    """
    doubts = {row.who: row.doubt for row in rows if row.mesh is not None}
    done = [_as_swapped(one, doubts.get(one.who)) if one.done == SWAPPED else one for one in entries]
    covers, seen, finds = [one for one in done if one.done == COVERED], list[FaceTreatment](), list[int]()
    for one in done:
        over = [
            c
            for c in covers
            if one.done == SWAPPED and share_within(one.box, [c.region]) > LIMITS.hidden_share
        ]
        seen.append(replace(over[0], who=one.who) if over else one)
        finds += [id(c) for c in over if c.reason == FOUND]
    return [one for one in seen if id(one) not in finds]


def _as_swapped(one: FaceTreatment, doubt: float | None) -> FaceTreatment:
    """A swap as it was drawn.   doubt : opacity of the cover over it; None where nothing was drawn."""
    if doubt is None:
        return replace(one, done=one.otherwise, reason=NOT_DRAWN)
    return replace(one, done=COVERED, reason=TURNED) if doubt >= LIMITS.hidden_share else one


def _drawn(track: int, engine: Engine, mesh: F64) -> DrawnFace:
    """What an engine has drawn on a mesh (81, 2), for the audit."""
    box, uncovered = np.concatenate([mesh.min(0), mesh.max(0)]), engine.uncovered
    if uncovered is None:
        return DrawnFace(track, box)
    step, place = (
        LIMITS.audit_grid_step,
        engine.plan.donor.reference.to_grid(mesh),
    )
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
                confidence=float(plan["confidence"][i]),
                reason=int(plan["reason"][i]),
                cover=int(plan["cover"][i]),
            )
        )
    return entries


@dataclass(frozen=True, eq=False)
class JudgedPlaces:
    """What is known of places at which the audit found something: things, and boxes (4,) of what may be none."""

    things: Sequence[Thing] = ()
    doubtful: Sequence[F32] = ()


def with_detections(
    entries: dict[int, list[FaceTreatment]], detections: Sequence[AuditDetection], first: int, last: int, rate: float,
    judged: JudgedPlaces = JudgedPlaces(),
) -> dict[int, list[FaceTreatment]]:  # fmt: skip
    """The entries, with the faces that the audit found covered in the frames about each.

    What is found once more at the same place, beyond those frames, rests there: it is covered in all of them, unless it
    is a face that is followed, whose every frame is judged.  What is doubtful is covered from one sight to the next
    only, if that isn't far.  A place has one cover in a frame.   rate : frames a second.
    """
    about, far = (frames_within(seconds, rate) for seconds in (POLICY.near_seconds, POLICY.max_gap_seconds))
    more = defaultdict(list, {frame: list(these) for frame, these in entries.items()})
    sights: dict[tuple[int, int], list[AuditDetection]] = defaultdict(list)  # by frame and place
    for one, number in zip(detections, numbers_of(detections, last - first), strict=True):
        is_followed = any(
            entry.done == SWAPPED and iou(entry.box, one.box) > LIMITS.same_place_iou
            for entry in entries.get(one.frame, [])
        )
        away = [] if is_followed else _others(one, detections, about)
        before, after = [abs(d) for d in away if -far <= d < 0], [d for d in away if 0 < d <= far]
        low, high = min(before, default=about), min(after, default=about)
        if away and not any(iou(box, one.box) > LIMITS.same_place_iou for box in judged.doubtful):
            low = high = last - first
        for frame in range(max(first, one.frame - low), min(last, one.frame + high + 1)):
            sights[frame, number].append(one)
    for (frame, number), seen in sights.items():
        for box, one in _together(frame, seen):
            is_thing = any(thing.is_at(box) for thing in judged.things)
            more[frame].append(
                FaceTreatment(
                    NOBODY, COVERED, box, 1.0, one.turn, confidence=one.score,
                    reason=THING if is_thing else FOUND, cover=number,
                )
            )  # fmt: skip
    return more


def _together(frame: int, seen: Sequence[AuditDetection]) -> Iterator[tuple[F32, AuditDetection]]:
    """The box about the last and the next sights of a place in a frame, and the surest; for each way up."""
    for turn in {round(one.turn / _QUARTER) for one in seen}:
        mine = [one for one in seen if round(one.turn / _QUARTER) == turn]
        last = max((one.frame for one in mine if one.frame <= frame), default=None)
        after = min((one.frame for one in mine if one.frame >= frame), default=None)
        near = [one for one in mine if one.frame in (last, after)]
        boxes = np.stack([one.box for one in near])
        box = np.concatenate([boxes[:, :2].min(0), boxes[:, 2:].max(0)])
        yield box, max(near, key=lambda one: one.score)


def numbers_of(detections: Sequence[AuditDetection], reach: int) -> list[int]:
    """A number from 1 for each place at which the audit found something."""
    order = sorted(range(len(detections)), key=lambda k: detections[k].frame)
    frames = np.array([detections[k].frame for k in order], np.int32)
    boxes = np.array([detections[k].box for k in order], np.float32).reshape(-1, 4)
    of = dict(zip(order, numbered(frames, boxes, reach).tolist(), strict=True))
    return [of[k] for k in range(len(detections))]


def _others(one: AuditDetection, detections: Sequence[AuditDetection], about: int) -> list[int]:
    """How many frames away something is found at the same place, beyond those covered about this one."""
    return [
        other.frame - one.frame
        for other in detections
        if abs(one.frame - other.frame) > about and iou(one.box, other.box) > LIMITS.same_place_iou
    ]
