"""Estimates ARKit's 52 coefficients, and the turn of head and eyes, frame by frame from a picture and its 81 points.

Small networks (`training/rig_head.py`, `aam/data/rig.md`) tell coefficients from what is seen of eyes, brows and
mouth, and from how that differs from the same person at rest.  Rest is told by a calibration or estimated on the way,
as the calmest of what was seen.  A calibration may also hold a linear map of the person's own.  Everything is smoothed
by the One Euro filter (Casiez, Roussel and Vogel, CHI 2012), which lags by less than a frame; a whole clip both ways,
so that nothing lags.

Blend shapes add up linearly, see Lewis et al., Practice and theory of blendshape facial models (Eurographics 2014).
Pixels, x right, y down; angles in degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, INDEX
from guise.aam.rig.sight import IRIS_RADII, FaceSight, iris_values, see, window_values
from guise.aam.solid_shape import SolidTracker
from guise.common.arrays import F32, F64, U8, Floating
from guise.common.small import mean
from guise.common.tuned import derived, tuned

DATA = Path(__file__).parents[1] / "data" / "rig.npz"
TOLD: tuple[int, ...] = tuple(k for k, name in enumerate(ARKIT_NAMES) if not name.startswith("eyeLook"))
LOOKS = ("lookRight", "lookUp")  # told beside them: the eyes' turn to the image's right and up, in full looks
LAYERS = 3
RIGHT, UP = len(TOLD), len(TOLD) + 1


class Coefficients(NamedTuple):
    """A face in one frame.

    weights : (52,) float32 in [0, 1], in the order of `ARKIT_NAMES`.
    head : (3,) yaw to the image's right, pitch up, roll to the image's right, of the head before the camera.
    eyes : (2, 3) likewise, of the person's left and right eye in the head; they do not roll.
    """

    weights: F32
    head: F64
    eyes: F64

    @property
    def named(self) -> dict[str, float]:
        """The weights by name."""
        return dict(zip(ARKIT_NAMES, self.weights.tolist(), strict=True))


@dataclass(frozen=True)
class Smoothing:
    """The One Euro filter's cut-off at rest, what speed adds to it, and that of the speed itself."""

    cutoff_hertz: float = tuned(3.0, "hertz", "rig.coefficients")
    per_speed: float = tuned(12.0, "hertz per unit a second", "rig.coefficients")
    speed_hertz: float = derived(1.0, "hertz", "the paper's value")


@dataclass(frozen=True)
class RigRestLimits:
    """How rest is estimated while there is no calibration."""

    calm: float = tuned(
        0.12, "coefficients", "rig.coefficients"
    )  # above the calmest so far, what still counts as rest
    first_share: float = derived(1.0, "share", "the first frame is all that is known")
    memory_frames: int = tuned(40, "frames", "rig.coefficients")  # over which rest is averaged


SMOOTHING, REST = Smoothing(), RigRestLimits()


@dataclass(frozen=True, eq=False)
class RigCalibration:
    """What is known of one person.

    rest : (k,) components of their sight at rest.
    linear : (47 + k, 46): what is told, 1, and how the components differ from rest -> coefficients and gaze.
    """

    rest: F32
    linear: F32 | None = None

    def mapped(self, told: Floating, components: F32) -> Floating:
        """What is told (46,) of components (k,), by the person's own map."""
        if self.linear is None:
            return told
        found: Floating = np.concatenate([told, [1.0], components - self.rest]) @ self.linear
        return found


class RigEstimator:
    """Coefficients of one person, frame by frame; used by one thread.

    Parameters
    ----------
    calibration : RigCalibration, optional
        Without one, rest is estimated from what was seen so far.
    smooth : bool
    """

    def __init__(self, calibration: RigCalibration | None = None, *, smooth: bool = True) -> None:
        self.calibration = calibration
        self._network = shipped()
        self._heads = SolidTracker()
        self._rest = Rest(calibration)
        self._filter = OneEuro() if smooth else None

    def __call__(self, rgb: U8, points: Floating, seconds: float) -> Coefficients:
        """Of a face with points (81, 2) in a picture (h, w, 3), shown at a time."""
        components, head = self.components(rgb, points)
        told = self._rest.tell(self._network, components)
        mine = told if self.calibration is None else self.calibration.mapped(told, components)
        values = np.concatenate([mine, head / 90])
        if self._filter is not None:
            values = self._filter(values, seconds)
        return coefficients(values[:-3], values[-3:] * 90)

    def components(self, rgb: U8, points: Floating) -> tuple[F32, F64]:
        """Components (k,) of what is seen, and the head's yaw, pitch and roll."""
        exact: F64 = np.asarray(points, np.float64)
        pose = self._heads.update(exact).pose
        return self._network.components(see(rgb, exact, pose)), np.array(pose.angles)


class Rest:
    """What a person looks like at rest, as told or as the calmest of what was seen."""

    def __init__(self, calibration: RigCalibration | None) -> None:
        self._known = None if calibration is None else calibration.rest
        self._seen: F32 | None = None
        self._least, self._count = np.inf, 0

    def tell(self, network: RigNetwork, components: F32) -> F32:
        """Coefficients and gaze (46,) of a sight's components (k,)."""
        if self._known is not None:
            return network.tell(components, self._known)
        alone = network.tell(components, None)
        moved = float(np.abs(alone[: len(TOLD)]).sum()) + float(np.abs(alone[len(TOLD) :]).sum())
        self._least = min(self._least, moved)
        if self._seen is None or moved < self._least + REST.calm:
            self._count = min(self._count + 1, REST.memory_frames)
            old = components if self._seen is None else self._seen
            self._seen = np.asarray(old + (components - old) / self._count, np.float32)
        return network.tell(components, self._seen)


@dataclass(frozen=True, eq=False)
class RigNetwork:
    """Principal components of a sight, and the networks that read them, as `training/rig_head.py` stores them."""

    arrays: dict[str, F32]

    @property
    def size(self) -> int:
        """How many components a sight has."""
        eye, mouth, shape = (int(self.arrays[name].shape[1]) for name in ("eye", "mouth", "shape"))
        return 2 * (eye + 2 * len(IRIS_RADII)) + mouth + shape

    def components(self, sight: FaceSight) -> F32:
        """(k,) of a sight."""
        a = self.arrays
        eyes = [(window_values(eye) - a["eye_mean"]) @ a["eye"] for eye in sight.eyes]
        irises = [iris_values(eye) for eye in sight.eyes]
        mouth = (window_values(sight.mouth) - a["mouth_mean"]) @ a["mouth"]
        return np.concatenate([mouth, *eyes, (sight.shape - a["shape_mean"]) @ a["shape"], *irises])

    def tell(self, own: F32, rest: F32 | None) -> F32:
        """Coefficients without the looks, then the two of `LOOKS`, (46,), from components (k,) and those at rest."""
        given = rest is not None
        away = own - rest if rest is not None else np.zeros_like(own)
        known = np.zeros(len(TOLD) + 3, np.float32)
        known[-1] = given
        parts = {"face": slice(-4 * len(IRIS_RADII)), "look": slice(self.arrays["mouth"].shape[1], None)}
        return np.concatenate(
            [self._run(n, np.concatenate([own[s], away[s], known])) for n, s in parts.items()]
        )

    def _run(self, name: str, values: F32) -> F32:
        """The mean answer of the networks for the face, or of those for the look; weights (networks, in, out)."""
        values = values[None, None]
        for k in range(LAYERS):
            values = values @ self.arrays[f"{name}_weight{k}"] + self.arrays[f"{name}_bias{k}"]
            if k + 1 < LAYERS:
                values = np.maximum(values, 0)
        averaged: F32 = mean(values[:, 0], 0)
        return averaged


class OneEuro:
    """The One Euro filter of several values."""

    def __init__(self, settings: Smoothing = SMOOTHING) -> None:
        self._settings = settings
        self._last: F64 | None = None
        self._speed: F64 = np.zeros(0)
        self._seconds = 0.0

    def __call__(self, values: Floating, seconds: float) -> F64:
        """The values (n,) at a time, smoothed."""
        if self._last is None or seconds <= self._seconds:
            self._last, self._speed = np.array(values, np.float64), np.zeros(len(values))
        else:
            step = seconds - self._seconds
            speed = (values - self._last) / step
            share = _share(np.full(len(speed), self._settings.speed_hertz), step)
            self._speed = np.asarray(self._speed + share * (speed - self._speed), np.float64)
            cutoff = self._settings.cutoff_hertz + self._settings.per_speed * np.abs(self._speed)
            self._last = np.asarray(self._last + _share(cutoff, step) * (values - self._last), np.float64)
        self._seconds = seconds
        return self._last.copy()


def smoothed(values: Floating, seconds: Floating) -> F64:
    """Values (t, n) of a whole clip, filtered forwards and backwards, so that nothing lags."""
    ways = []
    for order in (slice(None), slice(None, None, -1)):
        keep, times = OneEuro(), np.abs(seconds[order] - seconds[order][0])
        ways.append(
            np.array([keep(row, float(at)) for row, at in zip(values[order], times, strict=True)])[order]
        )
    return np.asarray(np.add(*ways) / 2, np.float64)


def _share(cutoff: F64, step: float) -> F64:
    turn = 2 * np.pi * cutoff * step
    return np.asarray(turn / (turn + 1))


def coefficients(told: Floating, head: F64) -> Coefficients:
    """Of what the network tells (46,), and the head's angles."""
    weights = np.zeros(len(ARKIT_NAMES), np.float32)
    weights[list(TOLD)] = np.clip(told[: len(TOLD)], 0, 1)
    right, up = float(told[RIGHT]), float(told[UP])
    for side, outwards in (("Left", right), ("Right", -right)):
        for way, value in (("Out", outwards), ("In", -outwards), ("Up", up), ("Down", -up)):
            weights[INDEX[f"eyeLook{way}{side}"]] = min(max(value, 0.0), 1.0)
    eye = np.array([right, up, 0.0]) * FULL_LOOK_DEGREES
    return Coefficients(weights, np.asarray(head, np.float64), np.stack([eye, eye]))


@cache
def shipped() -> RigNetwork:
    """The network that ships with the package."""
    with np.load(DATA) as stored:
        return RigNetwork({name: stored[name].astype(np.float32) for name in stored.files})
