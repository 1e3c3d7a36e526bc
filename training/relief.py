"""Learn how a face's surface lies between the 81 points: its depth beyond the flat triangles.

    python -m training.relief --program DIR

DIR holds the renderer.  The meshes of random people at rest are seen from the front, in the definition of the built-in
landmarker; what their surface's depth has beyond that of the triangles of the 81 points, the mean of all people and of
their mirror images, is approximated by few places more.  Writes `aam/data/relief.npz`: `places` (k, 2) face widths
from the reference frame's first corner, `depth` (k,) face widths, away from the viewer, and `triangles` (t, 3) of all
points, which divide the frame's own.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import Delaunay

from guise.aam.landmarks.schemes import BROWS, LEFT_EYE, LIPS, MIRROR, RIGHT_EYE
from guise.aam.mask import soft_parts
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.aam.relief import DATA, Relief
from guise.common.arrays import F32, F64, I32, Bool
from guise.render.visibility import visible
from training.brows import hair_points
from training.render_people import load_program, random_person
from training.solid_shape import SEED, _brows_only, _defined, _points

SURFACE_PIXELS = 640  # side of the picture in which a person's depth is drawn
FACE_SHARE = 0.7  # of it
RIM_FACE_WIDTHS = 0.05
OPENING_FACE_WIDTHS = 0.02  # around eyes and lips
MAX_DEPTH_FACE_WIDTHS = 0.4  # beyond which it is no skin of the face
MIN_GAP_FACE_WIDTHS = 0.035  # between points
NEAR_EDGE = 0.2  # weight of a corner, below which a place is put onto the edge beside it
ON_EDGE = 1e-6
MIN_AREA_GRID_PIXELS = 1e-3
SMOOTH_FACE_WIDTHS = 0.012
MAX_TRIANGLES = 255  # with which the CPU compositor is fastest


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--people", type=int, default=60)
    parser.add_argument("--out", type=Path, default=DATA)
    given = parser.parse_args()
    program = load_program(given.program, 176)
    program["human"].Person._surfaces = _brows_only
    reference = ReferenceFrame.canonical()
    bulges = np.array([_bulge(program, number, reference) for number in range(given.people)])
    mean = _symmetric(np.nanmean(bulges, axis=0), reference)
    print(f"deviation among people {np.nanstd(bulges, axis=0)[reference.mask].mean():.4f} face widths")
    relief = _approximated(mean, reference)
    left = np.abs(_drawn(relief) - mean)[reference.mask]
    print(
        f"{len(relief.triangles)} triangles; depth {np.abs(mean)[reference.mask].mean():.4f}, "
        f"left {left.mean():.4f}, {left.max():.3f}"
    )
    added = slice(len(reference.points), None)
    places = (relief.points[added] - reference.points.min(0)) / reference.resolution
    np.savez_compressed(
        given.out,
        places=places.astype(np.float32),
        depth=relief.depth[added].astype(np.float32),
        triangles=relief.triangles.astype(np.uint8),
    )


def _bulge(p, number: int, reference: ReferenceFrame) -> F64:
    """(h, w) depth of a person's surface beyond the triangles, face widths; NaN where there is none."""
    person = p["human"].Person(random_person(p, number, np.random.default_rng(SEED + number)))
    lift = hair_points(person, p["assets"].image) - p["face81"].points(person.base)[BROWS]
    vertices, skull = person.pose(np.zeros(len(p["human"].WEIGHT_NAMES)), np.eye(3))
    vertices = (vertices - skull[:3, 3]) @ skull[:3, :3] * (1, -1, -1)
    points = _points(p, person, lift, np.zeros(len(p["human"].WEIGHT_NAMES)), np.eye(3)) * (1, -1, -1)
    points = _defined(points[None])[0]
    fit = reference.to_grid(points[:, :2])
    low, span = points[:, :2].min(0), float(np.ptp(points[:, 0]))
    scale = FACE_SHARE * SURFACE_PIXELS / max(span, float(np.ptp(points[:, 1])))
    origin = low - (1 - FACE_SHARE) / 2 * SURFACE_PIXELS / scale

    def seen(xyz: F64) -> F64:
        return np.column_stack([(xyz[:, :2] - origin) * scale, xyz[:, 2]])

    quads = _skin(p)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    surface = seen(vertices)
    nearest = visible(surface, triangles, (SURFACE_PIXELS, SURFACE_PIXELS), "cpu")
    depth = np.full(nearest.triangle.shape, np.nan, np.float32)
    depth[nearest.covered] = nearest.interpolated(surface[:, 2:], triangles)[:, 0]
    found = reference.sampler.sample(depth, seen(points)[:, :2].astype(np.float64))
    flat = (points[reference.sampler.vertices, 2] * reference.sampler.weights).sum(0)
    return np.asarray(
        reference.scatter(((found - flat) * fit.scale / reference.resolution).astype(np.float32)), np.float64
    )


def _skin(p) -> np.ndarray:
    """(q, 4) faces of the body's skin, without the linings of mouth and eye sockets."""
    import make_swap_truth as truth

    _, _, _, faces, _, lining = truth._layout()
    return faces[~lining]


def _symmetric(bulge: F64, reference: ReferenceFrame) -> F32:
    """The smooth mean of a picture (h, w) and its mirror image."""
    h, w = reference.size
    ys, xs = np.mgrid[:h, :w].astype(np.float64)
    sampler = MeshSampler.build(reference, np.column_stack([xs.ravel(), ys.ravel()]))
    maps = sampler.positions(reference.points[list(MIRROR)]).reshape(h, w, 2)
    bulge = np.where(_openings(reference), 0, bulge)
    known = ((np.abs(bulge) < MAX_DEPTH_FACE_WIDTHS) & reference.mask).astype(np.float32)
    total = np.where(known > 0, bulge, 0).astype(np.float32)
    total += cv2.remap(total, maps, None, cv2.INTER_LINEAR)
    known += cv2.remap(known, maps, None, cv2.INTER_LINEAR)
    sigma = SMOOTH_FACE_WIDTHS * reference.resolution
    smooth = cv2.GaussianBlur(total, (0, 0), sigma) / np.maximum(cv2.GaussianBlur(known, (0, 0), sigma), 1e-3)
    return np.asarray(smooth, np.float32)


def _approximated(bulge: F32, reference: ReferenceFrame) -> Relief:
    """Pairs of places added one after another where the depth is farthest off."""
    made, inner = Relief.flat(reference), _inner(reference)
    while True:
        left = np.where(inner, np.abs(bulge - _drawn(made)), 0)
        y, x = np.unravel_index(left.argmax(), left.shape)
        one = _placed(np.array((x, y), np.float64), reference)
        places = np.array([one, _mirror_of(one, reference)])
        gaps = np.linalg.norm(np.vstack([made.points, places[1:]]) - one, axis=1)
        inner[y, x] = False
        if gaps.min() < MIN_GAP_FACE_WIDTHS * reference.resolution:
            continue
        points = np.vstack([made.points, places])
        triangles = _divided(points, reference)
        if len(triangles) > MAX_TRIANGLES:
            return made
        columns = np.round(places).astype(int)
        depth = np.append(made.depth, bulge[columns[:, 1], columns[:, 0]])
        made = Relief(reference, points, triangles, depth)


def _placed(place: F64, reference: ReferenceFrame) -> F64:
    """A place (2,), put onto the edge that it is near."""
    number, weights = _under(place, reference)
    weights = np.where(weights < NEAR_EDGE, 0, weights)
    return np.asarray(weights / weights.sum() @ reference.points[reference.triangles[number]])


def _under(place: F64, reference: ReferenceFrame) -> tuple[int, F64]:
    """The triangle that holds a place (2,), and the place's weights (3,) in it."""
    corners = reference.points[reference.triangles]
    edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
    along = np.linalg.solve(edges, (place - corners[:, 0])[..., None])[..., 0]
    weights = np.column_stack([1 - along.sum(1), along])
    number = int(weights.min(1).argmax())
    return number, weights[number]


def _divided(points: F64, reference: ReferenceFrame) -> I32:
    """(t, 3) the frame's triangles, each divided by the points in it and on its edges: no edge goes."""
    found = []
    for corners in reference.triangles:
        a, b, c = reference.points[corners]
        along = np.linalg.solve(np.column_stack([b - a, c - a]), (points - a).T)
        inside = np.flatnonzero(np.vstack([1 - along.sum(0), along]).min(0) > -ON_EDGE)
        parts = inside[Delaunay(points[inside]).simplices]
        (ux, uy), (vx, vy) = ((points[parts[:, k]] - points[parts[:, 0]]).T for k in (1, 2))
        found.append(parts[np.abs(ux * vy - uy * vx) > MIN_AREA_GRID_PIXELS])
    return np.concatenate(found).astype(np.int32)


def _drawn(relief: Relief) -> F32:
    """(h, w) depth as the relief has it."""
    ys, xs = np.divmod(relief.reference.pixels, relief.reference.size[1])
    return relief.reference.scatter(relief.at(np.column_stack([xs, ys]).astype(np.float64)))


def _inner(reference: ReferenceFrame) -> Bool:
    """(h, w) the face without its rim, eyes and mouth."""
    away = cv2.distanceTransform(np.pad(reference.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    return np.asarray((away > RIM_FACE_WIDTHS * reference.resolution) & ~_openings(reference))


def _openings(reference: ReferenceFrame) -> Bool:
    """(h, w) eyes and mouth, which lie on the flat triangles."""
    return np.asarray(soft_parts(reference, (RIGHT_EYE, LEFT_EYE, LIPS), OPENING_FACE_WIDTHS) > 0.1)


def _mirror_of(place, reference: ReferenceFrame) -> F64:
    sampler = MeshSampler.build(reference, np.array([place], np.float64))
    return np.asarray(sampler.positions(reference.points[list(MIRROR)])[0], np.float64)


if __name__ == "__main__":
    main()
