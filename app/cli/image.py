"""The commands `guise analogy image` and `guise analogy animate`: expressions of a photo or clip on another photo."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Crf, Encoder, Force, Json, LandmarkerSpec, Lossless, Preset, Quiet

if TYPE_CHECKING:
    from guise.app.photos.image import AnalogyOptions


class PhotoMethodName(StrEnum):
    """How an expression is transferred."""

    tents = "tents"
    ratio = "ratio"
    warp = "warp"


class MouthName(StrEnum):
    """What an opening mouth shows."""

    fill = "fill"
    none = "none"


NEUTRAL = "A photo of a person, neutral."
Target = Annotated[Path, typer.Argument(metavar="T", help="A photo of another person, neutral.")]
Method = Annotated[
    PhotoMethodName,
    typer.Option(
        help="Vertex tents on the luminance, or the methods they are compared with: ratio images, geometry only."
    ),
]
Strength = Annotated[
    float, typer.Option(min=0.0, max=2.0, help="Strength of the expression; 1 leaves it as it is.")
]
Mouth = Annotated[
    MouthName,
    typer.Option(help="What an opening mouth shows: teeth and tongue of S1, or the stretched lips of T."),
]
LandmarksS = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Landmarks of S (.npz, .json, .pts); default: detected.")
]
LandmarksS1 = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of S1; default: detected.")]
LandmarksT = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of T; default: detected.")]


def image(
    source: Annotated[Path, typer.Argument(metavar="S", help=NEUTRAL)],
    expressive: Annotated[
        Path, typer.Argument(metavar="S1", help="A photo of the same person with an expression.")
    ],
    target: Target,
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="T1.png", help="T with the expression, at the size of T."),
    ],
    landmarks_s: LandmarksS = None,
    landmarks_s1: LandmarksS1 = None,
    landmarks_t: LandmarksT = None,
    landmarker: LandmarkerSpec = None,
    method: Method = PhotoMethodName.tents,
    strength: Strength = 1.0,
    mouth: Mouth = MouthName.fill,
    montage: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw S, S1, T and the result in a row.")
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Transfer an expression from one photo to another, with its wrinkles and shading."""
    from guise.app.photos.image import analogy_image

    console = Console(quiet=quiet, json=json)
    report = analogy_image(
        source, expressive, target, output, _options(method, strength, mouth, landmarker, force),
        landmarks={"s": landmarks_s, "s1": landmarks_s1, "t": landmarks_t}, montage=montage, say=console.note,
    )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


def animate(
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
    landmarker: LandmarkerSpec = None,
    method: Method = PhotoMethodName.tents,
    strength: Strength = 1.0,
    mouth: Mouth = MouthName.fill,
    encoder: Encoder = "libx264",
    crf: Crf = None,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Animate a photo with the expressions of the person in a clip."""
    from guise.app.media import EncodeOptions
    from guise.app.photos.animate import animate_file
    from guise.app.photos.driving_track import TrackingOptions

    neutral, clip, target = _split_photos(photos)
    if source is not None and landmarks is not None:
        raise typer.BadParameter("give either --source or --landmarks")
    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        report = animate_file(
            neutral, clip, target, output, _options(method, strength, mouth, landmarker, force),
            TrackingOptions(source, landmarker or "builtin", landmarks), landmarks={"s": landmarks_s, "t": landmarks_t},
            encode=EncodeOptions(encoder, crf, preset, lossless), progress=stages, say=console.note,
        )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


def _split_photos(photos: list[Path]) -> tuple[Path | None, Path, Path]:
    if len(photos) not in (2, 3):
        raise typer.BadParameter(f"expected CLIP and T, or S, CLIP and T, got {len(photos)} files")
    return (photos[0] if len(photos) == 3 else None), photos[-2], photos[-1]


def _options(
    method: PhotoMethodName, strength: float, mouth: MouthName, landmarker: str | None, force: bool
) -> AnalogyOptions:
    from guise.app.photos.image import AnalogyOptions

    return AnalogyOptions(method.value, mouth.value, strength, landmarker or "builtin", force)
