"""The engine: from a frame of one person to the same frame with another face, in place.

fit -> parameters -> extrapolation -> pose and palette -> warp -> blend, in the frame's own YUV planes
(the way of a frame, docs/conventions.md).  Pixels, x right, y down; RGB 0..255 unless said otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.appearance import SHAPE
from aam.extrapolation import DEFAULT_ALPHA, Extrapolator
from aam.follow import Finder, PersonFollower
from aam.model import Identity
from aam.parameters import ParameterEstimator
from aam.reference import POINTS, RIGID_WEIGHTS, ReferenceFrame
from aam.similarity import Failed, align_planar
from aam.tracker import Fit
from app.media import ColourMatrix, Frame
from app.palette import Palette
from render import Compositor, feather, make_compositor
from render.closing import Closing
from render.compositor import Renderer

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

FEATHER = 0.01  # standard deviation of the soft border, in face widths
HOLD = 4  # frames for which a lost face keeps its last place
FINE = 1.15  # face on screen wider than this many texture grids: detail is added

RIM = 0.09  # face widths from the hull in which the source's hair stays
REACH = 0.11  # face widths over which the inner points follow the outline
OUTLINE = np.r_[:17, 68:POINTS]  # jaw and forehead

APART = 0.09  # share of the way from the nose's root to the temple by which a disguise moves an eye and its brow out
RAISED = 0.05  # share of the way from the nose's root to the hair by which it moves the brows up
WIDER = 0.06  # share by which it enlarges the mouth


@dataclass(frozen=True)
class Options:
    """How the engine draws.

    Parameters
    ----------
    alpha : share in [0, 1] of the expression outside the donor's own space that is let through.
    renderer : "auto", "gl" or "cpu".
    palette : "symmetric" or "least-squares" scale of the colour similarity.
    outline : share in [0, 1] by which jaw and forehead follow the head in the picture.
    jaw, forehead : face widths by which they are then drawn beyond it, the forehead most in its middle, to hide the
        rim of the face too.
    disguise : draw the features in other proportions, see `proportions`, and over all within the outline, so that what
        the head in the picture still tells (hair, ears, neck) is recognised less.
    """

    alpha: float = DEFAULT_ALPHA
    renderer: Renderer = "auto"
    palette: Literal["symmetric", "least-squares"] = "symmetric"
    outline: float = 0.7
    jaw: float = 0.0
    forehead: float = 0.0
    disguise: bool = False


Outcome = Literal["swapped", "held", "lost"]


@dataclass(frozen=True, eq=False)
class Step:
    """What happened to a frame: outcome, the fit or the reason, and the mesh that was drawn (81, 2)."""

    outcome: Outcome
    fit: Fit | Failed
    mesh: F64 | None = None


class Engine(Closing):
    """Draws `target` over `source`, frame by frame; holds the compositors, so it is closed by `with`.

    Parameters
    ----------
    source : Identity of the person in the video.
    target : Identity whose face is shown.
    boxes : what finds the face at the start and after a loss, see `PersonFollower`.
    options : Options.

    Raises
    ------
    ReferenceMismatchError
        When the two do not share a reference frame.
    RendererError
        When the chosen renderer is not there.
    """

    def __init__(
        self, source: Identity, target: Identity, boxes: Finder | None, options: Options = Options()
    ) -> None:
        self.source, self.target, self.options = source, target, options
        self.extrapolator = Extrapolator(source.appearance, target.appearance, options.alpha)
        self.estimator = ParameterEstimator(source.appearance)
        self.follower = PersonFollower(source.tracker, boxes)
        self.painter = Painter(source, target, self.estimator, options)
        self._last: tuple[F64, F32] | None = None

    def step(self, frame: Frame) -> Step:
        """Swap the face in a frame, in place; a frame in which the person is lost is not touched.

        For a few frames after a loss the last face is held where it was.
        """
        fit = self.follower.step(frame.luma)
        if isinstance(fit, Fit):
            return Step("swapped", fit, self.draw(frame, fit.shape))
        if self._last is not None and self.follower.lost <= HOLD:
            return Step("held", fit, self.painter.paint(frame, *self._last, None))
        self._last = None
        self.painter.forget()
        return Step("lost", fit)

    def draw(self, frame: Frame, shape: F64) -> F64:
        """Swap the face that lies at a shape (81, 2) in a frame, in place; returns the mesh that was drawn (81, 2)."""
        texels = frame.sample_rgb(self.estimator.sampler.positions(shape))
        appearance = self.extrapolator.apply(self.estimator(shape, texels))
        self._last = shape, appearance
        return self.painter.paint(frame, shape, appearance, texels)

    def close(self) -> None:
        """Release the compositors."""
        self.painter.close()


class Painter:
    """Aligns a synthesised appearance with a head in a frame and blends it in.

    Parameters
    ----------
    source, target : Identity of the head and of the face.
    estimator : of the source; its texels serve the palette.
    options : Options.
    """

    def __init__(
        self, source: Identity, target: Identity, estimator: ParameterEstimator, options: Options
    ) -> None:
        self.options, self.frame = options, target.frame
        mask = self.frame.mask if options.disguise else shown_mask(source.appearance.mask, self.frame)
        self._alpha = feather(mask, FEATHER * self.frame.resolution)
        self._palette = Palette(self.frame, estimator.texels, mask, options.palette)
        self._texels = estimator.texels
        self._detail = target.detail
        self._features = proportions(self.frame) if options.disguise else np.eye(POINTS)
        self._pull = options.outline * outline_pull(self.frame)
        self._beyond = outward(self.frame, options.jaw, options.forehead)
        self._compositors: dict[bool, Compositor] = {}
        self._grid = np.zeros(self.frame.size, np.uint32)
        self._zeros = np.zeros((3, 0), np.float32)

    def paint(self, frame: Frame, head: F64, appearance: F32, texels: F32 | None) -> F64:
        """Blend an appearance (162 + 3 n,) over the head (81, 2) in the frame; returns the mesh (81, 2).

        texels (t, 3): the frame's RGB under the estimator's places; None keeps the last palette.
        """
        shape = appearance[:SHAPE].reshape(POINTS, 2).astype(np.float64) / self.frame.shape_weight
        mesh, zoom = self.place(shape, head)
        texture = appearance[SHAPE:].reshape(-1, 3)
        if texels is not None:
            self._palette.update(texture[self._texels], texels)
        self.blend(frame, mesh, texture, zoom)
        return mesh

    def place(self, shape: F64, head: F64) -> tuple[F64, float]:
        """The face's shape (81, 2) on the grid, carried to the head by its rigid landmarks; and the zoom."""
        a, b, tx, ty = align_planar(shape, head, RIGID_WEIGHTS)
        turn = np.array([[a, b], [-b, a]])
        mesh = self._features @ (shape @ turn + (tx, ty))
        return mesh + self._pull @ (head - mesh) + self._beyond @ turn, math.hypot(a, b)

    def blend(self, frame: Frame, mesh: F64, texture: F32, zoom: float) -> None:
        """Draw a texture (n, 3) RGB, in the current palette, on the mesh."""
        x0, y0, w, h = frame.align_roi(*(mesh.min(0) - 1), *(mesh.max(0) + 2))
        if w < 2 or h < 2:
            return
        fine = zoom > FINE
        picture = self._stored(texture, frame.colour, zoom, fine)
        roi = frame.read_roi(x0, y0, w, h)
        self._compositor(fine).composite(roi, picture, mesh - (x0, y0), out=roi)
        frame.write_roi(x0, y0, roi)

    def forget(self) -> None:
        """Start the palette anew with the next face."""
        self._palette.forget()

    def close(self) -> None:
        """Release the compositors."""
        for compositor in self._compositors.values():
            compositor.close()
        self._compositors.clear()

    @property
    def renderer(self) -> str:
        """Who draws, for a person to read."""
        return self._compositor(False).description

    def _stored(self, texture: F32, colour: ColourMatrix, zoom: float, fine: bool) -> NDArray[np.uint8]:
        """The texture as a picture in the frame's stored components, uint8, with detail if it will show."""
        planes = self._palette.apply(texture, colour.from_rgb[:, :3], colour.from_rgb[:, 3])
        picture = self._scattered(planes)
        if zoom < 0.7:
            return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.45 / zoom), np.uint8)
        if not fine:
            return picture
        h, w = self.frame.size
        picture = np.asarray(cv2.resize(picture, (2 * w, 2 * h), interpolation=cv2.INTER_LINEAR), np.uint8)
        contrast = self._palette.contrast * float(colour.from_rgb[0, :3].sum())
        luma = cv2.extractChannel(picture, 0)
        cv2.addWeighted(luma, 1.0, self._detail, contrast, 0.0, dst=luma, dtype=cv2.CV_8U)
        return np.asarray(cv2.insertChannel(luma, picture, 0), np.uint8)

    def _scattered(self, planes: F32) -> NDArray[np.uint8]:
        """Planes (3, n) rounded to bytes, as a picture (h, w, 3); whole words, as that is the quickest way."""
        if self._zeros.shape != planes.shape:
            self._zeros = np.zeros_like(planes)
        bytes_ = cv2.add(planes, self._zeros, dtype=cv2.CV_8U)  # rounds and saturates
        words = cv2.merge([*bytes_, bytes_[0]]).view(np.uint32).ravel()
        self._grid[self.frame.mask] = words
        return np.asarray(
            cv2.cvtColor(self._grid.view(np.uint8).reshape(*self.frame.size, 4), cv2.COLOR_BGRA2BGR)
        )

    def _compositor(self, fine: bool) -> Compositor:
        if fine not in self._compositors:
            factor = 2 if fine else 1
            uv = (self.frame.points + 0.5) * factor - 0.5
            h, w = self.frame.size
            alpha = cv2.resize(self._alpha, (factor * w, factor * h), interpolation=cv2.INTER_LINEAR)
            self._compositors[fine] = make_compositor(
                self.options.renderer,
                self.frame.triangles,
                uv.astype(np.float32),
                np.asarray(alpha, np.float32),
            )
        return self._compositors[fine]


def shown_mask(source: NDArray[np.bool_], frame: ReferenceFrame) -> NDArray[np.bool_]:
    """Where a face is shown on the source's head (h, w): all of it, but not over hair at the forehead and at the rim.

    Farther inside, below the brows, the source's mask does not count: what it leaves out there (stubble, shadow, a lock
    of hair) would show the source's own face.  The target needs no mask: its neutral face is bare skin where hair was.
    """
    inside = cv2.distanceTransform(np.pad(frame.mask, 1).astype(np.uint8), cv2.DIST_L2, 3)[1:-1, 1:-1]
    below = np.arange(frame.size[0])[:, None] >= frame.points[[19, 24], 1].mean()
    return np.asarray(frame.mask & (source | (below & (inside > RIM * frame.resolution))))


def outward(frame: ReferenceFrame, jaw: float, forehead: float) -> F64:
    """(81, 2) grid pixels: the ways out of the face for the points of its outline; 0 for the others.

    jaw, forehead : face widths; the latter from none at the temples to all in the middle.
    """
    away = frame.points[OUTLINE] - frame.points[27:36].mean(0)
    height = np.sqrt(np.sin(np.linspace(0, np.pi, POINTS - 68)).clip(0))
    reach = frame.resolution * np.concatenate([np.full(17, jaw), forehead * height])
    ways = np.zeros((POINTS, 2))
    ways[OUTLINE] = reach[:, None] * away / np.linalg.norm(away, axis=1, keepdims=True)
    return ways


def outline_pull(frame: ReferenceFrame) -> F64:
    """(81, 81) weights by which each point follows the outline of the head in the picture.

    Jaw and forehead follow in full, so that the face is as wide as the head and no second chin shows; inner points
    follow the outline near them, less the farther they are, so that no brow reaches past a turned head.
    """
    near = np.exp(-((_to_outline(frame) * 1.5) ** 2))
    pull = np.zeros((POINTS, POINTS))
    pull[:, OUTLINE] = _bound(frame) * near / near.sum(1, keepdims=True)
    pull[OUTLINE] = np.eye(POINTS)[OUTLINE]
    return pull


def proportions(frame: ReferenceFrame) -> F64:
    """(81, 81) weights that take a face's points to those of a face with other proportions and the same outline.

    Eyes and brows lie farther apart, the brows higher, and the mouth is larger.  Every move is a share of a way along
    the face itself, so that place, size and turn in the picture do not matter and the far side of a turned head moves
    as little as it is wide.
    """
    points = np.eye(POINTS)
    moves = np.zeros_like(points)
    for side, temple in ((np.r_[17:22, 36:42], 0), (np.r_[22:27, 42:48], 16)):
        moves[side] = APART * (points[temple] - points[27])
    moves[17:27] += RAISED * (points[74] - points[27])
    moves[48:68] = WIDER * (points[48:68] - points[48:68].mean(0))
    return np.asarray(points + (1 - _bound(frame)) * moves)


def _bound(frame: ReferenceFrame) -> F64:
    """(81, 1) share in [0, 1] by which each point is bound to the outline: 1 on it, less the farther it is."""
    return np.asarray(np.exp(-(_to_outline(frame).min(1) ** 2))[:, None])


def _to_outline(frame: ReferenceFrame) -> F64:
    """(81, 30) distances of the points from those of the outline, in REACH."""
    away = np.linalg.norm(frame.points[:, None] - frame.points[OUTLINE], axis=2)
    return np.asarray(away / (REACH * frame.resolution))
