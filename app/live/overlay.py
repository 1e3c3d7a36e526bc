"""Overlays on a frame: readout, mode and face, messages, keys, the enrolment ring, mesh and mask.

Pixels, x right, y down; drawn into the frame's stored components, so that nothing outside the overlays changes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import cv2
import numpy as np

from guise.aam.landmarks.schemes import SILHOUETTE
from guise.aam.reference import ReferenceFrame
from guise.app.live.controls import KEYS
from guise.app.live.options import LiveSettings
from guise.app.live.output import OutputFrame, clock
from guise.app.live.stats import PipelineStats
from guise.app.media import ColourMatrix, Frame
from guise.common.arrays import F32, F64, I32, U8

Colour = tuple[int, int, int]
Row = tuple[tuple[str, Colour], ...]  # cells of a table

WHITE, GREY = (255, 255, 255), (190, 195, 205)
RED, GREEN, AMBER = (255, 95, 85), (90, 240, 130), (255, 200, 90)
HELP: tuple[Row, ...] = tuple(
    ((key.upper() if len(key) == 1 else key, AMBER), (what, WHITE))
    for key, what in (KEYS | {"F11": "full screen"}).items()
)
WARNINGS: dict[str, tuple[Row, ...]] = {
    "shown": ((("the real face is visible", RED),),),
    "lost": ((("no face found: everything is covered", AMBER),),),
}
PANEL_COLOUR = (14, 16, 22)


@dataclass(frozen=True)
class OverlayStyle:
    """Sizes, opacities and durations of the overlays."""

    panel_opacity: float = 0.66
    font_size: float = 0.034  # of the frame's shorter side
    min_font_pixels: float = 11.0
    line_height: float = 1.4  # font sizes
    panel_border: float = 0.55  # font sizes
    change_seconds: float = 2.0  # for which mode and face are shown after a change
    readout_seconds: float = 0.25  # between two updates of the readout
    mask_opacity: float = 0.35
    ring_radius: float = 0.38  # of the frame's shorter side
    ring_segments: int = 80


STYLE = OverlayStyle()
_FRACTION_BITS = 4  # of a pixel's coordinates in OpenCV's drawing
_MAX_COORDINATE = 2**14  # pixels; OpenCV's drawing takes 16 bits and the fraction


class Overlay:
    """Draws over frames; used by one thread.

    Parameters
    ----------
    names : of the donors, in the order of the settings' index.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = list(names)
        self._render = lru_cache(32)(TextRenderer().panel)
        self._settings: LiveSettings | None = None
        self._changed = self._read = -np.inf  # seconds
        self._readout: tuple[Row, ...] = ()

    def draw(self, shown: OutputFrame, settings: LiveSettings) -> Frame:
        """A copy of the frame with all its overlays, mirrored where the settings say so."""
        frame = mirrored(shown.frame) if settings.mirror else shown.frame.copy()
        if shown.result.mesh is not None:
            mesh = (
                shown.result.mesh * (-1, 1) + (frame.width - 1, 0) if settings.mirror else shown.result.mesh
            )
            draw_face(frame, mesh, settings)
        if shown.ring is not None:
            draw_ring(frame, shown.ring)
        if settings.help:
            self._put(frame, HELP, (0.5, 0))
        else:
            self._put(frame, self._readout_rows(shown, settings), (0, 0))
            self._put(frame, self._state(shown, settings), (1, 0))
        self._put(frame, _message_rows(shown, frame), (0.5, 1))
        return frame

    def _readout_rows(self, shown: OutputFrame, settings: LiveSettings) -> tuple[Row, ...]:
        if not settings.readout:
            return ()
        if shown.arrived - self._read >= STYLE.readout_seconds or not self._readout:
            self._readout, self._read = readout_rows(shown.stats), shown.arrived
        return self._readout

    def _state(self, shown: OutputFrame, settings: LiveSettings) -> tuple[Row, ...]:
        """For how long it has been recorded; mode, face and alpha when they have just changed or the readout is on."""
        if settings != self._settings:
            self._settings, self._changed = settings, shown.arrived
        rows: list[Row] = [] if shown.recording is None else [((f"● {clock(shown.recording)}", RED),)]
        if settings.readout or shown.arrived - self._changed < STYLE.change_seconds:
            rows += [((text, WHITE),) for text in self._choices(settings)]
        return tuple(rows)

    def _choices(self, settings: LiveSettings) -> list[str]:
        if settings.mode == "off":
            return ["off: face covered"]
        return [f"{settings.mode}: {self._names[settings.identity]}", f"alpha {settings.alpha:.1f}"]

    def _put(self, frame: Frame, rows: tuple[Row, ...], place: tuple[float, float]) -> None:
        """Blend a table into the frame; place: position in [0, 1] across and down."""
        if not rows:
            return
        size = _font_size(frame)
        panel = self._render(rows, size, (frame.width, frame.height), frame.colour)
        panel.blend(frame, place, round(STYLE.panel_border * size))


def mirrored(frame: Frame) -> Frame:
    """A copy with left and right flipped."""
    twin = frame.copy()
    twin.orientation = replace(twin.orientation, flip_x=not twin.orientation.flip_x)
    return twin


def readout_rows(stats: PipelineStats) -> tuple[Row, ...]:
    """The readout: frame rate, latency and dropped frames."""
    cells = [
        (f"{stats.fps:.0f}", "frames per second"),
        (f"{stats.latency:.0f} ms", "latency, median"),
        (f"{stats.latency_95:.0f} ms", "latency, 95 %"),
        (f"{stats.dropped} + {stats.skipped}", "dropped, in + out"),
    ]
    return tuple(((value, WHITE), (name, GREY)) for value, name in cells)


def _message_rows(shown: OutputFrame, frame: Frame) -> tuple[Row, ...]:
    """The warning about the frame and the message, in lines that fit."""
    lines = textwrap.wrap(shown.message, max(12, int(1.7 * frame.width / _font_size(frame))))
    missing: tuple[Row, ...] = (((shown.missing, GREY),),) if shown.missing else ()
    return (*WARNINGS.get(shown.result.outcome, ()), *(((line, WHITE),) for line in lines), *missing)


@dataclass(frozen=True, eq=False)
class TextPanel:
    """Text on a dark panel.

    stored : (h, w, 3) components.   opacity, transparency : (h, w), their sum is 1.
    """

    stored: U8
    opacity: F32
    transparency: F32

    def blend(self, frame: Frame, place: tuple[float, float], margin: int) -> None:
        """Blend the panel into a frame in place, `margin` pixels from its borders where there is room."""
        high, wide = self.opacity.shape
        left = _between(frame.width - wide, place[0], margin)
        top = _between(frame.height - high, place[1], margin)
        x0, y0, w, h = frame.align_roi(left, top, left + wide, top + high)
        picture = frame.read_roi(x0, y0, w, h)
        here = picture[top - y0 :, left - x0 :][:high, :wide]
        here[:] = cv2.blendLinear(np.ascontiguousarray(here), self.stored, self.transparency, self.opacity)
        frame.write_roi(x0, y0, picture)


def _between(room: int, share: float, margin: int) -> int:
    """Start, in pixels, of something that has `room` pixels to move, with a margin where possible."""
    return round(min(max(share * room, margin), max(room - margin, room // 2)))


class TextRenderer:
    """Renders tables as panels; loading the font takes a while."""

    def __init__(self) -> None:
        self._font = cv2.FontFace("sans")
        self._width("a", STYLE.min_font_pixels)

    def panel(
        self, rows: tuple[Row, ...], size: float, room: tuple[int, int], colour: ColourMatrix
    ) -> TextPanel:
        """A table in a font size, pixels, or a smaller one if it would not fit the room (w, h)."""
        widths = [max(self._width(cell[0], 100) for cell in column) for column in zip(*rows, strict=True)]
        wide = (sum(widths) / 100 + 0.8 * (len(widths) - 1)) + 2 * STYLE.panel_border
        high = STYLE.line_height * len(rows) + 2 * STYLE.panel_border
        size = min(size, room[0] / wide, room[1] / high)
        text, ink = self._written(rows, widths, size, (int(wide * size), int(high * size)))
        opacity = STYLE.panel_opacity + (1 - STYLE.panel_opacity) * ink
        stored = np.asarray(cv2.transform(text, colour.from_rgb), np.uint8)
        return TextPanel(stored, opacity, 1 - opacity)

    def _written(
        self, rows: tuple[Row, ...], widths: list[int], size: float, extent: tuple[int, int]
    ) -> tuple[U8, F32]:
        """The text in RGB (h, w, 3), and its coverage (h, w) in [0, 1]."""
        wide, high = extent
        picture = np.full((high, wide, 3), PANEL_COLOUR, np.uint8)
        ink = np.zeros((high, wide), np.uint8)
        for number, row in enumerate(rows):
            x = STYLE.panel_border * size
            y = (STYLE.panel_border + STYLE.line_height * number + 1.05) * size
            for (text, colour), width in zip(row, widths, strict=True):
                for image, paint in ((picture, colour), (ink, (255,))):
                    cv2.putText(image, text, (round(x), round(y)), paint, self._font, round(size), 500)
                x += (width / 100 + 0.8) * size
        return picture, np.asarray(ink / np.float32(255), np.float32)

    def _width(self, text: str, size: float) -> int:
        x, _, width, _ = cv2.getTextSize((1, 1), text, (0, 0), self._font, round(size), 500)
        return int(x + width)


def _font_size(frame: Frame) -> float:
    """Font size for a frame, pixels."""
    return max(STYLE.font_size * min(frame.width, frame.height), STYLE.min_font_pixels)


def draw_face(frame: Frame, mesh: F64, settings: LiveSettings) -> None:
    """Draw the overlays of a face (81, 2) that the settings ask for, in place."""
    if settings.mask:
        draw_mask(frame, mesh)
    if settings.mesh:
        draw_mesh(frame, mesh)


def draw_mesh(frame: Frame, mesh: F64) -> None:
    """Draw the triangles of a face (81, 2) in place."""
    if (area := _area(frame, mesh)) is not None:
        (x0, y0, _, _), picture = area
        points = _fixed(mesh - (x0, y0))
        cv2.polylines(
            picture, list(points[_edges()]), False, _stored(frame, GREEN), 1, cv2.LINE_AA, _FRACTION_BITS
        )
        frame.write_roi(x0, y0, picture)


def mesh_path(mesh: F64) -> str:
    """The triangles of a face (81, 2) as the path of an SVG."""
    return "".join(f"M{ax:.0f},{ay:.0f}L{bx:.0f},{by:.0f}" for (ax, ay), (bx, by) in mesh[_edges()])


def draw_mask(frame: Frame, mesh: F64) -> None:
    """Tint the area within the outline of a face (81, 2) in place."""
    if (area := _area(frame, mesh)) is not None:
        (x0, y0, _, _), picture = area
        tinted = picture.copy()
        outline = _fixed(mesh[SILHOUETTE] - (x0, y0))
        cv2.fillPoly(tinted, [outline], _stored(frame, AMBER), cv2.LINE_AA, _FRACTION_BITS)
        cv2.addWeighted(picture, 1 - STYLE.mask_opacity, tinted, STYLE.mask_opacity, 0, dst=picture)
        frame.write_roi(x0, y0, picture)


def draw_ring(frame: Frame, share: float) -> None:
    """Draw a ring around the middle of the frame in place, `share` in [0, 1] of it coloured."""
    short = min(frame.width, frame.height)
    centre, radius = np.array([frame.width - 1, frame.height - 1]) / 2, STYLE.ring_radius * short
    width = max(4, round(short / 45))
    if (area := _area(frame, np.array([centre - radius - width, centre + radius + width]))) is None:
        return
    (x0, y0, _, _), picture = area
    for end, thick, colour in ((1.0, width, PANEL_COLOUR), (min(max(share, 0.0), 1.0), 0.6 * width, GREEN)):
        turn = 2 * np.pi * np.linspace(-0.25, end - 0.25, 2 + round(STYLE.ring_segments * end))
        circle = np.column_stack([np.cos(turn), np.sin(turn)])
        rim = np.concatenate([(radius + thick / 2) * circle, (radius - thick / 2) * circle[::-1]])
        if end > 0:
            points = _fixed(centre - (x0, y0) + rim)
            cv2.fillPoly(picture, [points], _stored(frame, colour), cv2.LINE_AA, _FRACTION_BITS)
    frame.write_roi(x0, y0, picture)


def _area(frame: Frame, points: F64) -> tuple[tuple[int, int, int, int], U8] | None:
    """The rectangle around points (n, 2) and its components; None when it lies outside or cannot be drawn."""
    if not (np.abs(points) < _MAX_COORDINATE).all():
        return None
    roi = frame.align_roi(*(points.min(0) - 2), *(points.max(0) + 3))
    return (roi, frame.read_roi(*roi)) if roi[2] > 0 and roi[3] > 0 else None


def _fixed(points: F64) -> I32:
    return np.round(points * (1 << _FRACTION_BITS)).astype(np.int32)


def _stored(frame: Frame, colour: Colour) -> list[float]:
    """An RGB colour in the frame's stored components."""
    return [float(v) for v in frame.colour.from_rgb @ (*colour, 1)]


@cache
def _edges() -> I32:
    """The edges (n, 2) of the canonical face's triangles."""
    triangles = ReferenceFrame.canonical(96).triangles
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    return np.unique(edges, axis=0).astype(np.int32)
