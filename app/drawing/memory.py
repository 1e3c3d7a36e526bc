"""Everything that lasts from one drawn frame to the next, in seconds, so that 25 and 60 frames a second smooth alike.

A new face begins with a new `Memory`; nothing else of what draws changes from frame to frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from guise.aam.brows import BrowLift
from guise.aam.parsing import FaceParsing
from guise.aam.rims import RimMemory
from guise.aam.solid_shape import Sight
from guise.app.media import Frame
from guise.common.arrays import F32, F64
from guise.common.decay import FRAME_SECONDS
from guise.common.tuned import derived

LONGEST_STEP = 1.0  # seconds; what lasts longer is another scene
# by which something may be due early
SLACK = derived(1e-3, "seconds", "far less than a frame, far more than rounding")


@dataclass
class Clock:
    """The time of the frame that is drawn, and since the one before it, seconds."""

    now: float = 0.0
    step: float = FRAME_SECONDS
    _stamp: float | None = None

    def tick(self, frame: Frame) -> None:
        """Go on to a frame; one without a time of its own comes a usual step later."""
        base = frame.time_base
        stamp = frame.pts * base.numerator / base.denominator
        step = FRAME_SECONDS if self._stamp is None else stamp - self._stamp
        self.step = step if 0 < step <= LONGEST_STEP else FRAME_SECONDS
        self._stamp = stamp
        self.now += self.step

    def is_due(self, time: float) -> bool:
        """Whether a time has come."""
        return self.now >= time - SLACK


@dataclass(frozen=True, eq=False)
class Drawn:
    """The face as it was drawn last.

    time : when, seconds.   head : (81, 2) pixels.   sight : how it was seen.
    shape, texture : (81, 2) grid pixels, and (n, 3) RGB.
    """

    time: float
    head: F64
    sight: Sight
    shape: F64
    texture: F32


@dataclass
class CoverMemory:
    """What was in front of the face.

    due : when the next frame is parsed.   eyes : colours in the eyes as the last parsed frame had them.
    clear : (t, 3) RGB at the texels, where something is in front as it was seen before.   visible : (t,).
    worn, thing : (n,) shares of the cells that hair and glasses, and that objects hid.
    uncovered : (h, w) share that nothing hides; None is all of it.
    """

    due: float = 0.0
    parsed_at: float = -np.inf
    eyes: list[F32] = field(default_factory=list)
    clear: F32 | None = None
    visible: F32 | None = None
    worn: F32 | None = None
    thing: F32 | None = None
    uncovered: F32 | None = None


@dataclass
class LidMemory:
    """(2,) share of eye that is usual between the lids of each eye, and by how much they are open."""

    usual: F64 = field(default_factory=lambda: np.zeros(2))
    open: F64 = field(default_factory=lambda: np.ones(2))


@dataclass
class BrowMemory:
    """How brows lie off their points: by their hair, and (2,) by their looks, face widths down."""

    lift: BrowLift = field(default_factory=BrowLift)
    shifts: F64 | None = None


@dataclass
class GazeMemory:
    """(2, 2) places of the irises, eye widths: by the last parsing, and as they are found near by."""

    parsed: F64 = field(default_factory=lambda: np.zeros((0, 2)))
    places: F64 = field(default_factory=lambda: np.zeros((0, 2)))


@dataclass
class FaceLight:
    """An affine map of colours: gain and offset of each cell (6, h, w), and gains of eyes and mouth (2, 3)."""

    map: F32
    parts: F32


@dataclass
class PaperLightMemory:
    """(3, 3) similarity of colours, (8, 3) fields of light of the face and of the frame, and the brightest skin."""

    linear: F64 = field(default_factory=lambda: np.eye(3))
    own: F64 | None = None
    there: F64 | None = None
    bright: float = derived(255.0, "grey levels", "the brightest there is")
    updated: float = -np.inf


@dataclass
class SurfaceMemory:
    """Sharpness and grain of the frame beside those of the drawn face.

    gain : of fine contrast.   own_share : of the frame's own fine structure.   variance : of the grain, grey levels.
    began, sharpness_seen, grain_seen : when it was measured first and last, seconds.
    edges, grain : (n,) energies of the frame's skin before the face is drawn, if it is compared.
    """

    gain: float = 1.0
    own_share: float = 0.0
    variance: float = 0.0
    began: float | None = None
    sharpness_seen: float = -np.inf
    grain_seen: float = -np.inf
    edges: F32 | None = None
    grain: F32 | None = None


@dataclass
class Memory:
    """All of it.

    parsed : the last parsing, and (81, 2) where the head was then.
    """

    clock: Clock = field(default_factory=Clock)
    parsed: tuple[FaceParsing, F64] | None = None
    drawn: Drawn | None = None
    cover: CoverMemory = field(default_factory=CoverMemory)
    rims: RimMemory = field(default_factory=RimMemory)
    brows: BrowMemory = field(default_factory=BrowMemory)
    lids: LidMemory = field(default_factory=LidMemory)
    gaze: GazeMemory = field(default_factory=GazeMemory)
    light: FaceLight | None = None
    paper_light: PaperLightMemory = field(default_factory=PaperLightMemory)
    surface: SurfaceMemory = field(default_factory=SurfaceMemory)
