"""Expressions of one photo, or of a clip, on another photo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from guise.api.options import AnyPath, WatchOptions, WriteOptions, encoding
from guise.api.pictures import path_of
from guise.api.vocabulary import call, watch_of

if TYPE_CHECKING:
    from guise.app.photos.animate import AnimateReport
    from guise.app.photos.image import ImageReport


class AnalogyCallOptions(WatchOptions, total=False):
    """How an expression is transferred to a photo.

    strength : of the expression, 0 to 2; 1 is as it is.   method : vertex "tents", or what they are compared with.
    open_mouth : what an opening mouth shows: "fill", teeth and tongue of the expressive photo, or "none".
    landmarks_s, landmarks_t : files of those of the neutral photo and of the target; by default they are detected.
    """

    method: Literal["tents", "ratio", "warp"]
    open_mouth: Literal["fill", "none"]
    strength: float
    landmarker: str | None
    landmarks_s: AnyPath | None
    landmarks_t: AnyPath | None
    overwrite: bool


class TransferPhotoOptions(AnalogyCallOptions, total=False):
    """The same for two photos.

    landmarks_s1 : of the expressive photo.   picture : a file of all four in a row.
    """

    landmarks_s1: AnyPath | None
    picture: AnyPath | None


class AnimatePhotoOptions(AnalogyCallOptions, WriteOptions, total=False):
    """The same for a clip.

    source : model of the person in it, a file or a name, for tracking; or landmarks, a file of those of the clip.
    """

    source: AnyPath | None
    landmarks: AnyPath | None


@call
def transfer_photo(
    neutral: AnyPath,
    expressive: AnyPath,
    target: AnyPath,
    output: AnyPath,
    **options: Unpack[TransferPhotoOptions],
) -> ImageReport:
    """Carry the expression between two photos of one person over to a photo of another, wrinkles and shading included.

    Parameters
    ----------
    neutral, expressive : photos of one person, at rest and with the expression.   target : of another, at rest.
    output : the target with the expression, of the target's size.
    options : `TransferPhotoOptions`.
    """
    from guise.app.photos.image import analogy_image

    left: dict[str, Any] = {**options}
    _, say = watch_of(left)
    montage = path_of(left.pop("picture", None))
    files: Any = {role: path_of(left.pop(f"landmarks_{role}", None)) for role in ("s", "s1", "t")}
    return analogy_image(
        Path(neutral), Path(expressive), Path(target), Path(output), _analogy(left), landmarks=files, montage=montage,
        say=say,
    )  # fmt: skip


@call
def animate_photo(
    clip: AnyPath,
    target: AnyPath,
    output: AnyPath,
    *,
    neutral: AnyPath | None = None,
    **options: Unpack[AnimatePhotoOptions],
) -> AnimateReport:
    """Animate a photo with the expressions of the person in a clip, and its sound.

    Parameters
    ----------
    target : a photo of another person, at rest.   output : the video.
    neutral : a photo of the person in the clip, at rest; by default the most neutral frame.
    options : `AnimatePhotoOptions`.
    """
    import os

    from guise.app.photos.animate import animate_file
    from guise.app.photos.driving_track import TrackingOptions

    left: dict[str, Any] = {**options}
    progress, say = watch_of(left)
    encode = encoding(left)
    files: Any = {role: path_of(left.pop(f"landmarks_{role}", None)) for role in ("s", "t")}
    source, points = left.pop("source", None), path_of(left.pop("landmarks", None))
    how = _analogy(left)
    tracking = TrackingOptions(None if source is None else os.fspath(source), how.landmarker, points)
    return animate_file(
        path_of(neutral), Path(clip), Path(target), Path(output), how, tracking, landmarks=files, encode=encode,
        progress=progress, say=say,
    )  # fmt: skip


def _analogy(left: dict[str, Any]) -> Any:
    from guise.app.photos.options import AnalogyOptions
    from guise.common.option import made

    if "open_mouth" in left:
        left["mouth"] = left.pop("open_mouth")
    return made(AnalogyOptions, force=left.pop("overwrite", False), **left)
