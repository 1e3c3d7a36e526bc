"""Which codecs this PyAV has, and from a user's options to the settings of one encoder."""

from __future__ import annotations

import contextlib
import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Literal

import av
import av.error
from av import library_versions as versions
from av.codec.codec import UnknownCodecError
from av.video.codeccontext import VideoCodecContext

from guise.app.media.errors import MediaError
from guise.app.media.pixel_formats import SHALLOW, depth, has_alpha, least_loss

_SUGGESTED = ("libx264", "libx265", "libsvtav1", "libvpx-vp9", "ffv1")
_X26X = frozenset({"libx264", "libx264rgb", "libx265"})
_X26X_PRESETS = (
    "ultrafast", "superfast", "veryfast", "faster", "fast", "medium", "slow", "slower", "veryslow", "placebo"
)  # fmt: skip
_ALWAYS_LOSSLESS = frozenset({"ffv1", "huffyuv", "ffvhuff", "utvideo", "png", "rawvideo"})
_QSCALE = frozenset({"mpeg4", "mpeg2video", "mpeg1video", "mjpeg", "msmpeg4v2", "msmpeg4", "h263", "flv"})
_EVEN_ONLY = frozenset({"libx264", "libx265", "libopenh264", "libsvtav1"})
_WITH_ALPHA = {".webm": "libvpx-vp9", ".mkv": "libvpx-vp9", ".mov": "prores_ks"}
_WITH_HEVC = frozenset({".mp4", ".m4v", ".mov", ".mkv", ".ts", ".mts", ".m2ts"})
_HARDWARE = frozenset({"nvenc", "qsv", "vaapi", "amf", "videotoolbox"})  # ends of names
# The rate control of x264 165 differs from run to run with AVX-512, and between machines by their instruction sets.
_COMMON_INSTRUCTIONS = "asm=sse2fast,sse4.2"
AUTO = "auto"
_DEFAULT_PRESET, _USUAL_CRF = "veryfast", 20


@dataclass(frozen=True)
class EncodeOptions:
    """How to encode: encoder name, constant rate factor 0..63 (lower is better), preset, or lossless.

    encoder : AUTO is what suits the pictures and the output's container, see `chosen_encoder`.
    crf : None is about as finely as the input is coded, see `coded_quality.py`.
    """

    encoder: str = AUTO
    crf: int | None = None
    preset: str = _DEFAULT_PRESET
    lossless: bool = False

    def __post_init__(self) -> None:
        if self.crf is not None and not 0 <= self.crf <= 63:
            raise MediaError(f"The crf must be from 0 (best) to 63, got {self.crf}: 18 to 28 is usual.")

    @property
    def rate_factor(self) -> int:
        """The crf, or the usual one."""
        return _USUAL_CRF if self.crf is None else self.crf

    @property
    def follows_input(self) -> bool:
        """Whether the crf is to be like the input's, which can be told on the scale of x264."""
        kind = self.encoder.rpartition("_")[2]
        return self.crf is None and not self.lossless and (self.encoder in _X26X or kind in _HARDWARE)


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


def find_encoder(name: str) -> av.Codec:
    """The video encoder of that name; MediaError lists some that exist."""
    if (codec := find_codec(name, "w")) is None:
        raise MediaError(f"Encoder {name!r} is not available: use one of {available_encoders()}.")
    if codec.type != "video":
        raise MediaError(
            f"Encoder {name!r} makes {codec.type}, not video: use one of {available_encoders()}."
        )
    return codec


def check_options(options: EncodeOptions) -> None:
    """Raise MediaError for an encoder that does not exist, or settings that it does not have."""
    if options.encoder == AUTO:
        options = replace(options, encoder="libx264")
    find_encoder(options.encoder)
    encoder_settings(options)


def chosen_encoder(suffix: str, fmt: str, *, lossless: bool = False) -> str:
    """The encoder for pictures of a native format in a file with a suffix; one with such a mode where it is lossless.

    >>> chosen_encoder(".mp4", "yuv420p"), chosen_encoder(".mp4", "yuv420p10le"), chosen_encoder(".webm", "yuva420p")
    ('libx264', 'libx265', 'libvpx-vp9')
    """
    deep, suffix = depth(fmt) > SHALLOW, suffix.lower()
    if has_alpha(fmt) and suffix in _WITH_ALPHA and not (lossless and suffix == ".mov"):
        name = _WITH_ALPHA[suffix]
    elif suffix == ".webm":
        name = "libsvtav1" if deep and not lossless else "libvpx-vp9"
    else:
        name = "libx265" if deep and suffix in _WITH_HEVC else "libx264"
    return name if find_codec(name, "w") else "libx264"


def available_encoders() -> str:
    """Some encoders of this installation, for a message."""
    return ", ".join(name for name in _SUGGESTED if name in av.codecs_available)


def encoder_settings(options: EncodeOptions, threads: int = 0) -> dict[str, str]:
    """The encoder's own options for a choice of crf, preset and lossless.

    threads : a fixed number, for the same output on any machine, or 0 for what suits this one.
    """
    name = options.encoder
    kind = name.rpartition("_")[2]
    if kind in _HARDWARE and not options.lossless:
        return _hardware_settings(kind, options)
    if name in _X26X:
        return _x26x_settings(options, threads)
    if options.lossless:
        return _lossless_settings(name)
    if name in _ALWAYS_LOSSLESS:
        return {}
    if name == "libvpx-vp9":
        return {"crf": str(options.rate_factor), "b": "0", "deadline": "good", "cpu-used": "5", "row-mt": "1"}
    if name == "libsvtav1":
        os.environ.setdefault("SVT_LOG", "1")  # otherwise it prints its settings
        return {
            "crf": str(options.rate_factor),
            "preset": "10" if options.preset == _DEFAULT_PRESET else options.preset,
        }
    if name in _QSCALE:
        quality = min(max(options.rate_factor // 4, 1), 31)
        return {"flags": "+qscale", "global_quality": str(quality * 118)}  # FF_QP2LAMBDA
    own = {} if options.preset == _DEFAULT_PRESET else {"preset": options.preset}
    return {"crf": str(options.rate_factor), **own}


def _x26x_settings(options: EncodeOptions, threads: int) -> dict[str, str]:
    if options.preset not in _X26X_PRESETS:
        raise MediaError(f"Preset {options.preset!r} is unknown: use one of {', '.join(_X26X_PRESETS)}.")
    if options.rate_factor > 51 and not options.lossless:
        raise MediaError(
            f"The crf of {options.encoder} must be from 0 (best) to 51, got {options.rate_factor}."
        )
    settings = {"preset": options.preset}
    if options.encoder == "libx265":
        pools = f":pools={threads}" if threads else ""
        settings["x265-params"] = "log-level=none" + pools + (":lossless=1" if options.lossless else "")
        return settings if options.lossless else settings | {"crf": str(options.rate_factor)}
    if threads and platform.machine().lower() in ("x86_64", "amd64"):
        settings["x264-params"] = _COMMON_INSTRUCTIONS
    return settings | ({"qp": "0"} if options.lossless else {"crf": str(options.rate_factor)})


def _hardware_settings(kind: str, options: EncodeOptions) -> dict[str, str]:
    """Constant quality, as near to the crf as the kind of encoder has it."""
    crf = str(options.rate_factor)
    settings = {
        "nvenc": {"rc": "vbr", "cq": crf, "b": "0"},
        "qsv": {"global_quality": crf},
        "vaapi": {"rc_mode": "CQP", "qp": crf},
        "amf": {"rc": "cqp", "qp_i": crf, "qp_p": crf},
        "videotoolbox": {
            "flags": "+qscale",
            "global_quality": str(118 * max(100 - 2 * options.rate_factor, 1)),
        },
    }[kind]
    return settings if options.preset == _DEFAULT_PRESET else settings | {"preset": options.preset}


def _lossless_settings(name: str) -> dict[str, str]:
    if name in _ALWAYS_LOSSLESS:
        return {}
    if name == "libvpx-vp9":
        return {"lossless": "1", "row-mt": "1"}
    raise MediaError(f"Encoder {name!r} has no lossless mode: use libx264, libx265, libvpx-vp9 or ffv1.")


def encoder_format(codec: av.Codec, name: str, held: Sequence[str] = ()) -> str:
    """The encoder's pixel format for a native one: the same, or the one that loses the least.

    held : formats that the container holds, where it does not hold all.
    """
    supported = [fmt.name for fmt in codec.video_formats or ()] or held
    supported = [fmt for fmt in supported if not has_alpha(fmt) or opens(codec.name, fmt)]
    if not supported or name in supported:
        return name
    if (nearest := least_loss(name, supported)) is None:
        raise MediaError(f"Encoder {codec.name!r} takes no YUV pictures: use one of {available_encoders()}.")
    return nearest


@cache
def opens(encoder: str, fmt: str) -> bool:
    """Whether an encoder takes a pixel format of those that it lists; libx265 may be built without alpha."""
    context = av.CodecContext.create(encoder, "w")
    assert isinstance(context, VideoCodecContext)
    context.width = context.height = 128
    context.pix_fmt, context.time_base = fmt, Fraction(1, 30)
    try:
        with ordinary_priority():
            context.open()
    except (av.error.FFmpegError, ValueError, OSError):
        return False
    return True


def encoded_size(encoder: str, fmt: str, width: int, height: int) -> tuple[int, int]:
    """The picture's size, extended to even numbers where encoder and chroma require it."""
    even_only = encoder in _EVEN_ONLY or encoder.rpartition("_")[2] in _HARDWARE
    if not even_only or "444" in fmt or fmt.startswith("gray"):
        return width, height
    return width + width % 2, height + height % 2


@contextlib.contextmanager
def ordinary_priority() -> Iterator[None]:
    """Leave this thread's scheduling, and that of threads begun in the block, as it is now.

    SVT-AV1, opened by root, gives itself and the thread that opens it the highest real-time priority, which leaves all
    other programs of the machine little time.
    """
    tasks = Path("/proc/self/task")
    if not hasattr(os, "sched_setscheduler") or not tasks.is_dir():
        yield
        return
    policy, param, before = os.sched_getscheduler(0), os.sched_getparam(0), set(os.listdir(tasks))
    try:
        yield
    finally:
        for thread in {"0"} | set(os.listdir(tasks)) - before:
            with contextlib.suppress(OSError):  # it may have ended
                os.sched_setscheduler(int(thread), policy, param)
