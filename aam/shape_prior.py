"""A face at rest, guessed from one that isn't: what is expression or pose of a shape, and what is the person.

A joint linear Gaussian model of the 81 points, learnt from rendered people (`training/shape_prior.py`): shape = mean +
identity + expression + pose + noise.  The most likely expression and pose of a shape are taken away; what the model
explains by nobody's expression stays, so that a face keeps its own proportions.  Needed where a clip never shows the
face at rest: who smiles in every frame would otherwise not be seen to smile.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from guise.aam.reference import POINTS, ReferenceFrame
from guise.common.arrays import F64

DATA = Path(__file__).parent / "data" / "shape_prior.npz"


def at_rest(shape: F64, reference: ReferenceFrame) -> F64:
    """A shape (81, 2), pixels of any picture, aligned with the reference frame, frontal and without expression."""
    aligned = reference.align(shape) / reference.resolution
    mean, noise, modes, own = _prior()
    away = (aligned.ravel() - mean) / noise
    amounts = np.linalg.solve(modes @ modes.T + np.eye(len(modes)), modes @ away)
    amounts[:own] = 0
    still = aligned - (noise * (amounts @ modes)).reshape(POINTS, 2)
    return reference.align(still * reference.resolution)


@cache
def _prior() -> tuple[F64, F64, F64, int]:
    """Mean and noise (162,), modes (k, 162) in noise's units, one per standard deviation, and how many are identity."""
    with np.load(DATA) as stored:
        arrays = {name: stored[name].astype(np.float64) for name in stored.files}
    modes = np.vstack([arrays["identity"], arrays["expression"], arrays["pose"]]) / arrays["noise"]
    return arrays["mean"], arrays["noise"], modes, len(arrays["identity"])
