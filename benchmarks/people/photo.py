"""One photo of a person against a clip of them: what is lost when either is shown on somebody else.

Each of seven rendered people is enrolled from the photo neutral.jpg and from the clip talk.mp4, and shown on the first
seconds of talk2.mp4 of the next one.  Both swaps are judged by the tool illusion.py of the shared folder, against the
person's clip.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from benchmarks import common
from benchmarks.children import GUISE, PEER_ENVIRONMENT, ran
from benchmarks.common import Criterion, Report, Table
from benchmarks.landmarks.peers import MISSING
from benchmarks.landmarks.setting import skipped
from benchmarks.picture.pairs import TOOL
from benchmarks.picture.program import WORK, alone, beginning, enrolled, judged, swapped
from guise.app.measure.figures import mean_of

NAME, TITLE = "people.photo", "People: one photo against a clip"
PEOPLE = tuple(f"p0{number}" for number in range(1, 8))
SOURCE_SECONDS = 3.0
JUDGED = ("donor", "chroma", "light", "mouth", "lids", "sharp")
LEAST_SHARE = 0.85  # of the clip's likeness
MOST_WORSE = 0.25  # Lab, by which chroma and light may exceed the clip's without being worse than its noise


def of_person(name: str, other: str, options: argparse.Namespace) -> dict[str, Any]:
    """The figures of both swaps of a person onto another."""
    folder: Path = options.shared / "data" / "synthetic" / "people"
    clip = alone(folder / name / "talk.mp4", options.work / "people" / f"{name}.mp4")
    photo = alone(folder / name / "neutral.jpg", options.work / "people" / f"{name}_photo.jpg")
    if not photo.with_suffix(".guise").exists():
        ran([*GUISE, "enroll", photo, "-o", photo.with_suffix(".guise"), "--quiet"])
    own = enrolled(alone(folder / other / "talk.mp4", options.work / "people" / f"{other}.mp4"))
    video = options.work / "sources" / f"{other}.mp4"
    video = video if video.exists() else beginning(folder / other / "talk2.mp4", SOURCE_SECONDS, video)
    row: dict[str, Any] = {"shown <- on": f"{name} <- {other}"}
    for kind, face in (("clip", enrolled(clip)), ("photo", photo.with_suffix(".guise"))):
        made = swapped(video, own, face, options.work / "pairs" / f"{name}_{kind}_on_{other}.mp4")
        command = [options.peers_python, options.shared / TOOL, video, made.video, "--donor", clip]
        figures = judged(command, made.video.with_suffix(".json"), PEER_ENVIRONMENT)
        row |= {f"{figure}, {kind}": figures[figure] for figure in JUDGED}
    return row


def measure(options: argparse.Namespace) -> Report:
    """All seven people."""
    if options.peers_python is None:
        return skipped(NAME, TITLE, MISSING.format("MediaPipe"))
    people = PEOPLE[: 1 if options.quick else None]
    rows = []
    for place, name in enumerate(people):
        rows.append(of_person(name, PEOPLE[(place + 1) % len(PEOPLE)], options))
        common.say(str(rows[-1]))
    means = {column: mean_of([row[column] for row in rows]) for column in rows[0] if column != "shown <- on"}
    shares = [row["donor, photo"] / row["donor, clip"] for row in rows]
    return Report(
        NAME,
        TITLE,
        [
            Criterion("likeness of the photo's, of the clip's, mean", mean_of(shares), ">=", LEAST_SHARE),
            Criterion("the same, worst person", min(shares), ">=", LEAST_SHARE),
            *(
                Criterion(
                    f"{name}, photo's above the clip's", means[f"{name}, photo"] - means[f"{name}, clip"],
                    "<=", MOST_WORSE, "Lab",
                )
                for name in ("chroma", "light")
            ),
        ],
        [Table("People", tuple(rows[0]), [tuple(row.values()) for row in rows])],
    )  # fmt: skip


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__, work=WORK))
