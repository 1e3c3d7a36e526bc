"""Landmarks: of pictures, and of videos with the times and the tracks of their faces."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, Unpack, overload

import numpy as np

from guise.aam.landmarks import Face, Landmarker, open_landmarker
from guise.aam.landmarks.schemes import COUNT
from guise.api.options import AnyPath, WatchOptions, encoding
from guise.api.pictures import as_array, path_of
from guise.api.vocabulary import call, speaking, watch_of
from guise.common.arrays import F64
from guise.common.closing import Closing
from guise.common.errors import GuiseError
from guise.common.threads import one_thread

if TYPE_CHECKING:
    import pandas

    from guise.api.pictures import Picture
    from guise.app.landmarks.file import LandmarkReport
    from guise.app.landmarks.formats import TrackedFace


@dataclass(frozen=True, eq=False)
class VideoFace(Face):
    """A face of a picture, or of a frame of a video.

    Parameters
    ----------
    track : its number, the same in all frames of a video in which it is followed, or None.
    angles : yaw, pitch and roll, degrees.
    irises : (2, 3) x, y and radius in pixels, of the person's right eye and of the left one; NaN of a shut eye.
    """

    track: int | None = None
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0)
    irises: F64 | None = None


class FrameFaces(list[VideoFace]):
    """The faces of a frame, in the order of their tracks.   frame : its number, from 0.   seconds : its time."""

    def __init__(self, faces: list[VideoFace], frame: int, seconds: float) -> None:
        super().__init__(faces)
        self.frame, self.seconds = frame, seconds


class VideoLandmarks(Closing, Iterator[FrameFaces]):
    """The faces of a video or image, frame by frame, found while they are asked for; once through."""

    def __init__(self, video: Path, landmarker: Landmarker, min_confidence: float, smooth: bool) -> None:
        self._frames = _frames(video, landmarker, min_confidence, smooth)

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> FrameFaces:
        with speaking:
            return next(self._frames)

    def close(self) -> None:
        """Read no more frames."""
        self._frames.close()

    def to_arrays(self) -> dict[str, np.ndarray[Any, Any]]:
        """The faces of all frames that are left, a row for each: frame, seconds, track (-1 for none), confidence,
        angles (n, 3) and points (n, 81, 2)."""
        rows = [(faces, face) for faces in self for face in faces]
        return {
            "frame": np.array([faces.frame for faces, _ in rows], np.int32),
            "seconds": np.array([faces.seconds for faces, _ in rows], np.float64),
            "track": np.array([-1 if face.track is None else face.track for _, face in rows], np.int32),
            "confidence": np.array([face.confidence for _, face in rows], np.float32),
            "angles": np.array([face.angles for _, face in rows], np.float64).reshape(-1, 3),
            "points": np.array([face.points for _, face in rows], np.float32).reshape(-1, COUNT, 2),
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """The same as a table of pandas: angles as yaw, pitch and roll, points as x0, y0, x1, ..."""
        try:
            import pandas
        except ModuleNotFoundError as error:
            raise GuiseError(
                'a table needs pandas: pip install "guise-video[tables]", or use to_arrays()'
            ) from error
        found = self.to_arrays()
        angles, points = found.pop("angles"), found.pop("points")
        columns = dict(found) | dict(zip(("yaw", "pitch", "roll"), angles.T, strict=True))
        columns |= {f"{axis}{n}": points[:, n, k] for n in range(COUNT) for k, axis in enumerate("xy")}
        return pandas.DataFrame(columns)


class LandmarkFileOptions(WatchOptions, total=False):
    """How a file of landmarks is written.

    encoder, crf : of the overlay, see `WriteOptions`.
    """

    encoder: str
    crf: int | None


@overload
def landmarks(
    picture: Picture, *, landmarker: str = "builtin", detector: str | None = None, min_confidence: float = 0.5
) -> list[VideoFace]: ...
@overload
def landmarks(
    picture: AnyPath,
    *,
    landmarker: str = "builtin",
    detector: str | None = None,
    min_confidence: float = 0.5,
    smooth: bool = True,
) -> VideoLandmarks: ...
@call
def landmarks(
    picture: Picture | AnyPath,
    *,
    landmarker: str = "builtin",
    detector: str | None = None,
    min_confidence: float = 0.5,
    smooth: bool = True,
) -> list[VideoFace] | VideoLandmarks:
    """The 81 landmarks of every face.

    Parameters
    ----------
    picture : RGB uint8 (h, w, 3) or `PIL.Image`, or the path of a video, an image or a folder of images.
    landmarker : "builtin" or "CARD.toml[@DETECTOR]".   detector : "lbp", "yunet:PATH", "centerface:PATH", or its own.
    min_confidence : in [0, 1]; faces below are left out.
    smooth : over the frames of a video.

    Returns
    -------
    list of `VideoFace`, largest first, for a picture; for a path an iterator over such lists, one for each frame, with
    tracks; `to_arrays()` and `to_dataframe()` give all of them at once.
    """
    from guise.app.landmarks.file import VideoFaces
    from guise.app.media import Frame

    finder = open_landmarker(landmarker + (f"@{detector}" if detector else ""))
    if isinstance(picture, str | os.PathLike):
        return VideoLandmarks(Path(picture), finder, min_confidence, smooth)
    find = VideoFaces(finder, moves=False, min_confidence=min_confidence, smooth=False)
    with one_thread():
        return [_as_video_face(one) for one in find(Frame.from_rgb(as_array(picture)))]


@call
def landmarks_file(
    video: AnyPath,
    output: AnyPath,
    *,
    overlay: AnyPath | None = None,
    format: Literal["json", "npz", "pts"] | None = None,
    landmarker: str = "builtin",
    detector: str | None = None,
    min_confidence: float = 0.5,
    smooth: bool = True,
    overwrite: bool = False,
    **options: Unpack[LandmarkFileOptions],
) -> LandmarkReport:
    """Write the landmarks of all faces to a file; parameters as for `landmarks`.

    output : .json, .npz, .pts or a folder of .pts files.   overlay : a copy of the video with them drawn on it.
    """
    from guise.app.landmarks.file import LandmarkOptions
    from guise.app.landmarks.file import landmarks_file as write

    left: dict[str, Any] = {**options}
    progress, say = watch_of(left)
    encode = encoding(left)
    how = LandmarkOptions(format, path_of(overlay), min_confidence, smooth, encode, overwrite)
    finder = open_landmarker(landmarker + (f"@{detector}" if detector else ""))
    return write(Path(video), Path(output), finder, how, progress=progress, say=say)


def _frames(
    video: Path, landmarker: Landmarker, min_confidence: float, smooth: bool
) -> Generator[FrameFaces]:
    from guise.app.landmarks.file import VideoFaces
    from guise.app.media import open_input

    with open_input(video) as media:
        moves = media.kind == "video"
        find = VideoFaces(landmarker, moves, min_confidence, smooth and moves)
        for frame in media:
            with one_thread():
                found = find(frame)
            yield FrameFaces([_as_video_face(one) for one in found], frame.index, frame.seconds)


def _as_video_face(one: TrackedFace) -> VideoFace:
    return VideoFace(**vars(one.face), track=one.track, angles=one.angles, irises=one.irises)
