"""Another head in place of the source's: hair, ears and outline too, around a face that has been swapped.

The identity's still is warped so that its face lies on the drawn one, as in `guise.app.swapping.puppet`; its head and
the source's are found as `head_matte` tells.  What was behind the source's head is a plate where one is known, and
otherwise the surroundings, continued; its neck stays.  Pixels, x right, y down; RGB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import Delaunay

from guise.aam.landmarks.schemes import RIGID_WEIGHTS, SILHOUETTE
from guise.aam.light import LUMA
from guise.aam.mask import beyond_mask
from guise.aam.model import Identity
from guise.aam.parsing import FaceParser
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import SolidPrior
from guise.app.media import Frame
from guise.app.swapping.head_matte import FoundHead, matte
from guise.common.arrays import F32, F64, U8
from guise.common.closing import Closing
from guise.render import make_compositor


@dataclass(frozen=True)
class HeadLimits:
    """Sizes and thresholds."""

    sure_hair: float = 0.5  # of a pixel that goes in any case, beside the face, below and before the neck
    growth_face_widths: float = 0.04  # of what goes
    sure_share: float = 0.98  # of the head in a pixel of the still, from which its colour is the head's
    max_rim_share: float = (
        0.1  # of where heads end at the latest, above the chin: with more the head is not known
    )
    max_hidden_share: float = 0.22  # of the face behind objects, likewise
    max_turn_degrees: float = 40.0
    face_edge_widths: tuple[float, float] = (
        0.06,
        0.14,
    )  # within the drawn face, which passes into the head there
    light_face_widths: float = 0.15  # over which the light of the drawn face is carried into the head
    light_gain: tuple[float, float] = (0.5, 1.6)
    rings_face_widths: tuple[float, ...] = (0.18, 0.9)  # from the face to the still points around it
    ring_points: int = 28
    depth_face_widths: float = 0.55  # of where the head's outline lies, behind the face
    plate_spread_levels: float = 8.0  # of a pixel in time, up to which what is behind the head is known
    plate_min_pictures: int = 3
    plate_side_pixels: int = 960  # the longer one
    reduction: int = 4  # of the surroundings before they are continued
    continued_from: int = 4  # pixels of them, from which a pixel is
    memory: float = 0.9  # share of what is behind the head that is as in the frame before


LIMITS = HeadLimits()


def knows_head(head: FoundHead, shape: F64) -> bool:
    """Whether a head can be replaced: near the front, all of it where it is looked for, nothing before it."""
    yaw, pitch, _ = SolidPrior.shipped().fit(shape).pose.angles
    rim = head.places.rim()
    return bool(
        np.hypot(yaw, pitch) <= LIMITS.max_turn_degrees
        and head.mask[rim].sum() <= LIMITS.max_rim_share * rim.sum()
        and head.hidden_share <= LIMITS.max_hidden_share
    )


def gone(head: FoundHead) -> F32:
    """(h, w) share in [0, 1] of each pixel of a found head's picture that is not to be seen any more."""
    hair = head.hair > LIMITS.sure_hair
    neck = head.places.below_jaw & ~hair
    cells = (head.mask | (hair & head.places.low)) & ~neck
    side = 2 * round(LIMITS.growth_face_widths * head.places.width) + 1
    grown = cv2.dilate(cells.astype(np.uint8), np.ones((side, side), np.uint8))
    grown[neck] = 0
    soft = cv2.GaussianBlur(grown.astype(np.float32), (0, 0), 1.0)
    return np.asarray(np.maximum(grown, soft), np.float32)


@dataclass(frozen=True, eq=False)
class Plate:
    """What is behind the heads of a shot.

    picture : (h, w, 3) float32 RGB, smaller than the frames.   known : (h, w) in [0, 1], where it can be relied on.
    """

    picture: F32
    known: F32

    @classmethod
    def of(cls, pictures: Sequence[U8], heads: Sequence[U8]) -> Plate:
        """The median over pictures of a shot where no head is; heads (h, w) are not 0 where one may be."""
        stack = np.stack(pictures).astype(np.float32)
        stack[np.stack(heads) > 0] = np.nan
        count = np.isfinite(stack[..., 0]).sum(0)
        low, middle, high = _quartiles(stack)
        steady = (high - low).max(2) <= LIMITS.plate_spread_levels
        known = (steady & (count >= LIMITS.plate_min_pictures)).astype(np.float32)
        soft = cv2.GaussianBlur(cv2.erode(known, np.ones((5, 5))), (0, 0), 2.0)
        return cls(middle, np.asarray(soft, np.float32))

    def within(self, frame: Frame, roi: tuple[int, int, int, int]) -> tuple[F32, F32]:
        """Picture and known of a rectangle x0, y0, w, h of the frame, in its pixels."""
        x0, y0, w, h = roi
        scale = self.picture.shape[1] / frame.width
        to_plate = np.array([[scale, 0, (x0 + 0.5) * scale - 0.5], [0, scale, (y0 + 0.5) * scale - 0.5]])
        picture, known = (
            cv2.warpAffine(
                part, to_plate, (w, h), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REPLICATE,
            )
            for part in (self.picture, self.known)
        )  # fmt: skip
        return np.asarray(picture, np.float32), np.asarray(known, np.float32)


def _quartiles(stack: F32) -> tuple[F32, F32, F32]:
    """Quartiles over the first axis without what is nan; 0 where all is."""
    ordered = np.sort(stack, axis=0)  # nan comes last
    last = np.isfinite(ordered).sum(0)[None] - 1
    picks = (np.take_along_axis(ordered, np.maximum(last * k // 4, 0), 0)[0] for k in (1, 2, 3))
    low, middle, high = (np.nan_to_num(one) for one in picks)
    return low, middle, high


class HeadPainter(Closing):
    """Draws an identity's head around a swapped face; use it by `with`.

    identity : whose still has the head.   renderer : see `make_compositor`.
    """

    def __init__(self, identity: Identity, renderer: str) -> None:
        still = identity.rest_frame
        height, width = still.picture.shape[:2]
        rings = (_ring(still.shape, reach) for reach in LIMITS.rings_face_widths)
        around = np.clip(np.concatenate([*rings]), 0, (width - 1, height - 1))
        self._points = np.concatenate([still.shape, around])
        self._depth = _depth(still.shape)
        # Index, corner, what was shown behind the head, and where.
        self._last: tuple[int, tuple[int, int], F32, F32] | None = None
        alpha = matte(FaceParser(), still)
        self._texture = _without_background(still.picture, alpha)
        self._compositor = make_compositor(
            renderer,
            Delaunay(self._points).simplices.astype(np.int32),
            self._points.astype(np.float32),
            alpha,
        )

    def draw(self, frame: Frame, mesh: F64, head: FoundHead, plate: Plate | None) -> None:
        """Replace the head of the source, found before its face was drawn at `mesh` (81, 2), in place."""
        still = self._points[: len(mesh)]
        fit = align_planar(still, mesh, RIGID_WEIGHTS)
        turned = LIMITS.depth_face_widths * (_depth(mesh) - self._depth @ fit.linear)
        vertices = np.concatenate([mesh, fit.apply(self._points[len(mesh) :]) + turned])
        roi = _rectangle(frame, head, vertices)
        x0, y0, w, h = roi
        if w < 2 or h < 2:
            return
        seen = frame.rgb_roi(*roi).astype(np.float32)
        away = head.in_picture(gone(head), roi)[..., None]
        behind = self._steadied(_behind(frame, seen, away, roi, plate), frame.index, (x0, y0))
        self._last = frame.index, (x0, y0), behind, away
        made = seen + away * (behind - seen)
        other = self._compositor.warp((h, w), self._texture, vertices - (x0, y0)).astype(np.float32)
        face = _face(mesh - (x0, y0), (h, w))
        lit = _lit(other[..., :3], seen, face, float(np.ptp(mesh[:, 0])))
        made = made + other[..., 3:] / 255 * (lit - made)
        made = made + face[..., None] * (seen - made)
        stored = cv2.transform(made, frame.colour.from_rgb)
        frame.write_roi(x0, y0, np.rint(stored).clip(0, 255).astype(np.uint8))

    def _steadied(self, behind: F32, index: int, corner: tuple[int, int]) -> F32:
        """What is behind the head (h, w, 3), most of it as it was shown in the frame before.

        Nothing that was seen there comes back: it may be a face that something else has yet to hide.
        """
        if self._last is None or self._last[0] != index - 1:
            return behind
        _, before, last, away = self._last
        low = np.maximum(corner, before)
        high = np.minimum(np.add(corner, behind.shape[1::-1]), np.add(before, last.shape[1::-1]))
        if (high > low).all():
            now, then, share = (
                picture[low[1] - y : high[1] - y, low[0] - x : high[0] - x]
                for picture, (x, y) in ((behind, corner), (last, before), (away, before))
            )
            now += LIMITS.memory * share * (then - now)
        return behind

    def close(self) -> None:
        """Release the compositor."""
        self._compositor.close()


def _without_background(picture: U8, alpha: F32) -> U8:
    """A still (h, w, 3) in which what isn't wholly head has the colour of the head beside it: no halo surrounds it."""
    made = picture.reshape(-1, 3).copy()
    beside, nearest = beyond_mask(alpha > LIMITS.sure_share)
    made[beside] = made[nearest]
    return made.reshape(picture.shape)


def _ring(shape: F64, reach: float) -> F64:
    """Points (n, 2) on an ellipse around a face, at a distance in its widths."""
    centre, half = (shape.min(0) + shape.max(0)) / 2, np.ptp(shape, axis=0) / 2
    turn = np.linspace(0, 2 * np.pi, LIMITS.ring_points, endpoint=False)
    axes = half + reach * np.ptp(shape[:, 0])
    return np.asarray(centre + axes * np.column_stack([np.cos(turn), np.sin(turn)]))


def _depth(shape: F64) -> F64:
    """(2,) pixels by which what lies a face width behind a face (81, 2) is seen elsewhere, as the head is turned."""
    return np.asarray(SolidPrior.shipped().fit(shape).pose.linear[2])


def _rectangle(frame: Frame, head: FoundHead, vertices: F64) -> tuple[int, int, int, int]:
    """The rectangle of a found head and of what is drawn, in the frame."""
    far = head.corner + np.array(head.mask.shape[::-1]) / head.scale
    reached = np.concatenate([[head.corner, far], vertices])
    return frame.align_roi(*reached.min(0), *(reached.max(0) + 1))


def _behind(frame: Frame, seen: F32, away: F32, roi: tuple[int, int, int, int], plate: Plate | None) -> F32:
    """What is shown (h, w, 3) where the source's head was: the plate, or else the surroundings, continued.

    Telea, *An image inpainting technique based on the fast marching method*, Journal of Graphics Tools 9(1), 2004.
    """
    h, w = seen.shape[:2]
    size = _reduced(seen)
    lost = cv2.resize((away[..., 0] > 0).astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0
    small = cv2.resize(seen, size, interpolation=cv2.INTER_AREA)
    filled = cv2.inpaint(
        np.clip(small, 0, 255).astype(np.uint8),
        lost.astype(np.uint8),
        LIMITS.continued_from,
        cv2.INPAINT_TELEA,
    )
    found = cv2.resize(filled.astype(np.float32), (w, h), interpolation=cv2.INTER_CUBIC)
    if plate is None:
        return np.asarray(found, np.float32)
    picture, known = plate.within(frame, roi)
    return np.asarray(found + known[..., None] * (picture - found), np.float32)


def _face(mesh: F64, size: tuple[int, int]) -> F32:
    """(h, w) share in [0, 1] of the drawn face that stays."""
    first, last = (share * float(np.ptp(mesh[:, 0])) for share in LIMITS.face_edge_widths)
    inside = np.zeros(size, np.uint8)
    cv2.fillPoly(inside, [np.round(mesh[SILHOUETTE]).astype(np.int32)], 1)
    near = cv2.distanceTransform(np.pad(inside, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(np.clip((near - first) / max(last - first, 1.0), 0, 1), np.float32)


def _lit(head: F32, seen: F32, face: F32, face_width: float) -> F32:
    """The head (h, w, 3) in the light of the drawn face, which it meets without a seam."""
    weight = face[..., None]
    total = max(float(face.sum()), 1e-6)
    ratio = (seen * weight).sum((0, 1)) / np.maximum((head * weight).sum((0, 1)), total)
    gain = np.clip(ratio, *LIMITS.light_gain).astype(np.float32)
    brightness = np.float32(gain @ LUMA)
    # What is darker or greyer than skin, as hair is, takes less of its change of brightness or colour.
    as_bright = _as_on_skin(head @ LUMA, face)
    red, green, blue = cv2.split(head)
    most, least = cv2.max(cv2.max(red, green), blue), cv2.min(cv2.min(red, green), blue)
    as_coloured = _as_on_skin(np.asarray((most - least) / np.maximum(most, 1), np.float32), face)
    lit = head * brightness**as_bright * (gain / brightness) ** as_coloured
    h, w = face.shape
    size = _reduced(face)
    left, share = (cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in ((seen - lit) * weight, face))
    sigma = max(1.0, LIMITS.light_face_widths * face_width / LIMITS.reduction)
    left, share = (cv2.GaussianBlur(p, (0, 0), sigma) for p in (left, share))
    spread = cv2.resize(left / np.maximum(share, 0.15)[..., None], (w, h), interpolation=cv2.INTER_LINEAR)
    return np.asarray(np.clip(lit + spread, 0, 255), np.float32)


def _reduced(picture: F32) -> tuple[int, int]:
    """Width and height of a picture (h, w, ..) made smaller for what is smooth."""
    h, w = picture.shape[:2]
    return max(2, w // LIMITS.reduction), max(2, h // LIMITS.reduction)


def _as_on_skin(values: F32, face: F32) -> F32:
    """(h, w, 1) share in [0, 1] of values (h, w) of their mean over the face."""
    mean = float((values * face).sum()) / max(float(face.sum()), 1e-6)
    return np.asarray(np.clip(values / max(mean, 1e-3), 0, 1)[..., None], np.float32)
