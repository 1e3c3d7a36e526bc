"""The third stage: a model of a track's person, enrolled from the video itself.

It is trained on frames in which the landmarks are confident, from a few segments, evenly chosen, so that an hour of
video costs no more than a minute.  Of the people in a photo no more is known than it shows (`guise.aam.one_photo`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from guise.aam.model import Identity
from guise.aam.one_photo import person_in_photo
from guise.aam.parsing import FaceParser
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.training import (
    Choice,
    Observation,
    TrainingError,
    TrainingOptions,
    choose_frames,
    observe,
    train_identity,
)
from guise.app.deidentify.stages.case import Case, LinkedTrack
from guise.app.swapping.donors import anybody
from guise.common.arrays import F64
from guise.common.threads import one_thread

TRAINING = TrainingOptions(frames=48, equalise_light=True)


@dataclass(frozen=True)
class TrackEnrolmentLimits:
    """From what a person is enrolled.  Widths are of the face's box; confidences are of its landmarks."""

    max_segments: int = 5
    clear_confidence: float = 0.95  # least, where so many frames have it:
    min_clear_frames: int = 36
    min_confidence: float = 0.5  # least, where fewer have
    min_frames: int = 24
    min_width_pixels: float = 36.0


LIMITS = TrackEnrolmentLimits()


def why_not(case: Case, track: LinkedTrack) -> str:
    """Why a track's person cannot be enrolled, or ""."""
    if track.width < LIMITS.min_width_pixels:
        return f"the face is only {track.width:.0f} pixels wide"
    if track.sure < min(LIMITS.min_frames, case.scan.frames):
        return f"the face is seen clearly in {track.sure} frames only"
    return ""


def enrol(case: Case, track: LinkedTrack) -> Identity | str:
    """The model, or why there is none."""
    reason = why_not(case, track)
    if reason:
        return reason
    frames, points = _confident_points(case, track)
    try:
        if case.scan.frames == 1:
            return _in_photo(case, track, points[0])
        choice = replace(choose_frames(points, TRAINING), held_out=np.empty(0, np.intp))  # no error is told
        observations = _observations(case, frames, points, choice)
        with one_thread():
            return train_identity(f"person {track.number}", observations, choice, options=TRAINING)
    except TrainingError as error:
        return str(error)


def _in_photo(case: Case, track: LinkedTrack, points: F64) -> Identity:
    """The model of somebody in a photo."""
    with one_thread():
        (picture,) = (rgb for _, rgb in _pictures(case, [0]))
        return person_in_photo(picture, points, f"person {track.number}", anybody())


def _confident_points(case: Case, track: LinkedTrack) -> tuple[NDArray[np.int32], F64]:
    """Frames (t,) and landmarks (t, 81, 2), NaN where their confidence is low, of the chosen segments."""
    frames, points, confidence = [], [], []
    for segment, number in _spread(track.pieces):
        found = case.found(segment)
        rows = np.flatnonzero(found.tracklet == number)
        frames.append(found.frame[rows])
        points.append(found.points[rows])
        confidence.append(found.confidence[rows])
    all_frames, all_points = np.concatenate(frames), np.concatenate(points).astype(np.float64)
    confidences = np.concatenate(confidence)
    is_clear = (confidences >= LIMITS.clear_confidence).sum() >= LIMITS.min_clear_frames
    all_points[confidences < (LIMITS.clear_confidence if is_clear else LIMITS.min_confidence)] = np.nan
    return all_frames, all_points


def _spread(pieces: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
    """The tracklets of a few segments, evenly chosen."""
    segments = sorted({segment for segment, _ in pieces})
    places = np.unique(np.linspace(0, len(segments) - 1, LIMITS.max_segments).round().astype(int))
    chosen = {segments[i] for i in places}
    return [piece for piece in pieces if piece[0] in chosen]


def _observations(
    case: Case, frames: NDArray[np.int32], points: F64, choice: Choice
) -> dict[int, Observation]:
    """What training needs of the chosen rows."""
    reference, parser = ReferenceFrame.canonical(TRAINING.resolution), FaceParser()
    wanted = {int(frames[row]): int(row) for row in choice.all}
    trained_on, neutral = set(choice.training.tolist()), set(choice.neutral)
    observations = {}
    for index, picture in _pictures(case, sorted(wanted)):
        row = wanted[index]
        seen = observe(
            picture,
            points[row],
            reference,
            parser if row in trained_on else None,
            keep_picture=row in neutral,
        )
        if not isinstance(seen, Failed):
            observations[row] = seen
    return observations


def _pictures(case: Case, wanted: list[int]) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    """The wanted frames as RGB, segment by segment."""
    for segment in case.scan.segments:
        here = {i for i in wanted if segment.first <= i < segment.end}
        if here:
            for frame in case.frames(min(here), max(here) + 1):
                if frame.index in here:
                    yield frame.index, frame.rgb()
