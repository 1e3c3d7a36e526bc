"""Renders the heads that `guise deidentify --region head` draws: hair of strands, path traced, with its alpha.

    pip install bpy==5.0.1 scipy opencv-contrib-python-headless    # Python 3.11, in an environment of its own
    python -m training.render_heads --program DIR --out HEADS [--only p01 p08] [--ship]

DIR holds the renderer's people (see `render_people`).  Each strand grows from the scalp along a field that its style
gives, lies on the head, neck and shoulders, and is drawn to the strands about it.  Blender's Cycles renders the head
from the front under soft light, once with everything, once for the hair that nothing hides.  HEADS/NAME.webp holds
the two, one above the other: the colours with the head's alpha, and the share of the hair in grey; points.npz has the
landmarks.  With --ship they go to app/gallery/heads.  Decimetres, y up, the face looks along z.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from guise.aam.landmarks.schemes import CHIN, EYES, LEFT_BROW, NOSE_ROOT, NOSE_TIP, RIGHT_BROW
from training.tracing import add_light

F64 = NDArray[np.float64]
SIZE = 480  # pixels of the pictures' sides
SHIPPED = Path("app/gallery/heads")
QUALITY = 95  # of the WebP files
MARGIN = 0.1  # decimetres about what is seen, at the face
NECK = 0.35  # decimetres below the chin that are seen
DISTANCE = 9.5  # of the camera
EYES_TO_CENTRE = np.array(
    [0.0, 0.18, -0.92]
)  # from between the eyes to where directions on the scalp are seen from
POINTS = 22  # of a strand
GUIDES = 700
SEED = 59
# Place about the face, size, power and colour of the lights: soft, from the front, as heads are to bring no shadows.
LIGHTS = (
    ((-4, 5, 7), 7, 480, (1, 0.98, 0.96)),
    ((6, 2, 6), 7, 260, (0.97, 0.98, 1)),
    ((0, 8, -1), 6, 140, (1, 1, 1)),
)
WORLD = 0.42


@dataclass(frozen=True)
class Style:
    """A hairstyle: lengths on top, at the sides and at the nape (dm); how strands leave the head and where they go.

    comb : along which they lie (back, side, forward, part, out).   lift : how far they stand up at their roots.
    layer : thickness of the hair on the head.   fall : how much they hang.   part : x of the parting.
    curl : radius and turns of their windings.   clump : how far strands meet.   frizz : how far they stray.
    """

    top: float
    sides: float
    nape: float
    comb: str
    melanin: float
    redness: float
    lift: float = 0.5
    layer: float = 0.10
    fall: float = 0.0
    part: float = 0.0
    curl: tuple[float, float] = (0.0, 0.0)
    clump: float = 0.45
    frizz: float = 0.02
    count: int = 36_000
    radius: float = 0.0042
    hairline: float = 0.0  # degrees by which it is higher
    white: float = 0.0  # share of strands without colour


STYLES = {
    "p01": Style(0.62, 0.22, 0.2, "side", 0.62, 0.3, lift=0.9, layer=0.2, part=0.28, clump=0.6),
    "p02": Style(0.95, 0.7, 0.5, "out", 0.97, 0.1, lift=2.0, layer=0.9, curl=(0.035, 7), clump=0.8, frizz=0.05),
    "p03": Style(2.4, 1.7, 1.1, "part", 0.95, 0.05, lift=0.35, layer=0.12, fall=1.0, count=26_000, radius=0.005),
    "p04": Style(0.5, 0.2, 0.2, "back", 0.12, 0.1, lift=0.45, layer=0.12, hairline=7, clump=0.4, white=0.75),
    "p05": Style(0.13, 0.08, 0.06, "out", 0.97, 0.1, lift=2.0, layer=0.08, curl=(0.014, 2), clump=0.7, count=60_000),
    "p06": Style(
        2.3, 1.6, 1.1, "part", 0.55, 0.75, lift=0.5, layer=0.18, fall=0.9, part=0.22, curl=(0.05, 2.2), clump=0.6,
        frizz=0.05, count=26_000, radius=0.005,
    ),
    "p07": Style(0.5, 0.16, 0.14, "forward", 0.96, 0.05, lift=1.1, layer=0.22, clump=0.75),
    "p08": Style(2.0, 2.0, 1.2, "bun", 0.96, 0.08, lift=0.12, layer=0.06, clump=0.3),
    "p09": Style(0.75, 0.2, 0.2, "back", 0.93, 0.12, lift=1.0, layer=0.24, curl=(0.025, 1.6), clump=0.6),
}  # fmt: skip


def unit(v: F64) -> F64:
    """Vectors (n, 3) of length 1."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-9))


def directions(p: F64, centre: F64) -> tuple[F64, F64]:
    """Azimuth from the front, without sign, and elevation of places (n, 3) on the head; degrees."""
    away = p - centre
    azimuth = np.degrees(np.arctan2(np.abs(away[:, 0]), away[:, 2]))
    elevation = np.degrees(np.arctan2(away[:, 1], np.hypot(away[:, 0], away[:, 2])))
    return azimuth, elevation


def density(p: F64, centre: F64, higher: float) -> F64:
    """Share in [0, 1] of the hair that grows at places (n, 3): none on the face, ears and neck."""
    azimuth, elevation = directions(p, centre)
    azimuths = (0, 20, 38, 52, 62, 72, 78, 84, 92, 108, 116, 124, 140, 180)
    line = (23, 24, 27, 27, 17, 4, -10, -10, 7, 8, -12, -30, -38, -42)
    lowest = np.interp(azimuth, azimuths, line) + higher * (azimuth < 60)
    ear = (np.abs(p[:, 0]) > 0.775) & (p[:, 1] < centre[1] + 0.07) & (p[:, 2] < centre[2] + 0.3)
    return np.asarray(np.clip((elevation - lowest) / 5, 0, 1) * ~ear)


class Head:
    """Skin of a person: vertices (n, 3), normals, and triangles to grow from."""

    def __init__(self, places: F64, normals: F64, triangles: NDArray[np.int32], centre: F64) -> None:
        self.centre = centre
        self.places, self.normals, self.triangles = places, unit(normals), triangles
        self._near = cKDTree(places)

    def roots(self, style: Style, rng: np.random.Generator) -> tuple[F64, F64]:
        """Places (n, 3) on the scalp and normals there."""
        corners, normals = self.places[self.triangles], self.normals[self.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        share = area * density(corners.mean(1), self.centre, style.hairline)
        share[corners[:, :, 1].min(1) < self.centre[1] - 1.05] = 0
        which = rng.choice(len(share), style.count, p=share / share.sum())
        weights = rng.dirichlet((1, 1, 1), style.count)[..., None]
        places = (corners[which] * weights).sum(1)
        keep = rng.uniform(size=len(places)) < density(places, self.centre, style.hairline)
        return places[keep], unit((normals[which] * weights).sum(1))[keep]

    def height(self, p: F64) -> tuple[F64, F64]:
        """Of places (n, 3) above the skin, and the normals there."""
        nearest = self._near.query(p)[1]
        normals = self.normals[nearest]
        return ((p - self.places[nearest]) * normals).sum(1)[:, None], normals


def combed(style: Style, root: F64, p: F64, centre: F64) -> F64:
    """Directions (n, 3) in which strands lie, of roots and where they have come to."""
    x = root[:, :1] - style.part
    side = np.where(x >= 0, 1.0, -1.0)
    still = np.zeros_like(x)
    if style.comb == "back":
        return np.hstack([0.35 * np.sign(root[:, :1]) * (np.abs(root[:, :1]) > 0.5), still, still - 1])
    if style.comb == "forward":
        front = root[:, 2:] > centre[2] + 0.45
        return np.hstack([0.25 + still, np.where(front, 0.35, -0.2), 1 + still])
    if style.comb == "side":
        across = np.tanh(x / 0.12)  # strands beside the parting lie backwards
        return np.hstack(
            [
                across,
                0.15 + still,
                np.where(root[:, 2:] > centre[2] + 0.35, 0.55, -0.2) - 0.8 * (1 - np.abs(across)),
            ]
        )
    if style.comb == "part":
        return np.hstack([side, -0.25 + still, -0.25 + still])
    if style.comb == "bun":
        return unit(centre - [0.0, 0.15, 1.2] - p)
    return unit(p - centre)


def grown(head: Head, style: Style, rng: np.random.Generator) -> F64:
    """Strands (n, POINTS, 3)."""
    root, normal = head.roots(style, rng)
    azimuth, elevation = directions(root, head.centre)
    aside = np.clip((azimuth - 48) / 22, 0, 1) * np.clip((52 - elevation) / 22, 0, 1)
    low = np.clip((head.centre[1] - 0.1 - root[:, 1]) / 0.3, 0, 1) * (azimuth > 95)
    length = (style.top * (1 - aside) + style.sides * aside) * (1 - low) + style.nape * low
    # Strands at the hairline are finer and shorter; no two are as long.
    edge = np.clip(density(root, head.centre, style.hairline + 6), 0.35, 1)
    length = (length * rng.uniform(0.78, 1.06, len(root)) * (edge if style.top < 1.5 else 1))[:, None]
    layer = style.layer * rng.uniform(0.08, 1, (len(root), 1)) * np.clip(length / 0.3, 0.35, 1)
    p, v = root - 0.01 * normal, normal
    strands = [p]
    for k in range(1, POINTS):
        t = k / (POINTS - 1)
        height, n = head.height(p)
        comb = combed(style, root, p, head.centre)
        comb -= (comb * n).sum(1, keepdims=True) * n * (style.comb != "out")
        away = p[:, 1:2] < head.centre[1] + 0.15 if style.fall else np.zeros_like(height, bool)
        hang = style.fall * np.where(away, 1.6, 0.25 + 0.5 * t)
        want = unit(comb) * np.where(away, 0.12, 1.0) + style.lift * np.exp(-6 * t) * n
        want = want - np.array([0.0, 1.0, 0.0]) * hang - n * np.clip((height - layer) / 0.1, 0, 1) * (~away)
        v = unit(0.55 * v + 0.45 * unit(want))
        p = p + v * length / (POINTS - 1)
        height, n = head.height(p)
        clear = np.minimum(layer, 0.02 + 0.25 * t * length)
        p = p + n * np.maximum(clear - height, 0)
        strands.append(p)
    return dressed(np.stack(strands, 1), normal, style, rng)


def dressed(strands: F64, normal: F64, style: Style, rng: np.random.Generator) -> F64:
    """Strands with windings, drawn together, and straying."""
    count, t = len(strands), np.linspace(0, 1, POINTS)[:, None]
    guides = rng.choice(count, min(GUIDES, count), replace=False)
    _, near = cKDTree(strands[guides, 0]).query(strands[:, 0])
    mine = guides[near]
    turn, radius = style.curl[1] * 2 * np.pi, style.curl[0]
    along = unit(strands[:, -1] - strands[:, 0])
    across = unit(np.cross(along, normal + 1e-3))
    other = np.cross(along, across)
    phase = rng.uniform(0, 2 * np.pi, count)[mine][:, None] + rng.normal(0, 0.35, (count, 1))
    angle = phase[..., None] + turn * t
    grow = np.clip(3 * t, 0, 1)
    wound = strands + radius * grow * (np.cos(angle) * across[:, None] + np.sin(angle) * other[:, None])
    together = style.clump * t**1.3 * rng.uniform(0.4, 1, (count, 1, 1))
    met = wound + together * (wound[mine] - wound)
    stray = rng.normal(0, 1, (count, 3, 3)) * style.frizz
    waves = [np.sin(np.pi * (k + 1) * t * 0.8) for k in range(3)]
    return np.asarray(met + t * sum(wave * stray[:, None, k] for k, wave in enumerate(waves)))


def hair(strands: F64, style: Style, rng: np.random.Generator) -> None:
    """The strands in Blender's scene."""
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves([POINTS] * len(strands))
    curves.attributes["position"].data.foreach_set("vector", strands.astype(np.float32).ravel())
    thick = style.radius * np.linspace(1, 0.25, POINTS) * rng.uniform(0.7, 1.25, (len(strands), 1))
    curves.points.foreach_set("radius", thick.astype(np.float32).ravel())
    look = bpy.data.materials.new("hair")
    look.use_nodes = True
    nodes, links = look.node_tree.nodes, look.node_tree.links
    fibre, mix, plain = (
        nodes.new(f"ShaderNode{kind}") for kind in ("BsdfHairPrincipled", "MixShader", "BsdfHairPrincipled")
    )
    info, less = nodes.new("ShaderNodeHairInfo"), nodes.new("ShaderNodeMath")
    for one, melanin in ((fibre, style.melanin), (plain, 0.02)):
        one.parametrization, one.model = "MELANIN", "CHIANG"
        one.inputs["Melanin"].default_value = melanin
        one.inputs["Melanin Redness"].default_value = style.redness
        one.inputs["Random Color"].default_value = 0.35
        one.inputs["Roughness"].default_value, one.inputs["Radial Roughness"].default_value = 0.32, 0.45
        one.inputs["Random Roughness"].default_value = 0.3
    less.operation, less.inputs[1].default_value = "LESS_THAN", style.white
    links.new(info.outputs["Random"], less.inputs[0])
    links.new(less.outputs[0], mix.inputs[0])
    links.new(fibre.outputs[0], mix.inputs[1])
    links.new(plain.outputs[0], mix.inputs[2])
    links.new(mix.outputs[0], nodes["Material Output"].inputs["Surface"])
    curves.materials.append(look)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("hair", curves))


def stage(size: int, samples: int, middle: F64, view: float) -> None:
    """Camera, lights and settings."""
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", samples, True
    scene.cycles.max_bounces, scene.cycles.transparent_max_bounces = 5, 12
    scene.cycles_curves.shape = "RIBBONS"
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.data.angle = (
        middle + np.array([0, 0, DISTANCE]),
        2 * np.arctan(0.5 * view / DISTANCE),
    )
    scene.collection.objects.link(camera)
    scene.camera = camera
    add_light(middle, LIGHTS, WORLD)


def picture(path: Path) -> NDArray[Any]:
    """What is rendered (h, w, 4), RGBA uint8."""
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return cv2.cvtColor(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), cv2.COLOR_BGRA2RGBA)


def render(program: dict[str, Any], spec: dict[str, Any], out: Path, size: int, samples: int) -> F64:
    """One head, into OUT/NAME.png and OUT/NAME.hair.png; its landmarks (81, 2), pixels."""
    style, rng = STYLES[spec["name"]], np.random.default_rng(SEED + spec["seed"])
    human, bare = program["human"], {**spec, "hair": None, "clothes": None}
    person, weights = human.Person(bare), np.zeros(len(human.WEIGHT_NAMES))
    surfaces = person.surfaces(weights, human.euler(0, 0, 0))[0]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    look = program["path_traced"].materials(bare)
    for name, surface in person.surf.items():
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(surfaces[name][0][surface.vmap].tolist(), [], surface.tri.tolist())
        mesh.uv_layers.new(name="uv").data.foreach_set("uv", surface.uv[surface.tri.ravel()].ravel())
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
        mesh.materials.append(look[name])
        mesh.normals_split_custom_set_from_vertices(surfaces[name][1][surface.vmap].tolist())
        scene.collection.objects.link(bpy.data.objects.new(name, mesh))
    points = program["face81"].points(person.base)
    eyes, body = points[list(EYES)].mean(0), person.surf["body"]
    places, normals = (part[body.vmap] for part in surfaces["body"])
    strands = grown(Head(places, normals, body.tri, eyes + EYES_TO_CENTRE), style, rng)
    hair(strands, style, rng)
    seen = np.concatenate([strands.reshape(-1, 3)[::7], points, points[CHIN, None] - (0, NECK, 0)])[:, :2]
    low, high = np.percentile(seen, 0.02, axis=0) - MARGIN, np.percentile(seen, 99.98, axis=0) + MARGIN
    low[1] = min(low[1], points[CHIN][1] - NECK)
    middle, view = np.array([*(low + high) / 2, points[NOSE_TIP][2]]), float((high - low).max())
    stage(size, samples, middle, view)
    cv2.imwrite(str(out / f"{spec['name']}.png"), cv2.cvtColor(picture(out / "raw.png"), cv2.COLOR_RGBA2BGRA))
    for thing in scene.objects:
        thing.is_holdout = thing.type == "MESH"
    scene.cycles.use_denoising, scene.cycles.max_bounces = False, 0
    cv2.imwrite(str(out / f"{spec['name']}.hair.png"), picture(out / "raw.png")[..., 3])
    depth = DISTANCE - (points[:, 2] - middle[2])
    flat = (points[:, :2] - middle[:2]) * [1, -1] * (DISTANCE / depth)[:, None]
    return np.asarray(flat * size / view + (size - 1) / 2)


def browless(colours: NDArray[Any], hair_share: NDArray[Any], points: F64) -> NDArray[Any]:
    """A picture (h, w, 3) without brows, which the face that is drawn within the head brings along."""
    brows = np.zeros(hair_share.shape, np.uint8)
    width = np.ptp(points[:, 0])
    for line in (points[list(RIGHT_BROW)], points[list(LEFT_BROW)]):
        outer = line[np.abs(line[:, 0] - points[NOSE_ROOT][0]).argmax()]
        line = np.vstack([line, outer + 0.6 * (outer - line.mean(0))])
        cv2.polylines(
            brows, [line[np.argsort(line[:, 0])].round().astype(np.int32)], False, 255, int(0.09 * width)
        )
    brows[hair_share > 8] = 0
    return cv2.inpaint(np.ascontiguousarray(colours), brows, 0.04 * width, cv2.INPAINT_TELEA)


def keep(out: Path, name: str, points: F64) -> None:
    """Write OUT/NAME.webp from what was rendered, and add its landmarks (81, 2) to OUT/points.npz."""
    colours, share = (
        cv2.imread(str(out / f"{name}{kind}.png"), cv2.IMREAD_UNCHANGED) for kind in ("", ".hair")
    )
    grey = np.dstack([share] * 3 + [np.full_like(share, 255)])
    colours[..., :3] = browless(colours[..., :3], share, points)
    cv2.imwrite(str(out / f"{name}.webp"), np.vstack([colours, grey]), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])
    known = dict(np.load(out / "points.npz")) if (out / "points.npz").exists() else {}
    np.savez_compressed(out / "points.npz", **{**known, name: points.astype(np.float32)})


def main() -> None:
    """Render those that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--program", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=list(STYLES))
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--samples", type=int, default=12)
    parser.add_argument("--ship", action="store_true")
    given = parser.parse_args()
    sys.path.insert(0, str(given.program))
    import face81
    import human
    import path_traced
    from people import PEOPLE

    from training.gallery_people import gallery_people

    program = {"human": human, "face81": face81, "path_traced": path_traced}
    given.out.mkdir(parents=True, exist_ok=True)
    for spec in gallery_people(PEOPLE):
        if spec["name"] in given.only:
            keep(given.out, spec["name"], render(program, spec, given.out, given.size, given.samples))
    if given.ship:
        SHIPPED.mkdir(exist_ok=True)
        for path in (*given.out.glob("*.webp"), given.out / "points.npz"):
            shutil.copy(path, SHIPPED)


if __name__ == "__main__":
    main()
