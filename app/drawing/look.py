"""The five ways to draw one face over another, and what a user may choose about them, in every command that draws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from guise.common.decay import FRAME_SECONDS
from guise.common.option import option
from guise.common.tuned import derived, tuned

if TYPE_CHECKING:
    from guise.render.compositor import Renderer

Whose = Literal["source", "donor", "painted"]
Glasses = Literal["off", "keep"]
InFront = Literal["all", "hair", "objects"]
Kind = Literal["swap", "live", "disguise", "puppet", "paper"]


@dataclass(frozen=True)
class Look:
    """How a face is drawn; `SWAP`, `LIVE`, `DISGUISE`, `PUPPET` and `PAPER` are those there are.

    Parameters
    ----------
    kind : which passes draw it, see `guise.app.drawing.plan`.
    alpha : share in [0, 1] of the expression outside the donor's own space that is let through.
    renderer : "auto", "gl" or "cpu".
    eyes, mouth : whose eyeballs and inside of the mouth show between the drawn lids and lips; "painted" eyes are
        nobody's.
    in_front : what stays in front of the drawn face: "all" that is in front of the person's, hair and glasses too;
        "objects", only those that reach in from beyond the face, so that no part of it shows by mistake; "hair", these
        and hair that reaches in.  The looks "paper" and "puppet" draw over all.
    glasses : whether those of a donor who wears some come along, over who wears none.  The donor's face is the same.
        "own" are the person's, which stay where otherwise only objects and hair do.
    outline : share in [0, 1] by which the head's jaw line goes to the face's own, with a little of what is beside it.
    apart : share by which the face differs more from the person's at rest than the donor's does.
    jaw, forehead : face widths by which the face is drawn beyond the head's outline, the forehead most in the
        middle, to hide the rim of the face as well.
    exact : by the papers' formulas as they stand: "paper" neither anchored on neutral faces nor gated, "puppet" in the
        papers' light.
    hold_seconds : for which a lost face keeps its last place.
    """

    kind: Kind
    alpha: float = derived(
        0.6, "share", "DEFAULT_ALPHA of guise.aam.extrapolation, which takes long to import"
    )
    renderer: Renderer = "auto"
    eyes: Whose = "source"
    mouth: Whose = "source"
    in_front: InFront = "all"
    glasses: Glasses | Literal["own"] = "off"
    outline: float = 0.0
    apart: float = 0.0
    jaw: float = 0.0
    forehead: float = 0.0
    exact: bool = False
    hold_seconds: float = tuned(4 * FRAME_SECONDS, "seconds", "unswapped")


# The face is fitted into the head at rest and moves as far as the head does, in the light of the scene.
SWAP = Look("swap")
# The same for a camera, where nobody looks the frames through: nothing of the person's features shows by mistake.
LIVE = Look("live", eyes="donor", in_front="objects", jaw=tuned(0.035, "face widths", "live.closed"))
# Up to the person's hair and a little beyond the jaw, with features that lie farther from the person's than the donor's
# do, so that the person is harder to recognise from what remains of the head; nothing of their eyes and skin.
DISGUISE = Look(
    "disguise",
    eyes="painted",
    in_front="hair",
    apart=tuned(0.9, "share", "deidentify.attack"),
    jaw=tuned(0.05, "face widths", "deidentify.identity"),
    forehead=tuned(0.28, "face widths", "deidentify.identity"),
)
# The donor's own head in a still, moved by the expressions of the person.
PUPPET = Look("puppet", eyes="donor", mouth="donor")
# The plain formulas of de la Hunty, Asthana and Goecke (ICPR 2010), as a reference.
PAPER = Look("paper")
LOOKS = {look.kind: look for look in (SWAP, LIVE, DISGUISE, PUPPET, PAPER)}

LookName = Literal["swap", "paper", "exact"]
Owner = Literal["donor", "source"]


@dataclass(frozen=True)
class DrawingChoices:
    """How a face is drawn, as a user says it; see `Look` for what it means."""

    look: LookName = option(
        "swap",
        "How the face is drawn: swap is the best; paper (the papers' formulas) and exact (the first paper's to the "
        "letter) are for comparison, and draw over hands.",
    )
    alpha: float = option(
        Look.alpha,
        "Strength of expressions that the identity never showed, 0 to 1.",
        least=0.0,
        most=1.0,
    )
    eyes: Owner = option(
        "source",
        "Eyes between the lids: the identity's (donor), or the person's own in the identity's eye colour (source).",
    )
    mouth: Owner = option("source", "Teeth and tongue: the identity's (donor) or the person's own (source).")
    glasses: Glasses = option(
        "off",
        "The identity's glasses: off, or keep, which draws them where the person wears none.",
    )
    outline: float = option(
        0.0,
        "How far the jaw line moves to the identity's, 0 to 1; 0 keeps the person's.",
        least=0.0,
        most=1.0,
    )
    renderer: Literal["auto", "gl", "cpu"] = option("auto", "Which renderer draws the face.")

    def of(self, usual: Look) -> Look:
        """The look for these choices.   usual : that of the command."""
        look = usual if self.look == "swap" else replace(PAPER, exact=self.look == "exact")
        return replace(
            look, alpha=self.alpha, renderer=self.renderer, eyes=self.eyes, mouth=self.mouth, glasses=self.glasses,
            outline=self.outline,
        )  # fmt: skip


LIVE_CHOICES = DrawingChoices(eyes="donor")  # a face that is worn shows no irises of the person's unasked
