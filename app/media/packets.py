"""Encoded pieces of a video, and the video that is assembled from them.

A piece is a file of packets: their payloads one after the other, then a JSON index, its length (8 bytes, little-endian)
and a magic number.  It depends only on its frames and the encoder, not on the machine.
"""

from __future__ import annotations

import base64
import heapq
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import av
import numpy as np
from av.codec.context import Flags
from av.packet import Packet, PacketSideData, PktSideDataT, packet_sidedata_type_from_literal
from av.video.codeccontext import VideoCodecContext
from numpy.typing import NDArray

from guise.app.media.container import ALPHA_DECODERS
from guise.app.media.deep_frame import frame_of
from guise.app.media.encoder import EncodeOptions, ordinary_priority
from guise.app.media.encoding import Encoding, encoding_for
from guise.app.media.errors import MediaError
from guise.app.media.frame import Frame
from guise.app.media.input import MediaInput, VideoInput
from guise.app.media.orientation import Orientation
from guise.app.media.outputs import check_free
from guise.app.media.pixel_formats import NATIVE_FORMATS, has_alpha, nearest_format
from guise.app.media.reader import AnyPacket, reformat
from guise.app.media.sink import Sink, VideoOutput, as_media_error, later_time
from guise.app.media.stream_copies import Audio

ENCODER_THREADS = 4  # a fixed number, as the output of some encoders depends on it
_MAGIC = b"GUISEPK1"
_DECODERS = {"av1": "libdav1d"}  # where FFmpeg's own needs special hardware
_ALPHA: PktSideDataT = "matroska_block_additional"


@dataclass(frozen=True)
class _Entry:
    """One packet: its bytes in the file, its time and duration in units of time_base, and its frame's index.

    beside : bytes of the packet's side data, VP9's alpha, that follow its own.
    """

    size: int
    pts: int
    duration: int
    key: bool
    index: int
    beside: int = 0


class PacketSink(Sink):
    """Encodes consecutive frames of an input as a piece that starts with a keyframe and refers to no other piece.

    It may be empty, as a damaged part may be lost altogether.  Closed captions are left out.  An existing file is
    replaced.  Images and folders of images have no pieces: use `open_sink` for those outputs.
    """

    needs_frames = False

    def __init__(self, path: Path, media: MediaInput, options: EncodeOptions, output: Path) -> None:
        super().__init__(path, force=True)
        self._encoding = encoding_for(media, options, output, threads=ENCODER_THREADS, captions=False)
        self._context = _encoder(self._encoding)
        self._last: Fraction | None = None
        self._entries: list[_Entry] = []
        self._indices: dict[int, int] = {}
        self.claim()
        self._file = self.part.open("wb")

    def write(self, frame: Frame) -> None:
        self._last = later_time(frame, self._last)
        self._indices[frame.pts] = frame.index
        with as_media_error(self.path):
            self._store(self._context.encode(self._encoding.picture(frame)))
        self.frames += 1

    def _store(self, packets: Sequence[AnyPacket]) -> None:
        for packet in packets:
            assert packet.pts is not None
            beside = bytes(packet.get_sidedata(_ALPHA)) if packet.has_sidedata(_ALPHA) else b""
            self._file.write(bytes(packet) + beside)
            index, key = self._indices.pop(packet.pts), packet.is_keyframe
            entry = _Entry(packet.size, packet.pts, packet.duration or 0, key, index, len(beside))
            self._entries.append(entry)

    def _finish(self) -> None:
        if self.frames:
            self._store(self._context.encode(None))
        text = json.dumps(self._header()).encode()
        self._file.write(text + len(text).to_bytes(8, "little") + _MAGIC)
        self._file.close()
        self.publish()

    def _header(self) -> dict[str, Any]:
        form, context = self._encoding.picture_format, self._context
        return {
            "codec": self._encoding.codec,
            "extradata": base64.b64encode(context.extradata or b"").decode(),
            "size": form.coded,
            "format": form.fmt,
            "bits": context.bits_per_coded_sample,
            "colour": [form.span, form.matrix, form.primaries, form.transfer],
            "orientation": asdict(form.orientation),
            "time_base": str(self._encoding.time_base),
            "packets": [[*asdict(entry).values()] for entry in self._entries],
        }

    def discard(self) -> None:
        self._file.close()
        super().discard()


def _encoder(encoding: Encoding) -> VideoCodecContext:
    """An open encoder, configured like that of a file's stream."""
    context = av.CodecContext.create(encoding.encoder, "w")
    assert isinstance(context, VideoCodecContext)
    context.options = dict(encoding.settings)
    encoding.configure(context)
    context.flags |= Flags.global_header
    try:
        with ordinary_priority():
            context.open()
    except (av.error.FFmpegError, ValueError) as error:
        raise MediaError(f"Encoder {encoding.encoder!r} refuses these settings: use libx264.") from error
    return context


class _Piece:
    """A finished piece: its index, and its payloads one by one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:
            self.header = _read_header(file, path)
        self.entries = [_Entry(*entry) for entry in self.header["packets"]]
        self.extradata = base64.b64decode(self.header["extradata"])
        self.time_base = Fraction(self.header["time_base"])

    def packets(self) -> Iterator[AnyPacket]:
        """The packets in decoding order, without dts."""
        with self.path.open("rb") as file:
            for entry in self.entries:
                # In FFmpeg's memory: a decoder's thread needs Python's lock to free Python's, and whoever closes the
                # decoder before its end holds it.
                packet: AnyPacket = Packet(entry.size)
                packet.update(file.read(entry.size))
                if entry.beside:
                    _put_beside(packet, file.read(entry.beside))
                packet.pts, packet.duration, packet.time_base = entry.pts, entry.duration, self.time_base
                packet.is_keyframe = bool(entry.key)
                yield packet


def _put_beside(packet: AnyPacket, data: bytes) -> None:
    """Add the side data that holds VP9's alpha."""
    make: Any = PacketSideData  # its constructor isn't in PyAV's types
    side = make(packet_sidedata_type_from_literal(_ALPHA), len(data))
    side.update(data)
    side.to_packet(packet, move=True)


def _read_header(file: BinaryIO, path: Path) -> dict[str, Any]:
    tail = len(_MAGIC) + 8
    end = file.seek(0, 2)
    file.seek(max(end - tail, 0))
    length, magic = int.from_bytes(file.read(8), "little"), file.read()
    if magic != _MAGIC or length > end - tail:
        raise MediaError(f"{path} is not a complete piece of a video: delete it and run again.")
    file.seek(end - tail - length)
    header: dict[str, Any] = json.loads(file.read(length))
    return header


def read_packets(path: Path) -> Iterator[Frame]:
    """The decoded frames of a piece, with the times and indices with which they were written."""
    piece = _Piece(path)
    context = _decoder(piece)
    orientation = Orientation(**piece.header["orientation"])
    entries = {entry.pts: entry for entry in piece.entries}
    for packet in chain(piece.packets(), [None]):
        for picture in context.decode(packet):
            assert picture.pts is not None
            entry = entries[picture.pts]
            picture.duration = entry.duration
            yield frame_of(
                _native(picture), pts=entry.pts, time_base=piece.time_base, index=entry.index,
                orientation=orientation,
            )  # fmt: skip


def _decoder(piece: _Piece) -> VideoCodecContext:
    """A decoder configured with what is stored outside the packets."""
    codec = piece.header["codec"]
    special = ALPHA_DECODERS if has_alpha(piece.header["format"]) else _DECODERS
    context = av.CodecContext.create(special.get(codec, codec), "r")
    assert isinstance(context, VideoCodecContext)
    context.extradata = piece.extradata or None
    context.width, context.height = piece.header["size"]
    context.pix_fmt = piece.header["format"]
    context.bits_per_coded_sample = piece.header["bits"]
    context.color_range, context.colorspace, context.color_primaries, context.color_trc = piece.header[
        "colour"
    ]
    context.thread_type = "AUTO"
    return context


def _native(picture: av.VideoFrame) -> av.VideoFrame:
    if picture.format.name in NATIVE_FORMATS:
        return picture
    return reformat(picture, picture.width, picture.height, nearest_format(picture))


def assemble(
    output: Path, media: MediaInput, parts: Sequence[Path], options: EncodeOptions, *, tags: Mapping[str, str],
    private: bool, audio: Audio = "keep", force: bool = False,
) -> None:  # fmt: skip
    """Write the video that consists of the pieces in order, with copies of the input's other streams.

    options : those of the pieces.   audio : what happens to the audio.   Others are as for `open_sink`.
    The output has the same bytes each time.  Raises MediaError for a user's mistake, and then leaves nothing behind.
    """
    check_free(output, media, force)
    pieces = [_Piece(part) for part in parts]
    encoding = encoding_for(media, options, output, threads=ENCODER_THREADS, captions=False)
    with _Assembly(output, media, encoding, force=force, tags=tags, private=private, audio=audio) as whole:
        whole.mux(media, [piece for piece in pieces if piece.entries])


class _Assembly(VideoOutput):
    """A video whose encoded stream is assembled from pieces."""

    def mux(self, media: MediaInput, pieces: Sequence[_Piece]) -> None:
        """Write the packets of all streams, in the order of their time."""
        streams = [self._timed(pieces)]
        if isinstance(media, VideoInput):
            streams.append(_timed_others(media))
        for _, is_video, packet in heapq.merge(*streams, key=lambda item: item[0]):
            if is_video:
                packet.stream = self._stream
                with as_media_error(self.path):
                    self._mux([packet])
                self.frames += 1
            else:
                self._copy(packet)

    def _timed(self, pieces: Sequence[_Piece]) -> Iterator[_Timed]:
        """The pieces' packets with decoding times that suit all of them, and when they are due, seconds."""
        decoding = iter(
            decoding_times(np.array([e.pts for p in pieces for e in p.entries], np.int64)).tolist()
        )
        inline = not self._stream.codec_context.flags & Flags.global_header
        for piece in pieces:
            for packet in piece.packets():
                if inline and packet.is_keyframe and piece.extradata:
                    packet = _with_headers(packet, piece.extradata)
                packet.dts = next(decoding)
                yield packet.dts * piece.time_base, True, packet


_Timed: TypeAlias = "tuple[Fraction, bool, AnyPacket]"


def _with_headers(packet: AnyPacket, headers: bytes) -> AnyPacket:
    """A keyframe's packet with the headers in it, for containers that have no other place for them."""
    whole: AnyPacket = Packet(headers + bytes(packet))
    whole.pts, whole.duration, whole.time_base = packet.pts, packet.duration, packet.time_base
    whole.is_keyframe = True
    return whole


def _timed_others(media: VideoInput) -> Iterator[_Timed]:
    """The packets of the other streams and when they are due, seconds; one without a time follows the last."""
    time = Fraction(-(2**62))
    with media.open_reader(media.problems) as reader:
        reader.only_others()
        for packet in reader.packets():
            if packet.stream is reader.stream or not (packet.size or packet.dts is not None):
                continue
            if packet.dts is not None:
                time = packet.dts * Fraction(packet.time_base)
            yield time, False, packet


def decoding_times(pts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Ascending dts (n,) for packets in decoding order, none later than its pts (n,), all in one time base.

    These are the sorted pts, delayed by the largest number of pictures for which any picture waits.

    >>> decoding_times(np.array([0, 40, 10, 20, 30])).tolist()
    [-10, 0, 10, 20, 30]
    """
    shown = np.sort(pts)
    depth = int((np.arange(len(pts)) - np.searchsorted(shown, pts)).max(initial=0))
    early = shown[:depth] - (shown[depth] - shown[0]) if depth else shown[:0]
    return np.concatenate([early, shown[: len(pts) - depth]])
