"""What HDR pictures say beside their pixels: the display they were graded on, their brightest light, Dolby Vision."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import av

from guise.app.media.rendition import HLG, is_hdr

_RATIONALS = struct.Struct("@20i2i")  # AVMasteringDisplayMetadata: ten of them, and which of them are known
_LIGHT = struct.Struct("@2I")  # AVContentLightMetadata


@dataclass(frozen=True)
class LightLevels:
    """The metadata of SMPTE ST 2086 and CTA-861.3.

    display : x, y of the red, green, blue and white point, then the least and the most nits; None where unknown.
    content : the most nits of a pixel, and of a picture's mean; None where unknown.
    """

    display: tuple[float, ...] | None = None
    content: tuple[int, int] | None = None

    def settings(self, encoder: str) -> dict[str, str] | None:
        """The encoder's own options that write them into its stream; None when it has none."""
        if encoder == "libsvtav1":
            return self._settings("svtav1-params", "mastering-display", "content-light", (1, 1))
        if encoder == "libx265":
            return self._settings("x265-params", "master-display", "max-cll", (50_000, 10_000))
        if encoder == "libx264":
            return self._settings("x264-params", "mastering-display", "cll", (50_000, 10_000))
        return None

    def _settings(self, option: str, display: str, content: str, units: tuple[int, int]) -> dict[str, str]:
        found = []
        if self.display:
            scaled = [
                value * unit
                for value, unit in zip(self.display, [units[0]] * 8 + [units[1]] * 2, strict=True)
            ]
            red, green, blue, white, (least, most) = (
                [f"{value:.0f}" if units[0] > 1 else f"{value:.6f}" for value in scaled[i : i + 2]]
                for i in range(0, 10, 2)
            )
            points = {"G": green, "B": blue, "R": red, "WP": white, "L": [most, least]}
            found.append(
                f"{display}=" + "".join(f"{name}({','.join(pair)})" for name, pair in points.items())
            )
        if self.content:
            found.append(f"{content}={self.content[0]},{self.content[1]}")
        return {option: ":".join(found)}


def light_levels(picture: av.VideoFrame) -> LightLevels | None:
    """What a decoded picture says; None when it says nothing."""
    display, content = _side(picture, "MASTERING_DISPLAY_METADATA"), _side(picture, "CONTENT_LIGHT_LEVEL")
    points, most = None, None
    if len(display) >= _RATIONALS.size:
        *values, has_points, has_light = _RATIONALS.unpack_from(display)
        if has_points and has_light:
            points = tuple(n / (d or 1) for n, d in zip(values[::2], values[1::2], strict=True))
    if len(content) >= _LIGHT.size:
        most = _LIGHT.unpack_from(content)
    return LightLevels(points, (most[0], most[1]) if most else None) if points or most else None


def changing_metadata(picture: av.VideoFrame) -> list[str]:
    """Names of metadata that change from picture to picture, which no encoder here writes."""
    kinds = {
        "Dolby Vision's": ("DOVI_RPU_BUFFER", "DOVI_METADATA"),
        "HDR10+'s": ("DYNAMIC_HDR_PLUS",),
        "HDR Vivid's": ("DYNAMIC_HDR_VIVID",),
    }
    return [name for name, sides in kinds.items() if any(_side(picture, side) for side in sides)]


def hdr_name(transfer: int) -> str:
    """What people call the transfer of HDR; "" when it is none."""
    return ("HLG" if transfer == HLG else "HDR10") if is_hdr(transfer) else ""


def merged(settings: Mapping[str, str], more: Mapping[str, str]) -> dict[str, str]:
    """An encoder's options with others, of which those that hold parameters are joined."""
    return {
        **settings,
        **{key: ":".join(filter(None, (settings.get(key), value))) for key, value in more.items()},
    }


def _side(picture: av.VideoFrame, kind: str) -> bytes:
    found: Any = picture.side_data.get(kind)
    return b"" if found is None else bytes(found)
