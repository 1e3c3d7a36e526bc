"""Heads with what an artist's head has besides skin: mouth bag, eye sockets, teeth, gums, tongue, eyeballs.

Made of the ICT head of data/mesh (centimetres, y up, z forward), whose expressions are exact truth on every identity
and remesh.  Teeth of the upper jaw stay; lower teeth, lower gum and tongue move with the jaw: in its shapes, the rigid
motion of the skin of the chin.  "Joined" heads have a cavity of its own behind the lips, with gums and tongue in one
component.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from guise.aam.similarity import align_rigid
from guise.analogy.geometry import border_mask
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import apply_rigid
from guise.common.arrays import F64, Int

BAG_RINGS, BAG_DEPTH_CM, SOCKET_DEPTH_CM = 4, 3.0, 1.2
TEETH = 12  # of each jaw, components of their own
CAVITY_CM = 0.15  # from the lips to a cavity of its own
CHIN = 120  # landmark 8 of 68, and the vertices nearest to it, give the jaw's motion
UPPER, LOWER = ("upper teeth", "upper gum"), ("lower teeth", "lower gum", "tongue")


@dataclass(frozen=True, eq=False)
class FullHead:
    """A head and its true expressions.

    Parameters
    ----------
    shapes : (k, N, 3), absolute; None where nobody knows.   parts : vertices by name, beside the skin.
    lids : upper and lower margin of both eyes, vertices from corner to corner; empty where unknown.
    """

    name: str
    mesh: Mesh
    shapes: F64 | None
    parts: dict[str, Int]
    lids: tuple[tuple[Int, Int], ...]


class IctHeads:
    """The head model of data/mesh."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        z = np.load(folder / "ict_head_dev.npz")
        self.neutral, self.quads = z["V"].astype(np.float64), z["Q"].astype(np.intp)
        self.triangles = z["T"].astype(np.intp)
        self.ways, self.names = z["E"].astype(np.float64), tuple(map(str, z["exp_names"]))
        self.identities = self.neutral + z["ID"]
        self.chin = int(z["lm68"][8])

    def plain(self, identity: int | None = None) -> FullHead:
        """Skin alone."""
        rest = self.neutral if identity is None else self.identities[identity]
        mesh = Mesh(rest, np.empty((0, 3), np.intp), self.quads)
        name = "ICT" if identity is None else f"ICT {identity}"
        return FullHead(name, mesh, rest + self.ways, {}, lid_margins(mesh))

    def remeshed(self, identity: int, triangles: int) -> FullHead:
        """On another topology."""
        z = np.load(self.folder / f"ict_remesh_{triangles}.npz")
        corners = self.triangles[z["tri"]]
        at = np.einsum("nk,nki->ni", z["bary"], self.identities[identity][corners])
        ways = np.einsum("nk,snki->sni", z["bary"], self.ways[:, corners])
        mesh = Mesh.of_triangles(at, z["T"])
        return FullHead(f"ICT {identity}, {triangles} triangles", mesh, at + ways, {}, lid_margins(mesh))

    def full(self, identity: int | None = None, *, joined: bool = False) -> FullHead:
        """With mouth bag, sockets, teeth, gums, tongue and eyeballs."""
        plain = self.plain(identity)
        assert plain.shapes is not None
        build = _Builder(plain.mesh.vertices, plain.shapes, self.quads)
        loops = [_ordered(loop, plain.mesh) for loop in _holes(plain.mesh)]
        mouth = next(loop for loop in loops if abs(plain.mesh.vertices[loop, 0].mean()) < 1)
        for loop in loops:
            if loop is not mouth:
                build.add_bag(loop, SOCKET_DEPTH_CM)
        end = build.add_bag(mouth, BAG_DEPTH_CM, apart=joined)
        at = plain.mesh.vertices[mouth]
        rest = np.eye(3), np.zeros(3)
        jaw = [
            _jaw_motion(plain.mesh.vertices, shape, self.chin) if name.startswith("jaw") else rest
            for name, shape in zip(self.names, plain.shapes, strict=True)
        ]
        still = [rest] * len(jaw)
        for name, vertices, faces in _mouth_parts(at.mean(0), float(np.ptp(at[:, 0]))):
            build.add_part(name, vertices, faces, still if name in UPPER else jaw)
        for loop in loops:
            if loop is not mouth:
                build.add_part("eyes", *_ball(plain.mesh.vertices[loop]), still)
        if joined:
            build.tie(end, ("upper gum", "lower gum", "tongue"))
        return FullHead(f"{plain.name} full", *build.done(), plain.lids)


class _Builder:
    """Adds parts and bags to a head of quads."""

    def __init__(self, vertices: F64, shapes: F64, quads: Int) -> None:
        self.vertices, self.shapes = [vertices], [shapes]
        self.quads, self.triangles = [quads], [np.empty((0, 3), np.intp)]
        self.parts: dict[str, list[Int]] = {}
        self.count = len(vertices)

    def add_bag(self, loop: Int, depth: float, *, apart: bool = False) -> int:
        """Rings of quads inwards from a loop of the first mesh, wider behind it, and a fan that shuts it; its end.

        apart : with a first ring of its own, a little behind the loop.
        """
        at, before = self.vertices[0][loop], loop
        middle = at.mean(0)
        if apart:
            behind = np.array([0, 0, CAVITY_CM])
            before = self._append(at - behind, self.shapes[0][:, loop] - behind)
            self.parts["bags"] = [before]
        for ring in range(1, BAG_RINGS + 1):
            share = ring / BAG_RINGS
            wide = 1 + 0.25 * np.sin(np.pi * min(share, 0.8))
            place = middle + (at - middle) * (wide, wide, 1) + (0, 0, -depth * share)
            way = (self.shapes[0][:, loop] - at) * (1 - share)
            now = self._append(place, place + way)
            self.parts.setdefault("bags", []).append(now)
            self.quads.append(np.stack([before, np.roll(before, -1), np.roll(now, -1), now], axis=1))
            before = now
        last = self.vertices[-1].mean(0, keepdims=True)
        end = self._append(last, np.repeat(last[None], len(self.shapes[0]), axis=0))
        self.parts["bags"].append(end)
        self.triangles.append(np.stack([before, np.roll(before, -1), np.repeat(end, len(before))], axis=1))
        return int(end[0])

    def tie(self, end: int, names: tuple[str, ...]) -> None:
        """Join parts to a vertex, each by one triangle."""
        for name in names:
            self.triangles.append(np.array([[end, *self.parts[name][0][:2]]]))

    def add_part(self, name: str, vertices: F64, faces: Int, motions: list[tuple[F64, F64]]) -> None:
        """A part that moves rigidly."""
        moved = np.stack([apply_rigid(vertices, turn, shift) for turn, shift in motions])
        ids = self._append(vertices, moved)
        self.triangles.append(ids[faces])
        self.parts.setdefault(name, []).append(ids)

    def done(self) -> tuple[Mesh, F64, dict[str, Int]]:
        """Mesh, shapes and parts."""
        mesh = Mesh(np.concatenate(self.vertices), np.concatenate(self.triangles), np.concatenate(self.quads))
        return (
            mesh,
            np.concatenate(self.shapes, axis=1),
            {k: np.concatenate(v) for k, v in self.parts.items()},
        )

    def _append(self, vertices: F64, shapes: F64) -> Int:
        self.vertices.append(vertices)
        self.shapes.append(shapes)
        self.count += len(vertices)
        return np.arange(self.count - len(vertices), self.count)


def others(folder: Path) -> Iterator[FullHead]:
    """MakeHuman's heads and another artist's, without truth."""
    z = np.load(folder / "makehuman_head_dev.npz")
    for name, identity in zip(map(str, z["ids"]), z["ID"], strict=True):
        mesh = Mesh((z["V"] + identity).astype(np.float64), np.empty((0, 3), np.intp), z["Q"].astype(np.intp))
        yield FullHead(
            f"MakeHuman {name}", mesh, None, {}, tuple(_meeting_lids(z, side) for side in ("left", "right"))
        )
    z = np.load(folder / "arkit_kl.npz")
    mesh = Mesh.of_triangles(z["V"], z["T"])
    yield FullHead("KL", mesh, None, {}, lid_margins(mesh))


def _meeting_lids(z: Any, side: str) -> tuple[Int, Int]:
    """The margins of MakeHuman's lids, which are no border: what its own closed eye brings together."""
    way = z["X_caucasian"][list(z["units"]).index(f"eye-{side}-closure")]
    shut, moved = z["V"] + way, np.flatnonzero(np.linalg.norm(way, axis=1) > 0.2)
    rest, apart = (np.linalg.norm(at[:, None] - at[None, moved], axis=2) for at in (z["V"], shut))
    low, high = np.nonzero((apart < 0.12) & (rest > 0.5))
    low, high = np.unique(low), np.unique(moved[high])
    high = high[z["V"][high, 1] > z["V"][low, 1].mean()]
    low = np.setdiff1d(low, high)
    return high[z["V"][high, 0].argsort()], low[z["V"][low, 0].argsort()]


def lid_margins(mesh: Mesh) -> tuple[tuple[Int, Int], ...]:
    """Upper and lower margin of both eyes: the borders of the eye holes, from corner to corner."""
    found = []
    for loop in (_ordered(hole, mesh) for hole in _holes(mesh)):
        at = mesh.vertices[loop]
        if abs(at[:, 0].mean()) < 0.25 * np.abs(mesh.vertices[:, 0]).max() * 0.5:
            continue
        first, last = int(at[:, 0].argmin()), int(at[:, 0].argmax())
        one = np.roll(loop, -first)[: (last - first) % len(loop) + 1]
        other = np.roll(loop, -last)[: (first - last) % len(loop) + 1][::-1]
        high, low = sorted((one, other), key=lambda arc: -float(mesh.vertices[arc, 1].mean()))
        found.append((high, low))
    return tuple(found)


def _holes(mesh: Mesh) -> list[Int]:
    """The vertices of the borders inside the face: all but that of the neck or mask, which is the widest."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    border = border_mask(mesh.faces, len(mesh.vertices))
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    pairs, count = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)
    ends = pairs[count == 1]
    graph = coo_array((np.ones(len(ends)), ends.T), shape=(len(border),) * 2)
    labels = connected_components(graph, directed=False)[1]
    loops = [np.flatnonzero(labels == label) for label in np.unique(labels[border])]
    loops = [loop for loop in loops if len(loop) > 7]
    widest = max(loops, key=lambda loop: float(np.ptp(mesh.vertices[loop], axis=0).max()))
    return [loop for loop in loops if loop is not widest]


def _ordered(loop: Int, mesh: Mesh) -> Int:
    """The vertices of a border loop, one after the other, as the faces outside go round."""
    inside = set(loop.tolist())
    sides = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]])
    there = {(a, b) for a, b in sides.tolist() if a in inside and b in inside}
    after = {b: a for a, b in there if (b, a) not in there}
    out = [int(loop[0])]
    while (following := after[out[-1]]) != out[0]:
        out.append(following)
    return np.array(out)


def _jaw_motion(neutral: F64, shape: F64, chin: int) -> tuple[F64, F64]:
    """The rigid motion of the skin of the chin."""
    near = np.linalg.norm(neutral - neutral[chin], axis=1).argsort()[:CHIN]
    return align_rigid(neutral[near], shape[near], np.ones(CHIN))


def _mouth_parts(middle: F64, width: float) -> Iterator[tuple[str, F64, Int]]:
    """Teeth, gums and tongue behind lips of a width around a middle."""
    scale = width / 4.6
    for name, up in (("upper", 1), ("lower", -1)):
        arch = middle + np.array([0, 0.1 * up, -0.8])
        for angle in np.linspace(-1.15, 1.15, TEETH):
            place = arch + scale * np.array([2.1 * np.sin(angle), 0.45 * up, 2.4 * (np.cos(angle) - 1)])
            yield f"{name} teeth", *_box(place, scale * np.array([0.17, 0.42, 0.15]))
        angles = np.repeat(np.linspace(-1.2, 1.2, 15), 4)
        corner = np.tile([[-0.2, 0.8 * up], [0.2, 0.8 * up], [0.2, 1.4 * up], [-0.2, 1.4 * up]], (15, 1))
        reach = corner[:, 0]
        gum = np.stack(
            [(2.1 + reach) * np.sin(angles), corner[:, 1], (2.4 + reach) * np.cos(angles) - 2.4], axis=1
        )
        yield f"{name} gum", arch + scale * gum, _tube(15, up)
    ball, faces = _sphere()
    yield "tongue", middle + scale * (ball * (1.2, 0.35, 1.6) + (0, -0.5, -2.6)), faces


def _box(place: F64, half: F64) -> tuple[F64, Int]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    return place + corners * half, _outward(corners, ConvexHull(corners).simplices)


def _ball(loop: F64) -> tuple[F64, Int]:
    """An eyeball behind the margin of its lids."""
    ball, faces = _sphere()
    radius = 0.52 * float(np.ptp(loop[:, 0]))
    middle = loop.mean(0)
    return middle + (0, 0, loop[:, 2].max() - middle[2] - radius - 0.05) + radius * ball, faces


def _sphere() -> tuple[F64, Int]:
    steps = np.arange(200) + 0.5
    tilt, turn = np.arccos(1 - 2 * steps / 200), np.pi * (1 + 5**0.5) * steps
    points = np.stack([np.cos(turn) * np.sin(tilt), np.sin(turn) * np.sin(tilt), np.cos(tilt)], axis=1)
    return points, _outward(points, ConvexHull(points).simplices)


def _tube(rings: int, up: int) -> Int:
    quads = [
        [4 * r + k, 4 * r + (k + 1) % 4, 4 * r + 4 + (k + 1) % 4, 4 * r + 4 + k]
        for r in range(rings - 1)
        for k in range(4)
    ]
    held = np.array(quads)
    faces = np.concatenate([held[:, [0, 1, 2]], held[:, [0, 2, 3]]])
    return faces if up > 0 else faces[:, ::-1]


def _outward(points: F64, faces: Int) -> Int:
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = (np.cross(b - a, c - a) * (a + b + c)).sum(1) < 0
    return np.asarray(np.where(inward[:, None], faces[:, ::-1], faces), np.intp)
