"""Manual correction of a clip's landmarks: move, undo, mirror, propagate to the following frames, save.

A row is a frame of the clip, counted from 0; a frame without a face has NaN points.
Pixels, x right, y down, pixel centres at integers; points face81.
"""

from __future__ import annotations

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
    FaceTracker,
    Landmarker,
    LandmarkError,
    load_annotations,
    open_landmarker,
    tight_box,
)
from guise.aam.landmarks.plausible import is_plausible_motion
from guise.aam.landmarks.schemes import mean_geometry
from guise.aam.similarity import align_planar
from guise.aam.solid_shape import SolidTracker
from guise.app.landmarks.formats import FileHeader, TrackedFace, head_angles, open_landmark_file
from guise.app.media import open_input
from guise.common.arrays import F32, F64, U8, Bool
from guise.common.files import write_arrays
from guise.common.progress import Progress
from guise.common.threads import one_thread

DETECTED, PROPAGATED, CORRECTED = 0, 1, 2  # where the points of a row come from
_UNIFORM = np.full(COUNT, 1 / COUNT)


@dataclass(frozen=True)
class CorrectionLimits:
    """When a face counts, and which rows are doubtful."""

    min_confidence: float = 0.5  # of a face that is taken from the landmarker
    min_certain_confidence: float = 0.9  # below it, a row is doubtful
    max_relative_residual: float = 3.0  # to the clip's median; above it, a row is doubtful
    shape_modes: int = 10  # that describe the shapes of one person
    clip_parts: int = 10  # each is described by the modes of the parts that are not next to it


LIMITS = CorrectionLimits()


@dataclass(frozen=True, eq=False)
class LandmarkEdit:
    """A change of the rows from `first` on that can be undone.

    before, after : (k, 81, 2) points.   origins_before, origins_after : (k,) their origins.
    label : consecutive edits with the same label count as one; "" for none.
    """

    first: int
    before: F32
    after: F32
    origins_before: U8
    origins_after: U8
    label: str = ""

    @property
    def rows(self) -> slice:
        """The rows that change."""
        return slice(self.first, self.first + len(self.before))


class Correction:
    """The landmarks of a clip while they are being corrected.

    Parameters
    ----------
    points : (t, 81, 2) float32, pixels.
    found : (t, 81, 2) float32, the points before any correction.
    origin : (t,) uint8: DETECTED, PROPAGATED or CORRECTED.
    confidence : (t,) float32 in [0, 1], of the detected points; NaN without a face.
    pts : (t,) time stamps of the frames.
    """

    def __init__(self, points: F32, found: F32, origin: U8, confidence: F32, pts: NDArray[np.int64]) -> None:
        self.points, self.origin, self.pts = points.copy(), origin.copy(), pts
        self.found, self.confidence = found, confidence
        with one_thread():
            self.residual = shape_residuals(found)
        self._edits: list[LandmarkEdit] = []
        self._undone: list[LandmarkEdit] = []
        self._saved: LandmarkEdit | None = None

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.points)

    @property
    def unsaved(self) -> bool:
        """Whether there are changes since the last `mark_saved`."""
        return (self._edits[-1] if self._edits else None) is not self._saved

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._edits)

    @property
    def can_redo(self) -> bool:
        """Whether there is a change to redo."""
        return bool(self._undone)

    @property
    def doubtful(self) -> Bool:
        """(t,) rows to check: no face, a low confidence, or a shape unlike the person's others."""
        known = self.residual[np.isfinite(self.residual)]
        limit = LIMITS.max_relative_residual * float(np.median(known)) if len(known) else np.inf
        doubt = ~(self.confidence >= LIMITS.min_certain_confidence) | (np.nan_to_num(self.residual) > limit)
        return np.asarray(doubt & (self.origin == DETECTED))

    def has_face(self, row: int) -> bool:
        """Whether a row has points."""
        return bool(np.isfinite(self.points[row]).all())

    def move(self, row: int, point: int, to: ArrayLike) -> None:
        """Move a point to `to` (2,), pixels."""
        self._require_face(row)
        after = self.points[row].copy()
        after[point] = to
        self._correct(row, after)

    def nudge(self, row: int, point: int, by: ArrayLike) -> None:
        """Move a point by (2,) pixels; consecutive nudges of one point are undone together."""
        self._require_face(row)
        after = self.points[row].copy()
        after[point] += np.asarray(by, np.float32)
        self._correct(row, after, f"nudge {row} {point}")

    def mirror(self, row: int, point: int) -> None:
        """Copy the correction of the side of the face on which `point` lies to the other side.

        What is copied is the displacement of each point from where it was found, reflected at the face's own axis, so
        that a turned head keeps its shape.  LandmarkError for a point on the axis.
        """
        self._require_face(row)
        side = _SIDE[point]
        if side == 0:
            raise LandmarkError(
                "this point lies on the axis of the face: choose one on the side to copy from"
            )
        if not np.isfinite(self.found[row]).all():
            raise LandmarkError("no face was found in this frame, so there is no correction to copy")
        after = self.points[row].copy()
        other = side == -_SIDE
        displacement = (self.points[row] - self.found[row])[list(MIRROR)] @ reflection(self.found[row]).T
        after[other] = (self.found[row] + displacement)[other]
        self._correct(row, after)

    def reset(self, row: int) -> None:
        """Restore a row to what was found."""
        self._apply(row, self.found[row][None], DETECTED)

    def clear(self, row: int) -> None:
        """Leave a row out of training."""
        self._correct(row, np.full((COUNT, 2), np.nan, np.float32))

    def borrow(self, row: int) -> None:
        """Copy the points of the nearest row that has some."""
        there = np.flatnonzero(np.isfinite(self.points).all((1, 2)))
        there = there[there != row]
        if not len(there):
            raise LandmarkError("no other frame has points to copy")
        self._correct(row, self.points[there[np.abs(there - row).argmin()]])

    def propagation_end(self, row: int) -> int:
        """The row before which propagation from `row` stops: the next corrected one, or the end."""
        later = np.flatnonzero(self.origin[row + 1 :] == CORRECTED)
        return row + 1 + int(later[0]) if len(later) else len(self)

    def propagate(self, first: int, points: F32) -> None:
        """Give the rows from `first` on propagated points (k, 81, 2)."""
        if len(points):
            self._apply(first, points, PROPAGATED)

    def undo(self) -> int | None:
        """Undo the last change and return its row; None when there is none."""
        if not self._edits:
            return None
        edit = self._edits.pop()
        self._undone.append(edit)
        self.points[edit.rows], self.origin[edit.rows] = edit.before, edit.origins_before
        return edit.first

    def redo(self) -> int | None:
        """Redo the change that was undone last and return its row; None when there is none."""
        if not self._undone:
            return None
        edit = self._undone.pop()
        self._edits.append(edit)
        self.points[edit.rows], self.origin[edit.rows] = edit.after, edit.origins_after
        return edit.first

    def mark_saved(self) -> None:
        """Remember that the current state is saved."""
        self._saved = self._edits[-1] if self._edits else None

    def _require_face(self, row: int) -> None:
        if not self.has_face(row):
            raise LandmarkError("this frame has no points: copy those of the nearest frame first")

    def _correct(self, row: int, after: F32, label: str = "") -> None:
        self._apply(row, after[None], CORRECTED, label)

    def _apply(self, first: int, after: F32, origin: int, label: str = "") -> None:
        rows = slice(first, first + len(after))
        before, origins_before = self.points[rows].copy(), self.origin[rows].copy()
        last = self._edits[-1] if self._edits else None
        if last is not None and label and last.label == label and last is not self._saved:
            self._edits.pop()
            before, origins_before = last.before, last.origins_before
        origins_after = np.full(len(after), origin, np.uint8)
        self._edits.append(LandmarkEdit(first, before, after.copy(), origins_before, origins_after, label))
        self._undone.clear()
        self.points[rows], self.origin[rows] = after, origins_after


def reflection(points: ArrayLike) -> F64:
    """(2, 2) linear map that takes a displacement on one side of a face (81, 2) to the other side."""
    shape = np.asarray(points, np.float64)
    flipped = shape[list(MIRROR)] * [-1, 1]
    a, b, _, _ = align_planar(flipped, shape, _UNIFORM)
    return np.asarray(np.array([[a, -b], [b, a]]) @ np.diag([-1.0, 1.0]) / np.hypot(a, b))


def shape_residuals(points: F32) -> F64:
    """How much the shape of each row (t, 81, 2) differs from the others; (t,), NaN without a face.

    Root mean square distance, in face sizes, to the best combination of the first modes of the frames that are not
    nearby, so that an error over several frames cannot explain itself.
    """
    there = np.isfinite(points).all((1, 2))
    result = np.full(len(points), np.nan)
    shapes = _aligned(points[there].astype(np.float64))
    rest = np.zeros(len(shapes))
    length = -(-len(shapes) // LIMITS.clip_parts)
    for first in range(0, len(shapes), max(length, 1)):
        part = slice(first, first + length)
        away = np.r_[shapes[: max(0, first - length // 2)], shapes[first + length + length // 2 :]]
        modes = np.linalg.eigh(away.T @ away)[1][:, -LIMITS.shape_modes :]
        rest[part] = ((shapes[part] - shapes[part] @ modes @ modes.T) ** 2).sum(1)
    result[there] = np.sqrt(rest / COUNT)
    return result


def propagated(landmarker: Landmarker, pictures: Iterable[U8], start: F32) -> Iterator[F32]:
    """Points (81, 2) of the frames after a corrected one, until the face is lost.

    The landmarker tracks the face from the corrected points.  Their difference from its own points in the first frame
    is added to each frame, rotated and scaled with the face.

    pictures : RGB (h, w, 3), from the corrected frame on.   start : (81, 2) its points.
    """
    rest = iter(pictures)
    seen = landmarker.refine(next(rest), Face.around(start, 1.0))
    if seen is None:
        return
    first, correction = seen.points.astype(np.float64), start - seen.points
    for picture in rest:
        face = landmarker.refine(picture, seen)
        if (
            face is None
            or face.confidence < LIMITS.min_confidence
            or not is_plausible_motion(seen.points, face.points)
        ):
            return
        moved = align_planar(first, face.points.astype(np.float64), _UNIFORM)
        yield np.asarray(face.points + correction @ moved.linear, np.float32)
        seen = face


def find_landmarks(clip: Path, output: Path, landmarker: Landmarker, progress: Progress) -> int:
    """Write the landmarks of a clip with one face, as `guise landmarks` does; returns how many frames have the face.

    LandmarkError when none has.
    """
    count = 0
    with open_input(clip) as source, one_thread():
        about = FileHeader.of(source, landmarker.name, smoothed=False)
        tracker, total = FaceTracker(landmarker, LIMITS.min_confidence), source.frame_count or 1
        solid = SolidTracker()
        with open_landmark_file(output, source, about, "npz", force=True) as file:
            for frame in source:
                face = tracker.update(frame.rgb())
                file.add(frame, [] if face is None else [TrackedFace(face, head_angles(solid, face), 0)])
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
    """Read the landmarks from a file of `find_landmarks` or `save_correction`."""
    points = load_annotations(path).points
    with np.load(path) as stored:
        arrays = dict(stored)
    found = arrays.get("found", points)
    origin = arrays["origin"] if "origin" in arrays else np.zeros(len(points), np.uint8)
    return Correction(points, found, origin, arrays["confidence"][:, 0], arrays["pts"])


def save_correction(path: Path, correction: Correction) -> None:
    """Write the landmarks to the file they came from; `load_annotations` and `guise enroll` read it.

    In addition to what `guise landmarks` writes, it holds `found` (t, 81, 2) and `origin` (t,), see `Correction`.
    """
    with np.load(path) as stored:
        arrays = dict(stored)
    points = correction.points
    there = np.isfinite(points).all((1, 2))
    arrays["face81"] = points[:, None]
    arrays["box"] = np.array([tight_box(p) for p in points], np.float32)[:, None]
    arrays["track"] = np.where(there, 0, -1).astype(np.int32)[:, None]
    arrays |= {"found": correction.found, "origin": correction.origin}
    write_arrays(path, arrays)
    correction.mark_saved()


def _aligned(shapes: F64) -> F64:
    """Shapes (t, 81, 2) without position, size and rotation, less their median; (t, 162)."""
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
