"""Plain crops of known faces, for measurements: as a good detector would give them, unchanged."""

from __future__ import annotations

import numpy as np

from guise.aam.parsing import FACE_FRAMING, Framing
from guise.common.arrays import F32, U8, Int
from training.augment import Props, plain
from training.canvas import Sample
from training.data import Pictures


def plain_samples(
    pictures: Pictures, count: int, seed: int = 7, props: Props | None = None, framing: Framing = FACE_FRAMING
) -> list[Sample]:
    """Samples of `count` evenly spaced pictures; with `props`, one occluder in front of each face."""
    rng = np.random.default_rng(seed)
    return [plain(rng, pictures[int(i)], props, framing) for i in evenly_spaced(pictures, count)]


def evenly_spaced(pictures: Pictures, count: int) -> Int:
    """Indices of `count` evenly spaced pictures."""
    return np.linspace(0, len(pictures) - 1, min(count, len(pictures))).astype(np.intp)


def plain_crops(pictures: Pictures, count: int, seed: int = 7) -> tuple[U8, F32]:
    """Crops (n, 128, 128, 3) and points (n, 81, 2) in them, of `count` evenly spaced pictures."""
    samples = plain_samples(pictures, count, seed)
    return np.stack([s.crop for s in samples]), np.stack([s.points for s in samples])
