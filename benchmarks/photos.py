"""Photos: how long a swap of one photo by another takes, and an enrolment, and what becomes of photos that are hidden.

Processor seconds are those of the whole command, Python's start included.  A face leaks where the detector finds one in
the output, and a recogniser takes what is there for the person of the original.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from benchmarks.deidentify.identity import recogniser
from guise.aam.landmarks import iou
from guise.app.media import Frame
from guise.app.media.images import read_deep
from guise.app.people.found import VideoPeople, people_in_photo
from guise.app.people.recogniser import Recogniser
from guise.common.arrays import U8

NAME, TITLE = "photos", "Photos"
COUNT, MOST_FACES = 40, 5
MIN_SAME = 0.4  # cosine of the recogniser's embeddings, from which two pictures are of one person
MIN_IOU = 0.3  # of boxes in original and output


def measure(options: argparse.Namespace) -> Report:
    """Everything."""
    pairs = options.shared / "data" / "pairs" / "london"
    target, donor = pairs / "001_smile.jpg", pairs / "003_neutral.jpg"
    with tempfile.TemporaryDirectory() as name:
        folder, recognise = Path(name), recogniser(options.shared)
        swap = seconds("swap", target, "--identity", donor, "-o", folder / "out.jpg")[0]
        enrolment = seconds("enroll", donor, "-o", folder / "donor.guise")[0]
        rows = [hidden(photo, folder, recognise) for photo in photos(options.shared)]
    faces = [row for row in rows if row["exit"] == 0 and row["largest drawn"]]
    return Report(
        NAME,
        TITLE,
        [
            Criterion("photo on photo, processor time", swap, "<=", 6.0, "s"),
            Criterion("enrolment of a photo, processor time", enrolment, "<=", 4.0, "s"),
            Criterion(f"of {len(rows)} photos: a face, verified", float(len(faces)), ">=", 38.0),
            Criterion("leaks", float(sum(int(row["leaks"]) for row in rows)), "<=", 0.0),
        ],
        [Table("Photos", tuple(rows[0]), [tuple(row.values()) for row in rows])],
    )


def seconds(*words: str | Path) -> tuple[float, int]:
    """Processor seconds and exit code of a command of Guise."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-m", "guise", *map(str, words), "--force", "-q"], check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.returncode


def photos(shared: Path) -> Iterator[Path]:
    """Natural photos of one to five people, evenly over the folder."""
    files = [
        file
        for file in sorted((shared / "data" / "annotated" / "lfpw").glob("*.jpg"))
        if 1 <= len(people_in_photo(Frame.from_rgb(read_deep(file).rgb8())).people) <= MOST_FACES
    ]
    return iter(files[:: max(1, len(files) // COUNT)][:COUNT])


def hidden(photo: Path, folder: Path, recognise: Recogniser) -> dict[str, float | str]:
    """What becomes of a photo by `guise deidentify`."""
    output = folder / f"{photo.stem}.png"
    took, code = seconds("deidentify", photo, "-o", output)
    before = read_deep(photo).rgb8()
    people = people_in_photo(Frame.from_rgb(before))
    tracks = json.loads(output.with_suffix(".report.json").read_text())["tracks"] if output.exists() else []
    largest = max(tracks, key=lambda track: float(track["width"]), default=None)
    after = read_deep(output).rgb8() if output.exists() else before
    row = {
        "photo": photo.stem, "faces": len(people.people), "exit": code,
        "largest drawn": int(largest is not None and largest["counts"]["swapped"]),
        "drawn": sum(track["counts"]["swapped"] for track in tracks),
        "leaks": leaks(people, before, after, recognise), "seconds": round(took, 1),
    }  # fmt: skip
    common.say(str(row))
    return row


def leaks(people: VideoPeople, before: U8, after: U8, recognise: Recogniser) -> int:
    """How many of the people are found and recognised."""
    count = 0
    seen = people_in_photo(Frame.from_rgb(after)).people
    for person in people.people:
        for other in seen:
            if iou(person.boxes[0], other.boxes[0]) < MIN_IOU:
                continue
            own, drawn = recognise(before, person.points[0]), recognise(after, other.points[0])
            count += own is not None and drawn is not None and float(own @ drawn) >= MIN_SAME
    return count


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
