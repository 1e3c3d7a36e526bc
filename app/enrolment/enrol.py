"""Enrolment: a person's model from one or more clips.

Two passes: the first gets landmarks for every frame (from a file, or by a landmarker), the second reads only the
chosen frames, so that memory doesn't grow with length.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.brows import BrowLift
from guise.aam.landmarks import (
    Annotations,
    FaceTracker,
    Landmarker,
    LbpDetector,
    interocular,
    load_annotations,
    open_landmarker,
)
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.face import NoFaceError
from guise.aam.landmarks.schemes import NOSE_TIP
from guise.aam.model import Identity
from guise.aam.parsing import FaceParser
from guise.aam.reference import ReferenceFrame
from guise.aam.refinement import refine_shapes
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION, Crop, cut
from guise.aam.training import LIMITS as TRAINING_LIMITS
from guise.aam.training import (
    Choice,
    Observation,
    TrainingError,
    TrainingOptions,
    choose_frames,
    observe,
    train_identity,
)
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.enrolment.quality import weaknesses
from guise.app.media import frames_at, open_input
from guise.app.people.finding import find_people, people_followed
from guise.app.people.found import VideoPerson
from guise.common.arrays import F32, F64, Int
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread

BOX_FRAMES = 12  # on which the detector's box is compared with the landmarks
SAME_FACE_INTEROCULAR = 0.5  # mean distance of points that may be of one face
MIN_BOX_FRAMES = 3  # with a box, below which a typical detector's relation is used


class EnrolError(GuiseError):
    """An enrolment that can't be done."""


def enrol(
    clips: Sequence[Path],
    landmarks: LandmarkSource,
    *,
    name: str,
    person: int | None = None,
    options: TrainingOptions = TrainingOptions(),
    progress: Progress = silent,
    say: Say = mute,
) -> Identity:
    """Train a person's model.

    Parameters
    ----------
    clips : video files, images or folders of images of one person.
    landmarks : see `LandmarkSource`.
    person : which one of a clip that shows several, as `find_people` numbers them; by default who is seen most.
    progress : called with the stage ("landmarks", "refinement", "frames", "training") and the share of it that is done.
    say : called with notes for the user.
    """
    shapes = [_clip_landmarks(i, clip, landmarks, progress, say) for i, clip in enumerate(clips)]
    if not landmarks.points:
        shapes = [
            _of_one_person(clip, points, landmarks.gives(clip), person, say)
            for clip, points in zip(clips, shapes, strict=True)
        ]
    choice = choose_frames(np.concatenate(shapes), options)
    generic = [landmarks.refines(clip) for clip in clips]
    if any(generic):
        shapes, choice = _refined(clips, shapes, generic, choice, progress, say)
    observations, boxes = _observe(clips, shapes, choice, options, progress)
    identity = train(name, observations, choice, options, boxes, [clip.name for clip in clips], progress)
    identity.facts["weaknesses"] = weaknesses(np.concatenate(shapes), identity)
    for sentence in identity.facts["weaknesses"]:
        say(f"{name}: {sentence}")
    return identity


def train(
    name: str, observations: dict[int, Observation], choice: Choice, options: TrainingOptions, boxes: Sequence[F64],
    clips: Sequence[str], progress: Progress,
) -> Identity:  # fmt: skip
    """The model of observed frames, trained on one thread.

    boxes : `box_relation`s of some frames.   clips : names of what the frames are from.   progress : as for `enrol`.
    """
    box = np.median(boxes, axis=0) if len(boxes) >= MIN_BOX_FRAMES else None
    facts: dict[str, Any] = {"clips": list(clips), "box_known": box is not None}
    with one_thread():
        return train_identity(
            name,
            observations,
            choice,
            options=options,
            box_to_shape=box,
            facts=facts,
            progress=lambda share: progress("training", share),
        )


def _of_one_person(clip: Path, points: F64, given: bool, number: int | None, say: Say) -> F64:
    """The landmarks (n, 81, 2) of one person of a clip; the same where it shows nobody else."""
    with open_input(clip) as media:
        if media.kind == "image" or (number is None and people_followed(media, points) < 2):
            return points
    with open_input(clip) as media:
        people = find_people(media).people
    chosen = _chosen(clip, people, number)
    if len(people) > 1:
        seen = ", ".join(f"{person.number} in {len(person.frames)} frames" for person in people)
        say(
            f"{clip.name} shows {len(people)} people: {seen}; enrolling {chosen.number}. guise people find "
            "shows them, and guise enroll --person NUMBER enrolls another."
        )
    rows = chosen.landmarks(len(points))
    if not given:
        return rows
    there = np.linalg.norm(rows - points, axis=2).mean(1) < SAME_FACE_INTEROCULAR * interocular(points)
    return np.where(there[:, None, None], points, np.nan)


def _chosen(clip: Path, people: Sequence[VideoPerson], number: int | None) -> VideoPerson:
    if not people:
        raise EnrolError(
            f"no face can be followed in {clip}; use a clip that shows one person from the front"
        )
    if number is None:
        return max(people, key=lambda person: len(person.frames))
    for person in people:
        if person.number == number:
            return person
    numbers = ", ".join(str(person.number) for person in people)
    raise EnrolError(
        f"there is no person {number} in {clip}: choose from {numbers}; guise people find draws them"
    )


def _clip_landmarks(index: int, clip: Path, landmarks: LandmarkSource, progress: Progress, say: Say) -> F64:
    if landmarks.points:
        return landmarks.points[index]
    if landmarks.landmarker is not None:
        return _detected(clip, landmarks.landmarker, progress, say)
    file = landmarks.files[index] if landmarks.files else landmark_file(clip)
    if file is None:
        return _detected(clip, open_landmarker("builtin"), progress, say)
    try:
        annotations: Annotations = load_annotations(file)
    except NoFaceError:
        if landmarks.files:
            raise
        say(f"{file.name} beside {clip.name} has no face in it: detecting the face instead")
        return _detected(clip, open_landmarker("builtin"), progress, say)
    if not landmarks.files:
        say(f"landmarks of {clip.name} from {file.name} beside it")
    if annotations.note:
        say(annotations.note)
    return annotations.points.astype(np.float64)


def _detected(clip: Path, landmarker: Landmarker, progress: Progress, say: Say) -> F64:
    rows = []
    missing = np.full((81, 2), np.nan)
    with open_input(clip) as source:
        tracker = FaceTracker(landmarker, report=lambda text: say(f"{clip.name}: {text}"))
        parser, lift, lifted = FaceParser(), BrowLift(), isinstance(landmarker, BuiltinLandmarker)
        for frame in source:
            rgb = frame.rgb()
            face = tracker.update(rgb)
            points = missing if face is None else face.points.astype(np.float64)
            if face is None:
                lift.reset()
            elif lifted:
                lift.see(parser.parse(rgb, points), points)
            rows.append(lift(points))
            progress("landmarks", min(1.0, len(rows) / max(1, source.frame_count or 1)))
        for problem in source.problems:
            say(f"{clip.name}: {problem}")
    if not rows or all(np.isnan(r).all() for r in rows):
        raise EnrolError(f"no face found in {clip}; use a clip that shows the face from the front")
    return np.stack(rows)


def _refined(
    clips: Sequence[Path], shapes: Sequence[F64], generic: Sequence[bool], choice: Choice, progress: Progress,
    say: Say,
) -> tuple[list[F64], Choice]:  # fmt: skip
    """The landmarks with those of the chosen frames of generic clips refined, and the frames that are left."""
    crops = _crops(clips, shapes, generic, choice)
    index = np.array(list(crops), np.intp)
    if len(index) < TRAINING_LIMITS.min_frames:
        return list(shapes), choice
    points = np.concatenate(shapes)
    with one_thread():
        refined = refine_shapes(
            list(crops.values()), points[index], lambda share: progress("refinement", share)
        )
    points[index] = refined.shapes
    left_out = index[~refined.kept]
    say(
        f"landmarks of {len(index)} frames refined together, by {100 * refined.moved:.1f} % of the inter-ocular "
        f"distance; {len(left_out)} of them left out"
    )
    return np.split(points, np.cumsum([len(s) for s in shapes])[:-1]), _without(choice, left_out)


def _crops(
    clips: Sequence[Path], shapes: Sequence[F64], generic: Sequence[bool], choice: Choice
) -> dict[int, Crop]:
    """The working crops of the chosen frames of generic clips, by index over all clips."""
    frame, wanted = ReferenceFrame.canonical(FEATURE_RESOLUTION), {int(i) for i in choice.all}
    crops: dict[int, Crop] = {}
    base = 0
    for clip, points, found in zip(clips, shapes, generic, strict=True):
        own = {i - base for i in wanted if base <= i < base + len(points)} if found else ()
        for picture in frames_at(clip, own):
            crop = cut(picture.luma, points[picture.index], frame)
            if not isinstance(crop, Failed):
                crops[base + picture.index] = crop
        base += len(points)
    return crops


def _without(choice: Choice, left_out: Int) -> Choice:
    """The choice without some frames; of the neutral ones at least one stays."""
    neutral = [i for i in choice.neutral if i not in left_out] or choice.neutral[:1]
    return Choice(np.setdiff1d(choice.training, left_out), neutral, np.setdiff1d(choice.held_out, left_out))


def _observe(
    clips: Sequence[Path], shapes: Sequence[F64], choice: Choice, options: TrainingOptions, progress: Progress
) -> tuple[dict[int, Observation], list[F64]]:
    """The chosen frames, and how the face lies in the detector's box in some of them."""
    frame, wanted = ReferenceFrame.canonical(options.resolution), {int(i) for i in choice.all}
    trained_on = set(choice.training.tolist())
    boxed = {int(i) for i in choice.training[:: max(1, len(choice.training) // BOX_FRAMES)]}
    detector, parser, boxes = LbpDetector(), FaceParser(), []
    observations: dict[int, Observation] = {}
    base = 0
    for clip, points in zip(clips, shapes, strict=True):
        count = 0
        with open_input(clip) as source:
            for picture in source:
                count = picture.index + 1
                index = base + picture.index
                if picture.index >= len(points):
                    continue
                if index in wanted:
                    seen = observe(
                        picture.rgb(), points[picture.index], frame, parser if index in trained_on else None,
                        keep_picture=index in choice.neutral,
                    )  # fmt: skip
                    if not isinstance(seen, Failed):
                        observations[index] = seen
                        progress("frames", len(observations) / len(wanted))
                if index in boxed:
                    boxes.append(box_relation(detector.detect(picture.luma), points[picture.index]))
        if count != len(points):
            raise EnrolError(
                f"the landmarks of {clip} are for {len(points)} frames, the clip has {count}; "
                "give the landmarks of this very clip"
            )
        base += len(points)
    return observations, [b for b in boxes if b is not None]


def box_relation(boxes: F32, shape: F64) -> F64 | None:
    """(3,) shape centre minus box centre and face width, in widths of the box that holds the nose."""
    nose, centre = shape[NOSE_TIP], shape.mean(0)
    for x0, y0, x1, y1 in boxes.astype(np.float64):
        if x0 < nose[0] < x1 and y0 < nose[1] < y1:
            width = x1 - x0
            middle = (x0 + x1) / 2, (y0 + y1) / 2
            return np.array([*((centre - middle) / width), np.ptp(shape[:, 0]) / width])
    return None


__all__ = ["EnrolError", "LandmarkSource", "TrainingError", "box_relation", "enrol", "landmark_file", "train"]
