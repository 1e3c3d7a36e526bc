"""The commands `guise enroll`, `guise info` and `guise landmarks`."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.console import Stages
from guise.app.cli.options import (
    DetectorSpec,
    EncodeChoices,
    Force,
    FormatChoice,
    LandmarkerSpec,
    LandmarkFiles,
    LandmarkOutput,
    MinConfidence,
    NoSmooth,
    Overlay,
    Part,
    Rest,
    Shown,
    Video,
    landmark_source,
    takes,
)
from guise.app.enrolment.options import TrainingChoices
from guise.app.swapping import FACE_HELP

Clips = Annotated[
    list[Path], typer.Argument(metavar="VIDEO...", help="Clips of one person, or one to nine photos.")
]
ModelOutput = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="NAME.guise",
        help="The model file to write; default: the person is saved by name; see `guise people`.",
    ),
]
Name = Annotated[str | None, typer.Option(help="The person's name; default: that of the file.")]
Person = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="NUMBER",
        help="Which person of a clip that shows several; see `guise people find`.",
    ),
]
Refine = Annotated[
    bool | None,
    typer.Option(
        "--refine/--no-refine",
        help="Refine detected landmarks over all frames together; default: unless the landmarker is builtin.",
    ),
]


@takes
def enroll(
    *,
    videos: Clips,
    output: ModelOutput = None,
    landmarks: LandmarkFiles = None,
    landmarker: LandmarkerSpec = None,
    training: Annotated[TrainingChoices, Part(TrainingChoices)],
    name: Name = None,
    person: Person = None,
    rest: Rest = None,
    refine: Refine = None,
    force: Force = False,
    console: Shown,
) -> None:
    """Learn a model of a person's face from one or more clips, or from a photo."""
    from guise.aam.model import Identity
    from guise.app.enrolment.file import enrol_file
    from guise.app.enrolment.rest import frame_at
    from guise.app.people.kept import place_for
    from guise.app.photos.enrol_photos import are_photos, enrol_photos
    from guise.app.swapping.file import enrolment_grade

    if person is not None and len(videos) > 1:
        raise typer.BadParameter("--person chooses among the people of one clip: give one clip")
    source = replace(landmark_source(landmarks or [], landmarker, len(videos)), refine=refine)
    options = training.training()
    if rest is not None:
        options = replace(options, rest_frame=frame_at(videos[0], rest).index)
    name = name or (output or videos[0]).stem
    output = output or place_for(name)
    photos = are_photos(videos)
    if photos and (landmarks or landmarker or person or refine is not None):
        raise typer.BadParameter(
            "photos are enrolled by the built-in landmarker: leave its options and --person out"
        )
    with Stages(console) as stages:
        if photos:
            report = enrol_photos(
                videos, output, name=name, options=options, force=force, progress=stages, say=console.note
            )
        else:
            report = enrol_file(
                videos, output, source, name=name, person=person, options=options, force=force, progress=stages,
                say=console.note,
            )  # fmt: skip
    if console.quiet and not console.json:
        return  # nothing is shown of what follows
    graded = enrolment_grade(Identity.load(report.output))
    quality = {} if graded is None else {"quality": str(graded)}
    console.table(f"{report.output}: {report.name}", report.as_rows() | quality)
    console.result(report.as_json() | {"grade": graded and graded.score})


@takes
def info(
    *,
    model: Annotated[
        str,
        typer.Argument(
            metavar="FACE", help=f"A model that `guise enroll` made, or another face: {FACE_HELP}."
        ),
    ],
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.png",
            help="Also draw the mean, the neutral face and the modes at ±2 standard deviations.",
        ),
    ] = None,
    force: Force = False,
    console: Shown,
) -> None:
    """Show what is in a model."""
    from guise.app.people.info import describe
    from guise.app.swapping.donors import face_file
    from guise.common.files import require_free

    if picture is not None:
        require_free(picture, force=force)
    with face_file(model) as path:
        identity, facts = describe(path)
    if picture is not None:
        from guise.app.media.pictures import save_picture
        from guise.app.people.montage import montage

        save_picture(picture, montage(identity))
    console.table(model, facts.as_rows())
    if picture is not None:
        console.say(f"picture: {picture}")
    console.result(asdict(facts) | {"montage": picture and str(picture)})


@takes
def landmarks(
    *,
    video: Video,
    output: LandmarkOutput,
    overlay: Overlay = None,
    format: FormatChoice = None,
    landmarker: LandmarkerSpec = None,
    detector: DetectorSpec = None,
    min_confidence: MinConfidence = 0.5,
    no_smooth: NoSmooth = False,
    encoding: Annotated[EncodeChoices, Part(EncodeChoices, ("encoder", "crf"))],
    force: Force = False,
    console: Shown,
) -> None:
    """Detect the landmarks of all faces in a video, an image or a folder of images."""
    from guise.aam.landmarks import open_landmarker
    from guise.app.landmarks.file import LandmarkOptions, landmarks_file

    spec = (landmarker or "builtin") + (f"@{detector}" if detector else "")
    options = LandmarkOptions(
        form=format, overlay=overlay, min_confidence=min_confidence, smooth=not no_smooth,
        encode=encoding.options(), force=force,
    )  # fmt: skip
    with Stages(console) as stages:
        report = landmarks_file(
            video, output, open_landmarker(spec), options, progress=stages, say=console.note
        )
    console.say(str(report))
    console.result(report.as_json())
