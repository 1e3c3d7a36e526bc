"""Expressions transferred between rendered people, compared with the same expressions of the target.

Inside the face's contour.  Landmarks are found by the project's landmarker on the result and on the truth, each picture
by itself, and compared in % of the distance between the outer eye corners.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.image.photos import EXPRESSIONS, METHODS, Score, make_pictures, pairs, rendered, score
from guise.aam.landmarks import interocular, open_landmarker

MAX_LANDMARK_ERROR_PERCENT = 3.0  # % of the distance between the outer eye corners


def measure(options: argparse.Namespace) -> Report:
    """All ordered pairs, six expressions, three methods."""
    scores: dict[str, list[list[Score]]] = {method: [] for method in METHODS}
    errors: dict[str, list[list[float]]] = {method: [] for method in METHODS}
    landmarker = open_landmarker("builtin")

    def found(picture: Picture) -> F64 | None:
        faces = landmarker.detect(picture)
        return np.asarray(max(faces, key=lambda f: f.confidence).points, np.float64) if faces else None

    for first, second in pairs(options.shared, options.quick):
        common.say(f"{first} onto {second}")
        source, target = (rendered(options.shared, name, "neutral") for name in (first, second))
        expressive = [rendered(options.shared, first, name) for name in EXPRESSIONS]
        truths = [rendered(options.shared, second, name) for name in EXPRESSIONS]
        for method in METHODS:
            pictures = make_pictures(method, source, target, expressive)
            scores[method].append([score(p, t) for p, t in zip(pictures, truths, strict=True)])
            errors[method].append(
                [_off(found(p), found(t.rgb)) for p, t in zip(pictures, truths, strict=True)]
            )
    return _report(scores, errors)


def _off(one: F64 | None, two: F64 | None) -> float:
    if one is None or two is None:
        return float("nan")
    return 100 * float(np.linalg.norm(one - two, axis=1).mean() / interocular(two))


def _report(scores: dict[str, list[list[Score]]], errors: dict[str, list[list[float]]]) -> Report:
    report = Report("image.across", "Expressions carried between rendered people")
    psnr = {m: np.array([[s.psnr for s in pair] for pair in scores[m]]) for m in METHODS}
    ssim = {m: np.array([[s.ssim for s in pair] for pair in scores[m]]) for m in METHODS}
    for other in ("ratio", "warp"):
        for what, values, unit in (("PSNR", psnr, "dB"), ("SSIM", ssim, "")):
            own, its = float(values["tents"].mean()), float(values[other].mean())
            report.criteria.append(Criterion(f"{what}, against {other}", own, ">", its, unit))
    off = np.array(errors["tents"])
    report.criteria.append(
        Criterion("landmarks, mean", float(np.nanmean(off)), "<=", MAX_LANDMARK_ERROR_PERCENT, "%")
    )
    report.notes.append(f"No face was found in {int(np.isnan(off).sum())} of {off.size} results.")
    rows = [
        (
            name,
            *(float(v[m][:, k].mean()) for v in (psnr, ssim) for m in METHODS),
            float(np.nanmean(off[:, k])),
        )
        for k, name in enumerate(EXPRESSIONS)
    ]
    columns = ("expression", *(f"{w} {m}" for w in ("PSNR", "SSIM") for m in METHODS), "landmarks, %")
    report.tables.append(Table(f"means over {len(off)} pairs", columns, rows))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
