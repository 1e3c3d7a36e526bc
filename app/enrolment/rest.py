"""The frame in which a user says that a face is at rest."""

from __future__ import annotations

from pathlib import Path

from guise.aam.model import Identity
from guise.aam.person_tracker import FaceFinder, PersonTracker
from guise.aam.tracker import Fit
from guise.app.enrolment.enrol import EnrolError
from guise.app.media import Frame, open_input


def frame_at(clip: Path, seconds: float) -> Frame:
    """The frame that is shown so many seconds after a clip's first one."""
    with open_input(clip) as media:
        first = end = None
        for frame in media:
            first = frame.pts if first is None else first
            end = float((frame.pts + frame.duration - first) * frame.time_base)
            if end > seconds:
                return frame.copy()
    length = f"lasts {end:.2f} s" if end is not None else "has no frames"
    raise EnrolError(
        f"--rest {seconds:g} lies after the end of {clip.name}, which {length}: give a time within it"
    )


def at_rest(person: Identity, clip: Path, seconds: float, finder: FaceFinder) -> Identity:
    """A person whose face at rest is that of a frame of a clip, so many seconds after its first one."""
    frame = frame_at(clip, seconds)
    fit = PersonTracker(person.tracker, finder, rest=person.rest_frame).update(frame.luma)
    if not isinstance(fit, Fit):
        raise EnrolError(
            f"the face of {person.name} is not found {seconds:g} s into {clip.name} (--rest): "
            "give a time at which it is seen at rest"
        )
    return person.resting(frame.rgb(), fit.shape)
