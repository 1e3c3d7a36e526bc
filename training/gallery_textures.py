"""What the fictional people of the gallery have on their skin, for both their renderers."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from guise.aam.landmarks.schemes import LEFT_MOUTH_CORNER, OUTER_LIPS, RIGHT_MOUTH_CORNER
from guise.common.arrays import F32, F64, U8, Bool, Int

TILE_PIXELS, TILE_MILLIMETRES = 1024, 70.0  # of the map of fine skin; 16 tiles lie across the skin's texture
TILES = 16
MILLIMETRE = TILE_PIXELS / TILE_MILLIMETRES
PORES = 7000  # of a tile
SPOTS = 90
OUTER_ENDS = 0.15  # share of the hair at the brows' outer ends, which would look like drawn lines
SEED = 810_000
LUMINANCE = np.array([0.3, 0.55, 0.15], np.float32)


def fine_skin(rng: np.random.Generator) -> U8:
    """A tile (n, n, 4): gradient of the height, brightness of pores and spots, and mottling; it repeats seamlessly."""
    height, bright, mottle = fine_planes(rng)
    across = np.roll(height, -1, 1) - np.roll(height, 1, 1)
    along = np.roll(height, 1, 0) - np.roll(height, -1, 0)
    planes = [across / across.std() * 0.12, along / along.std() * 0.12, bright * 0.045, mottle * 0.055]
    return np.asarray(np.clip(np.dstack(planes) + 0.5, 0, 1) * 255 + 0.5, np.uint8)


def fine_planes(rng: np.random.Generator) -> tuple[F32, F32, F32]:
    """Tiles (n, n): height, brightness of pores and spots, and mottling, of about unit deviation."""
    height = 0.55 * band(rng, 0.25, 0.6) + 0.35 * band(rng, 0.6, 1.6) - 1.6 * dots(rng, PORES, (0.10, 0.22))
    spots = dots(rng, SPOTS, (0.25, 0.6))
    bright = (
        0.5 * band(rng, 0.3, 0.8)
        + 0.5 * band(rng, 0.8, 2.5)
        - 1.4 * dots(rng, PORES, (0.12, 0.25))
        - 2.2 * spots
    )
    mottle = 0.6 * band(rng, 0.7, 2.0) + 0.8 * band(rng, 2.0, 7.0) + 1.5 * spots
    return height, bright, mottle


def band(rng: np.random.Generator, fine: float, coarse: float) -> F32:
    """Noise (n, n) of unit deviation between two widths in millimetres."""
    noise = rng.standard_normal((TILE_PIXELS, TILE_PIXELS)).astype(np.float32)
    found = blurred(noise, fine * MILLIMETRE) - blurred(noise, coarse * MILLIMETRE)
    return np.asarray(found / found.std(), np.float32)


def dots(rng: np.random.Generator, count: int, radii: tuple[float, float]) -> F32:
    """Random soft dots (n, n), 1 in their middles, radii in millimetres."""
    groups = 4
    found = np.zeros((TILE_PIXELS, TILE_PIXELS), np.float32)
    for radius in np.linspace(*radii, groups):
        sparse = np.zeros_like(found)
        x, y = rng.integers(0, TILE_PIXELS, (2, count // groups))
        sparse[y, x] = rng.uniform(0.3, 1.0, len(x))
        sigma = radius * MILLIMETRE
        found = np.maximum(found, blurred(sparse, sigma) * np.float32(2 * np.pi * sigma**2))
    return np.minimum(found, 1)


def blurred(picture: F32, sigma: float) -> F32:
    """Gaussian blur of a tile, across its edges."""
    edge = int(4 * sigma) + 1
    wide = cv2.GaussianBlur(np.pad(picture, edge, mode="wrap"), (0, 0), sigma)
    return np.asarray(wide[edge:-edge, edge:-edge], np.float32)


def grown_brows(card: U8, rng: np.random.Generator, hairs: int, inner_ends: float) -> U8:
    """A texture of two brows (h, w, 4) with thinner hairs, and stray ones about them along the way they grow.

    inner_ends : share of the hair at the brows' inner ends, which grows to all of it within a third of their length.
    """
    alpha = card[..., 3].astype(np.float32) / 255
    gx, gy = (cv2.Sobel(cv2.GaussianBlur(alpha, (0, 0), 0.8), cv2.CV_32F, *d) for d in ((1, 0), (0, 1)))
    xx, yy, xy = (cv2.GaussianBlur(a * b, (0, 0), 9.0) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    way = 0.5 * np.arctan2(2 * xy, xx - yy) + np.pi / 2
    near = cv2.GaussianBlur(alpha, (0, 0), 4.0)
    likely = np.clip(near / near.max(), 0, 1) ** 0.5 * (near > 0.02)
    strays = np.zeros_like(alpha)
    places = rng.choice(likely.size, hairs, p=(likely / likely.sum()).ravel())
    for place in places:
        y, x = divmod(int(place), likely.shape[1])
        turn = way[y, x] + rng.normal(0, 0.22)
        points = [np.array([x, y], float)]
        for _ in range(int(rng.integers(5, 11))):
            points.append(points[-1] + 2.4 * np.array([np.cos(turn), np.sin(turn)]))
            turn += rng.normal(0, 0.05)
        line = np.round(np.array(points) * 16).astype(np.int32)
        cv2.polylines(strays, [line], False, float(rng.uniform(0.25, 0.75)), 1, cv2.LINE_AA, 4)
    gaps = cv2.GaussianBlur(rng.standard_normal(alpha.shape).astype(np.float32), (0, 0), 3.0)
    gaps = np.clip(0.85 + 0.12 * gaps / gaps.std(), 0.25, 1)
    between = 0.8 * cv2.GaussianBlur(alpha, (0, 0), 5.0)  # hairs beneath, without which gaps look like specks
    soft = np.maximum(cv2.GaussianBlur(alpha, (0, 0), 0.7) * gaps, between)
    grown = card.copy()
    ends = density(card[..., 3] > 12, inner_ends, OUTER_ENDS)
    grown[..., 3] = np.clip(np.maximum(soft, 0.8 * strays) * ends * 255, 0, 255)
    grown[..., :3] = np.where(alpha[..., None] > 0.05, card[..., :3], 60)
    return grown


def density(hair: Bool, inner: float, outer: float) -> F32:
    """(h, w) share of the hair that is left, less at two brows' ends: the upper one's inner is left."""
    rows, columns = (np.flatnonzero(hair.any(axis)) for axis in (1, 0))
    along = (np.arange(hair.shape[1]) - columns[0]) / (columns[-1] - columns[0])
    upper, lower = (np.interp(way, [0, 0.35, 0.6, 1], [inner, 1, 1, outer]) for way in (along, 1 - along))
    return np.asarray(np.where(np.arange(len(hair))[:, None] < rows.mean(), upper, lower), np.float32)


def thin_lashes(card: U8) -> U8:
    """The texture of the lashes (h, w, 4), each of them thinner, and those of the lower lids fainter."""
    _, labels, _, centres = cv2.connectedComponentsWithStats((card[..., 3] > 40).astype(np.uint8))
    lower = centres[:, 1] > 0.57 * len(card)
    alpha = cv2.erode(card[..., 3], np.ones((2, 2), np.uint8)).astype(np.float32) * 0.8
    grown = cv2.dilate(lower[labels].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    thin = card.copy()
    thin[..., 3] = np.where(grown, 0.4 * alpha, alpha)
    return thin


def at_rest(program, spec: dict, weights: F32) -> F32:
    """A frame's weights of the expression, on top of a face at rest that neither frowns nor parts its lips."""
    at, weights = program["human"].UIX, weights.copy()
    lift, raised = spec.get("inner_brows", 0.8), spec.get("brows_raised", 0.0)
    for side in ("left", "right"):
        weights[at[f"eyebrows-{side}-inner-up"]] += lift
        weights[at[f"eyebrows-{side}-up"]] += raised
    weights[at["mouth-open"]] -= spec.get("mouth_shut", 0.03)
    return weights


def plain_lips(colour: F32, uv: F64, tint: F32, rng: np.random.Generator) -> tuple[F32, F32]:
    """The colours of skin (n, n, 3) whose lips end softly and have fine creases, and the lips' share (n, n).

    The renderer's textures hold 30 texels of a mouth, on its side, with a bright rim: nothing there stays brighter than
    the skin around it.   uv : (68, 2) of the landmarks.   tint : of the lips.
    """
    side = len(colour)
    points = np.column_stack([uv[:, 0], 1 - uv[:, 1]]) * side
    outer = smooth_outline(points[list(OUTER_LIPS)])
    lips = soft_polygon(side, outer, 2.5)
    away = 1 - np.clip(soft_polygon(side, outer, 6.0) * 3, 0, 1)
    skin, soft = filled(colour, away, 14.0), cv2.GaussianBlur(colour, (0, 0), 1.8)
    most = (skin @ LUMINANCE) * (1 - 0.15 * lips)
    soft *= np.minimum(most / np.maximum(soft @ LUMINANCE, 1e-4), 1)[..., None]
    along = points[LEFT_MOUTH_CORNER] - points[RIGHT_MOUTH_CORNER]
    ys, xs = np.mgrid[:side, :side].astype(np.float32)
    x, y = points[RIGHT_MOUTH_CORNER]
    place = ((xs - x) * along[0] + (ys - y) * along[1]) / np.linalg.norm(along)
    place += 1.2 * noise(rng, side, 5.0)
    creases = cv2.GaussianBlur(rng.standard_normal((1, 4 * side)).astype(np.float32), (0, 0), 2.5)[0]
    lined = np.interp(place * 4 + 2 * side, np.arange(4 * side), creases / creases.std()).astype(np.float32)
    shade = 1 + lips * (0.03 * lined + 0.03 * noise(rng, side, 1.5) + 0.04 * noise(rng, side, 6.0))
    lips = np.clip(lips + 0.1 * noise(rng, side, 1.8) * lips * (1 - lips) * 4, 0, 1)
    painted = soft * (1 + (tint - 1) * lips[..., None]) * shade[..., None]
    plain = away[..., None]
    return np.asarray(colour * plain + painted * (1 - plain), np.float32), lips


def noise(rng: np.random.Generator, side: int, sigma: float) -> F32:
    """Soft noise (n, n) of unit deviation."""
    found = cv2.GaussianBlur(rng.standard_normal((side, side)).astype(np.float32), (0, 0), sigma)
    return np.asarray(found / found.std(), np.float32)


def smooth_outline(points: F64) -> F64:
    """A closed smooth curve through points (n, 2): Catmull and Rom's."""
    before, after, last = (np.roll(points, shift, 0) for shift in (1, -1, -2))
    t = np.linspace(0, 1, 12, endpoint=False)[:, None, None]
    curve = points + t * (after - before) / 2 + t**2 * (before - 2.5 * points + 2 * after - last / 2)
    return np.asarray(
        (curve + t**3 * (1.5 * (points - after) + (last - before) / 2)).swapaxes(0, 1).reshape(-1, 2)
    )


def soft_polygon(side: int, outline: F64, sigma: float) -> F32:
    """The share (n, n) of a picture within an outline, blurred."""
    mask = np.zeros((side, side), np.uint8)
    cv2.fillPoly(mask, [np.round(outline * 16).astype(np.int32)], 255, cv2.LINE_AA, 4)
    return np.asarray(cv2.GaussianBlur(mask, (0, 0), sigma).astype(np.float32) / 255)


def filled(colour: F32, known: F32, sigma: float) -> F32:
    """A picture (n, n, 3) continued smoothly from where it is known (n, n)."""
    weight = known[..., None] + 1e-6
    near = cv2.GaussianBlur(colour * weight, (0, 0), sigma)
    return np.asarray(near / cv2.GaussianBlur(known + 1e-6, (0, 0), sigma)[..., None], np.float32)


@dataclass(frozen=True)
class Strands:
    """Hairs: points (n, k, 3) from root to tip, and radii (n, k), decimetres."""

    points: F64
    radii: F64


BROW_MILLIMETRES = 50.0  # length of a brow
HAIRS = 2.6  # of a brow, a square millimetre
KNOTS = 8
NEAR_TRIANGLES = 8
HAIR_RADIUS = 0.0004  # decimetres


def brow_strands(card: U8, surface: Card, spec: dict, rng: np.random.Generator) -> Strands:
    """Hairs that grow where a texture of two brows (h, w, 4) has some, the way those grow."""
    alpha = card[..., 3].astype(np.float32) / 255
    gx, gy = (cv2.Sobel(cv2.GaussianBlur(alpha, (0, 0), 0.8), cv2.CV_32F, *d) for d in ((1, 0), (0, 1)))
    xx, yy, xy = (cv2.GaussianBlur(a * b, (0, 0), 9.0) for a, b in ((gx, gx), (gy, gy), (gx, gy)))
    way = 0.5 * np.arctan2(2 * xy, xx - yy) + np.pi / 2
    columns = np.flatnonzero((alpha > 0.05).any(0))
    rows = np.flatnonzero((alpha > 0.05).any(1))
    millimetre = np.ptp(columns) / BROW_MILLIMETRES
    outward = np.where(np.arange(len(alpha)) < rows.mean(), 1.0, -1.0)  # the upper brow's inner end is left
    near = cv2.GaussianBlur(alpha, (0, 0), 0.5 * millimetre)
    near = np.clip(near / np.quantile(near[near > 0.05], 0.8), 0, 1) * (near > 0.02)
    near *= density(card[..., 3] > 12, spec.get("inner_ends", 0.6), 0.5)
    count = int(HAIRS * near.sum() / millimetre**2)
    roots = rng.choice(near.size, count, p=(near / near.sum()).ravel())
    y, x = (at.astype(float) for at in np.divmod(roots, near.shape[1]))
    along = np.abs(x - np.where(outward[y.astype(int)] > 0, columns[0], columns[-1])) / np.ptp(columns)
    step = (
        np.interp(along, [0, 0.3, 1], [6.5, 8.0, 4.5])
        * rng.uniform(0.6, 1.15, count)
        * millimetre
        / (KNOTS - 1)
    )
    side = outward[y.astype(int)]
    turn, bend = None, rng.normal(0, 0.03, count)
    strayed = rng.normal(0, 0.13, count) + rng.standard_t(3, count) * 0.04
    path = []
    for _ in range(KNOTS):
        path.append(np.column_stack([x, y]))
        at = np.clip(y, 0, len(alpha) - 1).astype(int), np.clip(x, 0, alpha.shape[1] - 1).astype(int)
        found = way[at] + strayed
        forwards = np.cos(found) * side - 0.7 * np.sin(found) > 0
        found = np.where(forwards, found, found + np.pi)
        turn = found if turn is None else turn + 0.25 * np.angle(np.exp(1j * (found - turn))) + bend
        x, y = x + step * np.cos(turn), y + step * np.sin(turn)
    points, normals = surface.at(np.stack(path, 1).reshape(-1, 2) / alpha.shape[::-1])
    lift = np.tile(np.linspace(-0.003, 0.005, KNOTS), count) * np.repeat(rng.uniform(0.4, 1.3, count), KNOTS)
    thick = np.linspace(1.0, 0.35, KNOTS) * rng.uniform(0.7, 1.15, (count, 1))
    return Strands((points + normals * lift[:, None]).reshape(count, KNOTS, 3), HAIR_RADIUS * thick)


@dataclass(frozen=True)
class Card:
    """A textured surface in space: uv, places and normals (n, 2 and 3) of its corners, and triangles of these."""

    uv: F64
    places: F64
    normals: F64
    triangles: Int

    def at(self, points: F64) -> tuple[F64, F64]:
        """Places and normals (n, 3) of points (n, 2) of the texture, x right, y down, its sides 1."""
        corners = np.column_stack([self.uv[:, 0], 1 - self.uv[:, 1]])[self.triangles]
        _, near = cKDTree(corners.mean(1)).query(points, k=NEAR_TRIANGLES)
        a, b, c = corners[near].transpose(2, 0, 1, 3)
        u, v, w = b - a, c - a, points[:, None] - a
        area = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
        s = (w[..., 0] * v[..., 1] - w[..., 1] * v[..., 0]) / area
        t = (u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]) / area
        shares = np.stack([1 - s - t, s, t], 2)
        best = shares.min(2).argmax(1)
        rows = np.arange(len(points))
        own, chosen = shares[rows, best][..., None], self.triangles[near[rows, best]]
        return (self.places[chosen] * own).sum(1), (self.normals[chosen] * own).sum(1)
