"""The smooth chroma of the skin in the frame, on a face that shows nothing else of it.

Skin is paler towards the jaw and below the mouth, and a face without that looks painted beside the neck and the ears.
So where skin is drawn over skin, the wide means of both have the same chroma.  Where it is drawn over hair it has that
of the skin beside.  Brightness is left, as it tells who somebody is.  Pixels; grey levels 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.coarse_grid import CoarseGrid
from guise.aam.irises import EYES
from guise.aam.landmarks.schemes import INNER_LIPS
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.parsing import FaceClass
from guise.aam.reference import MeshSampler
from guise.aam.relief import Relief
from guise.app.drawing.face import COARSE_CELL, FaceInFrame, ramp
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, F64, U8
from guise.common.tuned import tuned


@dataclass(frozen=True)
class ShadeLimits:
    """Widths and bounds."""

    # standard deviation of the means
    width: float = tuned(0.07, "face widths", "deidentify.identity")
    # of skin, from which it begins to tell its shade, and from which it does
    skin: tuple[float, float] = tuned((0.5, 1.0), "share", "landmarks.parsing")
    growth: float = tuned(0.02, "face widths", "deidentify.identity")  # of features, that tell none


LIMITS = ShadeLimits()


class FrameShades:
    """Gives the picture the wide means of the frame's skin.

    Parameters
    ----------
    relief : of the face that is drawn.
    """

    def __init__(self, relief: Relief) -> None:
        reference = relief.reference
        self._reference, self._grid = reference, CoarseGrid(reference, COARSE_CELL)
        height, width = self._grid.size
        cells = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 2)
        places: F64 = np.asarray(self._grid.cell * cells, np.float64)
        self._sampler = MeshSampler.build(reference, places)
        self._depth = relief.at(places)[:, None]
        self._places = places.reshape(height, width, 2).astype(np.float32)
        self._skin = self._on_cells(skin_mask(reference, LIMITS.growth).astype(np.float32))
        self._surface = 1 - self._on_cells(soft_parts(reference, (*EYES, INNER_LIPS), 0.0))
        self._smoother = self._grid.smoother(LIMITS.width)

    def apply(self, face: FaceInFrame, memory: Memory) -> None:
        """Change the picture's chroma."""
        if face.parsed is None:
            return
        canvas = face.canvas
        places = self._sampler.positions(face.mesh) + self._depth * face.sight.across.astype(np.float32)
        at = np.asarray(places - canvas.corner, np.float32)
        skin = face.parsed.at(at, face.parsed.shares[FaceClass.SKIN])
        weight = ramp(skin, LIMITS.skin).reshape(self._grid.size) * self._skin[..., 0]
        side = max(round(COARSE_CELL * face.zoom * self._reference.resolution), 1)
        own = cv2.remap(  # type: ignore[call-overload]
            cv2.blur(canvas.roi, (side, side)), at.reshape(*self._grid.size, 2), None, cv2.INTER_LINEAR
        )
        drawn = self._on_cells(np.asarray(cv2.blur(canvas.picture, (round(self._grid.cell),) * 2), np.uint8))
        seen = np.concatenate([own, drawn], -1)
        sums = np.concatenate([seen * weight[..., None], weight[..., None]], -1).transpose(2, 0, 1)
        means = self._smoother.means(sums)
        shift = (means[:3] - means[3:]).transpose(1, 2, 0) * np.array([0, 1, 1], np.float32)
        canvas.picture = np.asarray(
            cv2.add(canvas.picture, self._on_grid(self._surface * shift), dtype=cv2.CV_8U), np.uint8
        )

    def _on_cells(self, plane: F32 | U8) -> F32:
        """A plane (h, w, ...) of the grid at the cells."""
        cells = cv2.remap(plane, self._places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        return np.asarray(cells.reshape(*self._grid.size, -1), np.float32)

    def _on_grid(self, cells: F32) -> F32:
        """Values (h, w, 3) of the cells at the pixels of the grid."""
        to_cells = np.array([[1 / self._grid.cell, 0, 0], [0, 1 / self._grid.cell, 0]])
        return np.asarray(
            cv2.warpAffine(
                np.asarray(cells, np.float32), to_cells, self._reference.size[::-1],
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
            )
        )  # fmt: skip
