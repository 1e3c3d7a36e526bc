"""Reads what the landmarker and the detector are trained on: rendered parts, and real pictures that may be trained on.

Pixels, x right, y down, pixel centres at integers; images RGB uint8.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.parsing import FACE_FRAMING, Framing
from guise.common.arrays import F32, I32, U8, Bool

HELD_OUT = 10  # rendered people whose number is a multiple of this are for evaluation only
REAL_SIZE = 208  # pixels, the side of a real picture's square
REAL_MARGIN = 1.29  # of that square, in sides of the crop that it is for
EVERY = 5  # a clip gives every fifth frame
VALIDATION_PEOPLE = 8  # people of the photographs that are kept for validation


class Packed:
    """Pictures of one size kept as the bytes of their files, decoded one at a time on access.

    Parameters
    ----------
    codes : bytes of each file, uint8
    colour : decode to RGB (h, w, 3), else to one channel (h, w)
    """

    def __init__(self, codes: Sequence[U8], colour: bool) -> None:
        self._codes, self._colour = list(codes), colour

    def __len__(self) -> int:
        """Return the number of pictures."""
        return len(self._codes)

    def __getitem__(self, index: int) -> U8:
        """Return picture `index`, decoded."""
        flag = cv2.IMREAD_COLOR_RGB if self._colour else cv2.IMREAD_GRAYSCALE
        return np.asarray(cv2.imdecode(self._codes[index], flag), np.uint8)

    def only(self, chosen: NDArray[Any]) -> Packed:
        """The pictures that an index array or a mask chooses."""
        return Packed([self._codes[i] for i in np.arange(len(self))[chosen]], self._colour)

    @classmethod
    def join(cls, several: Sequence[Packed]) -> Packed:
        """All pictures of several, in order."""
        return cls([code for packed in several for code in packed._codes], several[0]._colour)


@dataclass(frozen=True, eq=False)
class Labelled:
    """One picture with the labels known for its face.

    Parameters
    ----------
    image : (h, w, 3) uint8 RGB
    points, visible : (81, 2) float32 pixels, (81,) bool
    mask : (h, w) uint8, 1 on the person; None where unknown
    labels : (k h, k w) uint8 classes of `parsing_labels`; None where unknown
    iris : (2, 3) float32 centre and radius in pixels, the person's right eye first; None where unknown
    """

    image: U8
    points: F32
    visible: Bool
    mask: U8 | None = None
    labels: U8 | None = None
    iris: F32 | None = None


@dataclass(frozen=True, eq=False)
class Pictures:
    """Square pictures with one known face each.

    Parameters
    ----------
    images : n pictures (size, size, 3) uint8
    points : (n, 81, 2) float32 pixels
    visible : (n, 81) bool
    masks : (n, size, size / 8) uint8, packed bits, 1 on the person; None where unknown
    person : (n,) str
    attributes : (n, k) float32 and their names; k = 0 where unknown
    labels : n pictures (k size, k size) of classes; None where unknown
    iris : (n, 2, 3) float32 pixels; None where unknown
    pose : (n, 3) float32 yaw, pitch, roll in degrees; None where unknown
    """

    images: Packed | U8
    points: F32
    visible: Bool
    masks: U8 | None
    person: NDArray[Any]
    attributes: F32
    attribute_names: tuple[str, ...] = ()
    labels: Packed | None = None
    iris: F32 | None = None
    pose: F32 | None = None

    def __len__(self) -> int:
        """Return the number of pictures."""
        return len(self.images)

    def __getitem__(self, index: int) -> Labelled:
        """Return picture `index` with its labels."""
        return Labelled(
            self.images[index], self.points[index], self.visible[index],
            None if self.masks is None else np.unpackbits(self.masks[index], axis=1),
            None if self.labels is None else self.labels[index],
            None if self.iris is None else self.iris[index],
        )  # fmt: skip

    def only(self, chosen: NDArray[Any]) -> Pictures:
        """The pictures that an index or mask chooses."""

        def part(field: Any) -> Any:
            return (
                field.only(chosen) if isinstance(field, Packed) else None if field is None else field[chosen]
            )

        return replace(self, **{name: part(getattr(self, name)) for name in _FIELDS})


_FIELDS = ("images", "points", "visible", "masks", "person", "attributes", "labels", "iris", "pose")


def part_files(folder: Path) -> list[Path]:
    """The parts that `render_people.py` wrote, in order."""
    files = sorted(folder.glob("part_*.npz"))
    if not files:
        raise FileNotFoundError(f"no part_*.npz in {folder}: make them with training/render_people.py")
    return files


def load_parts(folder: Path, *, held_out: bool, limit: int | None = None) -> Pictures:
    """Rendered pictures of the people held out for evaluation, or of all others; limit: that many parts at most."""
    return join([load_part(file, held_out) for file in part_files(folder)[:limit]])


def join(parts: Sequence[Pictures]) -> Pictures:
    """All pictures of several rendered parts; an attribute that a part does not know is 0 there."""
    names = tuple(dict.fromkeys(name for p in parts for name in p.attribute_names))
    columns: dict[str, Any] = {}
    for field in _FIELDS:
        values = [getattr(p, field) for p in parts]
        if field == "attributes":
            values = [_attributes(p, names) for p in parts]
        columns[field] = Packed.join(values) if isinstance(values[0], Packed) else np.concatenate(values)
    return Pictures(**columns, attribute_names=names)


def _attributes(part: Pictures, names: tuple[str, ...]) -> F32:
    known = dict(zip(part.attribute_names, part.attributes.T, strict=True))
    return np.stack([known.get(name, np.zeros(len(part), np.float32)) for name in names], axis=1)


_BROW_UP, _BROW_DOWN = "eyebrows-{}-up", "eyebrows-{}-down"


def load_part(file: Path, held_out: bool) -> Pictures:
    """One file's pictures of the people held out for evaluation, or of all others."""
    with np.load(file) as part:
        wanted = np.flatnonzero((part["person"] % HELD_OUT == 0) == held_out)
        names = [str(n) for n in part["expression_names"]]
        moved = part["expression"].astype(np.float32)

        def either(pattern: str) -> F32:
            return np.max([moved[:, names.index(pattern.format(side))] for side in ("left", "right")], axis=0)

        attributes = np.column_stack([part["attributes"], either(_BROW_UP), either(_BROW_DOWN)])
        return Pictures(
            Packed(_codes(part["jpeg"], part["length"], wanted), colour=True),
            part["face81"][wanted],
            part["visible"][wanted],
            part["mask"][wanted],
            np.array([f"r{n:05d}" for n in part["person"][wanted]]),
            attributes[wanted].astype(np.float32),
            (*map(str, part["attribute_names"]), "brows_up", "brows_down"),
            Packed(_codes(part["labels"], part["labels_length"], wanted), colour=False),
            part["iris"][wanted],
            part["pose"][wanted],
        )


def _codes(joined: U8, lengths: I32, wanted: NDArray[Any]) -> list[U8]:
    ends = np.cumsum(lengths)
    return [joined[ends[i] - lengths[i] : ends[i]].copy() for i in wanted]


def by_hands(pictures: Pictures) -> tuple[Pictures, Pictures]:
    """The pictures without and with a hand that was rendered before the face."""
    value = dict(zip(pictures.attribute_names, pictures.attributes.T, strict=True))
    held = value.get("hand", np.zeros(len(pictures))) > 0.5
    return pictures.only(~held), pictures.only(held)


def load_real(data: Path, *, held_out: bool, framing: Framing = FACE_FRAMING) -> Pictures:
    """The real pictures that may be trained on, or those of their people that are kept for validation.

    Photographs of pairs/london (CC BY 4.0; people of evaluation_only.txt are never read) and frames of the clips
    real/grid_* (CC BY 4.0), labelled with MediaPipe's points; the ends of the brows, which MediaPipe's mesh does not
    follow, are moved by their mean distance from hand-placed ones.

    framing : of the crops that they are for.
    """
    found = chain(_london(data / "pairs" / "london", held_out), _clips(data / "real", held_out))
    rows = [(*square(image, points, framing), person) for image, points, person in found]
    if not rows:
        raise FileNotFoundError(f"no trainable pictures in {data}")
    images, labels, person = zip(*rows, strict=True)
    points = brow_ends(np.stack(labels), data / "pairs" / "london")
    return Pictures(
        np.stack(images), points, np.ones(points.shape[:2], bool), None, np.array(person),
        np.empty((len(images), 0), np.float32),
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
                yield np.ascontiguousarray(image[..., ::-1]), points, f"london{person}"


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
                yield np.ascontiguousarray(image[..., ::-1]), finite[0], file.stem


def square(image: U8, points: F32, framing: Framing = FACE_FRAMING) -> tuple[U8, F32]:
    """The face's surroundings as a square of REAL_SIZE pixels, and the points (81, 2) in it."""
    size = REAL_SIZE
    low, high = points.min(0), points.max(0)
    scale = size / (REAL_MARGIN * framing.side * float((high - low).max()))
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
