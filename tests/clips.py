"""Short clips for tests, cut from the sample videos or made up."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from made_up import SAMPLES

from guise.aam.landmarks.schemes import IBUG68


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


def empty_scene(path: Path, frames: int = 8, *, rate: int = 30) -> Path:
    """A video without anybody in it, each frame one grey level lighter than the one before."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        for i in range(frames):
            rgb = np.full((240, 320, 3), 90 + i, np.uint8)
            frame = av.VideoFrame.from_ndarray(rgb, "rgb24")
            frame.pts, frame.time_base = i, Fraction(1, rate)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def pictures(path: Path) -> list[np.ndarray]:
    """The luma (h, w) of every frame of a video."""
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


def sampled(clip: str, step: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every step-th frame of a sample clip and its 68 points."""
    points = np.load(SAMPLES / f"{clip}.npz")["landmarks"][:, IBUG68]
    capture = cv2.VideoCapture(str(SAMPLES / f"{clip}.mp4"))
    frames = []
    for index in range(len(points)):
        assert capture.grab()
        if index % step == 0:
            frames.append((cv2.cvtColor(capture.retrieve()[1], cv2.COLOR_BGR2RGB), points[index]))
    capture.release()
    return frames


def tags(path: Path) -> dict[str, str]:
    """The container's metadata."""
    with av.open(str(path)) as container:
        return dict(container.metadata)


def two_people(path: Path, frames: int, places: Callable[[float], tuple[float, float]]) -> np.ndarray:
    """p06 and, before her, p01 on plain ground, 480 x 240; returns the truth (2, frames, 81, 2), p01 first.

    places : of the two heads' middles across the picture, pixels, p01 first, at a time from 0 to 1.
    """
    people = [_small(person, frames) for person in ("p01", "p06")]
    truth = np.zeros((2, frames, 81, 2))
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 30, {"crf": "14", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = 480, 240, "yuv420p"
        for i in range(frames):
            canvas = np.full((240, 480, 3), (90, 100, 110), np.float64)
            for k in (1, 0):
                pictures, points, alpha = people[k]
                shift = np.array([places(i / max(frames - 1, 1))[k], 120.0]) - points.mean((0, 1))
                move = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
                shown, share = (cv2.warpAffine(one, move, (480, 240)) for one in (pictures[i], alpha))
                canvas += share[..., None] * (shown - canvas)
                truth[k, i] = points[i] + shift
            out.mux(stream.encode(av.VideoFrame.from_ndarray(canvas.round().astype(np.uint8), "rgb24")))
        out.mux(stream.encode(None))
    return truth


def _small(person: str, frames: int) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """The frames of a clip at half size, the landmarks, and the share (h, w) of the picture that is the head."""
    points = (np.load(SAMPLES / person / "talk.npz")["landmarks"][:frames] + 0.5) / 2 - 0.5
    with av.open(str(SAMPLES / person / "talk.mp4")) as source:
        decoded = (frame.to_ndarray(format="rgb24") for frame in source.decode(video=0))
        pictures = [cv2.resize(next(decoded), None, fx=0.5, fy=0.5).astype(np.float64) for _ in range(frames)]
    ys, xs = np.mgrid[: pictures[0].shape[0], : pictures[0].shape[1]]
    middle, size = points.mean((0, 1)), np.ptp(points.reshape(-1, 2), axis=0) * (0.78, 0.85)
    away = np.hypot((xs - middle[0]) / size[0], (ys - middle[1] + 0.1 * size[1]) / size[1])
    return pictures, points, np.clip((1.05 - away) * 10, 0, 1)
