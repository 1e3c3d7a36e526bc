"""2-D facial expression analogy: T' is to T as S' is to S (Song et al. 2007, section VI).

Landmarks are (81, 2) of scheme face81, pixels of their own picture, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

import cv2
import numpy as np
from numpy.typing import ArrayLike

from guise.analogy.photo.compositing import MOUTH_MARGIN_FACES, bounding_part, composite_lids, composite_mouth
from guise.analogy.photo.eyes import lid_shares, reopen_eyes
from guise.analogy.photo.flow import residual_flow, sample_field
from guise.analogy.photo.grid import (
    MAX_FACE_PX,
    Grid,
    RasterisedFace,
    face_mask,
    face_width,
    pixel_places,
    rasterise,
)
from guise.analogy.photo.height_field import log_luminance, target_edge_changes
from guise.analogy.photo.landmark_motion import LandmarkMotion
from guise.analogy.photo.luminance_change import (
    change_gain,
    limit_change,
    registered_share,
    relight,
    similarity_fields,
    subtract_light_plane,
    transferable_change,
)
from guise.analogy.photo.mouth import eye_white, light_gain, limit_teeth, mouth_fill_share
from guise.analogy.photo.pictures import (
    LUMINANCE,
    PhotoError,
    Picture,
    as_float_rgb,
    as_type_of,
    check_landmarks,
    downscale,
    sample_bicubic,
)
from guise.analogy.photo.poisson import integrate_edges
from guise.analogy.photo.ratio import rim_fade, smoothed_ratio
from guise.analogy.photo.template import anchor_ring, face_template
from guise.common.arrays import F32, F64

Method = Literal["tents", "ratio", "warp"]
Mouth = Literal["fill", "none"]
METHODS: tuple[Method, ...] = get_args(Method)
MOUTHS: tuple[Mouth, ...] = get_args(Mouth)


LIGHT_MARGIN_FACES = 0.08  # around the face, in which light is computed: four times the widest blur


class PhotoAnalogy:
    """Transfers expressions of a person S to a photo T of another.

    Parameters
    ----------
    source : S, neutral, (h, w, 3) RGB or (h, w): uint8, uint16 or float in 0 .. 1.   source_points : (81, 2).
    target : T, neutral, of the same kinds and any size.   target_points : (81, 2).
    method : 'tents'; 'ratio', expression ratio images; 'warp', geometry only.
    mouth : 'fill' takes the inside of an opening mouth from S'; 'none', as in the paper, stretches T.
    max_face_px : across the face, above which light, mouth and lids are computed on a coarser grid; T keeps its own.

    Raises
    ------
    PhotoError
        When a picture or landmarks cannot be used.
    """

    def __init__(
        self,
        source: Picture,
        source_points: ArrayLike,
        target: Picture,
        target_points: ArrayLike,
        method: Method = "tents",
        mouth: Mouth = "fill",
        max_face_px: int = MAX_FACE_PX,
    ) -> None:
        if method not in METHODS or mouth not in MOUTHS:
            raise PhotoError(
                f"method must be one of {METHODS} and mouth one of {MOUTHS}, got {method!r}, {mouth!r}"
            )
        self.method, self.mouth = method, mouth
        self._mesh = face_template()
        first = check_landmarks(source_points, "source_points")
        second = check_landmarks(target_points, "target_points")
        self._target = np.asarray(target)
        self._motion = LandmarkMotion(first, second)
        self._ring = anchor_ring(second)
        self._grid = Grid.around(second, self._ring, self._target.shape, max_face_px)
        self._face = as_float_rgb(self._grid.crop(self._target), "target")
        self._vertices = self._mesh.vertices(second, self._ring)
        picture = as_float_rgb(source, "source")
        neutral, self._neutral_places = self._prepare_source(picture, first, anchor_ring(first))
        self._neutral = neutral @ LUMINANCE
        self._light = light_gain(picture, first, self._face, second - self._grid.origin)
        self._white = float(eye_white(self._face, second - self._grid.origin) @ LUMINANCE)

    def __call__(
        self, expressive: Picture, points: ArrayLike, strength: float = 1.0, posed: ArrayLike | None = None
    ) -> Picture:
        """T' with the type and size of T.

        expressive : S', of any size.   points : (81, 2).
        strength : 0 gives T, 1 the expression; beyond it is exaggerated.
        posed : (81, 2) landmarks of S' as they would be with the head pose of S; motion is measured from them, so
            that a turn of the head does not count as expression.

        Raises
        ------
        PhotoError
            When the picture or its landmarks cannot be used.
        """
        given = check_landmarks(points, "points")
        expressed = given if posed is None else check_landmarks(posed, "posed")
        shares = (
            lid_shares(self._motion.source, expressed, strength) if self.method == "tents" else np.zeros(2)
        )
        if shares.any():
            given, expressed = (self._with_open_lids(landmarks, shares) for landmarks in (given, expressed))
        around = self._motion.pose(given).inverse().apply(anchor_ring(self._motion.source))
        picture, places = self._prepare_source(as_float_rgb(expressive, "expressive"), given, around)
        share = mouth_fill_share(self._motion.source, given, strength) if self.mouth == "fill" else 0.0
        seen = self._rasterise(self._motion(expressed, strength), places)
        shown, lids = sample_bicubic(picture, seen.values[..., 4:]), seen.eye_shares(shares)
        box = seen.face_box(LIGHT_MARGIN_FACES * self._width)
        near, light = seen.within(box), shown[box] @ LUMINANCE
        if self.method == "tents":
            near = self._add_residual_flow(near, light, strength if posed is None else 0.0)
            seen.values[box] = near.values
        out = self._warp(seen)
        if self.method != "warp":
            change = np.zeros(seen.face.shape, np.float32)
            target = (self._grid.downsample(out) @ LUMINANCE)[box]
            change[box] = strength * self._luminance_change(near, light, target, lids[box])
            out = self._relight(out, change)
        out = self._composite(out, shown, lids, seen.mouth_mask * np.float32(share))
        return self._paste(out, seen)

    def _with_open_lids(self, points: F64, shares: F64) -> F64:
        """Landmarks (81, 2) of S' with the eyes opened as in S, by shares (2,)."""
        rest = self._motion.pose(points).inverse().apply(self._motion.source)
        return reopen_eyes(points, rest, shares)

    def _prepare_source(self, picture: F32, points: F64, around: F64) -> tuple[F32, F64]:
        """A picture of the source, no finer than the grid, and the vertices (V, 2) of the template in it."""
        factor = self._grid.factor * face_width(self._motion.target) / max(face_width(points), 1e-6)
        small, held = downscale(picture, np.concatenate([points, around]), factor)
        return small, self._mesh.vertices(held[: len(points)], held[len(points) :])

    def _rasterise(self, made: F64, places: F64) -> RasterisedFace:
        """Rasterise the template at the landmarks (81, 2) of T', given its vertices (V, 2) in S'."""
        grid = self._grid
        vertices = grid.to_grid(self._mesh.vertices(made, self._ring))
        values = [grid.to_grid(self._vertices) - vertices, self._neutral_places, places]
        return rasterise(
            self._mesh,
            vertices,
            np.concatenate(values, axis=1),
            grid.size,
            face_mask(grid.to_grid(made), grid.size),
        )

    def _add_residual_flow(self, seen: RasterisedFace, shown: F32, share: float) -> RasterisedFace:
        """Add the residual flow from S to S' to the positions in S and, by a share, to those in T.

        The share is 0 for turned heads, where the residual is caused by the turn.
        """
        neutral = sample_bicubic(self._neutral, seen.values[..., 2:4])
        moved = residual_flow(
            log_luminance(shown), log_luminance(neutral), seen.face & (seen.part == 0), self._width
        )
        values, here = seen.values.copy(), pixel_places(seen.face.shape[::-1])
        values[..., 2:4] = sample_field(seen.values[..., 2:4], here + moved)
        moved *= np.float32(share)
        values[..., :2] = sample_field(seen.values[..., :2], here + moved) + moved
        return replace(seen, values=values)

    def _warp(self, seen: RasterisedFace) -> F32:
        """The warped crop (h, w, 3) of the target."""
        grid = self._grid
        moved = grid.upsample(seen.values[..., :2]) / np.float32(grid.factor)
        return sample_bicubic(self._face, pixel_places(grid.crop_size) + moved)

    def _luminance_change(self, seen: RasterisedFace, shown: F32, target: F32, lids: F32) -> F32:
        """(h, w) change of log luminance, given luminances of S' and the warped target, all of a part of the grid."""
        neutral = sample_bicubic(self._neutral, seen.values[..., 2:4])
        share = rim_fade(seen.face, self._width)
        if self.method == "ratio":
            return np.asarray(np.log(smoothed_ratio(neutral, shown, self._width)) * share, np.float32)
        before, after = log_luminance(neutral), log_luminance(shown)
        target = log_luminance(target)
        filled_in = (seen.mouth_mask & (self.mouth == "fill")) | (lids > 0)
        alike, same = similarity_fields(before, target, self._width)
        taken = transferable_change(after - before, alike, same, filled_in, self._width)
        if seen.face.any():
            keep = float(same[seen.face].mean()) ** 2
            taken = limit_change(subtract_light_plane(taken, seen.face, keep), keep)
            share = share * (1 - (1 - keep) * (1 - registered_share(before, after, self._width)))
            share = share * (1 - (1 - keep) * seen.eye_shares(np.ones(2)))
        taken = taken * share
        return integrate_edges(*target_edge_changes(before, before + taken, target), seen.face)

    def _relight(self, picture: F32, change: F32) -> F32:
        """A picture (h, w, 3) with changed luminance (on the grid); skin in a fold becomes redder."""
        return relight(picture, self._grid.upsample(change_gain(change)))

    def _composite(self, picture: F32, shown: F32, lids: F32, mouth: F32) -> F32:
        """Composite lids and the inside of the mouth of S' (`shown`, on the grid) into a picture (h, w, 3)."""
        fine, width = self._grid.upsample, face_width(self._motion.target)
        if lids.any():
            picture = composite_lids(picture, fine(shown), fine(lids), width)
        if mouth.any():
            alpha = fine(mouth)
            part = bounding_part(alpha, MOUTH_MARGIN_FACES * width)
            inside = fine(shown)[part]
            light = limit_teeth(self._light, inside, alpha[part], self._white)
            picture[part] = composite_mouth(picture[part], inside, alpha[part], light, width)
        return picture

    def _paste(self, made: F32, seen: RasterisedFace) -> Picture:
        """T with the pixels under the template replaced."""
        covered = np.asarray(self._grid.upsample(seen.covered.astype(np.float32)) > 0.5, np.uint8)
        out = self._target.copy()
        pixels = as_type_of(np.clip(made, 0, 1), self._target)
        part = self._grid.crop(out)
        part[:] = cv2.copyTo(pixels, covered, np.ascontiguousarray(part))
        return out

    @property
    def _width(self) -> float:
        """Width of the target's face, pixels of the grid."""
        return self._grid.factor * face_width(self._motion.target)
