"""Small made-up appearance models for tests: right in structure, random in content, no video needed."""

from pathlib import Path

import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel, Components
from guise.aam.reference import ReferenceFrame

SAMPLES = Path(__file__).parents[1] / "sample_videos"
FRAME = ReferenceFrame.canonical(32)


def components(rng: np.random.Generator, length: int, modes: int, spread: float) -> Components:
    basis = np.linalg.qr(rng.normal(size=(length, modes)))[0]
    deviations = np.sort(rng.uniform(spread / 30, spread, modes))[::-1]
    mean = rng.uniform(60, 180, length)
    return Components(
        mean.astype(np.float32),
        basis.astype(np.float32),
        deviations.astype(np.float32),
        float((deviations**2).sum() / 0.95),
    )


def appearance(
    seed: int, modes: int = 6, reference: ReferenceFrame = FRAME, spread: float = 30.0
) -> AppearanceModel:
    """A person whose mean shape is near the reference points and whose neutral face is one of their own."""
    rng = np.random.default_rng(seed)
    found = components(rng, SHAPE_ENTRIES + 3 * len(reference.pixels), modes, spread)
    near = reference.points + rng.normal(size=reference.points.shape) * 0.01 * reference.resolution
    found.mean[:SHAPE_ENTRIES] = (reference.align(near) * reference.shape_weight).ravel()
    neutral = found.synthesise((rng.normal(size=modes) * found.deviations).astype(np.float32))
    return AppearanceModel(reference, found, neutral, reference.mask)
