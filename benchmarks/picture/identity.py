"""Whose face is it, and does it fool: swaps between 24 pairs of people, judged by programs that have no part in them.

People are enrolled from their clips with the built-in landmarker.  The first seconds of a source are swapped and judged
by two tools of the shared folder, which explain the figures: identity.py (which of many people a recogniser takes the
face for) and illusion.py (tone, light, sharpness, expressions by MediaPipe).  A contact sheet of each pair is written
to the folder `sheets` of the working folder.  `--look paper` measures the papers' plain formulas in the same way.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.children import PEER_ENVIRONMENT, ran
from benchmarks.common import Clip, Criterion, Report, Table
from benchmarks.landmarks.peers import MISSING
from benchmarks.landmarks.setting import skipped
from benchmarks.picture.program import (
    FAR_FROM_0,
    FAR_FROM_1,
    HIGH,
    LOW,
    WORK,
    enrolled,
    judged,
    stretch,
    swapped,
    with_totals,
    worst,
)
from benchmarks.picture.sheets import contact_sheet
from guise.app.measure.figures import mean_of

NAME, TITLE = "picture.identity", "Picture: swaps between people, and whose face they show"
ILLUSION, IDENTITY = (Path("tools") / f"{name}.py" for name in ("illusion", "identity"))
# (source, donor): across sex, skin, age and light, with glasses, beards and marks on either side, a fringe, turned
# heads and strong expressions; chosen before the first figure was seen, and kept.  The last four are rendered people.
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
    ("franck", "talk_r2"),
    ("studio_d18", "studio_d3"),
    ("studio_d6", "phone_s29"),
    ("studio_d5", "franck"),
    ("grid_bbaf2n", "grid_pwij3p"),
    ("grid_lbax4n", "talk_r1"),
    ("address_o1", "studio_d18"),
    ("talk_r1", "webcam_a1"),
    ("p13", "p07"),
    ("p02", "p05"),
    ("p14", "p04"),
    ("p06", "p13"),
)
SOURCE_SECONDS = 5.0
ENROLMENT_SECONDS = 10.0
# Least mean correlation of each curve; their gains lie within GAIN_RANGE of 1.
EXPRESSIONS = {"mouth": 0.95, "lids": 0.93, "smile": 0.95, "brows": 0.85, "gaze": 0.85}
GAIN_RANGE = 0.15
GAINS = tuple(f"{name}_gain" for name in EXPRESSIONS)
# Figures of illusion.py, and which of them are bad.
JUDGED = {
    "tone_chroma": HIGH, "tone_light": HIGH, "relight": HIGH, "chroma": HIGH, "light": HIGH,
    "sharp": FAR_FROM_0, "seam": FAR_FROM_1, "flicker": HIGH,
    **dict.fromkeys(EXPRESSIONS, LOW), **dict.fromkeys(GAINS, FAR_FROM_1),
    "source": HIGH, "donor": LOW, "found": LOW,
}  # fmt: skip
# Figures whose mean and worst count, with the most that each may be.
TONES = (
    ("tone_chroma", 1.0, 2.5), ("tone_light", 1.2, 2.5), ("relight", 1.2, math.inf), ("chroma", math.inf, 9.0),
    ("light", math.inf, 16.0),
)  # fmt: skip
NOT_SWAPPED = "not swapped, %"
COLUMNS = {**JUDGED, NOT_SWAPPED: HIGH}
Row = dict[str, Any]


def missing(options: argparse.Namespace) -> str | None:
    """A sentence about what is needed and not there."""
    if options.peers_python is None:
        return MISSING.format("MediaPipe")
    for needed in (ILLUSION, IDENTITY, Path("data") / "real", Path("data") / "synthetic"):
        if not (options.shared / needed).exists():
            return f"{options.shared / needed} is missing; --shared names the folder that holds tools/ and data/."
    return None


def clip_of(shared: Path, name: str) -> Clip:
    """The clip of a person, real or rendered."""
    real = [p for p in (shared / "data" / "real").glob(f"{name}.*") if p.suffix != ".npz"]
    return common.clip_at(real[0], name) if real else common.synthetic_clip(shared, name)


def cut(options: argparse.Namespace, name: str, seconds: float, folder: str) -> Path:
    """The first seconds of a person's clip."""
    output: Path = options.work / folder / f"{name}.mp4"
    return output if output.exists() else stretch(clip_of(options.shared, name).video, output, seconds)


def of_pair(source: str, donor: str, options: argparse.Namespace) -> Row:
    """Swap a pair, have the illusion judged, and write its sheet."""
    clips = [cut(options, name, ENROLMENT_SECONDS, "people") for name in (source, donor)]
    own, identity = (enrolled(clip) for clip in clips)
    video = cut(options, source, SOURCE_SECONDS, "sources")
    output = options.work / options.look / f"{source}__{donor}.mp4"
    made = swapped(video, own, identity, output, "--look", options.look)
    command = [options.peers_python, options.shared / ILLUSION, video, output, "--donor", clips[1]]
    figures = judged(command, output.with_suffix(".json"), PEER_ENVIRONMENT)
    points = clip_of(options.shared, source).points[: made.frames]
    contact_sheet(Clip(output.stem, video, points), output, output.parent / "sheets" / f"{output.stem}.png")
    share = 100 * made.not_swapped / made.frames
    return {"pair": output.stem, **{name: figures[name] for name in JUDGED}, NOT_SWAPPED: share}


def taken_for(options: argparse.Namespace) -> dict[str, Any]:
    """What identity.py says of all swaps: `donor` and `source`, the shares taken for them, `margin` and `rows`."""
    data, output = options.shared / "data", options.work / options.look / "identity.json"
    command = [
        options.peers_python, options.shared / IDENTITY, output.parent, "--json", output,
        "--people", data / "real", data / "synthetic" / "people", "--cache", options.work / "people.npz",
    ]  # fmt: skip
    ran(command, environment=PEER_ENVIRONMENT)
    found: dict[str, Any] = json.loads(output.read_text())
    return found


def measure(options: argparse.Namespace) -> Report:
    """All pairs."""
    reason = missing(options)
    if reason is not None:
        return skipped(NAME, TITLE, reason)
    rows = []
    for source, donor in PAIRS[: 1 if options.quick else None]:
        rows.append(of_pair(source, donor, options))
        common.say(str(rows[-1]))
    return summary(rows, taken_for(options))


def summary(rows: list[Row], found: dict[str, Any]) -> Report:
    """Criteria over the pairs, and a row for each."""
    figures = {name: [row[name] for row in rows] for name in COLUMNS}
    means = {name: mean_of(values) for name, values in figures.items()}
    taken = {row["pair"]: row["taken_for"] for row in found["rows"]}

    def far(name: str) -> float:
        return worst(figures[name], COLUMNS[name])

    return Report(
        NAME,
        TITLE,
        [
            Criterion("taken for the donor", found["donor"], ">=", 0.95, "share"),
            Criterion("taken for the source", found["source"], "<=", 0.05, "share"),
            Criterion("margin, donor - source", found["margin"], ">=", 0.28),
            *(
                Criterion(f"{name}, {which}", value, "<=", most)
                for name, mean, most_of_all in TONES
                for which, value, most in (("mean", means[name], mean), ("worst", far(name), most_of_all))
            ),
            *(
                Criterion(f"correlation of {name}, mean", means[name], ">=", least)
                for name, least in EXPRESSIONS.items()
            ),
            *(
                Criterion(f"mean gain of {name}, from 1", abs(means[f"{name}_gain"] - 1), "<=", GAIN_RANGE)
                for name in EXPRESSIONS
            ),
            Criterion(
                "sharpness, absolute mean", mean_of([abs(v) for v in figures["sharp"]]), "<=", 0.25, "octaves"
            ),
            Criterion("flicker, mean", means["flicker"], "<=", 1.05),
            Criterion("frames not swapped, by the program's report, worst", far(NOT_SWAPPED), "<=", 0.0, "%"),
        ],
        [
            Table(
                "Pairs; nan: the original hardly moves",
                ("pair", *COLUMNS),
                with_totals(rows, "pair", COLUMNS),
            ),
            Table("Taken for", ("pair", "taken for"), list(taken.items())),
        ],
    )


def parser() -> argparse.ArgumentParser:
    """With the look."""
    made = common.arguments(__doc__, work=WORK)
    made.add_argument("--look", choices=("swap", "paper"), default="swap", help="how the face is drawn")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
