"""Different light on source and target: how much worse the result becomes when the source is lit otherwise.

Linear light, sRGB's curve taken as a power of 2.2; the fields are smooth.  The growth of the root mean square error
inside the face is compared with that of ratio images.  Light that multiplies S and S' alike leaves their ratio: there
both must hardly grow.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.image.photos import EXPRESSIONS, Photo, make_pictures, pairs, rendered, score

MAX_GROWTH_RATIO = 0.5  # of the growth of ratio images
NEGLIGIBLE_GROWTH_LEVELS = 0.05  # levels
GAMMA = 2.2
Lamp = Callable[[Photo, bool], Photo]  # a photo and whether it is the expressive one


def unchanged_light(photo: Photo, expressive: bool) -> Photo:
    """As it is."""
    return photo


def side_light(photo: Photo, expressive: bool) -> Photo:
    """Light from the image's right, which falls off smoothly over the face, from 1.7 to 0.3."""
    return _lit(photo, 1 + 0.7 * _across(photo))


def moved_light(photo: Photo, expressive: bool) -> Photo:
    """The lamp moved between the pictures, from the image's left to its right."""
    return _lit(photo, 1 + (0.25 if expressive else -0.25) * _across(photo))


def dimmed_light(photo: Photo, expressive: bool) -> Photo:
    """The expressive picture was taken in less light."""
    return _lit(photo, np.full((1, 1, 1), 0.6)) if expressive else photo


def _across(photo: Photo) -> F64:
    """(1, w, 1): -1 on the image's left of the face to 1 on its right."""
    low, high = photo.points[:, 0].min(), photo.points[:, 0].max()
    return np.clip(2 * (np.arange(photo.rgb.shape[1]) - low) / (high - low) - 1, -1, 1)[None, :, None]


def _lit(photo: Photo, field: F64) -> Photo:
    linear = (photo.rgb / 255.0) ** GAMMA * field
    rgb: Picture = np.asarray(np.rint(255 * np.clip(linear, 0, 1) ** (1 / GAMMA)), np.uint8)
    return Photo(rgb, photo.points)


def error(lamp: Lamp, method: str, options: argparse.Namespace) -> float:
    """Mean root mean square error over pairs of rendered people."""
    found = []
    for first, second in pairs(options.shared, options.quick)[::3]:
        source = lamp(rendered(options.shared, first, "neutral"), False)
        expressive = [lamp(rendered(options.shared, first, name), True) for name in EXPRESSIONS]
        pictures = make_pictures(method, source, rendered(options.shared, second, "neutral"), expressive)  # type: ignore[arg-type]
        truths = [rendered(options.shared, second, name) for name in EXPRESSIONS]
        found += [score(p, t).rms for p, t in zip(pictures, truths, strict=True)]
    return float(np.mean(found))


def measure(options: argparse.Namespace) -> Report:
    """Growth of the error by two lamps."""
    report = Report("image.light", "Different light on source and target")
    plain = {method: error(unchanged_light, method, options) for method in ("tents", "ratio")}
    rows = [("as rendered", plain["tents"], plain["ratio"], 0.0, 0.0)]
    lamps = (
        ("from the side", side_light),
        ("less for S'", dimmed_light),
        ("from the other side for S'", moved_light),
    )
    for name, lamp in lamps:
        lit = {method: error(lamp, method, options) for method in ("tents", "ratio")}
        own, its = (lit[m] - plain[m] for m in ("tents", "ratio"))
        rows.append((name, lit["tents"], lit["ratio"], own, its))
        report.criteria.append(
            Criterion(
                f"growth, light: {name}",
                own,
                "<",
                max(MAX_GROWTH_RATIO * its, NEGLIGIBLE_GROWTH_LEVELS),
                "levels",
            )
        )
    columns = ("light on the source", "tents, levels", "ratio, levels", "growth tents", "growth ratio")
    report.tables.append(Table("root mean square error inside the face", columns, rows))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
