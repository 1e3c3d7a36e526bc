"""Options that calls share, under the names that they have on the command line.

As `**options` of a call they are checked by a type checker and, when it is made, by the call.
"""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from guise.common.progress import Progress, Say

if TYPE_CHECKING:
    from guise.app.media import EncodeOptions

AnyPath = str | os.PathLike[str]


class WatchOptions(TypedDict, total=False):
    """How a long call is watched.

    progress : called with the stage and the share of it that is done.   say : called with notes for the user.
    cancel : once it is set, from any thread, the call raises `Cancelled` and leaves no output behind.
    """

    progress: Progress
    say: Say
    cancel: threading.Event


class TrainOptions(TypedDict, total=False):
    """How a face is learned.

    frames : to train on, about 120 by default.   resolution : texture pixels across the face, 160 by default.
    retain : share of the variance that is kept.   modes : number of modes instead.
    """

    frames: int | None
    resolution: int | None
    retain: float | None
    modes: int | None


class DrawOptions(TypedDict, total=False):
    """How a face is drawn, see `guise.app.drawing.look.DrawingChoices`.

    alpha : share in [0, 1] of the expression outside the identity's own range that is let through.
    eyes, mouth : whose they are, the identity's ("donor") or the person's own ("source").
    glasses : of the identity, off or kept.   outline : share in [0, 1] by which the jaw line goes to the identity's.
    """

    look: Literal["swap", "paper", "exact"]
    alpha: float
    eyes: Literal["donor", "source"]
    mouth: Literal["donor", "source"]
    glasses: Literal["off", "keep"]
    outline: float
    renderer: Literal["auto", "gl", "cpu"]


class WriteOptions(TypedDict, total=False):
    """How a video is written.

    encoder : such as "libx264"; by default what suits the pictures.   encoder_preset : "veryfast" by default.
    crf : constant rate factor, lower is better and larger; by default as fine as the input.
    """

    encoder: str
    crf: int | None
    encoder_preset: str
    lossless: bool


class RangeOptions(TypedDict, total=False):
    """The part of a video that is worked on: seconds, or times as "1:30"; what is outside is kept as it is or cut."""

    start: float | str | None
    end: float | str | None
    outside: Literal["keep", "cut"]


class PuppetOptions(DrawOptions, WriteOptions, RangeOptions, WatchOptions, total=False):
    """How a file is swapped or puppeteered.

    landmarks : a file of those of the video, from which its person is enrolled.
    landmarker : "builtin" or "CARD.toml[@DETECTOR]".   detector : of faces, see `guise landmarks`.
    hwaccel : the device that decodes.
    keep : use the model of the video's person that an earlier call has kept on this computer, and keep a new one.
    overwrite : replace an existing output.
    """

    landmarks: AnyPath | None
    landmarker: str | None
    detector: str
    keep: bool
    overwrite: bool


class SwapFileOptions(PuppetOptions, total=False):
    """How a file is swapped.

    rest : seconds into the video at which the person's face is at rest.
    unsure : what is done where the person's face is lost but may be visible: "cover" it, "hold" the last face for a
        second, or "leave" the frame as it is.
    """

    hwaccel: Literal["none", "auto", "cuda", "vaapi", "videotoolbox", "d3d11va"]
    rest: float | None
    unsure: Literal["cover", "hold", "leave"]


def taken(options: dict[str, Any], kind: Any) -> dict[str, Any]:
    """The options of a kind, taken out."""
    return {name: options.pop(name) for name in kind.__annotations__ if name in options}


def encoding(options: dict[str, Any], **usual: Any) -> EncodeOptions:
    """How to encode, taken out of the options."""
    from guise.app.media import EncodeOptions

    found = taken(options, WriteOptions)
    if "encoder_preset" in found:
        found["preset"] = found.pop("encoder_preset")
    return EncodeOptions(**usual | found)


def preset(name: str, command: str) -> dict[str, Any]:
    """What a preset of `guise.toml` or of the studio says for a command, as options of its call.

    Raises GuiseError when no preset has that name.
    """
    from guise.api.vocabulary import RENAMED, speaking
    from guise.common.presets import preset as read

    with speaking:
        found = read(name, command)
    words = {key: key.replace("-", "_") for key in found}
    return {RENAMED.get(word, word): found[key] for key, word in words.items()}
