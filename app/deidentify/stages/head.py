"""Another head in place of the source's: hair, ears and outline too, around a face that has been swapped.

A still of a head is warped so that its face lies on the drawn one, as in `guise.app.swapping.puppet`; the source's head
is found as `head_matte` tells.  What was behind the source's head is a plate where one is known, and
otherwise the surroundings, continued; its neck stays.  Pixels, x right, y down; RGB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np

from guise.aam.landmarks.schemes import RIGID_WEIGHTS, SILHOUETTE
from guise.aam.light import LUMA
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import SolidPrior
from guise.app.deidentify.stages.head_matte import FoundHead, Gap, Roi
from guise.app.deidentify.stages.head_still import HeadStill
from guise.app.deidentify.stages.neck import necked
from guise.app.media import Frame
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.closing import Closing
from guise.render import make_compositor


@dataclass(frozen=True)
class HeadLimits:
    """Sizes and thresholds."""

    max_rim_share: float = (
        0.1  # of where heads end at the latest, above the chin: with more the head is not known
    )
    max_hidden_share: float = 0.22  # of the face behind objects, likewise
    max_turn_degrees: float = 40.0
    # Within the drawn face, which passes into the head there unless it is turned away by these shares of its width.
    face_edge_widths: tuple[float, float] = (0.06, 0.14)
    far_depth_shares: tuple[float, float] = (0.1, 0.3)
    light_face_widths: float = 0.15  # over which the light of the drawn face is carried into the head
    light_gain: tuple[float, float] = (0.5, 1.6)
    edge_face_widths: float = 0.06  # from the face's edge to the still points beside it,
    rings_face_widths: tuple[float, ...] = (0.18, 1.8)  # and to those around the face,
    depth_face_widths: tuple[float, ...] = (0.04, 0.12, 0.35)  # which lie so far behind that edge,
    ears_face_widths: float = 0.46  # or as far back as ears, where a forehead is turned here, or an ear away
    ears_sines: tuple[float, float] = (-0.1, 0.5)  # of the places of ears on the ellipses
    ears_share: float = 0.1  # of a face width, by which ears must be seen aside for that
    ring_points: int = 28
    plate_spread_levels: float = 8.0  # of a pixel in time, up to which what is behind the head is known
    plate_min_pictures: int = 3
    plate_side_pixels: int = 960  # the longer one
    smooth_face_pixels: float = 48.0  # width of the face at which what is smooth is worked out
    surroundings_face_widths: float = 0.2  # of a head, that are continued behind it
    continued_pixels: float = 3.0  # of the smaller size, standard deviation of what is continued
    memory: float = 0.9  # share of what is behind the head that is as in the frame before


LIMITS = HeadLimits()
DARK_LEVEL = 48  # of a colour, below which its tint says little
PLATE_EDGE_PIXELS = 12  # of a plate, about where heads are
Picture = TypeVar("Picture", U8, F32)


def knows_head(head: FoundHead, shape: F64) -> bool:
    """Whether a head can be replaced: near the front, all of it where it is looked for, nothing before it."""
    yaw, pitch, _ = SolidPrior.shipped().fit(shape).pose.angles
    rim = head.places.rim()
    return bool(
        np.hypot(yaw, pitch) <= LIMITS.max_turn_degrees
        and head.mask[rim].sum() <= LIMITS.max_rim_share * rim.sum()
        and head.hidden_share <= LIMITS.max_hidden_share
    )


@dataclass(frozen=True, eq=False)
class Plate:
    """What is behind the heads of a shot.

    picture : (h, w, 3) float32 RGB, smaller than the frames.   known : (h, w) in [0, 1], where it can be relied on.
    """

    picture: F32
    known: F32

    @classmethod
    def of(cls, pictures: Sequence[U8], heads: Sequence[U8]) -> Plate:
        """The median over pictures of a shot where no head is; heads (h, w) are not 0 where one may be.

        It is known only about where a head may be at some time.
        """
        x, y, w, h = cv2.boundingRect(np.maximum.reduce(heads))
        edge = PLATE_EDGE_PIXELS
        part = np.s_[max(0, y - edge) : y + h + edge, max(0, x - edge) : x + w + edge]
        stack = np.stack([picture[part] for picture in pictures]).astype(np.float32)
        stack[np.stack([head[part] for head in heads]) > 0] = np.nan
        count = np.isfinite(stack[..., 0]).sum(0)
        low, middle, high = _quartiles(stack)
        steady = (high - low).max(2) <= LIMITS.plate_spread_levels
        known = np.zeros(heads[0].shape, np.float32)
        known[part] = steady & (count >= LIMITS.plate_min_pictures)
        picture = np.zeros(pictures[0].shape, np.float32)
        picture[part] = middle
        soft = cv2.GaussianBlur(cv2.erode(known, np.ones((5, 5))), (0, 0), 2.0)
        return cls(picture, np.asarray(soft, np.float32))

    def within(self, frame: Frame, roi: Roi) -> tuple[F32, F32]:
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


@dataclass(frozen=True, eq=False)
class Behind:
    """What is shown in place of a head: a rectangle of the frame, and its picture (h, w, 3), RGB."""

    roi: Roi
    picture: F32


class HeadPainter(Closing):
    """Draws a head around a swapped face; use it by `with`.

    still : of the head.   renderer : see `make_compositor`.
    """

    def __init__(self, still: HeadStill, renderer: str) -> None:
        from scipy.spatial import Delaunay  # slow to import, and a face alone doesn't need it

        self._still, self._around = still, Around(still)
        # Index, corner, what was shown behind the head, and where.
        self._last: tuple[int, tuple[int, int], F32, F32] | None = None
        self._smaller, self._texture = 0.0, still.picture
        points = np.concatenate([still.shape, self._around.points])
        self._compositor = make_compositor(
            renderer,
            Delaunay(points).simplices.astype(np.int32),
            points.astype(np.float32),
            still.alpha,
        )

    def behind(
        self, frame: Frame, width: float, gap: Gap, others: Sequence[Gap], plate: Plate | None
    ) -> Behind:
        """What is behind the source's head in a frame in which nothing has been drawn yet.

        width : of the source's face, pixels.   others : what other heads leave that are to be replaced.
        """
        margin = LIMITS.surroundings_face_widths * width
        (left, top), (right, bottom) = gap.corners
        roi = frame.align_roi(left - margin, top - margin, right + margin, bottom + margin)
        if min(roi[2:]) < 2:
            return Behind(roi, np.zeros((roi[3], roi[2], 3), np.float32))
        reduced = max(1.0, width / LIMITS.smooth_face_pixels)
        away = gap.share(roi)
        lost = np.maximum.reduce([away, gap.body_share(roi), *(other.share(roi) for other in others)])
        made = self._steadied(_behind(frame, lost > 0, reduced, roi, plate), frame.index, roi[:2])
        self._last = frame.index, roi[:2], made, away
        return Behind(roi, made)

    def draw(self, frame: Frame, mesh: F64, gap: Gap, behind: Behind) -> None:
        """Replace the head of the source, whose face has been drawn at `mesh` (81, 2), in place."""
        depth, width = _depth(mesh), float(np.ptp(mesh[:, 0]))
        vertices = np.concatenate([mesh, self._around.placed(mesh, depth)])
        x, y, wide, high = behind.roi
        reached = np.concatenate([[(x, y), (x + wide, y + high)], vertices + 1, vertices - 1])
        roi = frame.align_roi(*reached.min(0), *reached.max(0))
        x0, y0, w, h = roi
        if w < 2 or h < 2:
            return
        seen = frame.rgb_roi(*roi)
        made = seen.copy()
        if wide and high:
            part = made[y - y0 : y - y0 + high, x - x0 : x - x0 + wide]
            filled = np.asarray(cv2.convertScaleAbs(behind.picture), np.uint8)
            part[:] = _mixed(np.ascontiguousarray(part), filled, gap.share(behind.roi))
        self._look_from(width)
        other = self._compositor.warp((h, w), self._texture, vertices - (x0, y0))
        head = np.asarray(cv2.cvtColor(other, cv2.COLOR_RGBA2RGB), np.uint8)
        face = _face(mesh - (x0, y0), depth, (h, w))
        if self._still.before is not None:
            hair = np.repeat(self._still.before[..., None], 3, 2)
            over = self._compositor.warp((h, w), hair, vertices - (x0, y0))[..., 0]
            face = np.asarray(face * (1 - over / np.float32(255)), np.float32)
        reduced = max(1.0, width / LIMITS.smooth_face_pixels)
        lit = _lit(head, seen, face, reduced, LIMITS.light_face_widths * width)
        share = np.asarray(other[..., 3] / np.float32(255), np.float32)
        made = _mixed(necked(made, lit, share, mesh - (x0, y0)), lit, share)
        made = _mixed(made, seen, face)
        stored = frame.read_roi(*roi)
        drawn = np.asarray(cv2.transform(made, frame.colour.from_rgb), np.uint8)
        np.copyto(stored, drawn, where=(made != seen).any(2, keepdims=True))
        frame.write_roi(x0, y0, stored)

    def _look_from(self, width: float) -> None:
        """Have the still as it is seen with a face of this width, in steps of a tenth."""
        smaller = 1.1 ** round(np.log(float(np.ptp(self._still.shape[:, 0])) / width) / np.log(1.1))
        if smaller != self._smaller:
            self._smaller = smaller
            self._texture, alpha = self._still.seen(smaller)
            self._compositor.set_alpha(alpha)

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
            now[:] = _mixed(now, then, LIMITS.memory * share)
        return behind

    def close(self) -> None:
        """Release the compositor."""
        self._compositor.close()


class Around:
    """Points (n, 2) of a still around its face, none far beyond its head, and how they move with the face.

    They lie behind the face's edge, or as far back as the ears: hair beside a forehead that is turned here, and the ear
    that is turned away.
    """

    def __init__(self, still: HeadStill) -> None:
        shape = self._shape = still.shape
        edge, width = shape[SILHOUETTE], float(np.ptp(shape[:, 0]))
        centre, half = (shape.min(0) + shape.max(0)) / 2, np.ptp(shape, axis=0) / 2
        turn = np.linspace(0, 2 * np.pi, LIMITS.ring_points, endpoint=False)
        circle = np.column_stack([np.cos(turn), np.sin(turn)])
        outward = (edge - centre) / np.linalg.norm(edge - centre, axis=1, keepdims=True)
        rings = [centre + (half + reach * width) * circle for reach in LIMITS.rings_face_widths]
        x, y, w, h = cv2.boundingRect((still.alpha > 0).astype(np.uint8))
        points = np.concatenate([edge + LIMITS.edge_face_widths * width * outward, *rings])
        far = np.array(still.alpha.shape[::-1]) - 1
        self.points = np.clip(points, np.maximum((x - 1, y - 1), 0), np.minimum((x + w, y + h), far))
        near = 1 / (np.square(self.points[:, None] - edge).sum(2) + 1)
        self._near = near / near.sum(1, keepdims=True)
        counts = (len(edge), *(len(ring) for ring in rings))
        self._behind = np.repeat(LIMITS.depth_face_widths, counts)[:, None]
        self._aside, down = np.concatenate([outward, *[circle] * len(rings)]).T
        self._above = np.abs(self._aside) * (down < 0)
        first, last = LIMITS.ears_sines
        self._ears = (first < down) & (down < last)
        self._depth = _depth(shape)

    def placed(self, mesh: F64, depth: F64) -> F64:
        """Where they are (n, 2) about a mesh (81, 2); depth : as of `_depth`."""
        fit = align_planar(self._shape, mesh, RIGID_WEIGHTS)
        edge = self._near @ (mesh - fit.apply(self._shape))[SILHOUETTE]
        turned = depth - self._depth @ fit.linear
        here = self._aside * depth[0] / float(np.ptp(mesh[:, 0]))
        near, far = (np.interp(side * here, (0, LIMITS.ears_share), (0, 1)) for side in (1, -1))
        as_ears = np.maximum(self._above * near, self._ears * far)[:, None]
        behind_edge = edge + self._behind * turned
        moved = behind_edge + as_ears * (LIMITS.ears_face_widths * turned - behind_edge)
        return np.asarray(fit.apply(self.points) + moved)


def _depth(shape: F64) -> F64:
    """(2,) pixels by which what lies a face width behind a face (81, 2) is seen elsewhere, as the head is turned."""
    return np.asarray(SolidPrior.shipped().fit(shape).pose.linear[2])


def _behind(frame: Frame, lost: Bool, reduced: float, roi: Roi, plate: Plate | None) -> F32:
    """What is shown (h, w, 3) where a picture is lost (h, w): the plate, or else the surroundings, continued.

    They are continued in a picture that is smaller by a factor.
    """
    h, w = lost.shape
    size = _reduced(lost.shape, reduced)
    unknown = cv2.resize(lost.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0
    unknown = cv2.dilate(unknown.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    small = cv2.resize(frame.rgb_roi(*roi), size, interpolation=cv2.INTER_AREA)
    filled = _continued(small.astype(np.float32), np.asarray(~unknown, np.float32))
    found = np.asarray(cv2.resize(filled, (w, h), interpolation=cv2.INTER_LINEAR), np.float32)
    if plate is None:
        return found
    picture, known = plate.within(frame, roi)
    return _mixed(found, picture, known)


def _reduced(shape: tuple[int, ...], factor: float) -> tuple[int, int]:
    """Width and height of a picture (h, w) made smaller by a factor."""
    h, w = shape
    return max(2, round(w / factor)), max(2, round(h / factor))


def _continued(picture: F32, known: F32) -> F32:
    """A picture (h, w, 3) whose pixels that are not known (h, w) look like the nearest that are, softly.

    Shoulders and background go on behind a head up to where they meet.
    """
    if not known.any():
        return picture
    soft = cv2.GaussianBlur(known, (0, 0), LIMITS.continued_pixels)[..., None]
    smooth = cv2.GaussianBlur(picture * known[..., None], (0, 0), LIMITS.continued_pixels) / np.maximum(
        soft, 1e-3
    )
    _, labels = cv2.distanceTransformWithLabels(
        (known == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    sources = np.zeros(labels.max() + 1, np.intp)
    sources[labels[known > 0]] = np.flatnonzero(known)
    nearest = smooth.reshape(-1, 3)[sources[labels]]
    filled = np.asarray(cv2.GaussianBlur(nearest, (0, 0), LIMITS.continued_pixels / 2), np.float32)
    return _mixed(filled, picture, known)


def _mixed(under: Picture, over: Picture, share: F32) -> Picture:
    """Two pictures (h, w, 3), over each other by its share (h, w) in [0, 1]."""
    return np.asarray(cv2.blendLinear(under, over, 1 - share, share), under.dtype)


def _face(mesh: F64, depth: F64, size: tuple[int, int]) -> F32:
    """(h, w) share in [0, 1] of the drawn face that stays: on the far side of a turned head up to its very edge.

    depth : as of `_depth`.
    """
    width, edge = float(np.ptp(mesh[:, 0])), mesh[SILHOUETTE]
    first, last = (share * width for share in LIMITS.face_edge_widths)
    outward = edge - mesh.mean(0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    far = np.interp(-outward @ depth / width, LIMITS.far_depth_shares, (0, 1))[:, None]
    inside, wider = np.zeros((2, *size), np.uint8)
    for area, outline in ((inside, edge), (wider, edge + far * last * outward)):
        cv2.fillPoly(area, [np.round(outline).astype(np.int32)], 1)
    near = cv2.distanceTransform(np.pad(wider, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]
    return np.asarray(inside * np.clip((near - first) / max(last - first, 1.0), 0, 1), np.float32)


def _lit(head: U8, seen: U8, face: F32, factor: float, reach: float) -> U8:
    """The head (h, w, 3) in the light of the drawn face, which it meets without a seam.

    reach : how far the light is carried, pixels.   factor : by which pictures are made smaller for it.
    """
    size = _reduced(face.shape, factor)
    reduced = (
        cv2.resize(p, size, interpolation=cv2.INTER_AREA).astype(np.float32) for p in (head, seen, face)
    )
    small, target, weight = (np.asarray(p, np.float32) for p in reduced)
    total = max(float(weight.sum()), 1e-6)
    mean, wanted = ((p * weight[..., None]).sum((0, 1)) for p in (small, target))
    gain = np.clip(wanted / np.maximum(mean, total), *LIMITS.light_gain).astype(np.float32)
    brightness = np.float32(gain @ LUMA)
    # What is darker or greyer than skin, as hair is, takes less of its change of brightness or colour.
    as_bright = _as_on_skin(small @ LUMA, weight)
    most = small.max(2)
    as_coloured = _as_on_skin((most - small.min(2)) / np.maximum(most, DARK_LEVEL), weight)
    change = brightness**as_bright * (gain / brightness) ** as_coloured
    left, share = (
        cv2.GaussianBlur(p, (0, 0), max(1.0, reach / factor))
        for p in ((target - small * change) * weight[..., None], weight)
    )
    spread = as_bright * left / np.maximum(share, 0.15)[..., None]
    whole = [cv2.resize(p, face.shape[::-1], interpolation=cv2.INTER_LINEAR) for p in (change, spread)]
    lit = cv2.add(cv2.multiply(head, whole[0], dtype=cv2.CV_32F), whole[1], dtype=cv2.CV_8U)
    return np.asarray(lit, np.uint8)


def _as_on_skin(values: F32, face: F32) -> F32:
    """(h, w, 1) share in [0, 1] of values (h, w) of their mean over the face."""
    mean = float((values * face).sum()) / max(float(face.sum()), 1e-6)
    return np.asarray(np.clip(values / max(mean, 1e-3), 0, 1)[..., None], np.float32)
