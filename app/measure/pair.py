"""The frames of an original and of its output side by side: same size, same number, same times.

And the files themselves: time stamps, sound, and the picture where nothing should have changed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import tight_box
from guise.app.measure.faces import MeasureError
from guise.app.media import Frame, open_input
from guise.app.media.audio_tracks import AudioTrack, audio_tracks

CHANGED_MARGIN_FACE_SIZES = 0.5  # about a face, on each side: the region that a tool may change


@dataclass(frozen=True)
class VideoTiming:
    """When the frames of a video are shown, and its size.

    times : seconds.   width, height : pixels, as shown.   video : whether the frames follow each other.
    """

    name: str
    times: tuple[Fraction, ...]
    width: int
    height: int
    video: bool = True

    @classmethod
    def of(cls, path: Path) -> VideoTiming:
        """By decoding the video once."""
        with open_input(path) as media:
            size = media.width, media.height
            return cls(
                media.name,
                tuple(frame.pts * frame.time_base for frame in media),
                *size,
                media.kind == "video",
            )

    @property
    def frame_interval(self) -> Fraction:
        """The median time from frame to frame, seconds."""
        steps = sorted(b - a for a, b in zip(self.times, self.times[1:], strict=False))
        return steps[len(steps) // 2] if steps else Fraction(1, 30)


def require_alike(original: VideoTiming, output: VideoTiming) -> None:
    """MeasureError unless a video has the size, the frames and the times of the original.

    Times count from the first frame and may differ by less than half a frame: other tools round them.
    """
    if (output.width, output.height) != (original.width, original.height):
        raise MeasureError(
            f"{output.name} must have the size of {original.name}, {original.width} x {original.height}, "
            f"got {output.width} x {output.height}: give an output of the same video"
        )
    if len(output.times) != len(original.times):
        raise MeasureError(
            f"{output.name} must have the {len(original.times)} frames of {original.name}, got {len(output.times)}: "
            "give the whole output of the same video"
        )
    for index, (own, other) in enumerate(zip(original.times, output.times, strict=True)):
        expected, found = own - original.times[0], other - output.times[0]
        if abs(expected - found) >= original.frame_interval / 2:
            raise MeasureError(
                f"frame {index} of {output.name} must be at {float(expected):.3f} s as in {original.name}, got "
                f"{float(found):.3f} s: give an output with the frame rate of the original"
            )


def side_by_side(original: Path, output: Path) -> Iterator[tuple[Frame, Frame]]:
    """Both frames, in order; the files are alike."""
    with open_input(original) as first, open_input(output) as second:
        yield from zip(first, second, strict=True)


class BackgroundDifference:
    """How similar two videos are outside the faces, by luma; frames come one after the other."""

    def __init__(self) -> None:
        self._squares, self._pixels = 0.0, 0

    def add(self, before: Frame, after: Frame, faces: list[NDArray[Any]]) -> None:
        """One more frame with its faces, landmarks (81, 2) each."""
        outside = np.ones((before.height, before.width), np.bool_)
        for points in faces:
            x0, y0, x1, y1 = _region(points)
            outside[max(y0, 0) : max(y1, 0), max(x0, 0) : max(x1, 0)] = False
        difference = (before.luma.astype(np.int16) - after.luma)[outside].astype(np.float64)
        self._squares += float(difference @ difference)
        self._pixels += len(difference)

    @property
    def psnr(self) -> float:
        """Peak signal-to-noise ratio, dB; infinite when nothing differs, NaN when nothing was outside."""
        if not self._pixels:
            return math.nan
        mean = self._squares / self._pixels
        return math.inf if mean == 0 else 10 * math.log10(255**2 / mean)


def _region(points: NDArray[Any]) -> tuple[int, int, int, int]:
    """Pixels x0 y0 x1 y1 about a face (81, 2) that a tool may change."""
    box = tight_box(points)
    margin = CHANGED_MARGIN_FACE_SIZES * float((box[2:] - box[:2]).max())
    x0, y0, x1, y1 = (math.floor(v) for v in (*(box[:2] - margin), *(box[2:] + margin)))
    return x0, y0, x1 + 1, y1 + 1


@dataclass(frozen=True)
class SoundCheck:
    """How a sound stream compares with the original's, and its length in seconds before and after (None: not there)."""

    state: Literal["identical", "changed", "dropped", "added"]
    before: float | None
    after: float | None


def compare_sounds(original: Path, output: Path) -> tuple[SoundCheck, ...]:
    """Each sound stream of the original and the output, matched in order."""
    before, after = audio_tracks(original), audio_tracks(output)
    count = max(len(before), len(after))
    return tuple(
        _compared(before[i] if i < len(before) else None, after[i] if i < len(after) else None)
        for i in range(count)
    )


def _compared(before: AudioTrack | None, after: AudioTrack | None) -> SoundCheck:
    if before is None or after is None:
        state: Literal["dropped", "added"] = "added" if before is None else "dropped"
        return SoundCheck(state, *(None if sound is None else sound.seconds for sound in (before, after)))
    same = before.digest == after.digest
    return SoundCheck("identical" if same else "changed", before.seconds, after.seconds)
