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
from guise.aam.landmarks.schemes import (
    BROWS,
    CHIN,
    IBUG68,
    JAW,
    LEFT_MOUTH_CORNER,
    NOSE_BASE,
    NOSE_BRIDGE,
    NOSE_ROOT,
    RIGHT_MOUTH_CORNER,
    UPPER_LIP_TOP,
)
from guise.common.arrays import F32, F64, I32, U8
from training.backgrounds import CLIPS, hand, random_background, skin
from training.data import VALIDATION_PEOPLE, Pictures, london_people

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
    """A picture (SIZE, SIZE, 3), boxes (n, 4) of faces to find, and boxes (m, 4) of which nothing is asked."""

    image: Picture
    boxes: Floats
    unsure: Floats


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
        image = self._background(rng)
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
                _cover(rng, image, owner, face)
        kinds = [_kind(owner, f, k + 1, b) for k, (f, b) in enumerate(zip(faces, faceless, strict=True))]
        boxes = [np.concatenate([f.min(0), f.max(0)]) for f in faces]
        image = camera(rng, image)
        kinds = [
            "unsure" if k == "face" and _contrast(image, b) < DIM else k
            for k, b in zip(kinds, boxes, strict=True)
        ]
        return Scene(image, _rows(boxes, kinds, "face"), _rows(boxes, kinds, "unsure"))

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
        return _shuffled(rng, image) if rng.random() < 0.5 else _enlarged(rng, image, points)

    def _background(self, rng: Rng) -> Picture:
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
            _wipe(rng, image, points)
        elif size > 14:
            _dress(rng, image, points)
        if rng.random() < 0.15:  # as a photograph with its own background
            return Person(image, points), blank
        return Person(_lit(rng, image), points, alpha), blank


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


def _shuffled(rng: Rng, image: Picture) -> Picture:
    """A picture cut into small squares, which are turned and put together in another order."""
    count = int(rng.integers(6, 15))
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
    cover = cv2.warpAffine(alpha, local, shape, flags=cv2.INTER_LINEAR)
    if rng.random() < 0.5:
        cover = cv2.GaussianBlur(cover, (0, 0), rng.uniform(0.4, 1.2))
    part = (slice(low[1], high[1]), slice(low[0], high[0]))
    image[part] = _blend(image[part], np.asarray(over, np.uint8), np.asarray(cover, np.uint8))
    owner[part][cover > 127] = number


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


def _blend(under: Picture, over: Picture, alpha: Picture) -> Picture:
    share = alpha[..., None].astype(np.uint16)
    return np.asarray((over * share + under * (255 - share) + 127) // 255, np.uint8)


def _int(points: Floats) -> I32:
    return np.round(points).astype(np.int32)


def _about(person: Person) -> Picture:
    """Alpha (h, w): the face and a little of what is around, softly cut."""
    alpha = np.zeros(person.image.shape[:2], np.uint8)
    low, high = person.points.min(0), person.points.max(0)
    centre, side = (low + high) / 2, float((high - low).max())
    at = (int(centre[0]), int(centre[1] - 0.15 * side))
    cv2.ellipse(alpha, at, (int(0.62 * side), int(0.85 * side)), 0, 0, 360, 255, -1)
    return np.asarray(cv2.GaussianBlur(alpha, (0, 0), 0.03 * side), np.uint8)


def _wipe(rng: Rng, image: Picture, points: Floats) -> None:
    """Take the face away: skin, hair or a wild blur where it was, so that a head without a face remains."""
    hull = cv2.convexHull(_int(points.mean(0) + rng.uniform(1.05, 1.35) * (points - points.mean(0))))
    area = np.zeros(image.shape[:2], np.uint8)
    cv2.fillConvexPoly(area, hull, 255)
    area = np.asarray(cv2.GaussianBlur(area, (0, 0), 3), np.uint8)
    size = float(np.ptp(points, axis=0).max())
    if rng.random() < 0.5:
        blank = cv2.GaussianBlur(image, (0, 0), 0.25 * size)
    else:
        blank = np.empty_like(image)
        blank[:] = np.array([60, 45, 35]) * rng.uniform(0.2, 3)
        blank = cv2.add(blank, np.asarray(rng.integers(0, 30, image.shape), np.uint8))
    image[:] = _blend(image, np.asarray(blank, np.uint8), area)


def _dress(rng: Rng, image: Picture, points: Floats) -> None:
    """Glasses, beard, cap or fringe, a mask over mouth and nose: each now and then."""
    up = points[NOSE_ROOT] - points[CHIN]
    if rng.random() < 0.15:
        jaw = points[JAW][int(rng.integers(1, 5)) : len(JAW) - int(rng.integers(1, 5))]
        lip = 0.5 * (points[NOSE_BASE] + points[UPPER_LIP_TOP])
        area = np.concatenate(
            [jaw - rng.uniform(0, 0.08) * up, [points[LEFT_MOUTH_CORNER], lip, points[RIGHT_MOUTH_CORNER]]]
        )
        _over(rng, image, area, np.array([60, 45, 35]) * rng.uniform(0.2, 3.5), rng.uniform(0.4, 0.95))
    if rng.random() < 0.2:
        _glasses(rng, image, points)
    if rng.random() < 0.12:
        brow = points[BROWS] + rng.uniform(0.02, 0.35) * up
        area = np.concatenate([brow, (brow + rng.uniform(0.5, 1.0) * up)[::-1] * 1.0])
        _over(rng, image, area, rng.uniform(0, 255, 3) * rng.uniform(0.2, 1), 1.0)
    if rng.random() < 0.05:
        area = points[[*JAW[1:-1], NOSE_BRIDGE[2]]]
        _over(rng, image, area, rng.uniform(60, 255, 3), 1.0)


def _over(rng: Rng, image: Picture, polygon: Floats, colour: Floats, most: float) -> None:
    area = np.zeros(image.shape[:2], np.uint8)
    cv2.fillPoly(area, [_int(polygon)], int(255 * most))
    area = np.asarray(cv2.GaussianBlur(area, (0, 0), rng.uniform(0.6, 2)), np.uint8)
    front = np.empty_like(image)
    front[:] = np.clip(colour, 0, 255)
    image[:] = _blend(image, front, area)


def _glasses(rng: Rng, image: Picture, points: Floats) -> None:
    right, left = points[list(RIGHT_EYE)].mean(0), points[list(LEFT_EYE)].mean(0)
    gap = float(np.linalg.norm(left - right)) + 1e-6
    turn = float(np.degrees(np.arctan2(left[1] - right[1], left[0] - right[0])))
    r, g, b = (int(c) for c in rng.integers(0, 90, 3))
    axes = (max(2, int(gap * rng.uniform(0.27, 0.42))), max(2, int(gap * rng.uniform(0.2, 0.36))))
    dark = rng.random() < 0.4
    for eye in (right, left):
        at = (int(eye[0]), int(eye[1] + 0.04 * gap))
        if dark:
            cv2.ellipse(image, at, axes, turn, 0, 360, (r, g, b), -1, cv2.LINE_AA)
        cv2.ellipse(image, at, axes, turn, 0, 360, (r, g, b), max(1, int(0.05 * gap)), cv2.LINE_AA)


def _cover(rng: Rng, image: Picture, owner: NDArray[np.int16], face: Floats) -> None:
    """A hand, a microphone, a card or a bar before a face."""
    low, high = face.min(0), face.max(0)
    side = float((high - low).max())
    at = low + rng.uniform(0, 1, 2) * (high - low)
    before = image.copy()
    kind = rng.random()
    if kind < 0.5:
        hand(rng, image, at, side * rng.uniform(0.12, 0.35), skin(rng))
    else:
        r, g, b = (int(c) for c in rng.integers(0, 256, 3))
        if kind < 0.75:
            axes = (max(1, int(side * rng.uniform(0.1, 0.35))), max(1, int(side * rng.uniform(0.1, 0.35))))
            cv2.ellipse(image, _pixel(at), axes, rng.uniform(0, 180), 0, 360, (r, g, b), -1, cv2.LINE_AA)
        else:
            end = at + rng.normal(0, 2 * side, 2)
            thick = max(1, int(side * rng.uniform(0.05, 0.3)))
            cv2.line(image, _pixel(at), _pixel(end), (r, g, b), thick, cv2.LINE_AA)
    owner[(image != before).any(2)] = -1


def _pixel(point: Floats) -> tuple[int, int]:
    return int(point[0]), int(point[1])


# -- light and camera ---------------------------------------------------------------------------------------------


def _lit(rng: Rng, image: Picture) -> Picture:
    """A person in a light of their own: gain, white balance, gamma, now and then a slope from side to side."""
    gain = np.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.07, 3))
    if rng.random() < 0.12:
        gain = gain * rng.uniform(0.25, 0.6)
    levels = np.arange(256)[:, None] / 255
    table = np.clip(levels ** np.exp(rng.normal(0, 0.2)) * gain, 0, 1) * 255
    lit = cv2.LUT(image, np.asarray(table, np.uint8).reshape(1, 256, 3))
    if rng.random() < 0.2:
        slope = cv2.resize(
            np.exp(rng.normal(0, 0.4, (2, 2))), image.shape[1::-1], interpolation=cv2.INTER_LINEAR
        )
        lit = np.clip(lit * slope[..., None], 0, 255)
    return np.asarray(lit, np.uint8)


def _moved(rng: Rng, image: Picture) -> Picture:
    """Blurred by a motion in a random direction."""
    length = int(rng.integers(2, 8))
    kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
    angle = rng.uniform(0, np.pi)
    reach = 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
    middle = np.full(2, float(length))
    cv2.line(kernel, _pixel(middle - reach), _pixel(middle + reach), 1.0)
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()), np.uint8)


def camera(rng: Rng, image: Picture) -> Picture:
    """The whole scene through a camera: exposure, colour or grey, blur, low resolution, noise, JPEG."""
    gain = np.exp(rng.normal(0, 0.2)) * np.exp(rng.normal(0, 0.06, 3))
    if rng.random() < 0.12:
        gain = gain * rng.uniform(0.15, 0.6)
    black = rng.uniform(-0.05, 0.12) if rng.random() < 0.3 else 0.0
    levels = np.arange(256)[:, None] / 255
    table = np.clip(levels ** np.exp(rng.normal(0, 0.2)) * gain * (1 - black) + black, 0, 1) * 255
    image = np.asarray(cv2.LUT(image, np.asarray(table, np.uint8).reshape(1, 256, 3)), np.uint8)
    kind = rng.random()
    if kind < 0.15:
        image = np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    elif kind < 0.5:
        keep = rng.uniform(0.2, 1.5)
        mix = keep * (np.eye(3) + rng.normal(0, 0.05, (3, 3))) + (1 - keep) / 3
        image = np.asarray(cv2.transform(image, mix), np.uint8)
    if rng.random() < 0.25:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.3)), np.uint8)
    if rng.random() < 0.12:
        image = _moved(rng, image)
    if rng.random() < 0.2:
        share = rng.uniform(0.5, 0.95)
        small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
        image = np.asarray(cv2.resize(small, (SIZE, SIZE), interpolation=cv2.INTER_LINEAR), np.uint8)
    if rng.random() < 0.4:
        noise = np.empty(image.shape, np.int16)
        cv2.randn(noise, 0, rng.uniform(1, 12))
        image = np.asarray(cv2.add(image, noise, dtype=cv2.CV_8U), np.uint8)
    if rng.random() < 0.15:
        soft = cv2.GaussianBlur(image, (0, 0), 1.0)
        image = np.asarray(cv2.addWeighted(image, 1.8, soft, -0.8, 0), np.uint8)
    if rng.random() < 0.5:
        code = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, int(rng.uniform(20, 92))])[1]
        image = np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)
    return np.ascontiguousarray(image)
