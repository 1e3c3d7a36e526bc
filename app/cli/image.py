"""The commands `guise analogy image` and `guise analogy animate`: expressions of a photo or clip on another photo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from guise.app.cli.console import Stages
from guise.app.cli.options import Encode, Part, Shown, takes
from guise.app.photos.options import AnalogyOptions

NEUTRAL = "Photo 1: a person with a neutral face."
Target = Annotated[Path, typer.Argument(metavar="T", help="Photo 3: another person with a neutral face.")]
Options = Annotated[AnalogyOptions, Part(AnalogyOptions)]
LandmarksS = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Landmarks of S (.npz, .json, .pts); default: detected.")
]
LandmarksS1 = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of S1; default: detected.")]
LandmarksT = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of T; default: detected.")]


@takes
def image(
    *,
    source: Annotated[Path, typer.Argument(metavar="S", help=NEUTRAL)],
    expressive: Annotated[
        Path, typer.Argument(metavar="S1", help="Photo 2: the same person with an expression.")
    ],
    target: Target,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="T1.png", help="T with the expression, at the size of T."),
    ],
    landmarks_s: LandmarksS = None,
    landmarks_s1: LandmarksS1 = None,
    landmarks_t: LandmarksT = None,
    options: Options,
    picture: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw S, S1, T and the result in a row.")
    ] = None,
    console: Shown,
) -> None:
    """Copy the expression from photo 1 to 2 onto photo 3, with its wrinkles and shading."""
    from guise.app.photos.image import analogy_image

    report = analogy_image(
        source, expressive, target, output, options,
        landmarks={"s": landmarks_s, "s1": landmarks_s1, "t": landmarks_t}, montage=picture, say=console.note,
    )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


@takes
def animate(
    *,
    photos: Annotated[
        list[Path],
        typer.Argument(
            metavar="[S] CLIP T",
            help="A neutral photo of the person in CLIP (default: the most neutral frame of CLIP), the clip, and a "
            "neutral photo of another person.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT.mp4", help="T, animated, with the sound of CLIP.")
    ],
    source: Annotated[
        str | None,
        typer.Option(
            "--source", metavar="SRC", help="Model of the person in CLIP, for tracking, a file or a name."
        ),
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Landmarks of CLIP; default: detected and tracked.")
    ] = None,
    landmarks_s: LandmarksS = None,
    landmarks_t: LandmarksT = None,
    options: Options,
    encoding: Encode,
    console: Shown,
) -> None:
    """Animate a photo with the expressions of the person in a clip."""
    from guise.app.photos.animate import animate_file
    from guise.app.photos.driving_track import TrackingOptions

    neutral, clip, target = _split_photos(photos)
    if source is not None and landmarks is not None:
        raise typer.BadParameter("give either --source or --landmarks")
    with Stages(console) as stages:
        report = animate_file(
            neutral, clip, target, output, options,
            TrackingOptions(source, options.landmarker, landmarks), landmarks={"s": landmarks_s, "t": landmarks_t},
            encode=encoding.options(), progress=stages, say=console.note,
        )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


def _split_photos(photos: list[Path]) -> tuple[Path | None, Path, Path]:
    if len(photos) not in (2, 3):
        raise typer.BadParameter(f"expected CLIP and T, or S, CLIP and T, got {len(photos)} files")
    return (photos[0] if len(photos) == 3 else None), photos[-2], photos[-1]
