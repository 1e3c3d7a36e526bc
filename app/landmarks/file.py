"""Landmarks of all faces of a video, a picture or a folder of pictures, to a file and drawn onto a copy.

In a video faces are tracked and numbered; each picture of a folder stands for itself.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from guise.aam.brows import BrowLift
from guise.aam.landmarks import Face, Landmarker, tight_box
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.landmark_filter import LandmarkFilter
from guise.aam.landmarks.tracking import MultiFaceTracker, TrackingLimits
from guise.aam.parsing import FaceParser
from guise.aam.solid_shape import SolidTracker
from guise.app.landmarks.formats import (
    FileHeader,
    LandmarkFile,
    TrackedFace,
    format_of,
    open_landmark_file,
)
from guise.app.landmarks.overlay import draw_face
from guise.app.media import EncodeOptions, Frame, MediaInput, NullSink, Sink, open_input, open_sink, process
from guise.common.arrays import F32, U8
from guise.common.errors import OutputError
from guise.common.progress import Progress, Say, mute, silent
from guise.common.report import Report
from guise.common.text import counted
from guise.common.threads import one_thread


@dataclass(frozen=True)
class LandmarkOptions:
    """How landmarks are found and written.

    Parameters
    ----------
    form : "json", "npz" or "pts"; None takes it from the output's suffix.
    overlay : a copy of the video or picture with the landmarks drawn on it.
    min_confidence : in [0, 1]; faces below are left out.
    smooth : whether points are smoothed over the frames of a video.
    encode : of the overlay.
    force : replace existing outputs.
    """

    form: str | None = None
    overlay: Path | None = None
    min_confidence: float = 0.5
    smooth: bool = True
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    force: bool = False


@dataclass(frozen=True)
class LandmarkReport(Report):
    """Result of a run.

    Parameters
    ----------
    frames : number read; `with_face` of them have a face.   faces : number written.
    tracks : number of faces tracked in a video.   seconds : wall time.
    """

    output: str
    overlay: str | None
    landmarker: str
    frames: int
    with_face: int
    faces: int
    tracks: int
    seconds: float
    problems: tuple[str, ...]

    def __str__(self) -> str:
        """One line for a person to read."""
        found = (
            f"{counted(self.faces, 'face')} in {self.with_face} of {counted(self.frames, 'frame')}"
            if self.faces
            else f"no face found in {counted(self.frames, 'frame')}"
        )
        tracks = f", {counted(self.tracks, 'track')}" if self.tracks else ""
        rate = self.frames / max(self.seconds, 1e-9)
        return f"{self.output}: {found}{tracks}; {self.seconds:.1f} s, {rate:.1f} frames per second"


def landmarks_file(
    video: Path, output: Path, landmarker: Landmarker, options: LandmarkOptions = LandmarkOptions(),
    *, progress: Progress = silent, say: Say = mute,
) -> LandmarkReport:  # fmt: skip
    """Write the landmarks of all faces of `video`; a file without any says so by empty lists.

    Parameters
    ----------
    video : a video file, an image or a folder of images.
    output : appears only when it is complete, as does the overlay.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.

    Raises
    ------
    MediaError, OutputError, LandmarkError
        For a user's mistake; nothing is then left behind.
    """
    start = time.perf_counter()
    form = options.form or format_of(output)
    if options.overlay is not None and options.overlay.absolute() == output.absolute():
        raise OutputError(f"{output} cannot be both output and overlay: give two names")
    with open_input(video) as media, contextlib.ExitStack() as outputs:
        smooth = options.smooth and media.kind == "video"
        header = FileHeader.of(media, landmarker.name, smoothed=smooth)
        file = outputs.enter_context(
            open_landmark_file(output, media, header, form, force=options.force)
        )  # closed last: it appears only when the overlay is complete
        sink = _sink(outputs, media, options)
        work = _FrameWork(
            VideoFaces(landmarker, media.kind == "video", options.min_confidence, smooth),
            file,
            sink is not None,
        )
        total = media.frame_count or 0
        with one_thread():
            stats = process(
                media, sink or NullSink(output, force=True), work,
                progress=lambda done: progress("landmarks", done / total if total else 0.0),
            )  # fmt: skip
    for problem in stats.problems:
        say(f"{media.name}: {problem}")
    drawn = None if options.overlay is None else str(options.overlay)
    return LandmarkReport(
        str(output), drawn, landmarker.name, stats.frames, work.with_face, work.faces, len(work.tracks),
        round(time.perf_counter() - start, 3), stats.problems,
    )  # fmt: skip


@dataclass(eq=False)
class _Known:
    """What a track's earlier frames tell of the next one."""

    filter: LandmarkFilter = field(default_factory=LandmarkFilter)
    solid: SolidTracker = field(default_factory=SolidTracker)
    lift: BrowLift = field(default_factory=BrowLift)


class VideoFaces:
    """The faces of each frame, their turn and irises: tracked in a video, which moves, or detected in each picture.

    smooth : filter the points of a track over time.
    """

    def __init__(self, landmarker: Landmarker, moves: bool, min_confidence: float, smooth: bool) -> None:
        self._landmarker, self._min_confidence, self._smooth = landmarker, min_confidence, smooth
        self._tracker = MultiFaceTracker(landmarker, TrackingLimits(min_confidence)) if moves else None
        self._known: dict[int, _Known] = {}
        self._parser = FaceParser()

    def __call__(self, frame: Frame) -> list[TrackedFace]:
        """The faces of a frame: by their numbers, or the largest first."""
        rgb, seconds = frame.rgb(), frame.seconds
        if self._tracker is None:
            found = [f for f in self._landmarker.detect(rgb) if f.confidence >= self._min_confidence]
            return [self._described(rgb, seconds, face, _Known()) for face in found]
        tracked = self._tracker.update(rgb)
        self._known = {n: self._known.get(n) or _Known() for n in tracked}  # afresh after a gap
        return [self._described(rgb, seconds, face, self._known[n], n) for n, face in tracked.items()]

    def _described(
        self, rgb: U8, seconds: float, face: Face, known: _Known, track: int | None = None
    ) -> TrackedFace:
        """A face with its brows on their hair, the turn of the head and the irises."""
        if self._smooth:
            face = _moved(face, known.filter.update(face.points, face.point_confidence, seconds))
        points = face.points.astype(np.float64)
        parsing = self._parser.parse(rgb, points)
        irises = parsing.open_irises(points)
        if isinstance(self._landmarker, BuiltinLandmarker):
            lift = known.lift if self._smooth else BrowLift()
            lift.see(parsing, points)
            points = lift(points)
            face = _moved(face, points.astype(np.float32))
        return TrackedFace(face, known.solid.update(points).pose.angles, track, irises)


class _FrameWork:
    """Finds the faces of a frame, writes them, draws them onto it and counts them."""

    def __init__(self, find: VideoFaces, file: LandmarkFile, draw: bool) -> None:
        self._find, self._file, self._draw = find, file, draw
        self.with_face = self.faces = 0
        self.tracks: set[int] = set()

    def __call__(self, frame: Frame) -> None:
        """One more frame."""
        found = self._find(frame)
        self._file.add(frame, found)
        self.with_face += bool(found)
        self.faces += len(found)
        self.tracks.update(one.track for one in found if one.track is not None)
        if self._draw:
            _draw(frame, found)


def _sink(outputs: contextlib.ExitStack, media: MediaInput, options: LandmarkOptions) -> Sink | None:
    if options.overlay is None:
        return None
    return outputs.enter_context(open_sink(options.overlay, media, options.encode, force=options.force))


def _draw(frame: Frame, found: Sequence[TrackedFace]) -> None:
    for one in found:
        draw_face(frame, one.face, one.track, one.irises)


def _moved(face: Face, points: F32) -> Face:
    return replace(face, points=points, box=tight_box(points))
