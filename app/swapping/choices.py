"""What a user may choose about the drawing of a face, in every command that draws one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from guise.common.option import option
from guise.common.tuned import derived

FACE_HELP = (
    "NAME.guise, a name of `guise people list`, or a fictional face: Luca, Amara, Mei, Walter, Kofi, Elena, Kenji, "
    "Asha, Omar"
)

LookName = Literal["swap", "paper", "exact"]
Owner = Literal["donor", "source"]


@dataclass(frozen=True)
class DrawingChoices:
    """How a face is drawn, as a user says it; see `guise.app.drawing.look.Look` for what it means."""

    look: LookName = option(
        "swap",
        "How the face is drawn: swap, as well as Guise can; or for comparison, and over hands, too, paper, by the "
        "papers' plain formulas, or exact, by the first paper's as they stand.",
    )
    alpha: float = option(
        derived(0.6, "share", "DEFAULT_ALPHA of guise.aam.extrapolation, which takes long to import"),
        "How much expression beyond the identity's own range is passed on, 0 to 1.",
        least=0.0,
        most=1.0,
    )
    eyes: Owner = option(
        "source",
        "Eyeballs between the lids: the identity's (donor) or the person's own with the identity's iris colour "
        "(source).",
    )
    mouth: Owner = option(
        "source", "Teeth and tongue between the lips: the identity's (donor) or the person's own."
    )
    outline: float = option(
        0.0,
        "How far the head's jaw line goes to the identity's, with what is near it, 0 to 1; 0 keeps the head's.",
        least=0.0,
        most=1.0,
    )
    renderer: Literal["auto", "gl", "cpu"] = option("auto", "Which renderer draws the face.")


LIVE_CHOICES = DrawingChoices(eyes="donor")  # a face that is worn shows no irises of the person's unasked
