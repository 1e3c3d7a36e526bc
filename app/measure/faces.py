"""Faces of a video, frame by frame, and the same faces in another video of the same frames.

Landmarks (n, 81, 2) pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face, Landmarker, iou, load_annotations, tight_box
from guise.aam.landmarks.tracking import MultiFaceTracker
from guise.app.media import Frame, MediaInput
from guise.common.arrays import F32
from guise.common.errors import GuiseError

Ints = NDArray[np.int32]

MIN_MATCH_IOU = 0.3  # of boxes, from which a face of the output is the one of the original
MIN_CONFIDENCE = 0.5  # of a face in a picture


class MeasureError(GuiseError):
    """A measurement that is not possible; one sentence."""


@dataclass(frozen=True, eq=False)
class FaceTrack:
    """A face through a video: (n,) frames, ascending, and its landmarks (n, 81, 2) in them."""

    frames: Ints
    points: F32


class FaceLocator:
    """Locates all faces, frame by frame.

    landmarker : Landmarker.   video : whether to track faces from frame to frame; otherwise pictures are independent.
    """

    def __init__(self, landmarker: Landmarker, *, video: bool) -> None:
        self._landmarker = landmarker
        self._tracker = MultiFaceTracker(landmarker) if video else None
        self._numbers = count()

    def __call__(self, frame: Frame) -> dict[int, Face]:
        """The faces of the next frame by their numbers; in independent pictures no number comes twice."""
        if self._tracker is not None:
            return self._tracker.update(frame.rgb())
        found = [face for face in self._landmarker.detect(frame.rgb()) if face.confidence >= MIN_CONFIDENCE]
        return {next(self._numbers): face for face in found}


class FaceTrackBuilder:
    """Collects landmarks by the number of a face."""

    def __init__(self) -> None:
        self._frames: dict[int, list[int]] = {}
        self._points: dict[int, list[NDArray[Any]]] = {}

    def add(self, number: int, frame: int, points: NDArray[Any]) -> None:
        """A face in a frame."""
        self._frames.setdefault(number, []).append(frame)
        self._points.setdefault(number, []).append(np.asarray(points, np.float32))

    def track(self, number: int) -> FaceTrack:
        """The track of one face, which may be empty."""
        frames, points = self._frames.get(number, []), self._points.get(number, [])
        return FaceTrack(np.array(frames, np.int32), np.array(points, np.float32).reshape(-1, 81, 2))

    def tracks(self) -> list[FaceTrack]:
        """All faces, those seen in most frames first."""
        return sorted(map(self.track, self._frames), key=lambda face: -len(face.frames))


def faces_in(media: MediaInput, landmarker: Landmarker, progress: Callable[[int], None]) -> list[FaceTrack]:
    """The faces of a video; MeasureError without any.   progress : called with the number of frames that are done."""
    locate, found = FaceLocator(landmarker, video=media.kind == "video"), FaceTrackBuilder()
    for frame in media:
        for number, face in locate(frame).items():
            found.add(number, frame.index, face.points)
        progress(frame.index + 1)
    faces = found.tracks()
    if not faces:
        raise MeasureError(
            f"no face found in {media.name}: give a video that shows a face, or its landmarks with --landmarks"
        )
    return faces


def faces_of_file(path: Path, frames: int) -> list[FaceTrack]:
    """The face of a file of landmarks; LandmarkError unless the file is for so many frames."""
    known = load_annotations(path).require_frames(frames)
    index = np.flatnonzero(known.present).astype(np.int32)
    return [FaceTrack(index, known.points[index])]


class FacesByFrame:
    """The faces of some tracks by frame."""

    def __init__(self, faces: Sequence[FaceTrack]) -> None:
        self._rows: dict[int, list[tuple[int, F32]]] = {}
        for number, face in enumerate(faces):
            for frame, points in zip(face.frames.tolist(), face.points, strict=True):
                self._rows.setdefault(frame, []).append((number, points))

    def __getitem__(self, frame: int) -> list[tuple[int, F32]]:
        """(number, landmarks (81, 2)) of each face in a frame."""
        return self._rows.get(frame, [])


def relocate(media: MediaInput, faces: Sequence[FaceTrack], landmarker: Landmarker) -> list[FaceTrack]:
    """The known faces as they are found in a video, each frame searched on its own."""
    at, found = FacesByFrame(faces), FaceTrackBuilder()
    for frame in media:
        if known := at[frame.index]:
            every = dict(enumerate(landmarker.detect(frame.rgb())))
            for number, points in matched(known, every):
                found.add(number, frame.index, points)
    return [found.track(number) for number in range(len(faces))]


def matched(known: list[tuple[int, F32]], found: dict[int, Face]) -> Iterator[tuple[int, F32]]:
    """For each known face (number, landmarks) the found one that lies there: (number, its landmarks)."""
    for number, points in known:
        box = tight_box(points)
        best = max(found.values(), key=lambda face: iou(face.box, box), default=None)
        if best is not None and iou(best.box, box) >= MIN_MATCH_IOU:
            yield number, best.points


def files_by_person(folder: Path) -> dict[str, list[Path]]:
    """The people of a folder, each a file or a folder of files in it, by name; hidden and empty ones are left out."""
    entries = sorted(p for p in folder.iterdir() if not p.name.startswith("."))
    found = {e.name: sorted(p for p in e.iterdir() if p.is_file()) if e.is_dir() else [e] for e in entries}
    return {name: files for name, files in found.items() if files}
