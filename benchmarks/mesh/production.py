"""Heads for production: no vertex flies off, lids meet, teeth stay in their jaws, on every topology.

The expressions of the ICT head onto its other identities in other forms (remeshed, n-gons, larger eyes, with mouth bag,
sockets, teeth, gums, tongue and eyeballs) and onto MakeHuman's heads and another artist's.  Feature points are detected
on every head.  `gradients` is deformation transfer (Sumner and Popovic 2004) with the same correspondence.

Furthest: the largest motion of a vertex, of the source's largest, scaled.  Lid gap: the area between the lids in a
blink, seen from the front, of that at rest.  Torn: edges at the eyes three times as long as in the truth, or, where
nobody knows it, at rest.  Inverted: faces there turned by more than 100 degrees from rest and, if it is known, from the
truth: some of the true lids fold themselves, on an identity not made for the blink up to 20 faces.  The same at the
corners of the mouth, in eight shapes that move them.  Units: how far an opened jaw lies from the same one when the
target is a million times as large or as small, of the head's extent.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.full_heads import BIGGER_EYES, FullHead, IctHeads, others
from benchmarks.mesh.transfer import err
from guise.aam.similarity import Failed
from guise.analogy.feature_points import FEATURE_POINT_NAMES, find_feature_points
from guise.analogy.geometry import edge_lengths, face_normals
from guise.analogy.registration import skin_mask
from guise.analogy.transfer import Method, Transfer, prepare_transfer
from guise.common.arrays import F64, Bool, Int
from guise.render.visibility import visible

NAME, TITLE = "mesh.production", "Heads for production"
BLINKS = ("eyeBlink_R", "eyeBlink_L")
MOUTH_SHAPES = (
    "jawOpen", "jawLeft", "mouthFunnel", "mouthPucker", "mouthSmile_L", "mouthStretch_R", "mouthUpperUp_L",
    "mouthLowerDown_R",
)  # fmt: skip
MAX_FURTHEST, MAX_GAP_PERCENT, MAX_BLINK_ERROR = 1.5, 5.0, 0.2
MAX_UPPER_TEETH_CM, MAX_JAW_ERROR = 0.1, 0.1
UNITS, MAX_UNIT_DIFFERENCE = (1e6, 1e-6), 1e-6
LIP_CORNER_WIDTHS = 0.35  # of the mouth, around its corners
EYE_PICTURE_PX, HOLE_DEPTH_WIDTHS = 300, 0.25  # two eye widths; behind the margins' middle
TORN_RATIO, INVERTED_COSINE = 3.0, -0.17
LOWER = ("lower teeth", "lower gum", "tongue")


def targets(model: IctHeads, quick: bool) -> Iterator[FullHead]:
    """The heads.  The true blinks of these identities shut, unlike those of some others."""
    yield model.remeshed(6, 7678)
    if quick:
        return
    yield model.remeshed(9, 37500)
    yield model.plain(12, BIGGER_EYES)
    yield model.polygons(4)
    yield model.full(8)
    yield from others(model.folder)


def lid_gap(head: FullHead, made: F64, eye: int) -> float:
    """Area between the lids seen from the front where nothing near shows, of that at rest, %."""
    high, low = head.lids[eye]
    at = head.mesh.vertices[np.concatenate([high, low[::-1]])]
    middle, width = at.mean(0), float(np.ptp(at[:, 0]))
    skin = skin_mask(head.mesh)
    faces = head.mesh.faces[skin[head.mesh.faces[:, 0]]]
    scale = EYE_PICTURE_PX / (2 * width)
    outline = np.rint(((at - middle) * (scale, -scale, 1))[:, :2] + EYE_PICTURE_PX / 2).astype(np.int32)
    inside = np.zeros((EYE_PICTURE_PX, EYE_PICTURE_PX), np.uint8)
    cv2.fillPoly(inside, [outline], 1)
    open_before, open_after = (
        (_depths((vertices - middle) * scale, faces) < -HOLE_DEPTH_WIDTHS * width * scale)[inside > 0].sum()
        for vertices in (head.mesh.vertices, made)
    )
    return 100 * float(open_after) / float(open_before)


def _depths(vertices: F64, faces: Int) -> F64:
    """Heights towards the viewer (h, w) of a mesh seen from the front, in pixels; minus infinity where it is not."""
    places = vertices * (1, -1, -1) + (EYE_PICTURE_PX / 2, EYE_PICTURE_PX / 2, 0)
    near = (np.abs(vertices[:, :2]) < EYE_PICTURE_PX).all(1)
    drawn = faces[near[faces].any(1)]
    seen = visible(places, drawn, (EYE_PICTURE_PX, EYE_PICTURE_PX), "cpu")
    out = np.full(seen.triangle.shape, -np.inf)
    out[seen.covered] = seen.interpolated(vertices[:, 2:], drawn)[:, 0]
    return out


def flaws(head: FullHead, faces: Int, made: F64, truth: F64 | None) -> tuple[int, int]:
    """Inverted ones of faces (m, 3), and torn edges."""
    rest = head.mesh.vertices
    like = rest if truth is None else truth
    inverted = _turned_over(made, rest, faces) & _turned_over(made, like, faces)
    long = float(np.median(edge_lengths(rest, faces)))
    torn = edge_lengths(made, faces) > TORN_RATIO * np.maximum(edge_lengths(like, faces), long)
    return int(inverted.sum()), int(torn.sum())


def _turned_over(made: F64, like: F64, faces: Int) -> Bool:
    """(m,) which faces look away from where they look in a like mesh; slivers do not count."""
    one, other = face_normals(made, faces), face_normals(like, faces)
    sizes = np.linalg.norm(one, axis=1), np.linalg.norm(other, axis=1)
    solid = np.minimum(*sizes) > 0.02 * float(np.median(sizes[1]))
    return np.asarray(solid & ((one * other).sum(1) < INVERTED_COSINE * sizes[0] * sizes[1]))


def face_mask(head: FullHead) -> Bool:
    """(N,) the skin without the bags behind lips and lids, whose truth nobody knows."""
    skin = skin_mask(head.mesh)
    skin[head.parts.get("bags", [])] = False
    return skin


def _at_the_eyes(head: FullHead) -> Int:
    loops = (head.mesh.vertices[np.concatenate(margins)] for margins in head.lids)
    return _around(head, [(at.mean(0), 0.75 * float(np.ptp(at, axis=0).max())) for at in loops])


def _at_the_lip_corners(head: FullHead) -> Int:
    points = find_feature_points(head.mesh)
    assert not isinstance(points, Failed)
    place = dict(zip(FEATURE_POINT_NAMES, points.positions, strict=True))
    left, right = place["mouth_corner_left"], place["mouth_corner_right"]
    reach = LIP_CORNER_WIDTHS * float(np.linalg.norm(left - right))
    return _around(head, [(left, reach), (right, reach)])


def _around(head: FullHead, places: list[tuple[F64, float]]) -> Int:
    """Faces (m, 3) of the skin within a distance of some places (3,)."""
    away = [np.linalg.norm(head.mesh.vertices - place, axis=1) / reach for place, reach in places]
    near = np.min(away, axis=0) < 1
    return np.asarray(head.mesh.faces[(near & face_mask(head))[head.mesh.faces].all(1)])


def lip_flaws(target: FullHead, made: dict[str, F64], names: tuple[str, ...]) -> int:
    """Inverted faces and torn edges at the corners of the mouth."""
    faces = _at_the_lip_corners(target)
    truths = [None if target.shapes is None else target.shapes[names.index(name)] for name in MOUTH_SHAPES]
    return sum(
        sum(flaws(target, faces, made[name], truth)) for name, truth in zip(MOUTH_SHAPES, truths, strict=True)
    )


def blink_figures(
    target: FullHead, made: dict[str, F64], names: tuple[str, ...]
) -> tuple[float, float, int, int]:
    """Largest gap of both eyes in %, error, inverted faces, torn edges."""
    gaps, errors, inverted, torn = [], [], 0, 0
    for eye, (high, _) in enumerate(target.lids):
        left = target.mesh.vertices[high, 0].mean() > np.mean(
            [target.mesh.vertices[pair[0], 0].mean() for pair in target.lids]
        )
        blink = BLINKS[int(left)]
        truth = None if target.shapes is None else target.shapes[names.index(blink)]
        gaps.append(lid_gap(target, made[blink], eye))
        if truth is not None:
            skin = face_mask(target)
            errors.append(err(target.mesh.vertices[skin], truth[skin], made[blink][skin]))
        folded, ripped = flaws(target, _at_the_eyes(target), made[blink], truth)
        inverted, torn = inverted + folded, torn + ripped
    return max(gaps), max(errors, default=float("nan")), inverted, torn


def transferred(source: FullHead, transfer: Transfer, names: tuple[str, ...]) -> dict[str, F64]:
    """All expressions on the target."""
    assert source.shapes is not None
    return {name: transfer(shape) for name, shape in zip(names, source.shapes, strict=True)}


def furthest(source: FullHead, transfer: Transfer, made: dict[str, F64]) -> tuple[float, str]:
    """The largest motion of a vertex, of the source's largest in its shape, scaled; and the shape."""
    assert source.shapes is not None
    own = np.linalg.norm(source.shapes - source.mesh.vertices, axis=2).max(1) * transfer.pose.scale
    way = [np.linalg.norm(face - transfer.target.vertices, axis=1).max() for face in made.values()]
    ratio = np.array(way) / own
    return float(ratio.max()), list(made)[int(ratio.argmax())]


def unit_difference(source: FullHead, model: IctHeads) -> float:
    """The largest difference that the target's unit makes to an opened jaw, of the head's extent."""
    assert source.shapes is not None
    target, opened = model.remeshed(6, 7678).mesh, source.shapes[model.names.index("jawOpen")]
    usual = prepare_transfer(source.mesh, target)(opened)
    made = (
        prepare_transfer(source.mesh, target.with_vertices(target.vertices * unit))(opened) / unit
        for unit in UNITS
    )
    return max(float(np.abs(other - usual).max()) for other in made) / target.extent


def parts_figures(target: FullHead, made: dict[str, F64], names: tuple[str, ...]) -> dict[str, float]:
    """Furthest of the upper teeth in any shape, cm; error of each lower part in jawOpen, of its true motion."""
    assert target.shapes is not None
    rest = target.mesh.vertices
    upper = target.parts["upper teeth"]
    out = {
        "upper teeth": max(
            float(np.linalg.norm((face - rest)[upper], axis=1).max()) for face in made.values()
        )
    }
    truth = target.shapes[names.index("jawOpen")]
    for name in LOWER:
        ids = target.parts[name]
        off = np.linalg.norm((made["jawOpen"] - truth)[ids], axis=1).mean()
        out[name] = float(off / np.linalg.norm((truth - rest)[ids], axis=1).mean())
    return out


def measure(options: argparse.Namespace) -> Report:
    """Every head."""
    report = Report(NAME, TITLE)
    model = IctHeads(Path(options.shared) / "data" / "mesh")
    source, full = model.plain(), model.full()
    methods: tuple[Method, ...] = ("tents",) if options.quick else ("tents", "gradients")
    rows = []
    for target in targets(model, options.quick):
        for method in methods:
            common.say(f"{target.name}, {method}")
            rows.append(_row(source, target, method, model.names))
    own = [row for row in rows if row[1] == "tents"]
    report.tables.append(
        Table(
            "ICT's 55 shapes onto",
            ("head", "method", "furthest", "in", "lid gap, %", "blink error", "inverted", "torn", "lips"),
            rows,
        )
    )
    report.criteria += [
        Criterion(
            "furthest of any vertex, of the scaled source's", max(row[2] for row in own), "<=", MAX_FURTHEST
        ),
        Criterion("lid gap left in a blink", max(row[4] for row in own), "<=", MAX_GAP_PERCENT, "%"),
        Criterion(
            "blink error between topologies", float(np.nanmax([row[5] for row in own])), "<=", MAX_BLINK_ERROR
        ),
        Criterion(
            "inverted faces and torn edges in blinks", float(sum(row[6] + row[7] for row in own)), "<=", 0
        ),
        Criterion(
            "the same at the corners of the mouth, where the truth is known",
            float(sum(row[8] for row in own if np.isfinite(row[5]))),
            "<=",
            0,
        ),
    ]
    report.criteria.append(
        Criterion(
            "units 1e6 apart, both ways: difference, of the head",
            unit_difference(source, model),
            "<=",
            MAX_UNIT_DIFFERENCE,
        )
    )
    if not options.quick:
        _measure_parts(model, source, full, report)
    return report


def _row(
    source: FullHead, target: FullHead, method: Method, names: tuple[str, ...]
) -> tuple[str, str, float, str, float, float, int, int, int]:
    transfer = prepare_transfer(source.mesh, target.mesh, None, method)
    made = transferred(source, transfer, names)
    lids, lips = blink_figures(target, made, names), lip_flaws(target, made, names)
    return target.name, method, *furthest(source, transfer, made), *lids, lips


def _measure_parts(model: IctHeads, plain: FullHead, full: FullHead, report: Report) -> None:
    """From skin alone, and from a head with the same parts, to heads with teeth."""
    rows = []
    for how, source in (("from skin", plain), ("from a head with parts", full)):
        target = model.full(5)
        common.say(f"parts, {how}")
        made = transferred(source, prepare_transfer(source.mesh, target.mesh), model.names)
        figures = parts_figures(target, made, model.names)
        rows.append((how, *figures.values()))
        report.criteria += [
            Criterion(
                f"{how}: upper teeth in any shape", figures["upper teeth"], "<=", MAX_UPPER_TEETH_CM, "cm"
            ),
            *(
                Criterion(f"{how}: {name} in jawOpen, error", figures[name], "<=", MAX_JAW_ERROR)
                for name in LOWER
            ),
        ]
    report.tables.append(
        Table("Parts of the mouth", ("source", "upper teeth, cm", *(f"{n}, error" for n in LOWER)), rows)
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
