"""Clips made for the benchmarks of people."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av

from guise.common.arrays import U8

FPS = 30


def written(pictures: Iterable[U8], output: Path) -> Path:
    """Pictures (h, w, 3) RGB as a video."""
    with av.open(str(output), "w") as container:
        stream = None
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            if stream is None:
                stream = container.add_stream("libx264", FPS, {"crf": "14", "preset": "ultrafast"})
                stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
            frame.pts, frame.time_base = number, Fraction(1, FPS)
            container.mux(stream.encode(frame))
        assert stream is not None
        container.mux(stream.encode(None))
    return output
