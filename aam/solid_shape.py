"""The 81 points of a face in 3-D, and the turn of a head found from them.

A linear model learnt from rendered people (`training/solid_shape.py`): solid shape = mean + identity + movement, seen
by scaled orthography.  A fit finds pose, identity and movement that explain 81 points best, points that lie far off
counting less (Xiao, Baker, Matthews and Kanade, Real-time combined 2D+3D active appearance models, CVPR 2004, section
4, with their modes found from 3-D data).  Face widths, x to the image's right, y down, z away from the viewer.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.schemes import EYES_AND_LIPS, RIGID_WEIGHTS
from guise.aam.reference import POINTS, ReferenceFrame
from guise.common.arrays import F32, F64, I32
from guise.common.kernels import kernel
from guise.common.small import lengths, mean, ramp

DATA = Path(__file__).parent / "data" / "solid_shape.npz"

PULL_DEGREES = (10.0, 30.0)  # of turn, between which points begin to be drawn to the solid shape
# Share of the way to the solid shape of a turned head: eyes and lips do more than its movements know.
PULL: F64 = np.full(POINTS, 0.35)
PULL[EYES_AND_LIPS] = 0.25
PULL.setflags(write=False)
_UPRIGHT: F64 = np.eye(3)
DEPTH_DEGREES = (8.0, 22.0)  # of turn, between which depth comes in: poses are noisy


@dataclass(frozen=True)
class SolidLimits:
    """Steps and thresholds of the fit."""

    first_steps: int = 6  # without a start
    next_steps: int = 2  # from the frame before
    max_step_face_widths: float = 0.25  # mean way of the points from one frame to the next
    outlier_deviations: float = 3.0  # of the noise, from which a point counts half
    memory_frames: int = 60  # over which a person's identity is averaged
    remembered_deviation: float = 0.25  # of an identity that is known from many frames
    still_deviation: float = 1e-3  # of the movement of a face that is known to be at rest


LIMITS = SolidLimits()
STRAIGHT: F64 = np.zeros(2)  # what is seen of depth from the front
STRAIGHT.setflags(write=False)


@dataclass(frozen=True, eq=False)
class HeadPose:
    """How a head is turned and where it is seen: x -> scale * (rotation x)[:2] + translation.

    Parameters
    ----------
    rotation : (3, 3), of the head looking straight at the camera.
    scale : pixels a face width.
    translation : (2,) pixels.
    """

    rotation: F64
    scale: float
    translation: F64

    @cached_property
    def angles(self) -> tuple[float, float, float]:
        """Yaw to the image's right, pitch up and roll to the image's right, degrees."""
        r = self.rotation
        yaw = np.arcsin(np.minimum(np.maximum(r[2, 0], -1), 1))
        pitch, roll = -np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
        return float(np.degrees(yaw)), float(np.degrees(pitch)), float(np.degrees(roll))

    @cached_property
    def turn(self) -> float:
        """Degrees from looking straight at the camera; roll doesn't count."""
        return _degrees(self.rotation[2, 2])

    def turn_from(self, other: HeadPose) -> float:
        """Degrees between the directions in which two heads look; roll doesn't count."""
        return _degrees(self.rotation[2] @ other.rotation[2])

    @cached_property
    def linear(self) -> F64:
        """(3, 2) for rows: solid differences (n, 3) are seen as differences @ linear, pixels."""
        return self.scale * self.rotation[:2].T

    def apply(self, solid: F64) -> F64:
        """Where solid points (n, 3) are seen (n, 2), pixels."""
        return solid @ self.linear + self.translation


@dataclass(frozen=True, eq=False)
class SolidFit:
    """A solid shape seen in a picture.

    Parameters
    ----------
    pose : HeadPose.
    identity, movement : (k,) standard deviations of the modes.
    rest, solid : (81, 3) face widths, of the person at rest and as seen.
    """

    pose: HeadPose
    identity: F64
    movement: F64
    rest: F64
    solid: F64

    @cached_property
    def points(self) -> F64:
        """(81, 2) pixels, where the solid shape is seen."""
        return self.pose.apply(self.solid)


@dataclass(frozen=True, eq=False)
class SolidPrior:
    """What is known of all faces.

    Parameters
    ----------
    mean : (81, 3) face at rest.
    identity, movement : (k, 81, 3) modes, one standard deviation long.
    noise : (81,) standard deviation of found points, per axis.
    """

    mean: F64
    identity: F64
    movement: F64
    noise: F64
    _modes: F64 = field(init=False)

    def __post_init__(self) -> None:
        """Both kinds of modes in one array."""
        object.__setattr__(self, "_modes", np.concatenate([self.identity, self.movement]))

    @classmethod
    def shipped(cls) -> SolidPrior:
        """The prior that ships with the package."""
        return _shipped()

    def of_person(self, rest: SolidFit) -> SolidPrior:
        """What is known of the faces of one person, who is at rest as a fit says."""
        return replace(self, mean=rest.rest, identity=self.identity[:0])

    def at_rest(self, identity: F64) -> F64:
        """(81, 3) of a person with identity (k,), at rest."""
        return _moved(self.mean, identity, self.identity)

    def rest_of(self, points: F64, *, still: bool = False) -> SolidFit:
        """Who is seen at points (81, 2), without movement.

        What neither identity nor movement explains belongs to the shape too, the less the more a point is turned away.

        still : the face is known to be at rest there, so that nothing is taken for movement.
        """
        fit = self.fit(points, still=still)
        across = np.linalg.inv(fit.pose.linear[:2])
        seen, frontal = (facing(fit.rest, turn) for turn in (fit.pose.rotation, np.eye(3)))
        left = np.clip(seen / frontal, 0, 1)[:, None] * (points - fit.points)
        rest = np.column_stack([fit.rest[:, :2] + left @ across, fit.rest[:, 2]])
        return replace(fit, movement=np.zeros_like(fit.movement), rest=rest, solid=rest)

    def rough_pose(self, points: F64) -> HeadPose:
        """The pose of the mean face at points (81, 2), pixels; within about 10 degrees of that of a fit."""
        return _first_pose(self.mean, points, self._mean_lever)

    @cached_property
    def _mean_lever(self) -> F64:
        return _lever(self.mean)

    def fit(
        self, points: F64, start: SolidFit | None = None, known: F64 | None = None, deviation: float = 1.0,
        still: bool = False,
    ) -> SolidFit:  # fmt: skip
        """The likeliest solid shape seen at points (81, 2), pixels.

        start : of the frame before.
        known : (k,) the person's identity, of which each entry is sure within `deviation` standard deviations.
        still : see `rest_of`.
        """
        own = len(self.identity)
        middle, precision = np.zeros(len(self._modes)), np.empty(len(self._modes))
        if known is not None:
            middle[:own] = known
        precision[:own], precision[own:] = deviation**-2, LIMITS.still_deviation**-2 if still else 1
        if start is None:
            amounts, steps = middle.copy(), LIMITS.first_steps
            pose = _first_pose(self._solid(amounts), points)
        else:
            pose, steps = start.pose, LIMITS.next_steps
            amounts = np.concatenate([start.identity, start.movement])
        rotation, place = np.array(pose.rotation, order="C"), np.array([pose.scale, *pose.translation])
        solid = np.empty(self.mean.shape)
        solid_fit(
            np.ascontiguousarray(points, np.float64), self.mean, self._modes, self.noise, middle, precision, steps,
            LIMITS.outlier_deviations, rotation, place, amounts, solid,
        )  # fmt: skip
        pose = HeadPose(rotation, float(place[0]), place[1:])
        return SolidFit(pose, amounts[:own], amounts[own:], self.at_rest(amounts[:own]), solid)

    def _solid(self, amounts: F64) -> F64:
        return _moved(self.mean, amounts, self._modes)


@kernel
def solid_fit(
    points: F64, mean: F64, modes: F64, noise: F64, middle: F64, precision: F64, steps: int, outlier: float,
    rotation: F64, place: F64, amounts: F64, solid: F64,
) -> None:  # fmt: skip
    """Gauss-Newton steps on rotation, scale, translation and amounts, which are changed; the last shape is written.

    Parameters
    ----------
    points : (v, 2), pixels.
    mean, modes : (v, 3) and (k, v, 3), face widths.
    noise : (v,) standard deviation of points, face widths.
    middle, precision : (k,) likeliest amounts, and how sure each is, over its variance.
    steps : number of them.   outlier : deviations of the noise from which a point counts half.
    rotation, place, amounts : (3, 3); (3,) scale, pixels a face width, and translation, pixels; (k,).
    solid : (v, 3), face widths.
    """
    for _ in range(steps):
        turned = _moved(mean, amounts, modes) @ rotation.T
        scale, count = float(place[0]), len(points)
        away = points - scale * turned[:, :2] - place[1:]
        sigma = scale * noise
        far = np.add.reduce(away**2, 1) / (outlier * sigma) ** 2
        weight = 1 / (sigma * np.sqrt(1 + far))
        x, y, z = turned.T
        size = 6  # turns about x, y, z, scale and translation
        design = np.zeros((size + amounts.size, 2, count))
        design[0, 1], design[1, 0], design[2, 0], design[2, 1] = -z, z, -y, x
        design[:3] *= scale
        design[3] = x, y
        design[4, 0] = design[5, 1] = 1
        np.matmul(scale * rotation[:2], modes.transpose(0, 2, 1), out=design[size:])
        design *= weight
        flat = design.reshape(-1, 2 * count)
        normal, right = flat @ flat.T, flat @ (away.T * weight).ravel()
        diagonal = normal.reshape(-1)[:: right.size + 1]
        diagonal[:] += 1e-9
        diagonal[size:] += precision
        right[size:] -= precision * (amounts - middle)
        solved = cv2.solve(normal, right[:, None], flags=cv2.DECOMP_CHOLESKY)[1]
        step = np.asarray(solved, np.float64)[:, 0]
        rotation[:] = _turned(step[:3]) @ rotation
        place[0] = min(max(float(scale + step[3]), 0.5 * scale), 2 * scale)
        place[1:] += step[4:6]
        amounts += step[6:]
    solid[:] = _moved(mean, amounts, modes)


class SolidTracker:
    """Fits one person's solid shape frame by frame.

    person : SolidFit of the person at rest, see `SolidPrior.rest_of`; without one, their identity is learnt on the
        way, so that the pose is steady.
    """

    def __init__(self, person: SolidFit | None = None) -> None:
        shipped = SolidPrior.shipped()
        self.prior = shipped if person is None else shipped.of_person(person)
        self._identity: F64 | None = None
        self._frames = 0
        self._last: SolidFit | None = None

    def update(self, points: F64) -> SolidFit:
        """The solid shape seen at points (81, 2), pixels."""
        share = self._frames / LIMITS.memory_frames
        deviation = 1.0 + share * (LIMITS.remembered_deviation - 1.0)
        fit = self.prior.fit(points, self._start(points), self._identity, deviation)
        self._last = fit
        self._frames = min(self._frames + 1, LIMITS.memory_frames)
        old = np.zeros_like(fit.identity) if self._identity is None else self._identity
        self._identity = old + (fit.identity - old) / self._frames
        return fit

    def _start(self, points: F64) -> SolidFit | None:
        """The last fit, if the face is near it."""
        if self._last is None:
            return None
        away = mean(lengths(points - self._last.points))
        return self._last if away < LIMITS.max_step_face_widths * self._last.pose.scale else None


def turned_share(pose: HeadPose) -> float:
    """Share in [0, 1] to which a head is treated as turned."""
    return ramp(pose.turn, *DEPTH_DEGREES)


def depth_across(pose: HeadPose, enrolled: F64) -> F64:
    """(2,) pixels by which what lies a face width farther back is seen elsewhere than in the texture as enrolled.

    enrolled : (2,) the same of a head in that place that is turned as it was enrolled.
    """
    return np.asarray(turned_share(pose) * (pose.linear[2] - enrolled))


@dataclass(frozen=True, eq=False)
class Sight:
    """How a face is seen.

    Parameters
    ----------
    across : (2,) pixels of the picture by which what lies one face width farther back is seen elsewhere.
    facing : (81 + k,) share in [0, 1] of what is seen of a face from the front that is seen at the relief's points.
    at_rest : (81, 2) the face's shape at rest as it is seen, grid pixels, anywhere; None if that isn't known.
    """

    across: F64
    facing: F32
    at_rest: F64 | None = None

    @classmethod
    def of(
        cls, normals: F64, whole: F64, pose: HeadPose, enrolled: F64 = STRAIGHT, at_rest: F64 | None = None
    ) -> Sight:
        """The sight of a face with normals (81 + k, 3) at its relief's points, in a pose.

        whole : (81 + k,) cosines between the camera's direction and the normals, from which on all of a place is seen.
        enrolled : (2,) pixels, `across` of a head in that place that is turned as its texture was enrolled.
        """
        cosines = (1 - turned_share(pose)) - normals @ pose.rotation[2]  # nothing is hidden of a frontal head
        facing = np.minimum(np.maximum(cosines / whole, 0), 1).astype(np.float32)
        return cls(depth_across(pose, enrolled), facing, at_rest)

    @property
    def turned(self) -> bool:
        """Whether anything of the face is hidden."""
        return bool(np.minimum.reduce(self.facing) < 1)


def pulled(points: F64, fit: SolidFit) -> F64:
    """Points (81, 2) of a turned head drawn towards where the solid shape fitted to them is seen.

    Hidden points of the far side stay on the silhouette; the constraint of Xiao et al., with shares that grow as the
    head turns.
    """
    share = ramp(fit.pose.turn, *PULL_DEGREES) * PULL[:, None]
    drawn: F64 = points + share * (fit.points - points)
    return drawn


def facing(solid: F64, rotation: F64) -> F64:
    """(81,) cosines between the camera's direction and the normals of a turned solid shape (81, 3), < 0 behind."""
    return np.asarray(-normals(solid, ReferenceFrame.canonical().triangles) @ rotation[2])


def normals(solid: F64, triangles: I32) -> F64:
    """(n, 3) unit normals of the surface of a solid shape (n, 3) with triangles (t, 3), out of the face."""
    a, b, c = (solid[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    area *= np.where(area[:, 2:] > 0, -1, 1)  # as seen from the front all face the camera
    corners, thrice = triangles.T.ravel(), np.tile(area.T, 3)
    sums = np.stack([np.bincount(corners, plane, len(solid)) for plane in thrice], axis=1)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12))


def _lever(solid: F64) -> F64:
    """(3, 81), which times points (81, 2) is the affine map from a solid shape (81, 3) to them, by least squares."""
    weights = np.sqrt(RIGID_WEIGHTS)
    return np.asarray(
        np.linalg.pinv((solid - RIGID_WEIGHTS @ solid) * weights[:, None]) * weights, np.float64
    )


def _first_pose(solid: F64, points: F64, lever: F64 | None = None) -> HeadPose:
    """The pose in which a solid shape (81, 3) comes nearest to points (81, 2), by least squares and a rotation."""
    middle = RIGID_WEIGHTS @ points
    affine = ((_lever(solid) if lever is None else lever) @ (points - middle)).T
    u, sizes, vt = np.linalg.svd(affine, full_matrices=False)
    two = u @ vt
    (a, b, c), (d, e, f) = two.tolist()
    rotation = np.array([[a, b, c], [d, e, f], [b * f - c * e, c * d - a * f, a * e - b * d]])
    scale = max(float(sizes.mean()), 1e-6)
    return HeadPose(rotation, scale, middle - scale * two @ (RIGID_WEIGHTS @ solid))


def _moved(rest: F64, amounts: F64, modes: F64) -> F64:
    """A mean (81, 3) moved by amounts (k,) of modes (k, 81, 3)."""
    moved: F64 = rest + (amounts @ modes.reshape(-1, rest.size)).reshape(rest.shape)
    return moved


def _turned(vector: F64) -> F64:
    """(3, 3) rotation about a vector (3,) by its length, radians (Rodrigues)."""
    angle = float(np.sqrt(vector @ vector))
    x, y, z = vector / max(angle, 1e-12)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(_UPRIGHT + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k)


def _degrees(cosine: float) -> float:
    """The angle of a cosine, which rounding may have taken beyond one."""
    return float(np.degrees(np.arccos(np.minimum(np.maximum(cosine, -1), 1))))


@cache
def _shipped() -> SolidPrior:
    with np.load(DATA) as stored:
        return SolidPrior(**{name: stored[name].astype(np.float64) for name in stored.files})
