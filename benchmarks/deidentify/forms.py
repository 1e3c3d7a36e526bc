"""Forms of a clip in which a finder of upright faces may fail: rolled, mirrored, negative, half out of the picture.

Each keeps where the true faces are.  Pixels, x right, y down, pixel centres at integers; RGB.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path

import av
import numpy as np

from benchmarks.common import F64, Picture
from benchmarks.deidentify.changes import Truth
from benchmarks.rolled import moved, rolled
from guise.app.media import open_input

Change = Callable[[Picture], tuple[Picture, F64]]  # and the affine map (2, 3) of its points

AS_IT_IS = "0"
SPOILED = ("mirrored", "negative", "half-left", "half-below")
ALL_ROLLS = tuple(str(degrees) for degrees in range(0, 360, 15))
MIN_CROPPED_PIXELS = 64


def in_form(
    video: Path, truths: Sequence[Truth], form: str, folder: Path, frames: int | None
) -> tuple[Path, list[Truth]]:
    """A clip in a form, written losslessly into a folder, and the true faces in it.

    form : degrees by which it is rolled clockwise, or one of SPOILED.   frames : only the first; None for all.
    """
    if form == AS_IT_IS and frames is None:
        return video, list(truths)
    output = folder / f"{video.stem}_{form}.mkv"
    forward, size = write(video, output, change_to(form, truths), frames)
    return output, [_moved(truth, forward, size) for truth in truths]


def change_to(form: str, truths: Sequence[Truth]) -> Change:
    """What a form makes of each picture."""
    if re.fullmatch(r"\d+(\.\d+)?", form):
        return lambda rgb: rolled(rgb, float(form))
    if form == "mirrored":
        return lambda rgb: (
            np.ascontiguousarray(rgb[:, ::-1]),
            np.array([[-1.0, 0, rgb.shape[1] - 1], [0, 1, 0]]),
        )
    if form == "negative":
        return lambda rgb: (255 - rgb, np.eye(2, 3))
    if form == "half-left":
        return lambda rgb: _cropped(rgb, round(_middle(truths, rgb)[0]), rgb.shape[0])
    if form == "half-below":
        return lambda rgb: _cropped(rgb, 0, round(_middle(truths, rgb)[1]))
    raise ValueError(f"a form is a number of degrees or one of {', '.join(SPOILED)}, got {form}")


def write(video: Path, output: Path, change: Change, frames: int | None) -> tuple[F64, tuple[int, int]]:
    """Write the changed pictures losslessly; returns the affine map (2, 3) of their points, and width and height."""
    with open_input(video) as media, av.open(str(output), "w") as out:
        stream = out.add_stream("libx264", 30, {"qp": "0", "preset": "ultrafast"})
        stream.pix_fmt = "yuv420p"
        for frame in islice(media, frames):
            picture, forward = change(frame.rgb())
            picture = picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]
            if not stream.codec_context.is_open:
                stream.height, stream.width = picture.shape[:2]
            out.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")))
        out.mux(stream.encode(None))
    return forward, (picture.shape[1], picture.shape[0])


def _middle(truths: Sequence[Truth], rgb: Picture) -> F64:
    """The usual middle (2,) of the first face, or of the picture where no face is known."""
    truth = truths[0]
    seen = truth.points[truth.visible.any(1)]
    if not len(seen):
        return np.array(rgb.shape[1::-1]) / 2
    return np.asarray(np.median(seen.mean(1), axis=0))


def _cropped(rgb: Picture, left: int, height: int) -> tuple[Picture, F64]:
    """The picture without its columns before `left` and its rows from `height`."""
    left = min(left, rgb.shape[1] - MIN_CROPPED_PIXELS)
    height = max(height, MIN_CROPPED_PIXELS)
    return np.ascontiguousarray(rgb[:height, left:]), np.array([[1.0, 0, -left], [0, 1, 0]])


def _moved(truth: Truth, forward: F64, size: tuple[int, int]) -> Truth:
    """The face after an affine map; what is out of a picture of that size cannot be seen."""
    points = moved(truth.points, forward)
    inside = ((points >= 0) & (points <= np.array(size) - 1)).all(2)
    return Truth(points, truth.visible & inside)
