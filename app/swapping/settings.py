"""How a file is swapped or puppeteered."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from guise.aam.landmarks import open_detector, open_landmarker
from guise.aam.person_tracker import FaceFinder
from guise.app.media import EncodeOptions
from guise.app.media.hardware import HardwareDecoder
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.unsure import UNSURE_HOLD_FRAMES, Unsure
from guise.common.progress import Progress, Say, mute, silent


@dataclass(frozen=True)
class SwapSettings:
    """How a file is made.

    Parameters
    ----------
    options : how the engine draws.
    encode : encoder, crf, preset, lossless.
    hwaccel : the device that decodes the video, "auto" for one that works, or "none" for the processor.
    detector : "builtin", the landmarker, or "lbp" or "yunet:MODEL.onnx", which find boxes: what finds the face at the
        start and after a loss.
    unsure : what is done to frames in which the person's face is lost but may be visible: "cover" it, "hold" the last
        face for a second, or "leave" the frame as it is.
    keep_people : use the model of the video's person that an earlier run has kept, and keep a new one.
    rest_seconds : after the first frame, at which the person in the video is at rest; None finds out.
    graded : say in the report how good the swap looks, which takes as long as some ten frames.
    force : replace an existing output.
    progress : called with the stage and the share of it that is done.
    say : called with notes for the user.
    """

    options: EngineOptions = EngineOptions()
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    hwaccel: HardwareDecoder = "none"
    detector: str = "builtin"
    unsure: Unsure = "cover"
    keep_people: bool = False
    rest_seconds: float | None = None
    graded: bool = True
    force: bool = False
    progress: Progress = silent
    say: Say = mute

    def engine_options(self) -> EngineOptions:
        """How the engine draws, with the frames for which a lost face is held."""
        held = max(self.options.hold_frames, UNSURE_HOLD_FRAMES if self.unsure == "hold" else 0)
        return replace(self.options, hold_frames=held)

    def face_finder(self) -> FaceFinder:
        """What finds the face."""
        return open_landmarker("builtin") if self.detector == "builtin" else open_detector(self.detector)


DEFAULTS = SwapSettings()
