"""What is at a path, opened as the input that it is."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from pathlib import Path

from guise.app.media.errors import MediaError, UnreadableError
from guise.app.media.file_kind import kind_of
from guise.app.media.frame import Frame
from guise.app.media.hardware import HardwareDecoder
from guise.app.media.input import MediaInput, VideoInput, VideoPart
from guise.app.media.picture_inputs import AnimationInput, ImageInput
from guise.app.media.pipes import is_pipe
from guise.app.media.time_range import TimeRange

_ADDRESS = re.compile(r"[a-z][a-z0-9+.-]+:/[^/]")  # a path has lost a slash of it


def open_input(
    path: Path | str, hwaccel: HardwareDecoder = "none", part: TimeRange | None = None
) -> MediaInput:
    """Open a video file, an image or a folder of images.

    hwaccel : the device that decodes a video, "auto" for one that works, or "none" for the processor.
    part : of it, as if there were no more; None for the whole.
    Raises UnreadableError when there is nothing to read.
    """
    path = Path(path)
    try:
        if is_pipe(path):
            if part is not None:
                raise MediaError(
                    "A pipe cannot be cut: leave out --outside cut, or write it to a file first."
                )
            return VideoInput(path, hwaccel)
        if not path.exists() and _ADDRESS.match(str(path)):
            raise MediaError(
                f"{path} is an address, which this command does not fetch: download the file first."
            )
        if not path.exists():
            raise MediaError(f"{path} does not exist: give a video file, an image or a folder of images.")
        kind = "image" if path.is_dir() else kind_of(path)
        if kind == "image":
            return ImageInput(path, part)
        if kind != "video":
            return AnimationInput(path, kind, part)
        return VideoInput(path, hwaccel) if part is None else VideoPart(path, part, hwaccel)
    except MediaError as error:
        raise UnreadableError(str(error)) from error


def frames_at(path: Path | str, wanted: Collection[int]) -> Iterator[Frame]:
    """The frames of some indices; what comes after the last of them is not read."""
    left = len(set(wanted))
    with open_input(path) as media:
        for frame in media if left else ():
            if frame.index in wanted:
                yield frame
                left -= 1
                if not left:
                    return
