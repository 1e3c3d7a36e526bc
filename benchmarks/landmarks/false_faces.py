"""False faces: pictures in which nobody is, and how many faces are found in them with the default confidence.

300 crops of the photographs, scans and drawings that scikit-image ships, at random scales; 80 rooms out of focus by the
program that renders people, where it is there; the rest of 500 made up of noise, stripes, spots and shapes.  Left out
of scikit-image's pictures are those with people or their images (astronaut, camera, coins, lfw_subset) and with
animals' heads (chelsea, logo).
The pictures follow from their numbers alone.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import skimage.data
from numpy.typing import NDArray

from benchmarks import common
from benchmarks.common import Criterion, Picture, Report, Table
from benchmarks.landmarks import setting

NAME, TITLE = "landmarks.false_faces", "False faces"
PICTURES, PHOTOGRAPHS, ROOMS = 500, 300, 80
HEIGHT, WIDTH = 360, 480
FACELESS = (
    "brick", "cell", "checkerboard", "clock", "coffee", "colorwheel", "grass", "gravel", "horse", "hubble_deep_field",
    "immunohistochemistry", "microaneurysms", "moon", "page", "retina", "rocket", "shepp_logan_phantom",
    "stereo_motorcycle", "text",
)  # fmt: skip
SCALES = (0.4, 4.0)  # of the photographs
Rng = np.random.Generator


# -- pictures -------------------------------------------------------------------------------------------------


@cache
def photograph(name: str) -> Picture:
    """A picture of scikit-image as RGB uint8."""
    found = getattr(skimage.data, name)()
    image: NDArray[Any] = np.asarray(found[0] if isinstance(found, tuple) else found)
    if image.dtype != np.uint8:
        image = np.clip(255.0 * image, 0, 255).astype(np.uint8)
    return np.ascontiguousarray(np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image[..., :3])


def crop(rng: Rng) -> Picture:
    """Part of a photograph at a random scale, mirrored at its edges where it is too small."""
    image = photograph(FACELESS[int(rng.integers(len(FACELESS)))])
    low, high = np.log(SCALES)
    scale = max(float(np.exp(rng.uniform(low, high))), 64 / min(image.shape[:2]))
    flags = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=flags), np.uint8)
    y, x = (
        int(rng.integers(max(have - need, 0) + 1))
        for have, need in zip(image.shape, (HEIGHT, WIDTH), strict=False)
    )
    part = image[y : y + HEIGHT, x : x + WIDTH]
    return np.pad(part, ((0, HEIGHT - part.shape[0]), (0, WIDTH - part.shape[1]), (0, 0)), "symmetric")


def noise(rng: Rng) -> Picture:
    """Coloured noise in octaves."""
    picture = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for octave in range(int(rng.integers(1, 8))):
        cells = (2 + 2**octave * 3 // 4, 2 + 2**octave)
        coarse = rng.normal(size=(*cells, 3)).astype(np.float32)
        picture += cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC) * rng.uniform(0.3, 1)
    return bytes_of(rng.uniform(60, 200, 3) + rng.uniform(10, 60) * picture)


def stripes(rng: Rng) -> Picture:
    """Two crossing waves."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(np.float32)
    value = np.zeros_like(x)
    for _ in range(2):
        angle, length = rng.uniform(0, np.pi), rng.uniform(6, 120)
        value += np.sin(2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / length)
    return bytes_of(rng.uniform(50, 200, 3) + value[..., None] * rng.uniform(-50, 50, 3))


def spots(rng: Rng) -> Picture:
    """Filled ellipses of any size on a plain ground."""
    picture = np.full((HEIGHT, WIDTH, 3), rng.uniform(0, 255, 3), np.float32)
    for _ in range(int(rng.integers(5, 150))):
        centre, axes = rng.uniform(0, (WIDTH, HEIGHT)), rng.uniform(2, 60, 2)
        cv2.ellipse(
            picture,
            (*map(int, centre),),
            (*map(int, axes),),
            rng.uniform(0, 180),
            0,
            360,
            rng.uniform(0, 255, 3).tolist(),
            -1,
        )
    return bytes_of(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 4)))


def shapes(rng: Rng) -> Picture:
    """Polygons and lines."""
    picture = np.full((HEIGHT, WIDTH, 3), rng.uniform(0, 255, 3), np.float32)
    for _ in range(int(rng.integers(4, 60))):
        corners = (
            rng.uniform(0, (WIDTH, HEIGHT)) + rng.normal(0, rng.uniform(5, 120), (int(rng.integers(3, 7)), 2))
        ).astype(int)
        cv2.fillPoly(picture, [corners], rng.uniform(0, 255, 3).tolist())
        cv2.polylines(picture, [corners], True, rng.uniform(0, 255, 3).tolist(), int(rng.integers(1, 5)))
    return bytes_of(picture + rng.normal(0, rng.uniform(0, 20), picture.shape))


def bytes_of(picture: NDArray[Any]) -> Picture:
    """Rounded and clipped to 0..255."""
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


MADE_UP: tuple[Callable[[Rng], Picture], ...] = (noise, stripes, spots, shapes)


def rooms(shared: Path) -> Callable[[int], Picture] | None:
    """Rooms by number, of the program that renders people; None without it."""
    folder = shared / "people"
    if not (folder / "looks.py").is_file():
        return None
    sys.path.insert(0, str(folder))
    try:
        looks = importlib.import_module("looks")
    finally:
        sys.path.remove(str(folder))
    return lambda number: np.asarray(looks.background(number, w=2 * WIDTH, h=2 * HEIGHT), np.uint8)


def faceless(shared: Path, count: int) -> Iterator[tuple[str, Picture]]:
    """Kinds and pictures, so many in all."""
    room = rooms(shared)
    share = count / PICTURES
    photographs, scenes = round(share * PHOTOGRAPHS), round(share * ROOMS) if room else 0
    for number in range(count):
        rng = np.random.default_rng(900_000 + number)
        if number < photographs:
            yield "photographs", crop(rng)
        elif number < photographs + scenes and room is not None:
            yield "rooms", room(900_000 + number)
        else:
            yield "made up", MADE_UP[number % len(MADE_UP)](rng)


# -- measurement ----------------------------------------------------------------------------------------------


def measure(options: argparse.Namespace) -> Report:
    """Search all pictures."""
    landmarker: Any = setting.landmarker(options)
    detector = getattr(landmarker, "detector", None)
    counts: dict[str, list[int]] = {}
    most, worst = 0.0, "none"
    for number, (kind, rgb) in enumerate(faceless(options.shared, 50 if options.quick else PICTURES)):
        faces = landmarker.detect(rgb)
        boxes = 0 if detector is None else len(detector.detect(rgb))
        counted = (1, boxes, len(faces), len(setting.sure(faces)))
        counts[kind] = [a + b for a, b in zip(counts.get(kind, [0] * 4), counted, strict=True)]
        for face in faces:
            if face.confidence > most:
                most, worst = face.confidence, f"picture {number}, {kind}"
        if counted[3]:
            common.say(f"picture {number}, {kind}: {counted[3]} false")
    false = sum(row[3] for row in counts.values())
    report = Report(NAME, TITLE)
    total = sum(row[0] for row in counts.values())
    report.criteria = [
        Criterion(
            f"faces with the default confidence ({setting.MIN_CONFIDENCE:g}) in {total} pictures",
            false,
            "<=",
            0,
        )
    ]
    columns = ("pictures", "number", "boxes of the detector", "faces", "of default confidence")
    report.tables = [Table("Each kind", columns, [(kind, *row) for kind, row in counts.items()])]
    report.notes = [f"Highest confidence: {most:.3f} ({worst})."]
    if "rooms" not in counts:
        report.notes.append(
            f"Skipped: rooms, no people/looks.py in {options.shared}; made-up pictures stand for them."
        )
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
