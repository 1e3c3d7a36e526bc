"""Render hands of fictional people as cut-outs that are placed in front of faces.

    python -m training.render_hands --program DIR --first 0 --people 80 --per-person 12 --out HANDS.npz

Hands of `hands.py`, seen from anywhere, in the skins and lights of `render_people.py`.  HANDS.npz holds `colour` (JPEG
bytes, concatenated) and `colour_length`, `alpha` (PNG) and `alpha_length`, `person` (n,), and of each cut-out `scale`
(n,) pixels per decimetre and `knuckles` (n, 2), x and y of their middle. Pictures depend only on the person's number.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from guise.common.arrays import F64, U8, Bool
from training.hands import Hand, skin_actor, view
from training.parsing_labels import OCCLUDER, Labeller
from training.render_people import harden, load_program, make_renderer, release

SEED = 830_000
SIZE = 208  # pixels, the side of a picture


def pictures(
    p: dict[str, Any], renderer: Any, labeller: Labeller, number: int, count: int
) -> Iterator[tuple[bytes, bytes, float, F64]]:
    """Colour and alpha, encoded, of person `number`, pixels per decimetre, and the middle of the knuckles."""
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
    actor = skin_actor(p, renderer, hand, material)
    plain = renderer.texture(np.full((4, 4, 3), 128, np.uint8))
    for _ in range(count):
        turn = view(rng, hand, human.euler, (45, 30, 20))
        v = (hand.posed(rng) - hand.middle) @ turn.T
        distance = rng.uniform(6, 16)
        scale = SIZE * rng.uniform(0.3, 0.42)
        camera = p["render"].Camera(scale * distance, SIZE, SIZE, (0, -0.15, distance))
        places = hand.surface.positions(v)
        actor.upload({"prop": (places, hand.surface.normals(places))}, camera)
        actor.pos["body"] = actor.pos["prop"]  # the renderer asks where to aim its shadows
        image = renderer.frame([actor], camera, harden(program.random_light(rng), rng), plain)
        alpha = _whole(labeller.labels([actor], camera) == OCCLUDER)
        rows, columns = (np.flatnonzero(alpha.max(axis) > 0) for axis in (1, 0))
        box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
        bgr = np.ascontiguousarray(image[..., ::-1][box])
        jpeg = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]
        knuckles = camera.project(np.zeros((1, 3)))[0][0] - (columns[0], rows[0])
        yield jpeg.tobytes(), cv2.imencode(".png", alpha[box])[1].tobytes(), scale, knuckles
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
    colour, alpha, scale, knuckles = zip(*rows, strict=True)
    unfinished = options.out.with_suffix(".partial")
    with unfinished.open("wb") as file:
        np.savez(
            file,
            colour=np.frombuffer(b"".join(colour), np.uint8),
            colour_length=np.array([len(b) for b in colour], np.int32),
            alpha=np.frombuffer(b"".join(alpha), np.uint8),
            alpha_length=np.array([len(b) for b in alpha], np.int32),
            person=np.array(person, np.int32),
            scale=np.array(scale, np.float32),
            knuckles=np.array(knuckles, np.float32),
        )
    unfinished.replace(options.out)


if __name__ == "__main__":
    main()
