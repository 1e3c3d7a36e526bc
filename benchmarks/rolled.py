"""Pictures and clips rolled by any angle, with their points: for benchmarks of faces at any roll.

Degrees clockwise.  Quarter turns move pixels and change nothing; between them the picture is interpolated on a grey
canvas that holds all of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import av
import cv2
import numpy as np

from benchmarks.common import F64, Picture
from guise.app.media import open_input

CANVAS_GREY_LEVEL = 96


def rolled(rgb: Picture, degrees: float) -> tuple[Picture, F64]:
    """A picture (h, w, 3) rolled clockwise, and the affine map (2, 3) of its points."""
    height, width = rgb.shape[:2]
    cos, sin = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    linear = np.array([[cos, -sin], [sin, cos]])
    size = np.ceil(np.abs(linear) @ (width, height) - 1e-6).astype(int)
    centre, middle = (np.array([width, height]) - 1) / 2, (size - 1) / 2
    forward = np.column_stack([linear, middle - linear @ centre])
    if degrees % 90 == 0:
        return np.ascontiguousarray(np.rot90(rgb, -round(degrees / 90))), forward
    grey = (CANVAS_GREY_LEVEL,) * 3
    moved = cv2.warpAffine(rgb, forward, size.tolist(), flags=cv2.INTER_LINEAR, borderValue=grey)
    return np.asarray(moved, np.uint8), forward


def moved(points: F64, forward: F64) -> F64:
    """Points (..., 2) after an affine map (2, 3)."""
    return np.asarray(points @ forward[:, :2].T + forward[:, 2])


def write_rolled(video: Path, output: Path, degrees: Iterable[float]) -> list[F64]:
    """Write a clip rolled by an angle for each frame, losslessly; returns the affine map (2, 3) of each."""
    maps: list[F64] = []
    with open_input(video) as media, av.open(str(output), "w") as out:
        stream = out.add_stream("libx264", 30, {"qp": "0", "preset": "ultrafast"})
        stream.pix_fmt = "yuv420p"
        for frame, angle in zip(media, degrees, strict=False):
            picture, forward = rolled(frame.rgb(), angle)
            picture = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
            if not maps:
                stream.height, stream.width = picture.shape[:2]
            maps.append(forward)
            shown = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
            out.mux(stream.encode(shown))
        out.mux(stream.encode(None))
    return maps
