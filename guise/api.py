"""The Python API: what the commands do, for arrays and paths.

`import guise` gives all of it as `guise.enroll`, `guise.Swapper`, ...; docs/api.md is the tour.  Pictures are RGB uint8
(h, w, 3).  Paths may be text or `Path`.  Outputs appear only when they are complete and replace nothing unless
`overwrite` is true.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from guise.aam.landmarks import Face, open_landmarker
from guise.aam.model import Identity
from guise.common.arrays import U8
from guise.common.closing import Closing
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread

if TYPE_CHECKING:
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.measure.figures import MeasureResult
    from guise.app.meshes.reports import TransferReport
    from guise.app.photos.image import ImageReport
    from guise.app.swapping.report import SwapReport

AnyPath = str | os.PathLike[str]
Person = Identity | AnyPath
Renderer = Literal["auto", "gl", "cpu"]


def enroll(
    clips: AnyPath | Sequence[AnyPath],
    *,
    name: str | None = None,
    landmarks: AnyPath | Sequence[AnyPath] = (),
    landmarker: str = "builtin",
    frames: int | None = None,
    resolution: int | None = None,
    progress: Progress = silent,
    say: Say = mute,
) -> Identity:
    """Learn a person's face from one or more clips; `Identity.save` writes it to a file.

    Parameters
    ----------
    clips : a video, an image folder, or several, of one person who talks and turns the head a little.
    name : the person's name in the model; the first clip's file name by default.
    landmarks : landmark files (.npz, .json, .pts), one for each clip; by default those that lie beside the clips under
        their names, and otherwise points that `landmarker` finds.
    landmarker : "builtin" or "CARD.toml[@DETECTOR]", an ONNX model of your own.
    frames : to train on, about 120 by default.
    resolution : texture pixels across the face, 160 by default.
    progress : called with the stage and the share of it that is done.   say : called with notes for the user.

    Raises
    ------
    GuiseError
        When a clip cannot be read or shows no face that could be learned.
    """
    from guise.app.enrolment.enrol import enrol as enrol_clips
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.enrolment.options import TrainingChoices

    paths, files = _paths(clips), _paths(landmarks)
    if not paths:
        raise GuiseError("enrollment needs at least one clip, got none")
    if files and len(files) != len(paths):
        raise GuiseError(f"landmarks must be one file for each of the {len(paths)} clips, got {len(files)}")
    opened = None if landmarker == "builtin" else open_landmarker(landmarker)
    options = TrainingChoices(frames, resolution).training()
    return enrol_clips(
        paths, LandmarkSource(files, opened), name=name or paths[0].stem, options=options, progress=progress, say=say
    )  # fmt: skip


def load(face: AnyPath) -> Identity:
    """The model of a face: a file NAME.guise, somebody who is kept, or a fictional person, such as "Mei".

    Raises
    ------
    GuiseError
        When there is none, or its file is damaged or of another version.
    """
    from guise.app.swapping.donors import open_face

    return Identity.load(face) if Path(face).is_file() else open_face(os.fspath(face))


def landmarks(
    picture: U8 | AnyPath, *, landmarker: str = "builtin", min_confidence: float = 0.5
) -> list[Face] | Iterator[list[Face]]:
    """The 81 landmarks of every face.

    Parameters
    ----------
    picture : RGB uint8 (h, w, 3), or the path of an image or a video.
    min_confidence : in [0, 1]; faces below are left out.

    Returns
    -------
    list of Face, largest first, for an array or an image file; for a video an iterator of such lists, frame by frame,
    each in the order in which its faces first appeared.
    """
    from guise.app.media import open_input

    finder = open_landmarker(landmarker)
    if isinstance(picture, np.ndarray):
        return _faces(finder.detect(_checked(picture)), min_confidence)
    with open_input(Path(picture)) as media:
        if media.kind == "image":
            return _faces(finder.detect(next(iter(media)).rgb()), min_confidence)
    return _tracked(Path(picture), landmarker, min_confidence)


def _faces(found: Iterable[Face], min_confidence: float) -> list[Face]:
    return [face for face in found if face.confidence >= min_confidence]


def _tracked(video: Path, landmarker: str, min_confidence: float) -> Iterator[list[Face]]:
    from guise.aam.landmarks.tracking import MultiFaceTracker, TrackingLimits
    from guise.app.media import open_input

    tracker = MultiFaceTracker(open_landmarker(landmarker), TrackingLimits(min_confidence))
    with open_input(video) as media, one_thread():
        for frame in media:
            yield list(tracker.update(frame.rgb()).values())


class Swapper(Closing):
    """Puts one person's face on another's head, frame by frame, in the order of time.

    A frame goes in and a new one comes out; the array that was given is never changed.  Use it in one thread, and close
    it (or use `with`), as it may hold a GL context.

    Parameters
    ----------
    identity : the face that is shown: a model, its file or its name, see `load`.
    source : the person in the frames: likewise, or a clip to enroll them from.
    alpha : share in [0, 1] of the expression outside the identity's own space that is let through.
    renderer : "auto", "gl" or "cpu".

    Attributes
    ----------
    outcome : what happened to the last frame: "swapped", "held" (lost for a moment: the last face stays where it was)
        or "lost": no face was found and the frame came back as it was.

    Examples
    --------
    >>> import guise
    >>> with guise.Swapper("p06.guise", source="p02.guise") as swapper:  # doctest: +SKIP
    ...     picture = swapper(frame)
    """

    def __init__(
        self, identity: Person, source: Person, *, alpha: float = 0.6, renderer: Renderer = "auto"
    ) -> None:
        from guise.app.drawing.donor import Donor
        from guise.app.drawing.engine import Engine
        from guise.app.drawing.look import SWAP
        from guise.app.swapping.session import SwapSession

        shown = _identity(identity)
        person, look = _source(source, shown), replace(SWAP, alpha=alpha, renderer=renderer)
        self._session = SwapSession(
            lambda _: Engine(person, Donor.of(shown), open_landmarker("builtin"), look)
        )
        self._engine = self._session.engine(1)
        self.outcome: str = "lost"

    def __call__(self, frame: U8) -> U8:
        """The frame (h, w, 3) RGB uint8 with the other face, as a new array."""
        from guise.app.media import Frame

        picture = Frame.from_rgb(_checked(frame))
        with one_thread():
            self.outcome = self._session.swap(picture, 1, self._engine.track(picture)).outcome
        return picture.rgb()

    def close(self) -> None:
        """Release the renderer."""
        self._session.close()


def swap_file(
    video: AnyPath,
    identity: Person,
    output: AnyPath,
    *,
    source: Person | None = None,
    alpha: float = 0.6,
    renderer: Renderer = "auto",
    unsure: Literal["cover", "hold", "leave"] = "cover",
    crf: int = 20,
    overwrite: bool = False,
    progress: Progress = silent,
    say: Say = mute,
) -> SwapReport:
    """Swap the face of the person in a video; sound, time stamps, rotation and colour tags survive.

    Parameters
    ----------
    video : a video, an image or a folder of images.
    identity : the face that is shown: a model, its file or its name, see `load`.
    output : its suffix decides what is written.
    source : the person in the video: likewise; by default they are enrolled from the video itself.
    unsure : what is done to frames in which the person's face is lost but may be visible: "cover" it, "hold" the last
        face for a second, or "leave" the frame as it is.
    crf : quality of the encoder; lower is better and larger.

    Returns
    -------
    SwapReport : frames, and how many of them are swapped, held, covered and lost.
    """
    from guise.app.drawing.look import SWAP
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.media import EncodeOptions
    from guise.app.photos.swap import swap_any
    from guise.app.swapping.report import SwapSettings

    shown = _identity(identity)
    settings = SwapSettings(
        replace(SWAP, alpha=alpha, renderer=renderer), EncodeOptions(crf=crf), unsure=unsure, force=overwrite,
        progress=progress, say=say,
    )  # fmt: skip
    person = LandmarkSource() if source is None else _source(source, shown)
    return swap_any(Path(video), shown, Path(output), source=person, settings=settings)


def deidentify(
    inputs: AnyPath | Sequence[AnyPath],
    output: AnyPath | None = None,
    *,
    identity: str = "auto",
    cover: str = "solid",
    seed: int = 0,
    audio: Literal["keep", "drop", "mask", "disguise"] = "keep",
    region: Literal["face", "head"] = "face",
    audit: Literal["sampled", "full"] = "sampled",
    workers: int | None = None,
    resume: bool = False,
    overwrite: bool = False,
    donor: str | None = None,
) -> list[BatchEntry]:
    """Swap every face for a fictional one that keeps the expression, or cover it; a report lies beside each output.

    Parameters
    ----------
    inputs : videos, images or folders.
    output : of a single input, or a folder for all; by default beside each input, as NAME_deidentified.
    identity : "auto" (fictional people), "same", "mean:K", or a face as for `load`.
    cover : how a face that is not swapped is covered: "solid", "mosaic", "blur", "emoji" or "image:FILE".
    seed : of the choice of donors.
    audio : "mask" lowers voices, "disguise" makes them whisper.
    region : "head" replaces hair, ears and outline as well.
    audit : "full" searches all frames of the original and the result for faces, "sampled" some.
    workers : processes; half as many as there are cores by default.
    resume : go on where an earlier run stopped; the result has the same bytes.
    donor : the former name of `identity`, which goes with version 0.3.

    Returns
    -------
    list of BatchEntry : for each input its output, exit code (0 all swapped, 3 some covered, 1 failed, 2 not
        readable) and a sentence.
    """
    from guise.app.deidentify.options import DeidentifyOptions
    from guise.app.deidentify.run.batch import BatchRun, run_batch
    from guise.app.deidentify.run.checks import checked
    from guise.app.deidentify.run.inputs import make_plan, require_possible
    from guise.app.deidentify.run.registry import open_engine
    from guise.app.media.stream_copies import suffix_for

    if donor is not None:
        warnings.warn("donor is now identity", DeprecationWarning, stacklevel=2)
        identity = donor
    texts = [os.fspath(path) for path in ([inputs] if isinstance(inputs, str | os.PathLike) else inputs)]
    options = DeidentifyOptions(
        donor=identity, cover=cover, seed=seed, audio=audio, audit=audit, region=region
    )
    place = None if output is None else os.fspath(output)
    suffix = partial(suffix_for, encoder=options.encode.encoder)
    plan = make_plan(texts, place, Path("guise-work"), suffix, recursive=False)
    options = checked(options, [pair.output for pair in plan.pairs])
    require_possible(plan.pairs, force=overwrite, resume=resume)
    with open_engine("local", workers) as engine:
        return run_batch(plan.pairs, BatchRun(options, engine, resume, overwrite), _Unwatched())


class _Unwatched:
    """Ignores how far a batch is."""

    def file(self, name: str) -> Progress:
        return silent

    def note(self, text: str) -> None:
        pass

    def finished(self, entry: BatchEntry) -> None:
        pass


def measure(
    original: AnyPath,
    outputs: AnyPath | Sequence[AnyPath],
    *,
    recogniser: AnyPath | None = None,
    gallery: AnyPath | None = None,
    progress: Progress = silent,
    say: Say = mute,
) -> MeasureResult:
    """How private and how useful de-identified videos are, by any tool, against their original.

    Parameters
    ----------
    original, outputs : videos, images or folders of images; the outputs show the same frames.
    recogniser : TOML card of a face recogniser of your own; without one only usefulness is measured.
    gallery : folder of other people to tell the person from.

    Returns
    -------
    Result : figures for each output; `as_json` gives all of them.
    """
    from guise.app.measure.job import measure as measure_outputs
    from guise.app.measure.options import MeasureOptions

    cards = () if recogniser is None else (Path(recogniser),)
    options = MeasureOptions(recognisers=cards, gallery=_path(gallery))
    return measure_outputs(Path(original), _paths(outputs), options, progress=progress, say=say)


def transfer_mesh(
    neutral: AnyPath,
    expressions: AnyPath | Sequence[AnyPath],
    target: AnyPath,
    output: AnyPath | None = None,
    *,
    method: Literal["tents", "gradients", "cloning"] = "tents",
    overwrite: bool = False,
    progress: Progress = silent,
    say: Say = mute,
) -> TransferReport:
    """Carry expressions of one 3-D head over to another of any topology.

    Parameters
    ----------
    neutral, expressions : mesh files (OBJ, PLY, glTF, GLB) of one head, at rest and with expressions: same vertices.
    target : the mesh file of another head, at rest.
    output : folder for one file per expression, in the target's format; by default TARGET_expressions beside it.
    """
    from guise.app.meshes.context import RunContext
    from guise.app.meshes.options import TransferOptions
    from guise.app.meshes.transferring import transfer_files

    folder = None if output is None else Path(output)
    work = RunContext(overwrite, progress, say)
    return transfer_files(
        Path(neutral), _paths(expressions), Path(target), folder, TransferOptions(method), work
    )


def transfer_photo(
    neutral: AnyPath,
    expressive: AnyPath,
    target: AnyPath,
    output: AnyPath,
    *,
    strength: float = 1.0,
    overwrite: bool = False,
    say: Say = mute,
) -> ImageReport:
    """Carry the expression between two photos of one person over to a photo of another, wrinkles and shading included.

    Parameters
    ----------
    neutral, expressive : photos of one person, at rest and with the expression.   target : of another, at rest.
    output : the target with the expression, of the target's size.
    strength : of the expression, 0..2; 1 is as it is.
    """
    from guise.app.photos.image import analogy_image
    from guise.app.photos.options import AnalogyOptions

    how = AnalogyOptions(strength=strength, force=overwrite)
    return analogy_image(Path(neutral), Path(expressive), Path(target), Path(output), how, say=say)


def _paths(given: AnyPath | Sequence[AnyPath]) -> list[Path]:
    return [Path(given)] if isinstance(given, str | os.PathLike) else [Path(path) for path in given]


def _path(given: AnyPath | None) -> Path | None:
    return None if given is None else Path(given)


def _checked(picture: U8) -> U8:
    if not (
        isinstance(picture, np.ndarray)
        and picture.dtype == np.uint8
        and picture.ndim == 3
        and picture.shape[2] == 3
    ):
        got = (
            f"{picture.shape} {picture.dtype}" if isinstance(picture, np.ndarray) else type(picture).__name__
        )
        raise GuiseError(f"a frame must be an RGB array (h, w, 3) of uint8, got {got}")
    return picture


def _identity(person: Person) -> Identity:
    return person if isinstance(person, Identity) else load(person)


def _source(person: Person, shown: Identity) -> Identity:
    """The model of the person in the video; a clip is enrolled at the resolution of the face that is shown."""
    if isinstance(person, Identity) or _is_face(Path(person)):
        return _identity(person)
    return enroll(person, resolution=shown.reference.resolution)


def _is_face(path: Path) -> bool:
    """Whether a path is a model's or the name of a face, not that of a clip."""
    return path.suffix == ".guise" or (not path.suffix and not path.exists())
