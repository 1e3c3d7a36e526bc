"""Renders what the expected views of a face are trained on: people at rest, from the front and turned.

    python -m training.render_turns --program DIR --first 0 --count 600 --out PARTS

DIR holds the renderer, as for `render_swaps.py`.  People, who do not exist, are drawn without hair in one mild light
each, which stays where it is as the head turns to `YAWS`.  They depend only on their number.

Each person_NNNNN.npz holds pictures as JPEG in `jpeg` (bytes, concatenated) and `length`, and their points `face81`
(pictures, 81, 2) float32 pixels, in the order of `YAWS`.
"""

from __future__ import annotations

import cv2
import numpy as np

from training.render_people import random_expression
from training.render_swaps import Cast, Setup, draw, mild_light, release, render_files, scene_at

YAWS = (-50, -35, -20, 0, 20, 35, 50)  # degrees; the front is in the middle
SPREAD_DEGREES = 3.0  # standard deviation about them, and of the nod
FIRST_PERSON, SEED = 3_000_000, 930_777


def person(setup: Setup, number: int) -> dict:
    """The columns of one person's file."""
    rng = np.random.default_rng(SEED + number)
    one = Cast(setup, FIRST_PERSON + number, rng)
    p, renderer = setup.program, setup.renderer
    light = mild_light(p, rng)
    kind = int(rng.integers(1, 100_000))
    background = renderer.texture(p["looks"].background(kind, w=setup.size, h=setup.size))
    rest = np.zeros_like(random_expression(p, rng))
    pictures, points = [], []
    for yaw in YAWS:
        pose = np.array([yaw + rng.normal(0, SPREAD_DEGREES), rng.normal(0, SPREAD_DEGREES), 0])
        scene = scene_at(setup, one.actor, rest, pose, light, rng)
        picture, found = draw(setup, one.actor, one.lift, scene, background, bald=True)
        pictures.append(cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 96])[1].tobytes())
        points.append(found)
    release(setup, [one])
    return {
        "jpeg": np.frombuffer(b"".join(pictures), np.uint8),
        "length": np.array([len(b) for b in pictures], np.int32),
        "face81": np.array(points, np.float32),
    }


if __name__ == "__main__":
    render_files("person", person, __doc__.splitlines()[0], count=600, size=256)
