"""Round trip: a person's own face swapped onto the clip that the person was enrolled on.

PSNR of RGB between the original and the swapped frame over the pixels whose blending weight exceeds 0.5 (the shared
mask, feathered and drawn by the mesh of that frame), from the squared error pooled over all frames.  The landmark
shift is reported twice: between the tracked shape and the mesh that was drawn, and between the shapes tracked in the
original and in the swapped frames.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import cv2
import numpy as np

from benchmarks import common
from benchmarks.common import F64, Clip, Criterion, Picture, Report, Table
from guise.aam.appearance import sample_texture
from guise.aam.model import Identity
from guise.aam.person_tracker import PersonTracker
from guise.app.drawing.engine import Engine
from guise.app.drawing.passes.blend import FEATHER_FACE_WIDTHS
from guise.app.drawing.passes.cover import shown_mask
from guise.app.media import Frame
from guise.render import feather, make_compositor
from guise.render.compositor import Compositor

PERSON = "p01"
LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class Compared:
    """One frame: pixels inside, squared errors of RGB, of luma and of the texture grid alone; shifts in pixels."""

    pixels: int
    rgb: float
    luma: float
    grid: float
    drawn_shift: float
    tracked_shift: float


class Comparison:
    """Compares frames before and after; the compositor tells where the face is drawn."""

    def __init__(self, person: Identity) -> None:
        look = person.appearance
        self._frame = look.reference
        alpha = feather(
            shown_mask(look.mask, look.reference), FEATHER_FACE_WIDTHS * look.reference.resolution
        )
        points = self._frame.points.astype(np.float32)
        self._compositor: Compositor = make_compositor("cpu", self._frame.triangles, points, alpha)
        self._tracker = PersonTracker(person.tracker, common.detector())

    def __call__(self, before: Picture, after: Frame, shape: F64, mesh: F64) -> Compared | None:
        """One frame; None when the person is not found in the swapped frame."""
        again = common.shape_of(self._tracker.update(after.luma))
        if again is None:
            return None
        inside = self._inside(before, mesh)
        swapped, grid = after.rgb(), self._through_grid(before, shape)
        return Compared(
            int(inside.sum()),
            squared_error(before[inside], swapped[inside]),
            squared_error(before[inside] @ LUMA, swapped[inside] @ LUMA),
            squared_error(before[inside], grid[inside]),
            common.point_error(mesh, shape),
            common.point_error(again, shape),
        )

    def _inside(self, picture: Picture, mesh: F64) -> np.ndarray:
        blank = np.zeros((*self._frame.size, 3), np.uint8)
        drawn = self._compositor.warp(picture.shape[:2], blank, mesh)
        return np.asarray(drawn[..., 3] > 127)

    def _through_grid(self, picture: Picture, shape: F64) -> Picture:
        """The face sampled on the texture grid and drawn back without any model: the ceiling."""
        texture = self._frame.scatter(sample_texture(picture, shape, self._frame))
        outside = (~self._frame.mask).astype(np.uint8)
        filled = cv2.inpaint(texture.round().astype(np.uint8), outside, 3, cv2.INPAINT_TELEA)
        return self._compositor.composite(picture, np.asarray(filled, np.uint8), shape)


def squared_error(a: np.ndarray, b: np.ndarray) -> float:
    """Mean squared difference."""
    return float(((a.astype(np.float64) - b) ** 2).mean())


def psnr(error: float) -> float:
    """Decibels of a mean squared error on 0..255.

    >>> round(psnr(1.0), 2)
    48.13
    """
    return float(10 * np.log10(255**2 / error))


def compared(clip: Clip, person: Identity, limit: int | None) -> tuple[list[Compared], int]:
    """Every frame of the clip, and the number of frames in which the face was lost before or after."""
    comparison, rows, lost = Comparison(person), [], 0
    with Engine(person, person, common.detector()) as engine:
        for frame in common.frames(clip):
            if frame.index == limit:
                break
            before = frame.rgb()
            result = engine.swap(frame)
            shape = common.shape_of(result.fit)
            row = (
                None
                if shape is None or result.mesh is None
                else comparison(before, frame, shape, result.mesh)
            )
            lost += row is None
            rows += [] if row is None else [row]
    return rows, lost


def measure(options: argparse.Namespace) -> Report:
    """The round trip of one person."""
    clip = common.synthetic_clip(options.shared, PERSON)
    person = common.enrolled(clip)
    rows, lost = compared(clip, person, 30 if options.quick else None)
    values = {k: np.array([getattr(r, k) for r in rows]) for k in Compared.__dataclass_fields__}
    pooled = {
        k: psnr(float(np.average(values[k], weights=values["pixels"]))) for k in ("rgb", "luma", "grid")
    }
    each = 10 * np.log10(255**2 / values["rgb"])
    table = [
        ("PSNR of RGB, pooled, dB", pooled["rgb"]),
        ("PSNR of RGB, mean of frames, dB", float(each.mean())),
        ("PSNR of RGB, worst frame, dB", float(each.min())),
        ("PSNR of luma, pooled, dB", pooled["luma"]),
        ("the texture grid alone, PSNR of RGB, pooled, dB", pooled["grid"]),
        ("pixels inside, mean", float(values["pixels"].mean())),
        ("worst shift drawn, px", float(values["drawn_shift"].max())),
        ("worst shift tracked again, px", float(values["tracked_shift"].max())),
        ("frames compared", len(rows)),
        ("frames lost", lost),
    ]
    return Report(
        "roundtrip",
        f"Round trip: {PERSON} onto {PERSON}'s own clip",
        [
            Criterion("PSNR inside the mask", pooled["rgb"], ">=", 34.0, "dB"),
            Criterion("landmark shift, mesh drawn", float(values["drawn_shift"].mean()), "<=", 0.5, "px"),
            Criterion(
                "landmark shift, tracked again", float(values["tracked_shift"].mean()), "<=", 0.5, "px"
            ),
        ],
        [Table("Figures behind it", ("what", "measured"), table)],
    )


if __name__ == "__main__":
    common.run(measure, common.arguments(__doc__))
