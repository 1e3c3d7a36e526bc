"""The window of `guise rig live`: the picture with its points, and a bar for each of the 52 coefficients.

Pixels, x right, y down; RGB.
"""

from __future__ import annotations

import textwrap
from functools import cache

import cv2
import numpy as np

from guise.aam.rig.coefficients import Coefficients
from guise.aam.rig.names import ARKIT_NAMES
from guise.app.live.controls import Controls
from guise.app.live.options import LiveSettings
from guise.app.live.output import OutputFrame
from guise.app.live.overlay import AMBER, GREEN, GREY, PANEL_COLOUR, RED, WHITE, Colour, Overlay
from guise.app.live.window import ALTERNATIVES, Window
from guise.app.media import Frame
from guise.app.rig.shown import RigFrame
from guise.common.arrays import F32, U8
from guise.common.errors import OutputError

HEIGHT, PANEL = 720, 330  # of the picture that is shown, and the width of its panel
TOP, ROW = 30, 13  # where the bars begin, and from one to the next
BAR_LEFT, BAR_LENGTH = 150, 165
KEYS = "C calibrates   H looks ahead   M mirrors   Q ends"


class RigWindow(Window):
    """Shows frames with their coefficients on the desktop."""

    def __init__(self, controls: Controls) -> None:
        super().__init__(controls, RigOverlay())

    def check(self) -> None:
        """OutputError when the optional packages are missing."""
        try:
            super().check()
        except OutputError as error:
            raise _without_window(error) from error

    def open(self, width: int, height: int, fps: float) -> None:
        """Open the window at the size of what is shown."""
        try:
            super().open(round(width * HEIGHT / height) + PANEL, HEIGHT, fps)
        except OutputError as error:
            raise _without_window(error) from error


def _without_window(error: OutputError) -> OutputError:
    return OutputError(str(error).replace(ALTERNATIVES, "give --no-window with --vmc or --output FILE"))


class RigOverlay(Overlay):
    """Composes what is shown."""

    def __init__(self) -> None:
        super().__init__([])

    def draw(self, shown: OutputFrame, settings: LiveSettings) -> Frame:
        """The picture with points and message, and the panel beside it."""
        assert isinstance(shown, RigFrame)
        frame = shown.frame
        picture = drawn(frame.rgb(), shown, mirror=settings.mirror)
        return Frame.from_rgb(picture, frame.pts, frame.time_base, frame.index)


def drawn(rgb: U8, shown: RigFrame, *, mirror: bool) -> U8:
    """What the window shows, (720, w, 3)."""
    high, wide = rgb.shape[:2]
    scale = HEIGHT / high
    size = (round(wide * scale), HEIGHT)
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    picture = np.empty((HEIGHT, size[0] + PANEL, 3), np.uint8)
    seen: U8 = np.asarray(cv2.resize(rgb, size, interpolation=how), np.uint8)
    if shown.points is not None:
        _draw_points(seen, shown.points, scale)
    picture[:, : size[0]] = cv2.flip(seen, 1) if mirror else seen
    picture[:, size[0] :] = _panel(shown.coefficients, calibrated=shown.calibrated)
    lines = textwrap.wrap(shown.message, max(20, size[0] // 20))
    for k, line in enumerate(lines):
        _write(picture, line, (20, HEIGHT - 24 - 36 * (len(lines) - 1 - k)), AMBER, 28)
    return picture


def _draw_points(picture: U8, points: F32, scale: float) -> None:
    for x, y in np.round((points + 0.5) * scale - 0.5).astype(int).tolist():
        cv2.circle(picture, (x, y), 2, GREEN, -1, cv2.LINE_AA)


def _panel(found: Coefficients | None, *, calibrated: bool) -> U8:
    picture = _names().copy()
    state, colour = ("calibrated", GREEN) if calibrated else ("not calibrated", GREY)
    _write(picture, "no face" if found is None else state, (10, 20), RED if found is None else colour, 15)
    if found is None:
        return picture
    yaw, pitch, roll = found.head
    _write(picture, f"{yaw:+.0f} {pitch:+.0f} {roll:+.0f} degrees", (BAR_LEFT, 20), WHITE, 15)
    for k, value in enumerate(found.weights.tolist()):
        y = TOP + ROW * k
        cv2.rectangle(picture, (BAR_LEFT, y + 2), (BAR_LEFT + BAR_LENGTH, y + ROW - 3), (40, 44, 54), -1)
        if value > 0:
            end = BAR_LEFT + round(BAR_LENGTH * value)
            cv2.rectangle(picture, (BAR_LEFT, y + 2), (end, y + ROW - 3), GREEN, -1)
    return picture


@cache
def _names() -> U8:
    """The panel without bars."""
    picture = np.full((HEIGHT, PANEL, 3), PANEL_COLOUR, np.uint8)
    for k, name in enumerate(ARKIT_NAMES):
        _write(picture, name, (10, TOP + ROW * (k + 1) - 3), GREY, 11)
    _write(picture, KEYS, (10, HEIGHT - 5), WHITE, 11)
    return picture


@cache
def _font() -> cv2.FontFace:
    return cv2.FontFace("sans")


def _write(picture: U8, text: str, at: tuple[int, int], colour: Colour, size: int) -> None:
    part = picture if picture.flags.c_contiguous else np.ascontiguousarray(picture)
    cv2.putText(part, text, at, colour, _font(), size, 500)
