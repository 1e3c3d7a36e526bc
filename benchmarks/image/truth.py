"""Expressions put onto pictures of which the truth is known, compared with ratio images and a warp.

Onto itself: an expression put back onto the neutral picture that it belongs to (figure 15 of Song et al. 2007); the
truth is the expressive picture, its skull laid as in the neutral one.  Across: between rendered people, all ordered
pairs; landmarks are found on result and truth, each by itself, and compared in % of the distance between the outer eye
corners.  Light: the same with the source lit otherwise (linear light, sRGB's curve taken as a power of 2.2, smooth
fields): the growth of the root mean square error is compared with that of ratio images.  Light that multiplies S and
S' alike leaves their ratio: there both must hardly grow.  All figures are of the inside of the face's contour.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.image.photos import (
    EXPRESSIONS,
    METHODS,
    Photo,
    Score,
    aligned_to,
    make_pictures,
    pairs,
    people,
    rendered,
    score,
    smiles,
)
from guise.aam.landmarks import interocular, open_landmarker
from guise.analogy.photo import Method

MIN_MARGIN_DB = 3.0  # onto itself, above ratio images
MAX_LANDMARK_ERROR_PERCENT = 3.0  # % of the distance between the outer eye corners
MAX_GROWTH_RATIO = 0.5  # of the growth of ratio images
NEGLIGIBLE_GROWTH_LEVELS = 0.05
GAMMA = 2.2


# -- onto itself ----------------------------------------------------------------------------------------------


def margins(name: str, neutral: Photo, expressive: list[Photo]) -> tuple[str, float, float, float, float]:
    """PSNR of tents and ratio images in the mean, their difference, and that of the luminance."""
    truths, found = [aligned_to(photo, neutral) for photo in expressive], []
    for method in METHODS[:2]:
        made = make_pictures(method, neutral, neutral, expressive)
        scores = [score(picture, truth) for picture, truth in zip(made, truths, strict=True)]
        found.append(np.mean([(one.psnr, one.luminance) for one in scores], axis=0))
    tents, ratio = found
    return name, float(tents[0]), float(ratio[0]), float(tents[0] - ratio[0]), float(tents[1] - ratio[1])


def onto_itself(options: argparse.Namespace, report: Report) -> None:
    """Every synthetic person over six expressions, every real pair."""
    shared, quick = options.shared, options.quick
    synthetic = [
        margins(name, rendered(shared, name, "neutral"), [rendered(shared, name, e) for e in EXPRESSIONS])
        for name in people(shared, quick)
    ]
    real = [margins(name, a, [b]) for name, (a, b) in smiles(shared, quick).items()]
    columns = ("who", "tents, dB", "ratio, dB", "margin, dB", "margin of luminance, dB")
    for what, rows in (("synthetic people", synthetic), ("real pairs", real)):
        rows.sort(key=lambda row: row[3])
        what = f"onto itself, {len(rows)} {what}"
        report.criteria.append(Criterion(f"{what}: least margin", rows[0][3], ">=", MIN_MARGIN_DB, "dB"))
        report.tables.append(Table(what, columns, rows[:12]))


# -- across ---------------------------------------------------------------------------------------------------


def off(one: F64 | None, two: F64 | None) -> float:
    """Mean distance of landmarks, %; NaN where a face was not found."""
    if one is None or two is None:
        return float("nan")
    return 100 * float(np.linalg.norm(one - two, axis=1).mean() / interocular(two))


def across(options: argparse.Namespace, report: Report) -> None:
    """All ordered pairs, six expressions, three methods."""
    scores: dict[Method, list[list[Score]]] = {method: [] for method in METHODS}
    errors: list[list[float]] = []
    landmarker = open_landmarker("builtin")

    def found(picture: Picture) -> F64 | None:
        faces = landmarker.detect(picture)
        return np.asarray(max(faces, key=lambda f: f.confidence).points, np.float64) if faces else None

    for first, second in pairs(options.shared, options.quick):
        common.say(f"{first} onto {second}")
        source, target = (rendered(options.shared, name, "neutral") for name in (first, second))
        expressive, truths = ([rendered(options.shared, n, e) for e in EXPRESSIONS] for n in (first, second))
        for method in METHODS:
            pictures = make_pictures(method, source, target, expressive)
            scores[method].append([score(p, t) for p, t in zip(pictures, truths, strict=True)])
            if method == "tents":
                both = zip(pictures, truths, strict=True)
                errors.append([off(found(p), found(t.rgb)) for p, t in both])
    values = {
        what: {m: np.array([[getattr(s, what) for s in pair] for pair in scores[m]]) for m in METHODS}
        for what in ("psnr", "ssim")
    }
    for other in METHODS[1:]:
        for what, unit in (("psnr", "dB"), ("ssim", "")):
            own, its = (float(values[what][m].mean()) for m in ("tents", other))
            report.criteria.append(Criterion(f"across, {what.upper()} against {other}", own, ">", its, unit))
    away = np.array(errors)
    report.criteria.append(
        Criterion("across, landmarks", float(np.nanmean(away)), "<=", MAX_LANDMARK_ERROR_PERCENT, "%")
    )
    report.notes.append(f"No face was found in {int(np.isnan(away).sum())} of {away.size} results.")
    rows = [
        (
            e, *(float(v[m][:, k].mean()) for v in values.values() for m in METHODS),
            float(np.nanmean(away[:, k])),
        )
        for k, e in enumerate(EXPRESSIONS)
    ]  # fmt: skip
    columns = ("expression", *(f"{w} {m}" for w in ("PSNR", "SSIM") for m in METHODS), "landmarks, %")
    report.tables.append(Table(f"Across: means over {len(away)} pairs", columns, rows))


# -- light ----------------------------------------------------------------------------------------------------


def across_face(photo: Photo) -> F64:
    """(1, w, 1): -1 on the image's left of the face to 1 on its right."""
    low, high = photo.points[:, 0].min(), photo.points[:, 0].max()
    return np.clip(2 * (np.arange(photo.rgb.shape[1]) - low) / (high - low) - 1, -1, 1)[None, :, None]


# What the light is multiplied by, of a photo that is the expressive one or isn't.
Lamp = Callable[[Photo, bool], F64]
LAMPS: dict[str, Lamp] = {
    "as rendered": lambda photo, expressive: np.ones((1, 1, 1)),
    "from the side": lambda photo, expressive: 1 + 0.7 * across_face(photo),
    "less for S'": lambda photo, expressive: np.full((1, 1, 1), 0.6 if expressive else 1.0),
    "from the other side for S'": lambda photo, expressive: (
        1 + (0.25 if expressive else -0.25) * across_face(photo)
    ),
}


def lit(photo: Photo, field: F64) -> Photo:
    """A photo in other light."""
    linear = (photo.rgb / 255.0) ** GAMMA * field
    rgb = np.rint(255 * np.clip(linear, 0, 1) ** (1 / GAMMA)).astype(np.uint8)
    return Photo(rgb, photo.points)


def error(lamp: Lamp, method: Method, options: argparse.Namespace) -> float:
    """Mean root mean square error over pairs of rendered people."""
    found = []
    for first, second in pairs(options.shared, options.quick)[::3]:
        neutral = rendered(options.shared, first, "neutral")
        shown = [rendered(options.shared, first, name) for name in EXPRESSIONS]
        expressive = [lit(photo, lamp(photo, True)) for photo in shown]
        target = rendered(options.shared, second, "neutral")
        pictures = make_pictures(method, lit(neutral, lamp(neutral, False)), target, expressive)
        truths = [rendered(options.shared, second, name) for name in EXPRESSIONS]
        found += [score(p, t).rms for p, t in zip(pictures, truths, strict=True)]
    return float(np.mean(found))


def light(options: argparse.Namespace, report: Report) -> None:
    """Growth of the error by each lamp."""
    rows = [(name, *(error(lamp, method, options) for method in METHODS[:2])) for name, lamp in LAMPS.items()]
    (_, plain, plain_ratio), *others = rows
    for name, tents, ratio in others:
        most = max(MAX_GROWTH_RATIO * (ratio - plain_ratio), NEGLIGIBLE_GROWTH_LEVELS)
        report.criteria.append(Criterion(f"growth, light: {name}", tents - plain, "<", most, "levels"))
    columns = ("light on the source", "tents, levels", "ratio, levels")
    report.tables.append(Table("Light: root mean square error inside the face", columns, rows))


def measure(options: argparse.Namespace) -> Report:
    """All three."""
    report = Report("image.truth", "Expressions onto pictures of which the truth is known")
    for part in (onto_itself, across, light):
        part(options, report)
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
