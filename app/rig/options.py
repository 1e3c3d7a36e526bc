"""What `guise rig` is told."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from guise.app.meshes.options import Unit
from guise.common.option import option

RIG_SUFFIXES = "X.csv|X.jsonl|X.glb|X.vrm"


@dataclass(frozen=True)
class RigOptions:
    """How coefficients are found and written.

    smooth : over the frames.   part : of the clip, as from and to.
    """

    head: Path | None = option(
        None,
        "The head in a .glb or .vrm: one with ARKit's shapes, or any, which gets them; default: the one that ships.",
        metavar="RIG.glb|AVATAR.vrm|HEAD.obj",
    )
    unit: Unit | None = option(
        None, "Unit of that head's lengths, where it is given shapes; default: as they are."
    )
    calibration: Path | None = option(
        None, "What `guise rig live` has learned of the person.", metavar="FILE.npz"
    )
    force: bool = option(False, "Replace an existing output.")


@dataclass(frozen=True)
class RigClipOptions(RigOptions):
    """Those of a clip besides.   smooth : over the frames."""

    calibrate: Path | None = option(
        None,
        "A clip of the person to calibrate by, in five equal parts: rest, brows up, smile, mouth open, lips puckered.",
        metavar="CLIP",
    )
    person: int | None = option(
        None, "Which person of a clip that shows several; see `guise people find`.", metavar="NUMBER", least=1
    )
    smooth: bool = True


@dataclass(frozen=True)
class RigLiveOptions(RigOptions):
    """Those of a live run besides.   window : whether there is one.   size : requested of the camera."""

    input: str | None = option(
        None, "A video or a stream (rtsp, http ...); default: the camera.", metavar="FILE|URL"
    )
    camera: int = option(0, "Number of the camera.", metavar="N", least=0)
    fps: float = option(30.0, "Frames per second to ask the camera for.", least=1, most=240)
    vmc: str | None = option(
        None,
        "Send by the VMC protocol to this address; the port is 39539 if left out.",
        metavar="HOST[:PORT]",
    )
    presets: bool = option(
        False, "Also send VRM's own expressions, such as A and Joy, for an avatar with only these."
    )
    output: Path | None = option(
        None, "Also write the curves when it ends.", name="--output -o", metavar=RIG_SUFFIXES
    )
    window: bool = True
    mirror: bool = False
    size: tuple[int, int] = (1280, 720)
