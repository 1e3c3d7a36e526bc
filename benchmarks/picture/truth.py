"""Swaps of rendered scenes against their ideal: one person's head, hair, light and expression with another's face.

People are enrolled from their clips of speech with the built-in landmarker, and every scene is swapped with default
options and judged by the tool swap_score.py of the shared folder, which explains the figures.  A gain of 1 is perfect,
0 no better than the untouched source.  A scene that the program refuses counts as gain 0 with no frame swapped.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.children import CommandError
from benchmarks.common import Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.picture.program import (
    FAR_FROM_1,
    HIGH,
    LOW,
    WORK,
    alone,
    enrolled,
    judged,
    swapped,
    with_totals,
    worst,
)
from guise.app.measure.figures import mean_of

NAME, TITLE = "picture.truth", "Picture: rendered scenes against their ideal swap"
TOOL = Path("tools") / "swap_score.py"
SCENES = Path("data") / "synthetic" / "swap"
# Figures of the tool, and which of them are bad.
JUDGED = {
    "gain": LOW, "colour": HIGH, "colour_p95": HIGH, "ssim": LOW, "highband": FAR_FROM_1, "shape": HIGH,
    "flicker": HIGH, "outside": HIGH, "untouched": HIGH, "occlusion": HIGH,
}  # fmt: skip
NOT_SWAPPED = "not swapped, %"
COLUMNS = {**JUDGED, NOT_SWAPPED: HIGH}
Row = dict[str, Any]


def scenes(shared: Path) -> list[Path]:
    """Folders of the scenes that have a truth."""
    return sorted(path.parent for path in (shared / SCENES).glob("*/truth.mp4"))


def pair_of(scene: str) -> tuple[str, str]:
    """The person in a scene and the one whose face is shown, from its name.

    >>> pair_of("talk_p01_gets_p07")
    ('p01', 'p07')
    """
    _, person, _, donor = scene.split("_")
    return person, donor


def missing(shared: Path) -> str | None:
    """A sentence about what is needed and not there."""
    for needed in (shared / TOOL, shared / SCENES):
        if not needed.exists():
            return f"{needed} is missing; --shared names the folder that holds tools/ and data/."
    return None


def model(options: argparse.Namespace, person: str) -> Path:
    """A person enrolled from the clip of speech."""
    clip = options.work / "people" / f"{person}.mp4"
    return enrolled(alone(common.synthetic_clip(options.shared, person).video, clip))


def refused(scene: str) -> Row:
    """The row of a scene that was not swapped."""
    without = dict.fromkeys(JUDGED, math.nan)
    return {**without, "scene": scene, "gain": 0.0, "untouched": 1.0, NOT_SWAPPED: 100.0}


def of_scene(scene: Path, options: argparse.Namespace) -> Row:
    """Swap a scene and have it judged."""
    source, identity = (model(options, person) for person in pair_of(scene.name))
    video = alone(scene / "source.mp4", options.work / "scenes" / scene.name / "source.mp4")
    try:
        made = swapped(video, source, identity, video.with_name("swapped.mp4"))
    except CommandError as error:
        common.say(f"{scene.name}: {error}")
        return refused(scene.name)
    command = [sys.executable, options.shared / TOOL, scene, made.video]
    figures = judged(command, video.with_name("figures.json"))
    share = 100 * made.not_swapped / made.frames
    return {"scene": scene.name, **{name: figures[name] for name in JUDGED}, NOT_SWAPPED: share}


def measure(options: argparse.Namespace) -> Report:
    """All scenes."""
    reason = missing(options.shared)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    rows = []
    for scene in scenes(options.shared)[:: 9 if options.quick else 1]:
        rows.append(of_scene(scene, options))
        common.say(str(rows[-1]))
    return summary(rows)


def summary(rows: list[Row]) -> Report:
    """Criteria over the scenes, and a row for each."""
    figures = {name: [row[name] for row in rows] for name in COLUMNS}

    def far(name: str) -> float:
        return worst(figures[name], COLUMNS[name])

    return Report(
        NAME,
        TITLE,
        [
            Criterion("gain, mean", mean_of(figures["gain"]), ">=", 0.25),
            Criterion("gain, worst scene", far("gain"), ">=", 0.10),
            Criterion("colour, worst scene", far("colour"), "<=", 1.6, "Lab"),
            Criterion("95th percentile of colour, worst scene", far("colour_p95"), "<=", 3.5, "Lab"),
            Criterion("shape, worst scene", far("shape"), "<=", 1.2, "% of the face's width"),
            Criterion("SSIM, worst scene", far("ssim"), ">=", 0.90),
            Criterion("high band, least", worst(figures["highband"], LOW), ">=", 0.85),
            Criterion("high band, most", worst(figures["highband"], HIGH), "<=", 1.15),
            Criterion("flicker over the truth's, worst scene", far("flicker"), "<=", 1.15),
            Criterion("pixels of hand and mug, worst scene", far("occlusion"), "<=", 1.5, "Lab"),
            Criterion("outside the face, worst scene (truth: 0.8)", far("outside"), "<=", 0.8),
            Criterion("frames not swapped, by the program's report, worst", far(NOT_SWAPPED), "<=", 0.0, "%"),
            Criterion("frames left as they were, worst scene", 100 * far("untouched"), "<=", 0.0, "%"),
        ],
        [Table("Scenes", ("scene", *COLUMNS), with_totals(rows, "scene", COLUMNS))],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, work=WORK))
