"""The commands `guise swap` and `guise puppet`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.batches import Swap, summary, swap_each
from guise.app.cli.console import Console, Stages
from guise.app.cli.options import (
    DetectorSpec,
    Each,
    Encode,
    EncodeChoices,
    FaceMap,
    FaceSpec,
    Force,
    From,
    HardwareDecoding,
    LandmarkerSpec,
    LandmarkFile,
    NoKeep,
    OneFace,
    Others,
    OthersChoice,
    Output,
    OutputOrFolder,
    OutsideChoice,
    Part,
    PipeFormat,
    RawVideo,
    Rest,
    Shown,
    SourceSpec,
    To,
    UnsureOption,
    Video,
    Videos,
    faces_by_person,
    landmark_source,
    takes,
)
from guise.app.drawing.look import DrawingChoices

if TYPE_CHECKING:
    from guise.aam.model import Identity
    from guise.app.drawing.look import Look
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.swapping.report import SwapReport, SwapSettings
    from guise.app.swapping.several import Casting


PIPE = Path("-")


@takes
def swap(
    videos: Videos,
    output: OutputOrFolder,
    *,
    each: Each = False,
    identity: OneFace = None,
    source: SourceSpec = None,
    map: FaceMap = None,
    others: OthersChoice = "leave",
    landmarks: LandmarkFile = None,
    landmarker: LandmarkerSpec = None,
    drawing: Annotated[DrawingChoices, Part(DrawingChoices)],
    rest: Rest = None,
    from_: From = None,
    to: To = None,
    outside: OutsideChoice = "keep",
    pipe: PipeFormat = "nut",
    raw: RawVideo = None,
    detector: DetectorSpec = None,
    unsure: UnsureOption = "cover",
    hwaccel: HardwareDecoding = "none",
    encoding: Encode,
    no_keep: NoKeep = False,
    force: Force = False,
    console: Shown,
) -> int:
    """Replace the face of the person in a video by another, or of each of several people."""
    from guise.app.drawing.look import SWAP
    from guise.app.media.time_range import TimeRange

    for_one = (source, landmarks, landmarker, rest is not None, detector)
    casting = _casting(identity, map, others, for_one, unsure)
    alone = _is_alone(videos, each=each)
    if landmarks is not None and not alone:
        raise typer.BadParameter("--landmarks is for one video: give only one")
    made = _swapper(casting, str(identity), source, landmarks, landmarker)
    with Stages(console) as stages:
        settings = _settings(console, stages, drawing.of(SWAP), encoding, detector, force)
        settings = replace(
            settings,
            unsure=unsure,
            keep_people=not no_keep,
            part=TimeRange.between(from_, to, outside),
            rest_seconds=rest,
            graded=console.json or not console.quiet,
            hwaccel=hwaccel,
        )
        if not alone:
            return swap_each(console, videos, output, made, settings, each=each)
        places = _places(Path(videos[0]), Path(output), pipe, raw, console)
        report = made(*places, settings)
    _say_swap(console, report)
    return 0


def _places(video: Path, output: Path, pipe: str, raw: str | None, console: Console) -> tuple[Path, Path]:
    """Input and output, either of which may be a pipe; what is said then goes to stderr."""
    from guise.app.media.pipes import input_pipe, output_pipe

    if raw is not None and video != PIPE:
        raise typer.BadParameter("--raw is for raw video from a pipe: give - as VIDEO")
    console.piped = output == PIPE
    return input_pipe(raw) if video == PIPE else video, output_pipe(pipe) if output == PIPE else output


def _is_alone(videos: list[str], *, each: bool) -> bool:
    """Whether a file or a folder of images is given, and not what stands for several inputs or is elsewhere."""
    name = videos[0]
    if len(videos) == 1 and not each and Path(name).is_dir():
        from guise.app.deidentify.run.inputs import VIDEO_SUFFIXES
        from guise.app.media.images import list_images

        held = {path.suffix.lower() for path in Path(name).iterdir()}
        if held & VIDEO_SUFFIXES and not list_images(Path(name)):
            raise typer.BadParameter(f"{name} is a folder of videos: --each swaps them one by one")
    stands = not Path(name).exists() and ("://" in name or set("*?[") & set(name))
    return len(videos) == 1 and not each and not stands


def _swapper(
    casting: Casting | None, identity: str, source: str | None, landmarks: Path | None, landmarker: str | None
) -> Swap:
    """What swaps a video, with the models that are opened once for all."""
    if casting is not None:
        from guise.app.swapping.several import swap_people

        return lambda video, output, settings: swap_people(video, casting, output, settings=settings)
    from guise.app.photos.swap import swap_any

    shown, person = _open(identity, source, landmarks, landmarker)
    return lambda video, output, settings: swap_any(video, shown, output, source=person, settings=settings)


def _say_swap(console: Console, report: SwapReport) -> None:
    """Print the summary, and what became of each of several people."""
    from guise.app.swapping.donors import titled

    say_report(console, report, "swapped", last=False)
    for one in getattr(report, "people", ()):
        if not one.face and report.frames == 1 and not one.covered:
            continue  # somebody in a photo who stays
        got = f"the face {titled(one.face)}: " if one.face else ""
        console.say(
            f"person {one.number}: {got}{one.swapped} swapped, {one.covered} covered, {one.left} left"
            + (f"; quality {one.grade} of 100" if one.grade is not None else "")
        )
    console.result(report.as_json())


def _casting(
    identity: str | None, pairs: list[str] | None, others: Others, for_one: tuple[object, ...], unsure: str
) -> Casting | None:  # fmt: skip
    """Who gets whose face, by --map; None where --identity says it of one person."""
    if (identity is None) == (not pairs):
        raise typer.BadParameter("give --identity FACE, or --map SOURCE=FACE for each of several people")
    if not pairs:
        if others != "leave":
            raise typer.BadParameter("--others goes with --map: name the people who get a face")
        return None
    if any(for_one) or unsure == "hold":
        raise typer.BadParameter(
            "--source, --landmarks, --landmarker, --rest, --detector and --unsure hold are for one person: "
            "leave them out beside --map"
        )
    from guise.app.swapping.several import Casting

    return Casting(faces_by_person(pairs), others)


@takes
def puppet(
    video: Video,
    identity: FaceSpec,
    output: Output,
    *,
    source: SourceSpec = None,
    landmarks: LandmarkFile = None,
    landmarker: LandmarkerSpec = None,
    drawing: Annotated[DrawingChoices, Part(DrawingChoices, ("look", "alpha", "renderer"))],
    from_: From = None,
    to: To = None,
    outside: OutsideChoice = "keep",
    pipe: PipeFormat = "nut",
    raw: RawVideo = None,
    detector: DetectorSpec = None,
    encoding: Encode,
    no_keep: NoKeep = False,
    force: Force = False,
    console: Shown,
) -> None:
    """Animate another head with the expressions of the person in a video."""
    from guise.app.drawing.look import SWAP
    from guise.app.media.time_range import TimeRange
    from guise.app.swapping.puppet import puppet_file

    look = drawing.of(SWAP)
    with Stages(console) as stages:
        settings = _settings(console, stages, look, encoding, detector, force)
        settings = replace(settings, keep_people=not no_keep, part=TimeRange.between(from_, to, outside))
        shown, person = _open(identity, source, landmarks, landmarker)
        video, output = _places(video, output, pipe, raw, console)
        report = puppet_file(video, shown, output, source=person, settings=settings)
    say_report(console, report, "followed")


def _settings(
    console: Console, stages: Stages, look: Look, encoding: EncodeChoices, detector: str | None, force: bool
) -> SwapSettings:
    from guise.app.swapping.report import SwapSettings

    return SwapSettings(
        look,
        encoding.options(),
        detector=detector or "builtin",
        force=force,
        progress=stages,
        say=console.note,
    )


def _open(
    identity: str, source: str | None, landmarks: Path | None, landmarker: str | None
) -> tuple[Identity, Identity | LandmarkSource]:
    """The identity, and the person in the video: their model, or where their landmarks come from."""
    from guise.app.swapping.donors import open_face

    shown = open_face(identity)
    if source is None:
        return shown, landmark_source([landmarks] if landmarks else [], landmarker, 1)
    if landmarks or landmarker:
        raise typer.BadParameter(
            "--landmarks and --landmarker are for enrollment, which --source replaces: leave them out"
        )
    return shown, open_face(source)


def say_report(console: Console, report: SwapReport, word: str, *, last: bool = True) -> None:
    """Print the summary for people and, unless more follows, the JSON object."""
    console.say(f"{report.output}: {summary(report, word)}")
    if report.beyond_face_widths:
        share = round(100 * report.beyond_face_widths)
        console.note(
            f"pixels up to {share} % of the face's width from the jaw line may have changed (--outline)"
        )
    if report.grade is not None:
        console.say(f"quality: {report.grade} of 100" + (f"; {report.advice}" if report.advice else ""))
    if last:
        console.result(report.as_json())
