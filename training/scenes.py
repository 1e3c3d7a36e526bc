"""Scenes for the face detector: people pasted into backgrounds at all sizes, with the boxes of their faces.

Everything is random and comes from the generator that is given. Pixels, x right, y down, pixel centres at integers;
images RGB uint8. A face's box is the tight box of its 68 iBUG points.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import LEFT_EYE, RIGHT_EYE
from guise.aam.landmarks.schemes import IBUG68, NOSE_BASE
from guise.common.arrays import F32, F64, U8
from training.backgrounds import CLIPS, random_background
from training.camera import camera, lit
from training.canvas import blend
from training.data import VALIDATION_PEOPLE, Pictures, london_people
from training.patterns import before, is_plain
from training.worn import cover, dress, wipe

SIZE = 320  # pixels, the side of a scene
SMALLEST = (
    8  # pixels, the smallest face that is to be found; smaller ones are neither asked for nor forbidden
)
CLEAR, HIDDEN = (
    0.5,
    0.02,
)  # shares of a face's points in sight: above, it is to be found; below, it is not there
DIM = 7  # grey levels, the contrast of a face below which nobody could tell
_FAR = 340  # pixels, the longer side to which real frames are brought
_BACKGROUNDS, _BACKGROUND_SIZE = 700, 448
_PATTERNED = 0.4  # of the scenes, seen through something

Picture = U8
Floats = F64
Rng = np.random.Generator


@dataclass(frozen=True, eq=False)
class Person:
    """A picture (h, w, 3) with one face, its 68 points (68, 2) and what belongs to the person: alpha (h, w) uint8."""

    image: Picture
    points: Floats
    alpha: Picture | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture (SIZE, SIZE, 3), boxes (n, 4) of faces to find, and boxes (m, 4) of which nothing is asked.

    points : (n, 68, 2) of the faces to find.
    """

    image: Picture
    boxes: Floats
    unsure: Floats
    points: Floats


class Scenes:
    """Makes scenes from rendered people, real frames and backgrounds.

    rendered : with masks.   real : as from `real_people`.   photos : parts of real pictures without faces.
    """

    def __init__(
        self, rendered: Pictures, real: Sequence[Person], photos: Sequence[Picture], real_share: float, seed: int,
        backgrounds: int = _BACKGROUNDS,
    ) -> None:  # fmt: skip
        self.rendered, self.real, self.real_share = rendered, real, real_share if real else 0.0
        rng = np.random.default_rng([seed, 1])
        self.backgrounds = [self._made(rng, photos) for _ in range(backgrounds)]

    def make(self, rng: Rng) -> Scene:
        """One scene."""
        image = self.background(rng)
        owner = np.zeros((SIZE, SIZE), np.int16)
        faces: list[Floats] = []
        faceless: list[bool] = []
        for size in _sizes(rng):
            person, blank = self._person(rng, size)
            moved = _pasted(rng, image, owner, person, size, len(faces) + 1, faces)
            if moved is not None:
                faces.append(moved)
                faceless.append(blank)
        for face, blank in zip(faces, faceless, strict=True):
            if not blank and rng.random() < 0.15:
                cover(rng, image, owner, face)
        kinds = [_kind(owner, f, k + 1, b) for k, (f, b) in enumerate(zip(faces, faceless, strict=True))]
        if rng.random() < _PATTERNED:
            image, kinds = self._through(rng, image, faces, kinds)
        boxes = [np.concatenate([f.min(0), f.max(0)]) for f in faces]
        image = camera(rng, image)
        kinds = [
            "unsure" if k == "face" and _contrast(image, b) < DIM else k
            for k, b in zip(kinds, boxes, strict=True)
        ]
        points = [face for face, kind in zip(faces, kinds, strict=True) if kind == "face"]
        plain, unsure = (_rows(boxes, kinds, kind) for kind in ("face", "unsure"))
        return Scene(image, plain, unsure, np.array(points, np.float64).reshape(-1, 68, 2))

    def _through(
        self, rng: Rng, image: Picture, faces: Sequence[Floats], kinds: Sequence[str]
    ) -> tuple[Picture, list[str]]:
        """The scene behind bars, a watermark and the like; of faces that nobody could see then nothing is asked."""
        face = faces[int(rng.integers(len(faces)))] if faces else rng.uniform(0, SIZE, (len(IBUG68), 2))
        near = face[[*RIGHT_EYE, *LEFT_EYE]].mean(0)
        near = near + rng.uniform(0.15, 0.9) * (face[NOSE_BASE] - near)
        side = float(np.ptp(face, axis=0).max())
        pitch = float(np.clip(side * np.exp(rng.uniform(np.log(0.1), np.log(0.8))), 4, 160))
        image, opacity = before(rng, image, pitch, near, self.background(rng))
        kinds = [
            "unsure" if kind == "face" and not is_plain(opacity, face) else kind
            for kind, face in zip(kinds, faces, strict=True)
        ]
        return image, kinds

    def _made(self, rng: Rng, photos: Sequence[Picture]) -> Picture:
        """A background (_BACKGROUND_SIZE, _BACKGROUND_SIZE, 3): made up, or of a person's picture in pieces."""
        if rng.random() > 0.3:
            return random_background(rng, _BACKGROUND_SIZE, _BACKGROUND_SIZE, photos)
        if self.real and rng.random() < 0.5:
            person = self.real[int(rng.integers(len(self.real)))]
            image, points = person.image, person.points
        else:
            i = int(rng.integers(len(self.rendered)))
            image, points = self.rendered.images[i], self.rendered.points[i, IBUG68].astype(np.float64)
        return _shuffled(rng, image, points) if rng.random() < 0.5 else _enlarged(rng, image, points)

    def background(self, rng: Rng) -> Picture:
        """A part of a background (SIZE, SIZE, 3)."""
        whole = self.backgrounds[int(rng.integers(len(self.backgrounds)))]
        side = int(rng.uniform(0.4, 1) * _BACKGROUND_SIZE)
        y, x = rng.integers(0, _BACKGROUND_SIZE - side + 1, 2)
        part = np.ascontiguousarray(whole[y : y + side, x : x + side])
        if rng.random() < 0.5:
            part = np.ascontiguousarray(part[:, ::-1])
        return np.asarray(cv2.resize(part, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.uint8)

    def _person(self, rng: Rng, size: float) -> tuple[Person, bool]:
        """Somebody, and whether the face was taken away."""
        if rng.random() < self.real_share:
            person = self.real[int(rng.integers(len(self.real)))]
            if rng.random() < 0.35:
                person = Person(person.image, person.points, _about(person))
            return person, False
        i = int(rng.integers(len(self.rendered)))
        image, points = self.rendered.images[i].copy(), self.rendered.points[i, IBUG68].astype(np.float64)
        alpha = self.rendered[i].mask * np.uint8(255)
        blank = bool(rng.random() < 0.1)
        if blank:
            wipe(rng, image, points)
        elif size > 14:
            dress(rng, image, points)
        if rng.random() < 0.15:  # as a photograph with its own background
            return Person(image, points), blank
        return Person(lit(rng, image), points, alpha), blank


def _enlarged(rng: Rng, image: Picture, points: Floats) -> Picture:
    """What is beside, above or below a face, or a small part of a face."""
    low, high = points.min(0), points.max(0)
    side, limit = float((high - low).max()), np.array(image.shape[1::-1])
    if rng.random() < 0.4:
        size = np.full(2, side * rng.uniform(0.15, 0.3))
        corner = low + rng.uniform(-0.1, 1, 2) * (high - low)
    else:
        edge = rng.integers(4)
        areas = (
            (0, 0, low[0], limit[1]),
            (high[0], 0, limit[0], limit[1]),
            (0, high[1], *limit),
            (0, 0, limit[0], low[1]),
        )
        x0, y0, x1, y1 = areas[edge]
        corner, size = np.array([x0, y0]), np.array([x1 - x0, y1 - y0])
    x, y = (int(c) for c in np.clip(corner, 0, limit - 6))
    most = max(6, int(size.min()) if rng.random() < 0.7 else int(size.max()))
    w, h = (max(6, min(most, int(c))) for c in size)
    part = np.ascontiguousarray(image[y : y + h, x : x + w])
    grown = cv2.resize(part, (_BACKGROUND_SIZE, _BACKGROUND_SIZE), interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.rot90(grown, int(rng.integers(4))), np.uint8)


def _shuffled(rng: Rng, image: Picture, points: Floats) -> Picture:
    """A picture cut into squares of half a face at most, which are turned and put together in another order."""
    side = float(np.ptp(points, axis=0).max())
    count = max(int(rng.integers(6, 15)), int(np.ceil(2 * max(image.shape) / side)))
    side = -(-_BACKGROUND_SIZE // count)
    whole = cv2.resize(image, (count * side, count * side), interpolation=cv2.INTER_LINEAR)
    pieces = whole.reshape(count, side, count, side, 3).swapaxes(1, 2).reshape(-1, side, side, 3)
    pieces = np.stack([np.rot90(pieces[i], int(rng.integers(4))) for i in rng.permutation(len(pieces))])
    joined = pieces.reshape(count, count, side, side, 3).swapaxes(1, 2).reshape(count * side, count * side, 3)
    return np.ascontiguousarray(joined[:_BACKGROUND_SIZE, :_BACKGROUND_SIZE], np.uint8)


def real_people(data: Path, *, held_out: bool = False) -> list[Person]:
    """Frames with one known face that may be trained on: pairs/london, and the clips of `backgrounds.CLIPS`.

    People of evaluation_only.txt, and those whom `training.data` keeps for validation, are left out; with `held_out`
    the latter alone are given.
    """
    return [*_london(data / "pairs" / "london", held_out), *_frames(data / "real", held_out)]


def _london(folder: Path, held_out: bool) -> Iterator[Person]:
    people = london_people(folder)
    chosen = people[-VALIDATION_PEOPLE:] if held_out else people[:-VALIDATION_PEOPLE]
    with np.load(folder / "face81_mediapipe.npz") as labels:
        for name in (f"{p}_{kind}" for p in chosen for kind in ("neutral", "smile")):
            image = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_COLOR)
            if name in labels.files and image is not None and np.isfinite(labels[name]).all():
                yield _brought(image, labels[name])


def _frames(folder: Path, held_out: bool) -> Iterator[Person]:
    files = sorted(f for name in CLIPS for f in folder.glob(f"{name}.m*"))
    last = [f for f in files if f.stem.startswith("grid")][-1:]
    for file in last if held_out else [f for f in files if f not in last]:
        faces = np.load(file.with_suffix(".landmarks.npz"))["face81"]
        capture = cv2.VideoCapture(str(file))
        for index in range(len(faces)):
            good, image = capture.read()
            if good and index % 6 == 0 and np.isfinite(faces[index]).all():
                yield _brought(image, faces[index].reshape(-1, 81, 2)[0])
        capture.release()


def _brought(bgr: Picture, points: F32) -> Person:
    scale = min(1.0, _FAR / max(bgr.shape[:2]))
    image = cv2.resize(bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    moved = (points[IBUG68].astype(np.float64) + 0.5) * scale - 0.5
    return Person(np.ascontiguousarray(image[..., ::-1], np.uint8), moved)


# -- who is where -------------------------------------------------------------------------------------------------


def _sizes(rng: Rng) -> list[float]:
    """Sides of the faces' boxes, pixels, the smallest (farthest) first."""
    kind = rng.random()
    if kind < 0.12:
        return []
    if kind < 0.34:
        return [_log_uniform(rng, 50, 340)]
    if kind < 0.72:
        return sorted(_log_uniform(rng, 16, 100) for _ in range(int(rng.integers(2, 8))))
    middle = _log_uniform(rng, 8, 30)
    return sorted(middle * np.exp(rng.normal(0, 0.3)) for _ in range(int(rng.integers(3, 15))))


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _pasted(
    rng: Rng, image: Picture, owner: NDArray[np.int16], person: Person, size: float, number: int, others: list[Floats]
) -> Floats | None:  # fmt: skip
    """Paste a person so that the face's box has that side; its points in the scene, None if there is no room."""
    own = float(np.ptp(person.points, axis=0).max())
    angle = np.radians(rng.normal(0, 12) if rng.random() < 0.75 else rng.uniform(-45, 45))
    flip = np.diag([-1.0 if rng.random() < 0.5 else 1.0, 1.0])
    stretch = np.diag(np.exp(rng.normal(0, 0.05, 2)))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    linear = size / own * turn @ stretch @ flip
    middle = (person.points.min(0) + person.points.max(0)) / 2
    for _ in range(8):
        reach = 0.15 * size if size > 40 else 0.0
        centre = rng.uniform(-reach, SIZE + reach, 2)
        if all(np.abs(centre - (o.min(0) + o.max(0)) / 2).max() > 0.8 * max(size, np.ptp(o)) for o in others):
            break
    else:
        return None
    matrix = np.column_stack([linear, centre - linear @ middle])
    if person.alpha is not None and rng.random() < 0.7:
        _trunk(rng, image, owner, person, matrix, number)
    _warp_onto(rng, image, owner, person, matrix, number)
    return person.points @ matrix[:, :2].T + matrix[:, 2]


def _warp_onto(
    rng: Rng, image: Picture, owner: NDArray[np.int16], person: Person, matrix: Floats, number: int
) -> None:
    height, width = person.image.shape[:2]
    corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) @ matrix[:, :2].T + matrix[:, 2]
    low = np.clip(np.floor(corners.min(0)), 0, SIZE).astype(int)
    high = np.clip(np.ceil(corners.max(0)) + 1, 0, SIZE).astype(int)
    if (high <= low).any():
        return
    source, alpha = person.image, person.alpha
    if alpha is None:
        alpha = np.full((height, width), 255, np.uint8)
    scale = float(np.sqrt(abs(np.linalg.det(matrix[:, :2]))))
    local = np.column_stack([matrix[:, :2], matrix[:, 2] - low])
    if scale < 0.7:  # average before sampling, so that nothing aliases
        small = (max(2, round(width * scale * 1.3)), max(2, round(height * scale * 1.3)))
        factor = np.array([width / small[0], height / small[1]])
        source = np.asarray(cv2.resize(source, small, interpolation=cv2.INTER_AREA), np.uint8)
        alpha = np.asarray(cv2.resize(alpha, small, interpolation=cv2.INTER_AREA), np.uint8)
        local = np.column_stack([local[:, :2] * factor, local[:, 2] + local[:, :2] @ (0.5 * factor - 0.5)])
    shape = (int(high[0] - low[0]), int(high[1] - low[1]))
    flags = cv2.INTER_LINEAR if scale < 1.5 else cv2.INTER_CUBIC
    over = cv2.warpAffine(source, local, shape, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    opaque = cv2.warpAffine(alpha, local, shape, flags=cv2.INTER_LINEAR)
    if rng.random() < 0.5:
        opaque = cv2.GaussianBlur(opaque, (0, 0), rng.uniform(0.4, 1.2))
    part = (slice(low[1], high[1]), slice(low[0], high[0]))
    image[part] = blend(image[part], np.asarray(over, np.uint8), np.asarray(opaque, np.uint8))
    owner[part][opaque > 127] = number


def _trunk(
    rng: Rng, image: Picture, owner: NDArray[np.int16], person: Person, matrix: Floats, number: int
) -> None:
    """The body on below the picture, in the colour that its clothes have at the picture's bottom."""
    assert person.alpha is not None
    height, width = person.alpha.shape
    across = np.flatnonzero(person.alpha[-2] > 127)
    if len(across) < 8:
        return
    colour = person.image[-2, across].mean(0) if rng.random() < 0.7 else rng.uniform(0, 255, 3)
    left, right = across[0], across[-1]
    wide = rng.uniform(0, 0.3) * width
    corners = np.array(
        [[left, height - 2], [right, height - 2], [right + wide, height * 1.3], [right + wide, height * 3],
         [left - wide, height * 3], [left - wide, height * 1.3]]
    ) @ matrix[:, :2].T + matrix[:, 2]  # fmt: skip
    r, g, b = (int(c) for c in colour)
    cv2.fillPoly(image, [corners.astype(np.int32)], (r, g, b), cv2.LINE_AA)
    body = np.zeros(owner.shape, np.uint8)
    cv2.fillPoly(body, [corners.astype(np.int32)], 1)
    owner[body > 0] = number


def _kind(owner: NDArray[np.int16], face: Floats, number: int, blank: bool) -> str:
    """Of a pasted face with points (68, 2): face, unsure or none."""
    size, centre = float(np.ptp(face, axis=0).max()), face.mean(0)
    places = np.round(centre + 0.88 * (face - centre)).astype(int)
    inside = ((places >= 0) & (places < SIZE)).all(1)
    seen = owner[places[inside, 1], places[inside, 0]] == number
    share = float(seen.sum()) / len(face)
    if share < HIDDEN:
        return "none"
    if blank:
        return "none" if size > 18 else "unsure"
    middle = (face.min(0) + face.max(0)) / 2
    if size < SMALLEST or share < CLEAR or (middle < 0).any() or (middle > SIZE - 1).any():
        return "unsure"
    return "face"


def _contrast(image: Picture, box: Floats) -> float:
    """Standard deviation of the grey values in a box."""
    x0, y0, x1, y1 = np.clip(box, 0, SIZE).astype(int)
    part = image[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)].mean(2)
    return float(part.std()) if part.size else 0.0


def _rows(boxes: list[Floats], kinds: list[str], kind: str) -> Floats:
    chosen = [box for box, k in zip(boxes, kinds, strict=True) if k == kind]
    return np.array(chosen, np.float64).reshape(-1, 4)


# -- what is on and before a face ---------------------------------------------------------------------------------


def _about(person: Person) -> Picture:
    """Alpha (h, w): the face and a little of what is around, softly cut."""
    alpha = np.zeros(person.image.shape[:2], np.uint8)
    low, high = person.points.min(0), person.points.max(0)
    centre, side = (low + high) / 2, float((high - low).max())
    at = (int(centre[0]), int(centre[1] - 0.15 * side))
    cv2.ellipse(alpha, at, (int(0.62 * side), int(0.85 * side)), 0, 0, 360, 255, -1)
    return np.asarray(cv2.GaussianBlur(alpha, (0, 0), 0.03 * side), np.uint8)
