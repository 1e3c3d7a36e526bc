"""What moves the parts of a head beside the skin: eyes, teeth, tongue, lashes, glasses, hair, clothes, body.

Parts of the mouth that the source has too move as they do there, teeth rigidly.  Of the others, upper teeth stay with
the skull, lower ones and the tongue move with the lower jaw, whose rigid motion the skin of the chin shows, and a
cavity hangs between lips, teeth and the throat, which stays with the skull.  Shells in front of the eyes and lashes
follow the margins of the lids, brows the skin under them.  Eyeballs (`guise.analogy.eyeballs`), glasses, hair, clothes
and body stay.  What nobody knows keeps its shape and follows the skin close to it as far as that moves rigidly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from guise.aam.similarity import align_rigid
from guise.analogy.anatomy import CORRESPONDING, KINDS, TEETH, FaceFrame, Kind, kinds_by_place
from guise.analogy.carriers import components_of
from guise.analogy.filling import TensionFill
from guise.analogy.geometry import Surface
from guise.analogy.geometry import border_mask as borders
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import align_rigid_robust, apply_rigid
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class PartLimits:
    """Thresholds of parts beside the skin; widths are those of the mouth or of an eye, from corner to corner."""

    skin_samples: int = 64  # skin vertices that say how a part moves
    min_skin_vertices: int = 8  # distinct ones among them
    max_skin_distance_radii: float = 0.25  # of the skin that moves a part, in the part's radii
    rigid_residual: float = 0.1  # non-rigid share of the skin's motion, up to which a part moves fully
    loose_residual: float = 0.25  # and from which it stays
    min_border_share: float = 1 / 3  # of an unknown part's vertices on an open border, from which it is cards
    bending_residuals: tuple[float, float] = (
        0.05,
        0.1,
    )  # non-rigid share of a source's motion, from which a soft
    # part bends with it, and fully
    fade_share: float = 0.3  # of a part's size, over which bending fades where the source has nothing
    min_matched_share: float = (
        0.5  # of a part's vertices with a counterpart on the source, which then moves it
    )
    chin_widths: float = 0.5  # around the chin, of the skin that shows the jaw's motion
    jaw_residual: float = 0.25  # non-rigid share of the chin's motion, up to which the jaw moves fully
    still_jaw_residual: float = 0.5  # and from which it stays
    rim_widths: float = 0.15  # from the lips, up to which the border of a cavity goes with them
    held_widths: float = 0.04  # from a tooth, up to which what holds it goes with it


PART_LIMITS = PartLimits()


def submesh(mesh: Mesh, kept: Bool) -> Mesh:
    """The mesh of the vertices in `kept` (N,), in their order."""
    if kept.all():
        return mesh
    number = np.cumsum(kept) - 1
    faces = (number[part[kept[part].all(1)]] for part in (mesh.triangles, mesh.quads))
    return Mesh(mesh.vertices[kept], *faces)


class PartMotion:
    """Moves the other parts with the source's, with the jaw, with the lids or with the skin.

    Parameters
    ----------
    mesh : neutral; where it does not say the kinds of its parts, their places in the face do.   skin : (N,) bool.
    still : the other parts stay where they are.
    matched : (N,) bool, vertices of parts that have a counterpart on a part of the source.
    face : of the mesh, if it is known; without it all parts follow the skin.
    margins : (m, 3) places along the lids, which lashes and the rims of shells follow.
    """

    def __init__(
        self,
        mesh: Mesh,
        skin: Bool,
        still: bool,
        matched: Bool | None = None,
        face: FaceFrame | None = None,
        margins: F64 | None = None,
    ) -> None:
        self._vertices = mesh.vertices
        self._skin = np.flatnonzero(skin)
        self._still = still or bool(skin.all())
        if self._still:
            return
        if mesh.kinds is None and face is not None:
            mesh = kinds_by_place(mesh, face, skin)
        border = borders(mesh.faces, len(mesh.vertices))
        parts = _parts_by_rule(mesh, skin, border, matched)
        self._lower, self._solid, self._between = (parts[rule] for rule in ("lower jaw", "solid", "between"))
        self._matched = [
            _MatchedPart(mesh, part, matched) for part in parts["matched"] if matched is not None
        ]
        rims = [part[border[part]] for part in parts["shells"]]
        on_skin = mesh.faces[skin[mesh.faces].all(1)]
        at_lids = np.concatenate([np.empty(0, np.intp), *parts["lashes"], *rims])
        self._guided = np.concatenate([at_lids, *parts["cards"]])
        self._walls = []
        if parts["between"] and face is not None:
            teeth = np.concatenate([np.empty(0, np.intp), *parts["lower jaw"], *parts["still"]])
            walls = (_CavityWall(mesh, part, face, skin, teeth) for part in parts["between"])
            self._walls = [wall for wall in walls if len(wall.rows)]
        points = self._vertices[self._guided]
        if margins is not None and len(at_lids):
            points[: len(at_lids)] = margins[cKDTree(margins).query(points[: len(at_lids)])[1]]
        self._under, self._shares = self._beneath(on_skin, points)
        self._shells = [_ShellFill(mesh, part, border) for part in parts["shells"]]
        self._around = np.array([self._surroundings(part) for part in self._solid], np.intp)
        self._chin = None if face is None else self._chin_skin(face)
        self._face = face

    def __call__(self, skin: F64, way: F64) -> F64:
        """All vertices (N, 3), given those of the skin (n, 3), and what the source does (N, 3), for matched parts."""
        if len(skin) == len(self._vertices):
            return skin
        out = self._vertices.copy()
        out[self._skin] = skin
        return out if self._still else self._brought_along(out, way)

    def _brought_along(self, out: F64, source: F64) -> F64:
        way = out - self._vertices
        if len(self._guided):
            shift = np.einsum("nk,nki->ni", self._shares, way[self._under])
            out[self._guided] = self._vertices[self._guided] + shift
        for shell in self._shells:
            out[shell.rows] = shell(out, self._vertices)
        if (self._lower or self._between) and self._face is not None:
            jaw = self._jaw(out)
            for part in self._lower:
                out[part] = apply_rigid(self._vertices[part], *jaw)
            for part in self._between:
                rest = self._vertices[part]
                out[part] = rest + self._face.lower_share(rest)[:, None] * (apply_rigid(rest, *jaw) - rest)
        for wall in self._walls:
            out[wall.rows] = wall(out, self._vertices)
        if self._solid:
            for part, turn, shift in zip(self._solid, *self._motions(out), strict=True):
                out[part] = apply_rigid(self._vertices[part], turn, shift)
        for matched in self._matched:
            out[matched.rows] = matched(source)
        return out

    def _jaw(self, made: F64) -> tuple[F64, F64]:
        """R (3, 3), t (3,) of the lower jaw when the vertices are at `made` (N, 3)."""
        assert self._chin is not None
        turn, shift = _rigid_share(
            self._vertices[self._chin][None],
            made[self._chin][None],
            PART_LIMITS.jaw_residual,
            PART_LIMITS.still_jaw_residual,
        )
        return turn[0], shift[0]

    def _chin_skin(self, face: FaceFrame) -> Int:
        """Skin around the chin."""
        away = np.linalg.norm(self._vertices[self._skin] - face.chin, axis=1)
        near = np.argsort(away, kind="stable")[
            : max(
                PART_LIMITS.min_skin_vertices, int((away < PART_LIMITS.chin_widths * face.mouth_width).sum())
            )
        ]
        return np.asarray(self._skin[near])

    def _motions(self, made: F64) -> tuple[F64, F64]:
        """R (c, 3, 3), t (c, 3) of each solid part when the skin vertices are at `made` (N, 3)."""
        return _rigid_share(
            self._vertices[self._around],
            made[self._around],
            PART_LIMITS.rigid_residual,
            PART_LIMITS.loose_residual,
        )

    def _beneath(self, faces: Int, points: F64) -> tuple[Int, F64]:
        """Corners and barycentric weights (n, 3) of the place of the skin closest to each point (n, 3)."""
        if not len(points):
            return np.empty((0, 3), np.intp), np.empty((0, 3))
        places = Surface(self._vertices, faces, 0.0).closest_points(points, np.zeros_like(points))
        return faces[places.faces], places.weights

    def _surroundings(self, part: Int) -> Int:
        """An even sample of the skin vertices close to a part, or its nearest ones."""
        points = self._vertices[part]
        radius = np.linalg.norm(points - points.mean(0), axis=1).max()
        away, _ = cKDTree(points).query(self._vertices[self._skin])
        near = np.argsort(away, kind="stable")[
            : max(
                PART_LIMITS.min_skin_vertices,
                int((away <= PART_LIMITS.max_skin_distance_radii * radius).sum()),
            )
        ]
        return np.asarray(
            self._skin[near[np.linspace(0, len(near) - 1, PART_LIMITS.skin_samples).round().astype(int)]]
        )


class _ShellFill:
    """The inside of a shell, whose border the lids hold."""

    def __init__(self, mesh: Mesh, part: Int, border: Bool) -> None:
        own = submesh(mesh, _among(part, len(mesh.vertices)))
        reach = 100 * float(np.ptp(own.vertices, axis=0).max())
        self.rows, self._fill = part, TensionFill(own.vertices, own.rings, border[part], reach)

    def __call__(self, made: F64, rest: F64) -> F64:
        """Its vertices (n, 3), given all (N, 3) with its border in place, and those at rest."""
        return np.asarray(rest[self.rows] + self._fill((made - rest)[self.rows]))


class _CavityWall:
    """The wall of a cavity of its own behind the lips: its border goes with them, and its end stays with the skull.

    What holds teeth goes with these, and gums or a tongue that only touch it go with their jaw.

    Parameters
    ----------
    part : of the mesh.   skin : (N,) bool.   teeth : vertices (t,).
    """

    def __init__(self, mesh: Mesh, part: Int, face: FaceFrame, skin: Bool, teeth: Int) -> None:
        own = submesh(mesh, _among(part, len(mesh.vertices)))
        at, width = own.vertices, face.mouth_width
        lips = np.flatnonzero(skin)
        away, near = cKDTree(mesh.vertices[lips]).query(at)
        rim = borders(own.faces, len(at)) & (away < PART_LIMITS.rim_widths * width)
        pieces = _pieces_by_edges(own.faces)
        wall = own.faces[np.isin(pieces, pieces[rim[own.faces].any(1)])]
        chosen = _among(np.unique(wall), len(at))
        self.rows = part[chosen]
        if not len(self.rows):
            return
        held = np.zeros(len(at), bool)
        if len(teeth):
            held = cKDTree(mesh.vertices[teeth]).query(at)[0] < PART_LIMITS.held_widths * width
        self._lips, self._rim = lips[near[chosen]], rim[chosen]
        self._still = face.throat(at[chosen]) & ~self._rim
        piece = submesh(own, chosen)
        known = self._rim | self._still | held[chosen]
        self._fill = TensionFill(piece.vertices, piece.rings, known, 100 * float(np.ptp(at, axis=0).max()))

    def __call__(self, made: F64, rest: F64) -> F64:
        """Its vertices (n, 3), given all (N, 3), skin and jaws in place, and those at rest."""
        way = (made - rest)[self.rows]
        way[self._rim] = (made - rest)[self._lips[self._rim]]
        way[self._still] = 0
        return np.asarray(rest[self.rows] + self._fill(way))


def _pieces_by_edges(faces: Int) -> Int:
    """(m,) the piece of each face (m, 3); pieces have no edge in common."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = np.unique(sides @ (int(faces.max()) + 1, 1), return_inverse=True)[1].ravel()
    ones, of = np.ones(len(edges), np.int8), np.tile(np.arange(len(faces)), 3)
    shared = sp.csr_array(sp.coo_array((ones, (of, edges)), shape=(len(faces), int(edges.max()) + 1)))
    return np.asarray(connected_components(shared @ shared.T, directed=False)[1])


class _MatchedPart:
    """A part that moves as the source's: rigidly, and if it is soft and the source's bends, as it bends.

    matched : (N,) which vertices have a counterpart.
    """

    def __init__(self, mesh: Mesh, part: Int, matched: Bool) -> None:
        self.rows, self._rest, self._found = part, mesh.vertices[part], matched[part]
        kind = None if mesh.kinds is None else KINDS[mesh.kinds[part[0]]]
        self._fill = None
        if kind not in TEETH:
            own = submesh(mesh, _among(part, len(matched)))
            reach = PART_LIMITS.fade_share * float(np.ptp(own.vertices, axis=0).max())
            self._fill = TensionFill(own.vertices, own.rings, self._found, reach)

    def __call__(self, source: F64) -> F64:
        """Its vertices (n, 3), when the counterparts of all (N, 3) move by `source`."""
        way = source[self.rows]
        found = self._found.astype(np.float64)
        moved = apply_rigid(self._rest, *align_rigid_robust(self._rest, self._rest + way, found))
        if self._fill is None:
            return moved
        bent = self._rest + way - moved
        size = float((found * np.linalg.norm(way, axis=1)).sum())
        residual = float((found * np.linalg.norm(bent, axis=1)).sum()) / max(size, 1e-300)
        none, full = PART_LIMITS.bending_residuals
        share = float(np.clip((residual - none) / (full - none), 0, 1))
        return moved + share * self._fill(bent) if share > 0 else moved


def _among(part: Int, count: int) -> Bool:
    """(count,) which are of a part (n,)."""
    chosen = np.zeros(count, bool)
    chosen[part] = True
    return chosen


def _parts_by_rule(mesh: Mesh, skin: Bool, border: Bool, matched: Bool | None) -> dict[str, list[Int]]:
    """The parts by what moves them; "still" ones stay."""
    parts: dict[str, list[Int]] = {
        name: []
        for name in ("matched", "cards", "lashes", "shells", "lower jaw", "between", "solid", "still")
    }
    for component in components_of(mesh):
        part = component[~skin[component]]
        if len(part):
            kind: Kind = KINDS[0 if mesh.kinds is None else mesh.kinds[part[0]]]
            found = matched is not None and matched[part].mean() >= PART_LIMITS.min_matched_share
            cards = border[part].mean() >= PART_LIMITS.min_border_share
            parts[_rule(kind, found=bool(found), cards=bool(cards))].append(part)
    return parts


def _rule(kind: Kind, *, found: bool, cards: bool) -> str:
    """What moves a part of a kind.   found : on the source.   cards : whether it consists of them."""
    if found and kind in (*CORRESPONDING, "eyeball"):
        return "matched"
    if kind == "other":
        return "cards" if cards else "solid"
    rules: dict[Kind, str] = {
        "eye shell": "shells", "lashes": "lashes", "brows": "cards", "lower teeth": "lower jaw",
        "tongue": "lower jaw", "gums and cavity": "between",
    }  # fmt: skip
    return rules.get(kind, "still")


def _rigid_share(before: F64, after: F64, full: float, none: float) -> tuple[F64, F64]:
    """R (c, 3, 3), t (c, 3) of the rigid motions of points (c, n, 3), less the less rigid they are.

    full, none : the non-rigid share of a motion up to which it counts fully, and from which it does not count.
    """
    alike = np.ones(before.shape[:2])
    rigid = apply_rigid(before, *align_rigid_robust(before, after, alike))
    off = np.linalg.norm(after - rigid, axis=2).sum(1)
    way = np.linalg.norm(after - before, axis=2).sum(1)
    share = np.clip((none - off / np.maximum(way, 1e-300)) / (none - full), 0, 1)[:, None, None]
    return align_rigid(before, before + share * (rigid - before), alike)
