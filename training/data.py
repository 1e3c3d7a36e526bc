"""Reads what the landmarker and the detector are trained on: rendered parts, and real pictures that may be trained on.

Pixels, x right, y down, pixel centres at integers; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.common.arrays import F32, U8, Bool

HELD_OUT = 10  # rendered people whose number is a multiple of this are for evaluation only
REAL_SIZE = 208  # pixels, the side of a real picture's square
REAL_SHARE = 0.62  # of that square, taken by the longer side of the face's box
EVERY = 5  # a clip gives every fifth frame
VALIDATION_PEOPLE = 8  # people of the photographs that are kept for validation


@dataclass(frozen=True, eq=False)
class Pictures:
    """Square pictures with one known face each.

    Parameters
    ----------
    images : (n, size, size, 3) uint8
    points : (n, 81, 2) float32 pixels
    visible : (n, 81) bool
    masks : (n, size, size) uint8, 1 on the person; empty (0, ...) where unknown
    person : (n,) str
    attributes : (n, k) float32 and their names; k = 0 where unknown
    """

    images: U8
    points: F32
    visible: Bool
    masks: U8
    person: NDArray[Any]
    attributes: F32
    attribute_names: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of pictures."""
        return len(self.images)

    def only(self, chosen: NDArray[Any]) -> Pictures:
        """The pictures that an index or mask chooses."""
        masks = self.masks[chosen] if len(self.masks) else self.masks
        return Pictures(
            self.images[chosen], self.points[chosen], self.visible[chosen], masks, self.person[chosen],
            self.attributes[chosen], self.attribute_names,
        )  # fmt: skip


def part_files(folder: Path) -> list[Path]:
    """The parts that `render_people.py` wrote, in order."""
    files = sorted(folder.glob("part_*.npz"))
    if not files:
        raise FileNotFoundError(f"no part_*.npz in {folder}: make them with training/render_people.py")
    return files


def load_parts(folder: Path, *, held_out: bool, limit: int | None = None) -> Pictures:
    """Rendered pictures of the people held out for evaluation, or of all others; limit: that many parts at most."""
    parts = [_load_part(file, held_out) for file in part_files(folder)[:limit]]
    joined = (np.concatenate([getattr(p, name) for p in parts]) for name in _ARRAYS)
    return Pictures(*joined, parts[0].attribute_names)


_ARRAYS = ("images", "points", "visible", "masks", "person", "attributes")


def _load_part(file: Path, held_out: bool) -> Pictures:
    with np.load(file) as part:
        ends = np.cumsum(part["length"])
        wanted = np.flatnonzero((part["person"] % HELD_OUT == 0) == held_out)
        size = part["mask"].shape[1]
        jpeg = part["jpeg"]
        images = np.empty((len(wanted), size, size, 3), np.uint8)
        for k, i in enumerate(wanted):
            begin = ends[i] - part["length"][i]
            images[k] = cv2.imdecode(jpeg[begin : ends[i]], cv2.IMREAD_COLOR)[..., ::-1]
        return Pictures(
            images,
            part["face81"][wanted],
            part["visible"][wanted],
            np.unpackbits(part["mask"][wanted], axis=2),
            np.array([f"r{n:05d}" for n in part["person"][wanted]]),
            part["attributes"][wanted],
            tuple(map(str, part["attribute_names"])),
        )


def load_real(data: Path, *, held_out: bool) -> Pictures:
    """The real pictures that may be trained on, or those of their people that are kept for validation.

    Photographs of pairs/london (CC BY 4.0; people of evaluation_only.txt are never read) and frames of the clips
    real/grid_* (CC BY 4.0), labelled with MediaPipe's points; the ends of the brows, which MediaPipe's mesh does not
    follow, are moved by their mean distance from hand-placed ones.
    """
    rows = [*_london(data / "pairs" / "london", held_out), *_clips(data / "real", held_out)]
    if not rows:
        raise FileNotFoundError(f"no trainable pictures in {data}")
    images, labels, person = zip(*rows, strict=True)
    points = brow_ends(np.stack(labels), data / "pairs" / "london")
    count = len(images)
    empty = np.empty((0, REAL_SIZE, REAL_SIZE), np.uint8)
    return Pictures(
        np.stack(images), points, np.ones(points.shape[:2], bool), empty, np.array(person),
        np.empty((count, 0), np.float32),
    )  # fmt: skip


def london_people(folder: Path) -> list[str]:
    """The people of the photographs that may be trained on, in order."""
    never = set((folder / "evaluation_only.txt").read_text().split())
    return sorted({p.name.split("_")[0] for p in folder.glob("*_neutral.jpg")} - never)


def _london(folder: Path, held_out: bool) -> Iterator[tuple[Any, ...]]:
    with np.load(folder / "face81_mediapipe.npz") as stored:
        labels = {name: stored[name] for name in stored.files}
    people = london_people(folder)
    chosen = people[-VALIDATION_PEOPLE:] if held_out else people[:-VALIDATION_PEOPLE]
    for person in chosen:
        for kind in ("neutral", "smile"):
            name = f"{person}_{kind}"
            points = labels.get(name)
            image = cv2.imread(str(folder / f"{name}.jpg"), cv2.IMREAD_COLOR)
            if points is not None and image is not None:
                yield *square(np.ascontiguousarray(image[..., ::-1]), points), f"london{person}"


def _clips(folder: Path, held_out: bool) -> Iterator[tuple[Any, ...]]:
    files = sorted(f for f in folder.glob("grid_*") if f.suffix != ".npz")
    for file in files[-1:] if held_out else files[:-1]:
        shapes = np.load(file.with_suffix(".landmarks.npz"))["face81"]
        capture = cv2.VideoCapture(str(file))
        for index in range(len(shapes)):
            good, image = capture.read()
            if not good:
                break
            finite = [s for s in shapes[index] if np.isfinite(s).all()]
            if index % EVERY == 0 and finite:
                yield *square(np.ascontiguousarray(image[..., ::-1]), finite[0]), file.stem


def square(image: U8, points: F32, size: int = REAL_SIZE) -> tuple[U8, F32]:
    """The face's surroundings as a square of `size` pixels, and the points (81, 2) in it."""
    low, high = points.min(0), points.max(0)
    scale = REAL_SHARE * size / float((high - low).max())
    shift = (size - 1) / 2 - scale * (low + high) / 2
    matrix = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    if scale < 0.6:  # as area averaging, so that nothing aliases
        image = cv2.GaussianBlur(image, (0, 0), 0.4 / scale)
    picture = cv2.warpAffine(
        image, matrix, (size, size), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return np.asarray(picture, np.uint8), np.asarray(points * scale + shift, np.float32)


# Ends of the brows: points of face81 and the hand-placed points of the photographs between which they lie.
_ENDS = {17: (71, 71), 21: (75, 76), 22: (77, 78), 26: (82, 82)}


def brow_ends(points: F32, folder: Path) -> F32:
    """MediaPipe's points (n, 81, 2) with the ends of the brows moved, as hand-placed points of photographs tell."""
    hand, labels = np.load(folder / "webmorph189_neutral.npz"), np.load(folder / "face81_mediapipe.npz")
    ends = list(_ENDS)
    moves = []
    for person in london_people(folder):
        given = _complex(labels[f"{person}_neutral"])
        placed = _complex(hand[person])
        wanted = np.array([placed[list(pair)].mean() for pair in _ENDS.values()])
        moves.append((wanted - given[ends]) / (given[LEFT_EYE_OUTER] - given[RIGHT_EYE_OUTER]))
    move = np.mean(moves, axis=0)
    move = (move - np.conj(move[::-1])) / 2  # the same on both sides
    shapes = _complex(points)
    shapes[:, ends] += move * (shapes[:, LEFT_EYE_OUTER] - shapes[:, RIGHT_EYE_OUTER])[:, None]
    return np.stack([shapes.real, shapes.imag], axis=-1).astype(np.float32)


def _complex(points: NDArray[Any]) -> NDArray[np.complex128]:
    array = np.asarray(points, np.float64)
    return np.asarray(array[..., 0] + 1j * array[..., 1])
