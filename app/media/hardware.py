"""Encoders and decoders in hardware: which of them work on this computer, and what takes their place elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Literal, get_args

import av
import av.error
from av.codec.context import CodecContext
from av.video.codeccontext import VideoCodecContext

from guise.app.media.encoder import EncodeOptions, find_codec
from guise.app.media.errors import reason

HardwareDecoder = Literal["none", "auto", "cuda", "vaapi", "videotoolbox", "d3d11va"]
DEVICES = tuple(name for name in get_args(HardwareDecoder) if name not in ("none", "auto"))
# Hardware encoder -> the one on the processor that writes the same format.
ENCODERS = {
    f"{codec}_{kind}": software
    for codec, software in (("h264", "libx264"), ("hevc", "libx265"), ("av1", "libsvtav1"))
    for kind in ("nvenc", "qsv", "vaapi", "amf", "videotoolbox")
}
_TRIED_PIXELS = 256  # sides of the picture with which an encoder is tried
_MISSING = "not in this PyAV"


@cache
def encoder_fault(name: str) -> str:
    """Why a hardware encoder does not work on this computer, in a few words; "" where it does."""
    if (codec := find_codec(name, "w")) is None:
        return _MISSING
    formats = [fmt.name for fmt in codec.video_formats or ()]
    context = CodecContext.create(codec, "w")
    assert isinstance(context, VideoCodecContext)
    context.width = context.height = _TRIED_PIXELS
    context.pix_fmt = next((fmt for fmt in ("yuv420p", "nv12") if fmt in formats), "yuv420p")
    context.time_base = Fraction(1, 30)
    try:
        context.open()
    except (av.error.FFmpegError, ValueError, OSError) as error:
        return reason(error).split(":")[0]
    return ""


def working_encoder(options: EncodeOptions, note: Callable[[str], None]) -> EncodeOptions:
    """The options with an encoder on the processor, and a note, where the hardware encoder they name does not work."""
    software = ENCODERS.get(options.encoder)
    fault = encoder_fault(options.encoder) if software else ""
    if not software or not fault:
        return options
    note(f"Encoder {options.encoder} does not work on this computer ({fault}): {software} was used.")
    return replace(options, encoder=software)


def working_decoder(wanted: HardwareDecoder, note: Callable[[str], None]) -> str | None:
    """The device that is to decode; None for the processor, with a note where the wanted device does not work."""
    if wanted in ("none", "auto"):
        return next((d for d in DEVICES if not decoder_fault(d)), None) if wanted == "auto" else None
    if not (fault := decoder_fault(wanted)):
        return wanted
    note(f"Decoding by {wanted} does not work on this computer ({fault}): the processor decoded.")
    return None


@cache
def decoder_fault(device: str) -> str:
    """Why a kind of device cannot decode on this computer, in a few words; "" where it can."""
    from av.codec.hwaccel import HWAccel, hwdevices_available

    if device not in hwdevices_available():
        return _MISSING
    try:
        HWAccel(device).create(av.Codec("h264", "r"))
    except (av.error.FFmpegError, NotImplementedError, RuntimeError, ValueError, OSError) as error:
        return reason(error).split(":")[0]
    return ""
