"""Expressions between real people against their own, and raised brows between rendered people.

Smiles: ten people of data/pairs/london get the smile of the next; the truth is their own smile, which is another than
that of the source, so that figures only compare methods.  Mouth: landmarks found on the result and on the truth, in %
of the distance between the outer eye corners; SSIM and MAE of the luminance inside the face.

Brows: surprise carried between rendered people, with landmarks of the raised brows that stay halfway below them, as a
landmarker's do.  Where the target's brows were at rest and the truth shows skin, or halfway up, a second pair would be
darker than the truth and than the brow moved without shading: the mean darkening beyond that of `warp`, in levels.
"""

from __future__ import annotations

import argparse
from itertools import pairwise

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.image.photos import METHODS, Photo, aligned_to, make_pictures, pairs, rendered, score, smiles
from guise.aam.landmarks import interocular, open_landmarker
from guise.aam.landmarks.schemes import LEFT_BROW, LIPS, RIGHT_BROW
from guise.analogy.photo.grid import face_mask
from guise.analogy.photo.pictures import LUMINANCE

NAME, TITLE = "image.crossings", "Smiles against people's own, and raised brows"
CROSSINGS, BROWS = 10, 20
BROW_HALF_HEIGHT_EYES = 0.07  # of the band around brow landmarks, in distances of the outer eye corners
BROW_LAG = 0.5  # of their way up, by which landmarks of raised brows stay below
MAX_DARKENING_LEVELS = 3.0


def crossings(options: argparse.Namespace) -> list[tuple[str, Photo, Photo, Photo, Photo]]:
    """Name, S, S', T and the truth."""
    found = smiles(options.shared, False)
    names = list(found)[: 3 if options.quick else CROSSINGS + 1]
    return [
        (f"{one} onto {other}", *found[one], found[other][0], aligned_to(found[other][1], found[other][0]))
        for one, other in pairwise(names)
    ]


def figures(picture: Picture, truth: Photo, find: object) -> tuple[float, float, float]:
    """Mouth error in %, SSIM, MAE in levels."""
    got = find(picture)  # type: ignore[operator]
    want = find(truth.rgb)  # type: ignore[operator]
    mouth = 100 * float(np.linalg.norm((got - want)[LIPS], axis=1).mean() / interocular(want))
    inside = face_mask(truth.points, (picture.shape[1], picture.shape[0]))
    off = np.abs(picture.astype(np.float64) @ LUMINANCE - truth.rgb.astype(np.float64) @ LUMINANCE)
    return mouth, score(picture, truth).ssim, float(off[inside].mean())


def brow_band(points: F64, shape: tuple[int, ...]) -> Picture:
    """(h, w) 255 within a band around the brows of landmarks (81, 2)."""
    out = np.zeros(shape[:2], np.uint8)
    wide = max(1, round(2 * BROW_HALF_HEIGHT_EYES * float(interocular(points))))
    for brow in (RIGHT_BROW, LEFT_BROW):
        cv2.polylines(out, [np.rint(points[brow]).astype(np.int32)], False, 255, wide)
    return out


def lagging(photo: Photo, rest: Photo) -> Photo:
    """The photo with landmarks of the brows that do not follow them all the way up."""
    points, still = photo.points.copy(), rest.points
    brows = np.concatenate([RIGHT_BROW, LEFT_BROW])
    points[brows] -= BROW_LAG * (photo.points - still)[brows]
    return Photo(photo.rgb, points)


def darkening(made: Picture, rest: Photo, truth: Photo) -> float:
    """Mean levels by which the result is darker than the truth, between brows at rest and where they belong."""
    between = lagging(truth, rest).points
    near = (brow_band(rest.points, made.shape) > 0) | (brow_band(between, made.shape) > 0)
    left = near & (brow_band(truth.points, made.shape) == 0)
    one, two = (cv2.GaussianBlur(p, (0, 0), 1.5).astype(np.float64) @ LUMINANCE for p in (made, truth.rgb))
    return float(np.maximum(two - one, 0)[left].mean())


def measure(options: argparse.Namespace) -> Report:
    """Both."""
    report = Report(NAME, TITLE)
    landmarker = open_landmarker("builtin")

    def find(picture: Picture) -> F64:
        return np.asarray(max(landmarker.detect(picture), key=lambda f: f.confidence).points, np.float64)

    rows, means = [], {}
    cases = crossings(options)
    for method in METHODS:
        got = [figures(make_pictures(method, s, t, [s1])[0], truth, find) for _, s, s1, t, truth in cases]
        means[method] = np.mean(got, axis=0)
        rows.append((method, *means[method]))
    report.tables.append(Table("smiles", ("method", "mouth, %", "SSIM", "MAE, levels"), rows))
    tents, warp = means["tents"], means["warp"]
    report.criteria += [
        Criterion("mouth, against warp", float(tents[0]), "<", float(warp[0]), "%"),
        Criterion("SSIM, against warp", float(tents[1]), ">", float(warp[1])),
        Criterion("MAE, against warp", float(tents[2]), "<", float(warp[2]), "levels"),
    ]
    dark = []
    every = pairs(options.shared, False)
    for first, second in every[:: max(1, len(every) // BROWS)][: 3 if options.quick else BROWS]:
        s, s1 = (rendered(options.shared, first, name) for name in ("neutral", "surprise"))
        t, truth = (rendered(options.shared, second, name) for name in ("neutral", "surprise"))
        low = lagging(s1, s)
        found = [darkening(make_pictures(m, s, t, [low])[0], t, truth) for m in METHODS]
        dark.append((f"{first} onto {second}", *found))
    report.tables.append(Table("raised brows: darkening, levels", ("who", *METHODS), dark))
    worst = max(row[1] - row[3] for row in dark)
    report.criteria.append(
        Criterion("raised brows, most darkening", worst, "<=", MAX_DARKENING_LEVELS, "levels")
    )
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
