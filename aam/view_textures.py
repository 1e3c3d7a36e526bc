"""How a person's skin looks from the side: their neutral texture in bins of yaw.

A texture seen from the front and drawn on a turned head lacks what its turn shows: the edge of the nose against the far
cheek, the shade beside it, folds.  The frames of an enrolment in which the head is turned show it.  Kept is the
logarithm of their mean texture over that of the frames near the front, without the smooth part, which is light.  A side
that the clip doesn't show is the mirror image of the other.  Grid pixels; RGB 0..255; degrees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import openness
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_BROW, LEFT_EYE, RIGHT_BROW, RIGHT_EYE, RIGID_WEIGHTS
from guise.aam.mask import soft_parts
from guise.aam.mirror import mirror_image
from guise.aam.reference import MeshSampler, ReferenceFrame, remap_points
from guise.aam.relief import Relief
from guise.aam.resampling import resampled_texture
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import SolidPrior, depth_across, facing, pulled
from guise.common.arrays import F32, F64, U8, Bool


@dataclass(frozen=True)
class ViewLimits:
    """Which frames count for a view, and what is kept of them."""

    yaws: tuple[float, ...] = (-50.0, -35.0, -20.0, 20.0, 35.0, 50.0)  # from the yaw at rest
    spread_degrees: float = 7.0  # standard deviation of the yaws that count
    least_frames: float = 3.0  # whose yaws count, of a view that is known
    expression_deviations: float = 1.8  # from rest, over which frames count less
    least_weight: float = 0.02  # of frames with any expression
    # Cosines of normal and camera, from which a place is seen and from which it is seen well.
    seen_cosines: tuple[float, float] = (0.15, 0.5)
    seen_share: float = 0.3  # of the best seen place, below which a place fades
    black_grey_levels: float = 8.0  # added before logarithms are taken
    max_change: float = 0.6  # of a logarithm
    light_face_widths: float = 0.1  # standard deviation, beyond which a change is light
    still_face_widths: float = 0.03  # around brows, which are drawn as they are from the front
    aperture_face_widths: float = 0.02  # around eyes and the inside of the lips


LIMITS = ViewLimits()
YAWS, CHANGES, MAX_LEVEL = "views.yaws", "views.changes", 127  # in a model file


@dataclass(frozen=True, eq=False)
class ViewTextures:
    """Changes of the neutral texture by yaw.

    Parameters
    ----------
    yaws : (b,) degrees from the yaw at rest, increasing; 0 among them.
    changes : (b, n, 3) float32 logarithms of texture over neutral texture, 0 at rest.
    """

    yaws: F64
    changes: F32

    @cached_property
    def _factors(self) -> F32:
        return np.exp(self.changes)

    def at(self, yaw: float) -> F32:
        """(n, 3) by what the neutral texture is multiplied at a yaw; beyond the outermost views it is theirs."""
        after = int(np.clip(np.searchsorted(self.yaws, yaw), 1, len(self.yaws) - 1))
        before, next_ = self.yaws[after - 1 : after + 1]
        share = float(np.clip((yaw - before) / (next_ - before), 0, 1))
        return np.asarray(
            cv2.addWeighted(self._factors[after - 1], 1 - share, self._factors[after], share, 0), np.float32
        )

    def packed(self) -> dict[str, NDArray[Any]]:
        """As a model file holds them, without the view at rest."""
        turned = self.yaws != 0
        levels = np.round(self.changes[turned] * (MAX_LEVEL / LIMITS.max_change))
        return {YAWS: self.yaws[turned], CHANGES: np.clip(levels, -MAX_LEVEL, MAX_LEVEL).astype(np.int8)}

    @classmethod
    def unpacked(cls, tensors: dict[str, NDArray[Any]], reference: ReferenceFrame) -> ViewTextures | None:
        """From a model file's tensors; None without views, ValueError where they don't fit the reference frame."""
        if YAWS not in tensors:
            return None
        yaws, levels = tensors[YAWS].astype(np.float64), tensors[CHANGES]
        expected = len(yaws), len(reference.pixels), 3
        if levels.shape != expected or not (np.diff(yaws) > 0).all():
            raise ValueError(f"{CHANGES} is {levels.shape}, not {expected}, or {YAWS} do not increase")
        at = int(np.searchsorted(yaws, 0))
        changes = levels.astype(np.float32) * np.float32(LIMITS.max_change / MAX_LEVEL)
        return cls(np.insert(yaws, at, 0.0), np.insert(changes, at, 0.0, axis=0))

    def at_resolution(self, old: ReferenceFrame, new: ReferenceFrame) -> ViewTextures:
        """The same on another grid."""
        return replace(self, changes=np.stack([resampled_texture(c, old, new) for c in self.changes]))


def learn_views(
    faces: Sequence[tuple[U8, F64]], rest: F64, mask: Bool, reference: ReferenceFrame
) -> ViewTextures | None:
    """The views of faces (h, w, 3) at shapes (81, 2) of their pixels; None where no frame is turned enough.

    rest : (81, 2) the shape at rest.
    mask : (h, w) bool, where the face is shown.
    """
    person = SolidPrior.shipped().rest_of(rest)
    prior = SolidPrior.shipped().of_person(person)
    fits = [prior.fit(shape) for _, shape in faces]
    yaws = np.array([fit.pose.angles[0] for fit in fits]) - person.pose.angles[0]
    near = np.exp(-0.5 * ((yaws - np.array([0.0, *LIMITS.yaws])[:, None]) / LIMITS.spread_degrees) ** 2)
    known = near.sum(1) >= LIMITS.least_frames
    if not known[0] or not known[1:].any():
        return None
    relief = Relief.shipped(reference)
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    sampler = MeshSampler.build(relief.mesh, np.column_stack([xs, ys]).astype(np.float64))
    enrolled = person.pose.linear[2] @ align_planar(rest, reference.points, RIGID_WEIGHTS).linear
    textures, seen = [], []
    for (picture, shape), fit in zip(faces, fits, strict=True):
        there = enrolled @ align_planar(reference.points, shape, RIGID_WEIGHTS).linear
        mesh = relief.seen(pulled(shape, fit), depth_across(fit.pose, there))
        textures.append(remap_points(picture, sampler.positions(mesh)))
        cosines = facing(relief.solid(fit.rest), fit.pose.rotation, relief.triangles)
        seen.append(
            np.interp((cosines[sampler.vertices] * sampler.weights).sum(0), LIMITS.seen_cosines, (0, 1))
        )
    weights = near[known] * _at_rest(np.stack([shape for _, shape in faces]), rest)
    means, shares = _means(np.array(textures, np.float32), np.array(seen, np.float32), weights)
    logs = np.log(means + np.float32(LIMITS.black_grey_levels))
    changing = _changing(mask, reference)
    changes = [
        _without_light(log - logs[0], share * changing, reference)
        for log, share in zip(logs, shares, strict=True)
    ]
    return _both_sides(dict(zip(np.array([0.0, *LIMITS.yaws])[known], changes, strict=True)), reference)


def _at_rest(shapes: F64, rest: F64) -> F64:
    """(m,) weights of shapes (m, 81, 2), less the farther mouth, lids and brows are from rest (81, 2)."""
    states = openness(shapes)
    away = (states - openness(rest[None])) / np.maximum(states.std(0), 0.01)
    return np.asarray(np.exp(-0.5 * (away**2).sum(1) / LIMITS.expression_deviations**2) + LIMITS.least_weight)


def _means(textures: F32, seen: F32, weights: F64) -> tuple[F32, F32]:
    """Means (b, n, 3) of textures (m, n, 3) with weights (b, m) where they are seen (m, n), and how well (b, n)."""
    sums = weights.astype(np.float32) @ seen
    coloured = np.einsum("bm,mn,mnc->bnc", weights.astype(np.float32), seen, textures, optimize=True)
    best = sums.max(1, keepdims=True)
    return coloured / np.maximum(sums, 1e-6)[..., None], np.clip(sums / (LIMITS.seen_share * best), 0, 1)


def _changing(mask: Bool, reference: ReferenceFrame) -> F32:
    """(n,) share in [0, 1] of a change that is shown: eyes, brows and the inside of the mouth stay."""
    soft = cv2.GaussianBlur(
        mask.astype(np.float32), (0, 0), LIMITS.aperture_face_widths * reference.resolution
    )
    apertures = soft_parts(reference, (RIGHT_EYE, LEFT_EYE, INNER_LIPS), LIMITS.aperture_face_widths)
    brows = soft_parts(reference, (RIGHT_BROW, LEFT_BROW), LIMITS.still_face_widths)
    return np.asarray((soft * (1 - np.maximum(apertures, brows)))[reference.mask], np.float32)


def _without_light(change: F32, share: F32, reference: ReferenceFrame) -> F32:
    """A change (n, 3) without its smooth part, where a share (n,) of it is shown."""
    sigma = LIMITS.light_face_widths * reference.resolution
    weighted, weight = (
        cv2.GaussianBlur(reference.scatter(values), (0, 0), sigma)
        for values in (change * share[:, None], share)
    )
    smooth = weighted / np.maximum(weight, 1e-3)[..., None]
    kept = np.clip(change - smooth[reference.mask], -LIMITS.max_change, LIMITS.max_change)
    return np.asarray(kept * share[:, None], np.float32)


def _both_sides(changes: dict[float, F32], reference: ReferenceFrame) -> ViewTextures:
    """The views by yaw, and mirror images of those whose counterpart isn't known."""
    for yaw in [yaw for yaw in changes if -yaw not in changes]:
        changes[-yaw] = mirror_image(reference.scatter(changes[yaw]), reference, 1)[reference.mask]
    yaws = sorted(changes)
    return ViewTextures(np.array(yaws), np.stack([changes[yaw] for yaw in yaws]))
