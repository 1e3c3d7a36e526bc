"""Landmarks of a clip corrected by hand: moved, undone, mirrored, carried to the frames that follow, saved.

A row is a frame of the clip, counted from 0; a frame without a face has NaN points.
Pixels, x right, y down, pixel centres at integers; points face81.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from guise.aam.landmarks import (
    COUNT,
    MIRROR,
    Face,
    Follower,
    Landmarker,
    LandmarkError,
    load_annotations,
    open_landmarker,
    tight_box,
)
from guise.aam.landmarks.face import Image
from guise.aam.landmarks.plausible import followed
from guise.aam.landmarks.schemes import mean_geometry
from guise.aam.similarity import align_planar
from guise.app.landmarks.formats import About, Found, open_landmark_file
from guise.app.media import open_source
from guise.common.arrays import F32, F64
from guise.common.files import write_whole
from guise.common.progress import Progress
from guise.common.threads import one_thread

FOUND, CARRIED, CORRECTED = 0, 1, 2  # where the points of a row come from
CONFIDENT = 0.5  # from which the landmarker's face is taken
UNSURE = 0.9  # confidence below which a row is doubtful
STRANGE = 3  # median residuals above which a row is doubtful
_MODES = 10  # in which the shapes of one person differ
_PARTS = 10  # of a clip, each described by the modes of the others that are not near by
_EVEN = np.full(COUNT, 1 / COUNT)


@dataclass(frozen=True, eq=False)
class Step:
    """A change of the rows from `first` on, which can be undone.

    before, after : (k, 81, 2) points.   was, now : (k,) their origins.
    label : steps that follow each other with the same one are one step; "" for none.
    """

    first: int
    before: F32
    after: F32
    was: NDArray[np.uint8]
    now: NDArray[np.uint8]
    label: str = ""

    @property
    def rows(self) -> slice:
        """The rows that change."""
        return slice(self.first, self.first + len(self.before))


class Correction:
    """The landmarks of a clip while they are corrected.

    Parameters
    ----------
    points : (t, 81, 2) float32, pixels.
    found : (t, 81, 2) float32, as they were before any correction.
    origin : (t,) uint8: FOUND, CARRIED or CORRECTED.
    confidence : (t,) float32 in [0, 1], of what was found; NaN without a face.
    pts : (t,) time stamps of the frames.
    """

    def __init__(
        self, points: F32, found: F32, origin: NDArray[np.uint8], confidence: F32, pts: NDArray[np.int64]
    ) -> None:
        self.points, self.origin, self.pts = points.copy(), origin.copy(), pts
        self.found, self.confidence = found, confidence
        with one_thread():
            self.residual = strangeness(found)
        self._done: list[Step] = []
        self._undone: list[Step] = []
        self._saved: Step | None = None

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.points)

    @property
    def unsaved(self) -> bool:
        """Whether there are changes that `saved` was not told of."""
        return (self._done[-1] if self._done else None) is not self._saved

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether there is a change to do again."""
        return bool(self._undone)

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(t,) rows that somebody should look at: no face, an unsure one, or one unlike the person's others."""
        known = self.residual[np.isfinite(self.residual)]
        limit = STRANGE * float(np.median(known)) if len(known) else np.inf
        doubt = ~(self.confidence >= UNSURE) | (np.nan_to_num(self.residual) > limit)
        return np.asarray(doubt & (self.origin == FOUND))

    def has_face(self, row: int) -> bool:
        """Whether a row has points."""
        return bool(np.isfinite(self.points[row]).all())

    def move(self, row: int, point: int, to: ArrayLike) -> None:
        """Put a point at `to` (2,), pixels."""
        self._require_face(row)
        after = self.points[row].copy()
        after[point] = to
        self._correct(row, after)

    def nudge(self, row: int, point: int, by: ArrayLike) -> None:
        """Move a point by (2,) pixels; nudges of one point that follow each other are undone together."""
        self._require_face(row)
        after = self.points[row].copy()
        after[point] += np.asarray(by, np.float32)
        self._correct(row, after, f"nudge {row} {point}")

    def mirror(self, row: int, point: int) -> None:
        """Give the other side of the face the correction of the side on which `point` is.

        What is copied is the way of each point from where it was found, reflected at the face's own axis, so that a
        turned head keeps its shape.  LandmarkError for a point on the axis.
        """
        self._require_face(row)
        side = _SIDE[point]
        if side == 0:
            raise LandmarkError("this point is on the axis of the face: choose one of the side to copy from")
        if not np.isfinite(self.found[row]).all():
            raise LandmarkError("no face was found in this frame, so there is no correction to copy")
        after = self.points[row].copy()
        other = side == -_SIDE
        way = (self.points[row] - self.found[row])[list(MIRROR)] @ reflection(self.found[row]).T
        after[other] = (self.found[row] + way)[other]
        self._correct(row, after)

    def reset(self, row: int) -> None:
        """Put a row back to what was found."""
        self._do(row, self.found[row][None], FOUND)

    def clear(self, row: int) -> None:
        """Leave a row out: no model learns from it."""
        self._correct(row, np.full((COUNT, 2), np.nan, np.float32))

    def borrow(self, row: int) -> None:
        """Give a row the points of the nearest one that has some."""
        there = np.flatnonzero(np.isfinite(self.points).all((1, 2)))
        there = there[there != row]
        if not len(there):
            raise LandmarkError("no other frame has points that could be copied")
        self._correct(row, self.points[there[np.abs(there - row).argmin()]])

    def carried_until(self, row: int) -> int:
        """The row at which points that are carried on from `row` must stop: the next corrected one, or the end."""
        later = np.flatnonzero(self.origin[row + 1 :] == CORRECTED)
        return row + 1 + int(later[0]) if len(later) else len(self)

    def carry(self, first: int, points: F32) -> None:
        """Give the rows from `first` on points (k, 81, 2) that were carried there."""
        if len(points):
            self._do(first, points, CARRIED)

    def undo(self) -> int | None:
        """Take the last change back, and return its row; None when there is none."""
        if not self._done:
            return None
        step = self._done.pop()
        self._undone.append(step)
        self.points[step.rows], self.origin[step.rows] = step.before, step.was
        return step.first

    def redo(self) -> int | None:
        """Do the change again that was undone last, and return its row; None when there is none."""
        if not self._undone:
            return None
        step = self._undone.pop()
        self._done.append(step)
        self.points[step.rows], self.origin[step.rows] = step.after, step.now
        return step.first

    def saved(self) -> None:
        """Remember that what is there now is saved."""
        self._saved = self._done[-1] if self._done else None

    def _require_face(self, row: int) -> None:
        if not self.has_face(row):
            raise LandmarkError("this frame has no points: copy those of the nearest frame first")

    def _correct(self, row: int, after: F32, label: str = "") -> None:
        self._do(row, after[None], CORRECTED, label)

    def _do(self, first: int, after: F32, origin: int, label: str = "") -> None:
        rows = slice(first, first + len(after))
        before, was = self.points[rows].copy(), self.origin[rows].copy()
        last = self._done[-1] if self._done else None
        if last is not None and label and last.label == label and last is not self._saved:
            self._done.pop()
            before, was = last.before, last.was
        now = np.full(len(after), origin, np.uint8)
        self._done.append(Step(first, before, after.copy(), was, now, label))
        self._undone.clear()
        self.points[rows], self.origin[rows] = after, now


def reflection(points: ArrayLike) -> F64:
    """(2, 2) linear map that takes a way on one side of a face (81, 2) to that on the other."""
    shape = np.asarray(points, np.float64)
    flipped = shape[list(MIRROR)] * [-1, 1]
    a, b, _, _ = align_planar(flipped, shape, _EVEN)
    return np.asarray(np.array([[a, -b], [b, a]]) @ np.diag([-1.0, 1.0]) / np.hypot(a, b))


def strangeness(points: F32) -> F64:
    """How unlike its others the shape of each row (t, 81, 2) is; (t,), NaN without a face.

    Root mean square distance, in sizes of the face, to the best sum of the first modes of the frames that are not near
    by, so that a slip cannot explain itself.
    """
    there = np.isfinite(points).all((1, 2))
    result = np.full(len(points), np.nan)
    shapes = _aligned(points[there].astype(np.float64))
    rest = np.zeros(len(shapes))
    length = -(-len(shapes) // _PARTS)
    for first in range(0, len(shapes), max(length, 1)):
        part = slice(first, first + length)
        away = np.r_[shapes[: max(0, first - length // 2)], shapes[first + length + length // 2 :]]
        modes = np.linalg.eigh(away.T @ away)[1][:, -_MODES:]
        rest[part] = ((shapes[part] - shapes[part] @ modes @ modes.T) ** 2).sum(1)
    result[there] = np.sqrt(rest / COUNT)
    return result


def carried(landmarker: Landmarker, pictures: Iterable[Image], start: F32) -> Iterator[F32]:
    """Points (81, 2) of the frames after a corrected one, until the face is lost.

    The landmarker follows the face from the corrected points; how these differ from what it sees itself in the first
    frame goes along, turned and scaled with the face.

    pictures : RGB (h, w, 3), from the corrected frame on.   start : (81, 2) its points.
    """
    rest = iter(pictures)
    seen = landmarker.refine(next(rest), Face.around(start, 1.0))
    if seen is None:
        return
    first, own = seen.points.astype(np.float64), start - seen.points
    for picture in rest:
        face = landmarker.refine(picture, seen)
        if face is None or face.confidence < CONFIDENT or not followed(seen.points, face.points):
            return
        a, b, _, _ = align_planar(first, face.points.astype(np.float64), _EVEN)
        yield np.asarray(face.points + own @ np.array([[a, b], [-b, a]]), np.float32)
        seen = face


def find_landmarks(clip: Path, output: Path, landmarker: Landmarker, progress: Progress) -> int:
    """Write the landmarks of the one face of a clip, as `guise landmarks` does; returns how many frames have it.

    LandmarkError when none has.
    """
    count = 0
    with open_source(clip) as source, one_thread():
        about = About.of(source, landmarker.name, smoothed=False)
        follower, total = Follower(landmarker, CONFIDENT), source.frame_count or 1
        with open_landmark_file(output, source, about, "npz", force=True) as file:
            for frame in source:
                face = follower.step(frame.rgb())
                file.add(frame, [] if face is None else [Found(face, 0)])
                count += face is not None
                progress("landmarks", min(1.0, (frame.index + 1) / total))
            if not count:
                raise LandmarkError(
                    "no face was found in the clip: use one that shows the face from the front"
                )
    return count


def landmarks_job(about: dict[str, Any], folder: Path, progress: Progress) -> dict[str, Any]:
    """Find the landmarks of a clip; about : "clip" and "output", paths."""
    part = folder / "landmarks.npz"
    count = find_landmarks(Path(about["clip"]), part, open_landmarker("builtin"), progress)
    part.replace(about["output"])
    return {"frames": count}


def load_correction(path: Path) -> Correction:
    """The landmarks of a file of `find_landmarks` or `save_correction`."""
    points = load_annotations(path).points
    with np.load(path) as stored:
        arrays = dict(stored)
    found = arrays.get("found", points)
    origin = arrays["origin"] if "origin" in arrays else np.zeros(len(points), np.uint8)
    return Correction(points, found, origin, arrays["confidence"][:, 0], arrays["pts"])


def save_correction(path: Path, correction: Correction) -> None:
    """Write the landmarks to the file that they came from; `load_annotations` and `guise enroll` read it.

    Beside what `guise landmarks` writes it holds `found` (t, 81, 2) and `origin` (t,), see `Correction`.
    """
    with np.load(path) as stored:
        arrays = dict(stored)
    points = correction.points
    there = np.isfinite(points).all((1, 2))
    arrays["face81"] = points[:, None]
    arrays["box"] = np.array([tight_box(p) for p in points], np.float32)[:, None]
    arrays["track"] = np.where(there, 0, -1).astype(np.int32)[:, None]
    arrays |= {"found": correction.found, "origin": correction.origin}
    content = _npz(arrays)
    write_whole(path, lambda part: part.write_bytes(content))
    correction.saved()


def _npz(arrays: dict[str, NDArray[Any]]) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def _aligned(shapes: F64) -> F64:
    """Shapes (t, 81, 2) without place, size and turn, less their median; (t, 162)."""
    z = shapes[..., 0] + 1j * shapes[..., 1]
    z = z - z.mean(-1, keepdims=True)
    z /= np.sqrt((np.abs(z) ** 2).mean(-1, keepdims=True))
    z *= np.exp(-1j * np.angle((np.conj(mean_geometry().mean) * z).sum(-1, keepdims=True)))
    flat = np.concatenate([z.real, z.imag], axis=1)
    return flat - np.median(flat, axis=0) if len(flat) else flat


def _sides() -> NDArray[np.intp]:
    """(81,) 1 for points of the person's left side, -1 of the right, 0 on the axis."""
    away = np.sign(mean_geometry().mean.real).astype(int)
    return np.where(np.arange(COUNT) == MIRROR, 0, away)


_SIDE = _sides()
