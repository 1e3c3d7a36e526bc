"""The pictures that an encoder gets: size, pixel format and tags, and the conversion of frames to them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction

import av
import numpy as np

from guise.app.media import colour
from guise.app.media.encoder import EncodeOptions, encoded_size, encoder_format
from guise.app.media.errors import MediaError
from guise.app.media.frame import NATIVE_FORMATS, Frame, clone_video_frame
from guise.app.media.input import MediaInput, VideoInput
from guise.app.media.orientation import AS_STORED, Orientation
from guise.app.media.reader import is_full_range, reformat


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
    media: MediaInput, codec: av.Codec, options: EncodeOptions, size: tuple[int, int] | None
) -> PictureFormat:
    """The picture format for an input; with a `size` the pictures are taken as shown, without rotation."""
    if size is not None or not isinstance(media, VideoInput):
        width, height = size or (media.width, media.height)
        fmt = encoder_format(codec, "yuv420p", (1, 1))
        return PictureFormat((width, height), encoded_size(options.encoder, fmt, width, height), fmt)
    look = media.first_picture
    fmt = encoder_format(codec, look.format.name, NATIVE_FORMATS[look.format.name])
    shape = (look.width, look.height)
    form = PictureFormat(
        shape, encoded_size(options.encoder, fmt, *shape), fmt, int(look.colorspace),
        colour.FULL if is_full_range(look) else int(look.color_range), int(look.color_primaries),
        int(look.color_trc), media.orientation,
    )  # fmt: skip
    return replace(form, display_matrix=media.display_matrix, aspect=media.stream.sample_aspect_ratio)
