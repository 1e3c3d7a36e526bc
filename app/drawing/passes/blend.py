"""The lit texture as a picture, warped and blended into the frame's own planes.

Pixels, x right, y down; grid pixels where it says so.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.mask import beyond_mask
from guise.aam.relief import Relief
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.common.arrays import F32, U8, Int
from guise.common.closing import Closing
from guise.common.kernels import kernel
from guise.common.small import mean
from guise.common.tuned import derived
from guise.render import Compositor, make_compositor
from guise.render.compositor import Renderer

SOME = derived(16, "pixels", "between those looked at first for colour: a face has hundreds of them")
MOST_CHROMA = derived(2, "levels", "what coding adds to chroma without colour; it rounds twice")


class Blend(Closing):
    """Draws pictures on the relief's mesh.

    Parameters
    ----------
    relief : of the face that is drawn.
    alpha : (h, w) float32 in [0, 1] of the face on the grid, feathered.
    renderer : "auto", "gl" or "cpu".
    """

    def __init__(self, relief: Relief, alpha: F32, renderer: Renderer) -> None:
        self._relief, self._alpha, self._renderer = relief, alpha, renderer
        self._compositors: dict[bool, Compositor] = {}
        self._whole: dict[bool, bool] = {}  # whether each of them draws all of the face
        reference = relief.reference
        self._beside, self._nearest = beyond_mask(reference.mask)

    def spread(self, face: FaceInFrame, memory: Memory) -> None:
        """Find where the drawn face's relief lies in the frame."""
        face.canvas.mesh = self._relief.seen(face.mesh, face.sight.across)

    def begin(self, face: FaceInFrame, memory: Memory) -> None:
        """Cut the rectangle out of the frame in which the face lies; none is left of a face beside the picture."""
        canvas, frame = face.canvas, face.frame
        low, high = np.minimum.reduce(canvas.mesh), np.maximum.reduce(canvas.mesh)
        x, y, w, h = frame.align_roi(*(low - 1), *(high + 2))
        if w < 2 or h < 2:
            return
        canvas.corner, canvas.roi = (x, y), frame.read_yuv(x, y, w, h)
        some = canvas.roi[::SOME, ::SOME]
        canvas.is_grey = _is_grey(some) and _is_grey(canvas.roi)
        if memory.parsed is not None:
            parsing, then = memory.parsed
            face.parsed = parsing.from_place(*((x, y) - mean(face.head - then, 0)))

    def scatter(self, face: FaceInFrame, memory: Memory) -> None:
        """Lay the lit texture out as a picture of bytes."""
        reference = self._relief.reference
        picture = np.empty((*reference.size, 3), np.uint8)
        scattered(face.canvas.planes, reference.pixels, self._beside, self._nearest, picture)
        face.canvas.picture = picture

    def composite(self, face: FaceInFrame, memory: Memory) -> None:
        """Draw the picture on the mesh, where nothing hides the face."""
        canvas = face.canvas
        self._set_alpha(canvas.fine, canvas.share, canvas.rims)
        mesh = canvas.mesh - canvas.corner
        self._compositor(canvas.fine).composite(canvas.roi, canvas.picture, mesh, out=canvas.roi)

    def write(self, face: FaceInFrame, memory: Memory) -> None:
        """Put the rectangle back into the frame; a face in a frame without colour has none."""
        canvas, frame = face.canvas, face.frame
        if canvas.is_grey:
            h, w = canvas.roi.shape[:2]
            canvas.roi[..., 1:] = frame.read_yuv(*canvas.corner, w, h)[..., 1:]
        frame.write_yuv(*canvas.corner, canvas.roi)

    def close(self) -> None:
        """Release the compositors."""
        for compositor in self._compositors.values():
            compositor.close()
        self._compositors.clear()

    @property
    def renderer(self) -> str:
        """What draws the face, for the user."""
        return self._compositor(False).description

    def _set_alpha(self, fine: bool, share: F32 | None, rims: F32 | None) -> None:
        """Draw only what nothing hides."""
        whole = share is None and rims is None
        if not (whole and self._whole.get(fine, True)):
            alpha = self._enlarged(self._alpha if share is None else self._alpha * share, fine)
            if rims is not None:
                alpha = np.asarray(cv2.multiply(alpha, 1 - rims, dtype=cv2.CV_8U), np.uint8)
            self._compositor(fine).set_alpha(alpha)
        self._whole[fine] = whole

    def _compositor(self, fine: bool) -> Compositor:
        if fine not in self._compositors:
            factor = 2 if fine else 1
            uv = (self._relief.points + 0.5) * factor - 0.5
            self._compositors[fine] = make_compositor(
                self._renderer,
                self._relief.front_last,
                uv.astype(np.float32),
                self._enlarged(self._alpha, fine),
            )
        return self._compositors[fine]

    def _enlarged(self, alpha: F32, fine: bool) -> U8:
        """An alpha (h, w) of 255, at the size of the texture."""
        bytes_, (h, w) = cv2.convertScaleAbs(alpha, alpha=255.0), alpha.shape
        if fine:
            bytes_ = cv2.resize(bytes_, (2 * w, 2 * h), interpolation=cv2.INTER_LINEAR)
        return np.asarray(bytes_, np.uint8)


@kernel
def scattered(planes: F32, pixels: Int, beside: Int, nearest: Int, picture: U8) -> None:
    """Planes (3, n) rounded to bytes at flat indices (n,) of a picture (h, w, 3); those beside are as the nearest."""
    flat = picture.reshape(-1, 3)
    flat[pixels] = np.rint(np.minimum(np.maximum(planes, 0), 255)).T
    flat[beside] = flat[nearest]


def _is_grey(roi: U8) -> bool:
    """Whether brightness and chroma (h, w, 3) show no colour."""
    return bool((cv2.absdiff(roi[..., 1:], np.full_like(roi[..., 1:], 128)) <= MOST_CHROMA).all())
