"""Short clips for tests, cut from the sample videos or made up."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from made_up import SAMPLES


def cut(person: str, path: Path, frames: int, *, clip: str = "talk2.mp4") -> Path:
    """The first frames of a sample clip, with sound, losslessly."""
    with av.open(str(SAMPLES / person / clip)) as source, av.open(str(path), "w") as out:
        old, sound = source.streams.video[0], source.streams.audio[0]
        new = out.add_stream("libx264", 30, {"qp": "0", "preset": "ultrafast"})
        new.width, new.height, new.pix_fmt = old.width, old.height, "yuv420p"
        copy = out.add_stream_from_template(sound)
        end = frames / 30
        for frame in source.decode(old):
            if frame.time >= end:
                break
            frame.pict_type = 0
            out.mux(new.encode(frame))
        out.mux(new.encode(None))
        source.seek(0)
        for packet in source.demux(sound):
            if packet.dts is not None and packet.dts * packet.time_base < end:
                packet.stream = copy
                out.mux(packet)
    return path


def empty_scene(path: Path, frames: int = 8) -> Path:
    """A video without anybody in it."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for i in range(frames):
            rgb = np.full((240, 320, 3), 90 + i, np.uint8)
            frame = av.VideoFrame.from_ndarray(rgb, "rgb24")
            frame.pts, frame.time_base = i, Fraction(1, 30)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def pictures(path: Path) -> list[np.ndarray]:
    """The luma (h, w) of every frame of a video."""
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def tags(path: Path) -> dict[str, str]:
    """The container's metadata."""
    with av.open(str(path)) as container:
        return dict(container.metadata)
