"""Faces that nothing has tracked and that a user wants swapped: they are followed, and become tracks like others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, iou, tight_box
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.rolls import turn_of
from guise.aam.landmarks.schemes import COUNT, IBUG68
from guise.app.deidentify.run.planning import linked_track
from guise.app.deidentify.stages.case import ADDED, Case
from guise.app.deidentify.stages.follow import follow
from guise.app.deidentify.tracks import MarkedPlace
from guise.app.people.faces import LIMITS, TRACKING, SegmentFaces
from guise.app.people.link import Tracklet
from guise.common.arrays import F32


@dataclass
class _Rows:
    """Columns of a segment that are added, see `guise.app.people.faces.SegmentFaces`."""

    tracklet: list[int] = field(default_factory=list)
    frame: list[int] = field(default_factory=list)
    confidence: list[float] = field(default_factory=list)
    box: list[F32] = field(default_factory=list)
    turn: list[float] = field(default_factory=list)
    points: list[F32] = field(default_factory=list)

    def add(self, tracklet: int, frame: int, box: F32, face: Face | None) -> None:
        nowhere = np.full((COUNT, 2), np.nan, np.float32)
        self.tracklet.append(tracklet)
        self.frame.append(frame)
        self.confidence.append(face.confidence if face else 0.0)
        self.box.append(box if face is None else np.asarray(tight_box(face.points[IBUG68]), np.float32))
        self.turn.append(turn_of(face.points) if face else (self.turn or [0.0])[-1])
        self.points.append(face.points if face else nowhere)


def add_tracks(case: Case) -> bool:
    """Track what the user wants swapped; whether there are new tracks, whose people are to be enrolled and fitted."""
    swaps = [place for place in case.places if place.action == "swap"]
    if not swaps or case.work.has(ADDED):
        return False
    found = [case.found(k, points=False) for k in range(len(case.scan.segments))]
    next_tracklet = [int(one.tracklet.max(initial=-1)) + 1 for one in found]
    added = [_Rows() for _ in found]
    tracks, places, number = [], [], max((track.number for track in case.linked), default=0)
    for place in swaps:
        seen = {} if _is_tracked(found, place) else _faces(case, place)
        if len([face for _, face in seen.values() if face is not None]) < LIMITS.min_tracklet_frames:
            continue  # it is covered
        chain = []
        for k, segment in enumerate(case.scan.segments):
            mine = {frame: one for frame, one in seen.items() if segment.first <= frame < segment.end}
            for frame, (box, face) in mine.items():
                added[k].add(next_tracklet[k], frame, box, face)
            if mine:
                boxes = added[k].box[-len(mine) :]
                chain.append(Tracklet(k, next_tracklet[k], min(mine), max(mine), boxes[0], boxes[-1]))
                next_tracklet[k] += 1
        number += 1
        columns = [SimpleNamespace(**_arrays(rows)) for rows in added]
        rows = [(columns[t.segment], np.flatnonzero(columns[t.segment].tracklet == t.number)) for t in chain]
        tracks.append(linked_track(number, chain, rows))
        places.append(case.places.index(place))
    for k, one in enumerate(added):
        if one.frame:
            case.work.save_arrays(f"added.{k}.npz", **_arrays(one))
            case.work.forget(f"fit.{k}.npz")
    case.work.forget("people.json", "proposed.json")
    case.work.save_json(ADDED, {"tracks": tracks, "places": places})
    return bool(tracks)


def _arrays(rows: _Rows) -> dict[str, NDArray[Any]]:
    kinds = {"tracklet": np.int32, "frame": np.int32}
    return {name: np.array(values, kinds.get(name, np.float32)) for name, values in vars(rows).items()}


def _faces(case: Case, place: MarkedPlace) -> dict[int, tuple[F32, Face | None]]:
    """By frame, the box that is followed and the face there; from the first to the last frame with a face."""
    boxes, landmarker = follow(case, place), BuiltinLandmarker()
    last: Face | None = None
    seen: dict[int, tuple[F32, Face | None]] = {}
    for frame in case.frames(min(boxes), max(boxes) + 1):
        box, rgb = boxes[frame.index], frame.quick_rgb()
        last = landmarker.refine(rgb, last) if last is not None else None
        if last is None or not _is_at(last, box):
            last = landmarker.look_in_box(rgb, box)[0]
            last = last if last is not None and _is_at(last, box) else None
        if last is not None or seen:
            seen[frame.index] = box, last
    ends: Sequence[int] = [frame for frame, (_, face) in seen.items() if face is not None]
    return {frame: one for frame, one in seen.items() if frame <= max(ends, default=-1)}


def _is_tracked(found: Sequence[SegmentFaces], place: MarkedPlace) -> bool:
    """Whether what a place shows has a track already."""
    box = np.array(place.box, np.float32)
    return any(iou(one.box[row], box) > LIMITS.sight_iou
               for one in found for row in np.flatnonzero(one.frame == place.at))  # fmt: skip


def _is_at(face: Face, box: F32) -> bool:
    own = np.asarray(tight_box(face.points[IBUG68]), np.float32)
    return face.confidence >= TRACKING.min_confidence and float(iou(own, box)) > LIMITS.sight_iou
