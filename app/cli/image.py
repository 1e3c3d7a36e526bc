"""The commands `guise analogy image` and `guise analogy animate`: expressions from one photo, or a clip, to another."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from guise.app.cli.console import Console, Stages
from guise.app.cli.options import Crf, Encoder, Force, Json, LandmarkerSpec, Lossless, Preset, Quiet

if TYPE_CHECKING:
    from guise.app.photos.image import How


class MethodName(StrEnum):
    """How an expression is carried over."""

    tents = "tents"
    ratio = "ratio"
    warp = "warp"


class MouthName(StrEnum):
    """What a mouth that opens shows."""

    fill = "fill"
    none = "none"


NEUTRAL = "A photo of a person, neutral."
Target = Annotated[Path, typer.Argument(metavar="T", help="A photo of another person, neutral.")]
Method = Annotated[
    MethodName,
    typer.Option(
        help="Vertex tents on the luminance, or what they were compared with: ratio images, geometry alone."
    ),
]
Strength = Annotated[float, typer.Option(min=0.0, max=2.0, help="Of the expression; 1 is as it is.")]
Mouth = Annotated[
    MouthName,
    typer.Option(help="What a mouth that opens shows: teeth and tongue of S1, or T's stretched lips."),
]
LandmarksS = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Landmarks of S (.npz, .json, .pts); default: found.")
]
LandmarksS1 = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of S1; default: found.")]
LandmarksT = Annotated[Path | None, typer.Option(metavar="FILE", help="Landmarks of T; default: found.")]


def image(
    source: Annotated[Path, typer.Argument(metavar="S", help=NEUTRAL)],
    expressive: Annotated[
        Path, typer.Argument(metavar="S1", help="A photo of the same person with an expression.")
    ],
    target: Target,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="T1.png", help="T with the expression, of T's size.")
    ],
    landmarks_s: LandmarksS = None,
    landmarks_s1: LandmarksS1 = None,
    landmarks_t: LandmarksT = None,
    landmarker: LandmarkerSpec = None,
    method: Method = MethodName.tents,
    strength: Strength = 1.0,
    mouth: Mouth = MouthName.fill,
    montage: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Also draw S, S1, T and the result in a row.")
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Carry an expression from one photo over to another, with its wrinkles and shading."""
    from guise.app.photos.image import analogy_image

    console = Console(quiet=quiet, json=json)
    report = analogy_image(
        source, expressive, target, output, _how(method, strength, mouth, landmarker, force),
        landmarks={"s": landmarks_s, "s1": landmarks_s1, "t": landmarks_t}, montage=montage, say=console.note,
    )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


def animate(
    photos: Annotated[
        list[Path],
        typer.Argument(
            metavar="[S] CLIP T",
            help="A neutral photo of the person in CLIP (default: the frame of CLIP nearest to a face at rest), the "
            "clip, and a neutral photo of another person.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT.mp4", help="T, moved, with the sound of CLIP.")
    ],
    model: Annotated[
        Path | None,
        typer.Option(metavar="NAME.guise", help="Model of the person in CLIP, whose tracker follows them."),
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Landmarks of CLIP; default: found and followed.")
    ] = None,
    landmarks_s: LandmarksS = None,
    landmarks_t: LandmarksT = None,
    landmarker: LandmarkerSpec = None,
    method: Method = MethodName.tents,
    strength: Strength = 1.0,
    mouth: Mouth = MouthName.fill,
    encoder: Encoder = "libx264",
    crf: Crf = 20,
    preset: Preset = "veryfast",
    lossless: Lossless = False,
    force: Force = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Move a photo by the expressions of the person in a clip."""
    from guise.app.media import EncodeOptions
    from guise.app.photos.animate import animate_file
    from guise.app.photos.driver import Tracking

    source, clip, target = _three(photos)
    if model is not None and landmarks is not None:
        raise typer.BadParameter("give either --model or --landmarks")
    console = Console(quiet=quiet, json=json)
    with Stages(console) as stages:
        report = animate_file(
            source, clip, target, output, _how(method, strength, mouth, landmarker, force),
            Tracking(model, landmarker or "builtin", landmarks), landmarks={"s": landmarks_s, "t": landmarks_t},
            encode=EncodeOptions(encoder, crf, preset, lossless), progress=stages, say=console.note,
        )  # fmt: skip
    console.say(str(report))
    console.result(report.as_json())


def _three(photos: list[Path]) -> tuple[Path | None, Path, Path]:
    if len(photos) not in (2, 3):
        raise typer.BadParameter(f"expected CLIP and T, or S, CLIP and T, got {len(photos)} files")
    return (photos[0] if len(photos) == 3 else None), photos[-2], photos[-1]


def _how(method: MethodName, strength: float, mouth: MouthName, landmarker: str | None, force: bool) -> How:
    from guise.app.photos.image import How

    return How(method.value, mouth.value, strength, landmarker or "builtin", force)
