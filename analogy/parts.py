"""Parts of a head beside the skin (eyes, teeth, tongue, lashes) and what moves them.

The skin consists of the large components (`guise.analogy.registration.skin_mask`).  Parts that the source has too move
as they do there.  Of the others, what lies in the mouth stays with the skull or moves with the lower jaw, whose rigid
motion the skin of the chin shows; eyeballs stay; shells in front of the eyes and cards (mostly open border: lashes,
brows) follow the lids and the skin under them.  The rest keeps its shape and follows the skin close to it as far as
that moves rigidly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from guise.aam.similarity import align_rigid
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.filling import TensionFill
from guise.analogy.geometry import Surface
from guise.analogy.geometry import border_mask as borders
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import align_rigid_robust, apply_rigid
from guise.common.arrays import F64, Bool, Int


@dataclass(frozen=True)
class PartLimits:
    """Thresholds of parts beside the skin; widths are those of the mouth or of an eye, from corner to corner."""

    min_border_share: float = 1 / 3  # of a part's vertices on an open border, from which it consists of cards
    skin_samples: int = 64  # skin vertices that say how a part moves
    min_skin_vertices: int = 8  # distinct ones among them
    max_skin_distance_radii: float = 0.25  # of the skin that moves a part, in the part's radii
    rigid_residual: float = 0.1  # non-rigid share of the skin's motion, up to which a part moves fully
    loose_residual: float = 0.25  # and from which it stays
    min_matched_share: float = (
        0.5  # of a part's vertices with a counterpart on the source, which then moves it
    )
    mouth_widths: tuple[float, float, float] = (0.9, 0.9, 1.6)  # sideways, up or down, and back from the lips
    upper_jaw_widths: float = 0.05  # above the line of the lips, from which a part belongs to the skull
    chin_widths: float = 0.5  # around the chin, of the skin that shows the jaw's motion
    jaw_residual: float = 0.25  # non-rigid share of the chin's motion, up to which the jaw moves fully
    still_jaw_residual: float = 0.5  # and from which it stays
    eye_widths: float = 0.75  # around the middle of an eye, of eyeballs and shells
    lid_widths: float = 0.2  # from the lids' corners line of a shell's border


PART_LIMITS = PartLimits()


@dataclass(frozen=True, eq=False)
class FaceFrame:
    """Mouth and eyes of a head, from its 20 feature points (3,) each, in the order of `FEATURE_POINT_NAMES`.

    axes : (3, 3) unit rows: to the person's left, up and forward.   mouth, chin : (3,).   mouth_width : of it.
    eyes : middle (3,) and width of each.
    """

    axes: F64
    mouth: F64
    mouth_width: float
    chin: F64
    eyes: tuple[tuple[F64, float], ...]

    @classmethod
    def of(cls, points: F64) -> FaceFrame:
        """From points (20, 3)."""
        at = dict(zip(FEATURE_POINT_NAMES, points, strict=True))
        across = (
            at["mouth_corner_left"] - at["mouth_corner_right"] + at["eye_left_outer"] - at["eye_right_outer"]
        )
        lips = (at["upper_lip_inner"] + at["lower_lip_inner"]) / 2
        forward = np.cross(across, at["nose_bridge"] - at["chin"])
        axes = np.stack([across, np.cross(forward, across), forward])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True).clip(1e-300)
        width = float(np.linalg.norm(at["mouth_corner_left"] - at["mouth_corner_right"]))
        corners = [(at[f"eye_{side}_outer"], at[f"eye_{side}_inner"]) for side in ("right", "left")]
        eyes = tuple(((one + other) / 2, float(np.linalg.norm(one - other))) for one, other in corners)
        return cls(axes, lips, width, at["chin"], eyes)

    def in_mouth(self, place: F64) -> bool:
        """Whether a place (3,) lies behind the lips."""
        side, up, forward = (place - self.mouth) @ self.axes.T / self.mouth_width
        wide, high, deep = PART_LIMITS.mouth_widths
        return bool(abs(side) < wide and abs(up) < high and -deep < forward < 0)

    def in_upper_jaw(self, place: F64) -> bool:
        """Whether a place (3,) in the mouth lies above the line of the lips."""
        return bool((place - self.mouth) @ self.axes[1] > PART_LIMITS.upper_jaw_widths * self.mouth_width)

    def at_eye(self, place: F64) -> bool:
        """Whether a place (3,) is that of an eyeball."""
        return any(
            np.linalg.norm(((place - middle) @ self.axes.T)[:2]) < PART_LIMITS.eye_widths * width
            for middle, width in self.eyes
        )


def submesh(mesh: Mesh, kept: Bool) -> Mesh:
    """The mesh of the vertices in `kept` (N,), in their order; components must be kept or dropped as a whole."""
    if kept.all():
        return mesh
    number = np.cumsum(kept) - 1
    faces = (number[part[kept[part[:, 0]]]] for part in (mesh.triangles, mesh.quads))
    return Mesh(mesh.vertices[kept], *faces)


class PartMotion:
    """Moves the other parts with the source's, with the jaw, with the lids or with the skin.

    Parameters
    ----------
    mesh : neutral.   skin : (N,) bool.   still : the other parts stay where they are.
    matched : (N,) bool, vertices of parts that have a counterpart on a part of the source.
    face : of the mesh, if it is known; without it all parts follow the skin.
    """

    def __init__(
        self, mesh: Mesh, skin: Bool, still: bool, matched: Bool | None = None, face: FaceFrame | None = None
    ) -> None:
        self._vertices = mesh.vertices
        self._skin = np.flatnonzero(skin)
        self._still = still or bool(skin.all())
        if self._still:
            return
        border = borders(mesh.faces, len(mesh.vertices))
        kinds = _kinds(mesh, skin, border, matched, face)
        self._matched, self._lower, self._solid = kinds["matched"], kinds["lower jaw"], kinds["solid"]
        self._cards = np.concatenate([np.empty(0, np.intp), *kinds["cards"]])
        held = np.concatenate([np.empty(0, np.intp), *(part[border[part]] for part in kinds["shells"])])
        on_skin = mesh.faces[skin[mesh.faces[:, 0]]]
        self._guided = np.concatenate([self._cards, held])
        self._under, self._shares = self._beneath(on_skin)
        self._shells = [_ShellFill(mesh, part, border) for part in kinds["shells"]]
        self._around = np.array([self._surroundings(part) for part in self._solid], np.intp)
        self._chin = None if face is None else self._chin_skin(face)

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
        if self._lower and self._chin is not None:
            turn, shift = self._jaw(out)
            for part in self._lower:
                out[part] = apply_rigid(self._vertices[part], turn, shift)
        if self._solid:
            for part, turn, shift in zip(self._solid, *self._motions(out), strict=True):
                out[part] = apply_rigid(self._vertices[part], turn, shift)
        for part in self._matched:
            before = self._vertices[part]
            turn, shift = align_rigid_robust(before, before + source[part], np.ones(len(part)))
            out[part] = apply_rigid(before, turn, shift)
        return out

    def _jaw(self, made: F64) -> tuple[F64, F64]:
        """R (3, 3), t (3,) of the lower jaw when the vertices are at `made` (N, 3)."""
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

    def _beneath(self, faces: Int) -> tuple[Int, F64]:
        """Corners and barycentric weights (n, 3) of the skin point closest to each vertex that the skin guides."""
        points = self._vertices[self._guided]
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
        chosen = np.zeros(len(mesh.vertices), bool)
        chosen[part] = True
        own = submesh(mesh, chosen)
        reach = 100 * float(np.ptp(own.vertices, axis=0).max())
        self.rows, self._fill = part, TensionFill(own.vertices, own.rings, border[part], reach)

    def __call__(self, made: F64, rest: F64) -> F64:
        """Its vertices (n, 3), given all (N, 3) with its border in place, and those at rest."""
        return np.asarray(rest[self.rows] + self._fill((made - rest)[self.rows]))


def _kinds(
    mesh: Mesh, skin: Bool, border: Bool, matched: Bool | None, face: FaceFrame | None
) -> dict[str, list[Int]]:
    """The parts by what moves them; "still" ones stay."""
    kinds: dict[str, list[Int]] = {
        name: [] for name in ("matched", "cards", "shells", "lower jaw", "solid", "still")
    }
    for label in np.unique(mesh.components[~skin]):
        part = np.flatnonzero(mesh.components == label)
        kinds[_kind(mesh.vertices, part, border, matched, face)].append(part)
    return kinds


def _kind(vertices: F64, part: Int, border: Bool, matched: Bool | None, face: FaceFrame | None) -> str:
    if matched is not None and matched[part].mean() >= PART_LIMITS.min_matched_share:
        return "matched"
    middle = (vertices[part].min(0) + vertices[part].max(0)) / 2
    if face is not None and face.in_mouth(middle):
        return "still" if face.in_upper_jaw(middle) else "lower jaw"
    if border[part].mean() >= PART_LIMITS.min_border_share:
        return "cards"
    if face is None or not face.at_eye(middle):
        return "solid"
    return "shells" if _is_shell(vertices, part, border, face) else "still"


def _is_shell(vertices: F64, part: Int, border: Bool, face: FaceFrame) -> bool:
    """Whether the border of a part at an eye lies along its lids: in front, within their corners' depth."""
    rim = part[border[part]]
    if not len(rim):
        return False
    middle, width = min(face.eyes, key=lambda eye: float(np.linalg.norm(vertices[rim].mean(0) - eye[0])))
    depth = np.abs((vertices[rim] - middle) @ face.axes[2])
    return bool(np.median(depth) < PART_LIMITS.lid_widths * width)


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
