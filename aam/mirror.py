"""Mirror images of pictures on a reference frame's grid."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import MIRROR
from guise.aam.reference import MeshSampler, ReferenceFrame
from guise.common.arrays import F32


def mirror_image(picture: F32, reference: ReferenceFrame, factor: int) -> F32:
    """The mirror image of a picture on the grid (factor h, factor w) or with channels; 0 outside the face."""
    maps = _maps(reference, factor)
    return np.asarray(cv2.remap(picture, maps, None, cv2.INTER_LINEAR), np.float32)  # type: ignore[call-overload]


@lru_cache(maxsize=4)
def _maps(reference: ReferenceFrame, factor: int) -> F32:
    """(factor h, factor w, 2) where each place of the mirror image is seen in the picture."""
    h, w = reference.size
    ys, xs = np.mgrid[: factor * h, : factor * w]
    places = (np.column_stack([xs.ravel(), ys.ravel()]) + 0.5) / factor - 0.5
    positions = MeshSampler.build(reference, places).positions(reference.points[list(MIRROR)])
    return np.asarray(((positions + 0.5) * factor - 0.5).reshape(factor * h, factor * w, 2))
