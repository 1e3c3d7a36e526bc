"""Render hands of fictional people as cut-outs that are placed in front of faces.

    python -m training.render_hands --program DIR --first 0 --people 80 --per-person 12 --out HANDS.npz

The left hand and forearm of the renderer's mesh, fingers bent and spread by its rig, seen from anywhere, in the skins
and lights of `render_people.py`.  HANDS.npz holds `colour` (JPEG bytes, concatenated) and `colour_length`, `alpha`
(PNG) and `alpha_length`, and `person` (n,). Pictures depend only on the person's number.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.common.arrays import F64, U8, Bool
from training.parsing_labels import OCCLUDER, Labeller
from training.render_people import harden, load_program, make_renderer, release

SEED = 830_000
SIZE = 176  # pixels, the side of a picture
MIN_ARM_DECIMETRES = 2.6  # from the body's middle: what lies farther out is rendered
_MAX_BEND_RADIANS = np.radians((55, 75, 50))  # of the three joints of a finger


class Hand:
    """The left hand of one person, posed by its rig."""

    def __init__(self, program: dict[str, Any], person: Any) -> None:
        human, assets = program["human"], program["assets"]
        base = human.base()
        chosen = (base.g == "body") & (base.v[base.f][:, :, 0] > MIN_ARM_DECIMETRES).all(1)
        fine, f, texture, ft = human.catmull_clark(base.f[chosen], base.ft[chosen], human.NB, len(base.vt))
        self.surface = human.Surface(fine, np.zeros((fine.shape[0], 3)), f, ft, texture @ base.vt)
        self._rest = person.base
        rig = json.loads(assets.core("rigs/default.mhskel"))
        weights = json.loads(assets.core("rigs/default_weights.mhw"))["weights"]
        self._bones = [[f"finger{k}-{j}.L" for j in (1, 2, 3)] for k in range(1, 6)]
        self._weights = {b: np.array(weights[b]) for chain in self._bones for b in chain}
        self._joints = {
            b: tuple(person.base[rig["joints"][rig["bones"][b][end]]].mean(0) for end in ("head", "tail"))
            for chain in self._bones
            for b in chain
        }
        roots = np.array([self._joints[chain[0]][0] for chain in self._bones])
        tips = np.array([self._joints[chain[2]][1] for chain in self._bones])
        self.middle = roots[1:].mean(0)
        along = tips[2] - roots[2]
        self.along = along / np.linalg.norm(along)
        across = roots[4] - roots[1]
        palm = np.cross(across, self.along)  # out of the palm: it looks down at rest
        self.palm = palm / np.linalg.norm(palm) * (-1 if palm[1] > 0 else 1)

    def posed(self, rng: np.random.Generator) -> F64:
        """Vertices of the base mesh with random bends and spreads of the fingers."""
        v = self._rest.copy()
        curl = rng.beta(0.8, 1.6)
        for k, chain in enumerate(self._bones):
            bend = np.clip(curl + rng.normal(0, 0.15), 0, 1) * (0.5 if k == 0 else 1)
            if k and rng.random() < 0.12:
                bend = float(rng.random())
            spread = rng.normal(0, 0.12)
            carried = np.eye(4)
            moved = np.zeros_like(v)
            total = np.zeros(len(v))
            for bone, most in zip(chain, _MAX_BEND_RADIANS, strict=True):
                head, tail = self._joints[bone]
                finger = (tail - head) / np.linalg.norm(tail - head)
                axis = np.cross(finger, self.palm)
                turn = cv2.Rodrigues(axis / np.linalg.norm(axis) * bend * most)[0]
                if bone == chain[0]:
                    turn = cv2.Rodrigues(self.palm * spread)[0] @ turn
                own = np.eye(4)
                own[:3, :3], own[:3, 3] = turn, head - turn @ head
                carried = carried @ own
                index, weight = self._weights[bone][:, 0].astype(int), self._weights[bone][:, 1]
                moved[index] += weight[:, None] * (self._rest[index] @ carried[:3, :3].T + carried[:3, 3])
                total[index] += weight
            share = np.clip(total, 0, 1)[:, None]
            v += share * (moved / np.maximum(total, 1e-9)[:, None] - v) * (total > 0)[:, None]
        return np.asarray(v)


class _Owner:
    def __init__(self, surface: Any) -> None:
        self.surf = {"prop": surface}


def view(rng: np.random.Generator, hand: Hand, euler: Any) -> F64:
    """Rotation that shows the hand with its fingers roughly upwards, palm or back to the viewer or in between."""
    facing = hand.palm if rng.random() < 0.5 else -hand.palm
    side = np.cross(hand.along, facing)
    upright = np.stack([side / np.linalg.norm(side), hand.along, facing])
    angles = rng.normal(0, (45, 30, 20))
    return np.asarray(euler(*map(float, angles)) @ upright)


def pictures(
    p: dict[str, Any], renderer: Any, labeller: Labeller, number: int, count: int
) -> Iterator[tuple[bytes, bytes]]:
    """Colour and alpha, encoded, of person `number`."""
    rng = np.random.default_rng(SEED + number)
    program, human, looks = p["train_set"], p["human"], p["looks"]
    spec = program.random_person(number, rng)
    hand = Hand(p, human.Person(spec))
    colour, relief = looks.skin_maps(spec, p["landmarks"].uv())
    skin = {
        "tone": spec["tone"], "sat": spec["sat"], "bumpk": 0.01, "gloss": spec.get("gloss", 1.0),
        "lipcol": (1.0, 1.0, 1.0), "stub": 0.0,
    }  # fmt: skip
    material = {"kind": "SKIN", "tex": colour, "aux": relief, "u": skin}
    actor = p["render"].GpuActor(renderer, _Owner(hand.surface), {"prop": material})
    actor.parsing = {"prop": (OCCLUDER, 0.0)}
    plain = renderer.texture(np.full((4, 4, 3), 128, np.uint8))
    for _ in range(count):
        turn = view(rng, hand, human.euler)
        v = (hand.posed(rng) - hand.middle) @ turn.T
        distance = rng.uniform(6, 16)
        camera = p["render"].Camera(
            SIZE * rng.uniform(0.3, 0.42) * distance, SIZE, SIZE, (0, -0.15, distance)
        )
        places = hand.surface.positions(v)
        actor.upload({"prop": (places, hand.surface.normals(places))}, camera)
        actor.pos["body"] = actor.pos["prop"]  # the renderer asks where to aim its shadows
        image = renderer.frame([actor], camera, harden(program.random_light(rng), rng), plain)
        alpha = _whole(labeller.labels([actor], camera) == OCCLUDER)
        rows, columns = (np.flatnonzero(alpha.max(axis) > 0) for axis in (1, 0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        bgr = np.ascontiguousarray(image[..., ::-1][box])
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
        yield jpeg.tobytes(), cv2.imencode(".png", alpha[box])[1].tobytes()
    release([actor])
    for texture, _ in renderer._tex.values():
        texture.release()
    renderer._tex.clear()


def _whole(shown: Bool) -> U8:
    """Opacity (SIZE, SIZE) of the largest piece of what is shown: a bent arm may stick into the camera."""
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(shown.astype(np.uint8))
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
    mask = np.where(pieces == largest, np.uint8(255), np.uint8(0))
    return np.asarray(cv2.resize(mask, (SIZE, SIZE), interpolation=cv2.INTER_AREA), np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description="Render cut-outs of hands.")
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--people", type=int, default=80)
    parser.add_argument("--per-person", type=int, default=12)
    parser.add_argument("--out", type=Path, required=True)
    options = parser.parse_args()
    p = load_program(options.program, SIZE)
    renderer = make_renderer(p["render"])
    labeller = Labeller(renderer, np.zeros((4, 4), np.uint8))
    rows, person = [], []
    for number in range(options.first, options.first + options.people):
        made = list(pictures(p, renderer, labeller, number, options.per_person))
        rows += made
        person += [number] * len(made)
    colour, alpha = zip(*rows, strict=True)
    unfinished = options.out.with_suffix(".partial")
    with unfinished.open("wb") as file:
        np.savez(
            file,
            colour=np.frombuffer(b"".join(colour), np.uint8),
            colour_length=np.array([len(b) for b in colour], np.int32),
            alpha=np.frombuffer(b"".join(alpha), np.uint8),
            alpha_length=np.array([len(b) for b in alpha], np.int32),
            person=np.array(person, np.int32),
        )
    unfinished.replace(options.out)


if __name__ == "__main__":
    main()
