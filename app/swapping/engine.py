"""The engine: from a frame of one person to the same frame with another face, in place.

fit -> parameters -> extrapolation -> pose and palette -> warp -> blend, in the frame's own YUV planes
(the way of a frame, docs/conventions.md).  Pixels, x right, y down; RGB 0..255 unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.brows import BrowFollower, BrowLift
from guise.aam.even_light import evenly_lit
from guise.aam.extrapolation import Extrapolator
from guise.aam.landmarks import Face
from guise.aam.landmarks.schemes import RIGID_WEIGHTS
from guise.aam.lid_closing import LidCloser
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.person_tracker import FaceFinder, PersonTracker
from guise.aam.relief import STRAIGHT
from guise.aam.shape_transfer import ShapeTransfer
from guise.aam.similarity import Failed, align_planar
from guise.aam.skin_tone import toned
from guise.aam.solid_shape import HeadPose, SolidFit, SolidTracker, pulled
from guise.aam.tracker import Fit
from guise.aam.turned_texture import completed, moving_share
from guise.aam.view_prior import SideViews
from guise.aam.without_glasses import without_glasses
from guise.app.media import Frame
from guise.app.swapping.forehead import Forehead
from guise.app.swapping.occlusion import Occlusion
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.painter import Painter
from guise.app.swapping.silhouette import View
from guise.common.arrays import F32, F64
from guise.common.closing import Closing

MAX_TEXTURE_DEVIATIONS = 4.0  # of the target's modes of appearance
PROFILE_DEGREES = (71.0, 74.0)  # of yaw, below which a swap begins again and above which it ends
TEXTURE_TURN_DEGREES = (
    12.0,
    28.0,
)  # from how either was enrolled: from where texture moves less, and where not at all

DOUBT_DEGREES = (66.0, 71.0)  # of yaw, over which a cover comes in, if one is wanted

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
    target : Identity whose face is shown.
    finder : finds the face at the start and after a loss, see `PersonTracker`.
    options : EngineOptions.

    Raises
    ------
    ReferenceMismatchError
        When the two don't share a reference frame.
    RendererError
        When the chosen renderer isn't available.
    """

    def __init__(
        self,
        source: Identity,
        target: Identity,
        finder: FaceFinder | None,
        options: EngineOptions = EngineOptions(),
    ) -> None:
        source = source.at_resolution(target.reference.resolution)
        full = options.transfer == "full"
        moving = moving_share(target) if full else None
        if full:
            target = evenly_lit(completed(without_glasses(target)))
            target = toned(target, source, own_lips=not options.disguise)
        self.source, self.target, self.options = source, target, options
        self.extrapolator = Extrapolator(
            source.appearance,
            target.appearance,
            options.alpha,
            max_deviations=MAX_TEXTURE_DEVIATIONS if full else None,
            moving=moving,
        )
        self.estimator = ParameterEstimator(source.appearance)
        self.tracker = PersonTracker(source.tracker, finder, rest=source.rest_frame)
        self.occlusion = _occlusion(source, self.estimator, options)
        self.painter = Painter(source, target, self.estimator, options, self.occlusion)
        self._sampler = self.painter.sampler(self.estimator.texels)
        self._shape_transfer = (
            ShapeTransfer(
                source.appearance.neutral_shape,
                target.appearance.neutral_shape,
                source.reference,
                outline=options.outline if options.follows_outline else 0.0,
                still=(source.knows_rest, target.knows_rest),
            )
            if full
            else None
        )
        self._normals = (
            None if self._shape_transfer is None else self.painter.relief.normals(self._shape_transfer.solid)
        )
        self._sides = SideViews.of(target, self._shape_transfer.target.rest) if self._shape_transfer else None
        self._enrolled = self._enrolled_across()
        self.solid = SolidTracker(None if self._shape_transfer is None else self._shape_transfer.source)
        self._in_profile, self._missed_frames, self._doubt = False, 0, 0.0
        self._brows = BrowFollower(source.appearance) if full else None
        self._lift, self._lids = BrowLift(), LidCloser()
        self._last: tuple[F64, F32, View | None] | None = None

    def _enrolled_across(self) -> F64:
        """(2,) grid pixels by which depth is seen elsewhere in the target's texture at rest, see `View`."""
        if self._shape_transfer is None:
            return STRAIGHT
        seen, points = self.target.appearance.neutral_shape, self.target.reference.points
        to_grid = align_planar(seen, points, RIGID_WEIGHTS)
        return np.asarray(self._shape_transfer.target.pose.linear[2] @ to_grid.linear)

    def swap(self, frame: Frame) -> SwapResult:
        """Swap the face in a frame, in place; a frame in which the person is lost stays as it is.

        For `hold_frames` frames after a loss the last face is held where it was.
        """
        return self.swap_tracked(frame, self.track(frame))

    def track(self, frame: Frame) -> Fit | Failed:
        """Where the person is in the next frame; may run ahead of `swap_tracked` in another thread."""
        return self.tracker.update(frame.luma)

    def swap_face(self, frame: Frame, face: Face | None) -> SwapResult:
        """As `swap` where a tracker of several people has found the person's face, or that it isn't in the frame."""
        return self.swap_tracked(frame, self.tracker.follow(frame.luma, face))

    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> SwapResult:
        """As `swap` where `track` has found the person in the frame."""
        if isinstance(fit, Fit):
            solid = self.solid.update(fit.shape)
            if not self._is_profile(solid.pose):
                self._missed_frames = 0
                self._doubt = self._doubted(solid.pose)
                return SwapResult("swapped", fit, self._drawn(frame, fit.shape, solid), self._doubt)
            fit = Failed("the head is turned too far")
        self._missed_frames += 1
        if self._last is not None and self._missed_frames <= self.options.hold_frames:
            head, appearance, view = self._last
            mesh = self.painter.paint(frame, head, appearance, None, view)
            return SwapResult("held", fit, mesh, self._doubt)
        self._last = None
        if self._brows is not None:
            self._brows.reset()
        self._lift.reset()
        self._lids.reset()
        self.painter.reset()
        return SwapResult("lost", fit)

    def _is_profile(self, pose: HeadPose) -> bool:
        """Whether a head is turned farther than a swap looks right, with hysteresis."""
        if self._shape_transfer is not None:
            self._in_profile = abs(pose.angles[0]) > PROFILE_DEGREES[not self._in_profile]
        return self._in_profile

    def _doubted(self, pose: HeadPose) -> float:
        """Share in [0, 1] by which a head is turned too far."""
        if self._shape_transfer is None:
            return 0.0
        return float(np.interp(abs(pose.angles[0]), DOUBT_DEGREES, (0, 1)))

    def draw(self, frame: Frame, shape: F64) -> F64:
        """Swap the face that lies at a shape (81, 2) in a frame, in place; returns the mesh that was drawn (81, 2)."""
        return self._drawn(frame, shape, self.solid.update(shape))

    def _drawn(self, frame: Frame, shape: F64, solid: SolidFit) -> F64:
        if self._shape_transfer is not None:
            shape = pulled(shape, solid)
        found = shape
        if self._brows is not None:
            if self.occlusion is not None and not self._lift.has_seen:
                self.occlusion.update(frame, shape)
                self._see(shape)
            shape = self._brows.corrected(frame.luma, self._lift(shape))
        view = self.view(shape, solid)
        places = self.places(shape, view)
        texels = frame.sample_rgb(places)
        parameters = self.estimator(shape, self.clear(frame, shape, places, texels))
        if self._brows is not None:
            self._see(found)
            shape = self._lids(shape)
        appearance = self.synthesise(parameters, shape, solid)
        self._last = shape, appearance, view
        return self.painter.paint(frame, shape, appearance, texels, view)

    @property
    def uncovered(self) -> F32 | None:
        """(h, w) share in [0, 1] of the last drawn face that nothing hid, on the reference grid; None is all of it."""
        return None if self.occlusion is None else self.occlusion.last_uncovered

    def _see(self, shape: F64) -> None:
        """Look at brows and lids of a shape (81, 2) as it was tracked, if the last frame was parsed."""
        parsing = None if self.occlusion is None else self.occlusion.parsing
        if parsing is not None:
            self._lift.see(parsing, shape)
            self._lids.see(parsing, shape)

    def view(self, shape: F64, solid: SolidFit) -> View | None:
        """How the target's face is seen where the source's lies at a shape (81, 2); None with the transfer "paper"."""
        if self._shape_transfer is None or self._normals is None:
            return None
        enrolled = self._enrolled @ align_planar(self.source.reference.points, shape, RIGID_WEIGHTS).linear
        at_rest = self._shape_transfer.at_rest(shape, solid.pose)
        return View.of(self._normals, solid.pose, enrolled, at_rest)

    def places(self, shape: F64, view: View | None) -> F32:
        """(t, 2) pixels, where the texels of a face at a shape (81, 2) lie."""
        if view is None or not view.across.any():
            return self.estimator.sampler.positions(shape)
        return self._sampler.positions(self.painter.relief.seen(shape, view.across))

    def clear(self, frame: Frame, shape: F64, places: F32, texels: F32) -> F32:
        """The frame's RGB (t, 3) at texels at places (t, 2), without what hides the face at a shape (81, 2)."""
        if self.occlusion is None:
            return texels
        self.occlusion.update(frame, shape, places, texels if self.options.follows_eyes else None)
        return self.occlusion.cleared(texels)

    def synthesise(self, parameters: F32, shape: F64, solid: SolidFit) -> F32:
        """The target's appearance (162 + 3 n,) for the source's parameters (k,), and their shape (81, 2) as tracked."""
        appearance = self.extrapolator.apply(parameters, self._texture_share(solid.pose))
        if self._shape_transfer is not None:
            moved = self._shape_transfer.apply(shape, solid.pose) * self.target.reference.shape_weight
            appearance[:SHAPE_ENTRIES] = moved.ravel()
            self._turn(appearance[SHAPE_ENTRIES:].reshape(-1, 3), solid.pose)
        return appearance

    def _turn(self, texture: F32, pose: HeadPose) -> None:
        """Make of a texture (n, 3), in place, what the target's looks like from the side."""
        if self._sides is not None and self._shape_transfer is not None:
            yaw = pose.angles[0] - self._shape_transfer.target.pose.angles[0]
            cv2.multiply(texture, cv2.merge([self._sides.at(yaw)] * 3).reshape(texture.shape), dst=texture)

    def _texture_share(self, pose: HeadPose) -> float:
        """Share of the texture's movement that is shown: of a turned head it is its turn, not its expression."""
        if self._shape_transfer is None:
            return 1.0
        known = self._shape_transfer.source.pose, self._shape_transfer.target.pose
        turn = max(pose.turn_from(one) for one in known)
        return float(np.interp(turn, TEXTURE_TURN_DEGREES, (1, 0)))

    def close(self) -> None:
        """Release the compositors."""
        self.painter.close()


def _occlusion(source: Identity, estimator: ParameterEstimator, options: EngineOptions) -> Occlusion | None:
    """What hides the source's face and stays in front of the drawn one."""
    if options.in_front == "none":
        return None
    beyond = Forehead.of(source.reference, options.forehead).added if options.disguise else None
    only_objects = options.in_front == "objects"
    return Occlusion(source.reference, estimator.sampler, only_objects=only_objects, beyond=beyond)
