"""Swap or cover the person at the camera, frame by frame; fails closed.

A face is drawn where the tracker and the person's own texture agree that it is theirs.  Where they do not, the region
of the face is covered; the region grows while the face is missing, up to the whole frame, which stays covered until the
person is found again.  Every other detected face is covered too.  Pixels as displayed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from guise.aam.extrapolation import Extrapolator
from guise.aam.landmarks import iou, open_landmarker
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import RolledBoxes, turn_of
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.live.background_detector import BackgroundDetector
from guise.app.live.controls import LiveSettings
from guise.app.media import Frame
from guise.app.media.pictures import letterboxed
from guise.app.swapping.cover import cover, cover_all
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.puppet import Puppet
from guise.app.swapping.trust import TrustJudge
from guise.common.arrays import F64, U8
from guise.common.closing import Closing

Outcome = Literal["swapped", "covered", "lost", "off", "shown", "enrolling"]


@dataclass(frozen=True)
class CoverLimits:
    """When a face is drawn, and for how long and how far missing faces are covered."""

    min_confidence: float = 0.5  # from which a face is drawn
    min_confident_seconds: float = 0.1  # for which the confidence must hold after it was too low
    growth_per_second: float = 2.0  # of the covered region, relative, while the face is missing
    max_missing_seconds: float = 0.6  # after which the whole frame is covered
    bystander_seconds: float = 0.5  # for which a bystander stays covered after the last detection
    min_unmoved_iou: float = (
        0.7  # of a bystander who has not moved, so that the old box is not covered as well
    )
    min_person_iou: float = 0.2  # of a detected box with the person's


LIMITS = CoverLimits()


@dataclass(frozen=True, eq=False)
class FaceResult:
    """What was done to a frame.

    Parameters
    ----------
    outcome : "swapped" (puppets too); "covered", only the face; "lost", the whole frame is covered; "off", covered
        at the user's request; "shown", unchanged at the user's request; "enrolling", covered until there is a model.
    mesh : (81, 2) pixels where the face was drawn, or None.
    confidence : in [0, 1] that the person's face was found.
    covered : number of covered regions.
    """

    outcome: Outcome
    mesh: F64 | None = None
    confidence: float = 0.0
    covered: int = 0


class LiveFace(Closing):
    """Draws one of several donor faces over a person, in place; used by one thread and closed there by `with`.

    Parameters
    ----------
    person : model of the person at the camera.
    identities : the donors.
    options : of the engine; alpha is taken from the settings instead.

    Raises
    ------
    ReferenceMismatchError
        By `process`, when the person and the donor do not share a reference frame.
    RendererError
        When the chosen renderer is not available.
    """

    def __init__(
        self, person: Identity, identities: Sequence[Identity], options: EngineOptions = EngineOptions()
    ) -> None:
        self.person, self.identities = person, list(identities)
        self.options = replace(options, occluders="objects")
        self.detector = BackgroundDetector()
        self.landmarker = open_landmarker("builtin")
        self.tracker = PersonTracker(
            person.tracker, self.detector, landmarker=self.landmarker, rest=person.rest_frame
        )
        self.cover_planner = CoverPlanner()
        self._judge = TrustJudge()
        self._engines: dict[int, Engine] = {}
        self._puppets: dict[int, Puppet] = {}

    def process(self, frame: Frame, settings: LiveSettings) -> FaceResult:
        """Change a frame as the settings say; whatever happens, no detected face is left visible."""
        if settings.mode == "puppet":
            return self._puppet(frame, settings)
        self.detector.submit(frame)
        fit = self.tracker.update(frame.luma)
        confidence = self._trust(frame, fit)
        trusted = self.cover_planner.is_trusted(frame, confidence)
        if settings.mode == "swap" and trusted and isinstance(fit, Fit):
            return self._swapped(frame, settings, fit, confidence)
        regions = self.cover_planner.update(frame, fit, self.detector.found)
        if settings.uncovered and settings.mode == "swap":
            return FaceResult("shown", None, confidence)
        return self._covered(frame, settings, regions, confidence)

    def close(self) -> None:
        """Release the compositors and the detector's thread."""
        for one in (*self._engines.values(), *self._puppets.values(), self.detector):
            one.close()

    def _swapped(self, frame: Frame, settings: LiveSettings, fit: Fit, confidence: float) -> FaceResult:
        """Draw the face and cover others: known bystanders before it, newcomers after it, once they are detected."""
        alone = not self.cover_planner.has_bystanders
        mesh = self._engine(settings).draw(frame, fit.shape) if alone else None  # while the detector runs
        others = self.cover_planner.update(frame, fit, self.detector.found).others
        for box in others:
            cover(frame, box, settings.style)
        if mesh is None:
            mesh = self._engine(settings).draw(frame, fit.shape)
        return FaceResult("swapped", mesh, confidence, len(others))

    def _covered(
        self, frame: Frame, settings: LiveSettings, regions: CoverRegions, confidence: float
    ) -> FaceResult:
        off = settings.mode == "off"
        if regions.face is None:
            cover_all(frame, settings.style)
            return FaceResult("off" if off else "lost", None, confidence, 1)
        for box in (regions.face, *regions.others):
            cover(frame, box, settings.style)
        return FaceResult("off" if off else "covered", None, confidence, 1 + len(regions.others))

    def _trust(self, frame: Frame, fit: Fit | Failed) -> float:
        return self._judge.trust(self.person.tracker, frame, fit.shape) if isinstance(fit, Fit) else 0.0

    def _engine(self, settings: LiveSettings) -> Engine:
        if settings.identity not in self._engines:
            donor = self.identities[settings.identity]
            self._engines[settings.identity] = Engine(self.person, donor, None, self.options)
        engine = self._engines[settings.identity]
        set_alpha(engine.extrapolator, settings.alpha)
        return engine

    def _puppet(self, frame: Frame, settings: LiveSettings) -> FaceResult:
        if settings.identity not in self._puppets:
            donor = self.identities[settings.identity]
            self._puppets[settings.identity] = Puppet(
                self.person, donor, self.detector, self.options, self.landmarker
            )
        puppet = self._puppets[settings.identity]
        set_alpha(puppet.extrapolator, settings.alpha)
        self.detector.submit(frame)
        _, picture = puppet.animate(frame)
        fill(frame, picture.rgb())
        return FaceResult("swapped", None, 1.0)


@dataclass(frozen=True, eq=False)
class CoverRegions:
    """Regions (4,) to cover in a frame: the person's face, or None for the whole frame, and other faces."""

    face: F64 | None
    others: list[F64]


class CoverPlanner:
    """Decides what must be covered, from all frames so far."""

    def __init__(self) -> None:
        self._own_place: FacePlace | None = None
        self._seen = self._doubted = -np.inf  # seconds
        self._others: list[tuple[float, FacePlace]] = []

    @property
    def has_bystanders(self) -> bool:
        """Whether another face was detected recently."""
        return bool(self._others)

    def is_trusted(self, frame: Frame, confidence: float) -> bool:
        """Whether the next frame's face may be drawn: its confidence must have been high enough for a while."""
        now = float(frame.pts * frame.time_base)
        if confidence < LIMITS.min_confidence:
            self._doubted = now
        return now - self._doubted >= LIMITS.min_confident_seconds

    def update(self, frame: Frame, fit: Fit | Failed, found: RolledBoxes) -> CoverRegions:
        """The regions to cover in the same frame, given the tracker's fit and what the detector found."""
        now = float(frame.pts * frame.time_base)
        own = self._own(fit, found)
        if own is not None:
            self._own_place, self._seen = own, now
        missing = now - self._seen
        if self._own_place is None or missing > LIMITS.max_missing_seconds:
            face = None
        else:
            growth = 1 + LIMITS.growth_per_second * missing
            seen = [place for place in _places(found) if self._belongs(place.box)]  # the fit may lag behind
            regions = np.array([place.region(growth) for place in (self._own_place, *seen)])
            face = np.concatenate([regions[:, :2].min(0), regions[:, 2:].max(0)])
        return CoverRegions(face, self._bystanders(now, found))

    def _own(self, fit: Fit | Failed, found: RolledBoxes) -> FacePlace | None:
        """The place of the person's 68 points, or else the detected one at the person's last position."""
        if isinstance(fit, Fit):
            inner = fit.shape[IBUG68]
            return FacePlace(np.concatenate([inner.min(0), inner.max(0)]), turn_of(fit.shape))
        if self._own_place is None:
            return None
        last = self._own_place.box.astype(np.float32)
        near = [place for place in _places(found) if iou(place.box, last) > LIMITS.min_person_iou]
        return near[0] if near else None

    def _bystanders(self, now: float, found: RolledBoxes) -> list[F64]:
        others = [place for place in _places(found) if not self._belongs(place.box)]
        kept = [
            (at, place)
            for at, place in self._others
            if now - at <= LIMITS.bystander_seconds
            and not any(iou(place.box, other.box) > LIMITS.min_unmoved_iou for other in others)
        ]
        self._others = kept + [(now, place) for place in others]
        return [place.region() for _, place in self._others]

    def _belongs(self, box: F64) -> bool:
        """Whether a box lies on the person's face."""
        if self._own_place is None:
            return False
        own, centre = self._own_place.box, (box[:2] + box[2:]) / 2
        inside = bool((centre > own[:2]).all() and (centre < own[2:]).all())
        return inside or iou(box, own.astype(np.float32)) > LIMITS.min_person_iou


@dataclass(frozen=True, eq=False)
class FacePlace:
    """Where a face is: the box (4,) of its 68 points, and the turn in radians by which it is rolled clockwise."""

    box: F64
    turn: float

    def region(self, growth: float = 1.0) -> F64:
        """The rectangle (4,) that covers it."""
        return region(self.box, growth, self.turn)


def _places(found: RolledBoxes) -> list[FacePlace]:
    pairs = zip(found.boxes.astype(np.float64), found.turns.tolist(), strict=True)
    return [FacePlace(box, turn) for box, turn in pairs]


def set_alpha(extrapolator: Extrapolator, alpha: float) -> None:
    """Set the share of expression that is let through, where it differs: that costs."""
    if extrapolator.alpha != alpha:
        extrapolator.alpha = alpha


def fill(frame: Frame, rgb: U8) -> None:
    """Replace the frame's picture by another (h, w, 3), letterboxed."""
    whole = letterboxed(rgb, frame.width, frame.height)
    frame.write_roi(0, 0, np.asarray(cv2.transform(whole, frame.colour.from_rgb), np.uint8))
