"""How the engine draws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from guise.aam.extrapolation import DEFAULT_ALPHA
from guise.render.compositor import Renderer


@dataclass(frozen=True)
class EngineOptions:
    """How the engine draws.

    Parameters
    ----------
    alpha : share in [0, 1] of the expression outside the donor's own space that is let through.
    renderer : "auto", "gl" or "cpu".
    palette : "symmetric" or "least-squares" scale of the colour similarity.
    outline : share in [0, 1] by which jaw and forehead follow the head in the picture.
    jaw, forehead : face widths by which they are then drawn beyond it, the forehead most in its middle, to hide the
        rim of the face as well.
    disguise : draw the features in other proportions, see `proportions`, and everything within the outline, so that
        the person is harder to recognise from what remains of the head (hair, ears, neck).
    """

    alpha: float = DEFAULT_ALPHA
    renderer: Renderer = "auto"
    palette: Literal["symmetric", "least-squares"] = "symmetric"
    outline: float = 0.7
    jaw: float = 0.0
    forehead: float = 0.0
    disguise: bool = False
