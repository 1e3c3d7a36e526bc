"""What is measured, as a user says it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from guise.app.swapping import FACE_HELP, LANDMARKER_HELP
from guise.common.option import option


@dataclass(frozen=True)
class MeasureOptions:
    """What outputs are measured with, beside their original.

    landmarker : see `guise.aam.landmarks.open_landmarker`; None for the built-in one.
    """

    recognisers: tuple[Path, ...] = option(
        (),
        "A face recogniser; without it only utility is measured. With --attack it may be repeated.",
        name="--recogniser",
        metavar="CARD.toml",
    )
    gallery: Path | None = option(
        None,
        "Other people: a picture, a video or a folder of them for each.",
        name="--distractors",
        metavar="DIR",
    )
    identities: tuple[str, ...] = option(
        (),
        f"A face that the outputs show: {FACE_HELP}; may be repeated.",
        name="--identity",
        metavar="FACE",
    )
    reports: tuple[Path, ...] = option(
        (),
        "A report that `guise deidentify` wrote of an output; may be repeated.",
        name="--output-report",
        metavar="NAME.report.json",
    )
    landmarks: Path | None = option(
        None,
        "Landmarks of ORIGINAL (.npz, .json, .pts); default: found by the landmarker.",
        metavar="FILE",
    )
    landmarker: str | None = option(None, LANDMARKER_HELP, metavar="SPEC")
