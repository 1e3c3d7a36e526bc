"""The command line: `guise COMMAND`.  Thin: each command opens what it needs, calls the library and says the result.

Heavy libraries are imported inside the commands, so that `guise --help` is quick.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.analogy import analogy
from guise.app.cli.console import Console, Stages
from guise.app.cli.deidentify import deidentify
from guise.app.cli.live import live
from guise.app.cli.measure import measure
from guise.app.cli.options import (
    Alpha,
    BoxDetectorSpec,
    Crf,
    Detector,
    Encoder,
    Force,
    FormatChoice,
    Json,
    LandmarkerSpec,
    LandmarkFile,
    LandmarkFiles,
    LandmarkOutput,
    Lossless,
    MinConfidence,
    ModelPath,
    NoSmooth,
    Output,
    Overlay,
    Preset,
    Quiet,
    RendererChoice,
    RendererName,
    SourcePath,
    Video,
)
from guise.app.cli.studio import studio
from guise.common.version import version

if TYPE_CHECKING:
    from guise.aam.model import Identity
    from guise.app.enrolment.enrol import LandmarkSource
    from guise.app.swapping.run import Report, Settings

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Another face on a person in a video, in real time on an ordinary CPU.",
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit code; errors are one sentence on stderr."""
    from guise.common.failures import INTERRUPTED, report

    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # read when NumPy is imported; why: guise.common.threads
    os.environ.setdefault(
        "OPENCV_LOG_LEVEL", "SILENT"
    )  # what it would say of a broken image is an error's sentence
    arguments = list(sys.argv[1:] if argv is None else argv)
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _terminate)
    try:
        code = app(arguments or ["--help"], standalone_mode=False, prog_name="guise")
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else 1
    except typer.Abort:
        code = report(KeyboardInterrupt())
    except BaseException as error:
        return report(error)
    if code == INTERRUPTED:
        return report(KeyboardInterrupt())
    return int(code or 0)


def _terminate(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"guise {version()}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Take the options before the command."""


@app.command()
def enroll(
    videos: Annotated[list[Path], typer.Argument(metavar="VIDEO...", help="Clips of one person.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="NAME.guise", help="The model that is written.")
    ],
    landmarks: LandmarkFiles = None,
    landmarker: LandmarkerSpec = None,
    frames: Annotated[
        int | None, typer.Option(min=12, help="Frames to train on; about 120 by default.")
    ] = None,
    resolution: Annotated[
        int | None,
        typer.Option(min=32, max=512, help="Texture pixels across the face; the same for both models."),
    ] = None,
    retain: Annotated[float | None, typer.Option(min=0.5, max=1.0, help="Share of variance to keep.")] = None,
    modes: Annotated[
        int | None, typer.Option(min=1, help="Number of modes to keep, instead of --retain.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="The person's name in the model; default: the file's.")
    ] = None,
    refine: Annotated[
        bool | None,
        typer.Option(
            "--refine/--no-refine",
            help="Refine found landmarks, all frames together; default: those of other landmarkers than builtin.",
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Learn a person's face from one or more clips."""
    from guise.app.enrolment.file import describe_options, enrol_file

    console = Console(quiet=quiet, json=json)
    source = replace(_landmark_source(landmarks or [], landmarker, len(videos)), refine=refine)
    options = describe_options(frames=frames, resolution=resolution, retain=retain, modes=modes)
    with Stages(console) as stages:
        report = enrol_file(
            videos, output, source, name=name or output.stem, options=options, force=force, progress=stages,
            say=console.note,
        )  # fmt: skip
    console.table(f"{report.output}: {report.name}", report.as_rows())
    console.result(report.as_json())


@app.command()
def swap(
    video: Video,
    identity: ModelPath,
    output: Output,
    source: SourcePath = None,
    landmarks: LandmarkFile = None,
    landmarker: LandmarkerSpec = None,
    alpha: Alpha = 0.6,
    renderer: RendererChoice = RendererName.auto,
    detector: Detector = "builtin",
    encoder: Encoder = "libx264",
    crf: Crf = 20,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Put the identity's face on the person in a video."""
    from guise.app.swapping.file import swap_file

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        settings = _settings(
            console, stages, alpha, renderer, detector, encoder, crf, preset, lossless, force
        )
        shown, person = _open(identity, source, landmarks, landmarker)
        report = swap_file(video, shown, output, source=person, settings=settings)
    _say_report(console, report, "swapped")


@app.command()
def puppet(
    video: Video,
    identity: ModelPath,
    output: Output,
    source: SourcePath = None,
    landmarks: LandmarkFile = None,
    landmarker: LandmarkerSpec = None,
    alpha: Alpha = 0.6,
    renderer: RendererChoice = RendererName.auto,
    detector: Detector = "builtin",
    encoder: Encoder = "libx264",
    crf: Crf = 20,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Put the expressions of the person in a video on the identity's own head."""
    from guise.app.swapping.puppet import puppet_file

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        settings = _settings(
            console, stages, alpha, renderer, detector, encoder, crf, preset, lossless, force
        )
        shown, person = _open(identity, source, landmarks, landmarker)
        report = puppet_file(video, shown, output, source=person, settings=settings)
    _say_report(console, report, "followed")


@app.command()
def landmarks(
    video: Video,
    output: LandmarkOutput,
    overlay: Overlay = None,
    format: FormatChoice = None,
    landmarker: LandmarkerSpec = None,
    detector: BoxDetectorSpec = None,
    min_confidence: MinConfidence = 0.5,
    no_smooth: NoSmooth = False,
    encoder: Encoder = "libx264",
    crf: Crf = 20,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Find the landmarks of all faces in a video, an image or a folder of images."""
    from guise.aam.landmarks import open_landmarker
    from guise.app.landmarks.file import LandmarkOptions, landmarks_file
    from guise.app.media import EncodeOptions

    console = Console(quiet=quiet, json=json)
    spec = (landmarker or "builtin") + (f"@{detector}" if detector else "")
    options = LandmarkOptions(
        form=format and format.value, overlay=overlay, min_confidence=min_confidence, smooth=not no_smooth,
        encode=EncodeOptions(encoder, crf), force=force,
    )  # fmt: skip
    with Stages(console) as stages:
        report = landmarks_file(
            video, output, open_landmarker(spec), options, progress=stages, say=console.note
        )
    console.say(str(report))
    console.result(report.as_json())


@app.command()
def info(
    model: Annotated[Path, typer.Argument(metavar="NAME.guise", help="A model that `guise enroll` made.")],
    montage: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw mean, neutral and modes at +-2 sd.")
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show what is inside a model."""
    from guise.app.people.info import describe
    from guise.common.files import require_free

    console = Console(quiet=quiet, json=json)
    if montage is not None:
        require_free(montage, force=force)
    identity, facts = describe(model)
    if montage is not None:
        from guise.app.media.pictures import save_picture
        from guise.app.people.montage import montage as draw

        save_picture(montage, draw(identity))
    console.table(str(model), facts.as_rows())
    if montage is not None:
        console.say(f"montage: {montage}")
    console.result(asdict(facts) | {"montage": montage and str(montage)})


@app.command()
def demo(
    samples: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The folder sample_videos of a Guise checkout.")
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="Where the files go.")] = Path(
        "guise-demo"
    ),
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Enrol two sample people and put the face of one on the other."""
    from guise.app.swapping.run import Settings
    from guise.app.tools.demo import run_demo

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        report = run_demo(samples, output, Settings(force=force, progress=stages, say=console.note))
    for enrolment in report.enrolments:
        console.table(enrolment.output, enrolment.as_rows())
    _say_report(console, report.swap, "swapped", last=False)
    console.say(f"side by side: {report.side_by_side}")
    console.say(f"contact sheet: {report.contact_sheet}")
    console.result(report.as_json())


@app.command()
def doctor(quiet: Quiet = False, json: Json = False) -> None:
    """Show what works on this computer, and what to install for the rest."""
    from guise.app.tools.doctor import as_json, examine

    console = Console(quiet=quiet, json=json)
    findings = examine()
    words = {True: "works", False: "missing", None: "optional"}
    rows = [[f.topic, f.name, words[f.ok], f.detail] for f in findings]
    console.grid("Guise on this computer", ["", "what", "", "detail"], rows)
    console.result(as_json(findings))


@app.command()
def bench(
    clip: Annotated[
        Path | None, typer.Argument(metavar="[VIDEO]", help="What is measured on; default: a sample clip.")
    ] = None,
    source: Annotated[
        Path | None,
        typer.Option(metavar="SRC.guise", help="Model of the person in VIDEO; default: enrolled."),
    ] = None,
    identity: Annotated[
        Path | None,
        typer.Option(metavar="NAME.guise", help="Whose face is shown; default: the same person's."),
    ] = None,
    samples: Annotated[
        Path | None, typer.Option(metavar="DIR", help="The folder sample_videos of a Guise checkout.")
    ] = None,
    frames: Annotated[int, typer.Option(min=20, help="Frames that are counted.")] = 150,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Measure how long each stage of a frame takes here."""
    from guise.app.tools.bench import measure, prepare

    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        clip, person, shown = prepare(clip, source, identity, samples, progress=stages, say=console.note)
        timings = measure(clip, person, shown, frames=frames, say=console.note)
    rows = [[t.renderer, t.stage, f"{t.median:.2f}", f"{t.p95:.2f}"] for t in timings]
    console.grid(f"{clip.name}: milliseconds a frame", ["renderer", "stage", "median", "95 %"], rows)
    console.result({"clip": str(clip), "milliseconds": [t.as_json() for t in timings]})


app.command()(live)
app.command()(studio)
app.command()(deidentify)
app.command()(measure)
app.add_typer(analogy, name="analogy")


def _settings(
    console: Console, stages: Stages, alpha: float, renderer: RendererName, detector: str, encoder: str, crf: int,
    preset: str, lossless: bool, force: bool,
) -> Settings:  # fmt: skip
    from guise.app.media import EncodeOptions
    from guise.app.swapping.options import Options
    from guise.app.swapping.run import Settings

    return Settings(
        Options(alpha=alpha, renderer=renderer.value),
        EncodeOptions(encoder, crf, preset, lossless),
        detector=detector, force=force, progress=stages, say=console.note,
    )  # fmt: skip


def _open(
    identity: Path, source: Path | None, landmarks: Path | None, landmarker: str | None
) -> tuple[Identity, Identity | LandmarkSource]:
    """The identity, and the person in the video: their model, or where their landmarks come from."""
    from guise.aam.model import Identity

    shown = Identity.load(identity)
    if source is None:
        return shown, _landmark_source([landmarks] if landmarks else [], landmarker, 1)
    if landmarks or landmarker:
        raise typer.BadParameter(
            "--landmarks and --landmarker are for enrolling, which --source makes needless"
        )
    return shown, Identity.load(source)


def _landmark_source(files: list[Path], landmarker: str | None, clips: int) -> LandmarkSource:
    from guise.app.enrolment.enrol import LandmarkSource

    if files and landmarker:
        raise typer.BadParameter("give either --landmarks or --landmarker")
    if files and len(files) != clips:
        raise typer.BadParameter(
            f"--landmarks must be given once for each of the {clips} clips, got {len(files)}"
        )
    if landmarker is None:
        return LandmarkSource(files)
    from guise.aam.landmarks import open_landmarker

    return LandmarkSource(landmarker=open_landmarker(landmarker))


def _say_report(console: Console, report: Report, word: str, *, last: bool = True) -> None:
    """The line for people and, unless more follows, the JSON object."""
    console.say(
        f"{report.output}: {report.swapped} of {report.frames} frames {word}, {report.held} held, "
        f"{report.lost} lost; {report.seconds:.1f} s, {report.frames_per_second:.1f} frames per second"
    )
    if last:
        console.result(report.as_json())


if __name__ == "__main__":
    sys.exit(main())
