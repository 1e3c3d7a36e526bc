"""The pixel formats in which frames are kept as they are stored, and which of them is nearest to another one."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache

import av
from av.video.format import VideoFormat

_SHIFTS = {"420": (1, 1), "422": (1, 0), "444": (0, 0)}
SHALLOW = 8  # bits of a component
_DEPTHS = (9, 10, 12, 14, 16)  # bits of a component, of those with more than 8
_ALPHA_DEPTHS = (9, 10, 12, 16)

# Formats of 8 bits: log2 of the chroma step along x and y.
SHALLOW_FORMATS: dict[str, tuple[int, int]] = {
    **{f"yuv{kind}p": shift for kind, shift in _SHIFTS.items()},
    **{f"yuvj{kind}p": shift for kind, shift in _SHIFTS.items()},
    "nv12": (1, 1),
    "gray": (0, 0),
    **{f"yuva{kind}p": shift for kind, shift in _SHIFTS.items()},
}
# Formats of 9 to 16 bits, each component in the low bits of two bytes.
DEEP_FORMATS: dict[str, tuple[int, int]] = {
    **{f"yuv{kind}p{bits}le": shift for bits in _DEPTHS for kind, shift in _SHIFTS.items()},
    **{
        f"yuva{kind}p{bits}le": shift
        for bits in _ALPHA_DEPTHS
        for kind, shift in _SHIFTS.items()
        if (kind, bits) != ("420", 12)
    },
    **{f"gray{bits}le": (0, 0) for bits in _DEPTHS},
}
NATIVE_FORMATS = SHALLOW_FORMATS | DEEP_FORMATS


@cache
def depth(name: str) -> int:
    """Bits of a component of a pixel format.

    >>> depth("yuv420p"), depth("yuv422p10le")
    (8, 10)
    """
    return max((part.bits for part in VideoFormat(name).components), default=SHALLOW)


def has_alpha(name: str) -> bool:
    """Whether a native format has a plane of alpha, its last one."""
    return name.startswith("yuva")


def nearest_format(picture: av.VideoFrame) -> str:
    """The native pixel format that keeps the most of a picture's own."""
    fmt = picture.format
    parts = fmt.components
    bits = min((one for one in (SHALLOW, *_DEPTHS) if one >= depth(fmt.name)), default=16)
    alpha = any(part.is_alpha for part in parts)
    deep = "" if bits == SHALLOW else f"{bits}le"
    if not fmt.is_rgb and not fmt.has_palette and len(parts) < 3 and not alpha:
        return f"gray{deep}"
    kind = "444"
    if not fmt.is_rgb and not fmt.has_palette and len(parts) > 2 and fmt.chroma_width(64) < 64:
        kind = "420" if fmt.chroma_height(64) < 64 else "422"
    name = f"yuv{'a' if alpha else ''}{kind}p{deep}"
    return name if name in NATIVE_FORMATS else f"yuva{kind}p16le"


def _chroma_steps(name: str) -> int:
    """How coarse a native format's chroma is: 0 for that of every pixel, 3 for none."""
    return 3 if name.startswith("gray") else sum(NATIVE_FORMATS[name])


def least_loss(name: str, choices: Iterable[str]) -> str | None:
    """Which of some formats loses the least of a native one, and adds the least to it; None when none is native.

    Alpha counts most, then bits, then chroma.

    >>> least_loss("yuv422p10le", ["yuv420p10le", "yuv422p", "yuv444p10le"])
    'yuv444p10le'
    """
    wanted = name.replace("yuvj", "yuv")

    def cost(other: str) -> tuple[int, ...]:
        chroma = _chroma_steps(other) - _chroma_steps(wanted)
        bits = depth(wanted) - depth(other)
        alpha = has_alpha(wanted) - has_alpha(other)
        order = list(NATIVE_FORMATS).index(other)
        return (max(alpha, 0), max(bits, 0), max(chroma, 0), -bits, -chroma, -alpha, order)

    native = [other for other in choices if other in NATIVE_FORMATS and not other.startswith("yuvj")]
    return min(native, key=cost, default=None)
