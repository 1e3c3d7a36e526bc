"""Models resampled to a reference frame of another resolution, so that they can be mixed.

The canonical face is the same at every resolution; only its grid is finer or coarser, so textures are resampled and
shapes scaled.  Grid pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel, Components
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.similarity import align_planar
from guise.common.arrays import F32, F64, U8


def resampled(model: AppearanceModel, reference: ReferenceFrame) -> AppearanceModel:
    """The appearance model on another canonical reference frame.

    Resampled modes are no longer orthonormal: the modes returned are the principal axes of the same ellipsoid.
    """
    if reference.id == model.reference.id:
        return model
    change = _GridChange(model.reference, reference)
    parts = model.components
    axes = change.vectors((parts.basis * parts.deviations).T, offsets=False).T
    basis, deviations, _ = np.linalg.svd(axes.astype(np.float64), full_matrices=False)
    components = Components(
        change.vectors(parts.mean[None])[0],
        basis.astype(np.float32),
        deviations.astype(np.float32),
        float((deviations**2).sum() / max(parts.retained, 1e-9)),
    )
    mask = change.picture(model.mask.astype(np.float32)) > 0.5
    return AppearanceModel(
        reference, components, change.vectors(model.neutral[None])[0], mask & reference.mask
    )


def resampled_detail(detail: F32, old: ReferenceFrame, new: ReferenceFrame) -> F32:
    """Luma detail (2 h, 2 w) of one reference frame on the grid of another."""
    return _GridChange(old, new).picture(detail, factor=2)


def resampled_texture(texture: F32, old: ReferenceFrame, new: ReferenceFrame) -> F32:
    """A texture (n,) or (n, c) of one reference frame on the grid of another."""
    return _GridChange(old, new).texture(texture)


class _GridChange:
    """The similarity from one grid to another: x' = scale x + offset."""

    def __init__(self, old: ReferenceFrame, new: ReferenceFrame) -> None:
        self._old, self._new = old, new
        fit = align_planar(old.points, new.points, np.full(POINTS, 1 / POINTS))  # turns nothing
        self.scale = fit.a
        self.offset: F64 = np.array([fit.tx, fit.ty])
        self._weight = np.maximum(self.picture(old.mask.astype(np.float32)), 1e-3)

    def vectors(self, vectors: F32, *, offsets: bool = True) -> F32:
        """Appearance vectors (m, 162 + 3 n) on the new frame; without `offsets` they are differences of vectors."""
        shapes = vectors[:, :SHAPE_ENTRIES].reshape(-1, POINTS, 2) / self._old.shape_weight * self.scale
        shapes = (shapes + (self.offset if offsets else 0.0)) * self._new.shape_weight
        textures = [self.texture(v[SHAPE_ENTRIES:].reshape(-1, 3)).ravel() for v in vectors]
        return np.concatenate(
            [shapes.reshape(len(vectors), SHAPE_ENTRIES), np.stack(textures)], axis=1, dtype=np.float32
        )

    def texture(self, texture: F32) -> F32:
        """(n', ..) of a texture (n, ..); at the rim only what lies inside the old mask counts."""
        picture = self.picture(self._old.scatter(texture))
        weight = self._weight if texture.ndim == 1 else self._weight[..., None]
        return np.asarray((picture / weight)[self._new.mask], np.float32)

    def picture(self, picture: F32 | U8, factor: int = 1) -> F32:
        """A picture (factor h, factor w, ..) of the old grid on the new one; blurred first where that is coarser."""
        values = np.asarray(picture, np.float32)
        if self.scale < 1:
            sigma = 0.5 * np.sqrt(1 / self.scale**2 - 1)
            values = np.asarray(cv2.GaussianBlur(values, (0, 0), sigma), np.float32)
        shift = factor * (self.offset + 0.5 - 0.5 * self.scale) - 0.5 + 0.5 * self.scale
        matrix = np.array([[self.scale, 0, shift[0]], [0, self.scale, shift[1]]])
        h, w = self._new.size
        size = (factor * w, factor * h)
        return np.asarray(
            cv2.warpAffine(values, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
            np.float32,
        )
