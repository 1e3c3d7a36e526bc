"""Swap the face in a file: the identity's face on the video's head, with the video's sound and time stamps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.enrolment.source_person import source_person
from guise.app.media import open_input, open_sink
from guise.app.media.synthetic import synthetic_tags
from guise.app.swapping.cover import CoverStyle
from guise.app.swapping.donors import open_donor
from guise.app.swapping.grade import TYPICAL_FACE, Grade, grade
from guise.app.swapping.report import DEFAULTS, SwapReport, SwapSettings, Tally, say_of_faces
from guise.app.swapping.session import ALONE, SwapSession, follow_alone
from guise.common.memory import one_heap
from guise.common.threads import one_thread

if TYPE_CHECKING:
    from guise.app.enrolment.landmark_source import LandmarkSource


def swap_file(
    video: Path, identity: Identity, output: Path, *, source: Identity | LandmarkSource,
    settings: SwapSettings = DEFAULTS,
) -> SwapReport:  # fmt: skip
    """Write `video` with the identity's face on its person's head.

    Parameters
    ----------
    video : a video file, an image or a folder of images.
    identity : whose face is shown.
    output : its suffix decides what is written; it appears only when it is complete.
    source : the model of the person in the video, or where landmarks come from to enrol them first.
    settings : see `SwapSettings`.

    Raises
    ------
    SwapError
        When no frame shows the source person; no output is left.
    GuiseError
        For a user's mistake: MediaError, EnrolError, ReferenceMismatchError, RendererError.
    """
    one_heap()
    say_of_faces([identity], settings.say)
    with open_input(video, settings.hwaccel, settings.read) as media:
        tags = synthetic_tags(identity.facts.get("made_from"))
        with open_sink(output, media, settings.encode, force=settings.force, tags=tags) as sink:
            person = source_person(media, source, identity, settings)
            if settings.rest_seconds is not None:
                person = _at_rest(person, video, settings)
            tally = Tally(settings, media, "swapping")
            look, finder = settings.drawn_look(), settings.face_finder()
            style: CoverStyle | None = "mosaic" if settings.unsure == "cover" else None
            with (
                one_thread(),
                SwapSession(lambda _: Engine(person, Donor.of(identity), finder, look), style) as session,
            ):
                stats = follow_alone(session, media, sink, tally.add, tally.progress, settings.drawn)
                tally.require_some(person.name)
                engine = session.engine(ALONE)
                tally.faces, tally.renderer = engine.tracker.most_faces, session.renderer
                if settings.graded:
                    tally.grade = grade(engine)
        return tally.report(output, stats, sink.first_packet)


def _at_rest(person: Identity, video: Path, settings: SwapSettings) -> Identity:
    """The person, at rest where the settings say."""
    from guise.app.enrolment.rest import at_rest

    return at_rest(person, video, float(settings.rest_seconds or 0), settings.face_finder())


def enrolment_grade(person: Identity) -> Grade | None:
    """The grade of a swap of a person whom a video shows with a typical face of the gallery."""
    with Engine(person, Donor.of(open_donor(TYPICAL_FACE)), None) as engine:
        return grade(engine)
