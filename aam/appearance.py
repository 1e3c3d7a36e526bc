"""Shape, texture and combined appearance: principal components of a person's aligned frames.

Appearance vector y = (w_s x0, w_s y0, .., r0, g0, b0, ..): the landmarks on the reference grid, weighted, then the
RGB of every mask pixel (DESIGN of de la Hunty, Asthana and Goecke 2010, section 2).  Grid pixels; RGB 0..255.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    LEFT_EYE_OUTER,
    LEFT_MOUTH_CORNER,
    LIDS_BELOW_BROW_TOPS,
    LOWER_INNER_LIP,
    LOWER_LIDS,
    RIGHT_EYE_OUTER,
    RIGHT_MOUTH_CORNER,
    UPPER_INNER_LIP,
    UPPER_LIDS,
)
from guise.aam.reference import POINTS, ReferenceFrame
from guise.common.arrays import F32, F64, U8, Bool, Floating
from guise.common.errors import GuiseError

SHAPE_ENTRIES = 2 * POINTS  # leading entries of an appearance vector


@dataclass(frozen=True)
class RestLimits:
    """What counts as a face at rest among a person's frames."""

    mouth_quantile: float = 0.05  # of the mouth's opening: shut
    lid_quantile: float = 0.75  # of the lids' opening: open, not wide open
    yaw_quantiles: tuple[float, float] = (0.1, 0.9)  # between which the yaw nearest to the front is taken ..
    near_yaw_degrees: float = 4.0  # .. if so near to it ..
    frontal_share: float = 0.1  # .. lies this share of the frames
    bandwidth_deviations: float = 1.8  # of openings, width and yaw, over which frames count
    ridge: float = 0.05  # damping of the regression


REST = RestLimits()
_LEAST_SPREAD = np.array([0.01, 0.01, 0.01, 0.01, 1.0])  # of the entries of `_states`


@dataclass(frozen=True, eq=False)
class Components:
    """Mean, orthonormal basis and standard deviations of a set of vectors.

    Parameters
    ----------
    mean : (n,) float32.
    basis : (n, k) float32, orthonormal columns.
    deviations : (k,) float32, standard deviation along each column, decreasing.
    total_variance : float, of the training vectors, kept modes or not.
    """

    mean: F32
    basis: F32
    deviations: F32
    total_variance: float

    @property
    def modes(self) -> int:
        """Number of columns kept."""
        return int(self.basis.shape[1])

    @property
    def retained(self) -> float:
        """Share of the training variance inside the basis, 0..1."""
        if self.total_variance <= 0:
            return 1.0
        return float((self.deviations.astype(np.float64) ** 2).sum() / self.total_variance)

    def project(self, vectors: Floating) -> F32:
        """Parameters (.., k) of vectors (.., n): basis^T (y - mean)."""
        return np.asarray((vectors - self.mean) @ self.basis, np.float32)

    def synthesise(self, parameters: Floating) -> F32:
        """Vectors (.., n) of parameters (.., k): mean + basis rho."""
        return np.asarray(self.mean + parameters @ self.basis.T, np.float32)


def principal_components(vectors: F32, retain: float | int) -> Components:
    """Principal components of the rows of (m, n) vectors.

    Parameters
    ----------
    retain : share of the variance to keep (float in (0, 1]) or number of modes (int >= 1).

    Examples
    --------
    >>> pca = principal_components(np.float32([[0, 0, 1], [2, 0, 1], [4, 0, 1]]), 1)
    >>> pca.mean.tolist(), abs(pca.basis[:, 0]).round(6).tolist()
    ([2.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    """
    mean = vectors.mean(0)
    centred = vectors - mean
    gram = (centred @ centred.T).astype(np.float64) / len(vectors)
    values, left = np.linalg.eigh(gram)
    values, left = np.maximum(values[::-1], 0.0), left[:, ::-1]
    total = float(values.sum())
    k = _modes_to_keep(values, retain)
    basis, _ = np.linalg.qr((centred.T @ left[:, :k]).astype(np.float64))
    return Components(mean, basis.astype(np.float32), np.sqrt(values[:k]).astype(np.float32), total)


def _modes_to_keep(values: F64, retain: float | int) -> int:
    useful = max(1, int((values > 1e-9 * max(values[0], 1e-30)).sum()))
    if isinstance(retain, int):
        if retain < 1:
            raise GuiseError(f"the number of modes must be at least 1, got {retain}")
        return min(retain, useful)
    if not 0 < retain <= 1:
        raise GuiseError(f"the retained variance must be in (0, 1], got {retain}")
    share = np.cumsum(values) / max(float(values.sum()), 1e-30)
    return min(int(np.searchsorted(share, retain)) + 1, useful)


def sample_texture(rgb: U8, shape: F64, reference: ReferenceFrame) -> F32:
    """Texture (n, 3) float32 of a picture (h, w, 3) under a shape (81, 2) in its pixels.

    A face larger than the grid is first reduced by area, so that every frame pixel counts (no aliasing).
    """
    return reference.sampler.sample(*face_region(rgb, shape, reference))


def face_region(rgb: U8, shape: F64, reference: ReferenceFrame) -> tuple[U8, F64]:
    """The part of a picture (h, w, 3) that shows a face at a shape (81, 2), and the shape in it.

    A face larger than the grid is first reduced by area, so that every frame pixel counts (no aliasing).
    """
    x0, y0 = np.maximum(np.floor(shape.min(0)).astype(int) - 4, 0)
    x1, y1 = np.ceil(shape.max(0)).astype(int) + 5
    roi = rgb[y0:y1, x0:x1]
    if roi.size == 0:
        raise ValueError("the face lies outside the picture")
    local = shape - (x0, y0)
    ratio = reference.to_shape(local).scale  # picture pixels per grid pixel
    if ratio > 1.25:
        small = (max(2, round(roi.shape[1] / ratio)), max(2, round(roi.shape[0] / ratio)))
        factor = np.array(small) / (roi.shape[1], roi.shape[0])
        roi = np.asarray(cv2.resize(roi, small, interpolation=cv2.INTER_AREA), np.uint8)
        local = (local + 0.5) * factor - 0.5
    return np.ascontiguousarray(roi), local


@dataclass(frozen=True, eq=False)
class AppearanceModel:
    """What a person's face looks like: combined appearance modes, neutral appearance, learned mask.

    Parameters
    ----------
    reference : ReferenceFrame of every vector here.
    components : Components of the appearance vectors (162 + 3 n).
    neutral : (162 + 3 n,) float32, the appearance with the face at rest.
    mask : (h, w) bool, where the face may be shown: no hair, no background.
    """

    reference: ReferenceFrame
    components: Components
    neutral: F32
    mask: Bool

    @cached_property
    def neutral_parameters(self) -> F32:
        """(k,) parameters of the neutral appearance."""
        return self.components.project(self.neutral)

    @property
    def neutral_shape(self) -> F64:
        """(81, 2) neutral landmarks, grid pixels."""
        return self.shape_of(self.neutral)

    @property
    def neutral_texture(self) -> F32:
        """(n, 3) neutral RGB."""
        return self.texture_of(self.neutral)

    def with_neutral_texture(self, texture: F32) -> AppearanceModel:
        """The same with another neutral RGB, of which a picture (h, w, 3) on the grid is given."""
        neutral = self.neutral.copy()
        neutral[SHAPE_ENTRIES:] = texture[self.reference.mask].ravel()
        return replace(self, neutral=neutral)

    def shape_of(self, vector: F32) -> F64:
        """Landmarks (81, 2), grid pixels, of an appearance vector."""
        return np.asarray(vector[:SHAPE_ENTRIES].reshape(POINTS, 2), np.float64) / self.reference.shape_weight

    def texture_of(self, vector: F32) -> F32:
        """RGB (n, 3) of an appearance vector."""
        return vector[SHAPE_ENTRIES:].reshape(-1, 3)

    def picture(self, vector: F32) -> U8:
        """RGB picture (h, w, 3) uint8 of an appearance vector's texture on the grid."""
        return np.asarray(np.clip(self.reference.scatter(self.texture_of(vector)), 0, 255).round(), np.uint8)


def appearance_vectors(
    shapes: F64, textures: F32, reference: ReferenceFrame, weights: F32 | None = None
) -> F32:
    """Appearance vectors (m, 162 + 3 n) of shapes (m, 81, 2) in pixels and textures (m, n, 3).

    weights (n,) in [0, 1] damp the variation of pixels that aren't face (hair, background): outside the learned mask
    every frame shows the mean.
    """
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), SHAPE_ENTRIES)
    if weights is not None:
        mean = textures.mean(0)
        textures = mean + (textures - mean) * weights[:, None]
    parts = [
        aligned.astype(np.float32) * np.float32(reference.shape_weight),
        textures.reshape(len(textures), -1),
    ]
    return np.concatenate(parts, axis=1)


def openness(shapes: F64) -> F64:
    """Mouth, lid and brow openings (m, 3) of shapes (m, 81, 2), in inter-ocular distances."""
    iod = np.linalg.norm(shapes[:, LEFT_EYE_OUTER] - shapes[:, RIGHT_EYE_OUTER], axis=1)
    mouth = np.linalg.norm(shapes[:, UPPER_INNER_LIP] - shapes[:, LOWER_INNER_LIP], axis=2).mean(1)
    lids = np.linalg.norm(shapes[:, UPPER_LIDS] - shapes[:, LOWER_LIDS], axis=2).mean(1)
    brows = np.linalg.norm(shapes[:, BROW_TOPS] - shapes[:, LIDS_BELOW_BROW_TOPS], axis=2).mean(1)
    return np.asarray(np.stack([mouth, lids, brows], 1) / iod[:, None])


def neutral_frames(
    shapes: F64, reference: ReferenceFrame, count: int = 7, rest: F64 | None = None
) -> Sequence[int]:
    """Indices of the frames nearest to a face at rest: mouth shut, lids and brows as usual, seen from the front.

    shapes : (m, 81, 2) pixels.
    rest : (81, 2) the face where it's known to be at rest; the frames nearest to it are taken.
    """
    if rest is not None:
        states = _states(np.concatenate([rest[None], shapes]), reference)
        spread = np.maximum(states.std(0), _LEAST_SPREAD)
        away = np.linalg.norm((states[1:] - states[0]) / spread, axis=1)
        return [int(i) for i in np.argsort(away, kind="stable")[:count]]
    states = _states(shapes, reference)
    yaws = states[:, 4]
    in_front = np.abs(yaws - _rest_yaw(yaws)) <= REST.near_yaw_degrees
    usual = np.median(states[in_front], axis=0)
    usual[:2] = np.quantile(states[:, 0], REST.mouth_quantile), np.quantile(states[:, 1], REST.lid_quantile)
    least = np.array([0.01, 0.01, 0.01, 0.1 / reference.resolution])
    away = np.abs(states - usual)[:, :4] / np.maximum(states[:, :4].std(0), least)
    aligned = np.stack([reference.align(s) for s in shapes]).reshape(len(shapes), -1)
    from_usual = np.linalg.norm(aligned - np.median(aligned[in_front], 0), axis=1)
    score = away @ [2.0, 1.0, 1.0, 1.0] + from_usual / max(float(np.median(from_usual)), 0.1)
    return [int(i) for i in np.argsort(score)[:count]]


def rest_weights(shapes: F64, reference: ReferenceFrame, chosen: F64 | None = None) -> F64:
    """Weights (m,) summing to 1 that make the face at rest out of frames with shapes (m, 81, 2).

    Local linear regression on the openings, the mouth's width and the yaw, read at rest: mouth shut, lids open, the
    head as frontal as the clip has it, the others at their median.  Many frames contribute, so the errors and the noise
    of single ones cancel.

    chosen : (81, 2) the face where it's known to be at rest, at which the regression is read instead.
    """
    state = _states(shapes, reference)
    rest = np.median(state, axis=0)
    rest[:2] = np.quantile(state[:, 0], REST.mouth_quantile), np.quantile(state[:, 1], REST.lid_quantile)
    rest[4] = _rest_yaw(state[:, 4])
    if chosen is not None:
        rest = _states(chosen[None], reference)[0]
    away = (state - rest) / np.maximum(state.std(0), _LEAST_SPREAD)
    near = np.exp(-0.5 * (away**2).sum(1) / REST.bandwidth_deviations**2) + 1e-6
    design = np.column_stack([np.ones(len(away)), away])
    ridge = REST.ridge * near.sum() * np.diag([0.0, 1, 1, 1, 1, 1])
    weights = np.linalg.solve((design * near[:, None]).T @ design + ridge, (design * near[:, None]).T)[0]
    return np.asarray(weights / weights.sum())


def _rest_yaw(yaws: F64) -> float:
    """Degrees nearest to the front that many of a clip's frames (m,) show; their median where few are so near."""
    frontal = float(np.clip(0.0, *np.quantile(yaws, REST.yaw_quantiles)))
    near = np.abs(yaws - frontal) <= REST.near_yaw_degrees
    return frontal if near.mean() >= REST.frontal_share else float(np.quantile(yaws, 0.5, method="nearest"))


def _states(shapes: F64, reference: ReferenceFrame) -> F64:
    """(m, 5) openings, the mouth's width in face widths and yaw in degrees of shapes (m, 81, 2)."""
    aligned = np.stack([reference.align(s) for s in shapes])
    corners = aligned[:, LEFT_MOUTH_CORNER] - aligned[:, RIGHT_MOUTH_CORNER]
    yaw = [reference.yaw(a) for a in aligned]
    return np.column_stack([openness(shapes), np.linalg.norm(corners, axis=1) / reference.resolution, yaw])
