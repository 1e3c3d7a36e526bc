"""How an expression is transferred to a photo, as a user says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from guise.app.swapping import LANDMARKER_HELP
from guise.common.option import option


@dataclass(frozen=True)
class AnalogyOptions:
    """How an expression is transferred.

    landmarker : see `guise.aam.landmarks.open_landmarker`; None for the built-in one.
    """

    method: Literal["tents", "ratio", "warp"] = option(
        "tents",
        "Vertex tents on the luminance, or the methods they are compared with: ratio images, geometry only.",
    )
    mouth: Literal["fill", "none"] = option(
        "fill",
        "What an opening mouth shows: the teeth and tongue of S1 (fill), or the stretched lips of T (none).",
        name="--open-mouth",
    )
    strength: float = option(1.0, "Strength of the expression; 1 leaves it as it is.", least=0.0, most=2.0)
    landmarker: str | None = option(None, LANDMARKER_HELP, metavar="SPEC")
    force: bool = option(False, "Replace an existing output.")
