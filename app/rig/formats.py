"""Files of coefficients: CSV as the app Live Link Face writes it, JSON lines, and animated GLB or VRM.

The CSV has the columns of a recording of that app in its order, names with a capital letter, and a time code of 60
frames a second.  Its turns count half a turn as 1, with the signs of an unmirrored face, as Unreal Engine's ARKit
plug-in fills the same curves (AppleARKitConversion.h, ToBlendShapeMap): yaw to the person's left, pitch down, roll to
their right.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from guise.aam.rig.names import ARKIT_NAMES, INDEX
from guise.app.rig.curves import RigCurves
from guise.app.rig.head import RigHead
from guise.common.errors import OutputError
from guise.common.files import write_whole

TIMECODE_FPS = 60  # of the app
HALF_TURN = 180.0
_SWAPPED = {
    "jawLeft": "jawRight",
    "jawRight": "jawLeft",
    "mouthLeft": "mouthRight",
    "mouthRight": "mouthLeft",
}
_ORDER = [_SWAPPED.get(name, name) for name in ARKIT_NAMES]  # the app's, right before left there
TURNS = [f"{part}{way}" for part in ("Head", "LeftEye", "RightEye") for way in ("Yaw", "Pitch", "Roll")]
COLUMNS = ["Timecode", "BlendshapeCount", *(name[0].upper() + name[1:] for name in _ORDER), *TURNS]


def format_of_rig(path: Path) -> str:
    """ "csv", "jsonl", "glb" or "vrm", by the suffix; raises OutputError."""
    form = path.suffix.lower().removeprefix(".")
    if form not in WRITERS:
        raise OutputError(
            f"{path} must end in .csv (Live Link Face), .jsonl (JSON lines), .glb or .vrm (animated head)"
        )
    return form


def shows_head(path: Path) -> bool:
    """Whether a file shows a head, by its suffix; raises OutputError for an unknown one."""
    return WRITERS[format_of_rig(path)] is _write_glb


def write_curves(path: Path, curves: RigCurves, head: RigHead | None) -> None:
    """Write a file in the format of its suffix; it appears only when it is complete.   head : for a GLB."""
    WRITERS[format_of_rig(path)](path, curves, head)


def _write_csv(path: Path, curves: RigCurves, head: RigHead | None) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    order = [INDEX[name] for name in _ORDER]
    turns = (
        np.concatenate([curves.head, curves.eyes.reshape(-1, 6)], 1) * np.tile([1, -1, -1], 3) / HALF_TURN
        + 0.0
    )
    count = len(COLUMNS) - 2
    for seconds, weights, turned in zip(curves.seconds, curves.weights[:, order], turns, strict=True):
        writer.writerow([timecode(seconds), count, *(f"{value:.6f}" for value in (*weights, *turned))])
    write_whole(path, text.getvalue())


def timecode(seconds: float) -> str:
    """Hours, minutes, seconds, frames of 1/60 s, and thousandths of a frame.

    >>> timecode(3661.5125)
    '01:01:01:30.750'
    """
    parts = round(seconds * TIMECODE_FPS * 1000)
    whole, part = divmod(parts, 1000)
    left, frame = divmod(whole, TIMECODE_FPS)
    return f"{left // 3600:02}:{left // 60 % 60:02}:{left % 60:02}:{frame:02}.{part:03}"


def _write_jsonl(path: Path, curves: RigCurves, head: RigHead | None) -> None:
    lines = []
    for k, seconds in enumerate(curves.seconds):
        weights = {
            name: round(float(value), 5) for name, value in zip(ARKIT_NAMES, curves.weights[k], strict=True)
        }
        turns = {"head": curves.head[k], "leftEye": curves.eyes[k, 0], "rightEye": curves.eyes[k, 1]}
        named = {
            part: dict(zip(("yaw", "pitch", "roll"), (round(float(v), 3) for v in turn), strict=True))
            for part, turn in turns.items()
        }
        line = {"time": round(float(seconds), 6), "face": bool(curves.seen[k]), "weights": weights, **named}
        lines.append(json.dumps(line, separators=(",", ":")))
    write_whole(path, "\n".join(lines) + "\n")


def _write_glb(path: Path, curves: RigCurves, head: RigHead | None) -> None:
    if head is None:
        raise OutputError(f"{path} needs a head: give one with --head")
    write_whole(path, head.animated(curves))


WRITERS: dict[str, Callable[[Path, RigCurves, RigHead | None], None]] = {
    "csv": _write_csv,
    "jsonl": _write_jsonl,
    "glb": _write_glb,
    "vrm": _write_glb,
}
