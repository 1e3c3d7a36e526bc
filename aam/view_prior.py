"""How a face is expected to look from the side, by how it looks from the front.

Learnt from rendered people (`training/views.py`): principal components of the neutral texture's fine shades, and the
solid shape of the face, predict the change of its luma at 20, 35 and 50 degrees to one side, by ridge regression; the
other side is the same of the mirror image.  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.landmarks.schemes import MIRROR
from guise.aam.light import LUMA
from guise.aam.mirror import mirror_image
from guise.aam.reference import ReferenceFrame
from guise.aam.resampling import resampled_texture
from guise.aam.view_textures import LIMITS, YAWS, ViewTextures, changing, without_light
from guise.common.arrays import F32, F64

DATA = Path(__file__).parent / "data" / "views.npz"
RESOLUTION = 64  # of what is learnt
TURNS = tuple(yaw for yaw in YAWS if yaw > 0)
MAX_FEATURE = 2.5  # standard deviations


class ViewPrior:
    """The regression.

    Parameters
    ----------
    path : arrays `centre` (f,) and `basis` (f, k) of the inputs, `weights` (1 + k, r), `changes` (r, turns * n) on the
        grid of `RESOLUTION`; int8 arrays have a `scale_` of their columns or rows.
    """

    def __init__(self, path: Path) -> None:
        self.reference = ReferenceFrame.canonical(RESOLUTION)
        with np.load(path) as stored:
            self._centre = stored["centre"].astype(np.float32)
            self._basis = stored["basis"].astype(np.float32) * stored["scale_basis"].astype(np.float32)
            self._weights = stored["weights"].astype(np.float32)
            self._changes = stored["changes"] * stored["scale_changes"].astype(np.float32)[:, None]

    def __call__(self, texture: F32, rest: F64, reference: ReferenceFrame) -> F32:
        """(yaws, n) logarithms of luma over that of a neutral texture (n, 3) of a face at rest (81, 3), at `YAWS`."""
        small = resampled_texture(np.maximum(texture, 0) @ LUMA, reference, self.reference)
        right = self._to_one_side(small, rest)
        left = [self._mirrored(change) for change in self._to_one_side(self._mirrored(small), mirrored(rest))]
        return np.stack([resampled_texture(c, self.reference, reference) for c in [*left[::-1], *right]])

    def _to_one_side(self, luma: F32, rest: F64) -> F32:
        """(turns, n) at `TURNS`."""
        known = (features(luma, rest, self.reference) - self._centre) @ self._basis
        known = np.clip(known, -MAX_FEATURE, MAX_FEATURE)
        known /= max(
            1.0, float(np.sqrt(np.square(known).mean()))
        )  # nobody is stranger than those seen before
        made = self._weights[0] + known @ self._weights[1:]
        return np.asarray(made @ self._changes).reshape(len(TURNS), -1)

    def _mirrored(self, values: F32) -> F32:
        return mirror_image(self.reference.scatter(values), self.reference, 1)[self.reference.mask]


def features(luma: F32, rest: F64, reference: ReferenceFrame) -> F32:
    """(f,) what the regression sees: fine shades of a neutral face's luma (n,), and its shape at rest (81, 3)."""
    shades = without_light(np.log(luma + np.float32(LIMITS.black_grey_levels)), np.ones_like(luma), reference)
    return np.concatenate([shades, (rest - rest.mean(0)).ravel()]).astype(np.float32)


def mirrored(rest: F64) -> F64:
    """A solid shape (81, 3) in the mirror."""
    return rest[list(MIRROR)] * [-1, 1, 1]


@dataclass(frozen=True, eq=False)
class SideViews:
    """What a neutral texture is multiplied by as its head turns.

    Parameters
    ----------
    yaws : (b,) degrees from rest, increasing.
    factors : (b, n).
    """

    yaws: F64
    factors: F32

    @classmethod
    def of(cls, appearance: AppearanceModel, known: ViewTextures | None, rest: F64) -> SideViews:
        """A person's, whose face at rest is (81, 3): as they are known, and as expected where they are not."""
        reference = appearance.reference
        changes = shipped()(appearance.neutral_texture, rest, reference)
        if known is not None:
            at = np.searchsorted(YAWS, known.yaws)
            changes[at] += known.sure * (known.changes - changes[at])
        sigma = LIMITS.aperture_face_widths * reference.resolution
        soft = cv2.GaussianBlur(appearance.mask.astype(np.float32), (0, 0), sigma)
        changes *= changing(reference) * soft[reference.mask]
        front = int(np.searchsorted(YAWS, 0))
        return cls(np.insert(np.array(YAWS), front, 0.0), np.insert(np.exp(changes), front, 1.0, axis=0))

    def at(self, yaw: float) -> F32:
        """(n,) factors at a yaw; beyond the outermost views they are theirs."""
        after = min(max(int(self.yaws.searchsorted(yaw)), 1), len(self.yaws) - 1)
        before, beyond = self.yaws[after - 1 : after + 1]
        share = min(max(float((yaw - before) / (beyond - before)), 0.0), 1.0)
        factors = cv2.addWeighted(self.factors[after - 1], 1 - share, self.factors[after], share, 0)
        return np.asarray(factors, np.float32).ravel()


@cache
def shipped() -> ViewPrior:
    """The regression that ships with the package."""
    return ViewPrior(DATA)
