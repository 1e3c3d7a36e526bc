"""Learn how faces differ from one another and from themselves: identity, expression and pose of the 81 points.

    python -m training.shape_prior --parts PARTS

PARTS is the output of `render_people.py`. The shipped landmarker finds the points in its pictures, so that they are
defined as in real clips. On the reference frame, within a person, the points are regressed on the expression's units
and the angles of the head; what is left differs from person to person. Writes `aam/data/shape_prior.npz`: `mean` (162),
`identity` (k, 162), `expression` (k, 162) and `pose` (2, 162) per standard deviation and `noise` (162), all in face
widths, points in the order x y.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from guise.aam.landmarks import Face, open_landmarker
from guise.aam.reference import POINTS, ReferenceFrame
from training.data import part_files

OUT = Path(__file__).parents[1] / "aam" / "data" / "shape_prior.npz"
MAX_YAW_DEGREES, MAX_PITCH_DEGREES = 30.0, 20.0
UNIT_RIDGE = 3.0  # of the units' regression
IDENTITY_MODES, EXPRESSION_MODES = 24, 20
REST_SHARE = 0.5  # of the expression's standard deviation, that is expected of a calm moment
HELD_OUT = 5  # every so manieth person


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", type=Path, required=True)
    parser.add_argument("--every", type=int, default=2, help="use every so manieth picture")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    rows = list(_faces(given.parts, given.every))
    shapes, pose, units, person = (np.array(column) for column in zip(*rows, strict=True))
    held = person % HELD_OUT == 0
    prior = _learnt(shapes[~held], pose[~held], units[~held], person[~held])
    print(f"{len(shapes)} pictures of {len(np.unique(person))} people")
    _report(prior, shapes[held], person[held])
    prior = _learnt(shapes, pose, units, person)
    np.savez_compressed(given.out, **{name: value.astype(np.float16) for name, value in prior.items()})
    print(given.out.name, given.out.stat().st_size, "bytes")


def _faces(parts: Path, every: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, int]]:
    """Aligned points (162,) in face widths, yaw and pitch, expression units, and the person's number."""
    landmarker, reference = open_landmarker("builtin"), ReferenceFrame.canonical()
    for path in part_files(parts):
        part = np.load(path)
        ends = np.cumsum(part["length"])
        units = part["expression"][:, :-2].astype(np.float64)  # without gaze
        for i in range(0, len(ends), every):
            yaw, pitch = part["pose"][i, :2]
            if abs(yaw) > MAX_YAW_DEGREES or abs(pitch) > MAX_PITCH_DEGREES:
                continue
            coded = part["jpeg"][ends[i] - part["length"][i] : ends[i]]
            picture = cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
            face = landmarker.refine(picture, Face.around(part["face81"][i], 1.0))
            if face is not None:
                aligned = reference.align(face.points.astype(np.float64)) / reference.resolution
                yield aligned.ravel(), np.array([yaw, pitch], np.float64), units[i], int(part["person"][i])


def _learnt(
    shapes: np.ndarray, pose: np.ndarray, units: np.ndarray, person: np.ndarray
) -> dict[str, np.ndarray]:
    causes = np.hstack([pose, units])
    within_shapes, within_causes = _within(shapes, person), _within(causes, person)
    ridge = UNIT_RIDGE * np.diag(np.r_[0.0, 0.0, np.ones(units.shape[1])])
    effects = np.linalg.solve(within_causes.T @ within_causes + ridge, within_causes.T @ within_shapes)
    moved = units @ effects[2:]
    expression = _modes(moved - moved.mean(0), EXPRESSION_MODES)
    rest = shapes - causes @ effects
    people = np.unique(person)
    own = np.array([rest[person == one].mean(0) for one in people])
    noise = (rest - own[np.searchsorted(people, person)]).std(0)
    mean = own.mean(0)
    return {
        "mean": mean,
        "identity": _modes(own - mean, IDENTITY_MODES),
        "expression": REST_SHARE * expression,
        "pose": effects[:2] * pose.std(0)[:, None],
        "noise": noise,
    }


def _within(values: np.ndarray, person: np.ndarray) -> np.ndarray:
    """Differences from each person's own mean."""
    out = values.astype(np.float64).copy()
    for one in np.unique(person):
        out[person == one] -= out[person == one].mean(0)
    return out


def _modes(differences: np.ndarray, count: int) -> np.ndarray:
    """(count, 162) principal directions, as long as their standard deviations."""
    _, lengths, directions = np.linalg.svd(differences, full_matrices=False)
    return (lengths[:count, None] / np.sqrt(len(differences))) * directions[:count]


def _report(prior: dict[str, np.ndarray], shapes: np.ndarray, person: np.ndarray) -> None:
    """How much nearer the rest shapes of people not trained with are to each other than their shapes as seen."""
    made = np.array([_rest_of(shape, prior) for shape in shapes])
    for name, values in (("as seen", shapes), ("at rest", made)):
        spread = _within(values, person).reshape(len(values), POINTS, 2)
        print(
            f"{name}: {100 * np.linalg.norm(spread, axis=2).mean():.2f} % of the face's width about each person's mean"
        )


def _rest_of(shape: np.ndarray, prior: dict[str, np.ndarray]) -> np.ndarray:
    modes = np.vstack([prior["identity"], prior["expression"], prior["pose"]]) / prior["noise"]
    away = (shape - prior["mean"]) / prior["noise"]
    amounts = np.linalg.solve(modes @ modes.T + np.eye(len(modes)), modes @ away)
    amounts[: len(prior["identity"])] = 0
    return shape - prior["noise"] * (amounts @ modes)


if __name__ == "__main__":
    main()
