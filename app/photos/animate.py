"""A photo moved by the expressions of a clip: the analogy of photos, frame by frame."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.landmarks import open_landmarker
from guise.analogy.photo import PhotoAnalogy, PhotoError
from guise.app.media import EncodeOptions, Frame, open_input, open_sink
from guise.app.media.images import DeepImage, looks_like_image
from guise.app.media.process import replace_frames
from guise.app.media.synthetic import synthetic_tags
from guise.app.photos.driving_track import Driver, Tracking, follow, picture_of
from guise.app.photos.faces import Photo, in_colours, in_colours_of, warnings
from guise.app.photos.pose_normaliser import Facing
from guise.app.photos.image import USUAL, How, Notes, Role, opened
from guise.common.arrays import F64, U8
from guise.common.errors import OutputError
from guise.common.files import require_outputs
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread

Picture = U8

AROUND = 0.5  # of the face's size, that is read around it
UNTOLD, ENCODING = Tracking(), EncodeOptions()


@dataclass(frozen=True)
class AnimateReport:
    """What a run did.

    Parameters
    ----------
    frames : written; `animated` of them show the clip's expression, `held` the one before, as the face was not found,
        partly hidden, or turned too far.
    neutral : what the expressions are measured from: a photo, or a frame of the clip.
    setup_seconds : once, for S and T.   seconds : wall time of everything; work_seconds : of these in making pictures.
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
        """Frames per second, from files to file."""
        return self.frames / max(self.seconds, 1e-9)

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return {**asdict(self), "frames_per_second": round(self.frames_per_second, 2)}

    def __str__(self) -> str:
        """One line for a person to read."""
        return (
            f"{self.output}: {self.animated} of {self.frames} frames animated, {self.held} held; "
            f"neutral is {self.neutral}; {self.seconds:.1f} s, {self.frames_per_second:.1f} frames per second"
        )


def animate_file(
    source: Path | None, clip: Path, target: Path, output: Path, how: How = USUAL, tracking: Tracking = UNTOLD, *,
    landmarks: dict[Role, Path | None] | None = None, encode: EncodeOptions = ENCODING,
    progress: Progress = silent, say: Say = mute,
) -> AnimateReport:  # fmt: skip
    """Write a video of `target` with the expressions of the person in `clip`, with its sound and time stamps.

    Parameters
    ----------
    source : a neutral photo of that person, or None for the frame of the clip that is nearest to a face at rest.
    clip : a video, or a folder of images.   target : a neutral photo.
    output : of the target's size, grown to even where the encoder needs it.
    landmarks : files of landmarks of the photos.   tracking : of the clip.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.

    Raises
    ------
    MediaError, LandmarkError, PhotoError, OutputError, ModelError
        For a user's mistake; nothing is then left behind.
    """
    start = time.perf_counter()
    notes = Notes(say)
    _check(source, clip, target, output, force=how.force)
    landmarker, files = open_landmarker(how.landmarker), landmarks or {}
    t = in_colours(opened("t", target, files.get("t"), landmarker, notes), None, notes)
    given = None if source is None else opened("s", source, files.get("s"), landmarker, notes)
    size = t.image.pixels.shape[1], t.image.pixels.shape[0]
    with (
        open_input(clip) as media,
        open_sink(output, media, encode, force=how.force, tags=synthetic_tags(), size=size) as sink,
    ):
        driver = follow(clip, tracking, progress, notes)
        s = in_colours_of(given, t, notes) if given else _resting(clip, driver)
        notes.all(warnings(s, Photo(clip, s.image, driver.points[driver.resting]), t))
        with one_thread():
            puppet = _Animator(s, t, how, driver)
            total = media.frame_count or len(driver.points)
            stats = replace_frames(media, sink, puppet.step, progress=lambda done: progress("moving", done / total))
    neutral = str(source) if source else f"frame {driver.resting} of {clip.name}"
    for problem in stats.problems:
        say(f"{media.name}: {problem}")
    return AnimateReport(
        str(output), stats.frames, puppet.animated, stats.frames - puppet.animated, neutral, how.method, how.mouth,
        how.strength, round(puppet.setup_seconds, 4), round(stats.work_seconds, 3),
        round(time.perf_counter() - start, 3), stats.problems, tuple(notes.said),
    )  # fmt: skip


class _Animator:
    """Makes the pictures; frames come in order."""

    def __init__(self, source: Photo, target: Photo, how: How, driver: Driver) -> None:
        start = time.perf_counter()
        self._driver, self._strength, self._facing = driver, how.strength, Facing(source.points)
        self._picture = target.image.rgb8()
        self._analogy = PhotoAnalogy(
            source.image.rgb8(), source.points, self._picture, target.points, how.method, how.mouth
        )
        self.setup_seconds = time.perf_counter() - start
        self.animated = 0

    def step(self, frame: Frame) -> Frame:
        """The picture for a frame; the last one where there is no expression to take."""
        points = self._driver.usable(frame.index)
        if points is not None:
            part, corner = _around(frame, points)
            self._picture = self._analogy(part, points - corner, self._strength, self._facing(points))
            self.animated += 1
        return Frame.from_rgb(self._picture)


def _around(frame: Frame, points: F64) -> tuple[Picture, F64]:
    """The rectangle around a face (81, 2) as RGB, and where its corner lies."""
    low, high = points.min(0), points.max(0)
    x, y, width, height = frame.align_roi(*(low - AROUND * (high - low)), *(high + AROUND * (high - low)))
    return frame.rgb_roi(x, y, width, height), np.array([x, y], np.float64)


def _resting(clip: Path, driver: Driver) -> Photo:
    """The frame of the clip that is nearest to a face at rest."""
    index = driver.resting
    return Photo(clip, DeepImage(picture_of(clip, index)), driver.points[index])


def _check(source: Path | None, clip: Path, target: Path, output: Path, *, force: bool) -> None:
    """Raise what can be known before any work."""
    if looks_like_image(clip):
        raise PhotoError(f"{clip} is a picture, not a clip: use guise analogy image for it")
    if looks_like_image(output):
        raise OutputError(
            f"{output} is a picture by its name: name a video, such as {output.with_suffix('.mp4')}"
        )
    require_outputs([output], [path for path in (source, clip, target) if path is not None], force=force)
