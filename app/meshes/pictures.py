"""Pictures of heads: strips from several sides, colours for how far vertices are apart, chessboards, turning heads.

A column of a strip is a head, a row a side that it is seen from.  Lengths in the unit of the meshes.  Pictures are RGB
uint8 (h, w, 3).
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
from guise.analogy.feature_points import NAMES
from guise.analogy.mesh import Mesh
from guise.app.media import Frame, MediaInput, open_sink
from guise.common.arrays import F64, U8, Int
from guise.render.shaded import Camera, Paint, exposure, shaded

Picture = U8
Progress = Callable[[float], None]

YAWS = (0.0, 40.0)  # degrees, rows of a strip
SIZE = (360, 440)  # pixels of a head
PAPER, INK, FAINT = (27, 29, 32), (236, 236, 232), (150, 153, 158)
TITLE, FOOT = 40, 64  # pixels above and below
TURN, RATE = 72, 24  # pictures of a full turn, and a second

# From nothing to much: ever darker, so that it reads in grey too, and nothing is the colour of clay.
HEAT = ("#ddd6cd", "#f3d27c", "#f1913f", "#d8434a", "#8a2369", "#2f1650")
LIGHT, DARK, UNKNOWN = (0.90, 0.87, 0.82), (0.13, 0.36, 0.48), (0.45, 0.45, 0.45)  # of a chessboard
DOT, DOT_SIZE = (236, 92, 52), 0.009  # of a marked place; its radius as a share of the picture's height
SQUARES = 16  # of a chessboard, over the height of a head
TILTED = 15.0  # degrees from which a head is put upright


@dataclass(frozen=True, eq=False)
class Stand:
    """How a head is put before the camera: turned, then looked at; one for all expressions of it.

    rest : (N, 3) at rest.   turned : (3, 3) from mesh axes to right, up, forward.   camera : in those axes.
    """

    rest: F64
    turned: F64
    camera: Camera
    _light: list[F64] = field(default_factory=list)

    @classmethod
    def of(cls, neutral: F64, points: F64 | None = None) -> Stand:
        """Of a head at rest (N, 3); with its feature points (20, 3) a portrait, upright however the file's axes are."""
        if points is None:
            return cls(neutral, np.eye(3), Camera.around(neutral))
        axes = _face_axes(points)
        angle = np.degrees(np.arccos(np.clip((np.trace(axes) - 1) / 2, -1, 1)))
        turned = axes if angle > TILTED else np.eye(3)
        return cls(neutral, turned, _portrait(neutral @ turned.T, points @ turned.T))

    def draw(self, head: Head, yaw: float) -> Picture:
        """The head seen from a side, degrees."""
        camera = replace(self.camera, yaw=yaw)
        vertices = head.vertices @ self.turned.T
        if (
            not self._light
        ):  # at rest, so that mouths are dark inside; all heads of a stand have the same faces
            self._light.append(exposure(self.rest, head.faces))
        picture = shaded(
            vertices,
            head.faces,
            SIZE,
            colours=head.values,
            paint=head.paint,
            light=self._light[0],
            camera=camera,
        )
        if head.dots is not None:
            self._mark(picture, head.dots, camera)
        return picture

    def _mark(self, picture: Picture, dots: F64, camera: Camera) -> None:
        for x, y, depth in camera.project(dots @ self.turned.T, SIZE):
            if depth < 0:  # on the half towards the viewer
                at = round(16 * x), round(16 * y)  # in sixteenths
                for share, colour in ((1.0, INK), (0.75, DOT)):
                    radius = round(16 * share * DOT_SIZE * SIZE[1])
                    cv2.circle(picture, at, radius, colour, -1, cv2.LINE_AA, 4)


@dataclass(frozen=True, eq=False)
class Head:
    """A head to be drawn.

    vertices : (N, 3).   faces : (m, 3).   title : above it.   stand : shared by all expressions of one head.
    values, paint : colours, as for `guise.render.shaded`.   dots : (k, 3) places that are marked.
    """

    vertices: F64
    faces: Int
    title: str
    stand: Stand
    values: F64 | None = None
    paint: Paint | None = None
    dots: F64 | None = None


def strip(heads: Sequence[Head], yaws: Sequence[float] = YAWS) -> Picture:
    """The heads side by side, one row for each side, under their titles."""
    rows = [np.concatenate([h.stand.draw(h, yaw) for h in heads], axis=1) for yaw in yaws]
    titles = np.concatenate([_title(h.title) for h in heads], axis=1)
    return np.concatenate([titles, *rows])


def carried_over(
    source: Mesh, expressive: F64, target: Mesh, result: F64, points: tuple[F64, F64] | None = None
) -> Picture:
    """What a transfer was given and what it made: source at rest and with its expression, target, result.

    expressive (N_s, 3), result (N_t, 3).   points : (20, 3) feature points of source and target, for portraits.
    """
    first, second = points or (None, None)
    left, right = Stand.of(source.vertices, first), Stand.of(target.vertices, second)
    return strip(
        [
            Head(source.vertices, source.faces, "source", left),
            Head(expressive, source.faces, "source, expression", left),
            Head(target.vertices, target.faces, "target", right),
            Head(result, target.faces, "target, expression", right),
        ]
    )


def apart(
    before: Mesh, after: F64, titles: tuple[str, str] = ("before", "after"), *, unit: str = "units",
    points: F64 | None = None,
) -> Picture:  # fmt: skip
    """Two of the same vertices, and in colours how far each vertex of one is from the other's; with a scale.

    after (N, 3).   unit : what a length of 1 is called.   points : (20, 3) feature points, for a portrait.
    """
    distance = np.linalg.norm(after - before.vertices, axis=1)
    stand = Stand.of(before.vertices, points)
    warm = heated(Head(after, before.faces, "how far apart", stand), distance)
    heads = [
        Head(before.vertices, before.faces, titles[0], stand),
        Head(after, before.faces, titles[1], stand),
    ]
    picture = strip([*heads, warm])
    return np.concatenate([picture, scale_bar(distance, unit, picture.shape[1])])


def heated(head: Head, values: F64) -> Head:
    """The head in the colours of values (N,) >= 0, from nothing to `nice` of the largest."""
    most = nice(float(values.max(initial=0)))
    return replace(head, values=values[:, None], paint=lambda at: _heat(at[:, 0] / most))


def chessboard(
    source: Mesh, target: Mesh, correspondence: Correspondence, points: tuple[F64, F64] | None = None
) -> Picture:
    """A chessboard around the source's head, and carried to the target: what corresponds has the same square.

    What of the target was not found is grey.   points : (20, 3) feature points of both, for portraits.
    """
    first, second = points or (None, None)
    left, right = Stand.of(source.vertices, first), Stand.of(target.vertices, second)
    own = source.vertices @ left.turned.T
    known = np.column_stack([correspondence.carry(own), correspondence.found])
    paint = _squares(own)
    return strip(
        [
            Head(source.vertices, source.faces, "source", left, np.column_stack([own, np.ones(len(own))]), paint),
            Head(target.vertices, target.faces, "target", right, known, paint),
        ]
    )  # fmt: skip


def landmarks(mesh: Mesh, points: F64) -> Picture:
    """A head with its feature points (20, 3) marked, from three sides."""
    stand = Stand.of(mesh.vertices, points)
    sides = [strip([Head(mesh.vertices, mesh.faces, "", stand, dots=points)], [yaw]) for yaw in (-40, 0, 40)]
    return np.concatenate(sides, axis=1)[TITLE:]


def turntable(
    path: Path, heads: Sequence[Head], *, force: bool = False, progress: Progress | None = None
) -> None:
    """Write a video in which the heads turn once around, side by side, under their titles.

    progress : called with the share that is done.   Raises MediaError when it cannot be written.
    """
    film = _Film(heads)
    with open_sink(path, film, force=force) as sink:
        for frame in film:
            sink.write(frame)
            if progress is not None:
                progress((frame.index + 1) / TURN)


class _Film(MediaInput):
    """Heads that turn once around."""

    kind = "video"

    def __init__(self, heads: Sequence[Head]) -> None:
        super().__init__(Path("heads"))
        self._heads = heads
        self.width, self.height = SIZE[0] * len(heads), SIZE[1] + TITLE
        self.frame_rate = Fraction(RATE)
        self.time_base = Fraction(1, RATE)
        self.frame_count, self.duration = TURN, Fraction(TURN, RATE)

    def __iter__(self) -> Iterator[Frame]:
        for k in range(TURN):
            yield Frame.from_rgb(strip(self._heads, [360 * k / TURN]), k, self.time_base, k)


def nice(value: float) -> float:
    """The least of 1, 2, 2.5, 5 times a power of ten that is not below a value; 1 for 0.

    >>> nice(0.31), nice(2.0), nice(0.0)
    (0.5, 2.0, 1.0)
    """
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(power * step for step in (1, 2, 2.5, 5, 10) if power * step >= value * (1 - 1e-9)))


def scale_bar(values: ArrayLike, unit: str, width: int) -> Picture:
    """The colours of `heated` from 0 to their end, with numbers, and in words how the values (N,) are spread."""
    known = np.asarray(values, np.float64)
    most = nice(float(known.max(initial=0)))
    out = np.full((FOOT, width, 3), PAPER, np.uint8)
    long = min(width // 2, 360)
    ramp = np.rint(255 * _heat(np.linspace(0, 1, long))).astype(np.uint8)
    left, top = 24, 12
    out[top : top + 14, left : left + long] = ramp
    for share in (0, 0.5, 1):
        end = f" {unit}" if share == 1 else ""
        _write(out, f"{share * most:.4g}{end}", left + round(share * long), FOOT - 14, 14, middle=share > 0)
    words = f"mean {known.mean():.3g}   95 % below {np.percentile(known, 95):.3g}   largest {known.max():.3g} {unit}"
    _write(out, words, left + long + 96, top + 14, 15, FAINT)
    return out


def _heat(shares: F64) -> F64:
    """Colours (p, 3) sRGB in 0..1 of shares (p,) of the most."""
    stops = np.array([[int(name[k : k + 2], 16) / 255 for k in (1, 3, 5)] for name in HEAT])
    at = np.clip(np.asarray(shares), 0, 1) * (len(stops) - 1)
    return np.stack([np.interp(at, np.arange(len(stops)), stops[:, k]) for k in range(3)], axis=1)


def _squares(vertices: F64) -> Paint:
    """Paints values (x, y, z, known) by a chessboard wound around the head (N, 3), seamless at its back."""
    low, high = vertices.min(0), vertices.max(0)
    middle, side = (low + high) / 2, (high[1] - low[1]) / SQUARES
    radius = float(np.ptp(vertices[vertices[:, 1] > middle[1], 0])) / 2
    middle[2] = min(middle[2], high[2] - radius)  # a mask ends before the middle of the head
    around = 2 * max(1, round(np.pi * radius / side))

    def paint(values: F64) -> F64:
        x, y, z = (values[:, :3] - middle).T
        turn = np.floor(np.arctan2(x, z) / (2 * np.pi) * around)
        even = (turn + np.floor(y / side)) % 2 == 0
        squares = np.where(even[:, None], LIGHT, DARK)
        return np.where(values[:, 3:] > 0.5, squares, UNKNOWN)

    return paint


def _face_axes(points: F64) -> F64:
    """(3, 3) from mesh axes to the person's left (the viewer's right), up, and forward, of feature points (20, 3)."""

    def mean(*parts: str) -> F64:
        return np.asarray(
            np.mean([points[k] for k, name in enumerate(NAMES) if name.startswith(parts)], axis=0)
        )

    across = mean("eye_left", "brow_left") - mean("eye_right", "brow_right")
    up = mean("eye_", "brow_") - mean("mouth_", "upper_lip", "lower_lip")
    across /= np.linalg.norm(across)
    forward = np.cross(across, up)
    forward /= np.linalg.norm(forward)
    return np.stack([across, np.cross(forward, across), forward])


def _portrait(vertices: F64, points: F64) -> Camera:
    """Head and throat around upright feature points, no more than there is."""
    whole = Camera.around(vertices)
    tall = float(np.ptp(points[:, 1]))
    low, high = points[:, 1].min() - 0.55 * tall, vertices[:, 1].max()
    near = vertices[vertices[:, 1] > points[:, 1].min()]
    if low <= vertices[:, 1].min() or not len(near):
        return whole
    middle = (near.min(0) + near.max(0)) / 2
    across = float(np.hypot(*(near - middle)[:, [0, 2]].T).max())
    return Camera(np.array([middle[0], (low + high) / 2, middle[2]]), (across, (high - low) / 2))


def _title(text: str) -> Picture:
    out = np.full((TITLE, SIZE[0], 3), PAPER, np.uint8)
    _write(out, text, SIZE[0] // 2, 27, 17, middle=True)
    return out


def _write(
    picture: Picture, text: str, x: int, y: int, height: int, colour: tuple[int, int, int] = INK, *,
    middle: bool = False,
) -> None:  # fmt: skip
    """Letters of a height in pixels on a baseline, from x on or around it."""
    face = cv2.FontFace("sans")
    wide = cv2.getTextSize((0, 0), text, (0, 0), face, height, 400)[2] if middle else 0
    cv2.putText(picture, text, (x - wide // 2, y), colour, face, height, 400)
