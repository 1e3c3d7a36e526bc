"""Backgrounds without a face, of any size: made-up scenes, and parts of real pictures.  RGB uint8.

    rng = np.random.default_rng(1)
    picture = random_background(rng, 360, 640)

Some of what is drawn is there to be mistaken for a face: ovals with dots, skin-coloured blobs, arms and hands, heads
seen from behind, three dark spots in a bright one. Whoever trains on these pictures tells the network that none is.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from guise.common.arrays import F32, F64, U8
from training.clutter import clutter

Picture = U8
Colour = tuple[int, int, int]
Rng = np.random.Generator

# Clips whose landmarks say where the face is; the other gesture clips are kept for evaluation.
CLIPS = ("grid_*", "gesture_bird", "gesture_please", "gesture_thanks")
_PHOTO_EVERY = 12  # frames
_PHOTO_LEAST = 48  # pixels, the shorter side of a part of a real picture


def random_background(
    rng: Rng, height: int, width: int, photos: Sequence[Picture] | None = None, photo_share: float = 0.2
) -> Picture:
    """One picture (height, width, 3).

    photos : real pictures without faces (see `faceless_photos`); a part of one is taken in `photo_share` of the cases.
    """
    if photos and rng.random() < photo_share:
        return _part(rng, photos[int(rng.integers(len(photos)))], height, width)
    if rng.random() < 0.3:
        picture = _part(rng, clutter(rng, 256), height, width)
    else:
        ground = (_fractal, _room, _bricks, _page, _foliage, _patchwork, _street)[int(rng.integers(7))]
        picture = ground(rng, height, width)
    for _ in range(int(rng.choice(4, p=(0.35, 0.3, 0.2, 0.15)))):
        thing = (_heads_from_behind, _cartoons, _hands, _spots, _shapes, _bodies)[int(rng.integers(6))]
        picture = thing(rng, picture)
    if rng.random() < 0.35:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.5, 5)), np.uint8)
    return picture


def faceless_photos(folder: Path, size: int = 320) -> list[Picture]:
    """Parts without a face of the clips in `folder` that may be trained on (CLIPS), the longer side at most `size`.

    Of every frame in which the face is known: what lies left, right and below of it.
    """
    parts: list[Picture] = []
    files = sorted(f for name in CLIPS for f in folder.glob(f"{name}.m*"))
    for file in files:
        faces = np.load(file.with_suffix(".landmarks.npz"))["face81"]
        capture = cv2.VideoCapture(str(file))
        for index in range(len(faces)):
            good, frame = capture.read()
            if good and index % _PHOTO_EVERY == 0 and np.isfinite(faces[index]).all():
                parts += _around(np.ascontiguousarray(frame[..., ::-1]), faces[index].reshape(-1, 2), size)
        capture.release()
    return parts


def _around(frame: Picture, points: F32, size: int) -> list[Picture]:
    """The parts of a frame beside and below the face's points (n, 2)."""
    low, high = points.min(0), points.max(0)
    margin = 0.2 * (high - low)
    (left, _), (right, below) = (low - margin).astype(int), (high + margin).astype(int) + 1
    parts = (frame[:, : max(left, 0)], frame[:, max(right, 0) :], frame[max(below, 0) :])
    kept = [p for p in parts if min(p.shape[:2]) >= _PHOTO_LEAST]
    return [np.ascontiguousarray(_shrunk(p, size)) for p in kept]


def _shrunk(picture: Picture, size: int) -> Picture:
    scale = min(1.0, size / max(picture.shape[:2]))
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)


def _part(rng: Rng, picture: Picture, height: int, width: int) -> Picture:
    """A random part, mirrored or not, stretched to a size."""
    h, w = picture.shape[:2]
    share = rng.uniform(0.35, 1)
    ph = max(8, int(min(h, w * height / width) * share))
    pw = max(8, int(min(w, h * width / height) * share))
    y, x = int(rng.integers(0, max(1, h - ph + 1))), int(rng.integers(0, max(1, w - pw + 1)))
    part = np.ascontiguousarray(picture[y : y + ph, x : x + pw])
    if rng.random() < 0.5:
        part = np.ascontiguousarray(part[:, ::-1])
    flags = cv2.INTER_AREA if ph > height else (cv2.INTER_LINEAR, cv2.INTER_CUBIC)[int(rng.integers(2))]
    return np.asarray(cv2.resize(part, (width, height), interpolation=flags), np.uint8)


# -- colours and noise --------------------------------------------------------------------------------------------


def skin(rng: Rng) -> F64:
    """A skin colour (3,), from very light to very dark, in some light."""
    tones = np.array(
        [[244, 208, 177], [231, 180, 143], [210, 158, 124], [186, 120, 81], [130, 84, 58], [78, 52, 41]]
    )
    at = rng.uniform(0, len(tones) - 1.001)
    low = int(at)
    mixed = tones[low] + (at - low) * (tones[low + 1] - tones[low])
    return np.asarray(np.clip(mixed * rng.uniform(0.45, 1.1) * rng.normal(1, 0.05, 3), 0, 255))


def _colour(rng: Rng) -> F64:
    kind = rng.random()
    if kind < 0.25:
        return skin(rng)
    if kind < 0.6:  # walls, cloth, asphalt: nearly grey
        return np.clip(rng.uniform(15, 245) + rng.normal(0, 12, 3), 0, 255)
    return rng.uniform(0, 255, 3)


def _whole(colour: F64) -> Colour:
    r, g, b = (int(np.clip(c, 0, 255)) for c in colour)
    return r, g, b


def _ints(rng: Rng) -> Colour:
    return _whole(_colour(rng))


def _noise(rng: Rng, height: int, width: int, roughness: float, cells: int = 2) -> F32:
    """Fractal noise (height, width) in 0..1."""
    total = np.zeros((height, width), np.float32)
    weight = 1.0
    while cells < max(height, width):
        shape = (max(2, cells * height // max(height, width)), max(2, cells * width // max(height, width)))
        coarse = rng.random(shape, dtype=np.float32)
        total += weight * cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        cells, weight = cells * 2, weight * roughness
    return np.asarray((total - total.min()) / (np.ptp(total) + 1e-6), np.float32)


def _between(share: F32, rng: Rng) -> Picture:
    a, b = _colour(rng).astype(np.float32), _colour(rng).astype(np.float32)
    return np.asarray(np.clip(a + share[..., None] * (b - a), 0, 255), np.uint8)


def _plain(rng: Rng, height: int, width: int) -> Picture:
    """Nearly one colour, with a slope of light."""
    slope = rng.normal(0, 30, (2, 2, 1)) + _colour(rng)
    return np.asarray(
        np.clip(cv2.resize(slope, (width, height), interpolation=cv2.INTER_LINEAR), 0, 255), np.uint8
    )


# -- grounds ------------------------------------------------------------------------------------------------------


def _fractal(rng: Rng, height: int, width: int) -> Picture:
    share = _noise(rng, height, width, rng.uniform(0.3, 0.95), int(rng.integers(2, 12)))
    if rng.random() < 0.5:
        share = np.clip((share - rng.uniform(0.3, 0.7)) * rng.uniform(2, 10) + 0.5, 0, 1)
    return _between(share, rng)


def _room(rng: Rng, height: int, width: int) -> Picture:
    """A wall, a floor, and furniture, windows, frames and lamps as boxes with inner boxes."""
    out = _plain(rng, height, width)
    floor = int(rng.uniform(0.5, 1.1) * height)
    out[floor:] = _ints(rng)
    for _ in range(int(rng.integers(2, 16))):
        x, y = rng.uniform(-0.1, 1, 2) * (width, height)
        w, h = np.exp(rng.uniform(np.log(0.02), np.log(0.5), 2)) * max(height, width)
        _box(rng, out, (x, y, w, h))
        if rng.random() < 0.4:
            m = rng.uniform(0.05, 0.3)
            _box(rng, out, (x + m * w, y + m * h, w * (1 - 2 * m), h * (1 - 2 * m)))
    return out


def _box(rng: Rng, out: Picture, xywh: tuple[float, float, float, float]) -> None:
    x, y, w, h = xywh
    thick = -1 if rng.random() < 0.8 else max(1, int(0.02 * max(out.shape)))
    cv2.rectangle(out, (int(x), int(y)), (int(x + w), int(y + h)), _ints(rng), thick)


def _bricks(rng: Rng, height: int, width: int) -> Picture:
    """Bricks, tiles, shelves with books, window fronts: rows of boxes of one colour family."""
    out = np.empty((height, width, 3), np.uint8)
    out[:] = _ints(rng)
    base, spread = _colour(rng), rng.uniform(3, 70)
    rows = int(rng.integers(3, 24))
    step, joint = height / rows, max(1, int(rng.uniform(0.02, 0.25) * height / rows))
    wide = step * np.exp(rng.uniform(-1.2, 1.2))
    uneven = rng.random() < 0.5
    for row in range(rows):
        x = -wide * (0.5 if row % 2 else 0.0)
        while x < width:
            w = wide * (rng.uniform(0.4, 1.6) if uneven else 1)
            top, bottom = int(row * step), int((row + 1) * step) - joint
            cv2.rectangle(
                out, (int(x), top), (int(x + w) - joint, bottom), _whole(base + rng.normal(0, spread, 3)), -1
            )
            x += w
    grain = _noise(rng, height, width, 0.9, 16)[..., None]
    return np.asarray(np.clip(out * (0.8 + 0.4 * grain), 0, 255), np.uint8)


def _page(rng: Rng, height: int, width: int) -> Picture:
    """Lines of writing in all sizes: pages, signs, posters."""
    out = _plain(rng, height, width)
    letters = "ABCDEFGHKLMNOPQRSTabcdeghkmnoprstuvwxyz0123456789 .,:;()&@%?!"
    for _ in range(int(rng.integers(1, 5))):
        size, y = float(np.exp(rng.uniform(-1.2, 1.3))), int(rng.uniform(0, height))
        x, colour = int(rng.uniform(-0.1, 0.6) * width), _ints(rng)
        for line in range(int(rng.integers(1, 14))):
            text = "".join(letters[int(i)] for i in rng.integers(0, len(letters), int(rng.integers(4, 40))))
            at = (x, y + int(30 * size * line))
            font, thick = int(rng.integers(0, 8)), max(1, int(size * rng.uniform(1, 4)))
            cv2.putText(out, text, at, font, size, colour, thick, cv2.LINE_AA)
    return out


def _foliage(rng: Rng, height: int, width: int) -> Picture:
    """Leaves, grass, gravel, a crowd of blobs: many small ellipses of one colour family before a noisy ground."""
    out = _fractal(rng, height, width)
    base = np.array([70, 115, 45]) if rng.random() < 0.5 else _colour(rng)
    reach = np.exp(rng.uniform(np.log(0.004), np.log(0.06))) * max(height, width)
    stretch = rng.uniform(1, 4)
    for _ in range(int(rng.integers(60, 350))):
        axes = reach * rng.uniform(0.4, 1.4) * np.array([stretch, 1]) + 1
        centre = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        shade = _whole(base * rng.uniform(0.3, 1.8) + rng.normal(0, 10, 3))
        cv2.ellipse(out, centre, (int(axes[0]), int(axes[1])), rng.uniform(0, 180), 0, 360, shade, -1)
    return out


def _patchwork(rng: Rng, height: int, width: int) -> Picture:
    """Several pictures of clutter side by side."""
    out = np.empty((height, width, 3), np.uint8)
    rows, columns = (int(n) for n in rng.integers(1, 4, 2))
    ys = np.linspace(0, height, rows + 1).astype(int)
    xs = np.linspace(0, width, columns + 1).astype(int)
    for y0, y1 in pairwise(ys):
        for x0, x1 in pairwise(xs):
            out[y0:y1, x0:x1] = _part(rng, clutter(rng, 128), y1 - y0, x1 - x0)
    return out


def _street(rng: Rng, height: int, width: int) -> Picture:
    """House fronts with rows of windows, a road, cars as boxes with dark wheels."""
    out = _plain(rng, height, width)
    ground, x = int(rng.uniform(0.5, 0.9) * height), 0
    while x < width:
        w, top = int(rng.uniform(0.12, 0.5) * width) + 4, int(rng.uniform(0, 0.4) * height)
        cv2.rectangle(out, (x, top), (x + w, ground), _ints(rng), -1)
        dark, n = _ints(rng), int(rng.integers(2, 7))
        step, size = w / n, w / n * rng.uniform(0.3, 0.8)
        for cx in np.arange(x + step / 4, x + w - size / 2, step):
            for cy in np.arange(top + step / 3, ground - size, step * 1.3):
                cv2.rectangle(out, (int(cx), int(cy)), (int(cx + size), int(cy + size)), dark, -1)
        x += w
    cv2.rectangle(out, (0, ground), (width, height), _whole(np.full(3, rng.uniform(40, 160))), -1)
    for _ in range(int(rng.integers(0, 6))):
        w, cx, cy = rng.uniform(0.05, 0.3) * width, rng.uniform(0, width), rng.uniform(ground, height)
        cv2.rectangle(out, (int(cx), int(cy - 0.35 * w)), (int(cx + w), int(cy)), _ints(rng), -1)
        for share in (0.22, 0.78):
            cv2.circle(out, (int(cx + share * w), int(cy)), max(1, int(0.11 * w)), (20, 20, 22), -1)
    return out


# -- things to be mistaken for a face -----------------------------------------------------------------------------


def _place(rng: Rng, picture: Picture, least: float = 0.02, most: float = 0.3) -> tuple[F64, float]:
    """A random centre (2,) and radius in pixels."""
    height, width = picture.shape[:2]
    radius = np.exp(rng.uniform(np.log(least), np.log(most))) * max(height, width)
    return rng.uniform(0, 1, 2) * (width, height), max(3.0, float(radius))


def _oval(out: Picture, centre: F64, axes: F64, turn: float, colour: Colour) -> None:
    at, size = (int(centre[0]), int(centre[1])), (max(1, int(axes[0])), max(1, int(axes[1])))
    cv2.ellipse(out, at, size, turn, 0, 360, colour, -1, cv2.LINE_AA)


def _shaded_oval(rng: Rng, out: Picture, centre: F64, axes: F64, turn: float) -> None:
    """A skin-coloured oval, lit from somewhere."""
    tone, towards = skin(rng), rng.normal(0, 0.25, 2) * axes
    for k in range(5):
        shade = _whole(tone * (0.7 + 0.1 * k))
        _oval(out, centre + towards * k / 5, axes * (1 - 0.15 * k), turn, shade)


def _heads_from_behind(rng: Rng, picture: Picture) -> Picture:
    """Hair over an oval of skin without eyes, nose or mouth, on a neck."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(1, 6))):
        centre, r = _place(rng, picture, 0.02, 0.2)
        turn = rng.normal(0, 12)
        hair = _whole(np.array([60, 45, 35]) * rng.uniform(0.2, 3.2) * rng.normal(1, 0.1, 3))
        down = np.array([0, r])
        _oval(out, centre + 3.2 * down, np.array([2.2, 1.9]) * r, 0, _ints(rng))
        _shaded_oval(rng, out, centre + 0.8 * down, np.array([0.5, 0.9]) * r, turn)
        _shaded_oval(rng, out, centre, np.array([0.78, 1.05]) * r, turn)
        _oval(
            out,
            centre - rng.uniform(0, 0.4) * down,
            np.array([0.85, rng.uniform(0.7, 1.15)]) * r,
            turn,
            hair,
        )
    return out


def _cartoons(rng: Rng, picture: Picture) -> Picture:
    """Ovals with two dots and a line, as drawn faces, sockets, masks and fronts of cars have them."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(1, 5))):
        centre, r = _place(rng, picture, 0.02, 0.25)
        _oval(out, centre, np.array([rng.uniform(0.7, 1.1), 1]) * r, 0, _ints(rng))
        ink, eye = _ints(rng), rng.uniform(0.06, 0.2) * r
        for side in (-1, 1):
            at = centre + r * np.array([side * rng.uniform(0.25, 0.4), -rng.uniform(0.1, 0.35)])
            if rng.random() < 0.5:
                _oval(out, at, np.array([2, 2]) * eye, 0, (245, 245, 245))
            _oval(out, at, np.array([eye, eye]), 0, ink)
        mouth = (int(centre[0]), int(centre[1] + 0.35 * r))
        size = (max(1, int(0.4 * r)), max(1, int(rng.uniform(0.02, 0.2) * r)))
        span = (0, 180) if rng.random() < 0.7 else (180, 360)
        cv2.ellipse(out, mouth, size, 0, *span, ink, max(1, int(0.06 * r)), cv2.LINE_AA)
    return out


def _hands(rng: Rng, picture: Picture) -> Picture:
    """Hands and arms: a palm, fingers, a thick arm, shaded from the rim inwards."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(1, 4))):
        hand(rng, out, *_place(rng, picture, 0.02, 0.15), skin(rng))
    return out


def hand(rng: Rng, out: Picture, centre: F64, r: float, tone: F64) -> None:
    """Draw one hand of a skin tone, its palm at `centre` with radius r pixels, into a picture."""
    turn = rng.uniform(0, 2 * np.pi)
    ahead, aside = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    spread, length = rng.uniform(0, 0.5), rng.uniform(0.6, 2.2)
    strokes = [(centre, centre - ahead * r * rng.uniform(2, 7), 1.3 * r)]
    for k in (-1.0, -0.35, 0.3, 0.9):
        start = centre + aside * k * 0.75 * r
        strokes.append((start, start + (ahead + aside * k * spread) * length * r, 0.42 * r))
    thumb = centre - aside * 0.8 * r
    strokes.append((thumb, thumb + (ahead * 0.7 - aside) * r, 0.45 * r))
    for k in range(3):
        shade = _whole(tone * (0.72 + 0.16 * k))
        for a, b, w in strokes:
            thick = max(1, int(w * (1 - 0.25 * k)))
            cv2.line(out, (int(a[0]), int(a[1])), (int(b[0]), int(b[1])), shade, thick, cv2.LINE_AA)
        _oval(out, centre, np.array([1, 0.9]) * r * (1 - 0.2 * k), 0, shade)


def _spots(rng: Rng, picture: Picture) -> Picture:
    """Blurred dark spots in bright ovals, two over one, and skin-coloured blobs without any."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(1, 6))):
        centre, r = _place(rng, picture, 0.02, 0.2)
        _shaded_oval(rng, out, centre, np.array([rng.uniform(0.5, 1), 1]) * r, rng.uniform(0, 180))
        for _ in range(int(rng.integers(0, 5))):
            spot = centre + rng.normal(0, 0.35, 2) * r
            _oval(out, spot, rng.uniform(0.05, 0.25, 2) * r, rng.uniform(0, 180), _whole(skin(rng) * 0.4))
    return out


def _shapes(rng: Rng, picture: Picture) -> Picture:
    """Polygons, discs and rings anywhere."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(2, 14))):
        centre, r = _place(rng, picture, 0.01, 0.3)
        kind = rng.random()
        if kind < 0.6:
            corners = centre + rng.normal(0, 0.7 * r, (int(rng.integers(3, 8)), 2))
            cv2.fillPoly(out, [corners.astype(np.int32)], _ints(rng), cv2.LINE_AA)
        else:
            thick = -1 if kind < 0.8 else max(1, int(rng.uniform(0.05, 0.4) * r))
            cv2.circle(out, (int(centre[0]), int(centre[1])), int(r), _ints(rng), thick, cv2.LINE_AA)
    return out


def _bodies(rng: Rng, picture: Picture) -> Picture:
    """Trunks with arms and necks, without heads."""
    out = np.ascontiguousarray(picture)
    for _ in range(int(rng.integers(1, 4))):
        top, r = _place(rng, picture, 0.03, 0.2)
        cloth, tone = _colour(rng), skin(rng)
        shoulders = np.array([[-1.6, 0.7], [-0.5, 0], [0.5, 0], [1.6, 0.7], [1.5, 5], [-1.5, 5]]) * r + top
        cv2.fillPoly(out, [shoulders.astype(np.int32)], _whole(cloth), cv2.LINE_AA)
        neck = np.array([[-0.45, -0.8], [0.45, -0.8], [0.5, 0.1], [0, 0.7], [-0.5, 0.1]]) * r + top
        cv2.fillPoly(out, [neck.astype(np.int32)], _whole(tone), cv2.LINE_AA)
        for _ in range(int(rng.integers(0, 3))):
            hand(rng, out, top + rng.normal(0, 2, 2) * r, 0.5 * r, tone)
    return out
