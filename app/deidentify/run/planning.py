"""What is decided between the stages: which tracklets are one face, who is one person, what happens to each face."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.recognition import same_person, signature
from guise.app.deidentify.covers import (
    BYSTANDER,
    CHOSEN,
    EDGE,
    GAP,
    NO_REASON,
    NOT_ENROLLED,
    REASONS,
    RECOGNISED,
    THING,
    UNSURE_FIT,
    CoverSpan,
    covers_of,
    numbered,
    rows_of,
)
from guise.app.deidentify.report.review import read_places, read_tracks
from guise.app.deidentify.run.places import as_chosen
from guise.app.deidentify.stages.case import Case, LinkedTrack, track_from
from guise.app.deidentify.stages.people import LIMITS as ENROLMENT
from guise.app.deidentify.stages.people import why_not
from guise.app.deidentify.stages.things import Sights, find_things, known_things, save_things
from guise.app.deidentify.tracks import BYSTANDERS, Track
from guise.app.people.link import Tracklet, link
from guise.app.swapping.donors import KeyFile, assign
from guise.app.swapping.policy import (
    COVERED,
    LEFT,
    LIMITS,
    SWAPPED,
    Action,
    Bystanders,
    Decision,
    TrackObservations,
    boxes_by_frame,
    decide,
    frames_within,
)
from guise.common.arrays import F32

MAX_CONFIDENCE_PARTS = 100  # of a track's curve


def link_tracks(case: Case) -> dict[str, Any]:
    """The tracks of the detected faces, and the frames in which another shot begins."""
    found = [case.found(k, points=False) for k in range(len(case.scan.segments))]
    chains, cuts = link(found, [s.first for s in case.scan.segments], case.rate)
    tracks = []
    for number, chain in enumerate(chains, start=1):
        rows = [(p, np.flatnonzero(found[p.segment].tracklet == p.number)) for p in chain]
        tracks.append(linked_track(number, chain, [(found[p.segment], r) for p, r in rows]))
    return {"cuts": cuts, "tracks": tracks}


def linked_track(number: int, chain: Sequence[Tracklet], rows: Sequence[tuple[Any, Any]]) -> dict[str, Any]:
    """A track as `LinkedTrack` has it.   chain, rows : its tracklets, and of each the columns and which are its."""
    frames = np.concatenate([one.frame[r] for one, r in rows])
    boxes = np.concatenate([one.box[r] for one, r in rows])
    confidence = np.concatenate([one.confidence[r] for one, r in rows])
    parts = np.array_split(np.arange(len(frames)), min(6, len(frames)))
    shown = [int(frames[part[np.argmax(confidence[part])]]) for part in parts]
    return {
        "number": number, "pieces": [[p.segment, p.number] for p in chain], "first": int(frames[0]),
        "last": int(frames[-1]), "seen": len(frames), "width": float(np.median(boxes[:, 2] - boxes[:, 0])),
        "sure": int((confidence >= ENROLMENT.min_confidence).sum()), "shown": shown,
    }  # fmt: skip


def number_people(case: Case) -> dict[str, int]:
    """By track, the person: tracks of one person who left and returned have the number of the first of them."""
    people: dict[str, int] = {}
    first: dict[int, tuple[LinkedTrack, F32]] = {}  # by person, the track and face that they are known by
    for track in case.linked:
        number = track.number
        if case.has_enrolled(number):
            face = signature(case.enrolled(number))
            same = (
                n for n, (t, known) in first.items() if not _together(t, track) and same_person(known, face)
            )
            number = next(same, number)
            first.setdefault(number, (track, face))
        people[str(track.number)] = number
    return people


def _together(a: LinkedTrack, b: LinkedTrack) -> bool:
    return a.first <= b.last and b.first <= a.last


def _observations(case: Case, track: LinkedTrack) -> tuple[TrackObservations, F32]:
    """The observations of a track, and the confidence of its landmarks (n,)."""
    frames, boxes, turns, trust, confidence = [], [], [], [], []
    for segment, number in track.pieces:
        found, fits = case.found(segment, points=False), case.fits(segment)
        rows = np.flatnonzero(found.tracklet == number)
        mine = np.flatnonzero(fits.track == track.number)
        known = dict(zip(fits.frame[mine].tolist(), fits.confidence[mine].tolist(), strict=True))
        frames.append(found.frame[rows])
        boxes.append(found.box[rows])
        turns.append(found.turn[rows])
        trust.append([known.get(int(f), 0.0) for f in found.frame[rows]])
        confidence.append(found.confidence[rows])
    return TrackObservations(
        np.concatenate(frames),
        np.concatenate(boxes),
        np.concatenate(turns),
        np.concatenate(trust).astype(np.float32),
    ), np.concatenate(confidence)


def _decided(case: Case, track: LinkedTrack, action: Any) -> Decision:
    rows, _ = _observations(case, track)
    return decide(rows, action, total=case.scan.frames, rate=case.rate, cuts=case.cuts)


def propose_tracks(case: Case) -> list[Track]:
    """The tracks, to be swapped where their person could be enrolled and is seen well enough, otherwise covered."""
    tracks = []
    for one in case.linked:
        rows, confidence = _observations(case, one)
        decision = decide(rows, "swap", total=case.scan.frames, rate=case.rate, cuts=case.cuts)
        inside = (decision.frames >= one.first) & (decision.frames <= one.last)
        share = float((decision.done[inside] == SWAPPED).mean())
        reason = _why_cover(case, one, share)
        action: Action = "cover" if reason else "swap"
        tracks.append(Track(
            one.number, case.people[one.number], one.first, one.last, one.seen, round(one.width, 1),
            _curve(one, rows.frames, rows.trust if rows.trust.any() else confidence), action, reason, action,
            can_swap=case.has_model(one.number),
        ))  # fmt: skip
    return tracks


def _why_cover(case: Case, track: LinkedTrack, share: float) -> str:
    if not case.has_model(track.number):
        return why_not(case, track) or str(case.work.load_json(f"person.{track.number - 1}.json"))
    return "" if share >= LIMITS.min_swap_share else "hardly any frame shows the face well enough"


def _curve(track: LinkedTrack, frames: NDArray[np.int32], values: F32) -> tuple[float, ...]:
    whole = np.zeros(track.last - track.first + 1)
    whole[frames - track.first] = values
    parts = np.array_split(whole, min(MAX_CONFIDENCE_PARTS, len(whole)))
    return tuple(round(float(part.mean()), 3) for part in parts)


def chosen_tracks(case: Case, edited: Path | None) -> list[Track]:
    """The tracks with the user's actions, and donors for those that are swapped."""
    proposed = [track_from(entry) for entry in case.work.load_json("proposed.json")]
    count = len(proposed) - len(case.added["tracks"])
    tracks = proposed[:count]
    if edited is not None:
        tracks = list(read_tracks(edited, tracks, case.manifest["fingerprint"]))
    tracks += _renumbered(tracks, proposed[count:])
    origins = {t.number: t.origin for t in tracks}
    donors = donors_of(
        case, {t.person: origins[t.person] for t in tracks if t.action == "swap" and not t.donor}
    )
    return [replace(t, donor=t.donor or donors[t.person] if t.action == "swap" else "") for t in tracks]


def _renumbered(tracks: Sequence[Track], added: Sequence[Track]) -> list[Track]:
    """Tracks of faces that the user has pointed at, numbered after the others, some of which may be parts."""
    first = max((track.number for track in tracks), default=0) + 1
    return [
        replace(t, number=n, part_of=t.number, person=n if t.person == t.number else t.person)
        for n, t in enumerate(added, first)
    ]


def chosen_places(case: Case, edited: Path | None) -> list[dict[str, Any]]:
    """What the user says of places, as JSON holds it."""
    if edited is None:
        return []
    covers = covers_without_track(case)
    return [vars(one) for one in read_places(edited, covers, case.scan.frames, case.manifest["fingerprint"])]


def covers_without_track(case: Case) -> list[CoverSpan]:
    """The covers of faces that are not tracked, before the user has said anything of them."""
    rows = rows_of([bystanders(case)])
    _leave_outside(case, rows)
    return covers_of(rows)


def donors_of(case: Case, people: Mapping[int, int], taken: Collection[str] = ()) -> dict[int, str]:
    """The donor of each person, given with the track that they are called by; with a key file, the one of before.

    taken : donors that they should not get.
    """
    options, salt = case.options, case.manifest["name"]
    if options.keyfile is None:
        return assign(
            list(people), options.donor, own=options.gallery, seed=options.seed, salt=salt, taken=taken
        )
    faces = {
        person: signature(case.model_of(track)) if case.has_model(track) else None
        for person, track in people.items()
    }
    return KeyFile.open(options.keyfile).assign(
        faces, options.donor, own=options.gallery, salt=salt, taken=taken
    )


def plan_faces(case: Case, tracks: Sequence[Track]) -> dict[str, NDArray[Any]]:
    """What happens to each face in each frame, in the columns of `guise.app.deidentify.covers`."""
    linked = {one.number: one for one in case.linked}
    tracked = {}
    for place, one in zip(case.added["places"], case.added["tracks"], strict=True):
        seen, _ = _observations(case, linked[one["number"]])
        tracked[place] = dict(zip(seen.frames.tolist(), seen.boxes, strict=True))
    others = as_chosen(case, bystanders(case), tracked)
    plan = rows_of([*(_rows(case, linked[one.origin], one) for one in tracks), *others])
    _leave_outside(case, plan)
    if case.options.region == "head":
        plan["growth"] *= np.float32(LIMITS.head_growth)
    return plan


def _leave_outside(case: Case, rows: dict[str, NDArray[Any]]) -> None:
    """Have nothing done outside of the part in which faces are hidden."""
    stays = ~case.worked_on[rows["frame"]]
    rows["done"][stays], rows["reason"][stays], rows["cover"][stays] = LEFT, NO_REASON, 0


def _rows(case: Case, whole: LinkedTrack, track: Track) -> dict[str, NDArray[Any]]:
    """The columns of a track, which may be a part of a whole one."""
    d = _decided(case, whole, track.action)
    mine = (d.frames >= track.first) | (track.first == whole.first)
    mine &= (d.frames <= track.last) | (track.last == whole.last)
    unseen = np.where((d.frames < whole.first) | (d.frames > whole.last), EDGE, GAP)
    why = np.where(d.growth > 1, unseen, UNSURE_FIT)  # what is seen has not grown
    if track.action == "cover":
        proposed = RECOGNISED if track.reason == REASONS[RECOGNISED] else NOT_ENROLLED
        why = np.full(len(mine), CHOSEN if track.proposed == "swap" else proposed)
    columns = {
        "track": np.full(len(mine), track.number), "frame": d.frames, "done": d.done, "box": d.boxes, "turn": d.turns,
        "growth": d.growth, "confidence": d.confidence, "reason": np.where(d.done == COVERED, why, NO_REASON),
        "cover": np.zeros(len(mine)),
    }  # fmt: skip
    return {name: values[mine] for name, values in columns.items()}


def bystanders(case: Case) -> dict[str, NDArray[Any]]:
    """The columns of faces that are not tracked."""
    seen = _seen(case)
    frames, rows = seen.around(total=case.scan.frames, rate=case.rate, cuts=case.cuts)
    reach = frames_within(LIMITS.unseen_seconds, case.rate)
    ones, covers = np.ones(len(rows)), numbered(seen.frames, seen.boxes, reach)[rows]
    is_thing = np.isin(covers, [thing.number for thing in known_things(case)])
    return {
        "track": ones * BYSTANDERS, "frame": frames, "done": ones * COVERED, "box": seen.boxes[rows],
        "turn": seen.turns[rows], "growth": ones, "confidence": seen.scores[rows],
        "reason": np.where(is_thing, THING, BYSTANDER), "cover": covers,
    }  # fmt: skip


def things(case: Case) -> list[dict[str, Any]]:
    """What of that is no face, as JSON holds it."""
    seen = _seen(case)
    numbers = numbered(seen.frames, seen.boxes, frames_within(LIMITS.unseen_seconds, case.rate))
    order = np.argsort(numbers, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(numbers[order])) + 1) if len(order) else []
    places = (
        Sights(seen.frames[g], seen.boxes[g], seen.turns[g], seen.scores[g], int(numbers[g[0]]))
        for g in groups
    )
    return save_things(find_things(case, places))


def _seen(case: Case) -> Bystanders:
    """The detections of faces that are not tracked, and where the others are."""
    found = [case.found(k, points=False) for k in range(len(case.scan.segments))]
    return Bystanders(
        np.concatenate([f.bystander_frame for f in found]),
        np.concatenate([f.bystander_box for f in found]),
        np.concatenate([f.bystander_score for f in found]),
        np.concatenate([f.bystander_turn for f in found]),
        boxes_by_frame((f.frame, f.box) for f in found),
    )
