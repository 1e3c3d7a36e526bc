"""How the engine draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from guise.aam.extrapolation import DEFAULT_ALPHA
from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_EYE, RIGHT_EYE, Group
from guise.render.compositor import Renderer


@dataclass(frozen=True)
class EngineOptions:
    """How the engine draws.

    Parameters
    ----------
    alpha : share in [0, 1] of the expression outside the donor's own space that is let through.
    renderer : "auto", "gl" or "cpu".
    light : "learned", by a network, or "classical", ratios of local means of skin; both keep hard shadows, and what
        hides the face stays in front of it. "paper", smooth fields and one similarity of colours, drawn over all.
    transfer : "full", the face is fitted into the head at rest, and its shape moves as much as the source's; "paper",
        the shape moves within the donor's own space and a share `alpha` outside it, and lies on the head by its rigid
        landmarks.
    palette : "symmetric" or "least-squares" scale of the colour similarity of light "paper".
    jaw, forehead : face widths by which they are drawn beyond the head's outline, the forehead most in its middle, to
        hide the rim of the face as well.
    hold_frames : for which a lost face keeps its last place.
    occluders : what stays in front of the drawn face: "all" that is in front of the person's, hair and glasses too;
        "objects", only those that reach in from beyond the face, so that no part of it shows by mistake; or "none".
    eyes, mouth : whose eyeballs and inside of the mouth show between the drawn lids and lips; in a disguise never the
        source's.
    outline : share in [0, 1] by which the head's jaw line goes to the face's own, with a little of what is beside it;
        with transfer "full" only.
    disguise : draw the features in other proportions, see `proportions`, and everything within the outline, so that
        the person is harder to recognise from what remains of the head (hair, ears, neck). No hair and no glasses of
        theirs stay in front but strands at the rim of a higher forehead; eyes are drawn anew, see `Eyeballs`.
    """

    alpha: float = DEFAULT_ALPHA
    renderer: Renderer = "auto"
    light: Literal["learned", "classical", "paper"] = "learned"
    transfer: Literal["full", "paper"] = "full"
    palette: Literal["symmetric", "least-squares"] = "symmetric"
    jaw: float = 0.0
    forehead: float = 0.0
    hold_frames: int = 4
    occluders: Literal["all", "objects", "none"] = "all"
    eyes: Literal["donor", "source"] = "source"
    mouth: Literal["donor", "source"] = "source"
    outline: float = 0.0
    disguise: bool = False

    @property
    def in_front(self) -> Literal["all", "objects", "none"]:
        """What stays in front of the drawn face; "all" is drawn over in a disguise and with the light "paper"."""
        if self.occluders == "all" and (self.disguise or self.light == "paper"):
            return "none"
        return self.occluders

    @property
    def follows_outline(self) -> bool:
        """Whether pixels beside the face change, too."""
        return self.outline > 0 and self.transfer == "full" and not self.disguise

    @property
    def eyes_of_source(self) -> bool:
        """Whether the source's eyeballs show between the drawn lids."""
        return self.eyes == "source" and not self.disguise

    @property
    def follows_eyes(self) -> bool:
        """Whether the drawn eyes look where the source's do."""
        return self.eyes_of_source or self.disguise

    @property
    def source_parts(self) -> tuple[Group, ...]:
        """Landmark groups inside which the source's own face shows; in a disguise nowhere."""
        if self.disguise:
            return ()
        eyes = (RIGHT_EYE, LEFT_EYE) if self.eyes_of_source else ()
        return (*eyes, INNER_LIPS) if self.mouth == "source" else eyes

    @property
    def shut_parts(self) -> tuple[Group, ...]:
        """Landmark groups inside which the source's own face shows while they are shut."""
        if self.disguise or self.light == "paper":
            return ()
        return RIGHT_EYE, LEFT_EYE
