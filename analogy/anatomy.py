"""What the components of a head are: skin, eyeballs, lashes, brows, teeth, tongue, glasses, hair, clothes, body.

The skin carries the feature points.  Of the other components a name in the file says what they are, or else their
place in the face.  Skin that leads far away from the face, as that of a body in one piece does, is body there.  Any
unit; lengths are in spans, between the outer corners of the eyes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from scipy.spatial import cKDTree

from guise.analogy.carriers import carriers, components_of, touching
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.geometry import border_mask, face_normals
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64, Bool, Int

Kind = Literal[
    "other", "face skin", "scalp", "eyeball", "eye shell", "lashes", "brows", "upper teeth", "lower teeth",
    "tongue", "gums and cavity", "glasses", "hair", "clothes", "body",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)
SKIN: tuple[Kind, ...] = ("face skin", "scalp")
STILL: tuple[Kind, ...] = ("clothes", "body")  # even when the head turns
CORRESPONDING: tuple[Kind, ...] = ("upper teeth", "lower teeth", "tongue", "gums and cavity", "other")
TEETH: tuple[Kind, ...] = ("upper teeth", "lower teeth")
MOUTH: tuple[Kind, ...] = ("upper teeth", "lower teeth", "tongue", "gums and cavity")

# What the names of nodes, meshes, groups and materials say, first match first.
WORDS: tuple[tuple[Kind, str], ...] = (
    ("glasses", r"glasses|spectacle|eyewear|goggle"),
    ("lashes", r"lash|eyeline"),
    ("brows", r"brow|beard|mustache|moustache|stubble"),
    ("eye shell", r"occlusion|tearline|tear_line|lacrimal|eye_?blend|eye_?wet"),
    ("tongue", r"tongue"),
    ("upper teeth", r"(upper|top).?(teeth|tooth|dent)|(teeth|tooth|dent)\w*.?(upper|top)"),
    ("lower teeth", r"(lower|bottom).?(teeth|tooth|dent)|(teeth|tooth|dent)\w*.?(lower|bottom)"),
    ("gums and cavity", r"gum|gingiva|cavity|palate|mouth|oral|teeth|tooth|dental"),
    ("eyeball", r"eye|iris|pupil|cornea|sclera"),
    ("hair", r"hair|pony|bangs|fringe|headwear|hat\b|helmet"),
    (
        "clothes",
        r"cloth|outfit|shirt|sweater|jacket|coat|dress|skirt|pants|trouser|shoe|footwear|boots|suit|uniform|"
        r"tops|bottoms|onepiece|glove|sock",
    ),
    ("scalp", r"scalp|skull|head"),
    ("body", r"body|torso|hand\b|hands|arms?\b|legs?\b|foot|feet"),
)


@dataclass(frozen=True)
class AnatomyLimits:
    """Thresholds of the kinds, in spans unless they say otherwise."""

    head_radius: float = 3.2  # around the eyes; skin that leads twice as far is a body's
    min_border_share: float = 1 / 3  # of a part's vertices on an open border, from which it consists of cards
    brow_reach: float = 0.3
    brow_height: float = 0.08  # over the skin
    cavity_heights: float = 0.2  # of the mouth's width above and below the lips, which a cavity spans
    same_box: float = 0.15  # between the sides of boxes of two heads' parts, up to which they are the same
    jaws_apart: float = 0.15  # of the mouth's width, between the middles of upper and lower teeth
    tongue_widths: float = 0.4  # of the mouth, that it is at least wide and long
    tongue_share: float = 0.05  # of its vertices in the middle of its box, from which it is no arch of teeth
    glasses_sides: float = 0.25  # to both sides of the nose
    glasses_heights: tuple[float, float] = (
        0.45,
        0.9,
    )  # of their middle from the eyes, and from top to bottom
    crown_height: float = 0.6  # above the eyes, over which there is hair
    hair_height: float = 0.25  # the same, of the middle of a part
    hair_depth: float = 0.6  # behind them


ANATOMY = AnatomyLimits()


@dataclass(frozen=True)
class FacePlaces:
    """Places in a face; widths are those of the mouth or of an eye, from corner to corner."""

    mouth_widths: tuple[float, float, float] = (0.9, 0.9, 1.6)  # sideways, up or down, and back from the lips
    upper_jaw_widths: float = 0.05  # above the line of the lips, from which a part belongs to the skull
    throat_share: float = 0.3  # of a cavity's length, at its end
    min_cavity_widths: float = 0.2  # from front to back, below which nothing of it is the throat
    eye_widths: float = 0.75  # around the middle of an eye, of eyeballs and shells
    lid_widths: float = 0.2  # from the lids' corners line of a shell's border


PLACES = FacePlaces()


@dataclass(frozen=True, eq=False)
class FaceFrame:
    """Mouth and eyes of a head, from its 20 feature points (3,) each, in the order of `FEATURE_POINT_NAMES`.

    axes : (3, 3) unit rows: to the person's left, up and forward.   mouth, chin : (3,).   mouth_width : of it.
    eyes : middle (3,) and width of each.   span : between the outer corners of the eyes.
    """

    axes: F64
    mouth: F64
    mouth_width: float
    chin: F64
    eyes: tuple[tuple[F64, float], ...]
    span: float

    @classmethod
    def of(cls, points: F64) -> FaceFrame:
        """From points (20, 3)."""
        at = dict(zip(FEATURE_POINT_NAMES, points, strict=True))
        outer = at["eye_left_outer"] - at["eye_right_outer"]
        across = at["mouth_corner_left"] - at["mouth_corner_right"] + outer
        lips = (at["upper_lip_inner"] + at["lower_lip_inner"]) / 2
        forward = np.cross(across, at["nose_bridge"] - at["chin"])
        axes = np.stack([across, np.cross(forward, across), forward])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True).clip(1e-300)
        width = float(np.linalg.norm(at["mouth_corner_left"] - at["mouth_corner_right"]))
        corners = [(at[f"eye_{side}_outer"], at[f"eye_{side}_inner"]) for side in ("right", "left")]
        eyes = tuple(((one + other) / 2, float(np.linalg.norm(one - other))) for one, other in corners)
        return cls(axes, lips, width, at["chin"], eyes, max(float(np.linalg.norm(outer)), 1e-300))

    @property
    def between_eyes(self) -> F64:
        """(3,)."""
        return np.asarray((self.eyes[0][0] + self.eyes[1][0]) / 2)

    def in_mouth(self, places: F64) -> Bool:
        """(...) whether places (..., 3) lie behind the lips."""
        side, up, forward = ((places - self.mouth) @ self.axes.T / self.mouth_width).T
        wide, high, deep = PLACES.mouth_widths
        return np.asarray((abs(side) < wide) & (abs(up) < high) & (-deep < forward) & (forward < 0))

    def throat(self, places: F64) -> Bool:
        """(n,) which places (n, 3) of a cavity in the mouth are its end, which stays with the skull."""
        back = (self.mouth - places) @ self.axes[2]
        long = float(np.ptp(back)) if len(back) else 0.0
        deep = back > back.max(initial=0) - PLACES.throat_share * long
        return np.asarray(deep & (long > PLACES.min_cavity_widths * self.mouth_width))

    def in_upper_jaw(self, place: F64) -> bool:
        """Whether a place (3,) in the mouth lies above the line of the lips."""
        return bool((place - self.mouth) @ self.axes[1] > PLACES.upper_jaw_widths * self.mouth_width)

    def lower_share(self, places: F64) -> F64:
        """(n,) by which places (n, 3) in the mouth move with the lower jaw: 0 above the line of the lips, 1 below."""
        up = (places - self.mouth) @ self.axes[1] / (PLACES.upper_jaw_widths * self.mouth_width)
        share = np.clip((1 - up) / 2, 0, 1)
        return np.asarray(share**2 * (3 - 2 * share))

    def at_eye(self, place: F64) -> bool:
        """Whether a place (3,) is that of an eyeball."""
        return any(
            np.linalg.norm(((place - middle) @ self.axes.T)[:2]) < PLACES.eye_widths * width
            for middle, width in self.eyes
        )

    def along_lids(self, rim: F64) -> bool:
        """Whether a border (k, 3) at an eye lies along its lids: in front, within their corners' depth."""
        middle, width = min(self.eyes, key=lambda eye: float(np.linalg.norm(rim.mean(0) - eye[0])))
        depth = np.abs((rim - middle) @ self.axes[2])
        return bool(np.median(depth) < PLACES.lid_widths * width)


@dataclass(frozen=True, eq=False)
class Component:
    """A component of a head.

    rows : its vertices (n,).   name : in the file, "" where it has none.   by : what says its kind.
    """

    rows: Int
    name: str
    kind: Kind
    by: Literal["points", "name", "place", "source", "file"]


def kind_mask(mesh: Mesh, kinds: Sequence[Kind]) -> Bool:
    """(N,) which vertices of a mesh with kinds are of some of them."""
    assert mesh.kinds is not None
    return np.isin(mesh.kinds, [KINDS.index(kind) for kind in kinds])


def name_components(mesh: Mesh, points: F64, names: Sequence[str] | None = None) -> list[Component]:
    """What each component of a head is.

    Parameters
    ----------
    points : feature points (20, 3).   names : (N,) of the vertices in the file; None where it has none.
    """
    rows = components_of(mesh)
    face = FaceFrame.of(points)
    skin = carriers(mesh, points, face.span)
    judge = _Judge(mesh, face, np.concatenate([rows[k] for k in skin]))
    found = []
    for number, part in enumerate(rows):
        name = "" if names is None else _commonest([names[k] for k in part[:: max(1, len(part) // 50)]])
        if number in skin:
            found += _split_by_name(mesh, part, names, points)
            continue
        said = kind_by_name(name)
        if said is not None and judge.fits(said, part):
            found.append(Component(part, name, judge.in_detail(said, part), "name"))
        else:
            found.append(Component(part, name, judge.kind(part), "place"))
    return _with_both_jaws(found, mesh, face)


def like_source(
    parts: Sequence[Component], own: tuple[Mesh, F64], source: Sequence[Component], other: tuple[Mesh, F64]
) -> list[Component]:
    """The components of a target; one judged by its place is what the source calls a part of that place and size.

    own, other : mesh and feature points (20, 3) of target and source.
    """
    known = [part for part in source if part.by == "name" and part.kind not in SKIN]
    boxes = np.array([_box(part, *other) for part in known]).reshape(len(known), 6)
    found = []
    for part in parts:
        if part.by == "place" and len(known):
            away = np.abs(boxes - _box(part, *own)).max(1)
            if away.min() < ANATOMY.same_box:
                part = replace(part, kind=known[int(away.argmin())].kind, by="source")
        found.append(part)
    return found


def _box(part: Component, mesh: Mesh, points: F64) -> F64:
    """(6,) the box around a component, from the middle between the eyes, in spans."""
    face = FaceFrame.of(points)
    placed = (mesh.vertices[part.rows] - face.between_eyes) @ face.axes.T / face.span
    return np.concatenate([placed.min(0), placed.max(0)])


def _split_by_name(mesh: Mesh, part: Int, names: Sequence[str] | None, points: F64) -> list[Component]:
    """The skin, and what it is joined to whose name says that it is not: files weld a neck to a body, too."""
    if names is None:
        return [Component(part, "", "face skin", "points")]
    called = np.array([names[k] for k in part])
    carry = set(called[cKDTree(mesh.vertices[part]).query(points)[1]])
    own: Bool = np.ones(len(part), bool)
    found = []
    for name in dict.fromkeys(called.tolist()):
        kind = kind_by_name(name)
        if name not in carry and kind in ("glasses", "hair", "clothes", "body"):
            own &= called != name
            found.append(Component(part[called == name], name, kind, "name"))
    return [Component(part[own], _commonest(called[own].tolist()), "face skin", "points"), *found]


def _with_both_jaws(parts: list[Component], mesh: Mesh, face: FaceFrame) -> list[Component]:
    """Teeth that all seem to be of one jaw, but lie at different heights, by these: lips may hang over a row."""
    teeth = [k for k, part in enumerate(parts) if part.kind in TEETH]
    up = [float(mesh.vertices[parts[k].rows].mean(0) @ face.axes[1]) / face.mouth_width for k in teeth]
    if len({parts[k].kind for k in teeth}) == 1 and max(up) - min(up) > ANATOMY.jaws_apart:
        for k, height in zip(teeth, up, strict=True):
            parts[k] = replace(parts[k], kind=TEETH[int(height < (max(up) + min(up)) / 2)])
    return parts


def with_components(mesh: Mesh, parts: Sequence[Component], points: F64) -> Mesh:
    """The mesh with the kinds of its components; skin far away from the face is body."""
    kinds = np.zeros(len(mesh.vertices), np.intp)
    face = FaceFrame.of(points)
    for part in parts:
        kinds[part.rows] = KINDS.index(part.kind)
        if part.kind in SKIN:
            away = np.linalg.norm(mesh.vertices[part.rows] - face.between_eyes, axis=1) / face.span
            if away.max() > 2 * ANATOMY.head_radius:
                kinds[part.rows[away > ANATOMY.head_radius]] = KINDS.index("body")
    whole = np.unique(mesh.faces[(kinds[mesh.faces] == kinds[mesh.faces[:, :1]]).all(1)])
    cut_off = np.setdiff1d(np.arange(len(kinds)), whole)  # every face of them leads from one kind to another
    kinds[cut_off] = KINDS.index("body")
    return mesh.with_kinds(kinds)


def kinds_by_place(mesh: Mesh, face: FaceFrame, skin: Bool) -> Mesh:
    """The mesh with the kinds that the places of its components say, where some are known to be skin (N,)."""
    judge = _Judge(mesh, face, np.flatnonzero(skin))
    kinds = np.where(skin, KINDS.index("face skin"), 0)
    for part in components_of(mesh):
        if not skin[part[0]]:
            kinds[part] = KINDS.index(judge.kind(part))
    return mesh.with_kinds(kinds)


def kind_by_name(name: str) -> Kind | None:
    """What a name says, None where it says nothing.

    >>> kind_by_name("Wolf3D_Hair"), kind_by_name("EyeLeft"), kind_by_name("N00_000_00_FaceEyelash_00_FACE")
    ('hair', 'eyeball', 'lashes')
    """
    spoken = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).replace("_", " ").lower()
    return next((kind for kind, words in WORDS if re.search(words, spoken)), None)


def _commonest(names: Sequence[str]) -> str:
    return max(dict.fromkeys(names), key=names.count)


class _Judge:
    """Says by the place of a component (n,) in the face what it is.   skin : the vertices (n,) of the face."""

    def __init__(self, mesh: Mesh, face: FaceFrame, skin: Int) -> None:
        self._mesh, self._face = mesh, face
        self._skin = cKDTree(mesh.vertices[skin])
        self._area = _areas(mesh)
        self._skin_area = float(self._area[mesh.components[skin[0]]])
        self._border = border_mask(mesh.faces, len(mesh.vertices))
        self._chin = float(self._placed(face.chin)[1])

    def fits(self, kind: Kind, part: Int) -> bool:
        """Whether a component may be what its name says: one named after the whole head may be anything."""
        at = self._placed(self._mesh.vertices[part])
        low, high = at.min(0), at.max(0)
        if kind in MOUTH or kind in ("eyeball", "eye shell", "lashes", "brows"):
            return bool((high - low).max() < 1.6 and np.linalg.norm((low + high) / 2) < ANATOMY.head_radius)
        if kind == "scalp":
            return self._is_scalp(part)
        return True

    def in_detail(self, kind: Kind, part: Int) -> Kind:
        """Of teeth in general, which."""
        return self._mouth_kind(part) if kind == "gums and cavity" else kind

    def kind(self, part: Int) -> Kind:
        """By place alone."""
        at = self._mesh.vertices[part]
        middle = (at.min(0) + at.max(0)) / 2
        cards = self._border[part].mean() >= ANATOMY.min_border_share
        if self._face.in_mouth(middle):
            return self._mouth_kind(part)
        placed = self._placed(at)
        low, high = placed.min(0), placed.max(0)
        if self._is_glasses(low, high):
            return "glasses"
        if self._is_brow(at):
            return "brows"
        if not cards and self._face.at_eye(middle):
            rim = at[self._border[part]]
            return "eye shell" if len(rim) and self._face.along_lids(rim) else "eyeball"
        if cards and self._face.at_eye(middle):
            return "lashes"
        if self._is_scalp(part):
            return "scalp"
        if high[1] > ANATOMY.crown_height:
            return "hair"
        if high[1] < self._chin or (low[1] + high[1]) / 2 < self._chin - 0.3:
            return "body" if self._touches(part) else "clothes"
        if (low[1] + high[1]) / 2 > ANATOMY.hair_height or (low[2] + high[2]) / 2 < -ANATOMY.hair_depth:
            return "hair"
        return "other"

    def _placed(self, places: F64) -> F64:
        """Places (..., 3) to the left, up and forward of the middle between the eyes, in spans."""
        return np.asarray((places - self._face.between_eyes) @ self._face.axes.T / self._face.span)

    def _mouth_kind(self, part: Int) -> Kind:
        at = self._mesh.vertices[part]
        side, up, forward = ((at - self._face.mouth) @ self._face.axes.T / self._face.mouth_width).T
        if min(up.max(), -up.min()) > ANATOMY.cavity_heights:
            return "gums and cavity"
        if self._face.in_upper_jaw((at.min(0) + at.max(0)) / 2):
            return "upper teeth"
        inner = np.abs(side - (side.min() + side.max()) / 2) < np.ptp(side) / 6
        inner &= forward < forward.max() - np.ptp(forward) / 3
        large = min(np.ptp(side), np.ptp(forward)) > ANATOMY.tongue_widths
        return "tongue" if large and inner.mean() > ANATOMY.tongue_share else "lower teeth"

    def _is_glasses(self, low: F64, high: F64) -> bool:
        """Whether a box spans both eyes in front of them, and not much more."""
        near, tall = ANATOMY.glasses_heights
        across = low[0] < -ANATOMY.glasses_sides and high[0] > ANATOMY.glasses_sides
        return bool(across and high[2] > 0 and abs(low[1] + high[1]) / 2 < near and high[1] - low[1] < tall)

    def _is_brow(self, at: F64) -> bool:
        """Whether a part (n, 3) lies flat above an eye."""
        middle = (at.min(0) + at.max(0)) / 2
        above = (
            [
                float(np.linalg.norm((middle - eye) @ self._face.axes[:2].T)) / self._face.span
                for eye, _ in self._face.eyes
            ],
            [float((middle - eye) @ self._face.axes[1]) / width for eye, width in self._face.eyes],
        )
        near = min(above[0]) < ANATOMY.brow_reach and max(above[1]) > PLACES.eye_widths / 2
        return near and float(np.max(self._skin.query(at)[0])) < ANATOMY.brow_height * self._face.span

    def _is_scalp(self, part: Int) -> bool:
        """Whether a large component goes on where the skin of the face ends, and not below the chin."""
        large = self._area[self._mesh.components[part[0]]] > self._skin_area / 4
        return bool(
            large and self._placed(self._mesh.vertices[part].mean(0))[1] > self._chin and self._touches(part)
        )

    def _touches(self, part: Int) -> bool:
        """Whether its border coincides with some of the skin."""
        return touching(self._skin, self._mesh.vertices[part[self._border[part]]], self._face.span)


def _areas(mesh: Mesh) -> F64:
    """(c,) twice the area of each component."""
    double = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    return np.bincount(mesh.components[mesh.faces[:, 0]], double).astype(np.float64)
