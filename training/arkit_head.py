"""The rig that ships with Guise: a head of nobody's with ARKit's 52 shapes, eyes, teeth, tongue, brows and lashes.

    python -m training.arkit_head --program ../shared/people sample_videos/heads/arkit.glb

The head is the renderer's base (CC0, see its PROVENANCE.md) half woman and half man, of three ancestries in equal
parts, cut at the neck.  Metres, x to the person's left, y up, z forward, from the joint of the head on the neck.
Colours are sampled from the renderer's textures at the vertices; brows and lashes keep small textures.  The eyes turn
by FULL_LOOK_DEGREES.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES
from guise.analogy.formats.files import read_mesh, write_rig
from guise.common.arrays import F64, I32, U8
from training.render_people import load_program
from training.rig_pictures import extend, give_shapes

SPEC: dict[str, Any] = {
    "name": "nobody", "race": {"caucasian": 1 / 3, "african": 1 / 3, "asian": 1 / 3}, "male": 0.5, "age": 0.15,
    "shape": {}, "brows": "eyebrow001",
}  # fmt: skip
METRES = 0.1  # in a decimetre
NECK_RISE = 0.02  # of the cut above the lowest joint of the neck, decimetres
SKIN, IRIS = "young_lightskinned_female_diffuse2", "brown_eye"
FLAT = {"teeth": (0.88, 0.84, 0.76), "tongue": (0.62, 0.33, 0.33)}
CARDS = {"brows": "eyebrows/eyebrow001/eyebrow001.png", "lashes": "eyelashes/eyelashes01/eyelashes01.png"}
CARD_SIDE = 256  # pixels, of the textures of brows and lashes


@dataclass(frozen=True, eq=False)
class Part:
    """One part: vertices at rest (n, 3) and moved (52, n, 3), quads, texture coordinates (m, 2), theirs, colours."""

    name: str
    rest: F64
    moved: F64
    faces: I32
    uv: F64
    uv_faces: I32
    colours: F64


def sampled(image: U8, uv: F64) -> F64:
    """Colours (n, 4), 0 to 1, of a texture at places (n, 2)."""
    height, width = image.shape[:2]
    x, y = np.mod(uv[:, 0], 1) * (width - 1), (1 - np.mod(uv[:, 1], 1)) * (height - 1)
    soft = cv2.GaussianBlur(image, (0, 0), width / 400)
    rows = soft[y.round().astype(int), x.round().astype(int)].astype(float) / 255
    return rows if rows.shape[1] == 4 else np.column_stack([rows, np.ones(len(rows))])


def part(p: dict[str, Any], person: Any, name: str) -> Part:
    """A part of the head, in decimetres."""
    human = p["human"]
    if name == "skin":
        base = human.base()
        cut = base.v[person.joints["neck01"]].mean(0)[1] + NECK_RISE
        at = base.v[base.f]
        kept = (base.g == "body") & (at[:, :, 1] > cut).all(1) & (np.abs(at[:, :, 0]) < 1.6).all(1)
        surface = human.Surface(
            human.sp.identity(human.NB, format="csr"),
            np.zeros((human.NB, 3)),
            base.f[kept],
            base.ft[kept],
            base.vt,
        )
    else:
        surface = person.surf[name]
    rest = surface.positions(person.base)
    moved = np.stack([surface.A @ shape for shape in person.E[34:].astype(float)])
    faces, corners = surface.f, _corners(surface)
    if name == "eyes":
        moved = np.stack([_looked(human, person, rest, shape) for shape in ARKIT_NAMES])
    textures = {"skin": f"skins/textures/{SKIN}.png", "eyes": f"eyes/materials/{IRIS}.png"}
    if name in textures:
        uv = np.zeros((len(rest), 2))
        uv[faces] = surface.uv[corners]
        colours = sampled(p["assets"].image(textures[name]), uv)
        solid = colours[faces][:, :, 3].mean(1) > 0.5  # not the cornea, which is clear
        faces, corners, colours = faces[solid], corners[solid], colours[:, :3]
    else:
        colours = np.tile(FLAT.get(name, (1.0, 1.0, 1.0)), (len(rest), 1))
    return Part(name, rest, moved, faces, surface.uv, corners, colours)


def _corners(surface: Any) -> I32:
    """Texture coordinates of the corners of a surface's quads."""
    first, second = np.split(surface.tri, 2) if len(surface.tri) == 2 * len(surface.f) else (None, None)
    if first is None:
        raise ValueError("a surface with triangles among its quads")
    return np.column_stack([first, second[:, 2]])


def _looked(human: Any, person: Any, rest: F64, shape: str) -> F64:
    """How the vertices of both eyeballs move in a shape: a turn by FULL_LOOK_DEGREES in eyeLook, nothing else."""
    moved = np.zeros_like(rest)
    if not shape.startswith("eyeLook"):
        return moved
    is_left = shape.endswith("Left")
    own = person.eye_left if is_left else ~person.eye_left
    way = shape[len("eyeLook") :].removesuffix("Left").removesuffix("Right")
    outwards = 1 if is_left else -1
    yaw = {"In": -outwards, "Out": outwards}.get(way, 0) * FULL_LOOK_DEGREES
    pitch = {"Up": 1, "Down": -1}.get(way, 0) * FULL_LOOK_DEGREES
    centre = rest[own].mean(0)
    moved[own] = (rest[own] - centre) @ human.euler(yaw, pitch, 0).T + centre - rest[own]
    return moved


def write_obj(path: Path, parts: list[Part], pictures: dict[str, Path]) -> None:
    """Write all parts with colours at the vertices, texture coordinates and a material each."""
    lines, materials, first, first_uv = [f"mtllib {path.stem}.mtl"], [], 1, 1
    for one in parts:
        materials.append(f"newmtl {one.name}\nKd 1 1 1")
        if one.name in pictures:
            materials.append(f"d 0.99\nmap_Kd {pictures[one.name].name}")
        lines += [
            f"v {x:.6f} {y:.6f} {z:.6f} {r:.3f} {g:.3f} {b:.3f}"
            for (x, y, z), (r, g, b) in zip(one.rest, one.colours, strict=True)
        ]
        lines += [f"vt {u:.4f} {v:.4f}" for u, v in one.uv]
        lines += [f"g {one.name}", f"usemtl {one.name}"]
        for corners, places in zip(
            (one.faces + first).tolist(), (one.uv_faces + first_uv).tolist(), strict=True
        ):
            pairs = list(dict.fromkeys(zip(corners, places, strict=True)))
            lines.append("f " + " ".join(f"{v}/{t}" for v, t in pairs))
        first, first_uv = first + len(one.rest), first_uv + len(one.uv)
    path.write_text("\n".join(lines) + "\n")
    path.with_suffix(".mtl").write_text("\n".join(materials) + "\n")


def main() -> None:
    """Write the rig."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    p = load_program(options.program, 128)
    extend(p)
    person = p["human"].Person(SPEC)
    give_shapes(p, person)
    origin = person.J["head"]
    parts = [part(p, person, name) for name in ("skin", "eyes", "teeth", "tongue", "brows", "lashes")]
    parts = [
        Part(
            one.name,
            (one.rest - origin) * METRES,
            one.moved * METRES,
            one.faces,
            one.uv,
            one.uv_faces,
            one.colours,
        )
        for one in parts
    ]
    with tempfile.TemporaryDirectory() as folder:
        pictures = {}
        for name, source in CARDS.items():
            pictures[name] = Path(folder) / f"{name}.png"
            small = cv2.resize(
                p["assets"].image(source), (CARD_SIDE, CARD_SIDE), interpolation=cv2.INTER_AREA
            )
            small[..., :3] = (small[..., :3] * 0.35).astype(np.uint8)
            cv2.imwrite(str(pictures[name]), cv2.cvtColor(small, cv2.COLOR_RGBA2BGRA))
        obj = Path(folder) / "arkit.obj"
        write_obj(obj, parts, pictures)
        target = read_mesh(obj)
        ways = np.concatenate([one.moved for one in parts], axis=1)
        rest = np.concatenate([one.rest for one in parts])
        kept = target.cleaned.kept
        write_rig(options.output, target, ARKIT_NAMES, [(rest + way)[kept] for way in ways])


if __name__ == "__main__":
    main()
