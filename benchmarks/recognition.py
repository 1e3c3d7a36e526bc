"""Recognition: are two enrolments taken for one person when they are, and never when they are not?

Parts of clips (halves, thirds of the long one) are enrolled with the built-in landmarker and few frames, as
de-identification does, and all pairs compared.  The threshold of guise.aam.recognition was chosen on these pairs; the
photographs of people who are for evaluation only, neutral against smiling, were not looked at for it.
"""

from __future__ import annotations

import argparse
import re
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import Criterion, Report, Table
from guise.aam.appearance import sample_texture
from guise.aam.landmarks import Landmarker, open_landmarker, track_video
from guise.aam.model import Identity
from guise.aam.recognition import (
    MIN_SAME_PERSON_SIMILARITY,
    SIGNATURE_RESOLUTION,
    cosine_similarity,
    signature,
    signature_of,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.training import TrainingOptions
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.media import open_input
from guise.common.arrays import F32

OPTIONS = TrainingOptions(frames=48)
# Clips of one person under different names.
ONE_PERSON = {
    "webcam_a": "webcam", "address_o": "address", "grid_pwij3p": "grid_id2", "grid_id2": "grid_id2"
}  # fmt: skip
UNKNOWN = ("gesture_", "street_")  # who is who is not known


@dataclass(frozen=True, eq=False)
class Enrolment:
    """A part of a clip: its name, the clip, the person, the signature (64,)."""

    name: str
    clip: str
    person: str
    signature: F32


@dataclass(frozen=True)
class Pair:
    """Two enrolments, how like they are, and whether they are of one person, and of one clip."""

    names: tuple[str, str]
    similarity: float
    same: bool
    within: bool


def person_of(clip: str) -> str:
    """Who is in a clip.

    >>> person_of("webcam_a2"), person_of("p03/talk2"), person_of("talk_r1")
    ('webcam', 'p03', 'talk_r1')
    """
    for start, person in ONE_PERSON.items():
        if clip.startswith(start):
            return person
    return re.sub(r"/talk\d?$", "", clip)


def clips(shared: Path) -> Iterator[tuple[str, Path, int]]:
    """Name, video and number of parts of every clip."""
    for person in common.synthetic_people(shared):
        for take in ("talk", "talk2"):
            yield f"{person}/{take}", common.synthetic_clip(shared, person, take).video, 1
    for video in sorted((shared / "data" / "real").glob("*.mp*")):
        if not video.stem.startswith(UNKNOWN):
            yield video.stem, video, 3 if video.stem == "franck" else 2


def enrolments(name: str, video: Path, parts: int, landmarker: Landmarker) -> Iterator[Enrolment]:
    """The parts of a clip."""
    with open_input(video) as source:
        points = track_video(landmarker, (frame.rgb() for frame in source))
    edges = np.linspace(0, len(points), parts + 1).round().astype(int)
    for k in range(parts):
        kept = np.full_like(points, np.nan)
        kept[edges[k] : edges[k + 1]] = points[edges[k] : edges[k + 1]]
        yield Enrolment(f"{name}.{k + 1}", name, person_of(name), signature(enrolled(video, kept)))


def enrolled(video: Path, points: F32) -> Identity:
    """A person enrolled on found points (t, 81, 2)."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "landmarks.npz"
        np.savez(file, face81=points)
        return enrol([video], LandmarkSource(files=[file]), name=video.stem, options=OPTIONS)


def photographs(shared: Path, landmarker: Landmarker) -> Iterator[Enrolment]:
    """The people for evaluation only, neutral and smiling."""
    folder, frame = shared / "data" / "pairs" / "london", ReferenceFrame.canonical(SIGNATURE_RESOLUTION)
    for person in (folder / "evaluation_only.txt").read_text().split():
        for look in ("neutral", "smile"):
            picture = cv2.imread(str(folder / f"{person}_{look}.jpg"))
            if picture is None:
                continue
            rgb = np.ascontiguousarray(picture[..., ::-1])
            for face in landmarker.detect(np.asarray(rgb, np.uint8))[:1]:
                texture = sample_texture(np.asarray(rgb, np.uint8), face.points.astype(float), frame)
                yield Enrolment(f"{person} {look}", look, person, signature_of(texture))


def pairs(people: Sequence[Enrolment]) -> list[Pair]:
    """All pairs."""
    return [
        Pair(
            (a.name, b.name),
            cosine_similarity(a.signature, b.signature),
            a.person == b.person,
            a.clip == b.clip,
        )
        for a, b in combinations(people, 2)
    ]


def row(what: str, found: Sequence[Pair], same: bool) -> tuple[object, ...]:
    """What, pairs, how many are decided wrongly, the share, and the mean and the worst similarity."""
    values = np.array([p.similarity for p in found])
    wrong = int(
        ((values < MIN_SAME_PERSON_SIMILARITY) if same else (values >= MIN_SAME_PERSON_SIMILARITY)).sum()
    )
    worst = min(found, key=lambda p: p.similarity if same else -p.similarity)
    return (
        what,
        len(found),
        wrong,
        100 * wrong / len(found),
        float(values.mean()),
        worst.similarity,
        " / ".join(worst.names),
    )


def measure(options: argparse.Namespace) -> Report:
    """Clips and photographs."""
    landmarker = open_landmarker("builtin")
    people: list[Enrolment] = []
    for name, video, parts in list(clips(options.shared))[: 4 if options.quick else None]:
        people += enrolments(name, video, parts, landmarker)
        common.say(name)
    return summary(pairs(people), pairs(list(photographs(options.shared, landmarker))), len(people))


def summary(found: list[Pair], photos: list[Pair], enrolled: int) -> Report:
    """Rates of wrong merges and of missed ones."""
    groups = [
        ("one person, parts of one clip", [p for p in found if p.same and p.within], True),
        ("one person, different clips", [p for p in found if p.same and not p.within], True),
        ("different people", [p for p in found if not p.same], False),
        ("one person, photographs, neutral and smiling", [p for p in photos if p.same], True),
        ("different people, photographs", [p for p in photos if not p.same], False),
    ]
    rows = [row(what, group, same) for what, group, same in groups if group]
    share = {str(r[0]): float(str(r[3])) for r in rows}
    columns = ("pairs", "number", "decided wrongly", "%", "mean similarity", "worst", "worst pair")
    return Report(
        "recognition",
        f"Recognition: {enrolled} enrolments, one person from a similarity of {MIN_SAME_PERSON_SIMILARITY}",
        [
            Criterion(
                "different people taken for one", share.get("different people", float("nan")), "<=", 0.1, "%"
            ),
            Criterion("the same, photographs", share["different people, photographs"], "<=", 0.1, "%"),
            Criterion(
                "a person missed, parts of one clip",
                share.get("one person, parts of one clip", float("nan")),
                "<=",
                5,
                "%",
            ),
        ],
        [Table("Pairs", columns, rows)],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
