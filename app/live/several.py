"""Swap several known people at the camera, each for a face of their own, frame by frame; fails closed.

Each person has a tracker, and a face that two of them claim goes to whom its texture fits better.  A face that belongs
to nobody who is known, such as a newcomer's, is covered.  Where somebody who is known cannot be seen well enough, their
region is covered and grows; when they have been missing for longer, it is no longer known where they are: then every
face that is detected stays covered, and the whole frame is while nobody is recognised.  Pixels as displayed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from guise.aam.landmarks import Face, iou, open_landmarker, tight_box
from guise.aam.landmarks.rolls import RolledBoxes
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.live.background_detector import BackgroundDetector
from guise.app.live.controls import LiveSettings
from guise.app.live.face import LIMITS as COVER
from guise.app.live.face import CoverPlanner, FaceResult, Outcome, set_alpha
from guise.app.media import Frame
from guise.app.swapping.cover import cover, cover_all
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.trust import TrustJudge
from guise.common.arrays import F32, F64, U8
from guise.common.closing import Closing

MAX_PEOPLE = 4
MAX_SHARED_IOU = 0.2  # of two faces, from which they are one
MAX_DOUBTED_FRAMES = 5  # in a row, after which a face is taken to be somebody else's


@dataclass(frozen=True)
class CastMember:
    """Somebody at the camera, and the face that they get."""

    person: Identity
    face: Identity


class LiveFaces(Closing):
    """Draws a face over each of several people, in place; used by one thread and closed there by `with`.

    cast : the people, at most MAX_PEOPLE.   options : of the engines; alpha is taken from the settings instead.
    """

    def __init__(self, cast: Sequence[CastMember], options: EngineOptions = EngineOptions()) -> None:
        self.detector = BackgroundDetector()
        options = replace(options, occluders="objects")
        self._slots = [_Slot(member, self.detector, options) for member in cast[:MAX_PEOPLE]]

    def process(self, frame: Frame, settings: LiveSettings) -> FaceResult:
        """Change a frame as the settings say; no detected face is left visible."""
        self.detector.submit(frame)
        for slot in self._slots:
            slot.look(frame, self._boxes_but(slot, certain=True))
        self._settle()
        found = self.detector.found
        regions = [slot.planner.update(frame, slot.fit, self._unclaimed(found, slot)) for slot in self._slots]
        trusted = [slot.is_trusted(frame) and settings.mode != "off" for slot in self._slots]
        meshes = [slot.draw(frame, settings) for slot, own in zip(self._slots, trusted, strict=True) if own]
        confidence = max(slot.confidence for slot in self._slots)
        off: Outcome | None = "off" if settings.mode == "off" else None
        hidden = [region.face for region, own in zip(regions, trusted, strict=True) if not own]
        if not meshes and all(box is None for box in hidden):
            cover_all(frame, settings.style)
            return FaceResult(off or "lost", None, confidence, 1)
        boxes = [box for region in regions for box in region.others] + [
            box for box in hidden if box is not None
        ]
        for box in boxes:
            cover(frame, box, settings.style)
        return FaceResult(
            off or ("swapped" if meshes else "covered"), meshes[0] if meshes else None, confidence, len(boxes)
        )

    def close(self) -> None:
        """Release the compositors and the detector's thread."""
        for one in (*self._slots, self.detector):
            one.close()

    def _boxes_but(self, slot: _Slot, *, certain: bool = False) -> list[F32]:
        """Where the other people's faces are.   certain : only of those who are recognised there."""
        others = [other for other in self._slots if other is not slot]
        least = COVER.min_confidence if certain else 0.0
        return [other.box for other in others if other.box is not None and other.confidence >= least]

    def _unclaimed(self, found: RolledBoxes, slot: _Slot) -> RolledBoxes:
        """What was detected, without the other people's faces."""
        return found[[not _is_on(box, self._boxes_but(slot)) for box in found.boxes] or slice(0)]

    def _settle(self) -> None:
        """Leave a face that two trackers claim to the one that trusts it more."""
        kept: list[F32] = []
        for slot in sorted(self._slots, key=lambda one: -one.confidence):
            if slot.box is not None and _is_on(slot.box, kept):
                slot.lose(Failed("the face is somebody else's"))
            elif slot.box is not None:
                kept.append(slot.box)


class _Slot(Closing):
    """A person of the cast: where they are, how certain that is, and their engine."""

    fit: Fit | Failed
    _tracker: PersonTracker
    _doubted: int  # frames in a row

    def __init__(self, member: CastMember, detector: BackgroundDetector, options: EngineOptions) -> None:
        person = member.person
        self._person, self._finder, self._judge = person, _FreeFaces(detector), TrustJudge()
        self._landmarker = open_landmarker("builtin")
        self._engine = Engine(person, member.face, None, options)
        self.planner = CoverPlanner()
        self.lose(Failed("no face found yet"))

    def look(self, frame: Frame, taken: Sequence[F32]) -> None:
        """Find the person in a frame.   taken : boxes (4,) of other people's faces in the frame before."""
        self._finder.taken = taken
        self.fit = self._tracker.update(frame.luma)
        if isinstance(self.fit, Fit):
            self.confidence = self._judge.trust(self._person.tracker, frame, self.fit.shape)
            self._doubted = 0 if self.confidence >= COVER.min_confidence else self._doubted + 1
            if self._doubted > MAX_DOUBTED_FRAMES:  # it may be somebody else: look for the person anywhere
                self.lose(Failed("the face is not certainly theirs"))
        else:
            self.confidence = 0.0

    def lose(self, why: Failed) -> None:
        """Forget where the person is."""
        self.fit = why
        self.confidence, self._doubted = 0.0, 0
        self._tracker = PersonTracker(
            self._person.tracker, self._finder, landmarker=self._landmarker, rest=self._person.rest_frame
        )

    @property
    def box(self) -> F32 | None:
        """Where the face is, (4,), or None."""
        return tight_box(self.fit.shape[IBUG68]) if isinstance(self.fit, Fit) else None

    def is_trusted(self, frame: Frame) -> bool:
        """Whether the face may be drawn."""
        return self.planner.is_trusted(frame, self.confidence) and isinstance(self.fit, Fit)

    def draw(self, frame: Frame, settings: LiveSettings) -> F64:
        """Draw the face; the mesh (81, 2) of it."""
        assert isinstance(self.fit, Fit)
        set_alpha(self._engine.extrapolator, settings.alpha)
        return self._engine.draw(frame, self.fit.shape)

    def close(self) -> None:
        self._engine.close()


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


def _is_on(box: F32, others: Sequence[F32]) -> bool:
    return any(iou(box, other) > MAX_SHARED_IOU for other in others)
