"""Swaps between twelve pairs of real people, judged by programs that have no part in them; sheets to judge by eye.

People are enrolled from their clips with the built-in landmarker.  The first seconds of a source are swapped with
default options and judged by the tool illusion.py of the shared folder, which explains the figures (MediaPipe's points
and blendshapes, embeddings of mobilefacenet).  A contact sheet of each pair is written to the folder `sheets` of the
working folder.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.children import PEER_ENVIRONMENT
from benchmarks.common import Clip, Criterion, Report, Table
from benchmarks.landmarks.peers import MISSING
from benchmarks.landmarks.setting import skipped
from benchmarks.picture.program import (
    FAR_FROM_0,
    FAR_FROM_1,
    HIGH,
    LOW,
    WORK,
    beginning,
    enrolled,
    judged,
    swapped,
    with_totals,
    worst,
)
from benchmarks.picture.sheets import contact_sheet
from guise.app.measure.figures import mean_of

NAME, TITLE = "picture.pairs", "Picture: swaps between real people"
TOOL = Path("tools") / "illusion.py"
# (source, donor): across sex, skin, age and light, with glasses and stubble on either side, a fringe, turned heads and
# strong expressions; chosen before the first figure was seen, and kept.
PAIRS = (
    ("room_s18", "address_o1"),
    ("phone_s29", "room_s18"),
    ("talk_r1", "studio_d5"),
    ("address_o3", "talk_r4"),
    ("phone_d13", "webcam_a1"),
    ("studio_d7", "phone_d13"),
    ("talk_r4", "talk_r1"),
    ("webcam_a1", "address_o1"),
    ("studio_d3", "studio_d7"),
    ("talk_r2", "grid_id2_vcd_swwp2s"),
    ("address_o2", "talk_r2"),
    ("grid_lwbsza", "studio_d6"),
)
SOURCE_SECONDS = 5.0
ENROLMENT_SECONDS = 10.0
EXPRESSIONS = {
    "mouth": 0.93,
    "lids": 0.93,
    "brows": 0.85,
    "smile": 0.92,
    "gaze": 0.80,
}  # least mean correlation
GAINS = tuple(f"{name}_gain" for name in EXPRESSIONS)
# Figures of the tool, and which of them are bad.
JUDGED = {
    "chroma": HIGH, "light": HIGH, "sharp": FAR_FROM_0, "seam": FAR_FROM_1, "flicker": HIGH,
    **dict.fromkeys(EXPRESSIONS, LOW), **dict.fromkeys(GAINS, FAR_FROM_1),
    "source": HIGH, "donor": LOW, "found": LOW,
}  # fmt: skip
NOT_SWAPPED = "not swapped, %"
COLUMNS = {**JUDGED, NOT_SWAPPED: HIGH}
Row = dict[str, Any]


def missing(options: argparse.Namespace) -> str | None:
    """A sentence about what is needed and not there."""
    if options.peers_python is None:
        return MISSING.format("MediaPipe")
    for needed in (options.shared / TOOL, options.shared / "data" / "real"):
        if not needed.exists():
            return f"{needed} is missing; --shared names the folder that holds tools/ and data/."
    return None


def video_of(shared: Path, name: str) -> Path:
    """The clip of a person."""
    return next(p for p in (shared / "data" / "real").glob(f"{name}.*") if p.suffix != ".npz")


def cut(options: argparse.Namespace, name: str, seconds: float, folder: str) -> Path:
    """The first seconds of a person's clip."""
    output: Path = options.work / folder / f"{name}.mp4"
    return output if output.exists() else beginning(video_of(options.shared, name), seconds, output)


def of_pair(source: str, donor: str, options: argparse.Namespace) -> Row:
    """Swap a pair, have it judged, and write its sheet."""
    clips = [cut(options, name, ENROLMENT_SECONDS, "people") for name in (source, donor)]
    own, identity = (enrolled(clip) for clip in clips)
    video = cut(options, source, SOURCE_SECONDS, "sources")
    name = f"{source}_from_{donor}"
    made = swapped(video, own, identity, options.work / "pairs" / f"{name}.mp4")
    command = [options.peers_python, options.shared / TOOL, video, made.video, "--donor", clips[1]]
    figures = judged(command, made.video.with_suffix(".json"), PEER_ENVIRONMENT)
    points = common.clip_at(video_of(options.shared, source)).points[: made.frames]
    contact_sheet(Clip(name, video, points), made.video, options.work / "sheets" / f"{name}.png")
    share = 100 * made.not_swapped / made.frames
    return {
        "source <- donor": f"{source} <- {donor}",
        **{name: figures[name] for name in JUDGED},
        NOT_SWAPPED: share,
    }


def measure(options: argparse.Namespace) -> Report:
    """All pairs."""
    reason = missing(options)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    rows = []
    for source, donor in PAIRS[: 1 if options.quick else None]:
        rows.append(of_pair(source, donor, options))
        common.say(str(rows[-1]))
    return summary(rows)


def summary(rows: list[Row]) -> Report:
    """Criteria over the pairs, and a row for each."""
    figures = {name: [row[name] for row in rows] for name in COLUMNS}
    means = {name: mean_of(values) for name, values in figures.items()}

    def far(name: str) -> float:
        return worst(figures[name], COLUMNS[name])

    return Report(
        NAME,
        TITLE,
        [
            Criterion("chroma, mean", means["chroma"], "<=", 3.0, "Lab"),
            Criterion("chroma, worst pair", far("chroma"), "<=", 4.5, "Lab"),
            Criterion("light, mean", means["light"], "<=", 4.0, "Lab"),
            Criterion("light, worst pair", far("light"), "<=", 6.5, "Lab"),
            *(
                Criterion(f"correlation of {name}, mean", means[name], ">=", least)
                for name, least in EXPRESSIONS.items()
            ),
            *(
                Criterion(f"mean gain of {name}, from 1", abs(means[f"{name}_gain"] - 1), "<=", 0.15)
                for name in EXPRESSIONS
            ),
            Criterion("sharpness, farthest from 0", abs(far("sharp")), "<=", 0.3, "octaves"),
            Criterion("similarity to the donor, mean", means["donor"], ">=", 0.70),
            Criterion("similarity to the source, mean", means["source"], "<=", 0.15),
            Criterion("frames not swapped, by the program's report, worst", far(NOT_SWAPPED), "<=", 0.0, "%"),
        ],
        [
            Table(
                "Pairs; nan: the original hardly moves",
                ("source <- donor", *COLUMNS),
                with_totals(rows, "source <- donor", COLUMNS),
            )
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, work=WORK))
