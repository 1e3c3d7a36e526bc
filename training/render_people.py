"""Renders the training pictures of the landmarker: random people who do not exist, with exact landmarks.

    python -m training.render_people --program DIR --first 0 --people 500 --per-person 36 --out PARTS

DIR holds the renderer (`train_set.py` and what it imports: CC0 assets, EGL). Its people, expressions and lights are
used as they are; this script turns the heads further, hardens some lights, bakes the ambient occlusion coarser (a
person takes three seconds instead of ten) and keeps what the training wants besides the 81 points: a foreground mask,
so that the background can be changed later, and the pictures' true depths. Pictures depend on the person's number
alone: run one process per core with different --first.

Points 17 to 26 are moved to the upper edge of the brows' hair (`brows.py`).

Each part_NNNNN.npz holds `jpeg` (bytes, concatenated) and `length`, `face81` (n, 81, 2) float32 pixels, `depth`
(n, 81) float32 decimetres behind the nearest point, `visible` (n, 81) bool, `mask` (n, size, size / 8) packed bits,
`dense` (n, 160, 2) float32 pixels of further points on the face, `pose` (n, 3) yaw, pitch, roll in degrees, `person`
(n,) and `attributes` (n, 6) with `attribute_names`.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.schemes import BROWS
from training.brows import hair_points

AO_DIRECTIONS, AO_SIZE = 40, 256
PEOPLE_PER_PART = 10
DENSE = 160


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--people", type=int, default=500)
    parser.add_argument("--per-person", type=int, default=36)
    parser.add_argument("--size", type=int, default=176)
    parser.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


def load_program(folder: Path, size: int) -> dict:
    """The renderer's modules, set to pictures of `size` pixels."""
    sys.path.insert(0, str(folder))
    sys.argv = ["train_set.py", "--size", str(size), "--out", os.devnull]  # it reads its size when imported
    import actor
    import assets
    import face81
    import human
    import looks
    import train_set

    import render

    actor._disk = lambda key, make: make()  # nobody is rendered twice
    bake = render.Renderer.bake_ao
    render.Renderer.bake_ao = lambda self, *a, **kw: bake(self, *a, **{**kw, "ndir": AO_DIRECTIONS})
    return {
        "actor": actor,
        "assets": assets,
        "face81": face81,
        "human": human,
        "looks": looks,
        "render": render,
        "train_set": train_set,
    }


def make_renderer(render):
    renderer = render.Renderer()
    renderer.AOS = AO_SIZE
    renderer.aot = renderer.ctx.depth_texture((AO_SIZE, AO_SIZE))
    renderer.aof = renderer.ctx.framebuffer([], renderer.aot)
    return renderer


def dense_vertices(p) -> np.ndarray:
    """DENSE vertices of the base mesh, spread over the front of the face, the same for everyone."""
    base = p["human"].base()
    skin = np.unique(base.f[p["human"].body_faces()])
    points = p["face81"].points(base.v)
    low, high = points.min(0), points.max(0)
    v = base.v[skin]
    inside = (v > low - 0.05).all(1) & (v[:, :2] < high[:2] + 0.05).all(1)
    skin, v = skin[inside], v[inside]
    chosen = [int(np.argmax(v[:, 2]))]
    distance = np.linalg.norm(v - v[chosen[0]], axis=1)
    while len(chosen) < DENSE:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(v - v[chosen[-1]], axis=1))
    return skin[chosen]


def harden(light: dict, rng: np.random.Generator) -> dict:
    """One picture in four in harsh light: a strong lamp from anywhere in front, little else."""
    if rng.random() < 0.25:
        direction = rng.normal(0, 1, 3) * (1, 0.7, 0.5) + (0, 0.3, 0.7)
        strength, rest = rng.uniform(1.1, 1.9), rng.uniform(0.15, 0.6)
        light["dir"] = [tuple(direction / np.linalg.norm(direction)), *light["dir"][1:]]
        light["col"] = [
            tuple(np.array(light["col"][0]) * strength),
            *(tuple(np.array(c) * rest) for c in light["col"][1:]),
        ]
        light["amb"] = [tuple(np.array(c) * rest) for c in light["amb"]]
    return light


def pictures(p, renderer, dense: np.ndarray, number: int, count: int, size: int):
    """Yields one row per picture of person `number`."""
    rng = np.random.default_rng(420_000 + number)
    program = p["train_set"]
    spec = program.random_person(number, rng)
    who = p["actor"].Actor(renderer, spec)
    attributes = [
        spec["male"],
        spec["age"],
        *(spec["race"][r] for r in program.RACES),
        float(spec["hair"] is not None),
    ]
    lift = hair_points(who.p, p["assets"].image) - p["face81"].points(who.p.base)[BROWS]
    background = renderer.texture(p["looks"].background(int(rng.integers(1, 100_000)), w=size, h=size))
    for _ in range(count):
        pose = np.clip(rng.normal(0, (25, 12, 9)), (-65, -35, -30), (65, 35, 30))
        distance, width = rng.uniform(4.8, 20), rng.uniform(0.44, 0.58) * size
        shift = rng.normal(0, 0.08, 2)
        at = (shift[0], who.face_c[1] + shift[1] + 0.15, who.face_c[2] + distance)
        camera = p["render"].Camera(width * distance / who.face_w, size, size, at)
        turn = p["human"].euler(*map(float, pose))
        truth = who.place(program.random_expression(rng), turn, None, camera)
        places = p["face81"].points(truth["verts"])
        places[BROWS] += lift @ turn.T
        points, depth = camera.project(places)
        more, _ = camera.project(truth["verts"][dense])
        image, z = renderer.frame(
            [who.g], camera, harden(program.random_light(rng), rng), background, want_depth=True
        )
        near = (z < 39).astype(np.uint8)
        mask = cv2.resize(near, (size, size), interpolation=cv2.INTER_AREA)
        jpeg = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
        yield (
            jpeg.tobytes(),
            points.astype(np.float32),
            (depth - depth.min()).astype(np.float32),
            program.visible(points, depth, z),
            np.packbits(mask, axis=1),
            more.astype(np.float32),
            pose.astype(np.float32),
            number,
            attributes,
        )
    program.release(renderer, who)


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    p = load_program(options.program, options.size)
    renderer, dense, start = make_renderer(p["render"]), dense_vertices(p), time.time()
    last = options.first + options.people
    for first in range(options.first, last, PEOPLE_PER_PART):
        path = options.out / f"part_{first:05d}.npz"
        if path.exists():
            continue
        numbers = range(first, min(first + PEOPLE_PER_PART, last))
        rows = [
            row for n in numbers for row in pictures(p, renderer, dense, n, options.per_person, options.size)
        ]
        jpeg, points, depth, visible, mask, more, pose, person, attributes = zip(*rows, strict=True)
        unfinished = path.with_suffix(".partial")
        with unfinished.open("wb") as file:
            np.savez(
                file,
                jpeg=np.frombuffer(b"".join(jpeg), np.uint8),
                length=np.array([len(b) for b in jpeg], np.int32),
                face81=np.array(points),
                depth=np.array(depth),
                visible=np.array(visible),
                mask=np.array(mask),
                dense=np.array(more),
                pose=np.array(pose),
                person=np.array(person, np.int32),
                attributes=np.array(attributes, np.float32),
                attribute_names=np.array(["male", "age", *p["train_set"].RACES, "hair"]),
            )
        unfinished.replace(path)
        print(f"{numbers[-1] + 1 - options.first} people, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
