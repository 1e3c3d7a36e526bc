"""Landmarks of a clip in a file: npz, JSON and iBUG .pts, read and written.

In memory: points (T, 81, 2) float32, pixels, x right, y down, pixel centres at integers, NaN for a frame
without a face. A frame with any point that is not finite counts as one without a face. Where a frame has
several faces the one with the largest box is taken, and :attr:`Annotations.several` counts such frames. Where
faces have the numbers of tracks, one track is taken for all frames: the one with the largest sum of face sizes
(square root of the box's area) over its frames.

npz
    One of the arrays ``face81``, ``landmarks``, ``points``: (T, n, 2) or, with several faces, (T, F, n, 2);
    n = 81 (face81) or 68 (ibug68). ``track``, (T, F) whole numbers, below 0 for none, is read with several
    faces. Other arrays may be there and are not read.
JSON
    ``{"scheme": "face81", "frames": [{"index": 0, "points": [[x, y], ...]}, {"index": 1, "points": null}]}``,
    scheme ``face81`` or ``ibug68``; frames that are not named have no face, an index named again is a further
    face, ``"count"`` (optional) is the number of frames. Or a plain list with an entry per frame, points or
    null, whose scheme follows from the number of points. Or what ``guise landmarks`` writes
    (docs/landmarks.md): ``"format": "guise-landmarks"``, and a list of faces in every frame.
.pts
    One face of one picture, ``n_points: 68`` or 81 (or 0, for none), counted from pixel 1 as iBUG does; 1 is
    subtracted on reading and added on writing. A folder of them is a clip, in natural order of the names
    (``f2.pts`` before ``f10.pts``), or matched by name to given pictures.
"""

from __future__ import annotations

import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from guise.aam.landmarks.face import LandmarkError, NoFaceError, frozen
from guise.aam.landmarks.schemes import COUNT, scheme_named, scheme_of_count, to_face81
from guise.common.arrays import F32, F64, Bool
from guise.common.files import natural_key, write_whole

_NPZ_KEYS = ("face81", "landmarks", "points")
# What a damaged npz file raises: of the zip archive, of its compression and encryption, and of the arrays' headers.
_NOT_READ = (
    OSError, ValueError, EOFError, LookupError, TypeError, zipfile.BadZipFile, NotImplementedError, RuntimeError,
    zlib.error, struct.error, MemoryError, OverflowError, SyntaxError,
)  # fmt: skip
_JSON_KEYS = ("scheme", "frames", "count", "about")

TRACKED_FORMAT, TRACKED_VERSION = "guise-landmarks", 1  # JSON with all faces of all frames

_Faces = list[tuple[int | None, F64]]  # of a frame: the track and the points (n, 2)


@dataclass(frozen=True, eq=False)
class Annotations:
    """Landmarks of a clip.

    Parameters
    ----------
    points : (T, 81, 2) float32
        Pixels, NaN for frames without a face; kept read-only.
    source : str
        Where they come from, for messages.
    scheme : str
        The scheme of the source; other points are completed.
    several : int
        Frames in which a face was there that was not taken.
    taken : str
        Which one was taken, for messages.
    """

    points: F32
    source: str = "landmarks"
    scheme: str = "face81"
    several: int = 0
    taken: str = "the largest"

    def __post_init__(self) -> None:
        """Check the shape, and that there is a face at all."""
        object.__setattr__(self, "points", frozen(self.points))
        shape = self.points.shape
        if len(shape) != 3 or shape[1:] != (COUNT, 2):
            raise LandmarkError(
                f"{self.source} must hold landmarks of shape (frames, {COUNT}, 2), got {shape}"
            )
        if not self.present.any():
            raise NoFaceError(
                f"{self.source} must hold a face in at least one frame, got none in {len(self)} frames"
            )

    def __len__(self) -> int:
        """Number of frames T."""
        return len(self.points)

    @property
    def present(self) -> Bool:
        """Whether a frame has a face (T,)."""
        return np.asarray(np.isfinite(self.points).all(axis=(1, 2)))

    @property
    def note(self) -> str | None:
        """A sentence for the user where several faces were there, else None."""
        if not self.several:
            return None
        return (
            f"{self.source} has several faces in {self.several} frames of {len(self)}; {self.taken} is taken"
        )

    def require_frames(self, count: int) -> Annotations:
        """These annotations, if they are for ``count`` frames; LandmarkError otherwise."""
        if len(self) != count:
            raise LandmarkError(
                f"{self.source} must have landmarks for the {count} frames of the video, got {len(self)}; "
                "give the landmarks of this very video"
            )
        return self


def load_annotations(path: str | Path, images: Sequence[str | Path] | None = None) -> Annotations:
    """Landmarks from an npz, JSON or .pts file or a folder of .pts files (formats: see the module).

    Parameters
    ----------
    path : path
    images : sequence of paths, optional
        Only for a folder: the pictures in order. Each takes the .pts of its name; without one it has no face.

    Returns
    -------
    Annotations
    """
    path = Path(path)
    if path.is_dir():
        return _load_folder(path, images)
    readers = {".npz": _load_npz, ".json": _load_json, ".pts": _load_single}
    if path.suffix.lower() not in readers:
        raise LandmarkError(
            f"landmarks must be a .npz, .json or .pts file or a folder of .pts files, got {path}"
        )
    if not path.is_file():
        raise LandmarkError(f"landmarks expected at {path}, got no such file")
    return readers[path.suffix.lower()](path)


def save_annotations(
    path: str | Path, points: NDArray[Any], scheme: str = "face81", *, overwrite: bool = False
) -> None:
    """Write landmarks; the name's ending chooses the format.

    Parameters
    ----------
    path : path
        ``.npz``, ``.json``, ``.pts`` (one frame) or a name without an ending (a folder of ``.pts``).
    points : (T, 81, 2) or, in another scheme, (T, n, 2) float
        Pixels, NaN for frames without a face.
    scheme : str
    overwrite : bool
        Whether a file may be replaced.
    """
    path, points = Path(path), np.asarray(points, dtype=np.float32)
    count = scheme_named(scheme).count
    if points.ndim != 3 or points.shape[1:] != (count, 2):
        raise LandmarkError(
            f"{scheme} landmarks to save must have shape (frames, {count}, 2), got {points.shape}"
        )
    writers = {".npz": _npz_bytes, ".json": _json_bytes, ".pts": _pts_bytes}
    if path.suffix.lower() not in {*writers, ""}:
        raise LandmarkError(
            f"landmarks are written as .npz, .json, .pts or a folder without an ending, got {path}"
        )
    if path.exists() and not overwrite:
        raise LandmarkError(f"{path} exists already; give another name or allow it to be overwritten")
    if path.suffix:
        _write(path, writers[path.suffix.lower()](points, scheme))
        return
    for index, frame in enumerate(points):
        _write(path / f"{index:06d}.pts", _pts_bytes(frame[None], scheme))


def _load_npz(path: Path) -> Annotations:
    try:
        with path.open("rb") as file, _opened(file) as stored:
            found = [key for key in _NPZ_KEYS if key in stored.files]
            names = ", ".join(stored.files)
            array = stored[found[0]] if found else None
            track = stored["track"] if "track" in stored.files else None
    except _NOT_READ as error:
        raise LandmarkError(
            f"{path} must be an npz file of plain arrays, got one that cannot be read"
        ) from error
    if array is None:
        raise LandmarkError(
            f"{path} must hold one of the arrays {', '.join(_NPZ_KEYS)}, got {names or 'none'}"
        )
    if array.ndim not in {3, 4} or array.shape[-1] != 2 or not np.issubdtype(array.dtype, np.number):
        shape = "(frames, points, 2) or (frames, faces, points, 2)"
        raise LandmarkError(
            f"{found[0]} in {path} must be numbers of shape {shape}, got {array.dtype} {array.shape}"
        )
    if np.issubdtype(array.dtype, np.complexfloating):
        raise LandmarkError(f"{found[0]} in {path} must be real numbers, got {array.dtype}")
    faces = array.astype(np.float64) if array.ndim == 4 else array.astype(np.float64)[:, None]
    scheme = _scheme_for(path, array.shape[-2])
    if track is None:
        return _annotations(path, faces, scheme)
    if track.shape != faces.shape[:2] or not np.issubdtype(track.dtype, np.integer):
        raise LandmarkError(
            f"track in {path} must be whole numbers of shape {faces.shape[:2]}, got {track.dtype} {track.shape}"
        )
    return _annotations(path, faces, scheme, track)


def _opened(file: BinaryIO) -> NpzFile:
    """The arrays of an open npz file; ValueError for one bare array."""
    stored = np.load(file, allow_pickle=False)
    if not isinstance(stored, NpzFile):
        raise ValueError("not an npz file")
    return stored


def _load_json(path: Path) -> Annotations:
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise LandmarkError(f"{path} must be a JSON file, got one that cannot be read: {error}") from error
    if isinstance(stored, list):
        frames = [[] if entry is None else [_points(path, i, entry)] for i, entry in enumerate(stored)]
        return _annotations(path, *_stacked(path, frames, None))
    if isinstance(stored, dict) and stored.get("format") == TRACKED_FORMAT:
        return _tracked(path, stored)
    if (
        not isinstance(stored, dict)
        or set(stored) - set(_JSON_KEYS)
        or not isinstance(stored.get("frames"), list)
    ):
        keys = ", ".join(map(str, stored)) if isinstance(stored, dict) else type(stored).__name__
        raise LandmarkError(
            f"{path} must be a list of frames or an object with scheme and frames, got {keys}"
        )
    scheme = stored.get("scheme")
    if not isinstance(scheme, str):
        raise LandmarkError(f"{path} must name its scheme as face81 or ibug68, got {scheme!r}")
    scheme_named(scheme)
    return _annotations(path, *_stacked(path, _indexed(path, stored), scheme))


def _indexed(path: Path, stored: dict[str, Any]) -> list[list[F64]]:
    """The faces of each frame, from entries with an index."""
    entries = stored["frames"]
    count = _frame_count(path, stored)
    frames: list[list[F64]] = [[] for _ in range(count)]
    for entry in entries:
        if entry["points"] is not None:
            frames[entry["index"]].append(_points(path, entry["index"], entry["points"]))
    return frames


def _tracked(path: Path, stored: dict[str, Any]) -> Annotations:
    """One track of a file with all faces of all frames."""
    scheme, frames = stored.get("scheme"), stored.get("frames")
    if stored.get("version") != TRACKED_VERSION:
        raise LandmarkError(
            f"{path} must have {TRACKED_FORMAT} version {TRACKED_VERSION}, got {stored.get('version')!r}"
        )
    if not isinstance(scheme, str) or not isinstance(frames, list):
        raise LandmarkError(f"{path} must have a scheme and frames, got {', '.join(map(str, stored))}")
    rows = [_tracked_faces(path, index, entry) for index, entry in enumerate(frames)]
    stacked, scheme = _stacked(path, [[points for _, points in row] for row in rows], scheme)
    track = np.full(stacked.shape[:2], -1)
    for index, row in enumerate(rows):
        track[index, : len(row)] = [-1 if number is None else number for number, _ in row]
    return _annotations(path, stacked, scheme, track)


def _tracked_faces(path: Path, index: int, entry: Any) -> _Faces:
    """The faces of one frame, whose place in the list is its index."""
    faces = entry.get("faces") if isinstance(entry, dict) and entry.get("index") == index else None
    if not isinstance(faces, list) or not all(isinstance(face, dict) for face in faces):
        raise LandmarkError(f"{path}: frame {index} must have index {index} and faces, got {_brief(entry)}")
    for face in faces:
        if face.get("track") is not None and not _is_index(face["track"], 2**31):
            raise LandmarkError(
                f"{path}: track of frame {index} must be a whole number or null, got {face['track']!r}"
            )
    return [(face.get("track"), _points(path, index, face.get("points"))) for face in faces]


def _frame_count(path: Path, stored: dict[str, Any]) -> int:
    entries = stored["frames"]
    limit = 100_000 + 100 * len(entries)  # keeps one wild index from filling the memory
    for position, entry in enumerate(entries):
        if not isinstance(entry, dict) or set(entry) != {"index", "points"}:
            got = ", ".join(entry) if isinstance(entry, dict) else type(entry).__name__
            raise LandmarkError(f"{path}: entry {position} of frames must have index and points, got {got}")
        if not _is_index(entry["index"], limit):
            raise LandmarkError(
                f"{path}: index of entry {position} must be a whole number from 0 to {limit - 1}, "
                f"got {entry['index']!r}"
            )
    needed = 1 + max((entry["index"] for entry in entries), default=-1)
    count = stored.get("count", needed)
    if not _is_index(count, limit + 1) or count < needed:
        raise LandmarkError(f"{path}: count must be a whole number from {needed} to {limit}, got {count!r}")
    return int(count)


def _is_index(value: Any, limit: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < limit


def _points(path: Path, index: int, value: Any) -> F64:
    """Points (n, 2) of one frame of a JSON file; null is NaN."""
    try:
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros(0)
    if points.ndim != 2 or points.shape[1] != 2:
        raise LandmarkError(
            f"{path}: points of frame {index} must be a list of [x, y] numbers, got {_brief(value)}"
        )
    return points


def _brief(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _load_single(path: Path) -> Annotations:
    points = _read_pts(path)
    return _annotations(path, *_stacked(path, [[points] if len(points) else []], None))


def _load_folder(path: Path, images: Sequence[str | Path] | None) -> Annotations:
    files = {file.stem: file for file in path.iterdir() if file.suffix.lower() == ".pts"}
    if not files:
        raise LandmarkError(f"folder {path} must hold .pts files, got none")
    names = sorted(files, key=natural_key) if images is None else [Path(image).stem for image in images]
    unused = sorted(set(files) - set(names), key=natural_key)
    if unused:
        raise LandmarkError(
            f"folder {path} must hold .pts files named as the pictures, got {unused[0]}.pts without one"
        )
    read = [_read_pts(files[name]) if name in files else np.zeros((0, 2)) for name in names]
    return _annotations(path, *_stacked(path, [[points] if len(points) else [] for points in read], None))


def _read_pts(path: Path) -> F64:
    """Points (n, 2) of a .pts file, pixels counted from 0."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise LandmarkError(f"{path} must be a readable .pts text file, got: {error}") from error
    match = re.fullmatch(r"(?s)\s*(?:version:\s*\S+\s+)?n_points:\s*([0-9]{1,6})\s*\{([^{}]*)\}\s*", text)
    if match is None:
        raise LandmarkError(
            f"{path} must be 'version: 1', 'n_points: N' and N lines 'x y' in braces, got other text"
        )
    try:
        rows = [[float(word) for word in line.split()] for line in match[2].splitlines() if line.strip()]
    except ValueError as error:
        raise LandmarkError(f"{path} must hold two numbers a line, got: {error}") from error
    if any(len(row) != 2 for row in rows):
        raise LandmarkError(f"{path} must hold two numbers a line, got a line with another number of them")
    if len(rows) != int(match[1]):
        raise LandmarkError(f"{path} must hold the {int(match[1])} points of its header, got {len(rows)}")
    return np.array(rows, dtype=np.float64).reshape(-1, 2) - 1


def _stacked(path: Path, frames: list[list[F64]], scheme: str | None) -> tuple[F64, str]:
    """Faces (T, F, n, 2), NaN-padded, and their scheme, from lists of (n, 2)."""
    counts = {len(points) for faces in frames for points in faces}
    expected = {scheme_named(scheme).count} if scheme else counts
    if not counts:
        raise NoFaceError(f"{path} must hold a face in at least one frame, got none in {len(frames)} frames")
    if counts != expected or len(counts) > 1:
        wanted = f"{expected.pop()} ({scheme})" if scheme else "the same number of"
        raise LandmarkError(
            f"{path} must have {wanted} points in every frame, got {', '.join(map(str, sorted(counts)))}"
        )
    count = counts.pop()
    stacked = np.full((len(frames), max(map(len, frames)), count, 2), np.nan)
    for index, faces in enumerate(frames):
        for face, points in enumerate(faces):
            stacked[index, face] = points
    return stacked, scheme or _scheme_for(path, count)


def _scheme_for(path: Path, count: int) -> str:
    try:
        return scheme_of_count(count).name
    except LandmarkError as error:
        raise LandmarkError(f"{path}: {error}") from error


def _annotations(path: Path, faces: F64, scheme: str, track: NDArray[Any] | None = None) -> Annotations:
    """One face of each frame, of faces (T, F, n, 2): the main track's, or the largest where there are no tracks.

    track : (T, F) numbers, below 0 for none.
    """
    if faces.shape[0] == 0 or faces.shape[1] == 0:
        raise LandmarkError(f"{path} must hold at least one frame, got an array of shape {faces.shape}")
    faces = np.where(np.isfinite(faces).all(axis=(2, 3), keepdims=True), faces, np.nan)
    area = np.prod(faces.max(axis=2) - faces.min(axis=2), axis=-1)
    seen = np.isfinite(area)
    number = None if track is None else _main_track(np.where(seen, track, -1), area)
    if track is not None and number is not None:
        faces = np.where((track == number)[..., None, None], faces, np.nan)
        area = np.where(track == number, area, np.nan)
    largest = np.nan_to_num(area, nan=-1.0).argmax(axis=1)
    chosen = faces[np.arange(len(faces)), largest]
    several = int((seen.sum(axis=1) > np.isfinite(area).any(axis=1)).sum())
    taken = "the largest" if number is None else "the one seen longest and largest"
    return Annotations(to_face81(chosen, scheme), str(path), scheme, several, taken)


def _main_track(track: NDArray[Any], area: F64) -> int | None:
    """The track with the largest sum of sizes, of numbers and areas (T, F); None without tracks."""
    numbers = np.unique(track[track >= 0])
    if not len(numbers):
        return None
    return int(max(numbers, key=lambda number: float(np.sqrt(area[track == number]).sum())))


def _npz_bytes(points: F32, scheme: str) -> bytes:
    buffer = io.BytesIO()
    if scheme == "face81":
        np.savez_compressed(buffer, face81=points)
    else:
        np.savez_compressed(buffer, landmarks=points)
    return buffer.getvalue()


def _json_bytes(points: F32, scheme: str) -> bytes:
    frames = [{"index": i, "points": _listed(frame)} for i, frame in enumerate(points)]
    return json.dumps({"scheme": scheme, "count": len(frames), "frames": frames}, allow_nan=False).encode()


def _listed(frame: F32) -> Any:
    """Points (n, 2) as lists; None without a face."""
    return shortest(frame) if np.isfinite(frame).all() else None


def shortest(values: F32) -> Any:
    """Nested lists of the shortest decimals that give the same float32 back."""
    return values.astype(str).astype(np.float64).tolist()


def _pts_bytes(points: F32, scheme: str) -> bytes:
    del scheme  # a .pts file does not name it
    if len(points) != 1:
        raise LandmarkError(
            f"a .pts file holds the landmarks of one picture, got {len(points)} frames; name a folder"
        )
    return pts_bytes(points[0] if np.isfinite(points[0]).all() else points[0, :0])


def pts_bytes(points: F32) -> bytes:
    """The text of a .pts file, in which the first pixel is 1, for points (n, 2)."""
    rows = [f"{x!r} {y!r}" for x, y in (points.astype(np.float64) + 1).tolist()]
    return "\n".join(["version: 1", f"n_points: {len(rows)}", "{", *rows, "}", ""]).encode()


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content)
    except OSError as error:
        raise LandmarkError(f"landmarks could not be written to {path}: {error.strerror}") from error
