"""Trains what tells people apart (aam/data/recognition.npz) on rendered people who do not exist.

    python -m training.train_recognition --parts PARTS --photographs DIR

PARTS is what render_people.py wrote.  The within-class covariance holds light, expression, pose and the landmarks'
slips, the between-class covariance what differs from person to person.

DIR holds photographs of real people (Face Research Lab London Set, CC BY 4.0; those of evaluation_only.txt are not
read).  Real faces have a part in common that rendered ones lack, by which all would seem alike: signatures are taken
about a mean halfway between the two kinds, which serves both.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.appearance import sample_texture
from aam.landmarks import open_landmarker
from aam.recognition import DIRECTIONS, RESOLUTION, features
from aam.reference import ReferenceFrame
from training.data import load_parts, london_people

OUTPUT = Path(__file__).parents[1] / "aam" / "data" / "recognition.npz"
SLIP = 0.012  # standard deviation of the landmarks' errors, inter-ocular distances
MOST_YAW = 45.0  # degrees
MODES = 300  # of the features, before
RIDGE = 0.1  # share of the mean within-class variance added to all directions

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


def observed(folder: Path) -> tuple[F32, NDArray[np.intp]]:
    """Features (n, m) of all pictures of the people that are trained with, and the person (n,) of each."""
    frame, rng = ReferenceFrame.canonical(RESOLUTION), np.random.default_rng(0)
    pictures = load_parts(folder, held_out=False)
    textures, people = [], []
    for image, points, person in zip(pictures.images, pictures.points, pictures.person, strict=True):
        shape = points.astype(np.float64)
        if abs(frame.yaw(frame.align(shape))) > MOST_YAW:
            continue
        size = np.linalg.norm(shape[45] - shape[36])
        textures.append(sample_texture(image, shape + rng.normal(0, SLIP * size, shape.shape), frame))
        people.append(person)
    return features(np.stack(textures)), np.unique(people, return_inverse=True)[1]


def photographed(folder: Path) -> F32:
    """Features (n, m) of real people, neutral and smiling."""
    frame, landmarker = ReferenceFrame.canonical(RESOLUTION), open_landmarker("builtin")
    textures = []
    for person in london_people(folder):
        for look in ("neutral", "smile"):
            picture = np.ascontiguousarray(cv2.imread(str(folder / f"{person}_{look}.jpg"))[..., ::-1])
            faces = landmarker.detect(np.asarray(picture, np.uint8))
            textures += [sample_texture(picture, f.points.astype(np.float64), frame) for f in faces[:1]]
    return features(np.stack(textures))


def discriminant(values: F32, person: NDArray[np.intp]) -> F64:
    """The projection (m, 64) of features (n, m) onto the discriminants."""
    centred = values - values.mean(0, dtype=np.float64)
    modes = np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :MODES]
    reduced = centred @ modes
    counts = np.bincount(person)
    means = np.stack([np.bincount(person, column) for column in reduced.T], 1) / counts[:, None]
    rest = reduced - means[person]
    within = rest.T @ rest / (len(rest) - len(counts))
    spread, turn = np.linalg.eigh(within + RIDGE * np.trace(within) / MODES * np.eye(MODES))
    whiten = turn / np.sqrt(spread)
    between = np.linalg.eigh(whiten.T @ np.cov(means.T) @ whiten)[1][:, ::-1][:, :DIRECTIONS]
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
