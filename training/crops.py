"""Plain crops of known faces, for measuring: as a good detector's box gives them, nothing added."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from training.augment import Props, Sample, plain
from training.data import Pictures


def plain_samples(pictures: Pictures, count: int, seed: int = 7, props: Props | None = None) -> list[Sample]:
    """Samples of `count` pictures evenly taken; with `props`, one occluder before each face."""
    rng = np.random.default_rng(seed)
    return [plain(rng, pictures[int(i)], props) for i in plainly_chosen(pictures, count)]


def plainly_chosen(pictures: Pictures, count: int) -> NDArray[np.intp]:
    """Indices of `count` pictures evenly taken."""
    return np.linspace(0, len(pictures) - 1, min(count, len(pictures))).astype(np.intp)


def plain_crops(
    pictures: Pictures, count: int, seed: int = 7
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Crops (n, 128, 128, 3) and points (n, 81, 2) in them, of `count` pictures evenly taken."""
    samples = plain_samples(pictures, count, seed)
    return np.stack([s.crop for s in samples]), np.stack([s.points for s in samples])
