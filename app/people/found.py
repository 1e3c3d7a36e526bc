"""The people that are found in a video, and those of a photo.

Pixels as shown, x right, y down; boxes ``x0 y0 x1 y1`` of the 68 iBUG points; frames counted from 0.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import tight_box
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.heads import region
from guise.aam.landmarks.rolls import turn_of
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.recognition import SIGNATURE_RESOLUTION, signature_of
from guise.aam.reference import ReferenceFrame
from guise.app.media import Frame
from guise.common.arrays import F32, F64, I32, U8
from guise.common.files import write_arrays

FIRST_FRAMES = 30  # that say where somebody is first seen
THUMBNAIL_PIXELS = 160
MIN_CONFIDENCE = 0.5  # of somebody's face in a photo


@dataclass(frozen=True, eq=False)
class VideoPerson:
    """A person in a video, a row for each frame in which they are seen.

    Parameters
    ----------
    number : from 1, in the order of appearance; larger faces first.
    frames, boxes, turns, points, confidence : (n,) ascending, (n, 4), (n,) radians, (n, 81, 2) or NaN, (n,) of the
        points.
    signature : (64,).
    thumbnail : (h, h, 3) of the clearest frame.
    """

    number: int
    frames: I32
    boxes: F32
    turns: F32
    points: F32
    confidence: F32
    signature: F32
    thumbnail: U8

    @property
    def width(self) -> float:
        """Median width of the face, pixels."""
        return float(np.median(self.boxes[:, 2] - self.boxes[:, 0]))

    @property
    def first_x(self) -> float:
        """Place across the picture where they are first seen, pixels."""
        return float(np.median(self.boxes[:FIRST_FRAMES, [0, 2]].mean(1)))

    def landmarks(self, count: int) -> F64:
        """(count, 81, 2) of every frame of the video; NaN where they are not seen."""
        rows = np.full((count, *self.points.shape[1:]), np.nan)
        rows[self.frames] = self.points
        return rows


@dataclass(frozen=True, eq=False)
class UnknownFaces:
    """Faces that are nobody's for certain: (m,) frames, ascending; (m, 4) boxes; (m,) scores; (m,) turns."""

    frames: I32
    boxes: F32
    scores: F32
    turns: F32


@dataclass(frozen=True, eq=False)
class VideoPeople:
    """All people of a video, the faces that are nobody's, the first frames of new shots, and the number of frames."""

    people: tuple[VideoPerson, ...]
    unknown: UnknownFaces
    cuts: tuple[int, ...]
    count: int


def people_in_photo(frame: Frame) -> VideoPeople:
    """The people in a single picture, larger faces first."""
    faces = [face for face in BuiltinLandmarker().detect(frame.rgb()) if face.confidence >= MIN_CONFIDENCE]
    sampler = ReferenceFrame.canonical(SIGNATURE_RESOLUTION).sampler
    people = []
    for number, face in enumerate(sorted(faces, key=lambda one: float(one.box[0] - one.box[2])), 1):
        points = face.points.astype(np.float64)
        box = tight_box(face.points[IBUG68])
        people.append(
            VideoPerson(
                number, np.zeros(1, np.int32), box[None], np.array([turn_of(points)], np.float32), face.points[None],
                np.array([face.confidence], np.float32), signature_of(frame.sample_rgb(sampler.positions(points))),
                head_picture(frame, box, THUMBNAIL_PIXELS),
            )
        )  # fmt: skip
    nothing = np.zeros(0, np.float32)
    nobody = UnknownFaces(np.zeros(0, np.int32), np.zeros((0, 4), np.float32), nothing, nothing)
    return VideoPeople(tuple(people), nobody, (), 1)


def save_people(path: Path, found: VideoPeople) -> None:
    """Write what was found, as arrays."""
    arrays: dict[str, NDArray[Any]] = {"cuts": np.array(found.cuts, np.int32), "count": np.array(found.count)}
    for place, part in enumerate((found.unknown, *found.people)):
        arrays |= {f"{place}.{name}": np.asarray(value) for name, value in vars(part).items()}
    write_arrays(path, arrays, compressed=False)


def load_people(path: Path) -> VideoPeople:
    """What `save_people` has written."""
    with np.load(path, allow_pickle=False) as file:
        arrays = dict(file)
    parts: dict[int, dict[str, Any]] = defaultdict(dict)
    for key, value in arrays.items():
        place, _, name = key.partition(".")
        if name:
            parts[int(place)][name] = value
    people = [
        VideoPerson(**one | {"number": int(one["number"])}) for place, one in parts.items() if place > 0
    ]
    cuts = tuple(arrays["cuts"].tolist())
    return VideoPeople(tuple(people), UnknownFaces(**parts[0]), cuts, int(arrays["count"]))


def head_picture(frame: Frame, box: F32, side: int) -> U8:
    """A square picture (side, side, 3) of the head with a face's box (4,); grey beyond the frame."""
    x0, y0, x1, y1 = region(box)
    length = max(x1 - x0, y1 - y0)
    left, top, scale = (x0 + x1 - length) / 2, (y0 + y1 - length) / 2, side / length
    matrix = np.array([[scale, 0, -left * scale], [0, scale, -top * scale]])
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(
        cv2.warpAffine(frame.quick_rgb(), matrix, (side, side), flags=how, borderValue=(64, 64, 64)), np.uint8
    )
