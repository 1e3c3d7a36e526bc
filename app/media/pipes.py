"""Standard input and output in place of files: y4m, raw video and NUT.

Inside, a pipe is a path `pipe:WHAT`, where WHAT is the format of an output, or the size, rate and pixel format of raw
pictures.  An input can be read once, and an output is not written whole or not at all, as a file is.
"""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

from guise.app.media.encoder import AUTO, EncodeOptions
from guise.app.media.errors import MediaError
from guise.app.media.pixel_formats import NATIVE_FORMATS, has_alpha

FORMATS = {"y4m": "yuv4mpegpipe", "rawvideo": "rawvideo", "nut": "nut"}  # as FFmpeg calls them
_PREFIX = "pipe:"
_RAW = re.compile(r"(\d+)x(\d+)@(\d+(?:[/.]\d+)?)(?::(\w+))?")
_RAW_ENCODER = "rawvideo"
READ_ONCE = (
    "A pipe can be read only once: give the model of the person in it with --source, or write it to a file."
)
UNREADABLE = (
    "What comes through the pipe is no video that says what it is, such as y4m or NUT: describe raw video with --raw "
    "640x480@30."
)


def is_pipe(path: Path) -> bool:
    """Whether a path stands for standard input or output."""
    return str(path).startswith(_PREFIX)


def input_pipe(raw: str | None = None) -> Path:
    """Standard input.   raw : WIDTHxHEIGHT@RATE[:PIXELS] of raw pictures, which say nothing of themselves."""
    if raw is not None and not _RAW.fullmatch(raw):
        raise MediaError(f"--raw {raw} must be like 640x480@30 or 1280x720@30000/1001:yuv422p.")
    return Path(_PREFIX + (raw or "").replace("/", "%"))


def output_pipe(name: str) -> Path:
    """Standard output in one of `FORMATS`."""
    return Path(_PREFIX + name)


def opened_as(path: Path) -> tuple[str, str | None, dict[str, str]]:
    """What FFmpeg opens to read a file or pipe, and the format and the options of raw pictures."""
    if not is_pipe(path):
        # an absolute path, as FFmpeg takes anything before a colon for a protocol
        return str(path.absolute()), None, {}
    if sys.stdin is not None and sys.stdin.isatty():
        raise MediaError(
            "Nothing comes through the pipe: write the pictures to guise, as in PROGRAM | guise swap -."
        )
    found = _RAW.fullmatch(str(path).removeprefix(_PREFIX).replace("%", "/"))
    if found is None:
        return "pipe:0", None, {}
    width, height, rate, pixels = found.groups()
    options = {"video_size": f"{width}x{height}", "framerate": rate, "pixel_format": pixels or "yuv420p"}
    return "pipe:0", _RAW_ENCODER, options


def written_as(path: Path) -> tuple[str, dict[str, str]]:
    """FFmpeg's format of an output pipe, and its options."""
    if sys.stdout is not None and sys.stdout.isatty():
        raise MediaError("- is the terminal: pipe the pictures into a program, or give a file with -o.")
    return FORMATS[str(path).removeprefix(_PREFIX)], {"strict": "-1"}  # y4m of more than 8 bits


def holds_times(path: Path) -> bool:
    """Whether an output pipe holds the times of pictures; y4m and raw video have only a rate, or none."""
    return str(path) == _PREFIX + "nut"


def formats_of(path: Path) -> list[str]:
    """The native pixel formats that an output pipe holds; none where it holds all."""
    if str(path) != _PREFIX + "y4m":
        return []
    return [name for name in NATIVE_FORMATS if name != "nv12" and not has_alpha(name)]


def encoded_for(path: Path, options: EncodeOptions) -> EncodeOptions:
    """The options with which pictures are written to a pipe: raw, unless NUT is to hold others."""
    name = str(path).removeprefix(_PREFIX)
    if name != "nut" and options.encoder not in (AUTO, _RAW_ENCODER):
        raise MediaError(f"{name} holds raw pictures: leave out --encoder, or use --pipe nut.")
    return replace(options, encoder=_RAW_ENCODER) if options.encoder == AUTO else options
