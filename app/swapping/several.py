"""Swap several people of a video or a photo, each for a face of their own.

The people are found first (`guise.app.people.finding`), so that everybody keeps their face through crossings and cuts;
then each frame is drawn by one engine a person.  What happens to whom is decided as in de-identification
(`guise.app.swapping.policy`): where it isn't certain who or where somebody is, they are covered.  Of a photo's people
no more is known than it shows (`guise.aam.one_photo`).

Pixels as shown, x right, y down; boxes ``x0 y0 x1 y1`` of the 68 iBUG points; frames counted from 0.
"""

from __future__ import annotations

import contextlib
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Literal

import numpy as np

from guise.aam.landmarks import Face, open_landmarker
from guise.aam.model import Identity
from guise.aam.one_photo import person_in_photo
from guise.aam.recognition import cosine_similarity, signature
from guise.aam.training import TrainingError, TrainingOptions
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.enrolment.source_person import keep_person
from guise.app.media import Frame, MediaInput, open_input, open_sink, process
from guise.app.media.synthetic import synthetic_tags
from guise.app.media.time_range import TimeRange, within
from guise.app.people import kept
from guise.app.people.finding import MIN_ALIKE, find_people
from guise.app.people.found import VideoPeople, VideoPerson, people_in_photo
from guise.app.swapping.cover import CoverStyle
from guise.app.swapping.donors import MODEL_SUFFIX, anybody, assign, fictional, open_donor, open_face
from guise.app.swapping.grade import grade
from guise.app.swapping.policy import (
    COVERED,
    DONE,
    LEFT,
    LIMITS,
    NOBODY,
    SWAPPED,
    Action,
    Bystanders,
    FaceTreatment,
    TrackObservations,
    boxes_by_frame,
    decide,
)
from guise.app.swapping.report import (
    DEFAULTS,
    PersonOutcome,
    SeveralReport,
    SwapError,
    SwapSettings,
    Tally,
    say_of_faces,
)
from guise.app.swapping.session import SwapSession
from guise.common.arrays import U8
from guise.common.closing import Closing
from guise.common.threads import one_thread

Others = Literal["leave", "cover", "fictional"]
PLACES = ("left", "right", "largest")
Learn = Callable[[VideoPerson, Identity], Identity]  # the model of a person, to be shown as another


@dataclass(frozen=True)
class Casting:
    """Who gets whose face.

    Parameters
    ----------
    faces : by the person in the video ("left", "right", "largest", a number of `find_people`, NAME.guise or the name of
        somebody who is kept) the face, as for `open_face`, or its model.
    others : what happens to everybody else.   cover : how a face is covered.
    """

    faces: Mapping[str, str | Identity]
    others: Others = "leave"
    cover: CoverStyle = "mosaic"

    def opened(self) -> dict[str, Identity]:
        """By person, the model of the face."""
        return {
            who: face if isinstance(face, Identity) else open_face(face) for who, face in self.faces.items()
        }

    def called(self, who: str) -> str:
        """The name of the face that somebody gets."""
        face = self.faces[who]
        return face.name if isinstance(face, Identity) else face


@dataclass(frozen=True, eq=False)
class KnownVideo:
    """What is known of a video already: who is in it, and models of some of them by number."""

    found: VideoPeople
    models: Mapping[int, Identity]


@dataclass(frozen=True, eq=False)
class _Role:
    """A person with what is done to them; `model` is theirs, `face` the one that they get, `named` if the user did."""

    person: VideoPerson
    action: Action
    named: bool = False
    face: str = ""
    model: Identity | None = None
    shown: Identity | None = None


@dataclass
class _Plan:
    """By frame, what is done, and the faces of those who are swapped."""

    treatments: dict[int, list[FaceTreatment]] = field(default_factory=lambda: defaultdict(list))
    faces: dict[tuple[int, int], Face] = field(default_factory=dict)  # by person and frame


def swap_people(
    video: Path,
    casting: Casting,
    output: Path,
    *,
    settings: SwapSettings = DEFAULTS,
    known: KnownVideo | None = None,
) -> SeveralReport:
    """Write `video` with a face for each of several people.

    Parameters
    ----------
    video : a video, an image or a folder of images.
    output : its suffix decides what is written; it appears only when it is complete.
    settings : see `SwapSettings`; with `unsure` "leave", who is to be swapped is never covered.
    known : what `find_people` and `learn_person` have given for the video, so that it isn't done again.

    Raises
    ------
    SwapError
        When somebody who gets a face is not in the video, or cannot be learned from it; no output is left.
    GuiseError
        For a user's mistake.
    """
    faces = casting.opened()
    say_of_faces(faces.values(), settings.say)
    with contextlib.ExitStack() as stack:
        media = stack.enter_context(open_input(video))
        made_from = {str(face.facts["made_from"]) for face in faces.values() if "made_from" in face.facts}
        tags = synthetic_tags(" and ".join(sorted(made_from)))
        shown, before = media, 0
        if settings.read is not None:
            shown = stack.enter_context(open_input(video, part=settings.read))
            before = _frames_before(media, settings.read)
        with open_sink(output, shown, settings.encode, force=settings.force, tags=tags) as sink:
            if known is None:
                known = KnownVideo(find_people(media, lambda share: settings.progress("faces", share)), {})
            found = known.found
            roles = _roles(media.name, known, casting, faces, _learner(media, known, settings), settings)
            plan = _plan(found, roles, casting, settings, _rate(media))
            tally, is_within = Tally(settings, shown, "swapping"), within(settings.drawn)
            with one_thread(), _Drawing(roles, plan, casting.cover, settings) as drawing:

                def draw(frame: Frame) -> None:
                    frame.index += before
                    tally.add(drawing.draw(frame) if is_within(frame) else "untouched")

                stats = process(shown, sink, draw, progress=tally.progress)
                outcomes = drawing.outcomes()
            require_some(outcomes, media.name)
            tally.renderer = drawing.session.renderer
        report = tally.report(output, stats, sink.first_packet)
    most = max(Counter(int(f) for person in found.people for f in person.frames).values(), default=0)
    return SeveralReport(**vars(replace(report, faces=most)), people=outcomes)


def _rate(media: MediaInput) -> float:
    """Frames a second; the only one of a photo is as long as any."""
    return 1.0 if media.kind == "image" else float(media.frame_rate)


def _frames_before(media: MediaInput, part: TimeRange) -> int:
    """The number of frames before a part of a video."""
    is_within = within(part)
    return sum(1 for _ in takewhile(lambda frame: not is_within(frame), media))


def choose(found: VideoPeople, who: str, video: str) -> tuple[VideoPerson, Identity | None]:
    """The person whom a user means, and their model if that is how they are named; see `Casting`."""
    people = found.people
    if not people and found.count == 1:
        raise SwapError(f"no face is seen in {video}: use a photo that shows one more clearly")
    if not people:
        raise SwapError(f"nobody is seen long enough in {video} to be swapped: use a longer or clearer video")
    if who == "largest":
        return max(people, key=lambda person: person.width), None
    if who in PLACES:
        first = sorted(people, key=lambda person: person.first_x)
        return first[0 if who == "left" else -1], None
    if who.isdigit():
        chosen = [person for person in people if person.number == int(who)]
        if chosen:
            return chosen[0], None
        numbers = ", ".join(str(person.number) for person in people)
        raise SwapError(
            f"there is no person {who} in {video}: choose from {numbers}; guise people find draws them"
        )
    if who not in {p.name for p in kept.everybody()} and not who.endswith(MODEL_SUFFIX):
        raise SwapError(
            f"{who} is nobody who could be in {video}: before the = give left, right, largest, a number of "
            f"guise people find, NAME{MODEL_SUFFIX} or a name of guise people list"
        )
    model = open_face(who)
    likeness = {person.number: cosine_similarity(person.signature, signature(model)) for person in people}
    best = max(people, key=lambda person: likeness[person.number])
    if likeness[best.number] < MIN_ALIKE:
        raise SwapError(
            f"nobody in {video} looks enough like {who} (person {best.number} most, {likeness[best.number]:.2f} of the "
            f"{MIN_ALIKE} needed): guise people find draws who is there, give a number"
        )
    return best, model


def draw_frame(
    video: str, frames: Sequence[Frame], casting: Casting, known: KnownVideo, rate: float, *,
    settings: SwapSettings = DEFAULTS,
) -> None:  # fmt: skip
    """Draw consecutive frames of a video in place, as `swap_people` would; the last one is for looking at.

    video : its name.   rate : frames a second.   People without a model in `known` are covered or refused.
    """
    faces = casting.opened()

    def learn(person: VideoPerson, like: Identity) -> Identity:
        if person.number not in known.models:
            raise SwapError(f"person {person.number} of {video} cannot be learned")
        return known.models[person.number]

    roles = _roles(video, known, casting, faces, learn, settings)
    plan = _plan(known.found, roles, casting, settings, rate)
    with one_thread(), _Drawing(roles, plan, casting.cover, settings) as drawing:
        for frame in frames:
            drawing.draw(frame)


def draw_photo(
    photo: U8, casting: Casting, *, found: VideoPeople | None = None, settings: SwapSettings = DEFAULTS
) -> tuple[U8, tuple[PersonOutcome, ...], VideoPeople]:
    """A photo (h, w, 3) as `swap_people` would draw it, what was done with everybody, and where they are.

    found : what `people_in_photo` has found in it.   Raises SwapError when nobody could be drawn.
    """
    frame, faces, name = Frame.from_rgb(photo), casting.opened(), "the photo"
    known = KnownVideo(people_in_photo(frame) if found is None else found, {})

    def learn(person: VideoPerson, like: Identity) -> Identity:
        return from_photo(photo, person, like.reference.resolution)

    roles = _roles(name, known, casting, faces, learn, settings)
    plan = _plan(known.found, roles, casting, settings, 1.0)
    with one_thread(), _Drawing(roles, plan, casting.cover, settings) as drawing:
        drawing.draw(frame)
        outcomes = drawing.outcomes()
    require_some(outcomes, name)
    return frame.rgb(), outcomes, known.found


def require_some(people: Sequence[PersonOutcome], video: str) -> None:
    """Raise SwapError when nobody of a video was swapped."""
    if not any(one.swapped for one in people):
        raise SwapError(f"nobody could be swapped in {video}: their faces are too small, hidden or turned")


def learn_person(
    media: MediaInput, found: VideoPeople, person: VideoPerson, settings: SwapSettings = DEFAULTS,
    *, resolution: int = TrainingOptions().resolution,
) -> Identity:  # fmt: skip
    """The model of a person, enrolled from the video, or kept from an earlier run.

    Raises SwapError when they are not seen well enough.
    """
    from guise.app.enrolment.enrol import EnrolError, enrol
    from guise.app.enrolment.landmark_source import LandmarkSource

    name = f"{media.path.stem} person {person.number}"
    if media.kind == "image":
        return from_photo(next(iter(media)).rgb(), person, resolution)

    def learn() -> Identity:
        points = person.landmarks(found.count)
        points[person.frames[person.confidence < LIMITS.min_confidence]] = np.nan
        training = TrainingOptions(resolution=resolution)
        source = LandmarkSource(points=[points])
        return enrol(
            [media.path], source, name=name, options=training, progress=settings.progress, say=settings.say
        )

    try:
        who = f"person {person.number} of {media.name}"
        return keep_person(media, (resolution, f"person {person.number}"), who, learn, settings)
    except (EnrolError, TrainingError) as error:
        raise SwapError(f"person {person.number} of {media.name} cannot be learned: {error}") from error


def from_photo(photo: U8, person: VideoPerson, resolution: int) -> Identity:
    """The model of a person in a photo (h, w, 3), which is all that is known of them."""
    like = anybody().at_resolution(resolution)
    try:
        return person_in_photo(photo, person.points[0].astype(np.float64), f"person {person.number}", like)
    except TrainingError as error:
        raise SwapError(str(error)) from error


def _learner(media: MediaInput, known: KnownVideo, settings: SwapSettings) -> Learn:
    def learn(person: VideoPerson, like: Identity) -> Identity:
        model = known.models.get(person.number)
        return model or learn_person(
            media, known.found, person, settings, resolution=like.reference.resolution
        )

    return learn


def _roles(
    video: str, known: KnownVideo, casting: Casting, faces: Mapping[str, Identity], learn: Learn, settings: SwapSettings
) -> list[_Role]:  # fmt: skip
    people = known.found.people
    chosen: dict[int, tuple[str, Identity | None]] = {}
    for who in casting.faces:
        person, model = choose(known.found, who, video)
        if person.number in chosen:
            raise SwapError(
                f"{chosen[person.number][0]} and {who} are the same person, {person.number}: give one face"
            )
        chosen[person.number] = who, model
    extras = [person.number for person in people if person.number not in chosen]
    taken = {fictional(face) or face for face in casting.faces.values() if isinstance(face, str)}
    spare = assign(extras, "auto", seed=0, salt=video, taken=taken) if casting.others == "fictional" else {}
    roles = []
    for person in people:
        if person.number in chosen:
            who, model = chosen[person.number]
            model = model or learn(person, faces[who])
            roles.append(_Role(person, "swap", True, casting.called(who), model, faces[who]))
        elif casting.others == "fictional":
            roles.append(_fictional(person, spare[person.number], learn, settings))
        else:
            roles.append(_Role(person, casting.others))
    return roles


def _fictional(person: VideoPerson, donor: str, learn: Learn, settings: SwapSettings) -> _Role:
    shown = open_donor(donor)
    try:
        return _Role(person, "swap", False, donor, learn(person, shown), shown)
    except SwapError as error:
        settings.say(f"{error}; they are covered")
        return _Role(person, "cover")


def _plan(
    found: VideoPeople, roles: Sequence[_Role], casting: Casting, settings: SwapSettings, rate: float
) -> _Plan:
    plan = _Plan()
    for role in roles:
        private = not role.named and role.action != "leave"
        for rows in _sights(role.person, rate, found.cuts):
            _add_sight(plan, found, role, rows, rate, margins=private)
        if role.action == "swap" and settings.unsure == "leave" and not private:
            _leave_unsure(plan, role.person.number)
    _add_unknown(plan, found, casting, settings, rate)
    return plan


def _sights(person: VideoPerson, rate: float, cuts: Sequence[int]) -> list[slice]:
    """Rows of a person without a long gap or a cut between them."""
    frames = person.frames
    breaks = np.diff(frames) > LIMITS.max_gap_seconds * rate
    for cut in cuts:
        breaks |= (frames[:-1] < cut) & (cut <= frames[1:])
    edges = [0, *(np.flatnonzero(breaks) + 1).tolist(), len(frames)]
    return [slice(a, b) for a, b in pairwise(edges)]


def _add_sight(
    plan: _Plan, found: VideoPeople, role: _Role, rows: slice, rate: float, *, margins: bool
) -> None:
    """One sight of a person.   margins : cover where they may be before and after it, too."""
    person = role.person
    clear = np.isfinite(person.points[rows]).all((1, 2)) & (person.confidence[rows] >= LIMITS.min_confidence)
    observed = TrackObservations(
        person.frames[rows], person.boxes[rows], person.turns[rows], clear.astype(np.float32)
    )
    decision = decide(observed, role.action, total=found.count, rate=rate, cuts=found.cuts)
    for k, frame in enumerate(map(int, decision.frames)):
        if margins or person.frames[rows][0] <= frame <= person.frames[rows][-1]:
            plan.treatments[frame].append(
                FaceTreatment(
                    person.number, int(decision.done[k]), decision.boxes[k], float(decision.growth[k]),
                    float(decision.turns[k]),
                )
            )  # fmt: skip
    for row in np.flatnonzero(clear) + rows.start:
        plan.faces[person.number, int(person.frames[row])] = Face(
            person.points[row], float(person.confidence[row]), person.boxes[row]
        )


def _leave_unsure(plan: _Plan, number: int) -> None:
    """Leave a person where they would be covered."""
    for frame, entries in plan.treatments.items():
        plan.treatments[frame] = [
            replace(one, done=LEFT if one.done == COVERED else one.done, otherwise=LEFT)
            if one.who == number
            else one
            for one in entries
        ]


def _add_unknown(
    plan: _Plan, found: VideoPeople, casting: Casting, settings: SwapSettings, rate: float
) -> None:
    """Cover the faces that are nobody's for certain, unless all of them may be left."""
    if casting.others == "leave" and settings.unsure == "leave":
        return
    seen = found.unknown
    followed = boxes_by_frame((person.frames, person.boxes) for person in found.people)
    faces = Bystanders(seen.frames, seen.boxes, seen.scores, seen.turns, followed)
    if casting.others != "leave":
        faces = faces.spread(total=found.count, rate=rate, cuts=found.cuts)
    for frame, box, turn in zip(faces.frames.tolist(), faces.boxes, faces.turns.tolist(), strict=True):
        unknown = FaceTreatment(NOBODY, COVERED, box, 1.0, float(turn))
        known = (one for one in plan.treatments[frame] if one.who != NOBODY)
        if casting.others != "leave" or any(
            _overlap(unknown, one) for one in known
        ):  # it may be one of these
            plan.treatments[frame].append(unknown)


def _overlap(a: FaceTreatment, b: FaceTreatment) -> bool:
    return bool((np.minimum(a.region[2:], b.region[2:]) > np.maximum(a.region[:2], b.region[:2])).all())


class _Drawing(Closing):
    """Draws the plan; one engine a person, made when it is first needed."""

    def __init__(
        self, roles: Sequence[_Role], plan: _Plan, style: CoverStyle, settings: SwapSettings
    ) -> None:
        self._roles, self._plan = {role.person.number: role for role in roles}, plan
        self._look, self._graded = replace(settings.look, hold_seconds=0.0), settings.graded
        self._landmarker = open_landmarker("builtin")
        self.session = SwapSession(self._open_engine, style)
        self._counts: dict[int, Counter[str]] = defaultdict(Counter)

    def draw(self, frame: Frame) -> str:
        """Change a frame in place; what it counts as."""
        treatments = self._plan.treatments.get(frame.index, [])
        swapped = {one.who for one in treatments if one.done == SWAPPED}
        fits = {
            who: self.session.engine(who).follow(
                frame, self._plan.faces.get((who, frame.index)) if who in swapped else None
            )
            for who in swapped | self.session.engines.keys()
        }
        rows = self.session.treat(frame, treatments, fits)
        for row in rows:
            self._counts[row.who][row.outcome] += 1
        named = {who for who, role in self._roles.items() if role.named}
        if any(row.outcome == "covered" and row.who in named for row in rows):
            return "covered"
        return "swapped" if any(row.outcome == "swapped" for row in rows) else "lost"

    def outcomes(self) -> tuple[PersonOutcome, ...]:
        """What was done with everybody, at the end."""
        grades = {who: grade(engine) for who, engine in self.session.engines.items() if self._graded}
        found = []
        for who, role in self._roles.items():
            swapped, covered, left = (self._counts[who][done] for done in DONE)
            outcome = PersonOutcome(who, role.face, swapped, covered, left)
            judged = grades.get(who)
            if judged is not None:
                outcome = replace(outcome, grade=judged.score, advice=judged.advice)
            found.append(outcome)
        return tuple(found)

    def close(self) -> None:
        """Release the engines."""
        self.session.close()

    def _open_engine(self, who: int) -> Engine:
        role = self._roles[who]
        assert role.model is not None
        assert role.shown is not None
        return Engine(role.model, Donor.of(role.shown), self._landmarker, self._look)
