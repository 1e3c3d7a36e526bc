"""Pictures without a face, made up: what may lie behind and beside a head.  RGB uint8."""

from __future__ import annotations

import cv2
import numpy as np

from guise.common.arrays import F32, U8

Picture = U8
Rng = np.random.Generator


def clutter(rng: Rng, size: int) -> Picture:
    """One picture (size, size, 3): a ground, things on it, and sometimes a blur over all."""
    ground = (_fractal, _gradient, _stripes, _tiles)[int(rng.integers(4))]
    picture = ground(rng, size)
    for _ in range(int(rng.integers(0, 4))):
        thing = (_polygons, _ellipses, _leaves, _writing, _boxes, _limbs)[int(rng.integers(6))]
        picture = thing(rng, picture)
    if rng.random() < 0.4:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.6, 6)), np.uint8)
    return picture


def _colour(rng: Rng) -> F32:
    if rng.random() < 0.3:  # of skin, wood, sand
        return np.asarray(
            np.array([1, rng.uniform(0.6, 0.85), rng.uniform(0.4, 0.75)]) * rng.uniform(40, 250), np.float32
        )
    return rng.uniform(0, 255, 3).astype(np.float32)


def _noise(rng: Rng, size: int, roughness: float) -> F32:
    """Fractal noise (size, size) in 0..1."""
    total = np.zeros((size, size), np.float32)
    cells, weight = 3, 1.0
    while cells < size:
        coarse = rng.random((cells, cells)).astype(np.float32)
        total += weight * cv2.resize(coarse, (size, size), interpolation=cv2.INTER_CUBIC)
        cells, weight = cells * 2, weight * roughness
    return np.asarray((total - total.min()) / (np.ptp(total) + 1e-6), np.float32)


def _between(share: F32, a: F32, b: F32) -> Picture:
    return np.asarray(np.clip(a + share[..., None] * (b - a), 0, 255), np.uint8)


def _fractal(rng: Rng, size: int) -> Picture:
    share = _noise(rng, size, rng.uniform(0.35, 0.9))
    if rng.random() < 0.4:
        share = np.clip((share - 0.5) * rng.uniform(2, 8) + 0.5, 0, 1)
    return _between(share, _colour(rng), _colour(rng))


def _gradient(rng: Rng, size: int) -> Picture:
    ys, xs = np.mgrid[:size, :size].astype(np.float32) / size
    angle = rng.uniform(0, 2 * np.pi)
    share = np.clip(0.5 + (xs - 0.5) * np.cos(angle) + (ys - 0.5) * np.sin(angle), 0, 1)
    return _between(share, _colour(rng), _colour(rng))


def _stripes(rng: Rng, size: int) -> Picture:
    ys, xs = np.mgrid[:size, :size].astype(np.float32) / size
    angle, frequency = rng.uniform(0, 2 * np.pi), rng.uniform(2, 30)
    bend = _noise(rng, size, 0.4) * rng.uniform(0, 0.3)
    wave = np.sin(2 * np.pi * frequency * (xs * np.cos(angle) + ys * np.sin(angle) + bend))
    return _between(np.clip(0.5 + wave * rng.uniform(0.4, 4), 0, 1), _colour(rng), _colour(rng))


def _tiles(rng: Rng, size: int) -> Picture:
    count = int(rng.integers(2, 16))
    colours = np.clip(_colour(rng) + rng.normal(0, rng.uniform(3, 60), (count, count, 3)), 0, 255)
    picture = cv2.resize(colours.astype(np.uint8), (size, size), interpolation=cv2.INTER_NEAREST)
    step = size / count
    joint = tuple(int(c) for c in _colour(rng))
    for k in range(count + 1):
        at = int(k * step)
        cv2.line(picture, (0, at), (size, at), joint, max(1, size // 128))
        if rng.random() < 0.7:
            cv2.line(picture, (at, 0), (at, size), joint, max(1, size // 128))
    return np.asarray(picture, np.uint8)


def _drawn(picture: Picture) -> Picture:
    return np.ascontiguousarray(picture.copy())


def _ints(rng: Rng) -> tuple[int, int, int]:
    r, g, b = (int(c) for c in _colour(rng))
    return r, g, b


def _polygons(rng: Rng, picture: Picture) -> Picture:
    out, size = _drawn(picture), len(picture)
    for _ in range(int(rng.integers(1, 12))):
        corners = rng.uniform(0, size, 2) + rng.normal(
            0, size * rng.uniform(0.03, 0.3), (int(rng.integers(3, 8)), 2)
        )
        cv2.fillPoly(out, [corners.astype(np.int32)], _ints(rng), cv2.LINE_AA)
    return out


def _ellipses(rng: Rng, picture: Picture) -> Picture:
    """Ovals, some with dots in them as cartoon faces and fruit have."""
    out, size = _drawn(picture), len(picture)
    for _ in range(int(rng.integers(1, 8))):
        centre, axes = rng.uniform(0, size, 2), rng.uniform(0.02, 0.3, 2) * size
        turn = float(rng.uniform(0, 180))
        whole = (int(centre[0]), int(centre[1])), (int(axes[0]) + 1, int(axes[1]) + 1)
        cv2.ellipse(out, *whole, turn, 0, 360, _ints(rng), -1, cv2.LINE_AA)
        for _ in range(int(rng.integers(0, 4))):
            place = (centre + rng.normal(0, 0.35, 2) * axes).astype(int)
            cv2.circle(
                out,
                (int(place[0]), int(place[1])),
                max(1, int(axes.min() * 0.12)),
                _ints(rng),
                -1,
                cv2.LINE_AA,
            )
    return out


def _leaves(rng: Rng, picture: Picture) -> Picture:
    out, size = _drawn(picture), len(picture)
    green = np.array([60, 110, 45]) if rng.random() < 0.7 else _colour(rng)
    for _ in range(int(rng.integers(20, 120))):
        at, axes = rng.uniform(0, size, 2).astype(int), rng.uniform(0.01, 0.06, 2) * size + 1
        shade = tuple(int(c) for c in np.clip(green * rng.uniform(0.4, 1.7), 0, 255))
        cv2.ellipse(
            out,
            (int(at[0]), int(at[1])),
            (int(axes[0]), int(axes[1])),
            float(rng.uniform(0, 180)),
            0,
            360,
            shade,
            -1,
        )
    return out


def _writing(rng: Rng, picture: Picture) -> Picture:
    out, size = _drawn(picture), len(picture)
    letters = "ABCDEFGHKLMNOPRSTabcdeghkmnoprstuvwxyz0123456789 .,:;()"
    for _ in range(int(rng.integers(1, 8))):
        text = "".join(letters[int(i)] for i in rng.integers(0, len(letters), int(rng.integers(3, 16))))
        at = rng.uniform(-0.1, 0.9, 2) * size
        cv2.putText(
            out, text, (int(at[0]), int(at[1])), int(rng.integers(0, 8)), float(rng.uniform(0.3, 2)), _ints(rng),
            int(rng.integers(1, 4)), cv2.LINE_AA,
        )  # fmt: skip
    return out


def _boxes(rng: Rng, picture: Picture) -> Picture:
    """Furniture, windows, shelves, cars seen roughly."""
    out, size = _drawn(picture), len(picture)
    for _ in range(int(rng.integers(2, 14))):
        a, b = rng.uniform(0, size, 2), rng.uniform(0.03, 0.5, 2) * size
        cv2.rectangle(
            out,
            (int(a[0]), int(a[1])),
            (int(a[0] + b[0]), int(a[1] + b[1])),
            _ints(rng),
            int(rng.choice((-1, -1, 2))),
        )
    return out


def _limbs(rng: Rng, picture: Picture) -> Picture:
    """Arms, fingers, shoulders: thick shaded lines of the colour of skin or cloth."""
    out, size = _drawn(picture), len(picture)
    for _ in range(int(rng.integers(1, 5))):
        colour, width = _colour(rng), rng.uniform(0.03, 0.2) * size
        places = np.cumsum(
            np.vstack([rng.uniform(0, size, 2), rng.normal(0, 0.25 * size, (3, 2))]), axis=0
        ).astype(np.int32)
        for k in range(5):
            shade = tuple(int(c) for c in np.clip(colour * (0.65 + 0.11 * k), 0, 255))
            cv2.polylines(out, [places], False, shade, max(1, int(width * (1 - 0.18 * k))), cv2.LINE_AA)
    return out
