"""Which codecs this installation of PyAV has."""

from __future__ import annotations

from typing import Literal

import av
from av import library_versions as versions
from av.codec.codec import UnknownCodecError


def find_codec(name: str, mode: Literal["r", "w"]) -> av.Codec | None:
    """The decoder ("r") or encoder ("w") of that name, of pictures or sound; None when there is none."""
    try:
        return av.Codec(name, mode)
    except UnknownCodecError:
        return None


def library_versions() -> str:
    """The versions of PyAV and its libavcodec, for people."""
    number = ".".join(map(str, versions.get("libavcodec", ())))
    return f"PyAV {av.__version__}, libavcodec {number}"
