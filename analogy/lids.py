"""The lids of a head: where their margins are seen from the front, and lids that meet when those of a source do.

Seen along the eye, the skin has a hole, be it an open border, a socket or a bag behind the lids.  Its upper and lower
edge, column by column from one corner to the other, are the margins.  Points of one column belong together on all
heads, which guides the registration, as do the creases of the upper lids; and the gap between the margins, relative to
that at rest, is what a transfer keeps.  Any unit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import vertex_normals
from guise.analogy.lid_crease import find_crease
from guise.analogy.mesh import Mesh
from guise.analogy.normals import unit_vectors
from guise.analogy.registration import skin_mask
from guise.analogy.views import OrthographicView
from guise.common.arrays import F64, U8, Bool, Int
from guise.render.visibility import visible

SIDES = ("right", "left")


@dataclass(frozen=True)
class LidSettings:
    """Settings of the lids; widths are the eye's, from corner to corner."""

    picture_px: int = 192  # side of the picture in which an eye is sought
    picture_widths: float = 1.8
    normal_reach_widths: float = 0.9  # around an eye, of the skin whose mean normal is the line of sight
    max_gap_widths: float = 0.8  # between the lids
    hole_depth_widths: tuple[float, ...] = (
        0.3,
        0.2,
        0.12,
    )  # behind the skin above and below; tried one by one
    margin_depth_widths: float = 0.04  # up to which the walls of a hole belong to it
    wall_cosine: float = 0.4  # between skin and line of sight, below which skin around a hole is its wall
    max_depth_widths: float = 0.4  # beyond which depths behind the lids do not matter
    margin_step_widths: float = 0.08  # between neighbouring pixels, which ends a hole
    min_hole_widths: float = 0.5  # from corner to corner
    max_hole_widths: float = 1.5
    max_offset_widths: float = 0.35  # of the hole from the middle between the feature points
    columns: int = 11  # in which margins are compared, corners left out
    max_crease_difference_widths: float = (
        0.065  # between heights of creases, beyond which they are other folds
    )
    margin_quantile: float = 0.25  # of the columns' openness, which is that of the margins
    max_fold_openness: float = 0.3  # beyond it, from which a column shows a fold over the lid
    closing_openness: tuple[float, float] = (0.6, 0.3)  # of the source, from which lids are moved, and fully
    max_fold_columns: int = 2  # more of which leave the lids as they are
    half_shut_share: float = 0.85  # of the openness of lids that still show something of the eye
    shut_share: float = 0.4  # of that of shut lids, which only have thickness, so that none stays open
    shut_openness: tuple[float, float] = (0.3, 0.15)  # of lids that are no longer half shut, and shut
    max_closing: float = (
        0.25  # mean of the gap at rest by which lids are moved; eyes that need more close less
    )
    upper_reach_widths: float = 0.1  # of the skin that a margin takes along
    lower_reach_widths: float = 0.055
    rounds: int = 4  # of moving margins
    larger_eyes_power: float = 0.63  # of the ratio of gaps, by which motion on larger eyes is scaled
    larger_eyes_reach_widths: tuple[float, float] = (0.7, 1.3)  # from an eye's middle, over which that fades
    max_larger_ratio: float = 1.15
    margin_trust: float = 3.0  # of a point of a margin in a registration, of that of other points
    crease_trust: float = 3.0
    brow_trust: float = 0.1
    corner_trust: float = 0.3  # of the eyes', where margins are known
    lip_corner_widths: float = 0.5  # of the skin that counts as a corner's; widths here are the mouth's


LIDS = LidSettings()


@dataclass(frozen=True, eq=False)
class SurfaceCurve:
    """Points on a mesh: corners (k, 3) and barycentric weights (k, 3)."""

    corners: Int
    weights: F64

    def at(self, vertices: F64) -> F64:
        """(k, 3) places on the mesh with vertices (N, 3)."""
        return np.asarray(np.einsum("kc,kci->ki", self.weights, vertices[self.corners]))


@dataclass(frozen=True, eq=False)
class Lids:
    """The margins of the lids of one eye, in columns from one corner to the other.

    Parameters
    ----------
    upper, lower : on the mesh.   width : of the eye.   crease : of the upper lid, None where it has none.
    """

    upper: SurfaceCurve
    lower: SurfaceCurve
    width: float
    crease: SurfaceCurve | None = None

    @property
    def margins(self) -> tuple[SurfaceCurve, SurfaceCurve]:
        """Upper and lower."""
        return self.upper, self.lower

    def crease_height(self, vertices: F64) -> float:
        """Mean height of the crease above the upper margin on the mesh with vertices (N, 3), in widths."""
        assert self.crease is not None
        away = np.linalg.norm(self.crease.at(vertices) - self.upper.at(vertices), axis=1)
        return float(away.mean()) / self.width

    def place(self, vertices: F64) -> tuple[F64, float]:
        """The middle (3,) of the eye on the mesh with vertices (N, 3), and its width."""
        return (self.upper.at(vertices).mean(0) + self.lower.at(vertices).mean(0)) / 2, self.width


LidPair = tuple[Lids, Lids]  # of one eye of the source and of the target


def find_lids(mesh: Mesh, points: F64) -> tuple[Lids | None, Lids | None]:
    """The lids of the right and the left eye; None where an eye is shut or has no hole.

    points : (20, 3) feature points, in the order of `FEATURE_POINT_NAMES`.
    """
    place = dict(zip(FEATURE_POINT_NAMES, points, strict=True))
    skin = skin_mask(mesh)
    faces = mesh.faces[skin[mesh.faces].all(1)]
    normals = vertex_normals(mesh.vertices, faces)
    across = place["eye_left_inner"] - place["eye_right_inner"]
    up = place["nose_bridge"] - (place["mouth_corner_left"] + place["mouth_corner_right"]) / 2
    forward = np.cross(across, up)
    first, second = (_find(mesh.vertices, faces, normals, place, side, forward, across) for side in SIDES)
    return first, second


def _find(
    vertices: F64, faces: Int, normals: F64, place: dict[str, F64], side: str, forward: F64, across: F64
) -> Lids | None:
    one, other = place[f"eye_{side}_outer"], place[f"eye_{side}_inner"]
    middle, width = (one + other) / 2, float(np.linalg.norm(one - other))
    if width <= 0:
        return None
    view = _eye_view(vertices, normals, middle, width, forward, across)
    near = np.linalg.norm(vertices - middle, axis=1) < 2 * LIDS.picture_widths * width
    drawn = faces[near[faces].any(1)]
    seen = visible(view.project(vertices), drawn, (view.pixels, view.pixels), "cpu")
    depth = np.full(seen.triangle.shape, -np.inf)
    depth[seen.covered] = seen.interpolated((vertices - middle) @ view.axes[2:].T, drawn)[:, 0]
    facing = np.ones(depth.shape)
    facing[seen.covered] = seen.interpolated(normals @ view.axes[2:].T, drawn)[:, 0]
    hole = _hole(depth, width, view, facing > LIDS.wall_cosine)
    if hole is None:
        return None
    high, low = _edges(hole)
    crease = find_crease(depth / width, high, view.pixels / (2 * view.half) * width)
    upper, lower, fold = (
        SurfaceCurve(drawn[seen.triangle[at]], seen.weights[at].astype(np.float64))
        for at in (high, low, crease or high)
    )
    return Lids(upper, lower, width, fold if crease else None)


def _eye_view(
    vertices: F64, normals: F64, middle: F64, width: float, forward: F64, across: F64
) -> OrthographicView:
    """Along the mean normal of the skin around an eye."""
    near = np.linalg.norm(vertices - middle, axis=1) < LIDS.normal_reach_widths * width
    facing = near & (normals @ unit_vectors(forward) > 0.5)
    sight = unit_vectors(normals[facing].sum(0) if facing.any() else forward)
    right = unit_vectors(across - across @ sight * sight)
    axes = np.stack([right, np.cross(sight, right), sight])
    return OrthographicView(axes, middle, LIDS.picture_widths * width / 2, LIDS.picture_px)


def _hole(depth: F64, width: float, view: OrthographicView, facing: Bool) -> Bool | None:
    """The pixels (h, w) between the lids of an eye in the middle; None if there is no such hole.

    They lie behind the skin above and below, and the depth steps at their edge, unlike in the hollow beside the nose.
    facing : (h, w) where the skin faces the viewer, unlike the walls between the lids and a hole that is narrower.
    """
    import cv2

    if not np.isfinite(depth).any():
        return None
    px = view.pixels / (2 * view.half) * width  # pixels in a width
    solid = np.where(np.isfinite(depth), depth / width, depth[np.isfinite(depth)].min() / width - 1)
    solid = solid.astype(np.float32)
    behind = (
        cv2.morphologyEx(solid, cv2.MORPH_CLOSE, np.ones((round(LIDS.max_gap_widths * px), 1), np.uint8))
        - solid
    )
    behind = np.minimum(behind, LIDS.max_depth_widths)
    around = np.ones((3, 3), np.uint8)
    level = cv2.dilate(behind, around) - cv2.erode(behind, around) < LIDS.margin_step_widths
    for least in LIDS.hole_depth_widths:
        eye = _central(level & (behind > least), px)
        if eye is not None:
            return _up_to_margins(eye > 0, ~(level & facing) & (behind > LIDS.margin_depth_widths))
    return None


def _up_to_margins(eye: Bool, walls: Bool) -> Bool:
    """A hole (h, w) extended upwards and downwards over its walls."""
    out = eye
    for _ in range(len(eye)):
        grown = out.copy()
        grown[1:] |= out[:-1] & walls[1:]
        grown[:-1] |= out[1:] & walls[:-1]
        if (grown == out).all():
            break
        out = grown
    return out


def _central(chosen: Bool, px: float) -> U8 | None:
    """The connected part of a picture (h, w) that may be an eye in its middle, px pixels wide."""
    import cv2

    size = len(chosen)
    count, labels, figures, middles = cv2.connectedComponentsWithStats(
        chosen.astype(np.uint8), connectivity=4
    )
    best = None
    for number in range(1, count):
        x, y, wide, high, area = figures[number]
        inside = x > 0 and y > 0 and x + wide < size and y + high < size
        central = np.linalg.norm(middles[number] - (size - 1) / 2) < LIDS.max_offset_widths * px
        fits = (
            LIDS.min_hole_widths * px < wide < LIDS.max_hole_widths * px and high < LIDS.max_gap_widths * px
        )
        if inside and central and fits and (best is None or area > figures[best][4]):
            best = number
    return None if best is None else (labels == best).astype(np.uint8)


def _edges(hole: Bool) -> tuple[tuple[Int, Int], tuple[Int, Int]]:
    """Rows and columns (k,) of pixels on the lids above and below a hole, evenly from corner to corner."""
    columns = np.flatnonzero(hole.any(0))
    chosen = np.linspace(columns[0], columns[-1], LIDS.columns + 2)[1:-1].round().astype(np.intp)
    first = hole[:, chosen].argmax(0)
    last = len(hole) - 1 - hole[::-1, chosen].argmax(0)
    return (first - 2, chosen), (last + 2, chosen)


@dataclass(frozen=True, eq=False)
class FacePair:
    """The faces of two heads.

    Parameters
    ----------
    points : feature points (20, 3) of source and target.   lids : of the eyes that are open on both.
    placed : whether somebody has placed the points, who is to be believed.
    creases : of the upper lids, of source and target, where they are the same fold.
    """

    points: tuple[F64, F64]
    lids: tuple[LidPair, ...]
    placed: bool = False
    creases: tuple[tuple[SurfaceCurve, SurfaceCurve], ...] = ()

    @classmethod
    def of(cls, source: Mesh, target: Mesh, points: tuple[F64, F64], *, placed: bool = False) -> FacePair:
        """From feature points (20, 3) of both."""
        both = (find_lids(mesh, places) for mesh, places in zip((source, target), points, strict=True))
        pairs = zip(*both, strict=True)
        lids = tuple((one, other) for one, other in pairs if one is not None and other is not None)
        return cls(points, lids, placed, _same_creases(lids, source.vertices, target.vertices))

    def with_margins(self, source: Mesh, target: Mesh) -> tuple[F64, F64]:
        """Corresponding points (k, 3) of both: feature points, the margins of the lids and their creases."""
        pairs = [pair for own, other in self.lids for pair in zip(own.margins, other.margins, strict=True)]
        pairs += self.creases
        first, second = (
            np.concatenate([points, *(_smooth(curve.at(mesh.vertices)) for curve in curves)])
            for points, mesh, curves in zip(
                self.points, (source, target), zip(*pairs, strict=True) if pairs else ((), ()), strict=True
            )
        )
        return first, second

    @property
    def trust(self) -> F64:
        """(k,) by which the points of `with_margins` count in a registration.

        Brows differ between artists and are detected less exactly, and margins say better than corners where eyes are.
        Points that somebody has placed count fully.
        """
        corners = LIDS.corner_trust if len(self.lids) == len(SIDES) else 1.0
        kinds = {} if self.placed else {"brow": LIDS.brow_trust, "eye": corners}
        points = [kinds.get(name.split("_")[0], 1.0) for name in FEATURE_POINT_NAMES]
        margins = 2 * LIDS.columns * len(self.lids) * [LIDS.margin_trust]
        return np.array(points + margins + LIDS.columns * len(self.creases) * [LIDS.crease_trust])

    def margins(self, target: F64) -> F64 | None:
        """(m, 3) places close together along the margins of the target (N, 3), from corner to corner; None without."""
        place = dict(zip(FEATURE_POINT_NAMES, self.points[1], strict=True))
        lines = []
        for _, eye in self.lids:
            middle = eye.place(target)[0]
            side = min(SIDES, key=lambda one: float(np.linalg.norm(place[f"eye_{one}_outer"] - middle)))
            ends = [place[f"eye_{side}_{end}"] for end in ("outer", "inner")]
            for curve in (eye.upper.at(target), eye.lower.at(target)):
                first, last = sorted(ends, key=lambda end: float(np.linalg.norm(end - curve[0])))
                lines.append(_finer(np.concatenate([[first], curve, [last]])))
        return np.concatenate(lines) if lines else None

    def slits(self, target: F64) -> list[tuple[F64, float]]:
        """Middle (3,) and width of what opens on the target (N, 3): its eyes, and both corners of its mouth."""
        place = dict(zip(FEATURE_POINT_NAMES, self.points[1], strict=True))
        corners = [place[f"mouth_corner_{side}"] for side in SIDES]
        width = LIDS.lip_corner_widths * float(np.linalg.norm(corners[1] - corners[0]))
        return [eye.place(target) for _, eye in self.lids] + [(corner, width) for corner in corners]


def _finer(curve: F64) -> F64:
    """A curve (k, 3) with eight places for each."""
    fine = np.linspace(0, len(curve) - 1, 8 * len(curve))
    return np.stack([np.interp(fine, np.arange(len(curve)), column) for column in curve.T], axis=1)


def _same_creases(
    lids: tuple[LidPair, ...], source: F64, target: F64
) -> tuple[tuple[SurfaceCurve, SurfaceCurve], ...]:
    """Creases of all upper lids, if those of both heads lie at about one height; else they may be other folds."""
    pairs = tuple((own.crease, other.crease) for own, other in lids if own.crease and other.crease)
    if not pairs or len(pairs) < len(lids):
        return ()
    apart = [abs(own.crease_height(source) - other.crease_height(target)) for own, other in lids]
    return pairs if np.mean(apart) < LIDS.max_crease_difference_widths else ()


def _smooth(curve: F64) -> F64:
    """A curve (k, 3) as cubic polynomials, without the steps of pixels and of the lid's thickness."""
    powers = np.vander(np.linspace(-1, 1, len(curve)), 4)
    return np.asarray(powers @ np.linalg.lstsq(powers, curve, rcond=None)[0])


def motion_ratios(lids: tuple[LidPair, ...], source: F64, target: F64, scale: float) -> F64:
    """(N_t,) by how much farther the skin of larger eyes moves than that of the source, scaled; 1 away from eyes.

    source, target : neutral vertices (N, 3).   scale : of the target, of the source.
    """
    full, none = LIDS.larger_eyes_reach_widths
    out = np.ones(len(target))
    for own, other in lids:
        gap, wide = (
            float(np.linalg.norm(_ways(eye, at), axis=1).mean())
            for eye, at in ((own, source), (other, target))
        )
        ratio = np.clip(wide / max(scale * gap, 1e-300), 1, LIDS.max_larger_ratio)
        middle, width = other.place(target)
        share = np.clip((none - np.linalg.norm(target - middle, axis=1) / width) / (none - full), 0, 1)
        out *= ratio ** (LIDS.larger_eyes_power * share**2 * (3 - 2 * share))
    return out


class LidMotion:
    """Moves the lids of an eye until the gap between their margins is that of the source's, relative to rest.

    Parameters
    ----------
    source, target : neutral vertices (N, 3).   lids : of both.
    """

    def __init__(self, source: F64, target: F64, lids: LidPair) -> None:
        self._source, self._lids = source, lids
        own, other = lids
        self._ways = [_ways(eye, vertices) for eye, vertices in zip(lids, (source, target), strict=True)]
        reaches = LIDS.upper_reach_widths * other.width, LIDS.lower_reach_widths * other.width
        self._upper, self._lower = (
            _Drag(target, curve, reach)
            for curve, reach in zip((other.upper, other.lower), reaches, strict=True)
        )
        self._own = own

    def __call__(self, expressive: F64, made: F64) -> F64:
        """The target (N_t, 3) with its lids moved, for a source (N_s, 3) without the motion of the head."""
        shown = _openness(self._lids[0], expressive, self._ways[0])
        middle = float(np.median(shown))
        high = np.linalg.norm(self._own.upper.at(expressive) - self._own.upper.at(self._source), axis=1)
        low = np.linalg.norm(self._own.lower.at(expressive) - self._own.lower.at(self._source), axis=1)
        share = (high / np.maximum(high + low, 1e-300))[:, None]
        first, last = LIDS.closing_openness
        closing = min(1.0, (first - middle) / (first - last))
        now = _openness(self._lids[1], made, self._ways[1])
        margin = _is_margin(now)
        if closing <= 0 or not (_mostly(_is_margin(shown)) and _mostly(margin)):
            return made
        part = np.interp(middle, LIDS.shut_openness[::-1], (LIDS.shut_share, LIDS.half_shut_share))
        excess = np.maximum(now - part * np.maximum(shown, middle), 0)
        wanted = now - excess * min(1.0, LIDS.max_closing / max(float(excess[margin].mean()), 1e-300))
        most = max(float(high.max()), float(low.max())) / self._own.width * self._lids[1].width
        for _ in range(LIDS.rounds):
            excess = np.maximum(_openness(self._lids[1], made, self._ways[1]) - wanted, 0) * closing
            step = _over_folds(excess[:, None] * self._ways[1], margin)
            step *= np.minimum(1, most / np.linalg.norm(step, axis=1, keepdims=True).clip(1e-300))
            made = self._lower(self._upper(made, share * step), (share - 1) * step)
        return made


def _is_margin(openness: F64) -> Bool:
    """(k,) whether a column shows the margins: a fold over a lid, taken for its margin, closes much less."""
    return np.asarray(openness <= np.quantile(openness, LIDS.margin_quantile) + LIDS.max_fold_openness)


def _mostly(margin: Bool) -> bool:
    """Whether so few columns show a fold that lids may be moved by the others."""
    return int((~margin).sum()) <= LIDS.max_fold_columns


def _over_folds(steps: F64, margin: Bool) -> F64:
    """Steps (k, 3), those of columns that are no margin interpolated between the others."""
    every, known = np.arange(len(steps)), np.flatnonzero(margin)
    return np.stack([np.interp(every, known, column[known]) for column in steps.T], axis=1)


def _ways(eye: Lids, vertices: F64) -> F64:
    """(k, 3) from the upper margin down to the lower one."""
    return eye.lower.at(vertices) - eye.upper.at(vertices)


def _openness(eye: Lids, vertices: F64, rest: F64) -> F64:
    """(k,) the gap along that at rest (k, 3), of it; negative where the lids overlap."""
    return np.asarray((_ways(eye, vertices) * rest).sum(1) / np.maximum((rest * rest).sum(1), 1e-300))


class _Drag:
    """Moves the skin around a margin with it, as far as it moves with the margin already, up to a reach."""

    def __init__(self, vertices: F64, margin: SurfaceCurve, reach: float) -> None:
        self._rest, self._margin, curve = vertices, margin, margin.at(vertices)
        fine = np.linspace(0, len(curve) - 1, 8 * len(curve))
        line = _finer(curve)
        away, near = cKDTree(line).query(vertices, distance_upper_bound=reach)
        self._rows = np.flatnonzero(away < reach)
        self._share = (1 - (away[self._rows] / reach) ** 2) ** 2
        at = fine[near[self._rows]]
        self._first = np.minimum(at.astype(np.intp), len(curve) - 2)
        self._along = (at - self._first)[:, None]

    def __call__(self, vertices: F64, step: F64) -> F64:
        """Vertices (N, 3) moved by steps (k, 3) of the margin."""
        own = np.linalg.norm((vertices - self._rest)[self._rows], axis=1)
        margin = np.linalg.norm(
            self._margin.at(vertices) - self._margin.at(self._rest), axis=1, keepdims=True
        )
        there = self._at_rows(margin)[:, 0]
        share = self._share * np.clip(own / np.maximum(there, 1e-300), 0, 1)
        out = vertices.copy()
        out[self._rows] += share[:, None] * self._at_rows(step)
        return out

    def _at_rows(self, values: F64) -> F64:
        """Values (k, d) of the margin, at the nearest place on it of each vertex that moves with it."""
        return np.asarray((1 - self._along) * values[self._first] + self._along * values[self._first + 1])
