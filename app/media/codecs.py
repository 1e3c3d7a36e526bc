"""Which codecs this installation of PyAV has."""

from __future__ import annotations

import av
from av import library_versions as versions
from av.codec.codec import UnknownCodecError


def has_encoder(name: str) -> bool:
    """Whether pictures or sound can be written with the codec of that name."""
    return _exists(name, "w")


def has_decoder(name: str) -> bool:
    """Whether pictures or sound can be read with the codec of that name."""
    return _exists(name, "r")


def library_versions() -> str:
    """The versions of PyAV and its libavcodec, for people."""
    number = ".".join(map(str, versions.get("libavcodec", ())))
    return f"PyAV {av.__version__}, libavcodec {number}"


def _exists(name: str, mode: str) -> bool:
    try:
        av.Codec(name, "w" if mode == "w" else "r")
    except UnknownCodecError:
        return False
    return True
