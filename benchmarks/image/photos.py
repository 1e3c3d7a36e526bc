"""Photographs of people, neutral and expressive, and how near one comes to another inside the face.

Pixels, x right, y down, pixel centres at integers; RGB 0..255.  The real pairs are those of data/pairs/london.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations
from pathlib import Path

import cv2
import numpy as np

from benchmarks.common import F64, Picture
from guise.analogy.photo import Method, PhotoAnalogy
from guise.analogy.photo.grid import face_mask
from guise.analogy.photo.landmark_motion import LandmarkMotion
from guise.analogy.photo.pictures import LUMINANCE

EXPRESSIONS = ("smile", "surprise", "anger", "disgust", "blink", "open")
METHODS: tuple[Method, ...] = ("tents", "ratio", "warp")


@dataclass(frozen=True, eq=False)
class Photo:
    """A picture (h, w, 3) uint8 and its landmarks (81, 2)."""

    rgb: Picture
    points: F64


@dataclass(frozen=True)
class Score:
    """How near a picture comes to the truth inside the face."""

    psnr: float  # dB, RGB
    luminance: float  # dB
    ssim: float  # of the luminance
    rms: float  # levels, RGB


@lru_cache(maxsize=64)
def rendered(shared: Path, person: str, name: str) -> Photo:
    """A still of a synthetic person with exact landmarks: 'neutral' or one of the expressions."""
    folder = shared / "data" / "synthetic" / "people" / person
    with np.load(folder / "stills.npz") as stills:
        index = list(stills["names"]).index(name)
        return Photo(_read(folder / f"{name}.jpg"), stills["landmarks"][index].astype(np.float64))


def people(shared: Path, quick: bool) -> list[str]:
    """Names of the synthetic people with stills."""
    names = sorted(p.parent.name for p in (shared / "data" / "synthetic" / "people").glob("*/stills.npz"))
    return names[:2] if quick else names


def pairs(shared: Path, quick: bool) -> list[tuple[str, str]]:
    """Every ordered pair of synthetic people."""
    return list(permutations(people(shared, quick), 2))


def smiles(shared: Path, quick: bool) -> dict[str, tuple[Photo, Photo]]:
    """Real people, neutral and smiling, with MediaPipe's landmarks."""
    folder = shared / "data" / "pairs" / "london"
    out = {}
    with np.load(folder / "face81_mediapipe.npz") as points:
        names = sorted({key.split("_")[0] for key in points})
        for name in names[:3] if quick else names:
            keys = [f"{name}_{kind}" for kind in ("neutral", "smile")]
            if all(key in points for key in keys):
                first, second = (
                    Photo(_read(folder / f"{k}.jpg"), points[k].astype(np.float64)) for k in keys
                )
                out[name] = (first, second)
    return out


def make_pictures(method: Method, source: Photo, target: Photo, expressive: Sequence[Photo]) -> list[Picture]:
    """T' of each S'."""
    carry = PhotoAnalogy(source.rgb, source.points, target.rgb, target.points, method)
    return [carry(photo.rgb, photo.points) for photo in expressive]


def aligned_to(photo: Photo, neutral: Photo) -> Photo:
    """An expressive picture turned, scaled and moved so that the skull lies as in the neutral one."""
    pose = LandmarkMotion(neutral.points, neutral.points).pose(photo.points)
    matrix = np.column_stack([pose.linear, pose.translation])
    size = (neutral.rgb.shape[1], neutral.rgb.shape[0])
    turned = cv2.warpAffine(photo.rgb, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return Photo(np.asarray(turned, np.uint8), pose.apply(photo.points))


def score(picture: Picture, truth: Photo) -> Score:
    """A picture against the truth, within the contour of the true landmarks."""
    from skimage.metrics import structural_similarity

    inside = face_mask(truth.points, (picture.shape[1], picture.shape[0]))
    off = picture.astype(np.float64) - truth.rgb
    one, two = (p.astype(np.float64) @ LUMINANCE for p in (picture, truth.rgb))
    alike = structural_similarity(one, two, data_range=255, full=True, gaussian_weights=True, sigma=1.5)[1]
    return Score(
        _decibels(off[inside]),
        _decibels((one - two)[inside]),
        float(alike[inside].mean()),
        float(np.sqrt((off[inside] ** 2).mean())),
    )


def _decibels(off: F64) -> float:
    return float(10 * np.log10(255**2 / max(float((off**2).mean()), 1e-9)))


def _read(path: Path) -> Picture:
    picture = cv2.imread(str(path))
    if picture is None:
        raise FileNotFoundError(f"{path} is no picture")
    return np.ascontiguousarray(picture[:, :, ::-1])
