"""Faces hidden, and how well: de-identification and its measures."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np

from guise.api.options import AnyPath, RangeOptions, WatchOptions, WriteOptions, encoding
from guise.api.pictures import Person, as_files, as_names, is_picture, path_of, paths
from guise.api.vocabulary import call, in_python, watch_of
from guise.common.arrays import U8
from guise.common.errors import GuiseError
from guise.common.progress import Progress, Say

if TYPE_CHECKING:
    from guise.api.pictures import Picture
    from guise.app.deidentify.report.report import BatchEntry
    from guise.app.deidentify.run.inputs import FilePair
    from guise.app.measure.attack import AttackResult
    from guise.app.measure.figures import MeasureResult

Tracks = dict[str, Any]


class HideOptions(WriteOptions, RangeOptions, WatchOptions, total=False):
    """How faces are hidden.

    gallery : faces to choose from, instead of all fictional ones.
    cover : how a face that is not swapped is covered: "solid", "mosaic", "blur", "emoji" or "image:FILE"; how much
        mosaic and blur hide is cover_strength, 1 to 5.
    region : "head" replaces hair, ears and outline as well.   own_glasses : "keep" leaves the person's.
    alpha : share in [0, 1] of the expression outside the identity's own range.   seed : of the choice of faces.
    keyfile : where people and their faces are remembered, so that they get the same ones in other files.
    audio : "mask" lowers voices, "disguise" makes them whisper.   keep_metadata, label : see `guise deidentify`.
    audit : "full" searches all frames of the original and the result for faces, "sampled" some; audit_detector is its.
    outside : of start and end, "cut" by default.   c2pa : PEM files (certificate, key) to sign the output with.
    workers : processes of the engine "local"; half as many as there are cores by default.   engine : or
        "dask:ADDRESS".   work : folder for copies of remote files.
    recursive : include subfolders.   overwrite : replace existing outputs.
    """

    gallery: Sequence[AnyPath]
    cover: str
    cover_strength: int
    region: Literal["face", "head"]
    own_glasses: Literal["remove", "keep"]
    alpha: float
    renderer: Literal["auto", "gl", "cpu"]
    seed: int
    keyfile: AnyPath | None
    audio: Literal["keep", "drop", "mask", "disguise"]
    keep_metadata: bool
    label: bool
    audit: Literal["sampled", "full"]
    audit_detector: str | None
    c2pa: tuple[AnyPath, AnyPath] | None
    engine: str
    workers: int | None
    work: AnyPath
    recursive: bool
    overwrite: bool


@dataclass(frozen=True, eq=False)
class Hidden:
    """A picture (h, w, 3), or a clip (n, h, w, 3), RGB uint8, in which every face is hidden.

    code, sentence : 0 all swapped, 3 some covered, and what was done, in words.   report : all that is known.
    """

    picture: U8
    code: int
    sentence: str
    report: dict[str, Any]


@overload
def deidentify(
    inputs: Picture, output: None = None, *, identity: Person = "auto", **options: Unpack[HideOptions]
) -> Hidden: ...
@overload
def deidentify(
    inputs: AnyPath | Sequence[AnyPath],
    output: AnyPath | None = None,
    *,
    identity: Person = "auto",
    review: bool = False,
    tracks: AnyPath | Tracks | None = None,
    resume: bool = False,
    donor: str | None = None,
    **options: Unpack[HideOptions],
) -> list[BatchEntry]: ...
@call
def deidentify(
    inputs: Picture | AnyPath | Sequence[AnyPath],
    output: AnyPath | None = None,
    *,
    identity: Person = "auto",
    review: bool = False,
    tracks: AnyPath | Tracks | None = None,
    resume: bool = False,
    donor: str | None = None,
    **options: Unpack[HideOptions],
) -> list[BatchEntry] | Hidden:
    """Swap every face for a fictional one that keeps the expression, or cover it; a report lies beside each output.

    Parameters
    ----------
    inputs : videos, images or folders; or one picture (h, w, 3) or clip (n, h, w, 3) as an array, or a `PIL.Image`.
    output : of a single input, or a folder for all; by default beside each input, as NAME_deidentified.
    identity : "auto" (fictional people), "same", "average:K", "mean:K", or a face as for `load`.
    review : stop before rendering, and write the tracks, which `read_tracks` reads.
    tracks : of a review, edited, as a file or as `read_tracks` gave them.
    resume : go on where an earlier run stopped; the result has the same bytes.
    donor : the former name of `identity`, which goes with version 0.3.
    options : `HideOptions`.

    Returns
    -------
    list of BatchEntry : for each input its output, exit code (0 all swapped, 3 some covered, 1 failed, 2 not
        readable) and a sentence; `read_report` reads the report of an output.  Or `Hidden`, of a picture.
    """
    if donor is not None:
        warnings.warn("donor is now identity", DeprecationWarning, stacklevel=3)
        identity = donor
    if is_picture(inputs):
        return _hidden(inputs, output, identity, options)
    texts = [os.fspath(path) for path in ([inputs] if isinstance(inputs, str | os.PathLike) else inputs)]  # type: ignore[union-attr]
    with ExitStack() as stack:
        name = stack.enter_context(as_names({"identity": identity}))["identity"]
        file = stack.enter_context(_tracks_file(tracks))
        return _entries(texts, output, name, dict(options), review=review, resume=resume, tracks=file)


def _entries(
    inputs: Sequence[str], output: AnyPath | None, identity: str, left: dict[str, Any], *, review: bool = False,
    resume: bool = False, tracks: Path | None = None,
) -> list[BatchEntry]:  # fmt: skip
    from guise.app.deidentify.options import DeidentifyOptions
    from guise.app.deidentify.run.batch import BatchRun, run_batch
    from guise.app.deidentify.run.checks import checked
    from guise.app.deidentify.run.inputs import make_plan, require_possible
    from guise.app.deidentify.run.registry import open_engine
    from guise.app.media.stream_copies import suffix_for
    from guise.common.option import made

    progress, say = watch_of(left)
    overwrite, workers, engine = (
        left.pop("overwrite", False),
        left.pop("workers", None),
        left.pop("engine", "local"),
    )
    recursive, work = left.pop("recursive", False), Path(left.pop("work", "guise-work"))
    encode = encoding(left)
    certificate, key = left.pop("c2pa", None) or (None, None)
    if "audit_detector" in left:
        left["detector"] = left.pop("audit_detector")
    times: dict[str, Any] = {
        name: str(left.pop(name)) for name in ("start", "end") if left.get(name) is not None
    }
    options = made(
        DeidentifyOptions, donor=identity, certificate=path_of(certificate), key=path_of(key), encode=encode,
        gallery=tuple(paths(left.pop("gallery", ()))), keyfile=path_of(left.pop("keyfile", None)), **left, **times,
    )  # fmt: skip
    place = None if output is None else os.fspath(output)
    plan = make_plan(inputs, place, work, partial(suffix_for, encoder=encode.encoder), recursive=recursive)
    if tracks is not None and (review or len(plan.pairs) > 1):
        raise GuiseError("tracks are those of a review of one input: give one input, and leave review out")
    options = checked(options, [pair.output for pair in plan.pairs])
    for note in plan.notes:
        say(note)
    require_possible(plan.pairs, force=overwrite, resume=resume)
    with open_engine(engine, workers) as opened:
        run = BatchRun(options, opened, resume, overwrite, review, tracks)
        entries = run_batch(plan.pairs, run, _Watch(progress, say, plan.pairs))
    return [replace(entry, sentence=in_python(entry.sentence)) for entry in entries]


class _Watch:
    """Passes on how far a batch is; with several files the stage begins with the file's name."""

    def __init__(self, progress: Progress, say: Say, pairs: Sequence[FilePair]) -> None:
        self._progress, self.note, self._many = progress, say, len(pairs) > 1

    def file(self, name: str) -> Progress:
        if not self._many:
            return self._progress
        return lambda stage, share: self._progress(f"{name}: {stage}", share)

    def finished(self, entry: BatchEntry) -> None:
        pass


def _hidden(picture: Picture, output: AnyPath | None, identity: Person, options: HideOptions) -> Hidden:
    """A picture by way of files that nobody else may read."""
    from guise.app.media import open_input

    if output is not None:
        raise GuiseError("a picture is given back: leave output out")
    with as_files([picture]) as [file], as_names({"identity": identity}) as names:
        made = file.with_name("hidden" + file.suffix)
        [entry] = _entries([str(file)], made, names["identity"], {"workers": 1, **options})
        if entry.output is None:
            raise GuiseError(entry.sentence.replace(file.name, "the picture"))
        with open_input(made) as media:
            frames = [frame.rgb() for frame in media]
        report = read_report(made)
    found = np.stack(frames) if file.is_dir() or made.is_dir() else frames[0]
    return Hidden(found, entry.code, entry.sentence, report)


def _tracks_file(tracks: AnyPath | Tracks | None) -> Any:
    """The file of edited tracks, which lasts as long as the context where they are no file."""
    return _Tracks(tracks)


class _Tracks(tempfile.TemporaryDirectory[str]):
    def __init__(self, tracks: AnyPath | Tracks | None) -> None:
        super().__init__(prefix="guise-")
        self._tracks = tracks

    def __enter__(self) -> Path | None:  # type: ignore[override]
        if not isinstance(self._tracks, Mapping):
            return path_of(self._tracks)
        file = Path(self.name, "tracks.json")
        file.write_text(json.dumps(self._tracks), encoding="utf-8")
        return file


@call
def read_tracks(output: AnyPath) -> Tracks:
    """What a review has found for an output that is to be.

    Change `action` ("swap", "cover", "leave") and `donor` of its `tracks`, and give it back:
    `deidentify(..., tracks=..., resume=True)`.
    """
    return _read(output, ".tracks.json", "a review writes one: deidentify(..., review=True)")


@call
def read_report(output: AnyPath) -> dict[str, Any]:
    """The report of an output of `deidentify`: settings, people, what was done in each frame, and what was audited."""
    return _read(output, ".report.json", "deidentify writes one beside each output")


def _read(output: AnyPath, suffix: str, hint: str) -> dict[str, Any]:
    from guise.app.deidentify.run.results import beside

    path = beside(Path(output).absolute(), suffix)
    if not path.is_file():
        raise GuiseError(f"there is no {path.name} beside {Path(output).name}: {hint}")
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


class MeasureCallOptions(WatchOptions, total=False):
    """What is measured with.

    recogniser : TOML card of a face recogniser of your own, or several for an attack; without one only usefulness is
        measured.   distractors : folder of other people to tell the person from.
    identity : faces that the outputs show.   output_report : the reports of outputs by `deidentify`.
    landmarks : a file of those of the original.   landmarker : "builtin" or "CARD.toml[@DETECTOR]".
    output : a file of all figures.   plot : a picture of them.   overwrite : replace these.
    """

    recogniser: AnyPath | Sequence[AnyPath]
    distractors: AnyPath | None
    identity: str | Sequence[str]
    output_report: AnyPath | Sequence[AnyPath]
    landmarks: AnyPath | None
    landmarker: str | None
    output: AnyPath | None
    plot: AnyPath | None
    overwrite: bool


@overload
def measure(
    original: AnyPath,
    outputs: AnyPath | Sequence[AnyPath],
    *,
    attack: Literal[False] = False,
    **options: Unpack[MeasureCallOptions],
) -> MeasureResult: ...
@overload
def measure(
    original: AnyPath,
    outputs: AnyPath | Sequence[AnyPath],
    *,
    attack: Literal[True],
    **options: Unpack[MeasureCallOptions],
) -> AttackResult: ...
@call
def measure(
    original: AnyPath,
    outputs: AnyPath | Sequence[AnyPath],
    *,
    attack: bool = False,
    **options: Unpack[MeasureCallOptions],
) -> MeasureResult | AttackResult:
    """How private and how useful de-identified videos are, by any tool, against their original.

    Parameters
    ----------
    original, outputs : videos, images or folders of images; the outputs show the same frames.
    attack : attack folders of people instead, by attackers that know other pictures of them, and learn.
    options : `MeasureCallOptions`.

    Raises
    ------
    GuiseError
        When they differ in their frames, or what `measure` needs is not there.
    """
    from guise.app.measure.options import MeasureOptions
    from guise.common.files import require_free, write_whole

    progress, say = watch_of({**options})
    files = {"output": path_of(options.get("output")), "plot": path_of(options.get("plot"))}
    force, names = options.get("overwrite", False), options.get("identity", ())
    for path in filter(None, files.values()):
        require_free(path, force=force)
    wanted = MeasureOptions(
        tuple(paths(options.get("recogniser") or ())), path_of(options.get("distractors")),
        (names,) if isinstance(names, str) else tuple(names), tuple(paths(options.get("output_report", ()))),
        path_of(options.get("landmarks")), options.get("landmarker"),
    )  # fmt: skip
    result: MeasureResult | AttackResult
    if attack:
        from guise.app.measure.attack import AttackRequest
        from guise.app.measure.attack import attack as run_attack

        if wanted.gallery or wanted.identities or wanted.reports or wanted.landmarks or files["plot"]:
            raise GuiseError(
                "an attack does not take distractors, identity, output_report, landmarks or plot: leave them out"
            )
        request = AttackRequest(Path(original), paths(outputs), wanted.recognisers, wanted.landmarker)
        result = run_attack(request, progress=progress, say=say)
    else:
        from guise.app.measure.job import measure as run_measure

        result = run_measure(Path(original), paths(outputs), wanted, progress=progress, say=say)
        if files["plot"] is not None:
            from guise.app.measure.plot import draw

            draw(result, files["plot"])
    if files["output"] is not None:
        write_whole(files["output"], json.dumps(result.as_json(), indent=1, allow_nan=False) + "\n")
    return result
