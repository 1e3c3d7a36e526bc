"""What the tool that judges real pairs says of the ideal: rendered swaps and their exact truth, side by side.

`picture.identity` has no truth, and even a perfect swap keeps the source's hair, outline, expression and light, which
an embedding sees too.  Here the same tool (illusion.py of the shared folder) judges the ideal swap of each rendered
scene and the program's: what the ideal does not reach, no program has to.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from benchmarks import common
from benchmarks.children import PEER_ENVIRONMENT
from benchmarks.common import Criterion, Report, Table
from benchmarks.landmarks.setting import skipped
from benchmarks.picture import identity, truth
from benchmarks.picture.program import WORK, alone, judged, swapped
from guise.app.measure.figures import mean_of

NAME, TITLE = "picture.ideal", "Picture: the judge of real pairs on swaps whose ideal is known"
COLUMNS = tuple(identity.JUDGED)
KINDS = "ideal", "swapped"
MAX_LOSS = 0.05  # of similarity and of correlations, against the ideal's
Row = dict[str, float]


def of_scene(scene: Path, options: argparse.Namespace) -> dict[str, Row]:
    """The figures of a scene's ideal and of its swap."""
    person, donor = truth.pair_of(scene.name)
    source, identity = (truth.model(options, name) for name in (person, donor))
    video = alone(scene / "source.mp4", options.work / "ideal" / scene.name / "source.mp4")
    made = swapped(video, source, identity, video.with_name("swapped.mp4")).video
    rows = {}
    for kind, shown in zip(KINDS, (scene / "truth.mp4", made), strict=True):
        command = [options.peers_python, options.shared / identity.ILLUSION, video, shown]
        command += ["--donor", identity.with_suffix(".mp4")]
        figures = judged(command, video.with_name(f"{kind}.json"), PEER_ENVIRONMENT)
        rows[kind] = {name: figures[name] for name in COLUMNS}
    return rows


def measure(options: argparse.Namespace) -> Report:
    """All scenes."""
    reason = identity.missing(options) or truth.missing(options.shared)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    found = {}
    for scene in truth.scenes(options.shared)[:: 9 if options.quick else 1]:
        found[scene.name] = of_scene(scene, options)
        common.say(f"{scene.name}: {found[scene.name]}")
    return summary(found)


def loss(found: dict[str, dict[str, Row]], name: str) -> float:
    """Mean of the ideal's figure less the swap's, over the scenes where both have one."""
    differences = [rows["ideal"][name] - rows["swapped"][name] for rows in found.values()]
    return mean_of([x for x in differences if math.isfinite(x)])


def summary(found: dict[str, dict[str, Row]]) -> Report:
    """What the swaps lack of the ideal, and both rows of each scene."""
    lines = [
        (scene, kind, *(rows[kind][name] for name in COLUMNS))
        for scene, rows in found.items()
        for kind in KINDS
    ]
    means = [
        ("mean", kind, *(mean_of([rows[kind][name] for rows in found.values()]) for name in COLUMNS))
        for kind in KINDS
    ]
    return Report(
        NAME,
        TITLE,
        [
            Criterion("similarity to the donor, below the ideal's", loss(found, "donor"), "<=", MAX_LOSS),
            Criterion("similarity to the source, above the ideal's", -loss(found, "source"), "<=", MAX_LOSS),
            *(
                Criterion(f"correlation of {name}, below the ideal's", loss(found, name), "<=", MAX_LOSS)
                for name in identity.EXPRESSIONS
            ),
        ],
        [Table("Scenes; nan: the original hardly moves", ("scene", "what", *COLUMNS), [*lines, *means])],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, work=WORK))
