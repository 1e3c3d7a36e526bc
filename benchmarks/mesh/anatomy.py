"""Parts of a head move as they should: bodies in the layouts of avatars, whole mouths, lids that meet.

Avatars: a head's 34 units onto another person's body, by the layout; err of the skin of the face as
`benchmarks.mesh.transfer` has it, beside that onto the head alone, and the furthest that hair, clothes, glasses and
body move.  Full ICT heads: err over all vertices, and the worst vertex in jawOpen; "joined" has cavity, gums and tongue
in one component.  Blinks: the area between the lids that stays open, of that at rest, as seen from the front.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.mesh.avatars import LAYOUTS, STILL, Avatar, People
from benchmarks.mesh.full_heads import FullHead, IctHeads, others
from benchmarks.mesh.transfer import err
from guise.aam.similarity import Failed
from guise.analogy.anatomy import name_components, with_components
from guise.analogy.feature_points import find_feature_points
from guise.analogy.mesh import Mesh
from guise.analogy.registration import skin_mask
from guise.analogy.transfer import prepare_transfer
from guise.common.arrays import F64, Int
from guise.render.visibility import visible

NAME, TITLE = "mesh.anatomy", "Parts of heads and bodies"
PAIRS = (("p01", "p03"), ("p04", "p02"))  # source and target
MM_PER_DM, MM_PER_CM = 100.0, 10.0
MAX_BODY_RATIO, MAX_STILL_MM, MAX_FULL_ERR, MAX_GAP_PERCENT = 1.05, 0.1, 0.12, 5.0
MAX_JAW_MM, MAX_SKIN_JAW_MM = 5.0, 10.0  # of a source with a mouth, and of skin alone
BLINKS = ("eyeBlink_R", "eyeBlink_L")
EYE_PICTURE_PX, HOLE_DEPTH_WIDTHS = 300, 0.25  # two eye widths; behind the margins' middle


def named(mesh: Mesh, names: Sequence[str] | None = None) -> Mesh:
    """The mesh with the kinds of its parts."""
    points = find_feature_points(mesh)
    assert not isinstance(points, Failed), points
    return with_components(mesh, name_components(mesh, points.positions, names), points.positions)


def onto(source: Avatar, target: Avatar) -> F64:
    """The target (k, N, 3) with all shapes of the source."""
    transfer = prepare_transfer(named(source.mesh, source.names), named(target.mesh, target.names))
    return np.stack([transfer(source.mesh.vertices + way) for way in source.shapes])


def face_err(target: Avatar, made: F64) -> float:
    """Mean err of the skin of the head, centimetres."""
    skin = target.parts["head"]
    rest, shapes = 10 * target.mesh.vertices[skin], 10 * target.shapes[:, skin]
    found = [err(rest, rest + way, 10 * one[skin]) for way, one in zip(shapes, made, strict=True)]
    return float(np.nanmean(found))


def measure_avatars(people: People, report: Report, quick: bool) -> None:
    """Bodies beside heads alone."""
    rows: list[tuple[object, ...]] = []
    for first, second in PAIRS[:1] if quick else PAIRS:
        source, alone = people.head(first), people.head(second)
        own = face_err(alone, onto(source, alone))
        rows.append((f"{first} to {second}", "head alone", own, *([0.0] * len(STILL))))
        for layout in LAYOUTS:
            common.say(f"{first} to {second}, {layout}")
            body = people.body(second, layout)
            made = onto(source, body)
            way = MM_PER_DM * np.linalg.norm(made - body.mesh.vertices, axis=2).max(0)
            still = [float(way[body.parts[kind]].max()) if kind in body.parts else 0.0 for kind in STILL]
            where = people.head_rows(body, alone)
            found = face_err(alone, made[:, where])
            rows.append((f"{first} to {second}", layout, found, *still))
            report.criteria += [
                Criterion(
                    f"{second}, {layout}: err of the face, of that alone", found / own, "<=", MAX_BODY_RATIO
                ),
                Criterion(f"{second}, {layout}: what should be still", max(still), "<=", MAX_STILL_MM, "mm"),
            ]
    report.tables.append(
        Table("Avatars", ("heads", "layout", "err", *(f"{kind}, mm" for kind in STILL)), rows)
    )


def measure_full(model: IctHeads, report: Report) -> None:
    """Whole mouths, and skin alone as a source."""
    rows = []
    for what, source, target in (
        ("parts", model.full(), model.full(5)),
        ("joined", model.full(joined=True), model.full(5, joined=True)),
        ("parts from skin", model.plain(), model.full(5)),
        ("joined from skin", model.plain(), model.full(5, joined=True)),
    ):
        common.say(f"full head, {what}")
        assert source.shapes is not None
        assert target.shapes is not None
        rest = target.mesh.vertices
        transfer = prepare_transfer(source.mesh, target.mesh)
        made = [transfer(shape) for shape in source.shapes]
        each = [err(rest, truth, one) for truth, one in zip(target.shapes, made, strict=True)]
        jaw = model.names.index("jawOpen")
        off = MM_PER_CM * np.linalg.norm(made[jaw] - target.shapes[jaw], axis=1)
        inside = np.concatenate([rows for name, rows in target.parts.items() if name != "eyes"])
        rows.append((what, float(np.nanmean(each)), off[inside].mean(), off[inside].max(), off.max()))
        worst = MAX_SKIN_JAW_MM if "skin" in what else MAX_JAW_MM
        report.criteria += [
            Criterion(f"full head, {what}: err", rows[-1][1], "<=", MAX_FULL_ERR),
            Criterion(f"full head, {what}: worst in jawOpen", rows[-1][4], "<=", worst, "mm"),
        ]
    columns = ("source and target", "err", "mouth in jawOpen, mean mm", "worst mm", "worst of all mm")
    report.tables.append(Table("Full ICT heads", columns, rows))


def lid_gap(head: FullHead, made: F64, eye: int) -> float:
    """Area between the lids seen from the front where no skin near shows, of that at rest, %."""
    high, low = head.lids[eye]
    at = head.mesh.vertices[np.concatenate([high, low[::-1]])]
    middle, width = at.mean(0), float(np.ptp(at[:, 0]))
    skin = skin_mask(named(head.mesh))
    faces = head.mesh.faces[skin[head.mesh.faces].all(1)]
    scale = EYE_PICTURE_PX / (2 * width)
    outline = np.rint(((at - middle) * (scale, -scale, 1))[:, :2] + EYE_PICTURE_PX / 2).astype(np.int32)
    inside = np.zeros((EYE_PICTURE_PX, EYE_PICTURE_PX), np.uint8)
    cv2.fillPoly(inside, [outline], 1)
    before, after = (
        (_depths((vertices - middle) * scale, faces) < -HOLE_DEPTH_WIDTHS * width * scale)[inside > 0].sum()
        for vertices in (head.mesh.vertices, made)
    )
    return 100 * float(after) / float(before)


def _depths(vertices: F64, faces: Int) -> F64:
    """Heights towards the viewer (h, w) of a mesh seen from the front, in pixels; minus infinity where it is not."""
    places = vertices * (1, -1, -1) + (EYE_PICTURE_PX / 2, EYE_PICTURE_PX / 2, 0)
    near = (np.abs(vertices[:, :2]) < EYE_PICTURE_PX).all(1)
    drawn = faces[near[faces].any(1)]
    seen = visible(places, drawn, (EYE_PICTURE_PX, EYE_PICTURE_PX), "cpu")
    out = np.full(seen.triangle.shape, -np.inf)
    out[seen.covered] = seen.interpolated(vertices[:, 2:], drawn)[:, 0]
    return out


def measure_blinks(model: IctHeads, report: Report, quick: bool) -> None:
    """ICT's blinks onto other topologies."""
    rows = []
    source = model.plain()
    assert source.shapes is not None
    targets = [model.remeshed(6, 7678), *([] if quick else [model.full(8), model.remeshed(9, 37500)])]
    for target in [*targets, *others(model.folder)]:
        common.say(f"blink, {target.name}")
        transfer = prepare_transfer(source.mesh, target.mesh)
        middles = [target.mesh.vertices[high, 0].mean() for high, _ in target.lids]
        left = [float(middle) > float(np.mean(middles)) for middle in middles]
        shut = [source.shapes[model.names.index(BLINKS[side])] for side in left]
        gaps = [lid_gap(target, transfer(shape), eye) for eye, shape in enumerate(shut)]
        own = [lid_gap(source, shape, eye) for eye, shape in enumerate(shut)]
        rows.append((target.name, *gaps, max(own)))
    worst = max(max(row[1:3]) for row in rows)
    report.criteria.append(Criterion("lid gap left in a blink", worst, "<=", MAX_GAP_PERCENT, "%"))
    report.tables.append(
        Table("Blinks of ICT", ("head", "one eye, %", "the other, %", "the source's, %"), rows)
    )


def measure(options: argparse.Namespace) -> Report:
    """Everything."""
    report = Report(NAME, TITLE)
    model = IctHeads(Path(options.shared) / "data" / "mesh")
    measure_avatars(People(Path(options.shared)), report, options.quick)
    if not options.quick:
        measure_full(model, report)
    measure_blinks(model, report, options.quick)
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
