"""Files of landmarks that grow frame by frame: JSON, npz and iBUG .pts (docs/landmarks.md describes the formats).

A file is written as NAME.part and renamed when it is complete; on any exception it is removed.
Pixels, x right, y down, pixel centres at integers; in .pts files they are counted from 1.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Self, TextIO

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face
from guise.aam.landmarks.annotations import TRACKED_FORMAT, TRACKED_VERSION, pts_bytes, shortest
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.solid_shape import SolidTracker
from guise.app.media import Frame, MediaInput
from guise.common.arrays import F64
from guise.common.errors import OutputError
from guise.common.files import WholeOutput, require_free
from guise.common.version import VERSION

SCHEME = "face81"


@dataclass(frozen=True, eq=False)
class TrackedFace:
    """A face of a frame.

    Parameters
    ----------
    face : Face.
    angles : its yaw, pitch and roll in degrees.
    track : number of its track, which only videos have.
    irises : (2, 3) x, y and radius in pixels, of the person's right eye and of the left one, NaN of a shut eye; None
        when they were not searched.
    """

    face: Face
    angles: tuple[float, float, float]
    track: int | None = None
    irises: F64 | None = None


def head_angles(solid: SolidTracker, face: Face) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a track's next face, degrees."""
    return solid.update(face.points.astype(np.float64)).pose.angles


@dataclass(frozen=True)
class FileHeader:
    """What is the same for all frames of a file: its first lines."""

    source: str
    kind: str
    landmarker: str
    smoothed: bool
    time_base: Fraction

    @classmethod
    def of(cls, source: MediaInput, landmarker: str, *, smoothed: bool) -> FileHeader:
        """The header for an opened input."""
        return cls(source.name, source.kind, landmarker, smoothed, source.time_base)

    def as_json(self) -> dict[str, Any]:
        """The head of a JSON file, and the text in an npz file."""
        return {
            "format": TRACKED_FORMAT,
            "version": TRACKED_VERSION,
            "guise": VERSION,
            "landmarker": self.landmarker,
            "scheme": SCHEME,
            "source": self.source,
            "kind": self.kind,
            "smoothed": self.smoothed,
            "time_base": [self.time_base.numerator, self.time_base.denominator],
        }


class LandmarkFile(WholeOutput):
    """A file of landmarks; by `with` it is complete and renamed, or removed.

    Parameters
    ----------
    path : of the file, or of a folder of .pts files.
    header : see `FileHeader`.
    force : replace an existing one.
    """

    is_folder = False

    def __init__(self, path: Path, header: FileHeader, *, force: bool = False) -> None:
        super().__init__(path, force=force, folder=self.is_folder)
        self.header = header

    def add(self, frame: Frame, found: Sequence[TrackedFace]) -> None:
        """The faces of the next frame."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self._require_free()
        with _as_output_error(self.path):
            self._begin()
        return self

    def complete(self) -> None:
        self._require_free()
        with _as_output_error(self.path):
            self._finish()

    def _require_free(self) -> None:
        """OutputError when nothing may be written there."""
        require_free(self.path, force=self._force)

    def _begin(self) -> None:
        """Make NAME.part, which nobody else may be writing."""
        self.claim()

    def _finish(self) -> None:
        """Complete NAME.part and rename it."""
        self.publish()


class JsonFile(LandmarkFile):
    """One JSON object, a frame on each line, written as the frames come."""

    _text: TextIO

    def _begin(self) -> None:
        super()._begin()
        self._text = self.part.open("w", encoding="utf-8")
        self._text.write(json.dumps(self.header.as_json())[:-1] + ', "frames": [')
        self._count = 0

    def add(self, frame: Frame, found: Sequence[TrackedFace]) -> None:
        entry = {
            "index": frame.index,
            "pts": frame.pts,
            "name": frame.name,
            "width": frame.width,
            "height": frame.height,
            "faces": [_face_entry(one) for one in found],
        }
        with _as_output_error(self.path):
            self._text.write((",\n" if self._count else "\n") + json.dumps(entry, allow_nan=False))
        self._count += 1

    def _finish(self) -> None:
        self._text.write(f'\n], "count": {self._count}}}\n')
        self._text.close()
        super()._finish()

    def discard(self) -> None:
        with contextlib.suppress(AttributeError, OSError):
            self._text.close()
        super().discard()


class NpzFile(LandmarkFile):
    """Arrays over frames and faces, NaN where there is none; kept in memory until the last frame."""

    def _begin(self) -> None:
        super()._begin()
        self._rows: list[tuple[int, tuple[int, int], list[TrackedFace]]] = []

    def add(self, frame: Frame, found: Sequence[TrackedFace]) -> None:
        self._rows.append((frame.pts, (frame.width, frame.height), list(found)))

    def _finish(self) -> None:
        with self.part.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **self._arrays())
        super()._finish()

    def _arrays(self) -> dict[str, NDArray[Any]]:
        columns = face_columns([[one.track for one in found] for _, _, found in self._rows])
        shape = len(self._rows), 1 + max((c for row in columns for c in row), default=-1)
        arrays = {
            "face81": np.full((*shape, 81, 2), np.nan, np.float32),
            "confidence": np.full(shape, np.nan, np.float32),
            "point_confidence": np.full((*shape, 81), np.nan, np.float32),
            "yaw_pitch_roll": np.full((*shape, 3), np.nan, np.float32),
            "irises": np.full((*shape, 2, 3), np.nan, np.float32),
            "box": np.full((*shape, 4), np.nan, np.float32),
            "track": np.full(shape, -1, np.int32),
        }
        for index, ((_, _, found), row) in enumerate(zip(self._rows, columns, strict=True)):
            for one, column in zip(found, row, strict=True):
                _fill(arrays, (index, column), one)
        return arrays | {
            "pts": np.array([pts for pts, _, _ in self._rows], np.int64),
            "size": np.array([size for _, size, _ in self._rows], np.int32).reshape(-1, 2),
            "about": np.array(json.dumps(self.header.as_json())),
        }


class PtsFolder(LandmarkFile):
    """A folder with the 68 iBUG points of each face in a file of its own.

    The largest face of a picture is NAME.pts, further ones are NAME_1.pts, NAME_2.pts; a picture without a face has a
    NAME.pts of no points.  A face of a video's frame is FRAME_TRACK.pts.
    """

    is_folder = True

    def add(self, frame: Frame, found: Sequence[TrackedFace]) -> None:
        for rank, one in enumerate(found):
            number = rank if one.track is None else one.track
            first = one.track is None and rank == 0
            self._write(self._stem(frame) + ("" if first else f"_{number}"), one.face.points[IBUG68])
        if not found and frame.name is not None:
            self._write(self._stem(frame), np.zeros((0, 2), np.float32))

    def _stem(self, frame: Frame) -> str:
        return f"{frame.index:06d}" if frame.name is None else Path(frame.name).stem

    def _write(self, name: str, points: NDArray[np.float32]) -> None:
        file = self.part / f"{name}.pts"
        try:
            with _as_output_error(self.path), file.open("xb") as opened:
                opened.write(pts_bytes(points))
        except FileExistsError as error:
            raise OutputError(
                f"two pictures have a face for {file.name}: rename one of them, or use --format json"
            ) from error

    def _require_free(self) -> None:
        if not self.path.is_dir():
            require_free(self.path, force=self._force)
        elif any(file.suffix.lower() != ".pts" for file in self.path.iterdir()):
            raise OutputError(f"{self.path} holds files other than .pts: choose another folder")
        elif any(self.path.iterdir()) and not self._force:
            raise OutputError(f"{self.path} exists: use --force to replace it, or choose another name")

    def _finish(self) -> None:
        if self.path.is_dir():
            shutil.rmtree(self.path)
        else:
            self.path.unlink(missing_ok=True)
        super()._finish()


class PtsPicture(PtsFolder):
    """The .pts files of one picture, beside each other: OUT.pts, OUT_1.pts, OUT_2.pts."""

    def _stem(self, frame: Frame) -> str:
        return self.path.stem

    def _require_free(self) -> None:
        require_free(self.path, force=self._force)

    def _finish(self) -> None:
        files = sorted(self.part.iterdir())
        for file in files:
            require_free(self.path.with_name(file.name), force=self._force)
        for file in files:
            file.replace(self.path.with_name(file.name))
        self.discard()


def open_landmark_file(
    path: Path, source: MediaInput, header: FileHeader, form: str, *, force: bool
) -> LandmarkFile:
    """The file for a format: "json", "npz" or "pts"; see the classes.

    Raises OutputError for .pts files of a video or a folder that are to go into one file.
    """
    if path.exists() and path.samefile(source.path):
        raise OutputError(f"{path} is the input itself: choose another name for the output")
    if form != "pts":
        return {"json": JsonFile, "npz": NpzFile}[form](path, header, force=force)
    if path.suffix.lower() != ".pts":
        return PtsFolder(path, header, force=force)
    if source.kind != "image":
        raise OutputError(
            f"a .pts file holds one picture, and {source.name} has more: name a folder, such as {path.stem}"
        )
    return PtsPicture(path, header, force=force)


def format_of(path: Path) -> str:
    """The format that a name stands for; without a suffix, a folder of .pts files."""
    form = path.suffix.lower().removeprefix(".") or "pts"
    if form not in ("json", "npz", "pts"):
        raise OutputError(f"{path} must end in .json, .npz or .pts; to use another name, add --format")
    return form


def face_columns(tracks: Sequence[Sequence[int | None]]) -> list[list[int]]:
    """A column for each face of each frame: a track keeps its own, which is free again after its last frame.

    tracks : for each frame the number of each face's track, or None for all.

    >>> face_columns([[0, 1], [1], [1, 2], [None, None]])
    [[0, 1], [1], [1, 0], [0, 1]]
    """
    last = {track: index for index, row in enumerate(tracks) for track in row}
    taken: dict[int | None, int] = {}
    columns = []
    for index, row in enumerate(tracks):
        for track in row:
            if track is not None and track not in taken:
                taken[track] = next(c for c in itertools.count() if c not in taken.values())
        columns.append([rank if track is None else taken[track] for rank, track in enumerate(row)])
        taken = {track: column for track, column in taken.items() if last[track] > index}
    return columns


def _face_entry(one: TrackedFace) -> dict[str, Any]:
    face, confidence = one.face, one.face.point_confidence
    return {
        "track": one.track,
        "confidence": round(face.confidence, 4),
        "box": shortest(face.box),
        "yaw_pitch_roll": [round(angle, 1) for angle in one.angles],
        "irises": None if one.irises is None else [_iris_entry(iris) for iris in one.irises],
        "points": shortest(face.points),
        "point_confidence": None
        if confidence is None
        else np.round(confidence.astype(np.float64), 4).tolist(),
    }


def _iris_entry(iris: F64) -> list[float] | None:
    return [round(float(value), 2) for value in iris] if np.isfinite(iris).all() else None


def _fill(arrays: dict[str, NDArray[Any]], place: tuple[int, int], one: TrackedFace) -> None:
    arrays["face81"][place], arrays["box"][place] = one.face.points, one.face.box
    arrays["confidence"][place], arrays["yaw_pitch_roll"][place] = one.face.confidence, one.angles
    if one.face.point_confidence is not None:
        arrays["point_confidence"][place] = one.face.point_confidence
    if one.irises is not None:
        arrays["irises"][place] = one.irises
    if one.track is not None:
        arrays["track"][place] = one.track


@contextlib.contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
    """A full disk or a lost drive, in one sentence; an existing file is left to the caller."""
    try:
        yield
    except FileExistsError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written ({error.strerror}): nothing was kept") from error
