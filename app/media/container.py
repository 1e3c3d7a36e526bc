"""A media file, opened, and what its container says of the video in it."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import av.error
from av.codec.hwaccel import HWAccel
from av.container import InputContainer
from av.video.codeccontext import VideoCodecContext
from av.video.stream import VideoStream

from guise.app.media.encoder import find_codec
from guise.app.media.errors import MediaError, reason
from guise.app.media.pipes import UNREADABLE, is_pipe, opened_as
from guise.app.media.pixel_formats import has_alpha

# FFmpeg renders text as a terminal's pictures.
_TEXT_AS_VIDEO = frozenset({"tty", "bin", "xbin", "adf", "idf"})
_NO_TIMESTAMPS = 0x80  # FFmpeg's AVFMT_NOTIMESTAMPS: a format's packets have no times
ALPHA_DECODERS = {"vp8": "libvpx", "vp9": "libvpx-vp9"}  # FFmpeg's own leave it out


def open_container(path: Path, device: str | None = None) -> InputContainer:
    """Open a media file, to be decoded by a device; MediaError says in one sentence why it cannot be read."""
    place, kind, options = opened_as(path)
    try:
        container = av.open(
            place,
            "r",
            format=kind,
            options=options,
            metadata_errors="surrogateescape",
            hwaccel=HWAccel(device) if device else None,
        )
    except PermissionError as error:
        raise MediaError(f"{path} cannot be read ({error.strerror}): check its permissions.") from error
    except (av.error.FFmpegError, OSError) as error:
        if is_pipe(path):
            raise MediaError(UNREADABLE) from error
        raise MediaError(
            f"{path} is not a video that can be read ({reason(error)}): give a video file, "
            "an image or a folder of images."
        ) from error
    if container.format.name in _TEXT_AS_VIDEO:
        container.close()
        raise MediaError(f"{path} is a text file: give a video file, an image or a folder of images.")
    return container


def main_video(container: InputContainer, path: Path) -> VideoStream:
    """The first video stream of a file that is not a cover or a thumbnail, ready to decode."""
    for stream in container.streams.video:
        if not is_still(stream):
            if stream.codec_context is None:
                raise MediaError(
                    f"{path}: no decoder for its video stream is available: convert it to H.264 first."
                )
            stream.thread_type = "AUTO"
            return stream
    raise MediaError(f"{path} holds no video stream: give a video file, an image or a folder of images.")


def alpha_decoder(stream: VideoStream) -> VideoCodecContext | None:
    """A decoder for VP8 or VP9 with alpha, which FFmpeg's own leave out; None for other streams."""
    name = ALPHA_DECODERS.get(stream.codec_context.name)
    if not shows_alpha(stream) or name is None or find_codec(name, "r") is None:
        return None
    known, context = stream.codec_context, av.CodecContext.create(name, "r")
    assert isinstance(context, VideoCodecContext)
    context.color_primaries, context.color_trc = known.color_primaries, known.color_trc
    return context


def shows_alpha(stream: VideoStream) -> bool:
    """Whether a stream says that its pictures have alpha, as a plane or, in VP8 and VP9, beside them."""
    return stream.metadata.get("alpha_mode") == "1" or has_alpha(stream.codec_context.pix_fmt or "")


def is_still(stream: VideoStream) -> bool:
    """Whether a video stream is a cover picture or a thumbnail."""
    still = av.stream.Disposition.attached_pic | av.stream.Disposition.timed_thumbnails
    return bool(stream.disposition & still)


def frame_rate(container: InputContainer, stream: VideoStream) -> Fraction | None:
    """A stream's average rate, pictures per second, or its codec's where the file has no times; None if unknown."""
    coded = stream.codec_context.framerate if container.format.flags & _NO_TIMESTAMPS else None
    rate = coded or stream.average_rate or stream.guessed_rate or stream.base_rate
    return Fraction(rate) if rate else None
