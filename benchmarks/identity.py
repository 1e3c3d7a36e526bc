"""Re-identification of swapped frames by a face recogniser, on six pairs of real people.

The recogniser (models/mobilefacenet.onnx) sees RGB 112 x 112, aligned by five points of the tracked landmarks of the
original frame.  A person is the mean embedding of frames evenly spread over the own clip; of the video's person those
frames lie between the swapped ones that are judged.  Cosine similarity.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import onnxruntime as ort

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from guise.aam.landmarks.schemes import LEFT_EYE, MOUTH_CORNERS, NOSE_TIP, RIGHT_EYE
from guise.aam.model import Identity
from guise.aam.similarity import Similarity, align
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.common.arrays import F32

# (video, donor): across sex, skin, age and light; chosen before the first figure was seen, and kept.
PAIRS = (
    ("room_s18", "studio_d7"),
    ("studio_d3", "talk_r4"),
    ("talk_r4", "address_o1"),
    ("address_o1", "talk_r4"),
    ("talk_r2", "talk_r1"),
    ("studio_d5", "webcam_a1"),
)
COMPARED_FRAMES = 20
TEMPLATE = np.array([[38.29, 51.70], [73.53, 51.50], [56.03, 71.74], [41.55, 92.37], [70.73, 92.20]])


class Recogniser:
    """Unit embeddings of aligned faces."""

    def __init__(self, model: Path) -> None:
        settings = ort.SessionOptions()
        settings.log_severity_level = 3
        self._session = ort.InferenceSession(str(model), settings, providers=["CPUExecutionProvider"])
        self._input = self._session.get_inputs()[0].name

    def __call__(self, rgb: Picture, shape: F64) -> F32:
        """(128,) of the face with landmarks (81, 2) in a picture (h, w, 3)."""
        face = (aligned(rgb, shape).astype(np.float32) - 127.5) / 127.5
        vector = self._session.run(None, {self._input: face.transpose(2, 0, 1)[None]})[0][0]
        return np.asarray(vector / np.linalg.norm(vector), np.float32)


def aligned(rgb: Picture, shape: F64) -> Picture:
    """The face (112, 112, 3), by the least-squares similarity of five points to the recogniser's template."""
    five = np.stack(
        [shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0), shape[NOSE_TIP], *shape[MOUTH_CORNERS]]
    )
    move = align(five, TEMPLATE)
    assert isinstance(move, Similarity)
    matrix = np.column_stack([move.linear, move.translation])
    how = cv2.INTER_AREA if move.scale < 0.5 else cv2.INTER_LINEAR
    return np.asarray(cv2.warpAffine(rgb, matrix, (112, 112), flags=how), np.uint8)


def person(clip: Clip, indices: set[int], recognise: Recogniser) -> F32:
    """The mean embedding (128,) of a person over some frames of a clip."""
    found = [
        recognise(frame.rgb(), clip.points[frame.index])
        for frame in common.frames(clip)
        if frame.index in indices and np.isfinite(clip.points[frame.index]).all()
    ]
    return unit(np.mean(found, axis=0))


def unit(vector: F32) -> F32:
    """A vector of length one."""
    return np.asarray(vector / np.linalg.norm(vector), np.float32)


def spread(count: int, number: int) -> list[int]:
    """Indices evenly spread over `count` frames, the ends left out."""
    return [int(i) for i in np.unique(np.round((np.arange(number) + 0.5) * count / number - 0.5))]


@dataclass(frozen=True, eq=False)
class Judged:
    """A frame before and after, and the tracked shape (81, 2) of it."""

    original: Picture
    swapped: Picture
    shape: F64


def swapped(
    clip: Clip, source: Identity, donor: Identity, indices: set[int]
) -> tuple[list[Judged], dict[str, int]]:
    """Swap a whole clip; keeps some frames, and counts the outcomes of all."""
    kept, outcomes = [], {"swapped": 0, "held": 0, "lost": 0}
    with Engine(source, Donor.of(donor), common.detector()) as engine:
        for frame in common.frames(clip):
            original = frame.rgb() if frame.index in indices else None
            result = engine.swap(frame)
            outcomes[result.outcome] += 1
            shape = common.shape_of(result.fit)
            if original is not None and shape is not None:
                kept.append(Judged(original, frame.rgb(), shape))
    return kept, outcomes


@dataclass(frozen=True)
class PairResult:
    """Mean similarities of a pair, and the references without a swap."""

    to_source: float
    to_donor: float
    same_person: float
    other_person: float
    outcomes: dict[str, int]


def judge(clip: Clip, donor_clip: Clip, people: dict[str, Identity], recognise: Recogniser) -> PairResult:
    """Swap one pair and compare."""
    every = spread(len(clip.points), 2 * COMPARED_FRAMES)
    own = person(clip, set(every[1::2]), recognise)
    theirs = person(donor_clip, set(spread(len(donor_clip.points), COMPARED_FRAMES)), recognise)
    judged, outcomes = swapped(clip, people[clip.name], people[donor_clip.name], set(every[::2]))
    after = np.array([recognise(j.swapped, j.shape) for j in judged])
    before = np.array([recognise(j.original, j.shape) for j in judged])
    values = (after @ own, after @ theirs, before @ own, before @ theirs)
    return PairResult(*(float(v.mean()) for v in values), outcomes)


def measure(options: argparse.Namespace) -> Report:
    """All pairs."""
    recognise = Recogniser(options.shared / "models" / "mobilefacenet.onnx")
    pairs = PAIRS[:1] if options.quick else PAIRS
    clips = {name: common.real_clip(options.shared, name) for pair in pairs for name in pair}
    people = {}
    for name, clip in clips.items():
        common.say(f"enrolling {name}")
        people[name] = common.enrolled(clip)
    results = []
    for video, donor in pairs:
        results.append(judge(clips[video], clips[donor], people, recognise))
        common.say(f"{video} <- {donor}: {results[-1]}")
    return summary(pairs, results)


def summary(pairs: tuple[tuple[str, str], ...], results: list[PairResult]) -> Report:
    """Criteria over the pairs' means, and a row for each pair."""
    source, donor = (float(np.mean([getattr(r, k) for r in results])) for k in ("to_source", "to_donor"))
    rows = [
        (f"{v} <- {d}", r.to_source, r.to_donor, r.same_person, r.other_person, *r.outcomes.values())
        for (v, d), r in zip(pairs, results, strict=True)
    ]
    columns = (
        "video <- donor", "to source", "to donor", "unswapped to source", "unswapped to donor",
        "frames swapped", "held", "lost",
    )  # fmt: skip
    return Report(
        "identity",
        "Identity: re-identification of swapped frames",
        [
            Criterion("mean similarity to the source", source, "<=", 0.15),
            Criterion("mean similarity to the donor", donor, ">=", 0.60),
        ],
        [Table(f"Cosine similarity, mean over {COMPARED_FRAMES} frames", columns, rows)],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
