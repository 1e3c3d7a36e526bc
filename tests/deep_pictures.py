"""Pictures of more than 8 bits and of HDR, as video has them."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np

from guise.app.media import Frame
from guise.app.media.colour import BT709, LIMITED
from guise.app.media.deep_frame import frame_of
from guise.app.media.frame import plane_arrays
from guise.app.media.orientation import Orientation
from guise.app.media.pixel_formats import depth
from guise.app.media.rendition import PQ

TICK = Fraction(1, 30)
UPRIGHT = Orientation()


def filled(
    fmt: str, seed: int = 0, width: int = 37, height: int = 23, transfer: int = BT709
) -> av.VideoFrame:
    """Smooth colours that a camera can see, with noise in the last bits; alpha falls from left to right."""
    rng, most = np.random.default_rng(seed), (1 << depth(fmt)) - 1
    video = av.VideoFrame(width, height, fmt)
    for number, plane in enumerate(plane_arrays(video)):
        y, x = np.mgrid[: plane.shape[0], : plane.shape[1]]
        middle, swing = ((0.5, 0.25) if number == 0 else (0.5, 0.03)) if number < 3 else (0.5, 0.0)
        values = middle + swing * np.sin(x / 5 + number + seed) * np.cos(y / 7)
        values += 0.4 * (1 - 2 * x / plane.shape[1]) if number == 3 else 0
        plane[:] = np.clip(values * most + rng.normal(0, most / 300, plane.shape), 0, most)
    video.color_trc, video.colorspace, video.color_primaries = transfer, 9, 9
    video.color_range = LIMITED
    return video


def framed(video: av.VideoFrame, orientation: Orientation = UPRIGHT) -> Frame:
    return frame_of(video, pts=0, time_base=TICK, index=0, orientation=orientation)


def stored(frame: Frame) -> list[np.ndarray]:
    assert frame.video_frame is not None
    return [plane.copy() for plane in plane_arrays(frame.video_frame)]


def code_of(nits: np.ndarray, transfer: int) -> np.ndarray:
    """R'G'B' in 0..1 of light, written anew from ITU-R BT.2100 for tests."""
    if transfer == PQ:
        power = (nits / 10_000) ** (1305 / 8192)
        return np.asarray(((107 / 128 + 2413 / 128 * power) / (1 + 2392 / 128 * power)) ** (2523 / 32))
    scene = 12 * (nits / 1000) ** (1 / 1.2)
    low = np.sqrt(np.minimum(scene, 1)) / 2
    return np.where(scene <= 1, low, 0.17883277 * np.log(np.maximum(scene, 1) - 0.28466892) + 0.55991073)
