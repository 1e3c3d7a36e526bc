"""Pictures of heads: strips from several sides, distances in colours, chessboards, turntables.

Each column of a strip is a head, each row a view.  Lengths are in the unit of the meshes.  Pictures are RGB uint8
(h, w, 3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike

from guise.analogy.correspondence import Correspondence
from guise.analogy.feature_points import FEATURE_POINT_NAMES
from guise.analogy.mesh import Mesh
from guise.analogy.rigid import rotation_angle
from guise.analogy.tents import vertex_error
from guise.app.media import Frame, MediaInput, open_sink
from guise.common.arrays import F64, U8, Int
from guise.render.shaded import Camera, Paint, exposure, shaded

Picture = U8
Progress = Callable[[float], None]


Colour = tuple[int, int, int]
Shares = tuple[float, float, float]


@dataclass(frozen=True)
class PictureStyle:
    """Sizes and colours of the pictures."""

    yaws_deg: tuple[float, ...] = (0.0, 40.0)  # rows of a strip
    head_px: tuple[int, int] = (360, 440)  # width and height of a head
    title_px: int = 40  # above
    scale_px: int = 64  # below
    background: Colour = (27, 29, 32)
    text: Colour = (236, 236, 232)
    faint_text: Colour = (150, 153, 158)
    turn_frames: int = 72  # of a full turn
    turn_fps: int = 24
    light_square: Shares = (0.90, 0.87, 0.82)  # of a chessboard
    dark_square: Shares = (0.13, 0.36, 0.48)
    unmatched_square: Shares = (0.45, 0.45, 0.45)
    squares_per_head: int = 16  # over its height
    dot: Colour = (236, 92, 52)  # of a marked point
    dot_radius_heights: float = 0.009  # of the picture's height
    max_tilt_deg: float = 15.0  # of a head that is drawn as it stands; others are put upright


STYLE = PictureStyle()


# From 0 to the maximum: ever darker, so that it also reads in grey; 0 has the colour of clay.
HEAT = ("#ddd6cd", "#f3d27c", "#f1913f", "#d8434a", "#8a2369", "#2f1650")

# Of the error E (Song et al. 2007, fig. 11: green, blue, red up to 2 %): below what, and a colour; the last is beyond.
BANDS = ((1e-3, "#3f9a4e"), (5e-3, "#3b6fc4"), (2e-2, "#d8434a"), (np.inf, "#2f1650"))


@dataclass(frozen=True, eq=False)
class HeadView:
    """Orientation and camera of a head, the same for all its expressions.

    rest : (N, 3) at rest.   turned : (3, 3) from mesh axes to right, up, forward.   camera : in those axes.
    """

    rest: F64
    turned: F64
    camera: Camera
    _light: list[F64] = field(default_factory=list)

    @classmethod
    def of(cls, neutral: F64, points: F64 | None = None) -> HeadView:
        """The view of a head at rest (N, 3); with its feature points (20, 3) an upright portrait, whatever the axes."""
        if points is None:
            return cls(neutral, np.eye(3), Camera.around(neutral))
        axes = _face_axes(points)
        angle = rotation_angle(axes)
        turned = axes if angle > STYLE.max_tilt_deg else np.eye(3)
        return cls(neutral, turned, _portrait_camera(neutral @ turned.T, points @ turned.T))

    def draw(self, head: DrawnHead, yaw: float) -> Picture:
        """The head seen from a yaw angle, degrees."""
        camera = replace(self.camera, yaw=yaw)
        vertices = head.vertices @ self.turned.T
        if (
            not self._light
        ):  # at rest, so that mouths are dark inside; all heads of a view have the same faces
            self._light.append(exposure(self.rest, head.faces))
        picture = shaded(
            vertices,
            head.faces,
            STYLE.head_px,
            colours=head.values,
            paint=head.paint,
            light=self._light[0],
            camera=camera,
        )
        if head.dots is not None:
            self._mark(picture, head.dots, camera)
        return picture

    def _mark(self, picture: Picture, dots: F64, camera: Camera) -> None:
        for x, y, depth in camera.project(dots @ self.turned.T, STYLE.head_px):
            if depth < 0:  # on the half towards the viewer
                at = round(16 * x), round(16 * y)  # in sixteenths
                for share, colour in ((1.0, STYLE.text), (0.75, STYLE.dot)):
                    radius = round(16 * share * STYLE.dot_radius_heights * STYLE.head_px[1])
                    cv2.circle(picture, at, radius, colour, -1, cv2.LINE_AA, 4)


@dataclass(frozen=True, eq=False)
class DrawnHead:
    """A head to draw.

    vertices : (N, 3).   faces : (m, 3).   title : above it.   view : shared by all expressions of one head.
    values, paint : colours, as for `guise.render.shaded`.   dots : (k, 3) points to mark.
    """

    vertices: F64
    faces: Int
    title: str
    view: HeadView
    values: F64 | None = None
    paint: Paint | None = None
    dots: F64 | None = None


def draw_strip(heads: Sequence[DrawnHead], yaws: Sequence[float] = STYLE.yaws_deg) -> Picture:
    """The heads side by side, one row per view, below their titles."""
    rows = [np.concatenate([h.view.draw(h, yaw) for h in heads], axis=1) for yaw in yaws]
    titles = np.concatenate([_draw_title(h.title) for h in heads], axis=1)
    return np.concatenate([titles, *rows])


def draw_transfer(
    source: Mesh, expressive: F64, target: Mesh, result: F64, points: tuple[F64, F64] | None = None
) -> Picture:
    """Inputs and result of a transfer: source at rest and with its expression, target, result.

    expressive (N_s, 3), result (N_t, 3).   points : (20, 3) feature points of source and target, for portraits.
    """
    first, second = points or (None, None)
    left, right = HeadView.of(source.vertices, first), HeadView.of(target.vertices, second)
    return draw_strip(
        [
            DrawnHead(source.vertices, source.faces, "source", left),
            DrawnHead(expressive, source.faces, "source, expression", left),
            DrawnHead(target.vertices, target.faces, "target", right),
            DrawnHead(result, target.faces, "target, expression", right),
        ]
    )


def draw_distances(
    before: Mesh, after: F64, titles: tuple[str, str] = ("before", "after"), *, unit: str = "units",
    points: F64 | None = None,
) -> Picture:  # fmt: skip
    """Two heads with the same vertices and the distances between these in colours, with a scale.

    after (N, 3).   unit : name of the unit of length.   points : (20, 3) feature points, for a portrait.
    """
    picture = draw_strip(distance_heads(before, after, titles, points))
    distance = np.linalg.norm(after - before.vertices, axis=1)
    return np.concatenate([picture, scale_bar(distance, unit, picture.shape[1])])


def distance_heads(before: Mesh, after: F64, titles: tuple[str, str], points: F64 | None) -> list[DrawnHead]:
    """A head before and after, and in the colours of the distances between the vertices."""
    view = HeadView.of(before.vertices, points)
    warm = DrawnHead(after, before.faces, "how far apart", view)
    return [
        DrawnHead(before.vertices, before.faces, titles[0], view),
        DrawnHead(after, before.faces, titles[1], view),
        coloured_by(warm, np.linalg.norm(after - before.vertices, axis=1)),
    ]


def draw_bands(neutral: Mesh, truth: F64, made: F64, points: F64 | None) -> Picture:
    """True and made vertices (N, 3) of a head, and in three bands the error E of Song's appendix, with their shares.

    points : (20, 3) feature points, for a portrait.
    """
    view, error = HeadView.of(neutral.vertices, points), vertex_error(neutral.vertices, truth, made)
    heads = [
        DrawnHead(at, neutral.faces, title, view)
        for at, title in zip((truth, made, made), ("truth", "result", "error E"), strict=True)
    ]
    known = np.column_stack([np.nan_to_num(error), np.isfinite(error)])
    heads[2] = replace(heads[2], values=known, paint=_band_colours)
    picture = draw_strip(heads)
    return np.concatenate([picture, _band_key(error, picture.shape[1])])


def _band_colours(known: F64) -> F64:
    """Colours (p, 3) sRGB in 0..1 of errors, and of whether the head moves there (p, 2)."""
    colours = np.stack([_shares(name) for _, name in BANDS])
    found = colours[np.searchsorted([most for most, _ in BANDS[:-1]], known[:, 0], "right")]
    return np.where(known[:, 1:] > 0.5, found, _shares(HEAT[0]))


def _band_key(error: F64, width: int) -> Picture:
    """What the colours mean, and the share of the moving vertices (N,) in each band."""
    out = np.full((STYLE.scale_px, width, 3), STYLE.background, np.uint8)
    moving = error[np.isfinite(error)]
    lows = [0.0, *(most for most, _ in BANDS[:-1])]
    for number, (low, (high, name)) in enumerate(zip(lows, BANDS, strict=True)):
        inside = float(((moving >= low) & (moving < high)).mean()) if len(moving) else 0.0
        words = f"from {100 * low:g} %" if number == len(BANDS) - 1 else f"below {100 * high:g} %"
        left = 24 + number * (width - 48) // len(BANDS)
        out[24:40, left : left + 16] = np.rint(255 * _shares(name))
        _draw_text(out, f"{words}: {100 * inside:.1f} %", left + 26, 38, 15)
    return out


def _shares(name: str) -> F64:
    """(3,) sRGB in 0..1 of a colour such as #ddd6cd."""
    return np.array([int(name[k : k + 2], 16) / 255 for k in (1, 3, 5)])


def coloured_by(head: DrawnHead, values: F64) -> DrawnHead:
    """The head coloured by values (N,) >= 0, from 0 to `round_up` of the largest."""
    most = round_up(float(values.max(initial=0)))
    return replace(head, values=values[:, None], paint=lambda at: _heat_colours(at[:, 0] / most))


def draw_chessboard(
    source: Mesh, target: Mesh, correspondence: Correspondence, points: tuple[F64, F64] | None = None
) -> Picture:
    """A chessboard on the source and its image on the target: corresponding points have the same square.

    Parts of the target without counterpart are grey.   points : (20, 3) feature points of both, for portraits.
    """
    first, second = points or (None, None)
    left, right = HeadView.of(source.vertices, first), HeadView.of(target.vertices, second)
    own = source.vertices @ left.turned.T
    known = np.column_stack([correspondence.interpolate(own), correspondence.found])
    paint = _chessboard_paint(own)
    return draw_strip(
        [
            DrawnHead(source.vertices, source.faces, "source", left, np.column_stack([own, np.ones(len(own))]), paint),
            DrawnHead(target.vertices, target.faces, "target", right, known, paint),
        ]
    )  # fmt: skip


def draw_feature_points(mesh: Mesh, points: F64) -> Picture:
    """A head with its feature points (20, 3) marked, from three sides."""
    view = HeadView.of(mesh.vertices, points)
    sides = [
        draw_strip([DrawnHead(mesh.vertices, mesh.faces, "", view, dots=points)], [yaw])
        for yaw in (-40, 0, 40)
    ]
    return np.concatenate(sides, axis=1)[STYLE.title_px :]


def write_turntable(
    path: Path, heads: Sequence[DrawnHead], *, force: bool = False, progress: Progress | None = None
) -> None:
    """Write a video in which the heads turn once around, side by side, under their titles.

    progress : called with the completed share.   Raises MediaError when the video cannot be written.
    """
    film = _TurntableSource(heads)
    with open_sink(path, film, force=force) as sink:
        for frame in film:
            sink.write(frame)
            if progress is not None:
                progress((frame.index + 1) / STYLE.turn_frames)


class _TurntableSource(MediaInput):
    """Heads that turn once around."""

    kind = "video"

    def __init__(self, heads: Sequence[DrawnHead]) -> None:
        super().__init__(Path("heads"))
        self._heads = heads
        self.width, self.height = STYLE.head_px[0] * len(heads), STYLE.head_px[1] + STYLE.title_px
        self.frame_rate = Fraction(STYLE.turn_fps)
        self.time_base = Fraction(1, STYLE.turn_fps)
        self.frame_count, self.duration = STYLE.turn_frames, Fraction(STYLE.turn_frames, STYLE.turn_fps)

    def __iter__(self) -> Iterator[Frame]:
        for k in range(STYLE.turn_frames):
            yield Frame.from_rgb(draw_strip(self._heads, [360 * k / STYLE.turn_frames]), k, self.time_base, k)


def round_up(value: float) -> float:
    """The smallest of 1, 2, 2.5, 5 times a power of ten that is not below a value; 1 for 0.

    >>> round_up(0.31), round_up(2.0), round_up(0.0)
    (0.5, 2.0, 1.0)
    """
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(power * step for step in (1, 2, 2.5, 5, 10) if power * step >= value * (1 - 1e-9)))


def scale_bar(values: ArrayLike, unit: str, width: int) -> Picture:
    """The colour scale of `coloured_by` with numbers, and statistics of the values (N,) in words."""
    known = np.asarray(values, np.float64)
    most = round_up(float(known.max(initial=0)))
    out = np.full((STYLE.scale_px, width, 3), STYLE.background, np.uint8)
    long = min(width // 2, 360)
    ramp = np.rint(255 * _heat_colours(np.linspace(0, 1, long))).astype(np.uint8)
    left, top = 24, 12
    out[top : top + 14, left : left + long] = ramp
    for share in (0, 0.5, 1):
        end = f" {unit}" if share == 1 else ""
        _draw_text(
            out,
            f"{share * most:.4g}{end}",
            left + round(share * long),
            STYLE.scale_px - 14,
            14,
            middle=share > 0,
        )
    words = f"mean {known.mean():.3g}   95 % below {np.percentile(known, 95):.3g}   largest {known.max():.3g} {unit}"
    _draw_text(out, words, left + long + 96, top + 14, 15, STYLE.faint_text)
    return out


def _heat_colours(shares: F64) -> F64:
    """Colours (p, 3) sRGB in 0..1 for shares (p,) of the maximum."""
    stops = np.stack([_shares(name) for name in HEAT])
    at = np.clip(np.asarray(shares), 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(at, np.arange(len(stops)), stops[:, k]) for k in range(3)], axis=1)


def _chessboard_paint(vertices: F64) -> Paint:
    """Paint values (x, y, z, known) with a chessboard around the head (N, 3), seamless at its back."""
    low, high = vertices.min(0), vertices.max(0)
    middle, side = (low + high) / 2, (high[1] - low[1]) / STYLE.squares_per_head
    radius = float(np.ptp(vertices[vertices[:, 1] > middle[1], 0])) / 2
    middle[2] = min(middle[2], high[2] - radius)  # a mask ends before the middle of the head
    around = 2 * max(1, round(np.pi * radius / side))

    def paint(values: F64) -> F64:
        x, y, z = (values[:, :3] - middle).T
        turn = np.floor(np.arctan2(x, z) / (2 * np.pi) * around)
        even = (turn + np.floor(y / side)) % 2 == 0
        squares = np.where(even[:, None], STYLE.light_square, STYLE.dark_square)
        return np.where(values[:, 3:] > 0.5, squares, STYLE.unmatched_square)

    return paint


def _face_axes(points: F64) -> F64:
    """(3, 3) from mesh axes to the person's left (the viewer's right), up, and forward, of feature points (20, 3)."""

    def mean(*parts: str) -> F64:
        return np.asarray(
            np.mean(
                [points[k] for k, name in enumerate(FEATURE_POINT_NAMES) if name.startswith(parts)], axis=0
            )
        )

    across = mean("eye_left", "brow_left") - mean("eye_right", "brow_right")
    up = mean("eye_", "brow_") - mean("mouth_", "upper_lip", "lower_lip")
    across /= np.linalg.norm(across)
    forward = np.cross(across, up)
    forward /= np.linalg.norm(forward)
    return np.stack([across, np.cross(forward, across), forward])


def _portrait_camera(vertices: F64, points: F64) -> Camera:
    """A camera that frames head and throat around upright feature points, no larger than the mesh."""
    whole = Camera.around(vertices)
    tall = float(np.ptp(points[:, 1]))
    low, high = points[:, 1].min() - 0.55 * tall, vertices[:, 1].max()
    near = vertices[vertices[:, 1] > points[:, 1].min()]
    if low <= vertices[:, 1].min() or not len(near):
        return whole
    middle = (near.min(0) + near.max(0)) / 2
    across = float(np.hypot(*(near - middle)[:, [0, 2]].T).max())
    return Camera(np.array([middle[0], (low + high) / 2, middle[2]]), (across, (high - low) / 2))


def _draw_title(text: str) -> Picture:
    out = np.full((STYLE.title_px, STYLE.head_px[0], 3), STYLE.background, np.uint8)
    _draw_text(out, text, STYLE.head_px[0] // 2, 27, 17, middle=True)
    return out


def _draw_text(
    picture: Picture, text: str, x: int, y: int, height: int, colour: tuple[int, int, int] = STYLE.text, *,
    middle: bool = False,
) -> None:  # fmt: skip
    """Draw text of a height in pixels on the baseline y, starting at or centred on x."""
    face = cv2.FontFace("sans")
    wide = cv2.getTextSize((0, 0), text, (0, 0), face, height, 400)[2] if middle else 0
    cv2.putText(picture, text, (x - wide // 2, y), colour, face, height, 400)
