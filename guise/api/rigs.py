"""ARKit's coefficients of a person: of a clip to a file, and live to an avatar."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Unpack

from guise.api.options import AnyPath, WatchOptions
from guise.api.pictures import path_of
from guise.api.vocabulary import call, watch_of

if TYPE_CHECKING:
    from guise.app.rig.clip import RigReport
    from guise.app.rig.live import RigLiveReport

Unit = Literal["m", "dm", "cm", "mm", "in"]


class RigWriteOptions(WatchOptions, total=False):
    """What is written.

    head : shown by a .glb or .vrm: one with ARKit's shapes, or any, which is given them; by default the one that ships.
    unit : of that head's lengths.   calibration : what `rig_live` has learned of the person, .npz.
    overwrite : replace an existing output.
    """

    head: AnyPath | None
    unit: Unit | None
    calibration: AnyPath | None
    overwrite: bool


@call
def rig_from_video(
    clip: AnyPath,
    output: AnyPath,
    *,
    calibrate: AnyPath | None = None,
    person: int | None = None,
    smooth: bool = True,
    start: float | str | None = None,
    end: float | str | None = None,
    **options: Unpack[RigWriteOptions],
) -> RigReport:
    """Write ARKit's 52 coefficients of the person in a clip, and the turn of head and eyes.

    Parameters
    ----------
    output : .csv as Live Link Face writes it, .jsonl, or .glb or .vrm, an animated head.
    calibrate : a clip of the person, in five equal parts: at rest, brows up, smiling, mouth open, lips puckered.
    person : which one of a clip that shows several, a number of `find_people`.
    smooth : over the frames.   start, end : of the part, seconds, or times as "1:30".
    """
    from guise.app.media.time_range import TimeRange
    from guise.app.rig.clip import rig_clip
    from guise.app.rig.options import RigClipOptions

    left: dict[str, Any] = {**options}
    progress, say = watch_of(left)
    how = RigClipOptions(**_written(left), calibrate=path_of(calibrate), person=person, smooth=smooth)
    first, last = (None if one is None else str(one) for one in (start, end))
    part = TimeRange.between(first, last, "cut")
    return rig_clip(Path(clip), Path(output), how, part, progress=progress, say=say)


@call
def rig_live(
    input: AnyPath | None = None,
    *,
    vmc: str | None = None,
    presets: bool = False,
    output: AnyPath | None = None,
    window: bool = True,
    mirror: bool | None = None,
    camera: int = 0,
    size: tuple[int, int] = (1280, 720),
    fps: float = 30.0,
    stopped: threading.Event | None = None,
    **options: Unpack[RigWriteOptions],
) -> RigLiveReport:
    """Send the coefficients of the person at the camera to an avatar, until the input ends or `stopped` is set.

    Parameters
    ----------
    input : a file or a stream; by default the camera, of which size and fps are requested.
    vmc : HOST or HOST:PORT of a receiver of the VMC protocol.   presets : also send VRM's own expressions.
    output : a file as for `rig_from_video`.
    window : show the picture and the coefficients.   mirror : by default with a camera.
    """
    from guise.app.rig.live import run_rig_live
    from guise.app.rig.options import RigLiveOptions

    left: dict[str, Any] = {**options}
    progress, say = watch_of(left)
    how = RigLiveOptions(
        **_written(left), input=None if input is None else str(input), camera=camera, fps=fps, vmc=vmc, presets=presets,
        output=path_of(output), window=window, mirror=input is None if mirror is None else mirror, size=size,
    )  # fmt: skip
    return run_rig_live(how, progress=progress, say=say, stopped=stopped)


def _written(options: dict[str, Any]) -> dict[str, Any]:
    """Those of `RigWriteOptions` as the engine takes them."""
    found = {name: path_of(options.get(name)) for name in ("head", "calibration")}
    return {**found, "unit": options.get("unit"), "force": options.get("overwrite", False)}
