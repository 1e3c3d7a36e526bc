"""Choice of the container for a result."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import av
import av.error
from av.stream import Stream

from guise.app.media.stream_copies import keeps_times

FALLBACKS = (".mp4", ".mkv")


def suffix_for(path: Path, encoder: str) -> str:
    """The suffix of an output: the input's own where that can hold the result, otherwise .mp4, otherwise .mkv.

    The result is the encoder's video with the input's time stamps, audio and subtitles.
    """
    with _copied_streams(path) as copied:
        fitting = (s for s in (path.suffix, FALLBACKS[0]) if s and _holds(s, encoder, copied))
        return next(fitting, FALLBACKS[1])


@contextlib.contextmanager
def _copied_streams(path: Path) -> Iterator[list[Stream]]:
    """The streams that are copied from a file; none if it cannot be read, which is reported elsewhere."""
    try:
        media = av.open(str(path.absolute()), "r", metadata_errors="surrogateescape")
    except (av.error.FFmpegError, OSError):
        yield []
        return
    with media:
        yield [s for s in media.streams if s.type in ("audio", "subtitle") and s.codec_context]


def _holds(suffix: str, encoder: str, copied: list[Stream]) -> bool:
    try:
        with av.open(f"probe{suffix}", "w") as container:  # opens no file until its header is written
            container.add_stream(encoder, 25)
            for stream in copied:
                container.add_stream_from_template(stream, opaque=True)
            return keeps_times(container.format.name)
    except (ValueError, av.error.FFmpegError):
        return False
