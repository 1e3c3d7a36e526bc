"""Compute the canonical reference geometry (aam/data/face81.json) from the CC0 sample clips.

    python training/make_reference.py

Near-frontal frames of every sample person are aligned, averaged and made symmetric.  The lips come from the frames with
the widest mouth, so that teeth and the inside of the mouth get pixels of their own.  How the points move when a head
turns to the side (yaw) and up (pitch) is regressed from all frames and made antisymmetric and symmetric.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

from guise.aam.landmarks import MIRROR
from guise.aam.landmarks.schemes import CHIN, LIPS, LOWER_LIP_INNER, NOSE_ROOT, RIGID_WEIGHTS, UPPER_LIP_INNER
from guise.aam.similarity import align

ROOT = Path(__file__).parents[1]


def _frontal(folder: Path) -> np.ndarray:
    truth = np.load(folder / "talk.npz")
    turned = np.abs(truth["yaw_pitch_roll_deg"][:, :2]).max(1)
    return truth["landmarks"][turned < np.quantile(turned, 0.4)].astype(float)


def _aligned_mean(shapes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    mean = shapes[0]
    for _ in range(5):
        shapes = np.stack([align(s, mean).apply(s) for s in shapes])  # type: ignore[union-attr]
        mean = shapes.mean(0)
    return mean, shapes


def _symmetric(shape: np.ndarray) -> np.ndarray:
    centred = shape - shape.mean(0)
    flipped = centred[list(MIRROR)] * [-1, 1]
    upright = align(flipped, centred, scale="symmetric").apply(flipped)  # type: ignore[union-attr]
    mean = (centred + upright) / 2
    axis = mean[NOSE_ROOT] - mean[CHIN]
    angle = np.arctan2(axis[0], -axis[1])
    c, s = np.cos(-angle), np.sin(-angle)
    mean = mean @ np.array([[c, -s], [s, c]]).T
    return (mean + mean[list(MIRROR)] * [-1, 1]) / 2


def _turn_modes(reference: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(81, 2) displacements per degree of yaw and of pitch, in face widths."""
    modes = []
    for folder in sorted((ROOT / "sample_videos").glob("p*")):
        for clip in ("talk", "talk2"):
            truth = np.load(folder / f"{clip}.npz")
            turn = truth["yaw_pitch_roll_deg"][:, :2].astype(float)
            shapes = np.stack(
                [align(s, reference, RIGID_WEIGHTS).apply(s) for s in truth["landmarks"].astype(float)]  # type: ignore[union-attr]
            )
            design = np.column_stack([turn, np.ones(len(turn))])
            fitted = np.linalg.lstsq(design, shapes.reshape(len(shapes), -1), rcond=None)[0]
            modes.append(fitted[:2].reshape(2, -1, 2))
    yaw, pitch = np.mean(modes, axis=0)
    mirrored = [mode[list(MIRROR)] * [-1, 1] for mode in (yaw, pitch)]
    return (yaw - mirrored[0]) / 2, (pitch + mirrored[1]) / 2


def main() -> None:
    means = []
    for folder in sorted((ROOT / "sample_videos").glob("p*")):
        mean, shapes = _aligned_mean(_frontal(folder))
        gap = np.linalg.norm(shapes[:, UPPER_LIP_INNER] - shapes[:, LOWER_LIP_INNER], axis=1)
        mean[LIPS] = shapes[gap >= np.quantile(gap, 0.8)].mean(0)[LIPS]
        means.append(mean)
    shape = _symmetric(_aligned_mean(np.stack(means))[0])
    low, high = shape.min(0), shape.max(0)
    unit = (shape - [(low[0] + high[0]) / 2, low[1]]) / (high[0] - low[0])
    yaw, pitch = _turn_modes(unit)
    out = ROOT / "aam" / "data" / "face81.json"
    content = {
        "scheme": "face81",
        "unit": "face width",
        "points": unit.round(5).tolist(),
        "triangles": Delaunay(
            unit.round(5)
        ).simplices.tolist(),  # stored: ties may be cut otherwise elsewhere
        "yaw_per_degree": yaw.round(7).tolist(),
        "pitch_per_degree": pitch.round(7).tolist(),
    }
    out.write_text(json.dumps(content) + "\n")
    print(out.relative_to(ROOT), "height / width", round(float(unit[:, 1].max()), 3))


if __name__ == "__main__":
    main()
