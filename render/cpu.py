"""The compositor on the CPU: twin of the shaders, and the choice of `auto` without a GPU.

Each pixel of the mesh's bounding box gets the index of its triangle, through it the triangle's affine map to
texture pixels, and one bilinear look-up gives warped colour and alpha. The blend is integer arithmetic.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F32, F64, I32, U8, Floating
from guise.common.closing import Closing
from guise.common.kernels import RUNNING, kernel
from guise.render.buffers import Alpha, Texels, Texture, check_opacity, output_for
from guise.render.mesh import (
    SUBPIXELS,
    Box,
    TexturedMesh,
    back_first,
    bounding_box,
    rasterise,
    snap,
    texture_gradients,
)

_EVERY_BYTE = np.arange(256)
# How far a pixel is drawn, by its alpha, and its share by the sum over it and its eight neighbours, as in
# shaders/blend.frag.glsl.
_DRAWN = np.rint(np.minimum(_EVERY_BYTE * (96 / 255), 1) * 28).astype(np.uint8)
_SHARES = np.rint(255 * np.clip(_EVERY_BYTE * (2 / (9 * 28)) - 1, 0, 1)).astype(np.uint8)


class CpuCompositor(Closing):
    """`guise.render.compositor.Compositor` on the CPU."""

    name = "cpu"

    def __init__(self, mesh: TexturedMesh, alpha: Alpha) -> None:
        self.description = f"CPU: {RUNNING} kernels, OpenCV {cv2.__version__}, NumPy {np.__version__}"
        self._mesh = mesh
        self._texels = Texels(mesh, alpha)

    def set_alpha(self, alpha: Alpha) -> None:
        """Take another (th, tw) alpha."""
        self._texels.set_alpha(alpha)

    def composite(
        self,
        roi: U8,
        texture: Texture,
        vertices: Floating,
        opacity: float = 1.0,
        out: U8 | None = None,
    ) -> U8:
        """See `guise.render.compositor.Compositor.composite`."""
        result, mesh = output_for(roi, out), self._mesh
        snapped = snap(vertices, len(mesh.uv))
        texture = self._texels.rounded(texture)
        if check_opacity(opacity) > 0:
            composite(texture, self._texels.alpha, snapped, mesh.triangles, mesh.grid, opacity, result)
        return result

    def warp(
        self,
        shape: tuple[int, int],
        texture: Texture,
        vertices: Floating,
    ) -> U8:
        """See `guise.render.compositor.Compositor.warp`."""
        result, mesh = np.zeros((*shape, 4), np.uint8), self._mesh
        snapped = snap(vertices, len(mesh.uv))
        box, rgba = bounding_box(snapped, shape[1], shape[0]), self._texels.load(texture)
        if not box.empty:
            warped, covered = _warped(rgba, snapped, mesh.triangles, mesh.grid, box)
            np.copyto(box.of(result), warped, where=covered[..., None])
        return result

    def close(self) -> None:
        """Nothing to release."""


@kernel
def composite(
    texture: U8, alpha: U8, snapped: F64, triangles: I32, grid: F64, opacity: float, target: U8
) -> None:
    """Blend a texture that is warped by a mesh into a picture, in place.

    Parameters
    ----------
    texture, alpha : (th, tw, 3) and (th, tw).
    snapped : (v, 2) vertices in the picture, whole 1/256 pixels.
    triangles, grid : (t, 3) and (7, t), see `TexturedMesh`.
    opacity : in [0, 1], multiplies alpha.
    target : (h, w, 3), which may be a part of a larger picture.
    """
    box = bounding_box(snapped, target.shape[1], target.shape[0])
    if not box.empty:
        warped, covered = _warped(np.dstack([texture, alpha]), snapped, triangles, grid, box)
        _blend(warped[..., :3], _share(warped, covered, opacity), box.of(target))


def _warped(rgba: U8, snapped: F64, triangles: I32, grid: F64, box: Box) -> tuple[U8, NDArray[np.bool_]]:
    """Colour and alpha (h, w, 4) in a box, of any value where no triangle is, and where one is."""
    snapped = snapped - (box.x0 * SUBPIXELS, box.y0 * SUBPIXELS)
    count = len(triangles)
    ids: NDArray[Any] = np.full((box.height, box.width), count, np.uint8 if count < 256 else np.uint16)
    rasterise(snapped, triangles, ids, back_first(snapped, triangles, grid))
    uv = _texture_places(texture_gradients(snapped, triangles, grid), ids)
    warped = cv2.remap(rgba, uv, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
    return np.asarray(warped, np.uint8), ids != count


def _texture_places(gradients: F64, ids: NDArray[Any]) -> F32:
    """(h, w, 2) texture pixels of pixels of triangles (h, w), whose maps are (6, t); zeros where none is."""
    # (a, d), (b, e) and (c, f) of every triangle, zeros behind them: both of a pair are looked up as one number.
    maps = np.zeros((3, max(256, gradients.shape[1] + 1), 2), np.float32)
    maps[:, : gradients.shape[1]] = gradients.reshape(2, 3, -1).transpose(1, 2, 0)
    height, width = ids.shape
    along_x, along_y, constant = (
        _looked_up(pairs, ids).view(np.float32) for pairs in maps.view(np.float64)[..., 0]
    )
    along_x *= np.arange(width, dtype=np.float32).repeat(2)
    along_y *= np.arange(height, dtype=np.float32)[:, None]
    along_x += along_y
    along_x += constant
    return along_x.reshape(height, width, 2)


def _looked_up(table: F64, ids: NDArray[Any]) -> F64:
    if ids.dtype == np.uint8:
        return np.asarray(cv2.LUT(ids, table))  # several times faster than take, but only for 256 entries
    return np.asarray(table[ids])


def _share(warped: U8, covered: NDArray[np.bool_], opacity: float) -> U8:
    """The face's share of each pixel in 255ths; 0 where no triangle is.

    Where the mesh ends, as at a turned head's silhouette, alpha ends within a pixel and not at once.
    """
    alpha = np.asarray(cv2.extractChannel(warped, 3) * covered, np.uint8)
    around = cv2.boxFilter(
        cv2.LUT(alpha, _DRAWN), -1, (3, 3), normalize=False, borderType=cv2.BORDER_REPLICATE
    )
    alpha = np.asarray(cv2.multiply(alpha, cv2.LUT(around, _SHARES), scale=1 / 255), np.uint8)
    return alpha if opacity == 1 else np.rint(_EVERY_BYTE * opacity).astype(np.uint8)[alpha]


def _blend(colour: U8, share: U8, target: U8) -> None:
    """target := (colour * share + target * (255 - share)) / 255, rounded to nearest, exactly."""
    share = share[..., None]
    total = np.multiply(colour, share, dtype=np.uint16)
    total += np.multiply(target, ~share, dtype=np.uint16)
    total += 128
    total += total >> 8
    target[...] = total >> 8
