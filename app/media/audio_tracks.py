"""A summary of a file's audio, to check whether a copy has the same."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from guise.app.media.container import open_container
from guise.app.media.file_kind import kind_of


@dataclass(frozen=True)
class AudioTrack:
    """An audio stream: codec, SHA-256 of its packets' bytes, and length in seconds."""

    codec: str
    digest: str
    seconds: float


def audio_tracks(path: Path) -> tuple[AudioTrack, ...]:
    """The audio streams of a video, in order; images and animations have none.

    Raises MediaError when the file cannot be read.
    """
    if path.is_dir() or kind_of(path) != "video":
        return ()
    with open_container(path) as container:
        streams = list(container.streams.audio)
        digests = {s.index: hashlib.sha256() for s in streams}
        ticks = dict.fromkeys(digests, 0)
        for packet in container.demux(streams) if streams else ():
            if packet.size:  # the last ones are empty: they flush decoders
                digests[packet.stream_index].update(bytes(packet))
                ticks[packet.stream_index] += packet.duration or 0
        return tuple(
            AudioTrack(
                s.codec_context.name, digests[s.index].hexdigest(), float(ticks[s.index] * (s.time_base or 0))
            )
            for s in streams
        )
