"""Which container the result of a file goes into."""

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
    """The suffix of an output: the input's own where that can hold the result, else .mp4, else .mkv.

    The result is a video of the encoder with the time stamps of the input, and its sound and subtitles.
    """
    with _copied_streams(path) as copied:
        fitting = (s for s in (path.suffix, FALLBACKS[0]) if s and _holds(s, encoder, copied))
        return next(fitting, FALLBACKS[1])


@contextlib.contextmanager
def _copied_streams(path: Path) -> Iterator[list[Stream]]:
    """The streams that are copied from a file; none of one that cannot be read, of which others tell."""
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
