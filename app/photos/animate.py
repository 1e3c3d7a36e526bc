"""A photo animated by the expressions of a clip, frame by frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import LIPS
from guise.aam.solid_shape import SolidPrior
from guise.analogy.photo import PhotoAnalogy, PhotoError
from guise.analogy.photo.grid import ANIMATED_FACE_PX
from guise.app.media import EncodeOptions, Frame, open_input, open_sink, process
from guise.app.media.animation_writer import can_move
from guise.app.media.file_kind import has_image_name, is_picture
from guise.app.media.images import DeepImage
from guise.app.media.synthetic import synthetic_tags
from guise.app.photos.driving_track import DrivingTrack, TrackingOptions, read_frame, track_clip
from guise.app.photos.faces import Photo, PoseNormaliser, quality_warnings, to_profile, to_profile_of
from guise.app.photos.image import DEFAULT_OPTIONS, Role, open_role
from guise.app.photos.options import AnalogyOptions
from guise.common.arrays import F64, U8
from guise.common.errors import OutputError
from guise.common.files import require_outputs
from guise.common.progress import NoteLog, Progress, Say, mute, silent
from guise.common.report import Report
from guise.common.threads import one_thread

Picture = U8

MARGIN_FACE_SIZES = 0.5  # that is read around the face
# Mean motion of the lips from those of the likeliest face at rest, from which nobody rests.  Of 86 real neutral photos
# none moves by more than 0.0247; half of the smiles do.
MAX_REST_MOTION_FACES = 0.025
DEFAULT_TRACKING, DEFAULT_ENCODING = TrackingOptions(), EncodeOptions()


@dataclass(frozen=True)
class AnimateReport(Report):
    """The report of a run.

    Parameters
    ----------
    frames : written; `animated` of them show the expression of the clip, `held` repeat the one before, because the
        face was not found, partly hidden, or turned too far.
    neutral : reference of the expressions: a photo, or a frame of the clip.
    setup_seconds : once, for S and T.   seconds : total wall time; work_seconds : of computing the pictures.
    """

    output: str
    frames: int
    animated: int
    held: int
    neutral: str
    method: str
    mouth: str
    strength: float
    setup_seconds: float
    work_seconds: float
    seconds: float
    problems: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def frames_per_second(self) -> float:
        """Frames per second, with reading and writing."""
        return self.frames / max(self.seconds, 1e-9)

    def as_json(self) -> dict[str, Any]:
        """The report for JSON."""
        return super().as_json() | {"frames_per_second": round(self.frames_per_second, 2)}

    def __str__(self) -> str:
        """One line for people."""
        return (
            f"{self.output}: {self.animated} of {self.frames} frames animated, {self.held} held; "
            f"neutral is {self.neutral}; {self.seconds:.1f} s, {self.frames_per_second:.1f} frames per second"
        )


def animate_file(
    source: Path | None, clip: Path, target: Path, output: Path, options: AnalogyOptions = DEFAULT_OPTIONS,
    tracking: TrackingOptions = DEFAULT_TRACKING, *,
    landmarks: dict[Role, Path | None] | None = None, encode: EncodeOptions = DEFAULT_ENCODING,
    progress: Progress = silent, say: Say = mute,
) -> AnimateReport:  # fmt: skip
    """Write a video of `target` with the expressions of the person in `clip`, with its sound and time stamps.

    Parameters
    ----------
    source : a neutral photo of that person, or None for the most neutral frame of the clip.
    clip : a video, or a folder of images.   target : a neutral photo.
    output : of the size of the target, padded to even sizes where the encoder needs it.
    landmarks : landmark files of the photos.   tracking : of the clip.
    progress : called with the stage and the completed share of it.   say : called with notes for the user.

    Raises
    ------
    MediaError, LandmarkError, PhotoError, OutputError, ModelError
        For a user's mistake; no output is then left behind.
    """
    start = time.perf_counter()
    notes = NoteLog(say)
    _require_files(source, clip, target, output, force=options.force)
    landmarker, files = open_landmarker(options.landmarker), landmarks or {}
    t = to_profile(open_role("t", target, files.get("t"), landmarker, notes), None, notes)
    given = None if source is None else open_role("s", source, files.get("s"), landmarker, notes)
    size = t.image.pixels.shape[1], t.image.pixels.shape[0]
    with (
        open_input(clip) as media,
        open_sink(output, media, encode, force=options.force, tags=synthetic_tags(), size=size) as sink,
    ):
        track = track_clip(clip, tracking, progress, notes)
        s = to_profile_of(given, t, notes) if given else _rest_photo(clip, track)
        if not given:
            notes.extend(rest_warnings(clip, track))
        notes.extend(quality_warnings(s, Photo(clip, s.image, track.points[track.rest_index]), t))
        with one_thread():
            animator = _Animator(s, t, options, track)
            total = media.frame_count or len(track.points)
            stats = process(
                media, sink, animator.animate, progress=lambda done: progress("moving", done / total)
            )
    neutral = str(source) if source else f"frame {track.rest_index} of {clip.name}"
    for problem in stats.problems:
        say(f"{media.name}: {problem}")
    return AnimateReport(
        str(output), stats.frames, animator.animated, stats.frames - animator.animated, neutral, options.method,
        options.mouth, options.strength, round(animator.setup_seconds, 4), round(stats.work_seconds, 3),
        round(time.perf_counter() - start, 3), stats.problems, tuple(notes.said),
    )  # fmt: skip


class _Animator:
    """Computes the pictures, frame by frame in order."""

    def __init__(self, source: Photo, target: Photo, options: AnalogyOptions, track: DrivingTrack) -> None:
        start = time.perf_counter()
        self._track, self._strength, self._normaliser = track, options.strength, PoseNormaliser(source.points)
        self._picture = target.image.rgb8()
        self._analogy = PhotoAnalogy(
            source.image.rgb8(), source.points, self._picture, target.points, options.method, options.mouth,
            ANIMATED_FACE_PX,
        )  # fmt: skip
        self.setup_seconds = time.perf_counter() - start
        self.animated = 0

    def animate(self, frame: Frame) -> None:
        """Show the picture for a frame in it; the previous one where no expression is available."""
        points = self._track.usable_points(frame.index)
        if points is not None:
            part, corner = _face_region(frame, points)
            self._picture = self._analogy(part, points - corner, self._strength, self._normaliser(points))
            self.animated += 1
        frame.show(self._picture)


def _face_region(frame: Frame, points: F64) -> tuple[Picture, F64]:
    """The rectangle around a face (81, 2) as RGB, and its origin."""
    low, high = points.min(0), points.max(0)
    x, y, width, height = frame.align_roi(
        *(low - MARGIN_FACE_SIZES * (high - low)), *(high + MARGIN_FACE_SIZES * (high - low))
    )
    return frame.rgb_roi(x, y, width, height), np.array([x, y], np.float64)


def rest_warnings(clip: Path, track: DrivingTrack) -> list[str]:
    """A warning that the person in a clip never rests, if even the lips of the most neutral frame are moved."""
    index = track.rest_index
    fit = SolidPrior.shipped().fit(track.points[index])
    moved = float(np.linalg.norm((fit.solid - fit.rest)[LIPS, :2], axis=1).mean())
    if moved <= MAX_REST_MOTION_FACES:
        return []
    return [
        f"nobody seems to rest in {clip.name}: even in frame {index}, taken for the face at rest, the mouth is moved "
        "as in a smile or a word, which the result lacks: give a photo of the person at rest before the clip"
    ]


def _rest_photo(clip: Path, track: DrivingTrack) -> Photo:
    """The most neutral frame of the clip."""
    index = track.rest_index
    return Photo(clip, DeepImage(read_frame(clip, index)), track.points[index])


def _require_files(source: Path | None, clip: Path, target: Path, output: Path, *, force: bool) -> None:
    """Raise errors that can be found before any work."""
    if is_picture(clip):
        raise PhotoError(f"{clip} is a picture, not a clip: use `guise analogy image` for it")
    if has_image_name(output) and not can_move(output):
        raise OutputError(
            f"{output} has the name of a picture: give the name of a video, such as {output.with_suffix('.mp4')}"
        )
    require_outputs([output], [path for path in (source, clip, target) if path is not None], force=force)
