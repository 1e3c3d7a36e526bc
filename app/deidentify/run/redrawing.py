"""People whom the recogniser still takes for themselves when they have been drawn get another face, or a cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from guise.app.deidentify.covers import REASONS, RECOGNISED
from guise.app.deidentify.run.planning import donors_of, plan_faces
from guise.app.deidentify.stages.alike import LIMITS, likeness
from guise.app.deidentify.stages.case import Case, track_json
from guise.app.deidentify.tracks import Track
from guise.app.swapping.policy import SWAPPED
from guise.common.progress import Say

TRIED = "tried.json"  # by person, the donors that were drawn, and how alike the person was to themselves
COVER = ""


def redrawn(case: Case, stage: str, say: Say) -> bool:
    """Plan another face, or a cover, of whoever is recognised, and forget what was drawn; False if nobody is.

    stage : "trial" or "render", of which what is there counts.
    """
    names = [f"{stage}.{k}.json" for k in range(len(case.scan.segments))]
    alike = likeness(case.work.load_json(name)["signatures"] for name in names if case.work.has(name))
    shown = {track.person: track for track in case.tracks if track.action == "swap"}
    tried: dict[str, dict[str, float]] = case.work.load_json(TRIED) if case.work.has(TRIED) else {}
    changes = {}
    for person, track in shown.items():
        if alike.get(person, 0.0) < LIMITS.alike:
            continue
        mine = tried.setdefault(str(person), {})
        if (
            alike[person] >= LIMITS.same or track.donor not in mine
        ):  # the first look decides which is the best
            mine[track.donor] = alike[person]
        if (donor := _next(case, track, mine)) != track.donor:
            changes[person] = donor
            then = "another face is tried" if donor not in mine else "the face that hides them best is taken"
            then = then if donor else "they are covered"
            say(f"{case.manifest['name']}: a recogniser still knows person {person}: {then}")
    if not changes:
        return False
    case.work.forget("trial.*", "render.*", "output.*", "drawn.*")
    case.work.save_json(TRIED, tried)
    tracks = [_changed(track, changes) for track in case.tracks]
    case.work.save_json("tracks.json", [track_json(track) for track in tracks])
    case.work.save_arrays("plan.npz", **plan_faces(case, tracks))
    return True


def telling_segments(case: Case) -> tuple[int, ...]:
    """For each person who is drawn the segment that shows them longest: enough to tell whether they are recognised."""
    spans = np.array([case.span(k)[0] for k in range(len(case.scan.segments))])
    drawn = case.plan["done"] == SWAPPED
    where = np.searchsorted(spans, case.plan["frame"][drawn], side="right") - 1
    person = {track.number: track.person for track in case.tracks}
    people = np.array([person[number] for number in case.plan["track"][drawn].tolist()], np.int64)
    return tuple(sorted({int(np.bincount(where[people == who]).argmax()) for who in np.unique(people)}))


def _next(case: Case, track: Track, tried: dict[str, float]) -> str:
    """Whose face somebody gets who is still recognised: one not tried yet, or the best; COVER if none hides them."""
    if len(tried) < LIMITS.donors:
        taken = {*tried, *(other.donor for other in case.tracks if other.donor)}
        donor = donors_of(case, {track.person: track.origin}, taken)[track.person]
        if donor not in taken:
            return donor
    best = min(tried, key=lambda donor: tried[donor])
    return best if tried[best] < LIMITS.same else COVER


def _changed(track: Track, donors: dict[int, str]) -> Track:
    """A track with its person's other donor; covered where there is none."""
    if track.action != "swap" or track.person not in donors:
        return track
    if donors[track.person] == COVER:
        return replace(track, action="cover", proposed="cover", reason=REASONS[RECOGNISED], donor="")
    return replace(track, donor=donors[track.person])
