"""People by their embeddings: those of a gallery folder, and those of the original."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Landmarker
from guise.app.measure.faces import FacesByFrame, FaceTrack, MeasureError, files_by_person
from guise.app.measure.privacy import Threshold, template, threshold
from guise.app.media import MediaError, MediaInput, open_input
from guise.app.people.recogniser import Recogniser
from guise.common.arrays import F32, F64
from guise.common.progress import Say

GALLERY_VIDEO_FRAMES = 20  # about so many are used of a video


@dataclass(frozen=True, eq=False)
class Subject:
    """A person with known faces: name, and unit embeddings (n, d), n > 0."""

    name: str
    embeddings: F32

    @property
    def template(self) -> F64:
        """(d,) with which other faces are compared."""
        return template(self.embeddings)


def open_gallery(folder: Path, landmarker: Landmarker, recogniser: Recogniser, say: Say) -> list[Subject]:
    """The people of a folder: each picture or video in it is a person, and each folder in it is one.

    Files without a face and unreadable files are reported and left out; MeasureError when nobody is left.
    """
    if not folder.is_dir():
        raise MeasureError(
            f"a gallery must be a folder with a picture, video or folder for each person, got {folder}"
        )
    people = []
    for name, files in files_by_person(folder).items():
        found = [e for file in files for e in embeddings_of(file, landmarker, recogniser, say)]
        if found:
            people.append(Subject(name, np.stack(found)))
    if not people:
        raise MeasureError(
            f"no face found in the gallery {folder}: give a folder of pictures or videos of people"
        )
    return people


def embeddings_of(file: Path, landmarker: Landmarker, recogniser: Recogniser, say: Say) -> list[F32]:
    """Embeddings (d,) of the largest face in a picture, or in some frames of a video."""
    try:
        with open_input(file) as media:
            found = list(_sampled_embeddings(media, landmarker, recogniser))
    except MediaError as error:
        say(f"left out of the gallery: {error}")
        return []
    if not found:
        say(f"left out of the gallery: no face found in {file.name}")
    return found


def _sampled_embeddings(media: MediaInput, landmarker: Landmarker, recogniser: Recogniser) -> list[F32]:
    stride = max(1, (media.frame_count or 1) // GALLERY_VIDEO_FRAMES)
    found = []
    for frame in media:
        if frame.index % stride:
            continue
        rgb = frame.rgb()
        faces = [face for face in landmarker.detect(rgb) if face.confidence >= 0.5]
        vector = recogniser(rgb, faces[0].points) if faces else None
        if vector is not None:
            found.append(vector)
    return found


def impostor_scores(people: Sequence[Subject]) -> F64:
    """Cosines of every embedding with the template of every other person, (pairs,)."""
    templates = np.stack([one.template for one in people])
    parts = [(one.embeddings @ np.delete(templates, own, axis=0).T).ravel() for own, one in enumerate(people)]
    return np.concatenate(parts).astype(np.float64)


@dataclass(frozen=True, eq=False)
class Gallery:
    """The people among whom a person is searched.

    people : those that are not in the original.   impostors : (pairs,) scores.
    limit : the score from which two faces are taken for one person; None with fewer than two people.
    """

    people: tuple[Subject, ...]
    impostors: F64
    limit: Threshold | None

    @classmethod
    def of(cls, people: Sequence[Subject]) -> Gallery:
        """The gallery of some people, all of them different."""
        impostors = impostor_scores(people) if len(people) > 1 else np.zeros(0)
        return cls(tuple(people), impostors, threshold(impostors) if len(impostors) else None)

    @property
    def usable_limit(self) -> Threshold | None:
        """The threshold, if there are enough people for it."""
        return self.limit if self.limit and self.limit.enough else None

    def without(self, own: F64, say: Say) -> Gallery:
        """The gallery without those who look like a person of the original with template `own` (d,)."""
        if self.usable_limit is None:
            return self
        same = [one for one in self.people if float(one.template @ own) > self.usable_limit.score]
        for one in same:
            say(f"{one.name} of the gallery looks like a person of the original and is left out")
        rest = tuple(one for one in self.people if one not in same)
        return Gallery(rest, self.impostors, self.limit)


def embeddings_in(media: MediaInput, faces: Sequence[FaceTrack], recogniser: Recogniser) -> list[F32]:
    """For each face the embeddings (n, d) in its frames of a video, NaN where there is none."""
    at = FacesByFrame(faces)
    found: list[list[NDArray[Any]]] = [[] for _ in faces]
    nothing = np.full(recogniser.dimension, np.nan, np.float32)
    for frame in media:
        known = at[frame.index]
        rgb = frame.rgb() if known else None
        for number, points in known:
            assert rgb is not None
            vector = recogniser(rgb, points)
            found[number].append(nothing if vector is None else vector)
    return [np.array(rows, np.float32).reshape(-1, recogniser.dimension) for rows in found]


def group_people(
    faces: Sequence[FaceTrack], embeddings: Sequence[F32], limit: Threshold | None
) -> list[list[int]]:
    """Indices of the faces of each person: faces whose templates are more similar than the threshold.

    A face joins the first group that it is like, unless it shares a frame with one of the group.
    """
    groups: list[list[int]] = []
    templates = [template(rows[np.isfinite(rows).all(1)]) if len(rows) else None for rows in embeddings]
    for number, own in enumerate(templates):
        home = next((g for g in groups if limit and _like(number, own, g, faces, templates, limit)), None)
        if home is None:
            groups.append([number])
        else:
            home.append(number)
    return groups


def _like(
    number: int, own: F64 | None, group: list[int], faces: Sequence[FaceTrack], templates: Sequence[F64 | None],
    limit: Threshold,
) -> bool:  # fmt: skip
    """Whether a face is like one of a group and is never seen together with one of them."""
    apart = all(not len(np.intersect1d(faces[number].frames, faces[k].frames)) for k in group)
    others = [t for k in group if (t := templates[k]) is not None]
    return apart and own is not None and any(float(own @ t) > limit.score for t in others)
