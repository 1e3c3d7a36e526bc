"""Learn how a face looks from the side, by how it looks from the front, from rendered people.

    python -m training.views --turns PARTS

PARTS is the output of `render_turns.py`.  The shipped landmarker finds the points, so that textures lie as in real
clips.  Every fifth person is held back and measured: the share of the changes' variance that is explained.
Writes `aam/data/views.npz`, see `ViewPrior`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from guise.aam.appearance import face_region
from guise.aam.landmarks import Face, open_landmarker
from guise.aam.mirror import mirror_image
from guise.aam.reference import ReferenceFrame
from guise.aam.solid_shape import SolidPrior
from guise.aam.view_prior import DATA, RESOLUTION, TURNS, features, mirrored
from guise.aam.view_textures import LIMITS, TurnedFaces, changing, seen_share, without_light
from guise.common.arrays import F32, F64, U8, Int

REFERENCE = ReferenceFrame.canonical(RESOLUTION)
MAX_MISS_FACE_WIDTHS = 0.06  # mean distance from the truth, beyond which the true points are taken
HELD_OUT = 5  # every so manieth person
SHADES, SHAPES, CHANGES = 120, 20, 40  # components kept of shades, of shapes, of what is predicted
RIDGE = 0.2  # for each sample


def faces(path: Path) -> list[tuple[U8, F64]]:
    """The pictures of a person and the points found in them."""
    landmarker, found = open_landmarker("builtin"), []
    with np.load(path) as file:
        data = {name: file[name] for name in file.files}
    ends = np.cumsum(data["length"])
    for end, length, exact in zip(ends, data["length"], data["face81"].astype(np.float64), strict=True):
        coded = data["jpeg"][end - length : end]
        picture = cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        face = landmarker.refine(picture, Face.around(exact, 1.0))
        points = exact if face is None else face.points.astype(np.float64)
        if np.linalg.norm(points - exact, axis=1).mean() > MAX_MISS_FACE_WIDTHS * np.ptp(exact[:, 0]):
            points = exact
        found.append(face_region(np.asarray(picture, np.uint8), points, REFERENCE))
    return found


def rows(path: Path) -> list[tuple[F32, F32, F32]]:
    """Of a person and of their mirror image: inputs (f,), changes (turns, n) and how far they are seen (turns, n)."""
    found = faces(path)
    front = len(found) // 2
    rest = found[front][1]
    turned = TurnedFaces.of(found, rest, REFERENCE)
    shares = np.array([seen_share(seen) * changing(REFERENCE) for seen in turned.seen])
    logs = turned.logs
    changes = np.array([
        without_light(log - logs[front], seen, REFERENCE) for log, seen in zip(logs, turned.seen, strict=True)
    ])  # fmt: skip
    luma = np.exp(logs[front]) - np.float32(LIMITS.black_grey_levels)
    solid = SolidPrior.shipped().rest_of(rest).rest
    right, left = slice(front + 1, None), slice(front - 1, None, -1)
    return [
        (features(luma, solid, REFERENCE), changes[right], shares[right]),
        (
            features(_mirrored(luma), mirrored(solid), REFERENCE),
            *(np.array([_mirrored(row) for row in some[left]]) for some in (changes, shares)),
        ),
    ]


def _mirrored(values: F32) -> F32:
    return mirror_image(REFERENCE.scatter(values), REFERENCE, 1)[REFERENCE.mask]


def learn(inputs: F32, changes: F32) -> dict[str, np.ndarray]:
    """The arrays of `ViewPrior` from inputs (m, f) and changes (m, turns, n)."""
    centre, pixels = inputs.mean(0), len(REFERENCE.pixels)
    parts = np.split(inputs - centre, [pixels], axis=1)
    axes = [_whitening(part, count) for part, count in zip(parts, (SHADES, SHAPES), strict=True)]
    shades = axes[0].shape[1]
    basis = np.zeros((inputs.shape[1], shades + axes[1].shape[1]), np.float32)
    basis[:pixels, :shades], basis[pixels:, shades:] = axes
    known = np.column_stack([np.ones(len(inputs)), (inputs - centre) @ basis])
    damping = RIDGE * len(known) * np.eye(known.shape[1])
    damping[0, 0] = 0
    weights = np.linalg.solve(known.T @ known + damping, known.T @ changes.reshape(len(changes), -1))
    _, _, kept = np.linalg.svd(known @ weights, full_matrices=False)
    kept = kept[:CHANGES]
    levels, scales = _levels(basis)
    change_levels, change_scales = _levels(kept.T)
    return {
        "centre": centre.astype(np.float16),
        "basis": levels,
        "scale_basis": scales,
        "weights": (weights @ kept.T).astype(np.float16),
        "changes": change_levels.T,
        "scale_changes": change_scales,
    }


def _whitening(part: F32, count: int) -> F32:
    """(f, count) what makes of centred rows (m, f) their leading components with variance 1; fewer of few rows."""
    _, lengths, axes = np.linalg.svd(part, full_matrices=False)
    count = min(count, len(part) // 2)
    return np.asarray(axes[:count].T / (lengths[:count] / np.sqrt(len(part))), np.float32)


def _levels(columns: F32) -> tuple[np.ndarray, np.ndarray]:
    """Columns (f, k) in 8 bits, and the scales (k,) of these."""
    scales = np.abs(columns).max(0) / 127
    return np.round(columns / scales).astype(np.int8), scales.astype(np.float32)


def explained(arrays: dict[str, np.ndarray], inputs: F32, changes: F32, shares: F32) -> list[float]:
    """Share of the changes' variance that is explained at each turn."""
    known = (inputs - arrays["centre"].astype(np.float32)) @ (arrays["basis"] * arrays["scale_basis"])
    made = arrays["weights"][0] + known @ arrays["weights"][1:].astype(np.float32)
    made = (made @ (arrays["changes"] * arrays["scale_changes"][:, None])).reshape(changes.shape)
    left, all_ = ((shares * np.square(what)).sum((0, 2)) for what in (changes - made, changes))
    return [float(x) for x in 1 - left / all_]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=DATA)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    found = [
        (*row, i) for i, path in enumerate(sorted(given.turns.glob("person_*.npz"))) for row in rows(path)
    ]
    inputs, changes, shares = (np.array([row[i] for row in found], np.float32) for i in range(3))
    who: Int = np.array([row[3] for row in found])
    held = who % HELD_OUT == 0
    shown = explained(learn(inputs[~held], changes[~held]), inputs[held], changes[held], shares[held])
    print(", ".join(f"{turn:.0f} degrees {share:.3f}" for turn, share in zip(TURNS, shown, strict=True)))
    np.savez_compressed(given.out, **learn(inputs, changes))
    print(f"{who.max() + 1} people; {given.out.name} {given.out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
