"""Streams and metadata that are copied unchanged from the input container to the output container, and its choice."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import av.error
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.stream import Stream

from guise.app.media.container import is_still, main_video, open_container, shows_alpha
from guise.app.media.encoder import AUTO, chosen_encoder
from guise.app.media.errors import MediaError
from guise.app.media.input import MediaInput, VideoInput
from guise.app.media.new_audio import NewAudio, Voice, named_layout, sound_encodings
from guise.app.media.pixel_formats import has_alpha
from guise.app.media.reader import AnyPacket
from guise.app.media.trial import UNKNOWN, SoundEncoding, Trial, codec_name

Audio = Literal["keep", "drop", "mask", "disguise"]

# Written by a container or encoder about itself; wrong in a copy.
_STALE = frozenset(
    {
        "major_brand",
        "minor_version",
        "compatible_brands",
        "encoder",
        "duration",
        "vendor_id",
        "rotate",
        "timecode",
    }
)
_STALE_PREFIXES = ("_statistics", "number_of_", "bps")
# Keys that MP4 and MOV store without `use_metadata_tags` (FFmpeg, movenc.c).
_MOV_KEYS = frozenset(
    {
        "title", "artist", "album_artist", "composer", "album", "date", "comment", "genre", "copyright",
        "grouping", "lyrics", "description", "synopsis", "show", "episode_id", "network", "keywords",
        "creation_time",
    }
)  # fmt: skip
# Containers that support variable frame rates and arbitrary other streams.
_FULL_CONTAINERS = frozenset({"mp4", "mov", "ipod", "3gp", "3g2", "matroska", "webm", "mpegts", "flv", "nut"})
_FALLBACKS = (".mp4", ".mkv")  # of a result that the input's own container does not hold
_MOST_NAMED = 3  # streams of one kind in a note
_WIDEST = "matroska"  # the container that holds the most
_CODE = re.compile(r"\d\d:[0-5]\d:[0-5]\d[:;.]\d\d")
_WITH_SOUND_HEADERS = frozenset({"mpegts"})  # whose packets of AAC tell their rate and channels
_ROTATING = frozenset({"mp4", "mov", "matroska", "ipod", "3gp", "3g2"})


def fresh_metadata(metadata: Mapping[str, str]) -> dict[str, str]:
    """Metadata without entries that describe the old file rather than its content."""
    return {
        key: value
        for key, value in metadata.items()
        if key.lower() not in _STALE and not key.lower().startswith(_STALE_PREFIXES)
    }


def muxer_options(format_name: str, keys: Mapping[str, str], time_base: Fraction) -> dict[str, str]:
    """Options of the output container that make it keep every metadata key and the exact start time.

    `bitexact` leaves out the library's version and what differs from run to run, such as random numbers.
    """
    exact = {"fflags": "+bitexact"}
    if format_name not in _ROTATING - {"matroska"}:
        return exact
    ticks = time_base.denominator
    options = exact | {
        "movie_timescale": str(ticks * max(1000 // ticks, 1))
    }  # unit of edit lists, 1 ms by default
    return options if _MOV_KEYS.issuperset(keys) else options | {"movflags": "+use_metadata_tags"}


def keeps_times(format_name: str) -> bool:
    """Whether the container stores arbitrary time stamps; others would drop or repeat frames."""
    return format_name in _FULL_CONTAINERS


def can_rotate(format_name: str) -> bool:
    """Whether the container stores a rotation of the picture."""
    return format_name in _ROTATING


class StreamCopier:
    """The copied streams of one output, to which `mux` writes the input's packets.

    What the output cannot hold is known before work begins: sound is then encoded anew, and other streams are left
    out, each with a note.

    private : whether everything but audio is left out, and its metadata except the language.
    audio : whether the audio is copied, left out, or re-encoded with the voices lowered (mask) or whispered (disguise).
    timecode : that the output's pictures carry.
    """

    def __init__(
        self, output: OutputContainer, media: VideoInput, *, private: bool, audio: Audio = "keep",
        timecode: str = "",
    ) -> None:  # fmt: skip
        self._output, self._private, self._timecode = output, private, timecode
        self._problems, self._joined = media.problems, bool(media.clock.jumps)
        self._trial = Trial(output.format.name, media.frame_rate)
        self._streams: dict[int, Stream] = {}
        self._anew: dict[int, NewAudio] = {}
        self._encodings: list[SoundEncoding] = []
        self._copied: list[Stream] = []
        self._last_dts: dict[int, int] = {}
        left_out: dict[str, list[Stream]] = {}
        for stream in media.container.streams:
            wanted = stream.index != media.stream.index and (stream.type != "audio" or audio != "drop")
            if wanted and (reason := self._add(stream, media, audio)):
                left_out.setdefault(reason, []).append(stream)
        for reason, streams in left_out.items():
            self._problems.note(_left_out(streams, reason))

    def _add(self, stream: Stream, media: VideoInput, audio: Audio) -> str | None:
        """Add the output's stream; returns why it has to be left out, or nothing where that needs no note."""
        reason = _why_dropped(stream, media, self._private)
        if reason is not None:
            return reason
        voice: Voice = "keep" if audio == "drop" or not isinstance(stream, AudioStream) else audio
        copied = [*self._copied, stream]
        varies = stream.index in media.clock.varying and self._output.format.name not in _WITH_SOUND_HEADERS
        if (
            voice == "keep" and not varies
            and self._trial.keeps(stream) and self._trial.takes(copied, self._encodings)
        ):  # fmt: skip
            self._add_copy(stream)
            return None
        if (
            isinstance(stream, AudioStream)
            and stream.codec_context is not None
            and self._add_anew(stream, voice, varies=varies)
        ):
            return None
        if self._timecode and stream.metadata.get("timecode") == self._timecode:
            return None  # the pictures' metadata have it
        if codec_name(stream) == UNKNOWN:
            return "{its} format is unknown"
        holder = ", .mkv can" if Trial(_WIDEST).keeps(stream) else ""
        return f"{self._output.format.name} cannot hold {{them}}{holder}"

    def _add_copy(self, stream: Stream) -> None:
        self._copied.append(stream)
        copy = self._output.add_stream_from_template(stream, opaque=True)
        if isinstance(copy, AudioStream) and copy.layout.name != named_layout(copy.layout.name):
            copy.codec_context.layout = named_layout(copy.layout.name)
        copy.disposition = stream.disposition
        copy.metadata.update(_metadata(stream, self._private))
        if self._private and codec_name(stream) == "vorbis":
            copy.codec_context.extradata = without_vorbis_comments(stream.codec_context.extradata or b"")
        self._streams[stream.index] = copy

    def _add_anew(self, stream: AudioStream, voice: Voice, *, varies: bool) -> bool:
        """Add a stream that is encoded anew; whether there is an encoder that the output takes."""
        known = sound_encodings(stream, own=self._trial.keeps(stream))
        fitting = (e for e in known if self._trial.takes(self._copied, [*self._encodings, e]))
        if (encoding := next(fitting, None)) is None:
            return False
        self._encodings.append(encoding)
        anew = self._anew[stream.index] = NewAudio(encoding, self._output, self._problems, voice)
        anew.stream.disposition = stream.disposition
        anew.stream.metadata.update(_metadata(stream, self._private))
        if voice == "keep":
            mixed = "" if encoding.layout == named_layout(stream.layout.name) else f", {encoding.layout}"
            held = "a change of its rate or channels" if varies else "it"
            self._problems.note(
                f"{_title(stream)} was encoded anew as {encoding.name}{mixed}, "
                f"as {self._output.format.name} cannot hold {held}."
            )
        return True

    def finish(self) -> None:
        """Write the rest of the audio that is encoded anew."""
        for anew in self._anew.values():
            for packet in anew.finish():
                self._output.mux_one(packet)

    def mux(self, packet: AnyPacket) -> None:
        """Write a packet of the input, its time stamps unchanged where the output allows them."""
        if packet.stream_index in self._anew:
            for encoded in self._anew[packet.stream_index].feed(packet):
                self._output.mux_one(encoded)
            return
        target = self._streams.get(packet.stream_index)
        if target is None:
            return
        self._repair_times(packet, target)
        packet.stream = target
        try:
            self._output.mux_one(packet)
        except (av.error.InvalidDataError, av.error.ArgumentError) as error:
            self._problems.note(f"A packet of {_title(target)} could not be copied ({error.strerror}).")

    def _repair_times(self, packet: AnyPacket, target: Stream) -> None:
        """Muxers need an ascending dts on every packet, in the output's unit; a missing one follows from the last."""
        index = packet.stream_index
        last = self._last_dts.get(index)
        dts = packet.dts if packet.dts is not None else packet.pts
        least = 0 if last is None else last + max(math.ceil((target.time_base or 0) / packet.time_base), 1)
        if dts is None:
            dts = least if last is None else max(last + (packet.duration or 0), least)
        elif last is not None and dts < least:
            if dts <= last and not self._joined:  # where parts were joined, sound may overlap
                self._problems.note(
                    f"A time stamp of {_title(packet.stream)} did not ascend and was moved on."
                )
            dts = least
        if not packet.duration and last is not None and target.type == "audio":
            packet.duration = dts - last  # without one, an MP4's track ends before its last packet
        packet.dts = self._last_dts[index] = dts
        packet.pts = dts if packet.pts is None else max(packet.pts, dts)


def _why_dropped(stream: Stream, media: VideoInput, private: bool) -> str | None:
    """Why a stream is not copied: '' without a note, None if it is copied."""
    if isinstance(stream, av.video.stream.VideoStream):
        return "a cover may show the face" if is_still(stream) else "only the first video is processed"
    if private and stream.type == "subtitle":
        return "{they} may name people or, as in drones' videos, places"
    if isinstance(stream, AudioStream) and stream.codec_context is not None and not stream.channels:
        return "{its} format is unknown"  # it begins too late to be seen
    if stream.type in ("audio", "subtitle"):
        return None
    if stream.name == "bin_data" and media.container.chapters():
        return ""  # the chapter titles of an MP4, which are copied as chapters
    return "{they} may identify people" if private else None


def timecode_of(media: MediaInput, format_name: str) -> str:
    """The time code of the first picture, where a container keeps it, or ''."""
    if not isinstance(media, VideoInput):
        return ""
    entries = [*media.stream.metadata.items(), *media.container.metadata.items()]
    codes = (value for key, value in entries if key.lower() == "timecode" and _CODE.fullmatch(value))
    trial = Trial(format_name, media.frame_rate)
    return next((code for code in codes if trial.keeps_timecode(code)), "")


def _metadata(stream: Stream, private: bool) -> dict[str, str]:
    """The metadata of a stream; if private, nothing that identifies anybody."""
    if not private:
        return fresh_metadata(stream.metadata)
    language = stream.metadata.get("language")
    return {"language": language} if language else {}


def without_vorbis_comments(headers: bytes) -> bytes:
    """The three headers of a Vorbis stream, Xiph-laced, with an empty second one (Vorbis I, 5.2)."""
    sizes, at = [], 1
    for _ in range(headers[0]):
        end = at
        while headers[end] == 255:
            end += 1
        sizes.append(255 * (end - at) + headers[end])
        at = end + 1
    first, setup = headers[at : at + sizes[0]], headers[at + sum(sizes) :]
    comment = b"\x03vorbis" + bytes(8) + b"\x01"
    return bytes([2, len(first), len(comment)]) + first + comment + setup


def _title(stream: Stream) -> str:
    return f"{stream.type.capitalize()} stream {stream.index} ({codec_name(stream)})"


def _left_out(streams: Sequence[Stream], reason: str) -> str:
    """The sentence that streams were left out; many of one kind are counted.

    reason : with the pronouns they, them and its in braces.
    """
    kinds = dict.fromkeys(stream.type for stream in streams)
    titles = []
    for kind in kinds:
        alike = [_title(stream) for stream in streams if stream.type == kind]
        titles += alike if len(alike) <= _MOST_NAMED else [f"{len(alike)} {kind} streams"]
    if len(streams) == 1:
        return f"{titles[0]} was left out: {reason.format(they='it', them='it', its='its')}."
    return f"{', '.join(titles)} were left out: {reason.format(they='they', them='them', its='their')}."


def can_hold(suffix: str, copied: Sequence[Stream], encoder: str = "") -> bool:
    """Whether a file with this suffix holds copies of streams, beside an encoder's video, and their time stamps."""
    try:
        with av.open(f"probe{suffix}", "w") as container:  # opens no file until its header is written
            if encoder:
                container.add_stream(encoder, 25)
            name = container.format.name
    except (ValueError, av.error.FFmpegError):
        return False
    trial = Trial(name)
    return keeps_times(name) and all(map(trial.keeps, copied)) and trial.takes(copied)


def suffix_for(path: Path, encoder: str) -> str:
    """The suffix of an output: the input's own where that can hold the result, otherwise .mp4, otherwise .mkv.

    The result is the encoder's video with the input's time stamps, audio and subtitles; with the automatic one, alpha
    stays in .webm and .mov.
    """
    with contextlib.ExitStack() as stack:
        copied, fmt = [], "yuv420p"
        with contextlib.suppress(MediaError):  # an input that cannot be read, which is reported elsewhere
            media = stack.enter_context(open_container(path))
            copied = [s for s in media.streams if s.type in ("audio", "subtitle") and s.codec_context]
            fmt = "yuva420p" if shows_alpha(main_video(media, path)) else fmt
        for suffix in filter(None, (path.suffix, _FALLBACKS[0])):
            auto = chosen_encoder(suffix, fmt) if has_alpha(fmt) else "libx264"
            if can_hold(suffix, copied, auto if encoder == AUTO else encoder):
                return suffix
        return _FALLBACKS[1]
