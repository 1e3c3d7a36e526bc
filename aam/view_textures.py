"""How a person's skin looks from the side: changes of their neutral texture by yaw.

A texture seen from the front and drawn on a turned head lacks what its turn shows: the edge of the nose against the far
cheek, the shade beside it, folds.  The turned frames of an enrolment show it.  Kept is the logarithm of their luma over
that of the frames near the front, without the smooth part, which is light.  What the frames don't show, or show
unsurely, is expected from how the face looks from the front (`view_prior.py`).  Grid pixels; RGB 0..255; degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import openness
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.resampling import resampled_texture
from guise.aam.solid_shape import SolidPrior, depth_across, pulled
from guise.common.arrays import F32, F64, U8
from guise.common.sampling import remap_points

YAWS = (-50.0, -35.0, -20.0, 20.0, 35.0, 50.0)  # from the yaw at rest


@dataclass(frozen=True)
class ViewLimits:
    """Which frames count for a view, and what is kept of them."""

    spread_degrees: float = 7.0  # standard deviation of the yaws that count
    least_frames: float = 3.0  # whose yaws count, of a view that is known,
    farthest_degrees: float = 6.0  # and whose mean yaw is so near
    most_frames: float = 4.0  # whose errors count as independent
    expression_deviations: float = 1.8  # from rest, over which frames count less
    least_weight: float = 0.02  # of frames with any expression
    # Cosines of normal and camera, from which a place is seen and from which it is seen well.
    seen_cosines: tuple[float, float] = (0.15, 0.5)
    seen_share: float = 0.3  # of the best seen place, below which a place fades
    black_grey_levels: float = 8.0  # added before logarithms are taken
    max_change: float = 0.6  # of a logarithm
    expected_deviation: float = 0.06  # of a logarithm, by which a change differs from what is expected
    light_face_widths: float = 0.1  # standard deviation, beyond which a change is light
    aperture_face_widths: float = 0.02  # around eyes and the inside of the lips


LIMITS = ViewLimits()
_FIELDS = "views.yaws", "views.changes", "views.sure"  # in a model file
_LEVELS = 127


@dataclass(frozen=True, eq=False)
class ViewTextures:
    """Changes of the neutral texture that an enrolment shows.

    Parameters
    ----------
    yaws : (b,) degrees from the yaw at rest, some of `YAWS`.
    changes : (b, n) float32 logarithms of luma over that of the neutral texture.
    sure : (b, n) float32 share in [0, 1] of them that counts, beside what is expected.
    """

    yaws: F64
    changes: F32
    sure: F32

    def packed(self) -> dict[str, NDArray[Any]]:
        """As a model file holds them."""
        levels = np.clip(np.round(self.changes * (_LEVELS / LIMITS.max_change)), -_LEVELS, _LEVELS)
        arrays = self.yaws, levels.astype(np.int8), np.round(self.sure * 255).astype(np.uint8)
        return dict(zip(_FIELDS, arrays, strict=True))

    @classmethod
    def unpacked(cls, tensors: dict[str, NDArray[Any]], reference: ReferenceFrame) -> ViewTextures | None:
        """From a model file's tensors; None without views, ValueError where they don't fit the reference frame."""
        if _FIELDS[0] not in tensors:
            return None
        yaws, levels, sure = (tensors[name] for name in _FIELDS)
        expected = len(yaws), len(reference.pixels)
        if levels.shape != expected or sure.shape != expected:
            raise ValueError(f"{_FIELDS[1]} is {levels.shape}, not {expected}")
        if not np.isin(yaws, YAWS).all():
            raise ValueError(f"{_FIELDS[0]} are {yaws.tolist()}")
        scale = np.float32(LIMITS.max_change / _LEVELS)
        return cls(yaws.astype(np.float64), levels * scale, sure.astype(np.float32) / np.float32(255))

    def at_resolution(self, old: ReferenceFrame, new: ReferenceFrame) -> ViewTextures:
        """The same on another grid."""
        changes, sure = (
            np.stack([resampled_texture(row, old, new) for row in rows]) for rows in (self.changes, self.sure)
        )
        return replace(self, changes=changes, sure=sure)


@dataclass(frozen=True, eq=False)
class TurnedFaces:
    """Frames of a person as they are drawn: yaw from rest (m,), log luma (m, n), share that is seen (m, n)."""

    yaws: F64
    logs: F32
    seen: F32

    @classmethod
    def of(cls, faces: Sequence[tuple[U8, F64]], rest: F64, reference: ReferenceFrame) -> TurnedFaces:
        """Of faces (h, w, 3) at shapes (81, 2) of their pixels; `rest` is the shape (81, 2) at rest."""
        person = SolidPrior.shipped().rest_of(rest)
        prior = SolidPrior.shipped().of_person(person)
        enrolled = person.pose.linear[2] @ reference.to_grid(rest).linear
        relief = Relief.shipped(reference)
        ys, xs = np.divmod(reference.pixels, reference.size[1])
        sampler = MeshSampler.build(relief.mesh, np.column_stack([xs, ys]).astype(np.float64))
        yaws, logs, seen = [], [], []
        for picture, shape in faces:
            fit = prior.fit(shape)
            there = enrolled @ reference.to_shape(shape).linear
            mesh = relief.seen(pulled(shape, fit), depth_across(fit.pose, there))
            luma = remap_points(picture, sampler.positions(mesh)) @ LUMA
            cosines = -relief.normals(fit.rest) @ fit.pose.rotation[2]
            cosines = (cosines[sampler.vertices] * sampler.weights).sum(0)
            yaws.append(fit.pose.angles[0] - person.pose.angles[0])
            logs.append(np.log(luma + np.float32(LIMITS.black_grey_levels)))
            seen.append(np.interp(cosines, LIMITS.seen_cosines, (0, 1)))
        return cls(np.array(yaws), np.array(logs, np.float32), np.array(seen, np.float32))


def learn_views(faces: Sequence[tuple[U8, F64]], rest: F64, reference: ReferenceFrame) -> ViewTextures | None:
    """The views of faces (h, w, 3) at shapes (81, 2) of their pixels; None where no frame is turned enough.

    rest : (81, 2) the shape at rest.
    """
    turned = TurnedFaces.of(faces, rest, reference)
    bins = np.array([0.0, *YAWS])
    near = np.exp(-0.5 * ((turned.yaws - bins[:, None]) / LIMITS.spread_degrees) ** 2)
    counts = near.sum(1)
    away = np.abs(near @ turned.yaws / np.maximum(counts, 1e-9) - bins)
    known = (counts >= LIMITS.least_frames) & (away <= LIMITS.farthest_degrees)
    if not known[0] or not known[1:].any():
        return None
    weights = near[known] * _at_rest(np.stack([shape for _, shape in faces]), rest)
    front = _mean(turned.logs, np.asarray(weights[0, :, None] * turned.seen, np.float32))
    used = weights.max(0) > LIMITS.least_weight**2
    weights, seen = weights[:, used], turned.seen[used]
    changes = np.array([
        without_light(log - front, share, reference) for log, share in zip(turned.logs[used], seen, strict=True)
    ])  # fmt: skip
    means, noises, shares = [], [], []
    for row in weights:
        weight = np.asarray(row[:, None] * seen, np.float32)
        means.append(_mean(changes, weight))
        frames = min(float(row.sum() ** 2 / (row**2).sum()), LIMITS.most_frames)
        noises.append(_mean((changes - means[-1]) ** 2, weight) / np.float32(frames))
        shares.append(seen_share(weight.sum(0)))
    noise, expected = np.array(noises[1:]) + noises[0], np.float32(LIMITS.expected_deviation**2)
    sure = np.array(shares[1:]) * expected / (expected + noise)
    limit = LIMITS.max_change
    return ViewTextures(bins[known][1:], np.clip(np.array(means[1:]), -limit, limit), sure)


def _at_rest(shapes: F64, rest: F64) -> F64:
    """(m,) weights of shapes (m, 81, 2), less the farther mouth, lids and brows are from rest (81, 2)."""
    states = openness(shapes)
    away = (states - openness(rest[None])) / np.maximum(states.std(0), 0.01)
    return np.asarray(np.exp(-0.5 * (away**2).sum(1) / LIMITS.expression_deviations**2) + LIMITS.least_weight)


def _mean(rows: F32, weights: F32) -> F32:
    """(n,) of rows (m, n) with weights (m, n)."""
    return np.asarray((rows * weights).sum(0) / np.maximum(weights.sum(0), 1e-6), np.float32)


def seen_share(weights: F32) -> F32:
    """(n,) share in [0, 1] of a change that is shown, of places seen with weights (n,)."""
    return np.asarray(np.clip(weights / (LIMITS.seen_share * weights.max()), 0, 1), np.float32)


def changing(reference: ReferenceFrame) -> F32:
    """(n,) share in [0, 1] of a change that is drawn: eyes and the inside of the mouth stay."""
    apertures = soft_parts(reference, (RIGHT_EYE, LEFT_EYE, INNER_LIPS), LIMITS.aperture_face_widths)
    return np.asarray(1 - apertures[reference.mask], np.float32)


def without_light(change: F32, share: F32, reference: ReferenceFrame) -> F32:
    """A change (n,) of logarithms of luma, seen by a share (n,), without its smooth part."""
    sigma = LIMITS.light_face_widths * reference.resolution
    weighted, weight = (
        cv2.GaussianBlur(reference.scatter(values), (0, 0), sigma) for values in (change * share, share)
    )
    return np.asarray(change - (weighted / np.maximum(weight, 1e-3))[reference.mask], np.float32)
