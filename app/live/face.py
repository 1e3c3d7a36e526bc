"""What is shown instead of the person at the camera, frame by frame; it fails closed.

A face is drawn where the tracker and the person's own texture agree that it is theirs.  Where they do not, the region
of the face is covered; the longer it was not seen, the larger the region, up to the whole picture, which stays covered
until the person is there again.  Every other face that the detector sees is covered too.  Pixels as shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.follow import PersonFollower
from guise.aam.landmarks import overlap
from guise.aam.model import Identity
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.live.controls import Settings
from guise.app.live.letterbox import letterboxed
from guise.app.live.watch import Watch
from guise.app.media import Frame
from guise.app.swapping.cover import cover, cover_all, region
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import Options
from guise.app.swapping.puppet import Puppet
from guise.app.swapping.trust import trust
from guise.common.arrays import F64
from guise.common.closing import Closing

Outcome = Literal["swapped", "covered", "lost", "off", "shown", "enrolling"]

TRUST = 0.5  # confidence from which a face is drawn
AROUND = 0.1  # seconds for which it must hold after it did not
GROWTH = 2.0  # by which the region grows in each second since the face was last seen
WHOLE = 0.6  # seconds after which the whole picture is covered
BYSTANDER = 0.5  # seconds for which a face stays covered after it was last seen
STILL = 0.7  # overlap from which a face is where it was, and the old place is not covered as well
SAME = 0.2  # overlap from which a detector's box is the person's


@dataclass(frozen=True, eq=False)
class Look:
    """What happened to a frame.

    Parameters
    ----------
    outcome : "swapped" (also a puppet); "covered", the face alone; "lost", the whole picture is covered; "off", covered
        as the user wished; "shown", left as it was, as the user wished; "enrolling", covered until there is a model.
    mesh : (81, 2) pixels where the face was drawn, or None.
    confidence : in [0, 1] that the face was found.
    covered : number of regions that were covered.
    """

    outcome: Outcome
    mesh: F64 | None = None
    confidence: float = 0.0
    covered: int = 0


class LiveFace(Closing):
    """Draws one of several faces over a person, in place; used by one thread, and closed there by `with`.

    Parameters
    ----------
    person : model of who is at the camera.
    identities : whose faces can be shown.
    options : how the engine draws; its alpha is that of the settings.

    Raises
    ------
    ReferenceMismatchError
        In `step`, when the person and the chosen face do not share a reference frame.
    RendererError
        When the chosen renderer is not there.
    """

    def __init__(
        self, person: Identity, identities: Sequence[Identity], options: Options = Options()
    ) -> None:
        self.person, self.identities, self.options = person, list(identities), options
        self.watch = Watch()
        self.follower = PersonFollower(person.tracker, self.watch)
        self.guard = Guard()
        self._engines: dict[int, Engine] = {}
        self._puppets: dict[int, Puppet] = {}

    def step(self, frame: Frame, settings: Settings) -> Look:
        """Change a frame as the settings say; whatever happens, no face is left bare that was seen."""
        if settings.mode == "puppet":
            return self._puppet(frame, settings)
        self.watch.look(frame)
        fit = self.follower.step(frame.luma)
        confidence = self._trust(frame, fit)
        trusted = self.guard.trusts(frame, confidence)
        if settings.mode == "swap" and trusted and isinstance(fit, Fit):
            return self._swapped(frame, settings, fit, confidence)
        sight = self.guard.see(frame, fit, self.watch.boxes[0])
        if settings.uncovered and settings.mode == "swap":
            return Look("shown", None, confidence)
        return self._covered(frame, settings, sight, confidence)

    def close(self) -> None:
        """Release the compositors and the detector's thread."""
        for one in (*self._engines.values(), *self._puppets.values(), self.watch):
            one.close()

    def _swapped(self, frame: Frame, settings: Settings, fit: Fit, confidence: float) -> Look:
        """Draw the face, and cover others: before it, but who has just come is only seen when it is drawn."""
        alone = not self.guard.company
        mesh = self._engine(settings).draw(frame, fit.shape) if alone else None  # while the detector looks
        others = self.guard.see(frame, fit, self.watch.boxes[0]).others
        for box in others:
            cover(frame, box, settings.style)
        if mesh is None:
            mesh = self._engine(settings).draw(frame, fit.shape)
        return Look("swapped", mesh, confidence, len(others))

    def _covered(self, frame: Frame, settings: Settings, sight: Sight, confidence: float) -> Look:
        off = settings.mode == "off"
        if sight.place is None:
            cover_all(frame, settings.style)
            return Look("off" if off else "lost", None, confidence, 1)
        for box in (sight.place, *sight.others):
            cover(frame, box, settings.style)
        return Look("off" if off else "covered", None, confidence, 1 + len(sight.others))

    def _trust(self, frame: Frame, fit: Fit | Failed) -> float:
        return trust(self.person.tracker, frame.luma, fit.shape) if isinstance(fit, Fit) else 0.0

    def _engine(self, settings: Settings) -> Engine:
        if settings.identity not in self._engines:
            shown = self.identities[settings.identity]
            self._engines[settings.identity] = Engine(self.person, shown, None, self.options)
        engine = self._engines[settings.identity]
        if engine.extrapolator.alpha != settings.alpha:
            engine.extrapolator.alpha = settings.alpha
        return engine

    def _puppet(self, frame: Frame, settings: Settings) -> Look:
        if settings.identity not in self._puppets:
            shown = self.identities[settings.identity]
            self._puppets[settings.identity] = Puppet(self.person, shown, self.watch, self.options)
        puppet = self._puppets[settings.identity]
        if puppet.extrapolator.alpha != settings.alpha:
            puppet.extrapolator.alpha = settings.alpha
        self.watch.look(frame)
        _, picture = puppet.step(frame)
        fill(frame, picture.rgb())
        return Look("swapped", None, 1.0)


@dataclass(frozen=True, eq=False)
class Sight:
    """What would have to be covered in a frame: the region (4,) of the face (None: all of the picture), and others."""

    place: F64 | None
    others: list[F64]


class Guard:
    """Decides what must be covered, from what was seen up to now."""

    def __init__(self) -> None:
        self._box: F64 | None = None
        self._seen = self._doubted = -np.inf  # seconds
        self._others: list[tuple[float, F64]] = []

    @property
    def company(self) -> bool:
        """Whether somebody else was seen lately."""
        return bool(self._others)

    def trusts(self, frame: Frame, confidence: float) -> bool:
        """Whether the next frame's face may be drawn, found with a confidence: it must have held for a while."""
        now = float(frame.pts * frame.time_base)
        if confidence < TRUST:
            self._doubted = now
        return now - self._doubted >= AROUND

    def see(self, frame: Frame, fit: Fit | Failed, boxes: NDArray[np.float32]) -> Sight:
        """The same frame: where the tracker sees the person, and the detector's boxes."""
        now = float(frame.pts * frame.time_base)
        own = self._own(fit, boxes)
        if own is not None:
            self._box, self._seen = own, now
        gone = self._box is None or now - self._seen > WHOLE
        place = None if gone or self._box is None else region(self._box, 1 + GROWTH * (now - self._seen))
        return Sight(place, self._bystanders(now, boxes))

    def _own(self, fit: Fit | Failed, boxes: NDArray[np.float32]) -> F64 | None:
        """The box of the person's 68 points, or the detector's at the last place."""
        if isinstance(fit, Fit):
            inner = fit.shape[:68]
            return np.concatenate([inner.min(0), inner.max(0)])
        if self._box is None:
            return None
        near = [box for box in boxes if overlap(box, self._box.astype(np.float32)) > SAME]
        return near[0].astype(np.float64) if near else None

    def _bystanders(self, now: float, boxes: NDArray[np.float32]) -> list[F64]:
        others = [box.astype(np.float64) for box in boxes if not self._belongs(box)]
        kept = [
            (at, box)
            for at, box in self._others
            if now - at <= BYSTANDER and not any(overlap(box, other) > STILL for other in others)
        ]
        self._others = kept + [(now, box) for box in others]
        return [region(box) for _, box in self._others]

    def _belongs(self, box: NDArray[np.float32]) -> bool:
        """Whether a box lies on the person's face."""
        if self._box is None:
            return False
        centre = (box[:2] + box[2:]) / 2
        inside = bool((centre > self._box[:2]).all() and (centre < self._box[2:]).all())
        return inside or overlap(box, self._box.astype(np.float32)) > SAME


def fill(frame: Frame, rgb: NDArray[np.uint8]) -> None:
    """Show a picture (h, w, 3) instead of the frame's, as large as it fits, on black."""
    whole = letterboxed(rgb, frame.width, frame.height)
    frame.write_roi(0, 0, np.asarray(cv2.transform(whole, frame.colour.from_rgb), np.uint8))
