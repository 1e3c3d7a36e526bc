"""Swap or cover the people at the camera, frame by frame; fails closed (`guise.app.swapping.policy`).

Each person who is known has a tracker, and a face that two of them claim goes to whom its texture fits better.  A face
is drawn where the tracker and the person's own texture agree that it is theirs.  Where they do not, its region is
covered; when somebody has not been seen for longer, it is no longer known where they are: every face that is detected
stays covered, and the whole frame is while nobody is recognised.  Every other detected face is covered too.  Pixels as
displayed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from guise.aam.landmarks import Face, iou, open_landmarker, tight_box
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import LIVE, PUPPET, Look
from guise.app.live.background_detector import BackgroundDetector
from guise.app.live.options import LiveSettings
from guise.app.media import Frame
from guise.app.media.pictures import letterboxed
from guise.app.swapping.cover import cover, cover_all
from guise.app.swapping.policy import LIMITS, FacePlace, FollowedFace, UnfollowedFaces
from guise.app.swapping.puppet import Puppet
from guise.app.swapping.session import SwapSession
from guise.app.swapping.trust import TrustJudge
from guise.common.arrays import F32, F64, U8
from guise.common.closing import Closing

Outcome = Literal["swapped", "covered", "lost", "off", "shown", "enrolling"]
MAX_PEOPLE = 4


@dataclass(frozen=True, eq=False)
class FaceResult:
    """What was done to a frame.

    Parameters
    ----------
    outcome : "swapped" (puppets too); "covered", only faces; "lost", the whole frame is covered; "off", covered
        at the user's request; "shown", unchanged at the user's request; "enrolling", covered until there is a model.
    mesh : (81, 2) pixels where a face was drawn, or None.
    confidence : in [0, 1] that the person's face was found.
    covered : number of covered regions.
    """

    outcome: Outcome
    mesh: F64 | None = None
    confidence: float = 0.0
    covered: int = 0


@dataclass(frozen=True)
class CastMember:
    """Somebody at the camera, and the face that they get, or those among which the user chooses."""

    person: Identity
    faces: Sequence[Identity]


class LiveFaces(Closing):
    """Draws a face over each of several people, in place; used by one thread and closed there by `with`.

    Parameters
    ----------
    cast : the people, at most MAX_PEOPLE.
    look : of the engines; alpha is taken from the settings instead.

    Raises
    ------
    ReferenceMismatchError
        By `process`, when a person and their face do not share a reference frame.
    RendererError
        When the chosen renderer is not available.
    """

    def __init__(self, cast: Sequence[CastMember], look: Look = LIVE) -> None:
        self.look = replace(look, in_front="objects", hold_seconds=0.0)
        self.detector = BackgroundDetector()
        self._slots = [_Slot(member.person, self.detector) for member in cast[:MAX_PEOPLE]]
        self._choices = [(slot, face) for slot, one in enumerate(cast[:MAX_PEOPLE]) for face in one.faces]
        self._session: SwapSession[Engine] = SwapSession(self._open_engine)
        self._others = UnfollowedFaces()
        self._puppets: SwapSession[Puppet] = SwapSession(self._open_puppet)

    def process(self, frame: Frame, settings: LiveSettings) -> FaceResult:
        """Change a frame as the settings say; whatever happens, no detected face is left visible."""
        is_alone = len(self._slots) == 1
        if settings.mode == "puppet" and is_alone:
            return self._puppet(frame, settings)
        sure = [one.box for one in self._slots if one.confidence >= LIMITS.min_confidence]
        self.detector.submit(frame, [box for box in sure if box is not None])
        for slot in self._slots:
            slot.look(frame, self._boxes_but(slot, certain=True))
        self._settle()
        meshes = self._drawn(frame, settings)  # while the detector runs
        self._see(frame)
        confidence = max(slot.confidence for slot in self._slots)
        if settings.unsure == "leave" and settings.mode == "swap" and is_alone and not meshes:
            return FaceResult("shown", None, confidence)
        return self._covered(frame, settings, meshes, confidence)

    def close(self) -> None:
        """Release the compositors and the detector's thread."""
        for one in (self._puppets, self._session, self.detector):
            one.close()

    def _drawn(self, frame: Frame, settings: LiveSettings) -> dict[int, F64]:
        """The meshes (81, 2) of those who are trusted to be where they were tracked, by slot; they are drawn."""
        meshes = {}
        for number, slot in enumerate(self._slots):
            is_trusted = slot.face.is_trusted(frame.seconds, slot.confidence)
            if is_trusted and settings.mode != "off":
                who = number if len(self._slots) > 1 else settings.identity
                self._session.engine(who).alpha = settings.alpha
                mesh = self._session.swap(frame, who, slot.fit).mesh
                if mesh is not None:
                    meshes[number] = mesh
        return meshes

    def _see(self, frame: Frame) -> None:
        """Note where everybody known is in a frame, by their fit, or as they are detected where they were."""
        now, found = frame.seconds, FacePlace.detected(self.detector.found)
        for slot in self._slots:
            others = self._boxes_but(slot)
            slot.detected = [place for place in found if not _is_on(place.box, others)]
            if isinstance(slot.fit, Fit):
                slot.face.see(now, FacePlace.of(slot.fit.shape))
            else:
                slot.face.look_for(now, slot.detected)
        self._strangers = [one for one in found if not any(slot.face.holds(now, one) for slot in self._slots)]

    def _covered(
        self, frame: Frame, settings: LiveSettings, meshes: dict[int, F64], confidence: float
    ) -> FaceResult:
        """Cover who was not drawn and who is not known, or everything where nobody is known to be anywhere."""
        now, off = frame.seconds, settings.mode == "off"
        rectangles = self._others.see(now, self._strangers)
        hidden = [
            slot.face.region(now, slot.detected) for k, slot in enumerate(self._slots) if k not in meshes
        ]
        if not meshes and all(one is None for one in hidden):
            cover_all(frame, settings.style)
            return FaceResult("off" if off else "lost", None, confidence, 1)
        rectangles += [one for one in hidden if one is not None]
        for rectangle in rectangles:
            cover(frame, rectangle, settings.style)
        outcome: Outcome = "off" if off else "swapped" if meshes else "covered"
        return FaceResult(outcome, next(iter(meshes.values()), None), confidence, len(rectangles))

    def _open_engine(self, who: int) -> Engine:
        slot, face = self._choices[who]
        return Engine(self._slots[slot].person, Donor.of(face), None, self.look)

    def _open_puppet(self, who: int) -> Puppet:
        [slot], (_, face) = self._slots, self._choices[who]
        look = replace(PUPPET, renderer=self.look.renderer)
        return Puppet(slot.person, face, self.detector, look, slot.landmarker)

    def _boxes_but(self, slot: _Slot, *, certain: bool = False) -> list[F32]:
        """Where the other people's faces are.   certain : only of those who are recognised there."""
        least = LIMITS.min_confidence if certain else 0.0
        others = [other for other in self._slots if other is not slot and other.confidence >= least]
        return [other.box for other in others if other.box is not None]

    def _settle(self) -> None:
        """Leave a face that two trackers claim to the one that trusts it more."""
        kept: list[F32] = []
        for slot in sorted(self._slots, key=lambda one: -one.confidence):
            if slot.box is not None and _is_on(slot.box, kept):
                slot.lose(Failed("the face is somebody else's"))
            elif slot.box is not None:
                kept.append(slot.box)

    def _puppet(self, frame: Frame, settings: LiveSettings) -> FaceResult:
        puppet, picture = self._puppets.engine(settings.identity), frame.copy()
        puppet.alpha = settings.alpha
        self.detector.submit(frame)
        self._puppets.swap(picture, settings.identity, puppet.track(frame))
        fill(frame, picture.rgb())
        return FaceResult("swapped", None, 1.0)


class _Slot:
    """A person of the cast: where they are and how certain that is."""

    fit: Fit | Failed
    confidence: float
    _tracker: PersonTracker
    _doubted: float | None  # seconds, since when

    def __init__(self, person: Identity, detector: BackgroundDetector) -> None:
        self.person, self._finder, self._judge = person, _FreeFaces(detector), TrustJudge()
        self.landmarker = open_landmarker("builtin")
        self.face = FollowedFace()
        self.detected: list[FacePlace] = []  # faces of the current frame that are nobody else's
        self.lose(Failed("no face found yet"))

    def look(self, frame: Frame, taken: Sequence[F32]) -> None:
        """Find the person in a frame.   taken : boxes (4,) of other people's faces in the frame before."""
        self._finder.taken = taken
        self.fit = self._tracker.update(frame.luma)
        if not isinstance(self.fit, Fit):
            self.confidence = 0.0
            return
        self.confidence = self._judge.trust(self.person.tracker, frame, self.fit.shape)
        if self.confidence >= LIMITS.min_confidence:
            self._doubted = None
        elif self._doubted is None:
            self._doubted = frame.seconds
        elif frame.seconds - self._doubted > LIMITS.lose_seconds:  # it may be somebody else: look anywhere
            self.lose(Failed("the face is not certainly theirs"))

    def lose(self, why: Failed) -> None:
        """Forget where the person is."""
        self.fit, self.confidence, self._doubted = why, 0.0, None
        self._tracker = PersonTracker(
            self.person.tracker, self._finder, landmarker=self.landmarker, rest=self.person.rest_frame
        )

    @property
    def box(self) -> F32 | None:
        """Where the face is, (4,), or None."""
        return tight_box(self.fit.shape[IBUG68]) if isinstance(self.fit, Fit) else None


class _FreeFaces:
    """The detector's faces without those that other people have."""

    name = BackgroundDetector.name

    def __init__(self, detector: BackgroundDetector) -> None:
        self._detector = detector
        self.taken: Sequence[F32] = ()

    def detect(self, rgb: U8) -> list[Face]:
        """Faces of the current frame, largest first."""
        return [face for face in self._detector.detect(rgb) if not _is_on(face.box, self.taken)]

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The previous frame's face in the current frame."""
        return self._detector.refine(rgb, previous)


def _is_on(box: F32 | F64, others: Sequence[F32]) -> bool:
    return any(iou(box, other) > LIMITS.min_same_iou for other in others)


def fill(frame: Frame, rgb: U8) -> None:
    """Replace the frame's picture by another (h, w, 3), letterboxed."""
    whole = letterboxed(rgb, frame.width, frame.height)
    frame.write_roi(0, 0, np.asarray(cv2.transform(whole, frame.colour.from_rgb), np.uint8))
