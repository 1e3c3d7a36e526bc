"""The compositor in NumPy and OpenCV: twin of the shaders, and the choice of `auto` without a GPU.

Each pixel of the mesh's bounding box gets the index of its triangle, through it the triangle's affine map to
texture pixels, and one bilinear look-up gives warped colour and alpha. The blend is integer arithmetic.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.common.arrays import F32, F64, U8, Floating
from guise.common.closing import Closing
from guise.render.buffers import Scratch, Texels, Texture, check_opacity, output_for
from guise.render.mesh import (
    SUBPIXELS,
    Box,
    Rasteriser,
    TexturedMesh,
    back_first,
    bounding_box,
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

    def __init__(self, mesh: TexturedMesh, alpha: F32) -> None:
        self.description = f"CPU: OpenCV {cv2.__version__}, NumPy {np.__version__}"
        self._mesh = mesh
        self._texels = Texels(mesh, alpha)
        self._rasteriser = Rasteriser(mesh.triangles)
        self._background = len(mesh.triangles)
        entries = 256 if self._background < 256 else self._background + 1
        self._id_type = np.uint8 if entries == 256 else np.uint16
        # (a, d), (b, e) and (c, f) of every triangle, zeros behind them: both of a pair are looked up as one number.
        self._maps = np.zeros((3, entries, 2), np.float32)
        self._ids = Scratch(self._id_type)
        # each of these holds two pictures
        self._pairs, self._bytes = Scratch(np.float64), Scratch(np.uint8)
        self._triples, self._words = Scratch(np.uint8), Scratch(np.uint16)
        self._warped = Scratch(np.uint8)

    def set_alpha(self, alpha: F32) -> None:
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
        result = output_for(roi, out)
        snapped, box = self._place(vertices, roi.shape)
        rgba = self._texels.load(texture)
        if check_opacity(opacity) > 0 and not box.empty:
            ids = self._triangle_ids(snapped, box)
            warped = self._sample(rgba, snapped, box, ids)
            self._blend(warped, self._share(warped, ids, opacity), box.of(result))
        return result

    def warp(
        self,
        shape: tuple[int, int],
        texture: Texture,
        vertices: Floating,
    ) -> U8:
        """See `guise.render.compositor.Compositor.warp`."""
        result = np.zeros((*shape, 4), np.uint8)
        snapped, box = self._place(vertices, shape)
        rgba = self._texels.load(texture)
        if not box.empty:
            ids = self._triangle_ids(snapped, box)
            warped = self._sample(rgba, snapped, box, ids)
            np.copyto(box.of(result), warped, where=(ids != self._background)[..., None])
        return result

    def close(self) -> None:
        """Nothing to release."""

    def _place(self, vertices: Floating, shape: tuple[int, ...]) -> tuple[F64, Box]:
        """Snapped vertices relative to the mesh's box, and the box."""
        snapped = snap(vertices, len(self._mesh.uv))
        box = bounding_box(snapped, shape[1], shape[0])
        return snapped - (box.x0 * SUBPIXELS, box.y0 * SUBPIXELS), box

    def _triangle_ids(self, snapped: F64, box: Box) -> NDArray[Any]:
        ids = self._ids.view(box.height, box.width)
        ids.fill(self._background)
        self._rasteriser.draw(snapped, ids, back_first(snapped, self._mesh))
        return ids

    def _sample(self, rgba: U8, snapped: F64, box: Box, ids: NDArray[Any]) -> U8:
        """Warped colour and alpha in the box; where no triangle is, any value."""
        gradients = texture_gradients(snapped, self._mesh).reshape(2, 3, -1)
        self._maps[:, : self._background] = gradients.transpose(1, 2, 0)
        x = np.arange(box.width, dtype=np.float32).repeat(2)
        y = np.arange(box.height, dtype=np.float32)[:, None]
        uv = self._texture_places(ids, x, y)
        warped: U8 = self._warped.view(box.height, box.width, 4)
        cv2.remap(rgba, uv, None, cv2.INTER_LINEAR, dst=warped, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        return warped

    def _texture_places(self, ids: NDArray[Any], x: F32, y: F32) -> F32:
        """(h, w, 2) texture pixels of pixels of triangles (h, w) in columns x (2 w,), each twice, and rows y (h, 1)."""
        along_x, along_y, constant = self._maps.view(np.float64)[..., 0]
        places, terms = self._pairs.view(2, *ids.shape)
        place: F32 = places.view(np.float32)  # (h, 2 w): u, v, u, v ..
        term = terms.view(np.float32)
        _look_up(along_x, ids, places)
        place *= x
        _look_up(along_y, ids, terms)
        term *= y
        place += term
        _look_up(constant, ids, terms)
        place += term
        return place.reshape(*ids.shape, 2)

    def _share(self, warped: U8, ids: NDArray[Any], opacity: float) -> U8:
        """The face's share of each pixel in 255ths; 0 where no triangle is."""
        alpha: U8
        alpha, covered = self._bytes.view(2, *ids.shape)
        cv2.extractChannel(warped, 3, dst=alpha)
        np.not_equal(ids, self._background, out=covered.view(np.bool_))
        alpha *= covered
        self._soften(alpha, covered)
        if opacity < 1:
            cv2.LUT(alpha, np.rint(_EVERY_BYTE * opacity).astype(np.uint8), dst=alpha)
        return alpha

    def _soften(self, alpha: U8, spare: U8) -> None:
        """Where the mesh ends, as at a turned head's silhouette, alpha ends within a pixel and not at once."""
        cv2.LUT(alpha, _DRAWN, dst=spare)
        around = cv2.boxFilter(spare, -1, (3, 3), normalize=False, borderType=cv2.BORDER_REPLICATE)
        cv2.LUT(around, _SHARES, dst=spare)
        cv2.multiply(alpha, spare, dst=alpha, scale=1 / 255)

    def _blend(self, warped: U8, alpha: U8, target: U8) -> None:
        """target := (colour * alpha + target * (255 - alpha)) / 255, rounded to nearest."""
        colour, share = self._triples.view(2, *alpha.shape, 3)
        total, term = self._words.view(2, *alpha.shape, 3)
        cv2.cvtColor(warped, cv2.COLOR_RGBA2RGB, dst=colour)
        cv2.cvtColor(alpha, cv2.COLOR_GRAY2RGB, dst=share)
        np.multiply(colour, share, out=total, dtype=np.uint16)
        np.bitwise_not(share, out=share)
        np.multiply(target, share, out=term, dtype=np.uint16)
        total += term
        _divide_by_255(total, term)
        np.copyto(target, total, casting="unsafe")


def _divide_by_255(value: NDArray[np.uint16], spare: NDArray[np.uint16]) -> None:
    """value / 255 in place, rounded to nearest; exact for value <= 255 * 255."""
    value += 128
    np.right_shift(value, 8, out=spare)
    value += spare
    value >>= 8


def _look_up(table: F64, ids: NDArray[Any], out: F64) -> None:
    if ids.dtype == np.uint8:
        cv2.LUT(ids, table, dst=out)  # several times faster than take, but only for 256 entries
    else:
        np.take(table, ids, out=out, mode="clip")
