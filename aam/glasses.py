"""A person's glasses as they come along with their face: what they do to the light of what is behind them, and where.

No outline is told, since none can be in a small clip: a pixel of the frame at rest is divided by what lies around thin
lines there, dark or bright, and by the skin about dark frames.  Laid over another face, such ratios draw rims, bridge,
reflections at their edges and the arms up to the ears, each as strong as it was seen, in whatever light.

Glasses are stiff: a plane before the eyes, as deep as the root of the nose on which they rest, and beyond the hinges
two arms that go back to the ears.  So they move as the head does, whatever the face expresses.

Pixels of a crop about the eyes, or of the picture, x right, y down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.irises import CORNERS, EYES
from guise.aam.landmarks.schemes import JAW, NOSE_BRIDGE, NOSE_ROOT
from guise.aam.model import RestFrame
from guise.aam.parsing import FaceClass, FaceParser
from guise.aam.rims import RimFinder, RimMemory
from guise.aam.without_glasses import disc, wears_glasses
from guise.common.arrays import F32, F64, Bool
from guise.common.small import mean


@dataclass(frozen=True)
class WornLimits:
    """What of a frame at rest are glasses; lengths in distances between the eyes."""

    line: float = 0.07  # the widest line
    frame: float = 0.3  # the widest part of a dark frame
    reach: float = 0.05  # about cells with glasses, where rims may be
    # shares of glasses in a cell, from which there may be rims, and a dark frame
    rim_share: tuple[float, float] = (0.03, 0.12)
    frame_share: tuple[float, float] = (0.35, 0.6)
    contrast: tuple[float, float] = (0.03, 0.08)  # up to which a pixel is skin, from which it is a rim
    eye_growth: float = 0.05  # about eyes, where lashes are
    hinge: float = 0.9  # from the middle between the eyes, beyond which there are only arms,
    arm_reach: float = 0.25  # and how far from the line of the eyes
    least_arm: float = 0.1  # its length as seen from the front
    behind_jaw_face_widths: float = 0.15  # by which arms end behind the outermost points of the jaw line
    blurred_from: float = 0.8  # pixels of the picture a pixel of the crop, below which that is blurred,
    blur: float = 0.45  # pixels of the picture
    black: float = 6.0  # grey levels, added before a ratio is taken


LIMITS = WornLimits()
# Points that no expression moves, and those that tell how the face is seen.
STILL = np.array([*(eye[corner] for eye in EYES for corner in CORNERS), *NOSE_BRIDGE[:2]], np.intp)
EARS = JAW[0], JAW[-1]
ABOUT = np.concatenate([*EYES, NOSE_BRIDGE, EARS])
OTHERS = FaceClass.BROWS, FaceClass.HAIR, FaceClass.BACKGROUND  # which are no glasses, however thin


@dataclass(frozen=True, eq=False)
class WornGlasses:
    """What glasses do to what is behind them.

    Parameters
    ----------
    ratio : (h, w) of brightness with them to brightness without, 1 where there are none.
    to_crop : (2, 3) map from the picture at rest to the crop.
    """

    ratio: F32
    to_crop: F64

    @classmethod
    def of(cls, rest: RestFrame) -> WornGlasses | None:
        """Those that a person wears at rest, if they do."""
        parsing = FaceParser().parse(rest.picture, rest.shape)
        if not wears_glasses(parsing, rest.shape):
            return None
        finder, memory = RimFinder(), RimMemory()
        luma = np.asarray(cv2.cvtColor(rest.picture, cv2.COLOR_RGB2GRAY), np.uint8)
        finder.see(memory, luma, rest.shape, parsing, 0.0, 0.0)
        shares = finder.parsed(parsing, (FaceClass.GLASSES, *OTHERS), memory.to_crop)
        glasses, others = shares[..., 0], np.clip(1 - 2 * shares[..., 1:].max(2), 0, 1)
        near = cv2.dilate(glasses, disc(LIMITS.reach * finder.pixels))
        rims = _ramp(np.asarray(near, np.float32), LIMITS.rim_share)
        if memory.share is not None:
            rims = np.maximum(rims, memory.share)
        for eye in EYES:
            rims[finder.about(rest.shape[eye], LIMITS.eye_growth, memory.to_crop)] = 0
        seen = finder.cut(luma, memory.to_crop) + np.float32(LIMITS.black)
        lines, frame = _of_lines(seen, finder.pixels), _of_frame(seen, finder.pixels)
        ratio = 1 + rims * others * (lines - 1)
        frame = 1 + _ramp(glasses, LIMITS.frame_share) * (frame - 1)
        ratio = np.where(frame < 1, np.minimum(ratio, frame), ratio)
        points = rest.shape @ memory.to_crop[:, :2].T + memory.to_crop[:, 2]
        ratio[~_reached(ratio.shape, points)] = 1
        return cls(np.asarray(ratio, np.float32), memory.to_crop)


@dataclass(frozen=True, eq=False)
class GlassesOnHead:
    """Glasses on another head.

    Parameters
    ----------
    worn : WornGlasses.
    points : (n, 3) pixels of the crop and 1, the points `ABOUT` of who wore them.
    rim_depth : of the rims behind the `STILL` points, face widths.
    arms : of either, on which side it is (-1 or 1), where it begins, and face widths that it is deeper a pixel to the
        right.
    """

    worn: WornGlasses
    points: F64
    rim_depth: float
    arms: tuple[tuple[int, float, float], ...]

    @classmethod
    def of(cls, worn: WornGlasses, shape: F64, solid: F64) -> GlassesOnHead:
        """Of who wore them at a shape (81, 2), pixels; solid : (81, 3) the same on the head at rest, face widths."""
        points = shape @ worn.to_crop[:, :2].T + worn.to_crop[:, 2]
        right, left = _eyes(points)
        depth = solid[:, 2] - mean(solid[STILL, 2])
        rim, arms = float(depth[NOSE_ROOT]), []
        for side, ear in zip((-1, 1), EARS, strict=True):
            hinge = _hinge(points, side)
            length = max(side * (points[ear, 0] - hinge), LIMITS.least_arm * float((left - right)[0]))
            deeper = max(float(depth[ear]) + LIMITS.behind_jaw_face_widths - rim, 0)
            arms.append((side, hinge, side * deeper / length))
        return cls(worn, np.column_stack([points[ABOUT], np.ones(len(ABOUT))]), rim, tuple(arms))

    def front(self, seen: F64, across: F64) -> F64:
        """Map (2, 3) from the crop to the picture, of what is as deep as the rims.

        seen : (81, 2) where the face at rest is seen.   across : (2,) see `Relief.seen`.
        """
        front = np.linalg.lstsq(self.points, seen[ABOUT], rcond=None)[0].T
        front[:, 2] += self.rim_depth * across
        return np.asarray(front, np.float64)

    def outline(self, front: F64, across: F64) -> F64:
        """(8, 2) places in the picture between which all of the glasses lie."""
        h, w = self.worn.ratio.shape
        corners: F64 = np.array([(0, 0), (0, h), (w, 0), (w, h)]) @ front[:, :2].T + front[:, 2]
        deeper = [slope * (x - hinge) for (_, hinge, slope), x in zip(self.arms, (0, w), strict=True)]
        return np.concatenate([corners, corners + np.repeat(deeper, 2)[:, None] * across])

    def ratio(self, front: F64, across: F64, corner: tuple[int, int], size: tuple[int, int]) -> F32:
        """(h, w) in a rectangle of the picture that begins at a corner."""
        ratio, scale = self.worn.ratio, math.sqrt(abs(float(np.linalg.det(front[:, :2]))))
        if scale < LIMITS.blurred_from:
            ratio = np.asarray(cv2.GaussianBlur(ratio, (0, 0), LIMITS.blur / scale), np.float32)
        at, made = front.copy(), np.ones(size, np.float32)
        at[:, 2] -= corner
        columns = np.arange(ratio.shape[1])
        outer = [side * (columns - hinge) > 0 for side, hinge, _ in self.arms]
        parts = [(~np.logical_or.reduce(outer), at)]
        for beyond, (_, hinge, slope) in zip(outer, self.arms, strict=True):
            arm = at.copy()
            arm[:, 0] += slope * across
            arm[:, 2] -= slope * hinge * across
            if np.linalg.det(arm[:, :2]) > 0:  # else hidden behind the rest
                parts.append((beyond, arm))
        for part, there in parts:
            part_only = np.where(part, ratio, np.float32(1))
            made *= cv2.warpAffine(part_only, there, size[::-1], flags=cv2.INTER_LINEAR, borderValue=(1,))
        return made


def _eyes(points: F64) -> tuple[F64, F64]:
    """(2,) the middles of the right and the left eye of points (81, 2)."""
    right, left = (mean(points[eye], 0) for eye in EYES)
    return right, left


def _hinge(points: F64, side: int) -> float:
    """Where an arm begins, to the right of the crop's left edge; side : -1 of the right eye's, 1 of the left eye's."""
    right, left = _eyes(points)
    return float((right + left)[0] / 2 + side * LIMITS.hinge * (left - right)[0])


def _reached(size: tuple[int, ...], points: F64) -> Bool:
    """(h, w) places that glasses reach on a face (81, 2): beside the lenses only the arms."""
    right, left = _eyes(points)
    rows, columns = np.indices(size)
    beside = (columns < _hinge(points, -1)) | (columns > _hinge(points, 1))
    off_line = np.abs(rows - (right + left)[1] / 2) > LIMITS.arm_reach * (left - right)[0]
    first, last = points[list(EARS), 0]
    within = (
        (columns > max(first, 0)) & (columns < min(last, size[1] - 1)) & (rows > 0) & (rows < size[0] - 1)
    )
    return np.asarray(within & ~(beside & off_line))


def _of_lines(seen: F32, pixels: int) -> F32:
    """(h, w) ratio of thin lines to what lies beside them, 1 where the contrast is that of skin."""
    thin = disc(LIMITS.line * pixels / 2)
    skin = cv2.morphologyEx(cv2.morphologyEx(seen, cv2.MORPH_CLOSE, thin), cv2.MORPH_OPEN, thin)
    return _beyond_skin(seen / skin)


def _of_frame(seen: F32, pixels: int) -> F32:
    """(h, w) ratio of dark frames to the skin about them."""
    return _beyond_skin(seen / cv2.morphologyEx(seen, cv2.MORPH_CLOSE, disc(LIMITS.frame * pixels / 2)))


def _beyond_skin(ratio: F32) -> F32:
    return np.asarray(1 + _ramp(np.abs(ratio - 1), LIMITS.contrast) * (ratio - 1), np.float32)


def _ramp(values: F32, ends: tuple[float, float]) -> F32:
    return np.asarray(np.clip((values - ends[0]) / (ends[1] - ends[0]), 0, 1), np.float32)
