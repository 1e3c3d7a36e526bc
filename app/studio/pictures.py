"""Pictures inside of pages, RGB (h, w, 3)."""

from __future__ import annotations

import base64
from pathlib import Path

from guise.app.media import Frame
from guise.app.media.file_kind import kind_of
from guise.app.media.image_writing import encode_image
from guise.app.media.pictures import shrunk
from guise.app.media.segments import Scan, read_frames
from guise.app.media.stream_copies import suffix_for
from guise.app.media.time_range import TimeRange
from guise.app.studio.store import StudioError
from guise.common.arrays import U8

SHOWN_SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".webp"})  # of pictures, by every browser
WARM_UP_FRAMES = 6  # before a previewed one


def output_suffix(source: Path, encoder: str) -> str:
    """The suffix of what is made of a video or photo; browsers show that of a photo."""
    if kind_of(source) != "image":
        return suffix_for(source, encoder)
    return source.suffix if source.suffix.lower() in SHOWN_SUFFIXES else ".png"


def fitted_to(rgb: U8, width: int) -> U8:
    """A copy of a picture (h, w, 3), reduced to a width in pixels where it is larger."""
    return shrunk(rgb, min(1.0, width / rgb.shape[1]))


def frames_until(source: Path, scan: Scan, frame: int, part: TimeRange | None = None) -> list[Frame]:
    """A frame of a video after a few before it, over which light and occlusion settle.   part : that was scanned."""
    frames = list(read_frames(source, scan, max(0, frame - WARM_UP_FRAMES), frame + 1, part=part))
    if not frames:
        raise StudioError(f"frame {frame} cannot be decoded: choose another")
    return frames


def data_url(rgb: U8) -> str:
    """A picture (h, w, 3) as a data URL (JPEG)."""
    data = base64.b64encode(encode_image(rgb, None, ".jpg", {})).decode()
    return f"data:image/jpeg;base64,{data}"
