"""Whole bodies in the layouts of Ready Player Me and VRoid, made of the renderer's people (shared/people).

Their expressions are exact truth: MakeHuman's 34 units on every body.  Decimetres, y up, z forward.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from guise.analogy.cleaning import CleanedMesh
from guise.analogy.formats.polygons import Polygons
from guise.analogy.mesh import Mesh
from guise.common.arrays import F64, Int

Layout = Literal["Ready Player Me", "VRoid", "one piece"]
LAYOUTS: tuple[Layout, ...] = ("Ready Player Me", "VRoid", "one piece")
# What each surface is called: node / material.
NAMES: dict[Layout, dict[str, str]] = {
    "Ready Player Me": {
        "head": "Wolf3D_Head / Wolf3D_Skin", "body": "Wolf3D_Body / Wolf3D_Body", "eyes": "EyeLeft / Wolf3D_Eye",
        "teeth": "Wolf3D_Teeth / Wolf3D_Teeth", "tongue": "Wolf3D_Teeth / Wolf3D_Teeth",
        "brows": "Wolf3D_Head / Eyebrow", "lashes": "AvatarLeftEyelashes / Wolf3D_Skin",
        "hair": "Wolf3D_Hair / Wolf3D_Hair",
        "clothes": "Wolf3D_Outfit_Top / Wolf3D_Outfit_Top", "glasses": "Wolf3D_Glasses / Wolf3D_Glasses",
    },
    "VRoid": {
        "head": "Face / N00_000_00_Face_00_SKIN", "body": "Body / N00_000_00_Body_00_SKIN",
        "eyes": "Face / N00_000_00_EyeIris_00_EYE", "teeth": "Face / N00_000_00_FaceMouth_00_FACE",
        "tongue": "Face / N00_000_00_FaceMouth_00_FACE", "brows": "Face / N00_000_00_FaceBrow_00_FACE",
        "lashes": "Face / N00_000_00_FaceEyelash_00_FACE", "hair": "Hair / N00_000_Hair_00_HAIR",
        "clothes": "Body / N00_002_03_Tops_01_CLOTH", "glasses": "Glasses / Glass",
    },
    "one piece": {},
}  # fmt: skip
STILL = ("hair", "clothes", "glasses", "body")
NECK_DM = 0.02  # above the first joint of the neck, where the head ends


@dataclass(frozen=True, eq=False)
class Avatar:
    """A body.

    Parameters
    ----------
    names : (N,) of the vertices.   shapes : (k, N, 3) displacements.   parts : vertices by surface.
    """

    mesh: Mesh
    names: list[str]
    shapes: F64
    parts: dict[str, Int]


class People:
    """The renderer's people, by name."""

    def __init__(self, shared: Path) -> None:
        sys.path.insert(0, str(shared / "people"))
        import human
        import people

        self._human: Any = human
        self._specs = {spec["name"]: spec for spec in people.PEOPLE}
        self.units: tuple[str, ...] = tuple(human.UNITS)

    def head(self, name: str) -> Avatar:
        """The skin of the head alone."""
        return self._made(name, "Ready Player Me", ("head",))

    def body(self, name: str, layout: Layout, *, glasses: bool = True) -> Avatar:
        """Everything."""
        kinds = ("head", "body", "eyes", "teeth", "tongue", "brows", "lashes", "hair", "clothes")
        return self._made(name, layout, (*kinds, "glasses") if glasses else kinds)

    def head_rows(self, body: Avatar, alone: Avatar) -> Int:
        """The vertices (n,) of a body that are those of the same person's head alone."""
        skin = body.parts["head"]
        near = cKDTree(body.mesh.vertices[skin]).query(alone.mesh.vertices)[1]
        return np.asarray(skin[near], np.intp)

    def _made(self, name: str, layout: Layout, kinds: tuple[str, ...]) -> Avatar:
        person = self._human.Person(self._specs[name])
        at = np.stack([person.base, *(person.base + unit for unit in person.E)]).astype(np.float64)
        base = self._human.base()
        skin = base.f[(base.g == "body")]
        low = base.v[person.joints["neck01"]].mean(0)[1] + NECK_DM
        above = (base.v[skin][:, :, 1] > low).all(1) & (np.abs(base.v[skin][:, :, 0]) < 1.6).all(1)
        pieces: list[tuple[str, F64, Int]] = []
        if layout == "one piece":
            used, faces = np.unique(skin, return_inverse=True)
            pieces.append(("head", at[:, used], _triangles(faces.reshape(-1, 4))))
            kinds = tuple(kind for kind in kinds if kind not in ("head", "body"))
        for kind in kinds:
            if kind in ("head", "body"):
                used, faces = np.unique(skin[above == (kind == "head")], return_inverse=True)
                pieces.append((kind, at[:, used], _triangles(faces.reshape(-1, 4))))
            elif kind == "glasses":
                pieces.append(("glasses", *_glasses(person.eye_c, len(at))))
            elif kind in person.surf:
                surface = person.surf[kind]
                placed = np.stack([surface.positions(one) for one in at])
                pieces.append((kind, placed, _triangles(surface.f)))
        return _joined(pieces, NAMES[layout])


def _triangles(quads: Int) -> Int:
    """Of quads (q, 4), some of which are triangles whose last corner is repeated."""
    both = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.intp)
    return both[(both != np.roll(both, 1, axis=1)).all(1)]


def _glasses(eyes: dict[str, F64], count: int) -> tuple[F64, Int]:
    """A frame with open borders, (count, n, 3): a band around each eye, a bridge and temples, in one piece."""
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    way, middle = np.array([1.0, 0, 0]), (eyes["l"] + eyes["r"]) / 2
    half = float((eyes["l"] - eyes["r"]) @ way) / 2
    places, faces = [], []
    for side in (-1, 1):
        start = sum(map(len, places))
        for reach in (0.75, 0.9):
            ring = np.stack(
                [reach * half * np.cos(turn), 0.8 * reach * half * np.sin(turn), 0 * turn], axis=1
            )
            places.append(ring + middle + np.array([side * half, 0, 1.1 * half]))
        inner = start + np.arange(24)
        outer, after = inner + 24, start + (np.arange(24) + 1) % 24
        faces.append(np.stack([inner, outer, after + 24, after], axis=1))
        near = start + 24 + (0 if side > 0 else 12)  # the outermost place of a ring
        back = sum(map(len, places))
        temple = places[-1][0 if side > 0 else 12]
        places.append(
            temple
            + np.array([[0.05 * side, 0, -2.6 * half], [0.05 * side, -0.2, -2.6 * half]]) * (1, half, 1)
        )
        faces.append(np.array([[near, near + 1, back, back + 1]]))
    faces.append(np.array([[24 + 1, 24, 72 + 2 + 12, 72 + 2 + 11]]))  # the bridge
    return np.repeat(np.concatenate(places)[None], count, axis=0), _triangles(np.concatenate(faces))


def _joined(pieces: list[tuple[str, F64, Int]], names: dict[str, str]) -> Avatar:
    """One file of pieces that stay apart."""
    starts = np.cumsum([0, *(at.shape[1] for _, at, _ in pieces)])
    at = np.concatenate([at for _, at, _ in pieces], axis=1)
    faces = np.concatenate([faces + start for (_, _, faces), start in zip(pieces, starts, strict=False)])
    piece = np.repeat(np.arange(len(pieces)), np.diff(starts))
    cleaned = CleanedMesh.of(at[0], Polygons.of(faces), apart=piece[:, None].astype(np.float64))
    piece, at = piece[cleaned.kept], at[:, cleaned.kept]
    kinds = [kind for kind, _, _ in pieces]
    parts = {kind: np.flatnonzero(piece == number) for number, kind in enumerate(kinds)}
    called = [names.get(kind, "") for kind in kinds]
    return Avatar(cleaned.mesh, [called[k] for k in piece], at[1:] - at[0], parts)
