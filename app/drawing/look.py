"""The five ways to draw one face over another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from guise.aam.extrapolation import DEFAULT_ALPHA
from guise.common.tuned import tuned
from guise.render.compositor import Renderer

Whose = Literal["source", "donor", "painted"]
InFront = Literal["all", "objects"]
Kind = Literal["swap", "live", "disguise", "puppet", "paper"]


@dataclass(frozen=True)
class Look:
    """How a face is drawn; `SWAP`, `LIVE`, `DISGUISE`, `PUPPET` and `PAPER` are those there are.

    Parameters
    ----------
    kind : which passes draw it, see `guise.app.drawing.plan`.
    alpha : share in [0, 1] of the expression outside the donor's own space that is let through.
    renderer : "auto", "gl" or "cpu".
    eyes, mouth : whose eyeballs and inside of the mouth show between the drawn lids and lips; "painted" are nobody's.
    in_front : what stays in front of the drawn face: "all" that is in front of the person's, hair and glasses too;
        "objects", only those that reach in from beyond the face, so that no part of it shows by mistake.  The looks
        "paper" and "puppet" draw over all.
    outline : share in [0, 1] by which the head's jaw line goes to the face's own, with a little of what is beside it.
    jaw, forehead : face widths by which the face is drawn beyond the head's outline, the forehead most in the
        middle, to hide the rim of the face as well.
    exact : by the papers' formulas as they stand: "paper" neither anchored on neutral faces nor gated, "puppet" in the
        papers' light.
    hold_seconds : for which a lost face keeps its last place.
    """

    kind: Kind
    alpha: float = DEFAULT_ALPHA
    renderer: Renderer = "auto"
    eyes: Whose = "source"
    mouth: Whose = "source"
    in_front: InFront = "all"
    outline: float = 0.0
    jaw: float = 0.0
    forehead: float = 0.0
    exact: bool = False
    hold_seconds: float = tuned(4 / 30, "seconds", "unswapped")


# The face is fitted into the head at rest and moves as far as the head does, in the light of the scene.
SWAP = Look("swap")
# The same for a camera, where nobody looks the frames through: nothing of the person's features shows by mistake.
LIVE = Look("live", eyes="donor", in_front="objects", jaw=tuned(0.035, "face widths", "live.closed"))
# Features in other proportions and everything within the outline drawn anew, so that the person is harder to recognise
# from what remains of the head; no hair and no glasses of theirs but strands at the rim of a higher forehead.
DISGUISE = Look(
    "disguise",
    eyes="painted",
    mouth="painted",
    in_front="objects",
    jaw=tuned(0.05, "face widths", "deidentify.identity"),
    forehead=tuned(0.28, "face widths", "deidentify.identity"),
)
# The donor's own head in a still, moved by the expressions of the person.
PUPPET = Look("puppet", eyes="donor", mouth="donor")
# The plain formulas of de la Hunty, Asthana and Goecke (ICPR 2010), as a reference.
PAPER = Look("paper")
LOOKS = {look.kind: look for look in (SWAP, LIVE, DISGUISE, PUPPET, PAPER)}
