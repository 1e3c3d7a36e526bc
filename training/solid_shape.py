"""Learn the 81 points in 3-D: how heads differ from one another, and how a face moves.

    python -m training.solid_shape --program DIR --parts PARTS

DIR holds the renderer, PARTS the output of `render_people.py`.  The points of random people, at rest and with random
expressions and turns of the neck, are taken from their meshes, in the definition of the built-in landmarker
(`definitions.py`), turned back to the front, and each also mirrored.  `noise` is how far the shipped landmarker's
points lie from the shape fitted to them, in pictures of PARTS.  Writes `aam/data/solid_shape.npz`: `mean` (81, 3),
`identity` (k, 81, 3) and `movement` (k, 81, 3) per standard deviation and `noise` (81,), in face widths, x to the
image's right, y down, z away from the viewer.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks import Face, open_landmarker
from guise.aam.landmarks.schemes import BROWS, JAW, MIRROR, OUTLINE, RIGID_WEIGHTS
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.solid_shape import DATA, SolidPrior
from guise.common.arrays import F64
from training.brows import hair_points
from training.data import part_files
from training.definitions import face_axes, read_alignment
from training.render_people import load_program, random_expression, random_person, random_pose

SEED = 2_810_000
IDENTITY_MODES, MOVEMENT_MODES = 32, 24
FIRST_NOISE_FACE_WIDTHS = 0.012  # with which the shape is fitted before the landmarker's own is known
MAX_YAW_DEGREES = 60.0
EVERY_PICTURE = 6
OUTLINE_NOISE = (
    4  # by which the outline's points, which slide along turned heads, are trusted less than they fit
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", type=Path, required=True, help="folder of the renderer")
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--people", type=int, default=500)
    parser.add_argument("--moments", type=int, default=12, help="moments of each person")
    parser.add_argument("--out", type=Path, default=DATA)
    given = parser.parse_args()
    program = load_program(given.program, 176)
    program["human"].Person._surfaces = _brows_only
    people = [_moments(program, number, given.moments) for number in range(given.people)]
    rest, moved = np.array([p[0] for p in people]), np.concatenate([p[1] - p[0] for p in people])
    mean = _mirrored(rest).mean(0)
    prior = SolidPrior(
        mean,
        _modes(_mirrored(rest) - mean, IDENTITY_MODES),
        _modes(_mirrored(moved), MOVEMENT_MODES),
        np.full(POINTS, FIRST_NOISE_FACE_WIDTHS),
    )
    noise = _noise(prior, given.parts)
    arrays = {"mean": prior.mean, "identity": prior.identity, "movement": prior.movement, "noise": noise}
    np.savez_compressed(given.out, **{name: value.astype(np.float16) for name, value in arrays.items()})
    print(given.out.name, given.out.stat().st_size, "bytes")


def _brows_only(person) -> None:
    """In place of a person's surfaces, which take most of the time."""
    person.surf = {"brows": person.proxy("eyebrows", person.spec["brows"], subdiv=True)[0]}


def _moments(p, number: int, count: int) -> tuple[F64, F64]:
    """Points at rest (81, 3) and at `count` moments (count, 81, 3), turned back to the front, in face widths."""
    rng = np.random.default_rng(SEED + number)
    person = p["human"].Person(random_person(p, number, rng))
    lift = hair_points(person, p["assets"].image) - p["face81"].points(person.base)[BROWS]
    shapes = [_points(p, person, lift, np.zeros(len(p["human"].WEIGHT_NAMES)), np.eye(3))]
    for _ in range(count):
        turn = p["human"].euler(*map(float, np.clip(random_pose(rng), -45, 45)))
        shapes.append(_points(p, person, lift, random_expression(p, rng), turn))
    defined = _defined(np.array(shapes) * (1, -1, -1))
    reference = ReferenceFrame.canonical()
    fit = reference.to_grid(defined[0, :, :2])
    depth = fit.scale * (defined[..., 2] - RIGID_WEIGHTS @ defined[0, :, 2])
    flat = fit.apply(defined[..., :2].reshape(-1, 2)).reshape(*defined.shape[:2], 2)
    solid = np.dstack([flat - reference.points.mean(0), depth]) / reference.resolution
    return solid[0], solid[1:]


def _points(p, person, lift: F64, weights: F64, turn: F64) -> F64:
    """(81, 3) of a moment, turned back to the front."""
    vertices, skull = person.pose(weights, turn)
    points = (p["face81"].points(vertices) - skull[:3, 3]) @ skull[:3, :3]
    points[BROWS] += lift
    return points


def _defined(points: F64) -> F64:
    """Points (n, 81, 3) in the landmarker's definition."""
    alignment = read_alignment()
    across, down = face_axes(points)
    moved = points + alignment.rendered_moves[:, :1] * across + alignment.rendered_moves[:, 1:] * down
    moved[:, JAW] = np.einsum("ij,njk->nik", alignment.rendered_jaw, points[:, JAW])
    return np.asarray(moved)


def _mirrored(shapes: F64) -> F64:
    """Shapes (n, 81, 3) and their mirror images (2 n, 81, 3)."""
    return np.concatenate([shapes, shapes[:, list(MIRROR)] * (-1, 1, 1)])


def _modes(differences: F64, count: int) -> F64:
    """(count, 81, 3) principal directions, as long as their standard deviations."""
    _, lengths, directions = np.linalg.svd(differences.reshape(len(differences), -1), full_matrices=False)
    return (lengths[:count, None] / np.sqrt(len(differences)) * directions[:count]).reshape(-1, POINTS, 3)


def _noise(prior: SolidPrior, parts: Path) -> F64:
    """(81,) root mean square distance, per axis, of the landmarker's points from the fitted shape, in face widths."""
    landmarker, squares, errors = open_landmarker("builtin"), [], []
    for path in part_files(parts):
        part = np.load(path)
        ends = np.cumsum(part["length"])
        for i in range(0, len(ends), EVERY_PICTURE):
            if abs(part["pose"][i, 0]) > MAX_YAW_DEGREES:
                continue
            coded = part["jpeg"][ends[i] - part["length"][i] : ends[i]]
            picture = cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
            face = landmarker.refine(picture, Face.around(part["face81"][i], 1.0))
            if face is None:
                continue
            fit = prior.fit(face.points.astype(np.float64))
            away = (face.points - fit.points) / fit.pose.scale
            squares.append((away**2).mean(1))
            errors.append(np.array(fit.pose.angles) - part["pose"][i])
    wrong = np.abs((np.array(errors) + 180) % 360 - 180)
    print(f"{len(squares)} pictures: yaw, pitch, roll wrong by {wrong.mean(0).round(2)} degrees")
    symmetric = np.median(squares, axis=0)
    noise = np.sqrt((symmetric + symmetric[list(MIRROR)]) / 2 / 0.45)  # a median square is 0.45 of the mean's
    noise[OUTLINE] *= OUTLINE_NOISE
    return noise


if __name__ == "__main__":
    main()
