"""What an output container holds: found by writing a header and a packet to memory, and by reading them again."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import av
import av.error
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.packet import Packet
from av.stream import Stream

if TYPE_CHECKING:
    from av.container.core import Chapter

# Videos whose headers need no data of an encoder; one suits each container.
_PLACEHOLDERS = ("mpeg4", "vp8", "flv1")
_MILLISECOND = Fraction(1, 1000)
_CHAPTER: Chapter = {"id": 1, "start": 0, "end": 1, "time_base": _MILLISECOND, "metadata": {"title": "1"}}
UNKNOWN = "unknown"  # codec


@dataclass(frozen=True)
class SoundEncoding:
    """An encoder of sound and its settings."""

    name: str
    rate: int
    layout: str
    bit_rate: int

    def add_to(self, output: OutputContainer) -> AudioStream:
        """The stream; ValueError when the container has no such codec."""
        stream = output.add_stream(self.name, self.rate)
        assert isinstance(stream, AudioStream)
        stream.codec_context.layout, stream.codec_context.bit_rate = self.layout, self.bit_rate
        return stream


class Trial:
    """What files of one format hold beside a video.

    rate : of its pictures, per second.
    """

    def __init__(self, format_name: str, rate: Fraction = Fraction(30)) -> None:
        self._format, self._rate = format_name, rate

    def takes(self, copied: Sequence[Stream], encoded: Sequence[SoundEncoding] = ()) -> bool:
        """Whether a header can be written for copies of these streams, together with encoded sound."""
        if not copied and not encoded:
            return True
        if self._format == "flv" and any(map(_is_raw, copied)):
            return False  # FFmpeg 8 ends the process over most of them
        try:
            with av.open(io.BytesIO(), "w", format=self._format) as output:
                for stream in copied:
                    output.add_stream_from_template(stream, opaque=True).metadata.update(stream.metadata)
                for sound in encoded:
                    sound.add_to(output)
                output.start_encoding()
        except (ValueError, av.error.FFmpegError):
            return False
        return True

    def keeps(self, stream: Stream) -> bool:
        """Whether a copy of a stream is read as what it is.

        Sound and text may also be refused, left out or taken for another codec for their packet's content; that says
        nothing.
        """
        if not self.takes([stream]) or (stream.type == "data" and codec_name(stream) == UNKNOWN):
            return False
        found = self._read_back(stream)
        if stream.type in ("audio", "subtitle") and not _is_raw(stream):
            return found is None or {kind for kind, _ in found} <= {"video", stream.type}
        return found is not None and _kind(stream) in found

    def keeps_timecode(self, timecode: str) -> bool:
        """Whether the time code of the pictures is there again when the file is read."""
        return timecode in (self._read_back(None, timecode) or {}).values()

    def keeps_chapters(self) -> bool:
        """Whether chapters are there again when the file is read."""
        for video in _PLACEHOLDERS:
            try:
                with av.open(self._written(video, None, "", chapters=True)) as media:
                    return bool(media.chapters())
            except (ValueError, av.error.FFmpegError):
                continue
        return False

    def _read_back(self, stream: Stream | None, timecode: str = "") -> dict[_Kind, str] | None:
        """The streams of a file with a packet of a video and one of a stream, with their time codes.

        None where it cannot be written.
        """
        for video in _PLACEHOLDERS:
            try:
                file = self._written(video, stream, timecode)
                with av.open(file) as media:
                    return {_kind(s): _timecode(s) for s in media.streams}
            except (ValueError, av.error.FFmpegError):
                continue
        return None

    def _written(
        self, video: str, stream: Stream | None, timecode: str, *, chapters: bool = False
    ) -> io.BytesIO:
        file = io.BytesIO()
        with av.open(file, "w", format=self._format) as output:
            pictures = output.add_mux_stream(video, self._rate, width=64, height=48, time_base=_MILLISECOND)
            streams: list[Stream] = [pictures]
            if timecode:
                pictures.metadata["timecode"] = timecode
            if stream is not None:
                streams.append(output.add_stream_from_template(stream, opaque=True))
                streams[1].metadata.update(stream.metadata)
            if chapters:
                output.set_chapters([_CHAPTER])
            output.start_encoding()
            for target in streams:
                if target.type != "attachment":
                    output.mux_one(_empty_packet(target))
        file.seek(0)
        return file


_Kind = tuple[str, str]


def _is_raw(stream: Stream) -> bool:
    """Whether a stream has samples without a codec, for which any content does."""
    return codec_name(stream).startswith("pcm_")


def _kind(stream: Stream) -> _Kind:
    return stream.type, "" if stream.type == "attachment" else codec_name(stream)


def _timecode(stream: Stream) -> str:
    return next((value for key, value in stream.metadata.items() if key.lower() == "timecode"), "")


def codec_name(stream: Stream) -> str:
    """The codec of a stream, or UNKNOWN."""
    try:
        return stream.name or UNKNOWN
    except AttributeError:  # without a decoder, as PyAV 18 asks that one for its name
        return UNKNOWN


def _empty_packet(stream: Stream) -> Packet[Stream]:
    channels = stream.codec_context.channels if isinstance(stream, AudioStream) else 1
    packet: Packet[Stream] = Packet(bytes(48 * channels))  # whole samples of any format
    packet.pts = packet.dts = 0
    packet.duration, packet.time_base = 1, _MILLISECOND
    packet.stream, packet.is_keyframe = stream, True
    return packet
