"""Expression transfer: the expressions of the person in a video on the identity's own head, in an enrolment frame.

The first of the two modes of de la Hunty, Asthana and Goecke (ICPR 2010).  Head and light stay those of the still; the
driver's head turns are removed from the shape, and the surroundings of the face are warped along with it, so that the
still's own chin never shows beside the moving one.  Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.landmarks import Landmarker
from guise.aam.landmarks.schemes import (
    FOREHEAD,
    JAW,
    LOWER_INNER_LIP,
    LOWER_LIP_BOTTOM,
    RIGID_WEIGHTS,
    UPPER_INNER_LIP,
    UPPER_LIP_TOP,
)
from guise.aam.model import Identity, RestFrame
from guise.aam.parameters import ParameterEstimator
from guise.aam.person_tracker import FaceFinder, PersonTracker
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import Failed, align_planar
from guise.aam.tracker import Fit
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import SwapResult
from guise.app.drawing.face import FaceInFrame, Seen
from guise.app.drawing.look import PUPPET, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.plan import Plan
from guise.app.enrolment.source_person import source_person
from guise.app.media import Frame, open_input, open_sink
from guise.app.media.synthetic import synthetic_tags
from guise.app.swapping.report import DEFAULTS, SwapReport, SwapSettings, Tally
from guise.app.swapping.session import ALONE, SwapSession, follow_alone
from guise.common.arrays import F32, F64, U8
from guise.common.closing import Closing
from guise.common.threads import one_thread
from guise.common.tuned import derived
from guise.render import make_compositor
from guise.render.compositor import Renderer

if TYPE_CHECKING:
    from guise.app.enrolment.landmark_source import LandmarkSource


@dataclass(frozen=True)
class PuppetLimits:
    """Sizes and rates of a puppet."""

    max_height_pixels: int = derived(1080, "pixels", "the height of full HD")  # of the output
    # that is taken at once; the rest follows
    new_expression_share: float = derived(0.6, "share", "a choice: the paper leaves it open")
    # around the face, warped along with it
    surroundings_face_widths: float = derived(0.55, "face widths", "a choice: the paper leaves it open")
    # fixed, around the surroundings
    surroundings_points: int = derived(28, "points", "a choice: the paper leaves it open")
    turn_noise_degrees: float = 1.0  # standard deviation of the measured head turn
    # of the pinned points in the fit of the pose
    pinned_weight: float = derived(0.03, "ratio", "a choice: the paper leaves it open")
    pose_ridge: float = derived(1e-6, "ratio", "far less than a weight, so that the system can be solved")


LIMITS = PuppetLimits()

# Points that belong to the skull, not to the expression: upper jaw and forehead.
PINNED_POINTS = np.zeros(POINTS, bool)
PINNED_POINTS[[*JAW[:4], *JAW[-4:], *FOREHEAD]] = True


class Puppet(Closing):
    """Draws the identity's still with the expression of a driver, frame by frame; use it by `with`.

    As an `Engine`, but a frame of the driver becomes one of the still, whose size it has.

    Parameters
    ----------
    source : Identity of the driver.
    target : Identity whose still moves.
    finder, landmarker : find and follow the driver's face, see `PersonTracker`.
    look : Look.
    """

    def __init__(
        self,
        source: Identity,
        target: Identity,
        finder: FaceFinder | None,
        look: Look = PUPPET,
        landmarker: Landmarker | None = None,
    ) -> None:
        source = source.at_resolution(target.reference.resolution)
        self.plan = Plan.of(source, Donor.of(target), look)
        self.memory = Memory()
        self.tracker = PersonTracker(source.tracker, finder, landmarker=landmarker, rest=source.rest_frame)
        self._still = fitted(target.rest_frame)
        self._pose = PoseRemover(target.reference)
        self._neutral = source.appearance.neutral_parameters
        self._unturned = self._pose.from_parameters(source.appearance)
        self._rest = self._shape(self.plan.texture.extrapolator.apply(source.appearance.neutral_parameters))
        fit = align_planar(target.appearance.neutral_shape, self._still.shape, RIGID_WEIGHTS)
        self._linear, self.zoom = fit.linear, fit.scale
        self._surroundings = Surroundings(self._still, look.renderer)
        self._appearance = np.array(target.appearance.neutral, np.float32)  # a copy: it moves
        self._see_still(target)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        height, width = self._still.picture.shape[:2]
        return width, height

    def track(self, frame: Frame) -> Fit | Failed:
        """Where the driver is in the next frame; may run ahead of `swap_tracked` in another thread."""
        return self.tracker.update(frame.luma)

    def swap(self, frame: Frame) -> SwapResult:
        """Show the still with the expression of the driver's frame in it; the last one where the driver is lost."""
        return self.swap_tracked(frame, self.track(frame))

    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> SwapResult:
        """As `swap` where `track` has found the driver in the frame."""
        if isinstance(fit, Fit):
            self._follow(frame, fit)
        mesh = self.mesh(self._appearance)
        picture = self._surroundings.around(mesh)
        self._draw(picture, mesh, self._appearance)
        frame.show(picture)
        return SwapResult("swapped" if isinstance(fit, Fit) else "held", fit, mesh)

    def rest(self, frame: Frame) -> None:
        """Show the still as it is."""
        frame.show(self._still.picture)

    def mesh(self, appearance: F32) -> F64:
        """The face (81, 2) in the still's pixels for an appearance."""
        moved = self._pose.without(self._shape(appearance) - self._rest)
        moved[PINNED_POINTS] = 0
        return uncrossed(self._still.shape + moved @ self._linear)

    @property
    def alpha(self) -> float:
        """Share in [0, 1] of the expression outside the identity's own space; setting it costs."""
        return self.plan.texture.alpha

    @alpha.setter
    def alpha(self, value: float) -> None:
        self.plan.texture.alpha = value

    @property
    def renderer(self) -> str:
        """What draws the face, for the user."""
        return self.plan.blend.renderer

    def close(self) -> None:
        """Release the compositors."""
        self.plan.blend.close()
        self._surroundings.close()

    def _follow(self, frame: Frame, fit: Fit) -> None:
        """Move towards the expression of the driver."""
        texture = self.plan.texture
        texels = frame.sample_rgb(texture.estimator.sampler.positions(fit.shape))
        expression = self._unturned @ (texture.estimator(fit.shape, texels) - self._neutral)
        seen = texture.extrapolator.apply(self._neutral + expression)
        self._appearance += np.float32(LIMITS.new_expression_share) * (seen - self._appearance)

    def _draw(self, picture: U8, mesh: F64, appearance: F32, seen: Seen | None = None) -> None:
        """Draw the face on a picture, in place; it has no time, so that its grain stays."""
        frame = Frame(picture, pts=0, time_base=Fraction(1), index=0)
        face = FaceInFrame(frame, mesh, mesh, mesh=mesh, zoom=self.zoom, seen=seen or Seen())
        face.canvas.texture = appearance[SHAPE_ENTRIES:].reshape(-1, 3)
        for step in (*self.plan.placing, *self.plan.drawing):
            step(face, self.memory)

    def _shape(self, appearance: F32) -> F64:
        frame = self.plan.donor.reference
        return appearance[:SHAPE_ENTRIES].reshape(POINTS, 2).astype(np.float64) / frame.shape_weight

    def _see_still(self, target: Identity) -> None:
        """Measure the light of the still, and how sharp it is, on a copy."""
        picture, own = self._still.picture.copy(), ParameterEstimator(target.appearance)
        places = own.sampler.positions(self._still.shape)
        rgb = Frame.from_rgb(picture).sample_rgb(places)
        self._draw(picture, self._still.shape, target.appearance.neutral, Seen(places, rgb, rgb))


class PoseRemover:
    """Removes head pose from appearance parameters and from displacements of landmarks.

    The pose is fitted to the points that expression doesn't move: shift, scale and roll, and yaw and pitch through the
    depth that the reference frame's yaw mode shows.

    Parameters
    ----------
    frame : ReferenceFrame.

    Attributes
    ----------
    depth : (81,) grid pixels by which each point moves as the head turns by one degree.
    """

    def __init__(self, frame: ReferenceFrame) -> None:
        self.depth = depth = frame.yaw_mode[:, 0] - np.average(frame.yaw_mode[:, 0], weights=RIGID_WEIGHTS)
        x, y = (frame.points - frame.points.mean(0)).T
        zero, one = np.zeros(POINTS), np.ones(POINTS)
        columns = [(one, zero), (zero, one), (x, y), (-y, x), (depth, zero), (zero, depth)]
        modes = np.stack([np.column_stack(c).ravel() for c in columns], axis=1)
        self._degree = float(np.linalg.norm(frame.yaw_mode[:, 0]))
        self._modes = modes / np.linalg.norm(modes, axis=0)
        weights = np.repeat(RIGID_WEIGHTS + LIMITS.pinned_weight * PINNED_POINTS, 2)
        weighted = self._modes * weights[:, None]
        self._solve = np.linalg.solve(
            weighted.T @ self._modes + LIMITS.pose_ridge * np.eye(len(columns)), weighted.T
        )

    def from_parameters(self, model: AppearanceModel) -> F32:
        """(k, k) matrix that removes what yaw and pitch predict from parameters, measured from the neutral ones.

        With rho of covariance D and turns A^T rho, known to within `turn_noise_degrees`, it is
        I - D A (A^T D A + noise)^-1 A^T.
        """
        shapes = model.components.basis[:SHAPE_ENTRIES].astype(np.float64) / model.reference.shape_weight
        turns = (self._solve[4:] @ shapes).T
        spread = (model.components.deviations.astype(np.float64) ** 2)[:, None] * turns
        known = turns.T @ spread + (LIMITS.turn_noise_degrees * self._degree) ** 2 * np.eye(2)
        return (np.eye(len(turns)) - spread @ np.linalg.solve(known, turns.T)).astype(np.float32)

    def angles(self, displacement: F64) -> tuple[float, float]:
        """Degrees by which a displacement (81, 2), grid pixels, turns the head to the image right and down."""
        right, down = self._solve[4:] @ displacement.ravel() / self._degree
        return float(right), float(down)

    def without(self, displacement: F64) -> F64:
        """A displacement (81, 2), grid pixels, without its pose."""
        flat = displacement.ravel()
        return np.asarray((flat - self._modes @ (self._solve @ flat)).reshape(POINTS, 2))


class Surroundings:
    """The still with the surroundings of the face warped along with it; far from the face it stays as it is.

    Parameters
    ----------
    still : picture and landmarks.
    renderer : "auto", "gl" or "cpu".
    """

    def __init__(self, still: RestFrame, renderer: Renderer) -> None:
        from scipy.spatial import Delaunay

        self._picture = still.picture
        points = np.concatenate([still.shape, _ring(still.shape)])
        height, width = still.picture.shape[:2]
        x0, y0 = np.maximum(np.floor(points.min(0)).astype(int) - 1, 0)
        x1, y1 = np.minimum(np.ceil(points.max(0)).astype(int) + 2, (width, height))
        self._corner, self._roi = np.array([x0, y0]), np.s_[y0:y1, x0:x1]
        self._ring = points[POINTS:] - self._corner
        uv = np.clip(points - self._corner, 0, (x1 - x0 - 1, y1 - y0 - 1))
        self._texture = np.ascontiguousarray(still.picture[self._roi])
        self._compositor = make_compositor(
            renderer,
            Delaunay(points).simplices.astype(np.int32),
            uv.astype(np.float32),
            np.ones(self._texture.shape[:2], np.float32),
        )

    def around(self, mesh: F64) -> U8:
        """A new picture of the still in which the face's landmarks lie at `mesh` (81, 2)."""
        picture = self._picture.copy()
        roi = picture[self._roi]
        vertices = np.concatenate([mesh - self._corner, self._ring])
        self._compositor.composite(roi, self._texture, vertices, out=roi)
        return picture

    def close(self) -> None:
        """Release the compositor."""
        self._compositor.close()


def _ring(shape: F64) -> F64:
    """`surroundings_points` (n, 2) on an ellipse around the face."""
    centre, half = (shape.min(0) + shape.max(0)) / 2, np.ptp(shape, axis=0) / 2
    reach = half + LIMITS.surroundings_face_widths * np.ptp(shape[:, 0])
    turn = np.linspace(0, 2 * np.pi, LIMITS.surroundings_points, endpoint=False)
    return np.asarray(centre + reach * np.column_stack([np.cos(turn), np.sin(turn)]))


def uncrossed(mesh: F64) -> F64:
    """A face (81, 2) whose inner lips meet where the upper one would be below the lower one."""
    down = mesh[LOWER_LIP_BOTTOM] - mesh[UPPER_LIP_TOP]
    gap = (mesh[LOWER_INNER_LIP] - mesh[UPPER_INNER_LIP]) @ down / max(float(down @ down), 1e-9)
    out = mesh.copy()
    overlap = np.minimum(gap, 0)[:, None] * down / 2
    out[UPPER_INNER_LIP] += overlap
    out[LOWER_INNER_LIP] -= overlap
    return out


def fitted(still: RestFrame) -> RestFrame:
    """The still with an even size and at most `max_height_pixels` high, and its landmarks."""
    height, width = still.picture.shape[:2]
    factor = min(1.0, LIMITS.max_height_pixels / height)
    size = [max(2, 2 * round(side * factor / 2)) for side in (width, height)]
    if size == [width, height]:
        return still
    scale = np.array(size) / (width, height)
    how = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
    picture = np.asarray(cv2.resize(still.picture, size, interpolation=how), np.uint8)
    return RestFrame(picture, (still.shape + 0.5) * scale - 0.5)


def puppet_file(
    video: Path, identity: Identity, output: Path, *, source: Identity | LandmarkSource,
    settings: SwapSettings = DEFAULTS,
) -> SwapReport:  # fmt: skip
    """Write the identity's still moved by the expressions in `video`.

    Parameters and errors as for `guise.app.swapping.file.swap_file`; `held` counts frames that keep the last
    expression.
    """
    height, width = fitted(identity.rest_frame).picture.shape[:2]
    with open_input(video, settings.hwaccel, settings.read) as media:
        tags = synthetic_tags(identity.facts.get("made_from"))
        with open_sink(
            output, media, settings.encode, force=settings.force, tags=tags, size=(width, height)
        ) as sink:
            person = source_person(media, source, identity, settings)
            tally, asked = Tally(settings, media, "moving"), settings.look
            look = replace(PUPPET, alpha=asked.alpha, renderer=asked.renderer, exact=asked.kind == "paper")
            with (
                one_thread(),
                SwapSession(lambda _: Puppet(person, identity, settings.face_finder(), look)) as session,
            ):
                stats = follow_alone(
                    session, media, sink, tally.add, tally.progress, settings.drawn,
                    lambda frame: session.engine(ALONE).rest(frame),
                )  # fmt: skip
                tally.require_some(person.name)
                tally.faces, tally.renderer = session.engine(ALONE).tracker.most_faces, session.renderer
        return tally.report(output, stats, sink.first_packet)
