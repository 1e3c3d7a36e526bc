"""Painting a face onto the head in a frame: pose, palette, warp and blend.

Pixels, x right, y down; RGB 0..255 unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.appearance import SHAPE_ENTRIES
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE, RIGID_WEIGHTS
from guise.aam.mask import beyond_mask
from guise.aam.model import Identity
from guise.aam.parameters import ParameterEstimator
from guise.aam.parsing import Parsing
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame, remap_points
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.similarity import align_planar
from guise.app.media import ColourMatrix, Frame
from guise.app.swapping.apertures import Aperture, DrawnLid, eye_openings
from guise.app.swapping.brow_cover import cover_brows
from guise.app.swapping.brow_strips import BrowStrips
from guise.app.swapping.disguise import Disguise
from guise.app.swapping.finish import Finish
from guise.app.swapping.folds import Fold, Folds
from guise.app.swapping.forehead import strands
from guise.app.swapping.iris import IrisChange
from guise.app.swapping.learned_light import LearnedLight
from guise.app.swapping.local_light import LocalLight
from guise.app.swapping.occlusion import Occlusion
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.outline import warp_outline
from guise.app.swapping.own_skin import OwnSkin
from guise.app.swapping.palette import Palette
from guise.app.swapping.place import convex, outline_pull, outward, proportions, shown_mask
from guise.app.swapping.silhouette import Silhouette, View, front_last
from guise.app.swapping.similarity_palette import SimilarityPalette
from guise.common.arrays import F32, F64, U8, Bool, Int
from guise.render import Compositor, feather, make_compositor

FEATHER_FACE_WIDTHS = 0.02  # standard deviation of the soft border
NARROW_FEATHER_FACE_WIDTHS = 0.01  # in a disguise and with the light "paper": less of the own rim shows


@dataclass(frozen=True)
class ZoomLimits:
    """Picture pixels per grid pixel at which the texture is treated otherwise."""

    min_detail_zoom: float = 1.15  # above which detail is added
    max_blur_zoom: float = 0.7  # below which the texture is blurred against aliasing
    blur_grid_pixels: float = 0.45  # standard deviation, at a zoom of 1


ZOOM = ZoomLimits()


class Painter:
    """Aligns a synthesised appearance with the head in a frame and blends it in.

    Parameters
    ----------
    source, target : Identity of the head and of the face.
    estimator : of the source; its texels serve the palette.
    options : EngineOptions.
    occlusion : of the source's face, which stays in front of the drawn one.
    """

    def __init__(
        self,
        source: Identity,
        target: Identity,
        estimator: ParameterEstimator,
        options: EngineOptions,
        occlusion: Occlusion | None = None,
    ) -> None:
        self.options, self.reference = options, target.reference
        mask = self.reference.mask if options.disguise else shown_mask(source.appearance.mask, self.reference)
        narrow = options.disguise or options.light == "paper"
        width = NARROW_FEATHER_FACE_WIDTHS if narrow else FEATHER_FACE_WIDTHS
        textures = source.appearance.neutral_texture, target.appearance.neutral_texture
        self._palette = make_palette(self.reference, estimator.texels, mask, textures, options)
        self._occlusion = occlusion
        self.relief = (Relief.shipped if options.transfer == "full" else Relief.flat)(self.reference)
        self._silhouette = Silhouette(self.relief, _places(self.reference, estimator.texels))
        self._texels = estimator.texels
        self._detail = target.detail
        # Cubic makes up for what the bilinear warp blurs; "paper" stays as it is in the paper.
        self._enlarging = cv2.INTER_LINEAR if options.light == "paper" else cv2.INTER_CUBIC
        self._finish = None if options.light == "paper" else Finish(self.reference, mask)
        self._own_skin = None if options.disguise else OwnSkin(self.relief)
        self._folds = Folds(self.relief)
        self._features = proportions(self.reference) if options.disguise else np.eye(POINTS)
        self._pull = outline_pull(self.reference)
        self._beyond = outward(self.reference, options.jaw, options.forehead)
        self._disguise = Disguise(source, target, options.forehead) if options.disguise else None
        if self._disguise is not None:
            self._detail = self._disguise.forehead.detailed(self._detail)
        self._back = np.linalg.norm(self._beyond, axis=1, keepdims=True) / self.reference.resolution
        sigma, at_rest = width * self.reference.resolution, target.appearance.neutral_shape
        self._alpha = self._feathered(at_rest, sigma) if options.disguise else feather(mask, sigma)
        self._compositors: dict[bool, Compositor] = {}
        self._source_at_rest = source.appearance.neutral_shape
        self._irises = IrisChange.of(source, target) if options.eyes_of_source else None
        self._kept: dict[bool, list[Aperture]] = {}
        self._drawn_lids: dict[bool, list[DrawnLid]] = {}
        self._parsed: tuple[Parsing, F64] | None = None  # the last one, and the head (81, 2) in it
        self._brow_strips = [BrowStrips(self.reference, factor) for factor in (1, 2)]
        self._shown: dict[bool, tuple[F32 | None, F32 | None]] = {}  # what each compositor's alpha holds
        self._grid = np.zeros(self.reference.size, np.uint32)
        self._beside, self._nearest = beyond_mask(self.reference.mask)
        self._zeros = np.zeros((3, 0), np.float32)

    def paint(
        self, frame: Frame, head: F64, appearance: F32, texels: F32 | None, view: View | None = None
    ) -> F64:
        """Blend an appearance (162 + 3 n,) over the head (81, 2) in the frame; returns the mesh (81, 2).

        texels (t, 3): the frame's RGB at the estimator's texels; None keeps the last palette.
        view : how the drawn face is seen; None is as from the front.
        """
        shape = appearance[:SHAPE_ENTRIES].reshape(POINTS, 2).astype(np.float64) / self.reference.shape_weight
        mesh, zoom = self.place(shape, head, view)
        across = STRAIGHT if view is None else view.across
        texture = appearance[SHAPE_ENTRIES:].reshape(-1, 3)
        self._look(head)
        if self._disguise is not None:
            self._disguise.paint(texture, mesh)
        if texels is not None:
            visible = None if self._occlusion is None else self._occlusion.visible
            hidden = None if view is None else self._silhouette.visible(view.cosines)
            self._palette.update(texture[self._texels], texels, _product(visible, hidden))
        uncovered = None if self._occlusion is None else self._occlusion.uncovered(mesh, across)
        if self.options.follows_outline:
            warp_outline(frame, head, mesh, zoom * self.reference.resolution)
        if view is not None and not self.options.disguise:  # it covers what is seen at a grazing angle, too
            uncovered = _product(uncovered, self._silhouette.share(view.cosines))
        brows = None
        if view is not None and view.at_rest is not None:
            brows = self._features @ shape, self._features @ view.at_rest
        self.blend(frame, mesh, texture, zoom, uncovered, self._finish, head, across, brows)
        return mesh

    def sampler(self, texels: Int) -> MeshSampler:
        """Of texels on the relief's mesh."""
        return MeshSampler.build(self.relief.mesh, _places(self.reference, texels))

    def place(self, shape: F64, head: F64, view: View | None = None) -> tuple[F64, float]:
        """The face's shape (81, 2) on the grid, in the picture, on the head there (81, 2); and the zoom.

        What a disguise adds at the outline recedes as a skull does, by as much as it grows, and ends where background
        is behind it.
        """
        full = self.options.transfer == "full"
        fit = align_planar(self.reference.align(head) if full else shape, head, RIGID_WEIGHTS)
        mesh = self._features @ fit.apply(shape)
        if not full:
            mesh = mesh + self._pull @ (head - mesh)
        beyond = self._beyond @ fit.linear
        if view is not None:
            beyond += self._back * view.across
            beyond *= self._silhouette.points(view.cosines)[:POINTS, None]
        return mesh + beyond, fit.scale

    def blend(
        self, frame: Frame, mesh: F64, texture: F32, zoom: float, uncovered: F32 | None = None,
        finish: Finish | None = None, head: F64 | None = None, across: F64 = STRAIGHT,
        brows: tuple[F64, F64] | None = None,
    ) -> None:  # fmt: skip
        """Draw a texture (n, 3) RGB, in the current palette, on the mesh.

        uncovered : (h, w) share in [0, 1] of the face that is drawn, on the reference grid; None is all of it.
        finish : measures the frame's sharpness and grain and gives them to the texture; None changes nothing.
        across : see `View`.
        head : (81, 2) pixels of the source, whose own eyes or mouth are kept if the options say so.
        brows : the face as drawn and at rest, see `BrowStrips`.
        """
        drawn_mesh = self.relief.seen(mesh, across)
        if self.options.disguise:
            drawn_mesh = convex(drawn_mesh)
        x0, y0, w, h = frame.align_roi(*(drawn_mesh.min(0) - 1), *(drawn_mesh.max(0) + 2))
        if w < 2 or h < 2:
            return
        roi, fine = frame.read_roi(x0, y0, w, h), zoom > ZOOM.min_detail_zoom
        rims = (
            None if head is None or self._occlusion is None else self._occlusion.rims(mesh, across, 1 + fine)
        )
        self._set_occlusion(fine, uncovered, rims)
        fold = self._folds.at(drawn_mesh, zoom) if across.any() else None
        for left in reversed(range(1 if finish is None else finish.draws)):
            drawn = roi.copy() if left else roi
            picture = self._stored(texture, frame.colour, zoom, fine, fold)
            if brows is not None:
                self._brow_strips[fine].keep(picture, *brows)
            if finish is not None:
                finish.before(drawn, picture, frame.index)
                if self._own_skin is not None and finish.sharpness.own_share > 0:
                    self._own_skin.add(
                        picture, drawn, drawn_mesh - (x0, y0), zoom, finish.sharpness.own_share
                    )
            if head is not None:
                own, openings = head - (x0, y0), eye_openings(head)
                parsing = self._parsed_at(head, x0, y0)
                for aperture in self._apertures(fine):
                    aperture.fill(picture, drawn, own, frame.colour, openings, parsing)
                for lid in self._lids(fine):
                    lid.fill(picture, openings)
                if parsing is not None:
                    cover_brows(drawn, own, mesh - (x0, y0), parsing, zoom * self.reference.resolution)
            self._compositor(fine).composite(drawn, picture, drawn_mesh - (x0, y0), out=drawn)
            if fold is not None:
                fold.soften_edges(drawn, (x0, y0))
            if finish is not None:
                finish.after(drawn, mesh - (x0, y0))
        frame.write_roi(x0, y0, roi)

    def _look(self, head: F64) -> None:
        """See where the head (81, 2) looks, if the frame was parsed."""
        parsing = None if self._occlusion is None else self._occlusion.parsing
        if parsing is None:
            return
        self._parsed, irises = (parsing, head), parsing.irises[:, :2]
        if self._irises is not None:
            self._irises.gaze.see(irises, head, self._irises.at_rest)
        if self._disguise is not None:
            self._disguise.look(irises, head)

    def _parsed_at(self, head: F64, x: float, y: float) -> Parsing | None:
        """The last parsing moved along with the head (81, 2), in pixels of a part of the frame that begins at x, y."""
        if self._parsed is None:
            return None
        parsing, then = self._parsed
        return parsing.from_place(*((x, y) - (head - then).mean(0)))

    def _feathered(self, shape: F64, sigma: float) -> F32:
        """(h, w) alpha with a border as soft as `sigma` grid pixels on the shape (81, 2) as it is drawn.

        A disguise stretches the grid's border, most at the temples: a border of the grid would show much hair there.
        """
        mesh = self.relief.seen(self._features @ shape + self._beyond, STRAIGHT)
        mesh = mesh - np.floor(mesh.min(0))
        drawn = np.zeros(np.ceil(mesh.max(0)[::-1]).astype(int) + 1, np.uint8)
        for triangle in np.round(16 * mesh).astype(np.int32)[self.relief.triangles]:
            cv2.fillConvexPoly(drawn, triangle, 1, shift=4)
        alpha = feather(drawn > 0, sigma)
        alpha *= strands(mesh[:POINTS], drawn > 0, self._beyond, self.reference.resolution)
        places = self.sampler(np.arange(len(self.reference.pixels))).positions(mesh)
        return self.reference.scatter(remap_points(alpha, places))

    def reset(self) -> None:
        """Fit palette and occlusion afresh to the next face."""
        self._parsed = None
        self._palette.reset()
        if self._irises is not None:
            self._irises.gaze.reset()
        if self._disguise is not None:
            self._disguise.reset()
        if self._finish is not None:
            self._finish.reset()
        if self._occlusion is not None:
            self._occlusion.reset()

    def close(self) -> None:
        """Release the compositors."""
        for compositor in self._compositors.values():
            compositor.close()
        self._compositors.clear()

    @property
    def renderer(self) -> str:
        """What draws the face, for the user."""
        return self._compositor(False).description

    def _stored(self, texture: F32, colour: ColourMatrix, zoom: float, fine: bool, fold: Fold | None) -> U8:
        """The texture as a picture in the frame's stored components, uint8, with detail if it will show."""
        planes = self._palette.apply(texture, colour.from_rgb[:, :3], colour.from_rgb[:, 3])
        picture = self._scattered(planes)
        contrast = self._palette.contrast * float(colour.from_rgb[0, :3].sum())
        if self._disguise is not None:
            picture = self._disguise.continued(picture, contrast, float(colour.from_rgb[0, 3]))
        if self._finish is not None:
            picture = self._finish.sharpness.apply(picture)
        if fold is not None:
            fold.smooth(picture)
        if zoom < ZOOM.max_blur_zoom:
            return np.asarray(cv2.GaussianBlur(picture, (0, 0), ZOOM.blur_grid_pixels / zoom), np.uint8)
        if not fine:
            return picture
        h, w = self.reference.size
        picture = np.asarray(cv2.resize(picture, (2 * w, 2 * h), interpolation=self._enlarging), np.uint8)
        if self._finish is not None:
            contrast *= self._finish.sharpness.gain
        luma = cv2.extractChannel(picture, 0)
        detail = self._detail if fold is None else fold.without(self._detail)
        cv2.addWeighted(luma, 1.0, detail, contrast, 0.0, dst=luma, dtype=cv2.CV_8U)
        return np.asarray(cv2.insertChannel(luma, picture, 0), np.uint8)

    def _scattered(self, planes: F32) -> U8:
        """Planes (3, n) rounded to bytes, as a picture (h, w, 3); by whole words, which is fastest."""
        if self._zeros.shape != planes.shape:
            self._zeros = np.zeros_like(planes)
        bytes_ = cv2.add(planes, self._zeros, dtype=cv2.CV_8U)  # rounds and saturates
        words = cv2.merge([*bytes_, bytes_[0]]).view(np.uint32).ravel()
        self._grid[self.reference.mask] = words
        grid = self._grid.ravel()
        grid[self._beside] = grid[self._nearest]
        return np.asarray(
            cv2.cvtColor(self._grid.view(np.uint8).reshape(*self.reference.size, 4), cv2.COLOR_BGRA2BGR)
        )

    def _compositor(self, fine: bool) -> Compositor:
        if fine not in self._compositors:
            factor = 2 if fine else 1
            uv = (self.relief.points + 0.5) * factor - 0.5
            self._compositors[fine] = make_compositor(
                self.options.renderer,
                front_last(self.relief),
                uv.astype(np.float32),
                self._enlarged(self._alpha, fine),
            )
        return self._compositors[fine]

    def _apertures(self, fine: bool) -> list[Aperture]:
        """Where the source's own eyes and mouth show."""
        if fine not in self._kept:
            factor, at_rest = 2 if fine else 1, self._source_at_rest
            always, shut = (
                [
                    Aperture(self.reference, p, factor, shape, None if p is INNER_LIPS else self._irises)
                    for p in parts
                ]
                for parts, shape in ((self.options.source_parts, None), (self.options.shut_parts, at_rest))
            )
            self._kept[fine] = always + shut
        return self._kept[fine]

    def _lids(self, fine: bool) -> list[DrawnLid]:
        """The lids of a disguise."""
        if fine not in self._drawn_lids:
            eyes = (RIGHT_EYE, LEFT_EYE) if self.options.disguise else ()
            self._drawn_lids[fine] = [
                DrawnLid(self.reference, eye, 2 if fine else 1, self._source_at_rest) for eye in eyes
            ]
        return self._drawn_lids[fine]

    def _set_occlusion(self, fine: bool, uncovered: F32 | None, rims: F32 | None) -> None:
        """Draw only what nothing hides; the alpha is touched only when that changes.

        rims : (h, w) share at the size of the texture that is hidden besides.
        """
        now, before = (uncovered, rims), self._shown.get(fine, (None, None))
        if all(one is other for one, other in zip(now, before, strict=True)):
            return
        alpha = self._enlarged(self._alpha if uncovered is None else self._alpha * uncovered, fine)
        self._compositor(fine).set_alpha(alpha if rims is None else alpha * (1 - rims))
        self._shown[fine] = now

    def _enlarged(self, alpha: F32, fine: bool) -> F32:
        """An alpha (h, w) at the size of the texture."""
        if not fine:
            return alpha
        h, w = self.reference.size
        return np.asarray(cv2.resize(alpha, (2 * w, 2 * h), interpolation=cv2.INTER_LINEAR), np.float32)


def _places(reference: ReferenceFrame, texels: Int) -> F64:
    """(t, 2) grid pixels of texels, indices into the mask's pixels."""
    ys, xs = np.divmod(reference.pixels[texels], reference.size[1])
    return np.column_stack([xs, ys]).astype(np.float64)


def _product(one: F32 | None, other: F32 | None) -> F32 | None:
    """The product of two shares, of which None is all."""
    if one is None or other is None:
        return other if one is None else one
    return np.asarray(one * other, np.float32)


def make_palette(
    reference: ReferenceFrame, texels: Int, mask: Bool, textures: tuple[F32, F32], options: EngineOptions
) -> Palette:
    """The palette that the options name, for the neutral RGB (n, 3) of the head and of the face."""
    if options.light == "learned":
        return LearnedLight(reference, texels, mask, textures)
    if options.light == "classical":
        return LocalLight(reference, texels, mask, textures, disguise=options.disguise)
    return SimilarityPalette(reference, texels, mask, options.palette)
