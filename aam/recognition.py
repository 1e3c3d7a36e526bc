"""Is the person of one enrolment the person of another?

A signature is the mean face of an appearance model, small, as the logarithm of its luma (so that the strength of light
is a constant) without its plane (a light from one side), carried to where people differ most in proportion to how
pictures of one person differ: a linear discriminant analysis (Fisher 1936) of rendered people who do not exist under
many lights, poses and expressions (training/train_recognition.py; aam/data/recognition.npz).  Only brows, eyes, nose,
mouth and the skin between them count, hair does not.  Both models must have their landmarks from the same landmarker.

It is biometric data: whoever has it can look for the person in other pictures.

Measured by benchmarks/recognition.py on enrolments of parts of clips, 48 frames, built-in landmarker: of 1778 pairs of
different people none passes for one; of one person's, 0 of 25 pairs from one clip are missed, and 8 of 27 from two
clips, all of which hold a clip of a face that looks aside.  The threshold was chosen on these.  Of other people, in
single photographs, 2 of 1512 pairs pass for one, and 6 of 28, neutral and smiling, are missed; the centring was changed
after a first look at them.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import resources

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.mask import core_mask
from guise.aam.model import Identity
from guise.aam.reference import MARGIN, ReferenceFrame, remap_points
from guise.common.arrays import F32

RESOLUTION = 32  # grid pixels across the face
DIRECTIONS = 64  # values of a signature
SAME = 0.80  # likeness from which two enrolments are of one person
BLUR = 0.44  # small pixels, standard deviation, against aliasing
DARK = 16.0  # grey levels added before the logarithm
LUMA = np.array([0.299, 0.587, 0.114], np.float32)


def signature(identity: Identity) -> F32:
    """(64,) float32 of length 1 that is much the same for one person under other light, expression and pose."""
    look = identity.appearance
    scale = look.reference.resolution / RESOLUTION
    picture = look.reference.scatter(look.texture_of(look.components.mean))
    small = cv2.GaussianBlur(picture, (0, 0), BLUR * scale)
    places = (_pixels() - MARGIN) * np.float32(scale) + MARGIN
    return signature_of(remap_points(np.asarray(small, np.float32), places))


def signature_of(texture: F32) -> F32:
    """The signature of a texture (n, 3) RGB on the frame of RESOLUTION."""
    mean, projection = _trained()
    found = (features(texture) - mean) @ projection
    return np.asarray(found / max(float(np.linalg.norm(found)), 1e-9), np.float32)


def likeness(a: F32, b: F32) -> float:
    """Cosine of two signatures, -1..1."""
    return float(a @ b)


def same_person(a: Identity, b: Identity) -> bool:
    """Whether two enrolments are of one person; when in doubt, no."""
    return likeness(signature(a), signature(b)) >= SAME


def features(textures: F32) -> F32:
    """(.., m) of textures (.., n, 3) RGB on the small frame: log luma of the face's core without its plane."""
    core, plane = _core()
    values = np.log(np.maximum(textures[..., core, :] @ LUMA, 0) + np.float32(DARK))
    return np.asarray(values - (values @ plane) @ plane.T, np.float32)


@lru_cache(maxsize=1)
def _pixels() -> F32:
    """(n, 2) places of the small frame's pixels."""
    reference = ReferenceFrame.canonical(RESOLUTION)
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    return np.column_stack([xs, ys]).astype(np.float32)


@lru_cache(maxsize=1)
def _core() -> tuple[NDArray[np.bool_], F32]:
    """Which pixels count, and an orthonormal basis (m, 3) of planes over them."""
    reference = ReferenceFrame.canonical(RESOLUTION)
    core = np.asarray(core_mask(reference)[reference.mask])
    places = _pixels()[core]
    basis, _ = np.linalg.qr(np.column_stack([np.ones(len(places)), places - places.mean(0)]))
    return core, basis.astype(np.float32)


@lru_cache(maxsize=1)
def _trained() -> tuple[F32, F32]:
    """Mean (m,) and projection (m, 64) of features."""
    file = resources.files("guise.aam").joinpath("data", "recognition.npz")
    with file.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        return data["mean"].astype(np.float32), data["projection"].astype(np.float32)
