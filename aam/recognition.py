"""Is the person of one enrolment the person of another?

A signature is the mean face of an appearance model, reduced in size, as the logarithm of its luma (which makes the
strength of light a constant) without its plane (light from one side), projected to the directions in which people
differ most in proportion to how pictures of one person differ: a linear discriminant analysis (Fisher 1936) of rendered
fictional people under many lights, poses and expressions (training/train_recognition.py; aam/data/recognition.npz).
Only brows, eyes, nose, mouth and the skin between them count; hair doesn't.  Both models need landmarks from the same
landmarker.

It is biometric data: whoever has it can search for the person in other pictures.

Measured by benchmarks/recognition.py on enrolments of parts of clips, 48 frames, built-in landmarker: of 1778 pairs of
different people none is taken for one person; of pairs of one person, 0 of 25 from one clip are missed, and 8 of 27
from two clips, all of which include a clip of a face that looks aside.  The threshold was chosen on these.  Of other
people, in single photographs, 2 of 1512 pairs are taken for one person, and 6 of 28, neutral and smiling, are missed;
the centring was changed after a first evaluation on them.
"""

from __future__ import annotations

from functools import lru_cache
from importlib import resources

import cv2
import numpy as np

from guise.aam.light import LUMA
from guise.aam.mask import core_mask
from guise.aam.model import Identity
from guise.aam.reference import MARGIN_GRID_PIXELS, ReferenceFrame
from guise.common.arrays import F32, U8, Bool, Floating
from guise.common.sampling import remap_points

SIGNATURE_RESOLUTION = 32  # grid pixels across the face
PICTURE_RESOLUTION = 128  # grid pixels across a face that is sampled from a picture
SIGNATURE_LENGTH = 64  # of its vector
MIN_SAME_PERSON_SIMILARITY = 0.80  # cosine, from which two enrolments are of one person
BLUR_PIXELS = 0.44  # of the small frame, standard deviation, against aliasing
LOG_OFFSET_GREY_LEVELS = 16.0  # added before the logarithm


def signature(identity: Identity) -> F32:
    """(64,) float32 of unit length that hardly changes with light, expression and pose."""
    model = identity.appearance
    return _signature_on(model.reference, model.texture_of(model.components.mean))


def picture_signature(rgb: U8, shape: Floating) -> F32:
    """The signature (64,) of the face with landmarks (81, 2) in one picture (h, w, 3): light and expression tell more.

    It is what somebody has who knows a picture and no enrolment (`guise.app.measure.attack`).
    """
    reference = ReferenceFrame.canonical(PICTURE_RESOLUTION)
    return _signature_on(reference, reference.sampler.sample(rgb, shape))


def _signature_on(reference: ReferenceFrame, texture: F32) -> F32:
    """The signature of a texture (n, 3) RGB on a frame of a finer resolution."""
    scale = reference.resolution / SIGNATURE_RESOLUTION
    small = cv2.GaussianBlur(reference.scatter(texture), (0, 0), BLUR_PIXELS * scale)
    places = (_pixels() - MARGIN_GRID_PIXELS) * np.float32(scale) + MARGIN_GRID_PIXELS
    return signature_of(remap_points(np.asarray(small, np.float32), places))


def signature_of(texture: F32) -> F32:
    """The signature of a texture (n, 3) RGB on the reference frame of SIGNATURE_RESOLUTION."""
    mean, projection = _trained()
    found = (features(texture) - mean) @ projection
    return np.asarray(found / max(float(np.linalg.norm(found)), 1e-9), np.float32)


def cosine_similarity(a: F32, b: F32) -> float:
    """Of two signatures, -1..1."""
    return float(a @ b)


def same_person(a: F32, b: F32) -> bool:
    """Whether the signatures of two enrolments are of one person; when in doubt, no."""
    return cosine_similarity(a, b) >= MIN_SAME_PERSON_SIMILARITY


def features(textures: F32) -> F32:
    """(.., m) of textures (.., n, 3) RGB on the small frame: log luma of the face's core without its plane."""
    core, plane = _core()
    values = np.log(np.maximum(textures[..., core, :] @ LUMA, 0) + np.float32(LOG_OFFSET_GREY_LEVELS))
    return np.asarray(values - (values @ plane) @ plane.T, np.float32)


@lru_cache(maxsize=1)
def _pixels() -> F32:
    """(n, 2) places of the small frame's pixels."""
    reference = ReferenceFrame.canonical(SIGNATURE_RESOLUTION)
    ys, xs = np.divmod(reference.pixels, reference.size[1])
    return np.column_stack([xs, ys]).astype(np.float32)


@lru_cache(maxsize=1)
def _core() -> tuple[Bool, F32]:
    """Which pixels count, and an orthonormal basis (m, 3) of planes over them."""
    reference = ReferenceFrame.canonical(SIGNATURE_RESOLUTION)
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
