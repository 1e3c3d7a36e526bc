"""Renders people who do not exist with known ARKit coefficients, at rest and moving, for `rig_head.py`.

    python -m training.rig_pictures --program DIR --first 0 --people 300 --out PARTS

DIR holds the renderer, as for `render_people.py`, whose random people, beards and glasses are drawn from.  Each person
sits twice, in light, room and glasses of their own: `RESTS` pictures at rest, then `MOVES` with shapes of
`arkit_shapes.py` alone, together and in speech, turned by up to 38 degrees.  Each part_NNNNN.npz holds `jpeg` (bytes,
concatenated) and `length`, `face81` (n, 81, 2) pixels, `pose` (n, 3) degrees, `person`, `sitting`, `rest` (n,), and
`weights` (n, 54): the 52 coefficients, those of eyeLook 0, then the eyes' turn to the image's right and up, degrees.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, FULL_LOOK_DEGREES, INDEX
from guise.common.arrays import F64
from training import arkit_shapes
from training.render_people import (
    _jpeg,
    harden,
    load_program,
    make_renderer,
    random_beard,
    random_glasses,
    random_person,
    release,
)  # fmt: skip

SEED = 910_000
RESTS, MOVES, SITTINGS = 2, 10, 2
FACE_SHARE = (0.48, 0.6)
PEOPLE_PER_PART = 10
Rng = np.random.Generator
Program = dict[str, Any]


def extend(p: Program) -> None:
    """Let the renderer's people have the 52 shapes after their own 34 units."""
    human = p["human"]
    if len(human.UNITS) > 34:
        return
    human.UNITS.extend(ARKIT_NAMES)
    human.WEIGHT_NAMES[:] = [*human.UNITS, *human.WEIGHT_NAMES[-2:]]
    human.UIX.update({name: k for k, name in enumerate(human.UNITS)})
    sculpted, none = human.target, (np.zeros(0, np.int64), np.zeros((0, 3)))
    human.target = lambda name: none if name.rsplit("/", 1)[-1] in INDEX else sculpted(name)


def give_shapes(p: Program, person: Any) -> None:
    """Put the 52 shapes, made of the person's own units, in their places behind these."""
    human = p["human"]
    base = human.base()

    def of(group: str) -> Any:
        mask = np.zeros(human.NB, bool)
        mask[np.unique(base.f[base.g == group])] = True
        return mask

    own = {name: person.E[k].astype(np.float64) for k, name in enumerate(human.UNITS[:34])}
    face = arkit_shapes.Face(
        base.v, p["landmarks"].points(base.v), own, of("helper-lower-teeth"), of("helper-tongue"), of("body")
    )
    made = arkit_shapes.shapes(face)
    person.E = np.concatenate([person.E[:34], np.array([made[n] for n in ARKIT_NAMES], np.float32)])
    person.act = np.flatnonzero(np.abs(person.E).max((0, 2)) > 0)
    person.Ea = person.E[:, person.act].reshape(len(human.UNITS), -1)


def weights_of(p: Program, named: dict[str, float]) -> F64:
    """The renderer's weights of units and shapes by name."""
    weights = np.zeros(len(p["human"].WEIGHT_NAMES))
    for name, value in named.items():
        weights[p["human"].WEIGHT_NAMES.index(name)] = value
    return weights


def coefficients(p: Program, weights: F64) -> F64:
    """(54,) of the renderer's weights: the 52 without eyeLook, and the eyes' turn in degrees."""
    names, found = p["human"].UNITS, np.zeros(54)
    for name, value in zip(names, weights, strict=False):
        shares = {name: 1.0} if name in INDEX else arkit_shapes.UNIT_SHAPES.get(name, {})
        for shape, share in shares.items():
            if "Look" not in shape:
                found[INDEX[shape]] += share * value
    found[52:] = weights[-2:]
    return found


def expression(p: Program, rng: Rng) -> F64:
    """Random weights of the renderer's units and of the 52 shapes."""
    anim, human = p["train_set"].anim, p["human"]
    at, w = human.UIX, np.zeros(len(human.WEIGHT_NAMES))
    kind = rng.random()
    if kind < 0.35:  # speech, now and then with an expression
        for name, x in anim.VIS[_pick(rng, sorted(anim.VIS))].items():
            w[at[name]] += x * rng.uniform(0.4, 1.1)
        w[at["mouth-open"]] += rng.uniform(0, 0.25) * (rng.random() < 0.3)
    if 0.2 < kind < 0.55:
        for name, x in anim.EXPR[_pick(rng, sorted(anim.EXPR))].items():
            w[at[name]] += x * rng.uniform(0.15, 1)
    if kind > 0.45:
        mouth = [n for n in ARKIT_NAMES if not n.startswith("eye")]
        for _ in range(int(rng.integers(1, 5))):
            name, x = _pick(rng, mouth), rng.uniform(0.1, 1)
            w[at[name]] += x
            other = _other_side(name)
            if other is not None and rng.random() < 0.65:
                w[at[other]] += x * rng.uniform(0.8, 1.1)
        if rng.random() < 0.25:
            w[at["jawOpen"]] += rng.uniform(0, 0.8)
    if rng.random() < 0.35:
        _brows(rng, w, at)
    w[:-2] = np.clip(w[:-2], 0, 1.1)
    _constrain(rng, w, at)
    _look(rng, w, at)
    return w


def _brows(rng: Rng, w: F64, at: dict[str, int]) -> None:
    sides = ("left", "right") if rng.random() < 0.75 else (_pick(rng, ["left", "right"]),)
    up, x = rng.random() < 0.55, rng.uniform(0.1, 1.1)
    moves = ("up", "extern-up", "inner-up") if up else ("down",)
    shares = rng.uniform(0, 1, 3) if rng.random() < 0.5 else (1.0, 0.0, 0.0)
    for side in sides:
        for move in ("up", "extern-up", "inner-up", "down"):
            w[at[f"eyebrows-{side}-{move}"]] = 0
        for move, share in zip(moves, shares, strict=False):
            w[at[f"eyebrows-{side}-{move}"]] = x * (share if up else 1.0)


def _constrain(rng: Rng, w: F64, at: dict[str, int]) -> None:
    """What a face cannot do at once."""
    opened = w[at["mouth-open"]] + w[at["jawOpen"]]
    w[at["mouthClose"]] = min(w[at["mouthClose"]], opened)
    if w[at["tongueOut"]] > 0:
        w[at["jawOpen"]] = max(w[at["jawOpen"]], 0.25 + 0.3 * rng.random())
        w[at["mouthClose"]] = 0
    for one, other in (("jawLeft", "jawRight"), ("mouthLeft", "mouthRight")):
        w[at[one if rng.random() < 0.5 else other]] *= w[at[one]] * w[at[other]] == 0


def _look(rng: Rng, w: F64, at: dict[str, int]) -> None:
    """Gaze, lids that follow it, and blinks."""
    gaze = rng.normal(0, 1, 2) * (9, 5)
    if rng.random() < 0.3:
        gaze = np.array([rng.uniform(-28, 28), rng.uniform(-18, 18)])
    w[-2:] = gaze
    blink = np.zeros(2)
    if rng.random() < 0.3:
        blink[:] = rng.uniform(0.1, 1.0)
        if rng.random() < 0.25:
            blink[int(rng.integers(2))] = 0
    follow = rng.uniform(0, 1)
    for k, side in enumerate(("left", "right")):
        closed = at[f"eye-{side}-closure"]
        w[closed] = max(w[closed], blink[k])
        for name in ("opened-up", "slit"):
            w[at[f"eye-{side}-{name}"]] *= 1 - w[closed]
        for name in ("eyeWide", "eyeSquint"):
            w[at[f"{name}{side.capitalize()}"]] = (rng.random() < 0.1) * rng.uniform(0, 1) * (1 - w[closed])
        lids = follow * abs(gaze[1]) / FULL_LOOK_DEGREES * (1 - w[closed])
        w[at[f"eyeLook{'Up' if gaze[1] > 0 else 'Down'}{side.capitalize()}"]] = lids


def _other_side(name: str) -> str | None:
    for one, other in (("Left", "Right"), ("Right", "Left")):
        if name.endswith(one):
            return None if name.startswith(("jaw", "mouthLeft", "mouthRight")) else name[: -len(one)] + other
    return None


def _pick(rng: Rng, names: list[str]) -> str:
    return names[int(rng.integers(len(names)))]


class Sitter:
    """One person before the camera; all randomness comes from their number."""

    def __init__(self, p: Program, renderer: Any, size: int, number: int) -> None:
        self.p, self.renderer, self.size, self.number = p, renderer, size, number
        self.rng = rng = np.random.default_rng(SEED + number)
        self.spec = random_person(p, number, rng)
        self.who = p["actor"].Actor(renderer, self.spec)
        give_shapes(p, self.who.p)
        self.beard = random_beard(p, renderer, self.who, rng)
        self.glasses = random_glasses(p, renderer, self.who, rng)

    def rows(self) -> list[dict[str, Any]]:
        """All pictures of this person."""
        return [row for sitting in range(SITTINGS) for row in self._sitting(sitting)]

    def _sitting(self, sitting: int) -> list[dict[str, Any]]:
        p, rng, size = self.p, self.rng, self.size
        seed = int(rng.integers(1, 100_000))
        background = self.renderer.texture(p["looks"].background(seed, w=size, h=size))
        light = harden(p["train_set"].random_light(rng), rng)
        distance, share = rng.uniform(4.8, 16), rng.uniform(*FACE_SHARE)
        worn = [self.beard] if self.beard else []
        if self.glasses and (sitting or rng.random() < 0.5):
            worn.append(self.glasses[sitting % len(self.glasses)])
        made = []
        for k in range(RESTS + MOVES):
            rest = k < RESTS
            pose = _pose(rng) * (0.4 if rest else 1)
            w = expression(p, rng)
            if rest:
                w[:-2], w[-2:] = 0, rng.normal(0, 2, 2)
            skull = self.who.p.pose(w, p["human"].euler(*map(float, pose)), None)[1]
            camera = self._camera(skull, distance, share)
            truth = self.who.place(w, p["human"].euler(*map(float, pose)), None, camera)
            for prop in worn:
                prop.place(self.who, skull, camera)
            actors = [self.who.g, *(actor for prop in worn for actor in prop.actors)]
            image = self.renderer.frame(actors, camera, light, background)
            points = camera.project(p["face81"].points(truth["verts"]))[0]
            made.append({
                "jpeg": _jpeg(image), "face81": points.astype(np.float32),
                "pose": pose.astype(np.float32), "person": np.int32(self.number), "sitting": np.int32(sitting),
                "rest": np.bool_(rest), "weights": coefficients(p, w).astype(np.float32),
                "glasses": np.bool_(len(worn) > bool(self.beard)),
            })  # fmt: skip
        return made

    def _camera(self, skull: F64, distance: float, share: float) -> Any:
        middle = skull[:3, :3] @ self.who.face_c + skull[:3, 3]
        shift = self.rng.normal(0, 0.05, 2)
        at = (middle[0] + shift[0], middle[1] + shift[1] + 0.15, middle[2] + distance)
        focal = share * self.size * distance / self.who.face_w
        return self.p["render"].Camera(focal, self.size, self.size, at)

    def leave(self) -> None:
        """Free the renderer's memory."""
        release([a for prop in [self.beard, *self.glasses] if prop for a in prop.actors])
        self.p["train_set"].release(self.renderer, self.who)


def _pose(rng: Rng) -> F64:
    yaw = rng.normal(0, 12) if rng.random() < 0.65 else rng.uniform(-38, 38)
    return np.clip([yaw, rng.normal(0, 8), rng.normal(0, 6)], (-38, -25, -25), (38, 25, 25))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--people", type=int, default=300)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    p = load_program(options.program, options.size)
    extend(p)
    renderer, start = make_renderer(p["render"]), time.time()
    last = options.first + options.people
    for first in range(options.first, last, PEOPLE_PER_PART):
        path = options.out / f"part_{first:05d}.npz"
        if path.exists():
            continue
        rows = []
        for number in range(first, min(first + PEOPLE_PER_PART, last)):
            sitter = Sitter(p, renderer, options.size, number)
            rows += sitter.rows()
            sitter.leave()
        columns = {key: [row[key] for row in rows] for key in rows[0]}
        jpeg = columns.pop("jpeg")
        lengths = np.array([len(b) for b in jpeg], np.int32)
        whole = path.with_suffix(".partial")
        with whole.open("wb") as file:
            np.savez(
                file,
                jpeg=np.frombuffer(b"".join(jpeg), np.uint8),
                length=lengths,
                **{key: np.array(values) for key, values in columns.items()},
            )
        whole.replace(path)
        print(f"{path.name}, {time.time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main()
