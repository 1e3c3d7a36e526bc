"""Re-identification of de-identified videos by a face recogniser (models/mobilefacenet.onnx).

Every clip of one person who looks at the camera is de-identified with default options.  The gallery holds all people of
the data: those of the real clips, of the pairs, and the rendered ones, among whom are the donors; the clip's own person
is told by every second sampled frame of the original.  As the donors are the best match of every swapped face, rank 1
is told without rendered people too, which is the harder question: who of the real people is it?

Faces are looked at by the landmarks of the original and by those that are found in the output; the higher score counts.

The criteria are over the real clips.  Rendered people are in the table, each with another donor than themselves: to the
recogniser they look alike before anything is swapped, and none of them can be harmed.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import guise.app as app
from benchmarks import common
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.deidentify.guise import deidentified
from benchmarks.deidentify.swapped import frontal
from benchmarks.embeddings import TEMPLATE, spread
from benchmarks.landmarks.clips import real_clips
from guise.aam.landmarks import open_landmarker
from guise.app.measure.faces import FaceTrack, relocate
from guise.app.measure.job import FaceMatcher, MatchScores
from guise.app.measure.people import Gallery, Subject, embeddings_in, embeddings_of
from guise.app.measure.privacy import rank, rank_one, template
from guise.app.media import open_input
from guise.app.people.recogniser import Recogniser, RecogniserCard
from guise.app.swapping.donors import gallery
from guise.common.arrays import F32

SAMPLED_FRAMES = 80  # of each clip
CLIPS_OF_ONE_PERSON = ("address_o", "webcam_a")  # prefixes of clips' names
OTHER_CLIPS = {"grid_pwij3p": "grid_id2_vcd_swwp2s"}  # that show the same person
GALLERY = Path(app.__file__).parent / "gallery"
RENDERED = "rendered "  # prefix of the names of fictional people


def recogniser(shared: Path) -> Recogniser:
    """The recogniser of shared/models."""
    model = shared / "models" / "mobilefacenet.onnx"
    return Recogniser(
        RecogniserCard(
            path=model, name="mobilefacenet", model=model, size=(112, 112),
            mean=(127.5,), scale=(1 / 127.5,), template=TEMPLATE,
        )
    )  # fmt: skip


def person_of(video: Path) -> str:
    """Whom a clip shows."""
    if video.parent.parent.name == "people":
        return RENDERED + video.parent.name
    stem = OTHER_CLIPS.get(video.stem, video.stem)
    return next((name for name in CLIPS_OF_ONE_PERSON if stem.startswith(name)), stem)


def pictures(shared: Path) -> Iterator[tuple[str, Path]]:
    """Each person's name with a picture or clip, over all data."""
    data = shared / "data"
    for clip in real_clips(shared):
        yield person_of(clip.video), clip.video
    for file in sorted((data / "pairs" / "london").glob("*.jpg")):
        yield f"london {file.stem.split('_')[0]}", file
    for file in sorted((data / "pairs" / "yale").glob("*.png")):
        yield f"yale {file.stem.split('.')[0]}", file
    for file in sorted((data / "synthetic" / "people").glob("*/talk.mp4")):
        yield person_of(file), file


def everybody(shared: Path, recognise: Recogniser) -> list[Subject]:
    """The people of the gallery; crowds and faces that are too small are left out."""
    found: dict[str, list[F32]] = defaultdict(list)
    landmarker = open_landmarker("builtin")
    for name, file in pictures(shared):
        if not name.startswith(("street_", "gesture_")):
            found[name] += embeddings_of(file, landmarker, recognise, common.say)
    return [Subject(name, np.stack(rows)) for name, rows in found.items() if rows]


@dataclass(frozen=True, eq=False)
class Outcome:
    """A clip's scores.

    Parameters
    ----------
    own, unswapped : (n,) scores of the output's and of the original's faces with the source.
    ranks : ranks 1 of the output's faces among all, and among all who are real.
    place, of : of the source among the real people when all faces are averaged.
    """

    video: Path
    donor: str
    own: F64
    unswapped: F64
    ranks: tuple[float, float]
    place: int
    of: int


def judged(video: Path, people: list[Subject], recognise: Recogniser) -> Outcome:
    """De-identify a clip and look for its person."""
    face = sampled(video)
    with open_input(video) as source:
        own = embeddings_in(source, [face], recognise)[0]
    others = [one for one in people if one.name != person_of(video)]
    judge = FaceMatcher(recognise, Gallery.of(others), [(face, own)], [])
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / f"{video.parent.name}_{video.name}"
        report = deidentified(video, output.with_suffix(".mp4"), *others_than(person_of(video)))
        with open_input(output.with_suffix(".mp4")) as source:
            again = relocate(source, [face], open_landmarker("builtin"))
        after = judge.scores(output.with_suffix(".mp4"), again)[0]
    real = [0, *(i + 1 for i, one in enumerate(others) if not one.name.startswith(RENDERED))]
    return outcome(
        video, report["tracks"], after, own, real, [template(own[::2]), *(o.template for o in others)]
    )


def others_than(person: str) -> list[str]:
    """Options that leave a rendered person out of the donors."""
    if not person.startswith(RENDERED):
        return []
    names = [name for name in gallery() if name != person.removeprefix(RENDERED)]
    return [word for name in names for word in ("--gallery", str(GALLERY / f"{name}.guise"))]


def outcome(
    video: Path,
    tracks: list[dict[str, str]],
    after: MatchScores,
    own: np.ndarray,
    real: list[int],
    templates: list[F64],
) -> Outcome:
    """A clip's scores from those of its faces with all people, the source first; `real`: columns of real people."""
    none = np.zeros(len(after.own), int)
    ranks = rank_one(after.every, none), rank_one(after.every[:, real], none)
    together = np.stack(templates)[real] @ template(after.embeddings)
    donor = ", ".join(sorted({Path(track["donor"]).stem for track in tracks if track["donor"]}))
    return Outcome(video, donor, after.own, own[1::2] @ templates[0], ranks, rank(together, 0), len(real))


def sampled(video: Path) -> FaceTrack:
    """A clip's face, from the landmarks beside it, in some of its frames."""
    clip = common.clip_at(video)
    face = FaceTrack(np.arange(len(clip.points), dtype=np.int32), clip.points.astype(np.float32))
    known = np.flatnonzero(np.isfinite(face.points).all(axis=(1, 2)))
    some = known[spread(len(known), SAMPLED_FRAMES)]
    return FaceTrack(face.frames[some], face.points[some])


def measure(options: argparse.Namespace) -> Report:
    """All clips."""
    recognise = recogniser(options.shared)
    people = everybody(options.shared, recognise)
    common.say(f"{len(people)} people")
    outcomes = []
    for video in frontal(options.shared)[:: 8 if options.quick else 1]:
        outcomes.append(judged(video, people, recognise))
        common.say(str(row(outcomes[-1])))
    return summary(outcomes, len(people))


def row(one: Outcome) -> tuple[object, ...]:
    """A line of the table."""
    name = one.video.stem if one.video.stem != "talk2" else f"{one.video.parent.name}/talk2"
    return (
        name, one.donor, float(one.own.mean()), float(np.percentile(one.own, 99)), float(one.unswapped.mean()),
        100 * one.ranks[0], 100 * one.ranks[1], f"{one.place} of {one.of}",
    )  # fmt: skip


def summary(outcomes: list[Outcome], people: int) -> Report:
    """Criteria over the faces of all real clips, each with the same weight, and a row for each clip."""
    real = [one for one in outcomes if not person_of(one.video).startswith(RENDERED)]
    scores = np.concatenate([one.own for one in real])
    weights = np.concatenate([np.full(len(one.own), 1 / len(one.own)) for one in real])
    p99 = float(np.quantile(scores, 0.99, weights=weights, method="inverted_cdf"))
    found, hard = (100 * float(np.mean([one.ranks[k] for one in real])) for k in (0, 1))
    again = sum(one.place == 1 for one in real)
    columns = (
        "clip", "donor", "to source", "99th percentile", "unswapped", "rank 1, %", "rank 1 without rendered people, %",
        "place over all frames",
    )  # fmt: skip
    return Report(
        "deidentify.identity",
        "De-identification: re-identification",
        [
            Criterion("rank 1 over all clips", found, "<=", 100 / people + 2, "%"),
            Criterion(
                "mean similarity to the source", float(np.mean([o.own.mean() for o in real])), "<=", 0.15
            ),
            Criterion("99th percentile of the similarity to the source", p99, "<=", 0.30),
        ],
        [
            Table(
                f"Gallery of {people} people, {SAMPLED_FRAMES} frames of each clip",
                columns,
                [row(o) for o in outcomes],
            )
        ],
        [
            f"Without rendered people in the gallery, rank 1 is {hard:.1f} %, and {again} of {len(real)} real clips "
            "have their person at place 1 when all faces are averaged: that is what somebody finds who looks for one "
            "of these people and knows that the donors do not exist."
        ],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
