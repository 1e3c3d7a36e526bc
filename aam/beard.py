"""Beards on the reference grid, as two people's frames at rest show them.

The drawn face goes over into the person's skin at its border.  A beard is no skin: the person's would pass there for a
dark chin, and the donor's would be paled.  Only where the person's beard goes on below the face does the drawn chin go
over into it, as nothing else would end like that.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import JAW
from guise.aam.model import RestFrame
from guise.aam.parsing import FaceClass, FaceParser
from guise.aam.reference import ReferenceFrame
from guise.aam.without_glasses import disc
from guise.common.arrays import F32
from guise.common.small import mean, ramps


@dataclass(frozen=True)
class BeardLimits:
    """What of a parsed face is a beard."""

    share: tuple[float, float] = (0.3, 0.6)  # of a cell, up to which none is and from which all of it is
    growth_face_widths: float = 0.02
    below_jaw: float = (
        0.1  # of the way from the middle of the face to the jaw line, how far beyond it a beard goes on
    )
    goes_on: float = 0.3  # share there, from which it does
    edge_face_widths: float = (
        0.005  # standard deviation of the drawn face's border over beards, which end with it
    )
    beyond_jaw_face_widths: float = 0.02  # by which the face is drawn beyond the jaw line over the person's


LIMITS = BeardLimits()


def beard(rest: RestFrame, reference: ReferenceFrame) -> tuple[F32, bool]:
    """(h, w) share in [0, 1] of a beard, and whether it goes on below the face."""
    parsing = FaceParser().parse(rest.picture, rest.shape)
    hair, middle = parsing.share(FaceClass.FACIAL_HAIR), mean(rest.shape, 0)
    below = middle + (1 + LIMITS.below_jaw) * (rest.shape[JAW] - middle)
    goes_on = bool(parsing.at(below, hair).max() > LIMITS.goes_on)
    seen = ramps(parsing.at(reference.sampler.positions(rest.shape), hair), *LIMITS.share)
    share = reference.scatter(np.asarray(seen, np.float32))
    grown = cv2.dilate(share, disc(LIMITS.growth_face_widths * reference.resolution))
    return np.asarray(grown, np.float32), goes_on
