"""Trains the recognition of people (aam/data/recognition.npz) on rendered, fictional people.

    python -m training.train_recognition --parts PARTS --photographs DIR

PARTS is the output of render_people.py.  The within-class covariance holds light, expression, pose and landmark errors,
the between-class covariance what differs from person to person.

DIR holds photographs of real people (Face Research Lab London Set, CC BY 4.0; those of evaluation_only.txt are not
read).  Real faces share a component that rendered ones lack, which would make all of them look alike: signatures are
taken about a mean halfway between the two kinds, which suits both.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from guise.aam.appearance import sample_texture
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.recognition import SIGNATURE_LENGTH, SIGNATURE_RESOLUTION, features
from guise.aam.reference import ReferenceFrame
from guise.common.arrays import F32, F64, Int
from training.data import by_hands, load_parts, london_people

OUTPUT = Path(__file__).parents[1] / "aam" / "data" / "recognition.npz"
LANDMARK_ERROR_INTEROCULAR = 0.012  # standard deviation
MAX_YAW_DEGREES = 45.0
FEATURE_MODES = 300  # to which the features are reduced first
RIDGE_SHARE = 0.1  # of the mean within-class variance, added to all directions


def observed(folder: Path) -> tuple[F32, Int]:
    """Features (n, m) of all pictures of the people trained with, and the person (n,) of each."""
    frame, rng = ReferenceFrame.canonical(SIGNATURE_RESOLUTION), np.random.default_rng(0)
    pictures, _ = by_hands(load_parts(folder, held_out=False))
    textures, people = [], []
    for image, points, person in zip(pictures.images, pictures.points, pictures.person, strict=True):
        shape = points.astype(np.float64)
        if abs(frame.yaw(frame.align(shape))) > MAX_YAW_DEGREES:
            continue
        size = np.linalg.norm(shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER])
        textures.append(
            sample_texture(
                image, shape + rng.normal(0, LANDMARK_ERROR_INTEROCULAR * size, shape.shape), frame
            )
        )
        people.append(person)
    return features(np.stack(textures)), np.unique(people, return_inverse=True)[1]


def photographed(folder: Path) -> F32:
    """Features (n, m) of real people, neutral and smiling."""
    frame, landmarker = ReferenceFrame.canonical(SIGNATURE_RESOLUTION), open_landmarker("builtin")
    textures = []
    for person in london_people(folder):
        for look in ("neutral", "smile"):
            picture = np.ascontiguousarray(cv2.imread(str(folder / f"{person}_{look}.jpg"))[..., ::-1])
            faces = landmarker.detect(np.asarray(picture, np.uint8))
            textures += [sample_texture(picture, f.points.astype(np.float64), frame) for f in faces[:1]]
    return features(np.stack(textures))


def discriminant(values: F32, person: Int) -> F64:
    """The projection (m, 64) of features (n, m) onto the discriminants."""
    centred = values - values.mean(0, dtype=np.float64)
    modes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :FEATURE_MODES]
    reduced = centred @ modes
    counts = np.bincount(person)
    means = np.stack([np.bincount(person, column) for column in reduced.T], 1) / counts[:, None]
    rest = reduced - means[person]
    within = rest.T @ rest / (len(rest) - len(counts))
    spread, turn = np.linalg.eigh(
        within + RIDGE_SHARE * np.trace(within) / FEATURE_MODES * np.eye(FEATURE_MODES)
    )
    whiten = turn / np.sqrt(spread)
    between = np.linalg.eigh(whiten.T @ np.cov(means.T) @ whiten)[1][:, ::-1][:, :SIGNATURE_LENGTH]
    return np.asarray(modes @ whiten @ between)


def main() -> None:
    """Train and write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--parts", type=Path, required=True, help="folder of rendered parts")
    parser.add_argument(
        "--photographs", type=Path, required=True, help="folder of photographs of real people"
    )
    parser.add_argument("--output", type=Path, default=OUTPUT, help="default: where it ships")
    options = parser.parse_args()
    values, person = observed(options.parts)
    real = photographed(options.photographs)
    mean = (values.mean(0, dtype=np.float64) + real.mean(0, dtype=np.float64)) / 2
    projection = discriminant(values, person)
    np.savez(options.output, mean=mean.astype(np.float16), projection=projection.astype(np.float16))
    size = options.output.stat().st_size
    print(f"{len(values)} pictures of {person.max() + 1} people, {len(real)} photographs, {size} bytes")


if __name__ == "__main__":
    main()
