"""Faces: learned, opened by name, described, and kept on this computer."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

from guise.aam.model import Identity
from guise.api.options import AnyPath, TrainOptions, WatchOptions
from guise.api.pictures import as_files, identity_of, is_picture, path_of, paths
from guise.api.vocabulary import call, watch_of
from guise.common.errors import GuiseError

if TYPE_CHECKING:
    from guise.aam.training import TrainingOptions
    from guise.api.pictures import Picture
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.people.found import VideoPeople
    from guise.app.people.info import ModelInfo
    from guise.app.people.kept import KeptPerson
    from guise.common.progress import Progress, Say


class EnrollOptions(TrainOptions, WatchOptions, total=False):
    """How somebody is enrolled, beside what `enroll` names."""


@call
def enroll(
    clips: AnyPath | Picture | Sequence[AnyPath | Picture],
    *,
    name: str | None = None,
    landmarks: AnyPath | Sequence[AnyPath] = (),
    landmarker: str | None = None,
    person: int | None = None,
    rest: float | None = None,
    refine: bool | None = None,
    output: AnyPath | None = None,
    keep: bool = False,
    overwrite: bool = False,
    **options: Unpack[EnrollOptions],
) -> Identity:
    """Learn a person's face from clips or photos; `Identity.save` writes it to a file.

    Parameters
    ----------
    clips : a clip of one person who talks and turns the head a little, or a photo; or several.  Files, folders of
        images, pictures as arrays (h, w, 3) or `PIL.Image`, and clips as arrays (n, h, w, 3).
    name : the person's name in the model; the first clip's file name by default.
    landmarks : landmark files (.npz, .json, .pts), one for each clip; by default those that lie beside the clips under
        their names, and otherwise points that `landmarker` finds.
    landmarker : "builtin" or "CARD.toml[@DETECTOR]", an ONNX model of your own.
    person : which one of a clip that shows several, a number of `find_people`.
    rest : seconds into the first clip at which the face is at rest; by default a guess.
    refine : refine detected landmarks over all frames together; by default unless the landmarker is built in.
    output : a file NAME.guise that is written as well.
    keep : keep the person on this computer under their name, so that the name is enough from then on.
    overwrite : replace an existing output.
    options : `EnrollOptions`.

    Raises
    ------
    GuiseError
        When a clip cannot be read or shows no face that could be learned.
    """
    from guise.app.people.kept import place_for
    from guise.common.files import require_free

    left: dict[str, Any] = {**options}
    progress, say = watch_of(left)
    several = (
        [clips] if is_picture(clips) or not isinstance(clips, Sequence) or isinstance(clips, str) else clips
    )
    if not several:
        raise GuiseError("enrollment needs at least one clip, got none")
    if output is not None:
        require_free(Path(output), force=overwrite)
    with as_files(several) as files:
        points = _Points(paths(landmarks), landmarker, person, refine)
        called = name or files[0].stem
        place = place_for(called) if keep else None
        found = _learned(files, points, called, _training(left, files[0], rest), progress, say)
    for path in filter(None, (path_of(output), place)):
        found.save(path)
    return found


class _Points(NamedTuple):
    """Where the landmarks of clips come from, as `enroll` takes it."""

    files: list[Path]
    landmarker: str | None
    person: int | None
    refine: bool | None


def _learned(
    files: list[Path], points: _Points, name: str, options: TrainingOptions, progress: Progress, say: Say
) -> Identity:
    """The model of the person in clips, or in photos."""
    from guise.app.enrolment.enrol import enrol
    from guise.app.photos.enrol_photos import are_photos

    source = _source(points.files, points.landmarker, points.refine, len(files))
    if not are_photos(files):
        return enrol(
            files, source, name=name, person=points.person, options=options, progress=progress, say=say
        )
    if points.files or points.landmarker or points.person or points.refine is not None:
        raise GuiseError(
            "photos are enrolled by the built-in landmarker: leave landmarks, landmarker, person and refine out"
        )
    return _in_photos(files, name, options, progress, say)


def _training(options: dict[str, Any], clip: Path, rest: float | None) -> TrainingOptions:
    """How the model is made.   rest : seconds into the clip at which the face is at rest, if that is known."""
    from guise.app.enrolment.options import TrainingChoices
    from guise.app.enrolment.rest import frame_at
    from guise.common.option import made

    training = made(TrainingChoices, **options).training()
    return training if rest is None else replace(training, rest_frame=frame_at(clip, rest).index)


def _in_photos(
    files: Sequence[Path], name: str, options: TrainingOptions, progress: Progress, say: Say
) -> Identity:
    from guise.app.photos.enrol_photos import enrol_photos

    with tempfile.TemporaryDirectory(prefix="guise-") as folder:
        made = Path(folder, "photo.guise")
        enrol_photos(files, made, name=name, options=options, progress=progress, say=say)
        return Identity.load(made)


def _source(files: list[Path], landmarker: str | None, refine: bool | None, clips: int) -> LandmarkSource:
    from guise.aam.landmarks import open_landmarker
    from guise.app.enrolment.landmark_source import LandmarkSource

    if files and landmarker is not None:
        raise GuiseError("give either landmarks or a landmarker")
    if files and len(files) != clips:
        raise GuiseError(f"landmarks must be one file for each of the {clips} clips, got {len(files)}")
    own = None if landmarker in (None, "builtin") else open_landmarker(str(landmarker))
    return LandmarkSource(files, own, refine=refine)


@call
def load(face: AnyPath) -> Identity:
    """The model of a face: a file NAME.guise, a photo, somebody who is kept, or a fictional person, such as "Mei".

    Raises
    ------
    GuiseError
        When there is none, or its file is damaged or of another version.
    """
    return identity_of(face)


def gallery() -> tuple[str, ...]:
    """The names of the fictional people that come with Guise, each of whom may be given wherever a face is."""
    from guise.app.swapping.donors import FIRST_NAMES

    return tuple(FIRST_NAMES.values())


@call
def info(face: AnyPath, *, picture: AnyPath | None = None, overwrite: bool = False) -> ModelInfo:
    """What a model holds.

    face : as for `load`.   picture : a file that is written, of the mean, the neutral face and the modes.
    """
    import os

    from guise.app.people.info import describe
    from guise.app.swapping.donors import face_file
    from guise.common.files import require_free

    if picture is not None:
        require_free(Path(picture), force=overwrite)
    with face_file(os.fspath(face)) as path:
        identity, facts = describe(path)
    if picture is not None:
        from guise.app.media.pictures import save_picture
        from guise.app.people.montage import montage

        save_picture(Path(picture), montage(identity))
    return facts


@call
def find_people(
    video: AnyPath, *, output: AnyPath | None = None, overwrite: bool = False, **options: Unpack[WatchOptions]
) -> VideoPeople:
    """Who is seen in a video: `people` with their numbers, frames, boxes and pictures.

    The numbers are those that `enroll(person=...)` and `swap_file(map=...)` take.

    output : a picture of them that is written.
    """
    from guise.app.media import open_input
    from guise.app.media.pictures import save_picture
    from guise.app.people.finding import find_people as find
    from guise.app.people.finding import people_sheet
    from guise.common.files import require_free

    progress, _ = watch_of({**options})
    if output is not None:
        require_free(Path(output), force=overwrite)
    with open_input(Path(video)) as media:
        found = find(media, lambda share: progress("faces", share))
    if output is not None and found.people:
        save_picture(Path(output), people_sheet(found))
    return found


def people() -> list[KeptPerson]:
    """Everybody who is kept on this computer: name, origin, file, and since when.  The models are biometric data."""
    from guise.app.people.kept import everybody

    return everybody()


@call
def rename_person(name: str, new: str) -> KeptPerson:
    """Give somebody who is kept another name."""
    from guise.app.swapping.donors import rename_kept

    return rename_kept(name, new)


@call
def delete_people(names: str | Iterable[str] = (), *, all: bool = False) -> list[KeptPerson]:
    """Delete the models of people who are kept, by name or `all` of them; returns who they were."""
    from guise.app.people.kept import delete, everybody

    given = [names] if isinstance(names, str) else list(names)
    if bool(given) == all:
        raise GuiseError("give the names of the people to delete, or all=True")
    return delete([person.name for person in everybody()] if all else given)
