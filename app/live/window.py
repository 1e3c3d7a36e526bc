"""A window that shows the live picture; GL draws the stored planes directly and nothing is read back.

A shader converts colours, rotates the picture and fits it into the window.  Overlays and mirroring are part of the
picture (`guise.app.live.overlay`), so that text stays readable.  Keys go to `Controls.press`.
"""

from __future__ import annotations

import ctypes
import re
from types import ModuleType
from typing import Any

import cv2
import numpy as np

from guise.app.live.controls import Controls
from guise.app.live.output import Output, OutputFrame
from guise.app.live.overlay import Overlay, mirrored
from guise.app.media import ColourMatrix, Frame
from guise.app.media.colour import gbr_matrix
from guise.app.media.deep_frame import DeepFrame
from guise.app.media.frame import plane_arrays
from guise.app.media.orientation import AS_STORED, Orientation
from guise.common.arrays import U8
from guise.common.errors import OutputError
from guise.render import RendererError
from guise.render.context import leave_thread, window_context

TITLE = "Guise (H shows the keys)"
MAX_SCREEN_SHARE = 0.9  # of the screen's width and height, taken by a new window
ALTERNATIVES = "choose --output FILE"
Room = tuple[float, float, float, float]  # x, y from below, width and height as shares of the window
ALONE: Room = (0, 0, 1, 1)
HALVES: tuple[Room, Room] = ((0, 0, 0.5, 1), (0.5, 0, 0.5, 1))
INSET: Room = (0.73, 0.03, 0.25, 0.25)  # of one's own picture during an enrolment
NO_CHROMA = np.full((1, 1), 128, np.uint8)

_VERTEX = """
#version 330 core
uniform bool transposed;
uniform bvec2 flipped;
out vec2 place;
void main() {
    vec2 shown = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    gl_Position = vec4(2.0 * shown.x - 1.0, 1.0 - 2.0 * shown.y, 0.0, 1.0);
    place = mix(shown, 1.0 - shown, flipped);
    if (transposed) place = place.yx;
}
"""
_FRAGMENT = """
#version 330 core
uniform sampler2D planes[3];
uniform mat4x3 to_rgb;
in vec2 place;
out vec4 colour;
void main() {
    vec3 stored = vec3(texture(planes[0], place).r, texture(planes[1], place).r, texture(planes[2], place).r);
    colour = vec4(to_rgb * vec4(stored, 1.0), 1.0);
}
"""


class Window(Output):
    """Shows frames on the desktop; all in the main thread.

    Parameters
    ----------
    controls : receive the keys and hold the settings.
    overlay : draws over the frames.
    """

    main_thread = True

    def __init__(self, controls: Controls, overlay: Overlay) -> None:
        self._controls, self._overlay = controls, overlay
        self._glfw: Any = None
        self._window: Any = None
        self._textures: list[FrameTexture] = []
        self._rooms: tuple[Room, ...] = ()

    def check(self) -> None:
        """OutputError when the optional packages are missing."""
        _libraries()

    def open(self, width: int, height: int, fps: float) -> None:
        """Open the window at the size of the frames, or as large as the screen allows.

        Raises
        ------
        OutputError
            When the optional packages, a display or a recent enough OpenGL are missing.
        """
        self._glfw, library = _libraries()
        self._glfw.ERROR_REPORTING = "raise"
        leave_thread()
        try:
            self._glfw.init()
            self._window = library.Window(
                title=TITLE, size=_fitting(self._glfw, width, height), vsync=False,
                context_creation_func=lambda: window_context(self._address),
            )  # fmt: skip
        except (self._glfw.GLFWError, RendererError) as error:
            raise OutputError(
                f"no window can be opened ({_plainly(error)}): use a desktop, or {ALTERNATIVES}"
            ) from error
        self._glfw.ERROR_REPORTING = "log"  # Wayland, for one, refuses some queries
        self._textures = [FrameTexture(self._window.ctx) for _ in range(2)]
        self._listen()

    def show(self, shown: OutputFrame) -> None:
        """Draw a frame; the original beside it when the user asks for it, and in a corner during enrolment."""
        settings = self._controls.settings
        frames, self._rooms = [self._overlay.draw(shown, settings)], (ALONE,)
        if (own := shown.original) is not None:
            own = mirrored(own) if settings.mirror else own
            if settings.side_by_side:
                frames, self._rooms = [own, *frames], HALVES
            elif shown.ring is not None:
                frames, self._rooms = [*frames, own], (ALONE, INSET)
        for picture, frame in zip(self._textures, frames, strict=False):
            picture.load(frame)
        self._draw()

    def pump(self) -> bool:
        """Handle keys and other events; False when the window was closed."""
        self._glfw.poll_events()
        return not self._window.is_closing

    def close(self) -> None:
        """Close the window."""
        if self._glfw is not None:
            self._glfw.terminate()
        self._glfw = self._window = None

    def _listen(self) -> None:
        handle = self._glfw.get_current_context()
        self._window.exit_key = None
        self._window.key_event_func = self._key
        self._glfw.set_window_refresh_callback(handle, lambda _: self._draw())

    def _draw(self) -> None:
        """Draw the last frames, each as large as it fits its room, on black."""
        context, (wide, high) = self._window.ctx, self._window.buffer_size
        context.screen.use()
        context.clear()
        for picture, (x, y, w, h) in zip(self._textures, self._rooms, strict=False):
            room = int(x * wide), int(y * high), int(w * wide), int(h * high)
            picture.draw(fitted(picture.size, room))
        context.viewport = (0, 0, wide, high)
        self._glfw.swap_buffers(self._glfw.get_current_context())

    def _key(self, key: int, action: int, modifiers: Any) -> None:
        """Handle a key that was pressed, or that repeats (arrows only)."""
        name = self._name(key)
        repeats = action == self._glfw.REPEAT and name in ("up", "down")
        if (action != self._glfw.PRESS and not repeats) or modifiers.ctrl or modifiers.alt:
            return
        if name == "escape" and self._window.fullscreen:
            self._window.fullscreen = False
        elif name:
            self._controls.press(name)

    def _name(self, key: int) -> str:
        """A key's name for `Controls.press`: its label, or its position on keyboards of other scripts."""
        glfw = self._glfw
        others = {glfw.KEY_UP: "up", glfw.KEY_DOWN: "down", glfw.KEY_ESCAPE: "escape"}
        for first in (glfw.KEY_0, glfw.KEY_KP_0):
            others |= {first + digit: str(digit) for digit in range(10)}
        if key in others:
            return others[key]
        name = glfw.get_key_name(key, 0) or ""
        return str(name.lower() if name.isascii() else chr(key).lower())

    def _address(self, name: str) -> int:
        """Address of a GL function, 0 when there is none."""
        return ctypes.cast(self._glfw.get_proc_address(name), ctypes.c_void_p).value or 0


class FrameTexture:
    """A frame in GL: three textures and the program that draws them.   context : moderngl.Context."""

    def __init__(self, context: Any) -> None:
        self.size = (1, 1)
        self._context = context
        self._program = context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        self._program["planes"] = (0, 1, 2)
        self._quad = context.vertex_array(self._program, [])
        self._textures = [context.texture((1, 1), 1) for _ in range(3)]

    def load(self, frame: Frame) -> None:
        """Upload a frame's planes, its colour matrix and its orientation."""
        self.size = frame.width, frame.height
        planes, colour, orientation = _planes(frame)
        for number, plane in enumerate(planes):
            self._load(number, plane)
        to_rgb = colour.to_rgb / np.array([1, 1, 1, 255], np.float32)
        self._program["to_rgb"].write(to_rgb.T.tobytes())
        self._program["transposed"] = orientation.transpose
        self._program["flipped"] = (orientation.flip_x, orientation.flip_y)

    def draw(self, viewport: tuple[int, int, int, int]) -> None:
        """Fill a rectangle x, y, w, h of the window."""
        self._context.viewport = viewport
        exact = viewport[2:] == self.size  # then NEAREST gives the same pixels and is faster in software GL
        how = self._context.NEAREST if exact else self._context.LINEAR
        for number, texture in enumerate(self._textures):
            texture.filter = (how, how)
            texture.use(number)
        self._quad.render(self._context.TRIANGLE_STRIP, vertices=4)

    def _load(self, number: int, plane: U8) -> None:
        size = plane.shape[1], plane.shape[0]
        if self._textures[number].size != size:
            self._textures[number].release()
            self._textures[number] = self._context.texture(size, 1, alignment=1)
        self._textures[number].write(np.ascontiguousarray(plane), alignment=1)


def fitted(size: tuple[int, int], room: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """The largest centred rectangle x, y, w, h inside another with the aspect ratio of a size (w, h).

    >>> fitted((640, 480), (0, 0, 1000, 480))
    (180, 0, 640, 480)
    """
    left, top, wide, high = room
    factor = min(wide / size[0], high / size[1])
    w, h = (max(1, round(side * factor)) for side in size)
    return left + (wide - w) // 2, top + (high - h) // 2, w, h


def _planes(frame: Frame) -> tuple[list[U8], ColourMatrix, Orientation]:
    """Three planes of components as stored, what takes them to RGB, and the orientation for display."""
    if frame.video_frame is None or isinstance(frame, DeepFrame):
        red, green, blue = (np.asarray(part, np.uint8) for part in cv2.split(frame.rgb()))
        return [green, blue, red], gbr_matrix(), AS_STORED
    planes = [*plane_arrays(frame.video_frame), NO_CHROMA, NO_CHROMA][:3]
    return planes, frame.colour, frame.orientation


def _fitting(glfw: Any, width: int, height: int) -> tuple[int, int]:
    """The size of a new window, at most MAX_SCREEN_SHARE of the screen."""
    _, _, wide, high = glfw.get_monitor_workarea(glfw.get_primary_monitor())
    factor = min(1.0, MAX_SCREEN_SHARE * wide / width, MAX_SCREEN_SHARE * high / height)
    return max(1, round(width * factor)), max(1, round(height * factor))


def _libraries() -> tuple[ModuleType, ModuleType]:
    """The optional libraries; OutputError when they are missing."""
    try:
        import glfw
        from moderngl_window.context import glfw as library
    except ImportError as error:
        raise OutputError(
            f'a window needs more packages: pip install "guise-video[window]", or {ALTERNATIVES}'
        ) from error
    return glfw, library


def _plainly(error: BaseException) -> str:
    """The text of an error; GLFW's are a number and the representation of bytes.

    >>> _plainly(RuntimeError("(65550) b'X11: The DISPLAY environment variable is missing'"))
    'X11: The DISPLAY environment variable is missing'
    """
    found = re.fullmatch(r"""\(\d+\) b(['"])(.*)\1""", str(error))
    return found[2] if found else str(error)
