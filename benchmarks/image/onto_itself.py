"""An expression put back onto the neutral picture that it belongs to (figure 15 of Song et al. 2007).

The truth is the expressive picture itself, its skull laid as in the neutral one.  PSNR inside the face's contour.
"""

from __future__ import annotations

import argparse

import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.image.photos import (
    EXPRESSIONS,
    Photo,
    Score,
    aligned_to,
    make_pictures,
    people,
    rendered,
    score,
    smiles,
)

MIN_MARGIN_DB = 3.0  # dB above ratio images


def margins(neutral: Photo, expressive: list[Photo]) -> dict[str, list[Score]]:
    """Scores of each expression by tents and by ratio images."""
    truths = [aligned_to(photo, neutral) for photo in expressive]
    return {
        method: [
            score(picture, truth)
            for picture, truth in zip(
                make_pictures(method, neutral, neutral, expressive), truths, strict=True
            )
        ]
        for method in ("tents", "ratio")
    }


def row(name: str, found: dict[str, list[Score]]) -> tuple[str, float, float, float, float]:
    """PSNR of tents and ratio images in the mean, their difference, and that of the luminance."""
    tents, ratio = (np.array([(s.psnr, s.luminance) for s in found[m]]).mean(0) for m in ("tents", "ratio"))
    return name, float(tents[0]), float(ratio[0]), float(tents[0] - ratio[0]), float(tents[1] - ratio[1])


def measure(options: argparse.Namespace) -> Report:
    """Every synthetic person over six expressions, every real pair."""
    report = Report("image.onto_itself", "Expressions onto their own neutral picture")
    columns = ("who", "tents, dB", "ratio, dB", "margin, dB", "margin of luminance, dB")
    synthetic = []
    for person in people(options.shared, options.quick):
        photos = [rendered(options.shared, person, name) for name in EXPRESSIONS]
        synthetic.append(row(person, margins(rendered(options.shared, person, "neutral"), photos)))
    real = [row(name, margins(a, [b])) for name, (a, b) in smiles(options.shared, options.quick).items()]
    for what, rows in (("synthetic people", synthetic), ("real pairs", real)):
        least = min(rows, key=lambda r: r[3])
        report.criteria.append(
            Criterion(f"least margin of {len(rows)} {what}", least[3], ">=", MIN_MARGIN_DB, "dB")
        )
        share = 100 * float(np.mean([r[3] >= MIN_MARGIN_DB for r in rows]))
        report.notes.append(
            f"{what}: median margin {np.median([r[3] for r in rows]):.2f} dB; "
            f"{share:.0f} % reach {MIN_MARGIN_DB:g} dB; least of the luminance {min(r[4] for r in rows):.2f} dB."
        )
        report.tables.append(Table(what, columns, sorted(rows, key=lambda r: r[3])[:12]))
    return report


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
