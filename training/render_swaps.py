"""Renders what placement is learned from: a head in some light, the same frame with another's face, and that other.

    python -m training.render_swaps --program DIR --first 0 --count 100 --out PARTS

DIR holds the renderer (`make_swap_truth.py` and what it imports). A group is four random people who do not exist,
drawn as for `render_people.py`. Every one of them is rendered in scenes of their own (hard, warm and coloured lights,
turned up to 45 degrees); in each scene again with the face of each of the others, in the skin tone of the head; and
as a donor, near the front in a mild light, with the scenes' expressions, without hair, as the mask of a model leaves it
out, and with it, as the landmarker sees them. Groups depend only on their number.

Each group_NNNNN.npz holds pictures as JPEG in `jpeg` (bytes, concatenated) and `length`, in the order donors without
hair (4, k), scenes (4, k), truths (4, 4, k) by head and donor without those of a head with its own face, donors with
hair (4, k); their points `face81` (pictures, 81, 2) float32 pixels, points 17 to 26 on the brows' hair; `hair` (4, k,
size, size / 8) packed bits, what the hair of the head covers; and `people`, `scenes`. The first scene is without
expression.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.schemes import BROWS
from training import render_people
from training.brows import hair_points
from training.parsing_labels import HAIR, Labeller
from training.render_people import load_program, make_renderer, random_expression, random_person

PEOPLE_PER_GROUP, SCENES_PER_PERSON = 4, 12
SEED = 930_000
AO_DIRECTIONS = 24
TEXTURE_TEXELS = 1024  # side; a picture is far smaller
FACE_SHARE = 0.6  # of the picture's width
HARD_SHARE, COLOURED_SHARE = 0.35, 0.35  # of the scenes' lights
HAIRLESS_SHARE = 0.4


@dataclass(frozen=True, eq=False)
class Setup:
    """What all pictures share: the program's modules, with `swap` for the truths; renderer, labeller, pixels."""

    program: dict
    renderer: object
    labeller: Labeller
    size: int


class Cast:
    """One person: actor, specification, and how far the brows' hair lies from the mesh's points."""

    def __init__(self, setup: Setup, number: int, rng: np.random.Generator) -> None:
        p = setup.program
        spec = random_person(p, number, rng)
        if rng.random() < HAIRLESS_SHARE:
            spec["hair"] = None
        spec["clothes"] = None  # so that all bodies have the same vertices
        self.actor = p["actor"].Actor(setup.renderer, spec)
        self.lift = brow_lift(p, self.actor)


def brow_lift(p: dict, actor) -> np.ndarray:
    """Displacement (10, 3) of the brows' points to the upper edge of their hair, at rest."""
    return hair_points(actor.p, p["assets"].image) - p["face81"].points(actor.p.base)[BROWS]


@dataclass(frozen=True, eq=False)
class Scene:
    """Expression, rotation of the neck, camera and light of a picture."""

    weights: np.ndarray
    neck: np.ndarray
    camera: object
    light: dict


def random_scene(setup: Setup, actor, weights: np.ndarray, rng: np.random.Generator) -> Scene:
    """A head anywhere up to 45 degrees in any light."""
    yaw = rng.normal(0, 10) if rng.random() < 0.55 else rng.uniform(-45, 45)
    pose = np.clip([yaw, rng.normal(0, 8), rng.normal(0, 6)], (-45, -22, -20), (45, 22, 20))
    return scene_at(setup, actor, weights, pose, scene_light(setup.program, rng), rng)


def donor_scene(setup: Setup, actor, weights: np.ndarray, light: dict, rng: np.random.Generator) -> Scene:
    """A donor while enrolling: near the front."""
    return scene_at(setup, actor, weights, rng.normal(0, (6, 4, 3)), light, rng)


def scene_at(setup: Setup, actor, weights, pose, light, rng) -> Scene:
    size, distance = setup.size, rng.uniform(5.5, 16)
    width = FACE_SHARE * size * rng.uniform(0.95, 1.05)
    neck = setup.program["human"].euler(*map(float, pose))
    skull = actor.p.pose(weights, neck)[1]
    middle = skull[:3, :3] @ actor.face_c + skull[:3, 3]
    shift = rng.normal(0, 0.05, 2)
    at = (middle[0] + shift[0], middle[1] + shift[1] + 0.15, middle[2] + distance)
    camera = setup.program["render"].Camera(width * distance / actor.face_w, size, size, at)
    return Scene(weights, neck, camera, light)


def scene_light(p: dict, rng: np.random.Generator) -> dict:
    """A random light: soft, or a strong lamp from anywhere in front or beside, with little else; some coloured."""
    light = p["train_set"].random_light(rng)
    if rng.random() < HARD_SHARE:
        across = rng.choice((-1, 1)) * rng.uniform(0.3, 1.2)
        direction = np.array([across, rng.uniform(-0.1, 0.9), rng.uniform(0.0, 0.8)])
        strength, rest = rng.uniform(1.1, 2.0), rng.uniform(0.1, 0.6)
        light["dir"] = [tuple(direction / np.linalg.norm(direction)), *light["dir"][1:]]
        light["col"] = [
            tuple(np.array(light["col"][0]) * strength),
            *(tuple(np.array(c) * rest) for c in light["col"][1:]),
        ]
        light["amb"] = [tuple(np.array(c) * rest) for c in light["amb"]]
        light["soft"] = float(rng.uniform(0.006, 0.03))
    if rng.random() < COLOURED_SHARE:
        spread = rng.uniform(0.1, 0.45)
        common, own = np.exp(rng.normal(0, spread, 3)), rng.uniform(0, 0.7)
        light["col"] = [
            tuple(np.array(c) * common * np.exp(rng.normal(0, own * spread, 3))) for c in light["col"]
        ]
        light["amb"] = [tuple(np.array(c) * common**0.7) for c in light["amb"]]
    return light


def mild_light(p: dict, rng: np.random.Generator) -> dict:
    """A light as people choose it for a picture of themselves."""
    lights = p["looks"].LIGHTS
    names = sorted(lights)
    light = p["looks"].vary_light(lights[names[int(rng.integers(len(names)))]], rng, 0.15)
    tint = 1 + rng.normal(0, 0.05, 3)
    light["col"] = [tuple(np.array(c) * tint) for c in light["col"]]
    light["exposure"] *= rng.uniform(0.8, 1.15)
    return light


def draw(setup: Setup, actor, lift: np.ndarray, scene: Scene, background, shadow_centre=None, bald=False):
    """A picture (size, size, 3) RGB and its points (81, 2), with or without hair."""
    p = setup.program
    truth = actor.place(scene.weights, scene.neck, None, scene.camera)
    skull = actor.p.pose(scene.weights, scene.neck)[1]
    places = p["face81"].points(truth["verts"])
    places[BROWS] += lift @ skull[:3, :3].T
    light = dict(scene.light)
    if shadow_centre is not None:
        light["shadow_center"] = shadow_centre
    hair = actor.g.b.pop("hair", None) if bald else None
    image = setup.renderer.frame([actor.g], scene.camera, light, background)
    if hair is not None:
        actor.g.b["hair"] = hair
    return image, scene.camera.project(places)[0].astype(np.float32)


def group(setup: Setup, number: int) -> dict:
    """The columns of one group's file."""
    rng = np.random.default_rng(SEED + number)
    first = 1_000_000 + number * PEOPLE_PER_GROUP
    cast = [Cast(setup, first + i, rng) for i in range(PEOPLE_PER_GROUP)]
    p, renderer, k = setup.program, setup.renderer, SCENES_PER_PERSON
    weights = np.array([random_expression(p, rng) for _ in range(k)])
    weights[0] = 0
    backgrounds = [
        renderer.texture(p["looks"].background(int(rng.integers(1, 100_000)), w=setup.size, h=setup.size))
        for _ in range(2)
    ]
    pictures, points = [], []

    def add(found) -> None:
        pictures.append(
            cv2.imencode(".jpg", found[0][..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 96])[1].tobytes()
        )
        points.append(found[1])

    with_hair = []
    for one in cast:
        for without, found in donor_pictures(setup, one, weights, backgrounds[0], rng):
            add(without)
            with_hair.append(found)
    scenes = [[random_scene(setup, one.actor, w, rng) for w in weights] for one in cast]
    truths, hair = {}, np.zeros((len(cast), k, setup.size, -(-setup.size // 8)), np.uint8)
    heads = []
    for a, head in enumerate(cast):
        for b, donor in enumerate(cast):
            if a != b:
                truths[a, b] = hybrid_pictures(setup, head, donor, scenes[a], backgrounds)
        heads.append(own_pictures(setup, head, scenes[a], backgrounds, hair[a]))
    for row in heads:
        for found in row:
            add(found)
    for a in range(len(cast)):
        for b in range(len(cast)):
            for found in truths.get((a, b), []):
                add(found)
    for found in with_hair:
        add(found)
    release(setup, cast)
    return {
        "jpeg": np.frombuffer(b"".join(pictures), np.uint8),
        "length": np.array([len(b) for b in pictures], np.int32),
        "face81": np.array(points, np.float32),
        "hair": hair,
        "people": np.int32(len(cast)),
        "scenes": np.int32(k),
    }


def donor_pictures(
    setup: Setup, donor: Cast, weights: np.ndarray, background, rng: np.random.Generator
) -> list:
    """A donor with each expression, without and with hair."""
    light = mild_light(setup.program, rng)
    scenes = [donor_scene(setup, donor.actor, w, light, rng) for w in weights]
    return [
        [draw(setup, donor.actor, donor.lift, scene, background, bald=bald) for bald in (True, False)]
        for scene in scenes
    ]


def own_pictures(setup: Setup, head: Cast, scenes: list[Scene], backgrounds, hair: np.ndarray) -> list:
    """The head itself in its scenes, whose skin must have been baked by a hybrid; fills in the hair's bits."""
    found = []
    for k, scene in enumerate(scenes):
        found.append(draw(setup, head.actor, head.lift, scene, backgrounds[k % len(backgrounds)]))
        if "hair" in head.actor.g.b:
            labels = (setup.labeller.labels([head.actor.g], scene.camera) == HAIR).astype(np.float32)
            share = cv2.resize(labels, (setup.size, setup.size), interpolation=cv2.INTER_AREA)
            hair[k] = np.packbits(share > 0.25, axis=1)
    return found


def hybrid_pictures(setup: Setup, head: Cast, donor: Cast, scenes: list[Scene], backgrounds) -> list:
    """The head with the donor's face, in its scenes."""
    renderer = setup.renderer
    before = set(renderer._tex)
    hybrid = make_hybrid(setup.program, renderer, head.actor, donor.actor)
    lift = brow_lift(setup.program, hybrid)
    found = []
    for k, scene in enumerate(scenes):
        head.actor.place(scene.weights, scene.neck, None, scene.camera)
        centre = head.actor.g.pos["body"].mean(0)
        found.append(draw(setup, hybrid, lift, scene, backgrounds[k % len(backgrounds)], centre))
    render_people.release([hybrid.g])
    own = {id(m[t]) for m in head.actor.mats.values() for t in ("tex", "aux") if t in m}
    for key in set(renderer._tex) - before - own:
        renderer._tex.pop(key)[0].release()
    return found


def make_hybrid(p: dict, renderer, head, donor):
    """The head with the donor's face, with the ambient occlusion of both instead of its own."""
    known = {**donor.ao, **{name: value for name, value in head.ao.items() if name.startswith("hair")}}
    baked, p["actor"]._disk = (
        p["actor"]._disk,
        lambda key, make: known if key.startswith("ao") else {"t": np.zeros((1, 3), np.int32)},
    )
    try:
        return p["swap"].Hybrid(renderer, head, donor)
    finally:
        p["actor"]._disk = baked


def release(setup: Setup, cast: list[Cast]) -> None:
    """Free the GPU's memory."""
    for one in cast:
        render_people.release([one.actor.g])
        for part in one.actor.g.b.values():
            if "label" in part:
                part["label"].release()
    for texture, _ in setup.renderer._tex.values():
        texture.release()
    setup.renderer._tex.clear()


def load(folder: Path, size: int) -> Setup:
    """The renderer's modules, with small textures and coarse ambient occlusion."""
    p = load_program(folder, size, AO_DIRECTIONS)
    import make_swap_truth

    looks, maps = p["looks"], p["looks"].skin_maps
    small = (TEXTURE_TEXELS, TEXTURE_TEXELS)
    looks.skin_maps = lambda *a: tuple(cv2.resize(m, small, interpolation=cv2.INTER_AREA) for m in maps(*a))
    make_swap_truth.TEX = TEXTURE_TEXELS
    p["swap"] = make_swap_truth
    renderer = make_renderer(p["render"])
    return Setup(p, renderer, Labeller(renderer, render_people.regions(p)), size)


def render_files(
    prefix: str, make: Callable[[Setup, int], dict], description: str, count: int, size: int
) -> None:
    """A command that writes what is made of each number into a file of its own, unless it is there.

    count, size : by default, of numbers and of the pictures' sides in pixels.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--size", type=int, default=size)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    setup, start = load(options.program, options.size), time.time()
    for number in range(options.first, options.first + options.count):
        path = options.out / f"{prefix}_{number:05d}.npz"
        if path.exists():
            continue
        unfinished = path.with_suffix(".partial")
        with unfinished.open("wb") as file:
            np.savez(file, **make(setup, number))
        unfinished.replace(path)
        print(f"{number + 1 - options.first} of {options.count}, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    render_files("group", group, __doc__.splitlines()[0], count=100, size=144)
