"""The commands `guise demo`, `guise doctor` and `guise bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.console import Stages
from guise.app.cli.options import Force, Shown, takes
from guise.app.cli.video import say_report
from guise.app.swapping import FACE_HELP

Samples = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="A folder with the sample people; default: those that come with Guise."),
]


@takes
def demo(
    *,
    samples: Samples = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="The folder for the files.")
    ] = Path("guise-demo"),
    force: Force = False,
    console: Shown,
) -> None:
    """Enroll two sample people and swap one's face onto the other."""
    from guise.app.swapping.report import SwapSettings
    from guise.app.tools.demo import run_demo

    with Stages(console) as stages:
        report = run_demo(samples, output, SwapSettings(force=force, progress=stages, say=console.note))
    for enrolment in report.enrolments:
        console.table(enrolment.output, enrolment.as_rows())
    say_report(console, report.swap, "swapped", last=False)
    console.say(f"side by side: {report.side_by_side}")
    console.say(f"contact sheet: {report.contact_sheet}")
    console.result(report.as_json())


@takes
def doctor(
    *,
    verbose: Annotated[bool, typer.Option("--verbose", help="List everything that was looked at.")] = False,
    console: Shown,
) -> None:
    """Say what works on this computer, and how to install the rest."""
    from guise.app.tools.doctor import as_json, conclusion, examine

    findings = examine()
    if verbose:
        words = {True: "works", False: "missing", None: "optional"}
        rows = [[f.topic, f.name, words[f.ok], f.detail] for f in findings]
        console.grid("Guise on this computer", ["", "what", "", "detail"], rows)
    console.say(conclusion(findings))
    console.result(as_json(findings))


@takes
def bench(
    *,
    clip: Annotated[
        Path | None,
        typer.Argument(metavar="[VIDEO]", help="The clip to measure with; default: a sample clip."),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            metavar="SRC", help="Model of the person in VIDEO, a file or a name; default: they are enrolled."
        ),
    ] = None,
    identity: Annotated[
        str | None,
        typer.Option(
            metavar="FACE", help=f"The face that is shown: {FACE_HELP}; default: the same person's."
        ),
    ] = None,
    samples: Samples = None,
    frames: Annotated[int, typer.Option(min=20, help="Number of frames to measure.")] = 150,
    console: Shown,
) -> None:
    """Measure how long each stage of a frame takes on this computer, and a whole file beside its transcode."""
    from guise.app.tools.bench import measure, measure_file, prepare
    from guise.common.kernels import RUNNING

    with Stages(console) as stages:
        clip, person, shown = prepare(clip, source, identity, samples, progress=stages, say=console.note)
        timings = measure(clip, person, shown, frames=frames, say=console.note)
        whole = measure_file(clip, person, shown)
    rows = [[t.renderer, t.stage, f"{t.median:.2f}", f"{t.p95:.2f}"] for t in timings]
    console.grid(
        f"{clip.name}: milliseconds a frame, kernels of {RUNNING}",
        ["renderer", "stage", "median", "95 %"],
        rows,
    )
    rows = [
        ["wall time, s", f"{whole.seconds:.2f}", f"{whole.transcode_seconds:.2f}", f"{whole.over_transcode:.2f}"],
        [
            "processor time, s", f"{whole.processor_seconds:.2f}", f"{whole.transcode_processor_seconds:.2f}",
            f"{whole.processor_over_transcode:.2f}",
        ],
        ["first packet, s", f"{whole.first_packet_seconds:.2f}", "", ""],
        ["encoder idle", f"{whole.encoder_idle_share:.0%}", "", ""],
    ]  # fmt: skip
    console.grid(
        f"{clip.name}: all {whole.frames} frames", ["", "swap", "transcode (the limit)", "ratio"], rows
    )
    console.result(
        {
            "clip": str(clip),
            "kernels": RUNNING,
            "milliseconds": [t.as_json() for t in timings],
            "file": whole.as_json(),
        }
    )
