"""Contact sheets to judge a swap by eye: six telling frames, the original above the swapped one, in their own pixels.

Frames are chosen by landmarks (n, 81, 2) of the original, NaN where there is no face, so that they stay the same when
the program changes; only the one of the worst light is chosen by what the program made.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Picture
from guise.aam.landmarks.schemes import SILHOUETTE
from guise.app.measure.curves import expression, pose
from guise.app.media import frames_at

SIDE_FACES = 1.35  # side of a picture in heights of the largest face
GAP_FRAMES = 4  # at least between two chosen frames
LIGHT_PIXELS = 24  # across the face: finer things are features, not light
TITLE_HEIGHT = 24


def scores(points: F64) -> dict[str, F64]:
    """How well each frame (n,) shows what a sheet shows, more is better; NaN where there is no face."""
    curves = expression(points)
    brows, lids = (curves[f"right {name}"] + curves[f"left {name}"] for name in ("brow", "lids"))
    seen = np.isfinite(points).all(axis=(1, 2))
    yaw = np.full(len(points), np.nan)
    yaw[seen] = pose(points[seen])[:, 0]
    every = np.stack([*curves.values(), yaw / 90])
    away = np.abs(every - np.nanmedian(every, axis=1, keepdims=True))
    return {
        "neutral": -(away / np.maximum(np.nanmedian(away, axis=1, keepdims=True), 1e-6)).sum(0),
        "widest mouth": curves["mouth opening"],
        "blink": -lids,
        "brows up": brows,
        "most turned": np.abs(yaw),
    }


def chosen(scored: Mapping[str, F64]) -> dict[str, int]:
    """A frame for each of the scores (n,): the best one that is not next to those chosen before it."""
    taken: dict[str, int] = {}
    for name, values in scored.items():
        free = np.where(np.isfinite(values), values, -np.inf)
        for frame in taken.values():
            free[max(0, frame - GAP_FRAMES + 1) : frame + GAP_FRAMES] = -np.inf
        if np.isfinite(free).any():
            taken[name] = int(free.argmax())
    return taken


def light_error(original: Picture, swapped: Picture, shape: F64) -> float:
    """95th percentile over the face (81, 2) of the change of lightness, coarsely seen: Lab, L 0..100."""
    x0, y0 = np.maximum(np.floor(shape.min(0)).astype(int), 0)
    x1, y1 = np.ceil(shape.max(0)).astype(int) + 1
    face = np.zeros(original.shape[:2], np.uint8)
    cv2.fillPoly(face, [np.round(shape[SILHOUETTE]).astype(np.int32)], 255)
    coarse = [
        cv2.resize(p[y0:y1, x0:x1], (LIGHT_PIXELS, LIGHT_PIXELS), interpolation=cv2.INTER_AREA)
        for p in (original, swapped, face)
    ]
    first, second = (cv2.cvtColor(p.astype(np.float32) / 255, cv2.COLOR_RGB2Lab)[..., 0] for p in coarse[:2])
    inside = coarse[2] > 127
    return float(np.percentile(np.abs(second - first)[inside], 95)) if inside.any() else np.nan


def square(picture: Picture, centre: F64, side: int) -> Picture:
    """The pixels (side, side, 3) around a place, black beyond the picture."""
    x, y = np.round(centre).astype(int) - side // 2
    wide = cv2.copyMakeBorder(picture, side, side, side, side, cv2.BORDER_CONSTANT)
    cut = wide[max(y + side, 0) :, max(x + side, 0) :][:side, :side]
    out = np.zeros((side, side, 3), np.uint8)
    out[: cut.shape[0], : cut.shape[1]] = cut
    return out


def side_of(shapes: F64) -> int:
    """The side of squares that hold the largest of some faces (n, 81, 2), pixels."""
    return round(SIDE_FACES * float(np.ptp(shapes[..., 1], axis=1).max()))


def cut_outs(clip: Clip, indices: Collection[int], side: int) -> dict[int, Picture]:
    """The face in some frames: squares (side, side, 3) in the clip's own pixels, in the clip's order."""
    centres = {i: (clip.points[i].min(0) + clip.points[i].max(0)) / 2 for i in indices}
    return {f.index: square(f.rgb(), centres[f.index], side) for f in frames_at(clip.video, indices)}


def light_errors(original: Clip, swapped: Path) -> F64:
    """The light errors (n,) of all frames, NaN where there is no face."""
    errors = np.full(len(original.points), np.nan)
    pairs = zip(common.frames(original), common.frames(Clip("", swapped, original.points)), strict=False)
    for i, ((before, after), shape) in enumerate(zip(pairs, original.points, strict=False)):
        if np.isfinite(shape).all():
            errors[i] = light_error(before.rgb(), after.rgb(), shape)
    return errors


def contact_sheet(original: Clip, swapped: Path, output: Path) -> dict[str, int]:
    """Write the sheet as PNG.  Returns the frames that it shows."""
    points = original.points
    frames = chosen({**scores(points), "worst light": light_errors(original, swapped)})
    side = side_of(points[list(frames.values())])
    above, below = (cut_outs(video, frames.values(), side) for video in (original, Clip("", swapped, points)))
    columns = [np.vstack([title(f"{name}, {i}", side), above[i], below[i]]) for name, i in frames.items()]
    output.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(output), np.hstack(columns)[..., ::-1])
    return frames


def title(text: str, width: int) -> Picture:
    """White words on black (TITLE_HEIGHT, width, 3)."""
    strip = np.zeros((TITLE_HEIGHT, width, 3), np.uint8)
    cv2.putText(strip, text, (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return strip
