"""The drawn face's texture: how the head is seen, what it expresses, and the donor's appearance for that.

fit -> parameters -> alpha-extrapolation (de la Hunty, Asthana and Goecke, ICPR 2010) -> texture and shape, whose points
move as far as the head's own.  Pixels, x right, y down; RGB 0..255.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.extrapolation import Extrapolator
from guise.aam.parameters import ParameterEstimator
from guise.aam.reference import POINTS, MeshSampler
from guise.aam.relief import Relief
from guise.aam.shape_transfer import ShapeTransfer
from guise.aam.solid_shape import HeadPose, Sight
from guise.aam.view_prior import SideViews
from guise.app.drawing.face import FaceInFrame, Fold, Seen
from guise.app.drawing.memory import Memory
from guise.common import small
from guise.common.arrays import F32, F64, U8
from guise.common.kernels import TWINS, kernel
from guise.common.tuned import tuned


@dataclass(frozen=True)
class TextureLimits:
    """When the texture moves less, and how it is enlarged; pixels of the picture a grid pixel are its zoom."""

    # of turn from how either was enrolled: less, and not at all
    still_degrees: tuple[float, float] = tuned((12.0, 28.0), "degrees", "picture.turned")
    # above which detail is added
    min_detail_zoom: float = tuned(1.15, "pixels a grid pixel", "picture.truth")
    # below which the texture is blurred against aliasing
    max_blur_zoom: float = tuned(0.7, "pixels a grid pixel", "picture.truth")
    # standard deviation, at a zoom of 1
    blur_grid_pixels: float = tuned(0.45, "grid pixels", "picture.truth")


LIMITS = TextureLimits()
NO_FOLD = Fold(np.s_[0:1, 0:1], np.zeros((1, 1), np.float32), 0, np.zeros((0, 2, 2)))


class PlainTexture:
    """The appearance that the extrapolation gives, and the shape that goes with it, as the papers have it."""

    def __init__(self, extrapolator: Extrapolator, estimator: ParameterEstimator) -> None:
        self.extrapolator, self.estimator = extrapolator, estimator

    @property
    def alpha(self) -> float:
        """Share in [0, 1] of the expression outside the donor's own space that is let through; setting it costs."""
        return self.extrapolator.alpha

    @alpha.setter
    def alpha(self, value: float) -> None:
        if value != self.extrapolator.alpha:
            self.extrapolator.alpha = value

    def look(self, face: FaceInFrame, memory: Memory) -> None:
        """See what the frame shows of the head at the texels."""
        places = self.estimator.sampler.positions(face.head)
        rgb = face.frame.sample_rgb(places)
        face.seen = Seen(places, rgb, rgb)

    def measure(self, face: FaceInFrame, memory: Memory) -> None:
        """Tell what the head expresses."""
        face.seen.parameters = self.estimator(face.head, face.seen.clear)

    def synthesise(self, face: FaceInFrame, memory: Memory) -> None:
        """Make the donor's shape and texture for that."""
        self._make(face, 1.0)

    def _make(self, face: FaceInFrame, share: float, factors: F32 | None = None) -> None:
        appearance = self.extrapolator.apply(face.seen.parameters, share, factors)
        weight = self.extrapolator.reference.shape_weight
        face.shape = appearance[:SHAPE_ENTRIES].reshape(POINTS, 2).astype(np.float64) / weight
        face.canvas.texture = appearance[SHAPE_ENTRIES:].reshape(-1, 3)


class Texture(PlainTexture):
    """The same with the shape fitted into the head, and seen as the head is turned.

    Parameters
    ----------
    extrapolator, estimator : of the texture, and of the person's parameters.
    transfer : of the shape.
    sides : how the donor looks from the side.
    relief, whole : of the drawn face, and see `Sight.of`.
    across : (2,) grid pixels by which the donor's texture shows what lies one face width farther back elsewhere.
    """

    def __init__(
        self, extrapolator: Extrapolator, estimator: ParameterEstimator, transfer: ShapeTransfer, sides: SideViews,
        relief: Relief, whole: F64, across: F64,
    ) -> None:  # fmt: skip
        super().__init__(extrapolator, estimator)
        self.transfer, self._sides, self._relief, self._whole = transfer, sides, relief, whole
        self._normals = relief.normals(transfer.solid)
        reference = relief.reference
        ys, xs = np.divmod(reference.pixels[estimator.texels], reference.size[1])
        self._sampler = MeshSampler.build(relief.mesh, np.column_stack([xs, ys]).astype(np.float64))
        self._across = across

    def look(self, face: FaceInFrame, memory: Memory) -> None:
        """See how the head is turned, and what the frame shows of it at the texels."""
        pose = face.pose
        enrolled = self._across @ self._relief.reference.to_shape(face.head).linear
        at_rest = self.transfer.at_rest(face.head, pose)
        face.sight = sight = Sight.of(self._normals, self._whole, pose, enrolled, at_rest)
        if any(sight.across):
            places = self._sampler.positions(self._relief.seen(face.head, sight.across))
        else:
            places = self.estimator.sampler.positions(face.head)
        rgb = face.frame.sample_rgb(places)
        face.seen = Seen(places, rgb, rgb)

    def synthesise(self, face: FaceInFrame, memory: Memory) -> None:
        """Make the donor's texture for what the head expresses, and its shape for where its points are."""
        pose = face.pose
        factors = self._sides.at(pose.angles[0] - self.transfer.target.pose.angles[0])
        self._make(face, self._share(pose), factors)
        face.shape = self.transfer.apply(face.head, pose)

    def _share(self, pose: HeadPose) -> float:
        """Share of the texture's movement that is shown: of a turned head it is its turn, not its expression."""
        source, target = self.transfer.source.pose, self.transfer.target.pose
        turn = max(pose.turn_from(source), pose.turn_from(target))
        return 1 - small.ramp(turn, *LIMITS.still_degrees)


class Enlargement:
    """The picture as fine as the face is drawn.

    Parameters
    ----------
    detail : (2 h, 2 w) grey levels, what the donor's face has beyond the grid.
    interpolation : of OpenCV; cubic makes up for what the bilinear warp blurs.
    """

    def __init__(self, detail: F32, interpolation: int) -> None:
        self._detail = detail
        is_cubic = interpolation == cv2.INTER_CUBIC
        self._enlarge = enlarge if is_cubic else partial(TWINS["enlarge"], interpolation=interpolation)

    def choose(self, face: FaceInFrame, memory: Memory) -> None:
        """Tell whether the face is drawn larger than the grid."""
        face.canvas.fine = face.zoom > LIMITS.min_detail_zoom

    def enlarge(self, face: FaceInFrame, memory: Memory) -> None:
        """Enlarge the picture and add detail, or blur it against aliasing."""
        canvas, picture = face.canvas, face.canvas.picture
        if face.zoom < LIMITS.max_blur_zoom:
            sigma = LIMITS.blur_grid_pixels / face.zoom
            canvas.picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma), np.uint8)
        elif canvas.fine:
            fold = canvas.fold or NO_FOLD
            rows, columns = fold.place
            where = fold.share, columns.start, rows.start
            canvas.picture = np.empty((*self._detail.shape, 3), np.uint8)
            self._enlarge(picture, self._detail, canvas.contrast, *where, canvas.picture)


@kernel
def enlarge(
    picture: U8, detail: F32, contrast: float, fold: F32, left: int, top: int, out: U8,
    interpolation: int = cv2.INTER_CUBIC,
) -> None:  # fmt: skip
    """Out (2 h, 2 w, 3): a picture (h, w, 3) by cubic convolution, and detail (2 h, 2 w), scaled, on its brightness.

    fold, left, top : (i, j) share in [0, 1] by which detail is left out, and where that lies in the picture.
    """
    cv2.resize(picture, detail.shape[::-1], dst=out, interpolation=interpolation)
    (h, w), detail = fold.shape, detail * np.float32(contrast)
    detail[2 * top : 2 * (top + h), 2 * left : 2 * (left + w)] *= 1 - cv2.resize(fold, (2 * w, 2 * h))
    luma = cv2.extractChannel(out, 0)
    cv2.insertChannel(cv2.add(luma, detail, dtype=cv2.CV_8U), out, 0)
