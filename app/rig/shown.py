"""A frame of a live run with its coefficients."""

from __future__ import annotations

from dataclasses import dataclass

from guise.aam.rig.coefficients import Coefficients
from guise.app.live.output import OutputFrame
from guise.common.arrays import F32


@dataclass(frozen=True, eq=False)
class RigFrame(OutputFrame):
    """A frame.   coefficients : None without a face.   points : (81, 2) pixels, likewise.

    calibrated : by now.   calibrating : something is being asked for.
    """

    coefficients: Coefficients | None = None
    points: F32 | None = None
    calibrated: bool = False
    calibrating: bool = False
