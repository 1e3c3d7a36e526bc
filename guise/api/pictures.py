"""Pictures and people as a user has them: arrays, `PIL.Image`, files and names."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import NDArray

from guise.aam.model import Identity
from guise.api.options import AnyPath
from guise.common.arrays import U8
from guise.common.errors import GuiseError

if TYPE_CHECKING:
    from PIL.Image import Image

    Picture: TypeAlias = NDArray[Any] | Image  # of OpenCV, too, whose arrays have no certain type

Person: TypeAlias = Identity | AnyPath


def paths(given: AnyPath | Sequence[AnyPath]) -> list[Path]:
    """One path, or several."""
    return [Path(given)] if isinstance(given, str | os.PathLike) else [Path(path) for path in given]


def path_of(given: AnyPath | None) -> Path | None:
    """A path, or none."""
    return None if given is None else Path(given)


def is_picture(given: Any) -> TypeGuard[Picture]:
    """Whether it is an array or a `PIL.Image`, and no path."""
    return not isinstance(given, str | os.PathLike) and (
        isinstance(given, np.ndarray) or hasattr(given, "getexif")
    )


def as_array(picture: Picture) -> U8:
    """A picture as RGB uint8 (h, w, 3); one of PIL as it is shown.  GuiseError for anything else."""
    if isinstance(picture, np.ndarray):
        if picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3:
            return picture
        raise GuiseError(
            f"a frame must be an RGB array (h, w, 3) of uint8, got {picture.shape} {picture.dtype}"
        )
    if not hasattr(picture, "getexif"):
        raise GuiseError(f"a frame must be an RGB array (h, w, 3) of uint8, got {type(picture).__name__}")
    from PIL import ImageOps

    return np.asarray(ImageOps.exif_transpose(picture).convert("RGB"), np.uint8)


@contextlib.contextmanager
def as_files(given: Sequence[AnyPath | Picture]) -> Iterator[list[Path]]:
    """Files, or folders of images for clips (n, h, w, 3), of what is given; of arrays they last as long as the context.

    Nobody else may read them.
    """
    from guise.app.media.pictures import save_picture

    with tempfile.TemporaryDirectory(prefix="guise-") as folder:
        found = []
        for number, one in enumerate(given, 1):
            place = Path(folder, f"picture{number}.png")
            if not is_picture(one):
                found.append(Path(one))  # type: ignore[arg-type]
                continue
            if isinstance(one, np.ndarray) and one.ndim == 4:
                place = Path(folder, f"clip{number}")
                place.mkdir()
                for index, frame in enumerate(one):
                    save_picture(place / f"{index:06}.png", as_array(frame))
            else:
                save_picture(place, as_array(one))
            found.append(place)
        yield found


def identity_of(person: Person) -> Identity:
    """A model, or that of a file NAME.guise, a photo, somebody who is kept, or a fictional person."""
    from guise.app.swapping.donors import open_face

    return person if isinstance(person, Identity) else open_face(os.fspath(person))


@contextlib.contextmanager
def as_names(faces: dict[str, Person]) -> Iterator[dict[str, str]]:
    """By person, faces as the engine takes them: by name or file; models are files as long as the context lasts."""
    with tempfile.TemporaryDirectory(prefix="guise-") as folder:
        names = {}
        for number, (who, face) in enumerate(faces.items(), 1):
            names[who] = (
                os.fspath(face) if not isinstance(face, Identity) else str(Path(folder, f"{number}.guise"))
            )
            if isinstance(face, Identity):
                face.save(Path(names[who]))
        yield names
