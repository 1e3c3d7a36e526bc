"""How the pictures of one input are encoded: an encoder, its settings and the pictures it gets, to which frames are
converted: size, pixel format and tags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType

from guise.app.media import colour
from guise.app.media.coded_quality import crf_like
from guise.app.media.encoder import (
    AUTO,
    EncodeOptions,
    chosen_encoder,
    encoded_size,
    encoder_format,
    encoder_settings,
    find_encoder,
)
from guise.app.media.errors import MediaError
from guise.app.media.frame import Frame, clone_video_frame
from guise.app.media.hardware import working_encoder
from guise.app.media.hdr import hdr_name, merged
from guise.app.media.input import MediaInput, VideoInput
from guise.app.media.orientation import AS_STORED, Orientation
from guise.app.media.pipes import encoded_for, formats_of, holds_times, is_pipe
from guise.app.media.pixel_formats import depth, has_alpha
from guise.app.media.reader import is_full_range, reformat
from guise.app.media.rendition import BT2020, HLG, is_hdr

_WITH_ALPHA = "without --encoder, .webm and .mkv keep it."
_X265_FRAMES = 3  # fewer than which get decoding times from uninitialised memory where x265 reorders them
_CAPTIONING = frozenset({"libx264", "libx264rgb", "mpeg2video"})  # encoders that write captions by default


@dataclass(frozen=True)
class PictureFormat:
    """The format of an encoder's pictures.

    size : stored width and height of the picture; coded : the same, extended to what the encoder accepts.
    fmt : pixel format; matrix, span, primaries, transfer : colour tags as FFmpeg numbers them.
    orientation, display_matrix : from the stored to the shown picture.
    aspect : sample aspect ratio, stored, or None.
    """

    size: tuple[int, int]
    coded: tuple[int, int]
    fmt: str
    matrix: int = colour.BT709
    span: int = colour.LIMITED
    primaries: int = colour.BT709
    transfer: int = colour.BT709
    orientation: Orientation = AS_STORED
    display_matrix: tuple[int, ...] | None = None
    aspect: Fraction | None = None

    def picture(self, frame: Frame) -> av.VideoFrame:
        """The frame in this format: the decoder's own picture wherever possible."""
        video = frame.video_frame
        if video is None or frame.orientation != self.orientation or (video.width, video.height) != self.size:
            return self._from_rgb(frame)
        if is_hdr(video.color_trc) > is_hdr(self.transfer):
            return self._from_rgb(frame)
        if video.format.name == self.fmt and self.coded == self.size:
            return video
        if video.format.name.replace("yuvj", "yuv") != self.fmt.replace("yuvj", "yuv"):
            video = reformat(video, *self.size, self.fmt)
            if self.coded == self.size:
                return video
        return clone_video_frame(video, *self.coded, self.fmt)

    def _from_rgb(self, frame: Frame) -> av.VideoFrame:
        """Convert the whole picture as shown."""
        if (frame.width, frame.height) != self.orientation.size(*self.size):
            wanted = self.orientation.size(*self.size)
            raise MediaError(
                f"Frame {frame.name or frame.index} has {frame.width} x {frame.height} pixels but the video "
                f"{wanted[0]} x {wanted[1]}: give pictures of one size, or write to a folder."
            )
        stored = np.ascontiguousarray(self.orientation.stored_view(frame.rgb()))
        known = self.matrix not in (colour.RGB, colour.UNSPECIFIED)
        fallback = colour.BT709 if stored.shape[0] >= 720 else colour.BT470BG
        video = av.VideoFrame.from_ndarray(stored, "rgb24").reformat(
            format=self.fmt,
            dst_colorspace=self.matrix if known else fallback,
            dst_color_range=colour.FULL if self.span == colour.FULL else colour.LIMITED,
        )
        video.duration = frame.duration
        return video if self.coded == self.size else clone_video_frame(video, *self.coded)


def picture_format_for(
    media: MediaInput, codec: av.Codec, options: EncodeOptions, output: Path, size: tuple[int, int] | None
) -> PictureFormat:
    """The picture format for an input; with a `size` the pictures are taken as shown, without rotation."""
    if size is not None or not isinstance(media, VideoInput):
        width, height = size or (media.width, media.height)
        fmt = encoder_format(codec, "yuv420p")
        return PictureFormat((width, height), encoded_size(options.encoder, fmt, width, height), fmt)
    look = media.first_picture
    fmt = encoder_format(codec, look.format.name, formats_of(output))
    shape = (look.width, look.height)
    form = PictureFormat(
        shape, encoded_size(options.encoder, fmt, *shape), fmt, int(look.colorspace),
        colour.FULL if is_full_range(look) else int(look.color_range), int(look.color_primaries),
        int(look.color_trc), media.orientation,
    )  # fmt: skip
    return replace(form, display_matrix=media.display_matrix, aspect=media.stream.sample_aspect_ratio)


@dataclass(frozen=True)
class Encoding:
    """An encoder and its complete configuration.

    codec : FFmpeg's name of the coded format.   encoder, settings : FFmpeg's name of the encoder, its own options.
    picture_format : of its pictures.   rate : average frames per second.   time_base : unit of pts, seconds.
    field_order : of interlaced pictures, as FFmpeg numbers it, or None.
    threads : of the encoder; 0 for as many as suit the machine, on which the output then depends.
    counts : frames are counted, in `time_base`, as the container holds no times, only one rate.
    """

    codec: str
    encoder: str
    settings: dict[str, str]
    picture_format: PictureFormat
    rate: Fraction
    time_base: Fraction
    field_order: int | None
    threads: int
    counts: bool = False

    def configure(self, context: VideoCodecContext) -> None:
        """Set up an encoder's context, except for its own options."""
        form = self.picture_format
        context.width, context.height = form.coded
        context.pix_fmt = form.fmt
        context.framerate, context.time_base = self.rate, self.time_base
        context.thread_type = "AUTO"  # whole frames where it can: slices cost bits
        if self.threads:
            context.thread_count = self.threads
        context.flags |= Flags.frame_duration
        context.color_range, context.colorspace = form.span, form.matrix
        context.color_primaries, context.color_trc = form.primaries, form.transfer
        if form.aspect:
            context.sample_aspect_ratio = form.aspect
        if self.field_order is not None:
            context.field_order = self.field_order

    def picture(self, frame: Frame) -> av.VideoFrame:
        """The frame as the encoder wants it."""
        picture = self.picture_format.picture(frame)
        picture.pict_type = PictureType.NONE  # the encoder decides, not the input's encoder
        picture.pts, picture.time_base = frame.pts, frame.time_base
        if self.counts:
            picture.pts, picture.time_base = frame.index, self.time_base
        return picture


def encoding_for(
    media: MediaInput, options: EncodeOptions, output: Path, size: tuple[int, int] | None = None, *,
    threads: int = 0, captions: bool = True,
) -> Encoding:  # fmt: skip
    """The encoding for an input; what the encoder cannot keep is noted in the input's problems.

    output : the file that is written in the end; its suffix is that of the container.
    size : (width, height) of the frames if it differs from the input's.
    captions : whether encoders that can write closed captions keep those in the pictures.
    """
    if is_pipe(output):
        options = encoded_for(output, options)
    if options.encoder == AUTO:
        fmt = media.first_picture.format.name if isinstance(media, VideoInput) and size is None else "yuv420p"
        fmt = fmt if media.has_alpha else fmt.replace("yuva", "yuv")
        options = replace(options, encoder=chosen_encoder(output.suffix, fmt, lossless=options.lossless))
    options = working_encoder(options, media.problems.note)
    codec = find_encoder(options.encoder)
    options = replace(options, encoder=codec.name)  # "h264" finds libx264
    if options.follows_input:
        options = replace(options, crf=crf_like(media.quantiser if isinstance(media, VideoInput) else None))
    form = picture_format_for(media, codec, options, output, size)
    settings = encoder_settings(options, threads)
    if not captions and codec.name in _CAPTIONING:
        settings = settings | {"a53cc": "0"}
    if is_hdr(form.transfer) and is_pipe(output) and codec.name == "rawvideo":
        media.problems.note(
            f"Raw pictures say nothing of HDR: they are {_told(form)}, as what reads them must know."
        )
    else:
        settings = merged(settings, _light_settings(media, codec.name, size))
    if codec.name == "libx265" and (media.frame_count or _X265_FRAMES) < _X265_FRAMES:
        settings = merged(settings, {"x265-params": "bframes=0"})
    interlaced = isinstance(media, VideoInput) and media.interlaced
    if interlaced and "x26" in codec.name:
        settings = {"flags": "+ildct+ilme", **settings}
    order = media.stream.codec_context.field_order if interlaced else None  # type: ignore[attr-defined]
    _note_changes(media, form, "y4m" if formats_of(output) else codec.name, is_copy=size is None)
    counts = is_pipe(output) and not holds_times(output)
    return Encoding(
        codec.canonical_name,
        codec.name,
        settings,
        form,
        media.frame_rate,
        1 / media.frame_rate if counts else media.time_base,
        order,
        threads,
        counts,
    )


def _told(form: PictureFormat) -> str:
    wide = " with the colours of BT.2020" if form.primaries == BT2020 else ""
    return ("HLG" if form.transfer == HLG else "PQ") + wide


def _note_changes(media: MediaInput, form: PictureFormat, encoder: str, *, is_copy: bool) -> None:
    """Note what the pictures lose; is_copy : whether they are the input's, and not others of its time."""
    if form.coded != form.size:
        media.problems.note(
            f"The picture was extended from {form.size[0]} x {form.size[1]} to {form.coded[0]} x "
            f"{form.coded[1]}, as {encoder} needs even sizes."
        )
    if not is_copy or not isinstance(media, VideoInput) or form.fmt == media.first_picture.format.name:
        return
    native, deep = media.first_picture.format.name, depth(media.first_picture.format.name)
    if deep > depth(form.fmt) and is_hdr(form.transfer):
        media.problems.note(
            f"HDR was reduced from {deep} to {depth(form.fmt)} bits, as {encoder} has no more here: use --encoder "
            "libx265, libsvtav1 or libx264."
        )
    elif has_alpha(native) and not has_alpha(form.fmt):
        if media.has_alpha:
            media.problems.note(f"Transparency was left out, as {encoder} has none: {_WITH_ALPHA}")
    elif native.replace("yuvj", "yuv") != form.fmt.replace("yuvj", "yuv"):
        media.problems.note(f"Pictures were encoded as {form.fmt}, as {encoder} has no {native}.")


def _light_settings(media: MediaInput, encoder: str, size: tuple[int, int] | None) -> dict[str, str]:
    """Options that write what HDR pictures say of their light; what can't be written is noted."""
    if size is not None or not isinstance(media, VideoInput):
        return {}
    look = media.first_picture
    for name in media.changing_metadata:
        base = hdr_name(look.color_trc)
        kept = f"the pictures are kept as {base}" if base else "without it their colours may be wrong"
        media.problems.note(f"{name} metadata of every picture was left out: {kept}.")
    levels = media.light_levels
    settings = levels.settings(encoder) if levels else {}
    if settings is None:
        media.problems.note(
            f"The HDR metadata of display and light levels was left out, as {encoder} writes none."
        )
    return settings or {}
