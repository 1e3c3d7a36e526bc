"""Renders the training pictures: random people who do not exist, with exact landmarks, irises and parsing labels.

    python -m training.render_people --program DIR --first 0 --people 500 --per-person 30 --out PARTS

DIR holds the renderer (`train_set.py` and what it imports: CC0 assets, EGL). Its people, expressions and lights are
drawn from; this script turns the heads up to 75 degrees, raises and lowers brows and presses and widens lips more,
hardens and colours some lights, gives some men beards and some people glasses (`props.py`), holds a hand before some
faces (`hands.py`), and bakes the ambient occlusion coarser (a person takes three seconds instead of ten). Pictures
depend only on the person's number and --hands: run one process per core with different --first.

Points 17 to 26 are moved to the upper edge of the brows' hair (`brows.py`).

Each part_NNNNN.npz holds `jpeg` (bytes, concatenated) and `length`, `face81` (n, 81, 2) float32 pixels, `depth`
(n, 81) float32 decimetres behind the nearest point, `visible` (n, 81) bool, `mask` (n, size, size / 8) packed bits,
`dense` (n, 160, 2) float32 pixels of further points on the face, `pose` (n, 3) yaw, pitch, roll in degrees, `person`
(n,), `attributes` (n, k) with `attribute_names`, `labels` (PNG bytes, concatenated) and `labels_length` of the parsing
labels (`parsing_labels.py`; 1.5 times the picture's size), `iris` (n, 2, 3) float32 centre and radius in pixels, the
person's right eye first, `expression` (n, units) float16 with `expression_names`, gaze in degrees last.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks.schemes import BROWS
from training import parsing_labels
from training.brows import hair_points
from training.hands import HandBeforeFace
from training.parsing_labels import Labeller
from training.props import STYLES, Beard, Glasses, cast_only

AO_DIRECTIONS, AO_SIZE = 40, 256
PEOPLE_PER_PART = 10
DENSE_POINTS = 160  # further points on the face
SEED = 610_000
FACE_SHARE = (0.44, 0.58)  # of a picture's side, the least and the largest width of the face
HANDS_SHARE = 0.3  # of the pictures with the person's hand before the face
MAX_NECK_YAW_DEGREES = 40  # beyond which the shoulders turn as well
IRIS_RADIUS_DECIMETRES = 0.054  # of the limbus
IRIS_DEPTH_DECIMETRES = 0.066  # how far the limbus lies in front of the eye's centre


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--people", type=int, default=500)
    parser.add_argument("--per-person", type=int, default=30)
    parser.add_argument("--size", type=int, default=176)
    parser.add_argument(
        "--face-share", type=float, nargs=2, default=FACE_SHARE, help="of a picture's side, the face's width"
    )
    parser.add_argument(
        "--hands", type=float, default=HANDS_SHARE, help="share of pictures with a hand in front"
    )
    parser.add_argument("--out", type=Path, required=True)
    return parser.parse_args()


def load_program(folder: Path, size: int, ao_directions: int = AO_DIRECTIONS) -> dict:
    """The renderer's modules, set to pictures of `size` pixels and that many directions of ambient occlusion."""
    sys.path.insert(0, str(folder))
    sys.argv = ["train_set.py", "--size", str(size), "--out", os.devnull]  # it reads its size when imported
    import actor
    import assets
    import face81
    import human
    import landmarks
    import looks
    import train_set

    import render

    actor._disk = lambda key, make: make()  # no person is rendered twice
    bake = render.Renderer.bake_ao
    render.Renderer.bake_ao = lambda self, *a, **kw: bake(self, *a, **{**kw, "ndir": ao_directions})
    return {
        "actor": actor,
        "assets": assets,
        "face81": face81,
        "human": human,
        "landmarks": landmarks,
        "looks": looks,
        "render": render,
        "train_set": train_set,
    }


def make_renderer(render):
    renderer = render.Renderer()
    renderer.AOS = AO_SIZE
    renderer.aot = renderer.ctx.depth_texture((AO_SIZE, AO_SIZE))
    renderer.aof = renderer.ctx.framebuffer([], renderer.aot)
    cast_only(renderer)
    return renderer


def dense_vertices(p) -> np.ndarray:
    """DENSE_POINTS vertices of the base mesh, spread over the front of the face, the same for everyone."""
    base = p["human"].base()
    skin = np.unique(base.f[p["human"].body_faces()])
    points = p["face81"].points(base.v)
    low, high = points.min(0), points.max(0)
    v = base.v[skin]
    inside = (v > low - 0.05).all(1) & (v[:, :2] < high[:2] + 0.05).all(1)
    skin, v = skin[inside], v[inside]
    chosen = [int(np.argmax(v[:, 2]))]
    distance = np.linalg.norm(v - v[chosen[0]], axis=1)
    while len(chosen) < DENSE_POINTS:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(v - v[chosen[-1]], axis=1))
    return skin[chosen]


def harden(light: dict, rng: np.random.Generator) -> dict:
    """One picture in four in harsh light, a strong lamp from anywhere in front; one in five in coloured light."""
    if rng.random() < 0.25:
        direction = rng.normal(0, 1, 3) * (1, 0.7, 0.5) + (0, 0.3, 0.7)
        strength, rest = rng.uniform(1.1, 1.9), rng.uniform(0.15, 0.6)
        light["dir"] = [tuple(direction / np.linalg.norm(direction)), *light["dir"][1:]]
        light["col"] = [
            tuple(np.array(light["col"][0]) * strength),
            *(tuple(np.array(c) * rest) for c in light["col"][1:]),
        ]
        light["amb"] = [tuple(np.array(c) * rest) for c in light["amb"]]
    if rng.random() < 0.2:
        tints = np.exp(rng.normal(0, 0.35, (len(light["col"]), 3)))
        light["col"] = [tuple(np.array(c) * t) for c, t in zip(light["col"], tints, strict=True)]
    return light


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """Yaw, pitch, roll in degrees: near the front, or anywhere up to profile."""
    yaw = rng.normal(0, 22) if rng.random() < 0.6 else rng.uniform(-75, 75)
    return np.clip([yaw, rng.normal(0, 13), rng.normal(0, 9)], (-75, -38, -30), (75, 38, 30))


_BROWS_UP = ("up", "extern-up", "inner-up")


def random_expression(p, rng: np.random.Generator) -> np.ndarray:
    """The program's random expression, two in five with extreme brows or lips, one in four with a far gaze."""
    w, at = p["train_set"].random_expression(rng), p["human"].UIX
    if rng.random() < 0.2:  # raised or lowered brows, sometimes one alone
        sides = ("left", "right") if rng.random() < 0.75 else (("left", "right")[int(rng.integers(2))],)
        raised = rng.random() < 0.65
        for side in sides:
            w[at[f"eyebrows-{side}-down"]] = 0 if raised else rng.uniform(0.7, 1.25)
            for move, most in zip(_BROWS_UP, (1.3, 0.8, 0.7), strict=True):
                w[at[f"eyebrows-{side}-{move}"]] = rng.uniform(0.3, 1) * most if raised else 0
    if rng.random() < 0.25:
        kind = int(rng.integers(4))
        mouth = [n for n in at if n.startswith("mouth")]
        w[[at[n] for n in mouth]] = 0
        if kind == 0:  # pressed
            w[at["mouth-compression"]], w[at["mouth-elevation"]] = rng.uniform(0.6, 1.1), rng.uniform(0, 0.4)
        elif kind == 1:  # wide
            w[at["mouth-retraction"]], w[at["mouth-parling"]] = rng.uniform(0.6, 1.1), rng.uniform(0, 0.9)
            w[at["mouth-open"]] = rng.uniform(0, 0.25)
        elif kind == 2:  # broad smile
            w[at["mouth-corner-puller"]], w[at["mouth-retraction"]] = (
                rng.uniform(0.7, 1.1),
                rng.uniform(0, 0.6),
            )
            w[at["mouth-parling"]], w[at["mouth-open"]] = rng.uniform(0, 0.9), rng.uniform(0, 0.3)
        else:  # wide open
            w[at["mouth-open"]], w[at["mouth-parling"]] = rng.uniform(0.6, 1.15), rng.uniform(0, 0.4)
    if rng.random() < 0.25:
        w[-2:] = rng.uniform(-28, 28), rng.uniform(-18, 18)
    return w


def random_person(p, number: int, rng: np.random.Generator) -> dict:
    """The program's random person, with any of its hair and brows, and painted lips for some."""
    spec, assets = p["train_set"].random_person(number, rng), p["assets"].ROOT / "asset"
    if rng.random() < 0.5:
        hair = sorted({f.parent.name for f in (assets / "hair").glob("*/*.obj")})
        spec["hair"] = hair[int(rng.integers(len(hair)))]
    if rng.random() < 0.5:
        brows = sorted({f.parent.name for f in (assets / "eyebrows").glob("*/*.obj")})
        spec["brows"] = brows[int(rng.integers(len(brows)))]
    if spec["male"] < 0.5 and rng.random() < 0.5:
        spec["lipcol"] = (1.0, float(rng.uniform(0.25, 0.9)), float(rng.uniform(0.3, 0.9)))
    return spec


def irises(who, gaze: np.ndarray, skull: np.ndarray, euler, camera) -> np.ndarray:
    """Centre and radius of the irises (2, 3) in pixels, the person's right eye first, seen or not.

    gaze : yaw and pitch in degrees; skull : (4, 4) that carries the head at rest to its pose.
    """
    at_rest = who.p.surf["eyes"].positions(who.p.base)
    look = euler(*map(float, gaze), 0) @ (0, 0, IRIS_DEPTH_DECIMETRES)
    centres = np.array([at_rest[side].mean(0) + look for side in (~who.p.eye_left, who.p.eye_left)])
    places, depth = camera.project(centres @ skull[:3, :3].T + skull[:3, 3])
    return np.column_stack([places, camera.f * IRIS_RADIUS_DECIMETRES / depth])


@dataclass(frozen=True, eq=False)
class Setup:
    """What all pictures share: the program's modules, renderer, labeller, dense vertices, side in pixels, shares."""

    program: dict
    renderer: object
    labeller: Labeller
    dense: np.ndarray
    size: int
    hands: float
    face_share: tuple[float, float] = FACE_SHARE


class Person:
    """One person and what they wear, in front of the camera; all randomness comes from the person's number."""

    def __init__(self, setup: Setup, number: int) -> None:
        p, renderer = setup.program, setup.renderer
        self.setup, self.number, self.rng = setup, number, np.random.default_rng(SEED + number)
        self.spec = random_person(p, number, self.rng)
        self.who = p["actor"].Actor(renderer, self.spec)
        self.beard = random_beard(p, renderer, self.who, self.rng)
        self.glasses = random_glasses(p, renderer, self.who, self.rng)
        self.hand_rng = np.random.default_rng([SEED, number])  # its own: the rest is the same without hands
        self.hand = HandBeforeFace.of(p, renderer, self.who, self.hand_rng)
        self.lift = hair_points(self.who.p, p["assets"].image) - p["face81"].points(self.who.p.base)[BROWS]
        seed = int(self.rng.integers(1, 100_000))
        self.background = renderer.texture(p["looks"].background(seed, w=setup.size, h=setup.size))

    def picture(self) -> dict:
        """One row of a part."""
        p, rng, who = self.setup.program, self.rng, self.who
        pose, weights = random_pose(rng), random_expression(p, rng)
        neck, sway = self._turn(pose)
        skull = who.p.pose(weights, neck, sway)[1]
        camera = self._camera(skull)
        truth = who.place(weights, neck, sway, camera)
        places = p["face81"].points(truth["verts"])
        places[BROWS] += self.lift @ skull[:3, :3].T
        points, depth = camera.project(places)
        worn, attributes = self._worn(skull, camera)
        actors = [who.g, *(actor for prop in worn for actor in prop.actors)]
        held = self.hand_rng.random() < self.setup.hands
        if held:
            self.hand.place(self.hand_rng, places, camera)
            actors.append(self.hand.actor)
        light = harden(p["train_set"].random_light(rng), rng)
        image, z = self.setup.renderer.frame(actors, camera, light, self.background, want_depth=True)
        return {
            "jpeg": _jpeg(image),
            "labels": parsing_labels.encode(self.setup.labeller.labels(actors, camera)),
            "face81": points.astype(np.float32),
            "depth": (depth - depth.min()).astype(np.float32),
            "visible": p["train_set"].visible(points, depth, z),
            "mask": self._mask(z),
            "dense": camera.project(truth["verts"][self.setup.dense])[0].astype(np.float32),
            "iris": irises(who, weights[-2:], skull, p["human"].euler, camera).astype(np.float32),
            "pose": pose.astype(np.float32),
            "expression": weights.astype(np.float16),
            "person": np.int32(self.number),
            "attributes": np.array([*attributes, float(held)], np.float32),
        }

    def _turn(self, pose: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Rotation of the neck, and rotation and translation of the torso, which turns when the neck cannot."""
        euler, centre = self.setup.program["human"].euler, self.who.face_c
        shoulders = np.sign(pose[0]) * max(0.0, abs(pose[0]) - MAX_NECK_YAW_DEGREES)
        torso = euler(float(shoulders), 0, 0)
        return torso.T @ euler(*map(float, pose)), (torso, centre - torso @ centre)

    def _camera(self, skull: np.ndarray):
        rng, size, who = self.rng, self.setup.size, self.who
        distance, width = rng.uniform(4.8, 20), rng.uniform(*self.setup.face_share) * size
        middle = skull[:3, :3] @ who.face_c + skull[:3, 3]
        shift = rng.normal(0, 0.08, 2)
        at = (middle[0] + shift[0], middle[1] + shift[1] + 0.15, middle[2] + distance)
        return self.setup.program["render"].Camera(width * distance / who.face_w, size, size, at)

    def _worn(self, skull: np.ndarray, camera) -> tuple[list[Beard | Glasses], list[float]]:
        """What is worn in this picture, in its place, and the picture's attributes."""
        spec, worn = self.spec, [self.beard] if self.beard else []
        with_glasses = bool(self.glasses) and self.rng.random() < 0.7
        if with_glasses:
            worn.append(self.glasses[int(self.rng.integers(len(self.glasses)))])
        for prop in worn:
            prop.place(self.who, skull, camera)
        races = self.setup.program["train_set"].RACES
        hair, beard = spec["hair"] is not None, self.beard is not None
        own = [spec["male"], spec["age"], *(spec["race"][r] for r in races)]
        return worn, [*own, float(hair), float(beard), float(with_glasses)]

    def _mask(self, z: np.ndarray) -> np.ndarray:
        size = self.setup.size
        near = (z < 39).astype(np.uint8)
        return np.packbits(cv2.resize(near, (size, size), interpolation=cv2.INTER_AREA), axis=1)

    def leave(self) -> None:
        """Free the GPU's memory."""
        release([self.hand.actor, *(a for prop in [self.beard, *self.glasses] if prop for a in prop.actors)])
        for part in self.who.g.b.values():
            if "label" in part:
                part["label"].release()
        self.setup.program["train_set"].release(self.setup.renderer, self.who)


def _jpeg(image: np.ndarray) -> bytes:
    bgr = np.ascontiguousarray(image[..., ::-1])
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def release(actors: list) -> None:
    """Free the buffers of props; textures are the renderer's."""
    for part in (part for actor in actors for part in actor.b.values()):
        for name, buffer in part.items():
            if hasattr(buffer, "release") and name not in ("tex", "aux"):
                buffer.release()


def pictures(setup: Setup, number: int, count: int) -> list[dict]:
    """Rows of `count` pictures of person `number`."""
    person = Person(setup, number)
    rows = [person.picture() for _ in range(count)]
    person.leave()
    return rows


def random_beard(p, renderer, who, rng: np.random.Generator) -> Beard | None:
    """A beard for every other man."""
    if who.spec["male"] < 0.5 or rng.random() < 0.45:
        return None
    style = STYLES[int(rng.choice(len(STYLES), p=(0.35, 0.25, 0.2, 0.1, 0.1)))]
    length = rng.uniform(0.02, 0.09) if rng.random() < 0.65 else rng.uniform(0.09, 0.3)
    return Beard(p, renderer, who, rng, style, float(length))


def random_glasses(p, renderer, who, rng: np.random.Generator) -> list[Glasses]:
    """Two pairs of glasses for two people in five, some of them tinted."""
    if rng.random() > 0.4:
        return []
    tints = [rng.uniform(0.55, 0.95) if rng.random() < 0.2 else rng.uniform(0, 0.25) for _ in range(2)]
    return [Glasses(p, renderer, who, rng, float(tint)) for tint in tints]


def write_part(path: Path, rows: list[dict], names: dict[str, list[str]]) -> None:
    """Write the rows of a part; a file that exists is complete."""
    columns = {key: [row[key] for row in rows] for key in rows[0]}
    jpeg, labels = columns.pop("jpeg"), columns.pop("labels")
    unfinished = path.with_suffix(".partial")
    with unfinished.open("wb") as file:
        np.savez(
            file,
            jpeg=np.frombuffer(b"".join(jpeg), np.uint8),
            length=np.array([len(b) for b in jpeg], np.int32),
            labels=np.frombuffer(b"".join(labels), np.uint8),
            labels_length=np.array([len(b) for b in labels], np.int32),
            **{key: np.array(values) for key, values in columns.items()},
            **{key: np.array(values) for key, values in names.items()},
        )
    unfinished.replace(path)


def main() -> None:
    options = arguments()
    options.out.mkdir(parents=True, exist_ok=True)
    p = load_program(options.program, options.size)
    renderer, start = make_renderer(p["render"]), time.time()
    labeller, dense = Labeller(renderer, regions(p)), dense_vertices(p)
    setup = Setup(p, renderer, labeller, dense, options.size, options.hands, options.face_share)
    names = {
        "attribute_names": ["male", "age", *p["train_set"].RACES, "hair", "beard", "glasses", "hand"],
        "expression_names": list(p["human"].WEIGHT_NAMES),
    }
    last = options.first + options.people
    for first in range(options.first, last, PEOPLE_PER_PART):
        path = options.out / f"part_{first:05d}.npz"
        if path.exists():
            continue
        numbers = range(first, min(first + PEOPLE_PER_PART, last))
        rows = [row for n in numbers for row in pictures(setup, n, options.per_person)]
        write_part(path, rows, names)
        print(f"{numbers[-1] + 1 - options.first} people, {time.time() - start:.0f} s", flush=True)


def regions(p) -> np.ndarray:
    """Classes of the skin's texture."""
    base, points = p["human"].base(), p["landmarks"]
    lining = parsing_labels.mouth_lining(base, p["human"].body_faces(), points.points(base.v))
    return parsing_labels.skin_regions(points.uv(), lining)


if __name__ == "__main__":
    main()
