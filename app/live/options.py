"""What `guise live` is told, at its start and by keys."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from guise.app.drawing.look import LIVE, Look
from guise.app.swapping import FACE_HELP
from guise.common.option import option

if TYPE_CHECKING:
    from guise.app.media import EncodeOptions

Mode = Literal["swap", "puppet", "off"]


@dataclass(frozen=True)
class LiveSettings:
    """How the next frame is processed and shown.

    Parameters
    ----------
    identity : index of the donor face.
    alpha : share in [0, 1] of the expression beyond the donor's own range that is let through.
    mirror : flip left and right.
    mask, mesh : overlays that show where the face is drawn.
    help : show the keys.
    """

    identity: int = 0
    alpha: float = LIVE.alpha
    mode: Mode = option("swap", "Swap the face, animate a still of the identity (puppet), or cover (off).")
    mirror: bool = False
    side_by_side: bool = option(False, "Show the real face beside the result, in the window only.")
    mask: bool = False
    mesh: bool = False
    readout: bool = option(False, "Show frame rate, latency and dropped frames in the window.")
    help: bool = False
    style: Literal["solid", "mosaic", "blur"] = option("mosaic", "How a face is covered.", name="--cover")
    unsure: Literal["cover", "leave"] = option(
        "cover", "A face that cannot be swapped: cover it, or leave the picture as it is."
    )


def _encoding() -> EncodeOptions:
    from guise.app.media import EncodeOptions

    return EncodeOptions(crf=20)


@dataclass(frozen=True)
class LiveOptions:
    """Options of `guise live`.

    Parameters
    ----------
    outputs : "window", "virtualcam" or files.
    size : requested of the camera.
    settings : initial settings.   look : how faces are drawn.   encode : of files.
    cast : instead of identities and source, the face of each of several people, by their models; everybody else is
        covered.
    """

    input: str | None = option(
        None,
        "A video or a stream (rtsp, http ...); default: the camera. A video plays at its own pace; into files alone, "
        "every frame is written, as fast as possible.",
        metavar="FILE|URL",
    )
    camera: int = option(0, "Number of the camera.", metavar="N", least=0)
    identities: tuple[str, ...] = option(
        (),
        f"The face that is shown: {FACE_HELP}; repeat to choose among several with the number keys; default: the "
        "fictional faces.",
        name="--identity",
        metavar="FACE",
    )
    source: str | None = option(
        None,
        "Model of the person in the picture; default: the one saved for this camera or file, or a new one.",
        metavar="SRC",
    )
    outputs: tuple[str, ...] = option(
        (),
        "Where the result goes; may be repeated; default: window.",
        name="--output -o",
        metavar="window|studio|virtualcam|OUT.mp4",
    )
    size: tuple[int, int] = (1280, 720)
    fps: float = option(30.0, "Frames per second to ask the camera for.", least=1, most=240)
    loop: bool = option(False, "Repeat the file.")
    enrol: bool = option(False, "Enroll the person again, even if their model is saved.", name="--enroll")
    settings: LiveSettings = field(default_factory=LiveSettings)
    look: Look = LIVE
    encode: EncodeOptions = field(default_factory=_encoding)
    force: bool = option(False, "Replace an existing output.")
    cast: Mapping[str, str] = field(default_factory=dict)
