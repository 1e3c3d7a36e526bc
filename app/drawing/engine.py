"""The engine: from a frame of one person to the same frame with another face, in place.

For each pass of the plan, run it (the way of a frame, docs/conventions.md).  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from guise.aam.landmarks import Face as FoundFace
from guise.aam.model import Identity
from guise.aam.person_tracker import FaceFinder, PersonTracker
from guise.aam.similarity import Failed
from guise.aam.solid_shape import HeadPose, SolidFit, SolidTracker, pulled
from guise.aam.tracker import Fit
from guise.app.drawing.donor import Donor
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.look import SWAP, Look
from guise.app.drawing.memory import SLACK, Drawn, Memory
from guise.app.drawing.plan import Plan
from guise.app.media import Frame
from guise.common.arrays import F32, F64
from guise.common.closing import Closing
from guise.common.small import ramp
from guise.common.tuned import tuned

# of yaw, below which a swap begins again and above which it ends
PROFILE_DEGREES = tuned((71.0, 74.0), "degrees", "picture.turned")
# of yaw, over which a cover comes in, if one is wanted
DOUBT_DEGREES = tuned((66.0, PROFILE_DEGREES[0]), "degrees", "picture.turned")

Outcome = Literal["swapped", "held", "lost"]


@dataclass(frozen=True, eq=False)
class SwapResult:
    """What happened to a frame: outcome, the fit or why there is none, and the mesh that was drawn (81, 2).

    doubt : share in [0, 1] by which the head is turned too far for the drawn face to look right.
    """

    outcome: Outcome
    fit: Fit | Failed
    mesh: F64 | None = None
    doubt: float = 0.0


class Engine(Closing):
    """Draws `target` over `source`, frame by frame; use it by `with`, as it holds compositors.

    Parameters
    ----------
    source : Identity of the person in the video.
    target : Donor whose face is shown.
    finder : finds the face at the start and after a loss, see `PersonTracker`.
    look : Look.

    Raises
    ------
    ReferenceMismatchError
        When the two don't share a reference frame.
    RendererError
        When the chosen renderer isn't available.
    """

    def __init__(self, source: Identity, target: Donor, finder: FaceFinder | None, look: Look = SWAP) -> None:
        self.plan = plan = Plan.of(source, target, look)
        self._finder = finder
        self.solid = SolidTracker(plan.rest)
        self.memory = Memory()
        self._in_profile, self._doubt = False, 0.0

    @cached_property
    def tracker(self) -> PersonTracker:
        """Finds the person in a video's frames."""
        person = self.plan.person
        return PersonTracker(person.tracker, self._finder, rest=person.rest_frame)

    def swap(self, frame: Frame) -> SwapResult:
        """Swap the face in a frame, in place; a frame in which the person is lost stays as it is.

        For the look's `hold_seconds` after a loss the last face is held where it was.
        """
        return self.swap_tracked(frame, self.track(frame))

    def follow(self, frame: Frame, face: FoundFace | None) -> Fit | Failed:
        """Where the person is in the next frame, as somebody else has found it, or that they are not in it.

        Of a person who is known from a photo alone, this is all that tells.
        """
        if face is not None and not self.is_tracked:
            return Fit(face.points.astype(np.float64), np.zeros(0), 0.0, face.confidence)
        return self.tracker.follow(frame.luma, face) if self.is_tracked else Failed("no face there")

    @property
    def is_tracked(self) -> bool:
        """Whether the person's model tells them from others."""
        return len(self.plan.person.tracker.pixels) > 0

    def track(self, frame: Frame) -> Fit | Failed:
        """Where the person is in the next frame; may run ahead of `swap_tracked` in another thread."""
        return self.tracker.update(frame.luma)

    def swap_face(self, frame: Frame, face: FoundFace | None) -> SwapResult:
        """As `swap` where a tracker of several people has found the person's face, or that it isn't in the frame."""
        return self.swap_tracked(frame, self.follow(frame, face))

    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> SwapResult:
        """As `swap` where `track` has found the person in the frame."""
        if isinstance(fit, Fit):
            solid = self.solid.update(fit.shape)
            if not self._is_profile(solid.pose):
                self._doubt = self._doubted(solid.pose)
                return SwapResult("swapped", fit, self._drawn(frame, fit.shape, solid), self._doubt)
            fit = Failed("the head is turned too far")
        memory, last = self.memory, self.memory.drawn
        memory.clock.tick(frame)
        if last is not None and memory.clock.now <= last.time + self.plan.look.hold_seconds + SLACK:
            face = FaceInFrame(frame, last.head, last.head, sight=last.sight, shape=last.shape)
            face.canvas.texture = last.texture
            return SwapResult("held", fit, self._paint(face), self._doubt)
        self.reset()
        return SwapResult("lost", fit)

    def draw(self, frame: Frame, shape: F64) -> F64:
        """Swap the face that lies at a shape (81, 2) in a frame, in place; returns the mesh that was drawn (81, 2)."""
        return self._drawn(frame, shape, self.solid.update(shape))

    def reset(self) -> None:
        """Begin with a new face."""
        self.memory = Memory()

    def _drawn(self, frame: Frame, shape: F64, solid: SolidFit) -> F64:
        memory, found = self.memory, shape if self.plan.rest is None else pulled(shape, solid)
        memory.clock.tick(frame)
        if memory.drawn is None:  # what is measured after drawing is measured on a copy of the first frame
            self._run(FaceInFrame(frame.copy(), found, found, solid.pose))
        face = FaceInFrame(frame, found, found, solid.pose)
        self._run(face)
        memory.drawn = Drawn(memory.clock.now, face.head, face.sight, face.shape, face.canvas.texture)
        return face.mesh

    def _run(self, face: FaceInFrame) -> None:
        for step in self.plan.seeing:
            step(face, self.memory)
        self._paint(face)

    def _paint(self, face: FaceInFrame) -> F64:
        for step in self.plan.placing:
            step(face, self.memory)
        if not face.canvas.is_outside:
            for step in self.plan.drawing:
                step(face, self.memory)
        return face.mesh

    def _is_profile(self, pose: HeadPose) -> bool:
        """Whether a head is turned farther than a swap looks right, with hysteresis."""
        if self.plan.rest is not None:
            self._in_profile = abs(pose.angles[0]) > PROFILE_DEGREES[not self._in_profile]
        return self._in_profile

    def _doubted(self, pose: HeadPose) -> float:
        """Share in [0, 1] by which a head is turned too far."""
        if self.plan.rest is None:
            return 0.0
        return ramp(abs(pose.angles[0]), *DOUBT_DEGREES)

    @property
    def alpha(self) -> float:
        """Share in [0, 1] of the expression outside the donor's own space; setting it costs."""
        return self.plan.texture.alpha

    @alpha.setter
    def alpha(self, value: float) -> None:
        self.plan.texture.alpha = value

    @property
    def uncovered(self) -> F32 | None:
        """(h, w) share in [0, 1] of the last drawn face that nothing hid, on the reference grid; None is all of it."""
        return self.memory.cover.uncovered

    @property
    def renderer(self) -> str:
        """What draws the face, for the user."""
        return self.plan.blend.renderer

    def close(self) -> None:
        """Release the compositors."""
        self.plan.blend.close()
