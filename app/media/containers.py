"""Choice of the container for a result."""

from __future__ import annotations

import contextlib
from pathlib import Path

from guise.app.media.errors import MediaError
from guise.app.media.reader import open_container
from guise.app.media.stream_copies import can_hold

FALLBACKS = (".mp4", ".mkv")


def suffix_for(path: Path, encoder: str) -> str:
    """The suffix of an output: the input's own where that can hold the result, otherwise .mp4, otherwise .mkv.

    The result is the encoder's video with the input's time stamps, audio and subtitles.
    """
    with contextlib.ExitStack() as stack:
        copied = []
        with contextlib.suppress(MediaError):  # an input that cannot be read, which is reported elsewhere
            media = stack.enter_context(open_container(path))
            copied = [s for s in media.streams if s.type in ("audio", "subtitle") and s.codec_context]
        fitting = (s for s in (path.suffix, FALLBACKS[0]) if s and can_hold(s, copied, encoder))
        return next(fitting, FALLBACKS[1])
