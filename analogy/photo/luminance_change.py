"""The part of an expression's change in luminance that can be transferred from S to T.  Fields (h, w) on the grid."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.analogy.photo.height_field import LUMINANCE_OFFSET
from guise.common.arrays import F32, Bool


@dataclass(frozen=True)
class ChangeSettings:
    """Settings of the transferred change of luminance; faces are face widths, contrasts are of log luminance."""

    neighbourhood_sigma_faces: float = 0.012  # of the neighbourhoods that are compared
    flat_contrast: float = 0.03  # within which a neighbourhood is flat
    identical_contrast: float = 1e-4  # the same, where even the noise must agree
    coarse_sigma_faces: float = 0.02  # of what is taken where S and T differ
    noise_power_medians: float = 1.5  # median powers of the detail
    lip_similarity_power: int = 3  # of the similarity beside the composited mouth
    max_brightening: float = 0.25
    max_darkening: float = 0.18
    share_between_people: float = (
        0.5  # of the change, which suits nobody's face as it does that of the source
    )
    moved_contrast: float = 0.15  # within which S and S' count as alike: of wrinkles, less than of brows
    light_step_px: int = 6  # between the pixels by which the light is judged
    light_rounds: int = 8  # of reweighting
    light_scale: float = 0.01  # of Cauchy's likelihood around the plane of light
    mouth_margin_faces: float = 0.012  # by which the composited mouth is widened


CHANGE = ChangeSettings()
FOLD_POWERS = np.array([0.8, 1.07, 1.15], np.float32)  # of a darkening, by channel; their luminance is 1


def similarity_fields(source: F32, target: F32, width: float) -> tuple[F32, F32]:
    """Two fields 0 to 1: local similarity of log luminances, regardless of level; and whether they are identical."""
    sigma = CHANGE.neighbourhood_sigma_faces * width
    one, two = source - _blur(source, sigma), target - _blur(target, sigma)
    both = 2 * _blur(one * two, sigma)
    power = _blur(one * one + two * two, sigma)
    alike, same = (
        (both + flat**2) / (power + flat**2) for flat in (CHANGE.flat_contrast, CHANGE.identical_contrast)
    )
    return np.asarray(np.clip(alike, 0, 1), np.float32), np.asarray(np.clip(same, 0, 1) ** 2, np.float32)


def registered_share(before: F32, after: F32, width: float) -> F32:
    """(h, w) 0 to 1: whether S' shows what S does at each pixel, given their log luminances.

    Where neither landmarks nor flow followed a brow, what shows is not a change of light: a brow and no brow.
    """
    sigma = CHANGE.coarse_sigma_faces * width
    one, two = before - _blur(before, sigma), after - _blur(after, sigma)
    both, power = 2 * _blur(one * two, sigma), _blur(one * one + two * two, sigma)
    flat = CHANGE.moved_contrast**2
    return np.asarray(np.clip((both + flat) / (power + flat), 0, 1), np.float32)


def transferable_change(change: F32, alike: F32, same: F32, filled: Bool, width: float) -> F32:
    """The part of a change from S to S' that the target takes, given fields (h, w) of `similarity_fields`.

    Detail is kept where S resembles T and the change is not noise; elsewhere only the smoothed change is kept.  A fine
    change belongs to the structure that it changes: where T lacks that structure it would appear as a ghost.  Regions
    composited from S' continue their surroundings, as teeth and the darkness behind them are not a change of the lips.
    """
    size = 2 * round(CHANGE.mouth_margin_faces * width) + 1
    widened = cv2.dilate(filled.astype(np.uint8), np.ones((size, size), np.uint8))
    outside = np.asarray(widened == 0, np.float32)
    sigma = CHANGE.coarse_sigma_faces * width
    coarse = _blur(change * outside, sigma) / (_blur(outside, sigma) + 1e-6)
    detail = change - coarse
    kept = np.where(outside > 0, alike, alike**CHANGE.lip_similarity_power) * ~filled
    return np.asarray(
        coarse + kept * _wiener_gain(detail, same, CHANGE.neighbourhood_sigma_faces * width) * detail,
        np.float32,
    )


def subtract_light_plane(change: F32, face: Bool, keep: float) -> F32:
    """A change (h, w) without the plane that fits most of the face, as S and S' may be lit slightly differently.

    keep : share of that light to keep; 1 where T is S itself.
    The plane is fitted by reweighted least squares (Cauchy): an expression is an outlier, not noise around the plane.
    """
    y, x = np.nonzero(face[:: CHANGE.light_step_px, :: CHANGE.light_step_px]) * np.array(CHANGE.light_step_px)
    if len(x) < 3:
        return change
    terms = np.column_stack([np.ones(len(x)), x, y])
    values = change[y, x].astype(np.float64)
    plane, hold = np.array([np.median(values), 0, 0]), 1e-9 * np.eye(3)
    for _ in range(CHANGE.light_rounds):
        weighted = terms / ((values - terms @ plane) ** 2 + CHANGE.light_scale**2)[:, None]
        plane = np.linalg.solve(weighted.T @ terms + hold, weighted.T @ values)
    height, width = change.shape
    light = plane[0] + plane[1] * np.arange(width) + (plane[2] * np.arange(height))[:, None]
    return np.asarray(change - (1 - keep) * light, np.float32)


def limit_change(change: F32, keep: float) -> F32:
    """A change (h, w), less of it and within bounds; a share `keep` is left as it is, 1 where T is S itself.

    Skin in a socket or fold becomes several times brighter when it comes into the light; that of T may not lie in
    shadow at all.  What becomes much darker is a brow or a lip that was not followed, or a wrinkle of S alone.
    """
    less = CHANGE.share_between_people * change
    up, down = np.maximum(less, 0), np.maximum(-less, 0)
    bounded = CHANGE.max_brightening * np.tanh(up / CHANGE.max_brightening)
    bounded -= CHANGE.max_darkening * np.tanh(down / CHANGE.max_darkening)
    return np.asarray(keep * change + (1 - keep) * bounded, np.float32)


def change_gain(change: F32) -> F32:
    """Gain (h, w, 3) of a change (h, w) of log luminance; skin that becomes darker becomes redder.

    Light in a fold comes from the skin beside it: with unchanged colours folds look grey-green.
    """
    channels = change[:, :, None] * np.where(change[:, :, None] < 0, FOLD_POWERS, np.float32(1))
    return np.asarray(np.exp(channels), np.float32)


def relight(picture: F32, gain: F32) -> F32:
    """A picture (h, w, 3) with a gain (h, w, 3) of light."""
    out = picture + LUMINANCE_OFFSET
    out *= gain
    out -= LUMINANCE_OFFSET
    return out


def _wiener_gain(detail: F32, same: F32, sigma: float) -> F32:
    """Wiener gain (h, w) that suppresses noise; most pixels are assumed to contain noise only.

    Where T is S itself, noise is kept.
    """
    power = _blur(detail * detail, sigma)
    noise = CHANGE.noise_power_medians * float(np.median(power)) * (1 - same)
    return np.asarray(np.maximum(power - noise, 0) / (power + 1e-12), np.float32)


def _blur(field: F32, sigma: float) -> F32:
    return np.asarray(cv2.GaussianBlur(field, (0, 0), max(sigma, 0.5)), np.float32)
