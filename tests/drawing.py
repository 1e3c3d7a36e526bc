"""Small makers for tests of what draws: frames of any components, faces on them, and time that passes."""

from __future__ import annotations

import numpy as np

from guise.aam.parsing import FaceClass, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.aam.solid_shape import HeadPose
from guise.app.drawing.face import FaceInFrame, Seen
from guise.app.drawing.memory import Memory
from guise.app.media import ColourMatrix, Frame
from guise.common.arrays import F32, F64, U8
from guise.common.decay import FRAME_SECONDS

RGB = ColourMatrix(*(np.eye(3, 4, dtype=np.float32) for _ in range(2)))


class OwnColours(Frame):
    """A frame that is drawn into in its stored components, whatever these are."""

    @property
    def yuv(self) -> ColourMatrix:
        """As `colour`."""
        return self.colour


def blank(size: tuple[int, int] = (8, 8), colour: ColourMatrix = RGB) -> Frame:
    """A black frame (h, w) with stored components of its own."""
    frame = OwnColours.from_rgb(np.zeros((*size, 3), np.uint8))
    frame.colour = colour
    return frame


def face_at(points: F64, rgb: U8 | None = None) -> FaceInFrame:
    """A face that is found and drawn at points (81, 2) of a picture; by default of a black one."""
    return FaceInFrame(blank() if rgb is None else Frame.from_rgb(rgb), points, points, mesh=points)


def drawn_on(roi: U8, points: F64, picture: U8, *, fine: bool = False, zoom: float = 1.0) -> FaceInFrame:
    """A face at points (81, 2) of a rectangle (h, w, 3) of stored components, RGB, drawn as a picture."""
    face = FaceInFrame(blank(), points, points, mesh=points, zoom=zoom)
    face.canvas.roi, face.canvas.picture, face.canvas.fine = roi, picture, fine
    return face


def textured(
    texture: F32, seen: F32 | None = None, visible: F32 | None = None, colour: ColourMatrix = RGB
) -> FaceInFrame:
    """A face with a texture (n, 3), where a frame shows (t, 3) at the texels."""
    nowhere = np.zeros((0, 2))
    face = FaceInFrame(blank(colour=colour), nowhere, nowhere)
    face.canvas.texture = texture
    if seen is not None:
        face.seen = Seen(np.zeros((len(seen), 2), np.float32), seen, seen, visible)
    return face


def pass_time(memory: Memory, seconds: float = FRAME_SECONDS) -> None:
    """Go on to a frame so much later."""
    memory.clock.step = seconds
    memory.clock.now += seconds


def parsing_of(shares: dict[FaceClass, np.ndarray], size: tuple[int, int]) -> FaceParsing:
    """A parsing of a picture (h, w), given shares of some classes (64, 64)."""
    maps = np.zeros((len(FaceClass), 64, 64), np.float32)
    for kind, share in shares.items():
        maps[kind] = share
    h, w = size
    return FaceParsing(maps, np.array([[w / 64, 0, 0], [0, h / 64, 0]]), np.zeros((2, 4)))


def turned_head(
    degrees: float, scale: float = 170.0, middle: tuple[float, float] = (320.0, 240.0)
) -> HeadPose:
    """A head turned by so many degrees of yaw."""
    yaw = np.radians(degrees)
    rotation = np.array([[np.cos(yaw), 0, -np.sin(yaw)], [0, 1, 0], [np.sin(yaw), 0, np.cos(yaw)]])
    return HeadPose(rotation, scale, np.array(middle))


def grid_points(reference: ReferenceFrame, zoom: float) -> F64:
    """(81, 2) the reference face, with so many pixels to a grid pixel."""
    return np.asarray((reference.points + 0.5) * zoom - 0.5)
