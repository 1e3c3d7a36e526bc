"""What is written over a picture: read-out, mode and face, messages, keys, the ring of enrolment, mesh and mask.

Pixels, x right, y down; drawn into a frame's stored components, so that nothing outside it changes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.reference import ReferenceFrame
from guise.app.live.controls import KEYS, Settings
from guise.app.live.output import Shown
from guise.app.live.pipeline import Stats
from guise.app.media import ColourMatrix, Frame
from guise.common.arrays import F32, F64

Plane = NDArray[np.uint8]
Colour = tuple[int, int, int]
Row = tuple[tuple[str, Colour], ...]  # cells of a table

WHITE, GREY = (255, 255, 255), (190, 195, 205)
RED, GREEN, AMBER = (255, 95, 85), (90, 240, 130), (255, 200, 90)
HELP: tuple[Row, ...] = tuple(
    ((key.upper() if len(key) == 1 else key, AMBER), (what, WHITE))
    for key, what in (KEYS | {"F11": "full screen"}).items()
)
KNOWN: dict[str, tuple[Row, ...]] = {
    "shown": ((("the real face is visible", RED),),),
    "lost": ((("no face found: all is covered", AMBER),),),
}
PAPER, OPACITY = (14, 16, 22), 0.66
LETTERS, LEAST = 0.034, 11.0  # size of the letters, of the picture's shorter side, and at least, pixels
LINE, BORDER = 1.4, 0.55  # of a line and of a panel's border, in letters
STAYS = 2.0  # seconds for which mode and face are shown after they have changed
CALM = 0.25  # seconds between two changes of the read-out
TINT = 0.35  # of the mask
RING, CHORDS = 0.38, 80  # radius, of the picture's shorter side; and of how many straight lines it is drawn
SILHOUETTE = [*range(17), *range(80, 67, -1)]
_BITS = 4  # of a pixel's fraction, in OpenCV's drawing
_FAR = 2**14  # pixels beyond which points are not drawn: OpenCV's drawing takes 16 bits and the fraction


class Overlay:
    """Draws over pictures; used by one thread.

    Parameters
    ----------
    names : of the faces, as the settings count them.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = list(names)
        self._write = lru_cache(32)(Writer().panel)
        self._settings: Settings | None = None
        self._changed = self._read = -np.inf  # seconds
        self._readout: tuple[Row, ...] = ()

    def over(self, shown: Shown, settings: Settings) -> Frame:
        """The picture with all that belongs on it, mirrored where the settings say so; a copy."""
        frame = mirrored(shown.frame) if settings.mirror else shown.frame.copy()
        if shown.look.mesh is not None:
            mesh = shown.look.mesh * (-1, 1) + (frame.width - 1, 0) if settings.mirror else shown.look.mesh
            _draw_face(frame, mesh, settings)
        if shown.ring is not None:
            draw_ring(frame, shown.ring)
        if settings.help:
            self._put(frame, HELP, (0.5, 0))
        else:
            self._put(frame, self._figures(shown, settings), (0, 0))
            self._put(frame, self._state(shown, settings), (1, 0))
        self._put(frame, _sentences(shown, frame), (0.5, 1))
        return frame

    def _figures(self, shown: Shown, settings: Settings) -> tuple[Row, ...]:
        if not settings.readout:
            return ()
        if shown.arrived - self._read >= CALM or not self._readout:
            self._readout, self._read = figures(shown.stats), shown.arrived
        return self._readout

    def _state(self, shown: Shown, settings: Settings) -> tuple[Row, ...]:
        """Whether it is recorded; mode, face and alpha when they have just changed or the read-out is on."""
        if settings != self._settings:
            self._settings, self._changed = settings, shown.arrived
        rows: list[Row] = [(("● recording", RED),)] if shown.recording else []
        if settings.readout or shown.arrived - self._changed < STAYS:
            rows += [((text, WHITE),) for text in self._choices(settings)]
        return tuple(rows)

    def _choices(self, settings: Settings) -> list[str]:
        if settings.mode == "off":
            return ["off: face covered"]
        return [f"{settings.mode}: {self._names[settings.identity]}", f"alpha {settings.alpha:.1f}"]

    def _put(self, frame: Frame, rows: tuple[Row, ...], place: tuple[float, float]) -> None:
        """Blend a table into the frame; place: shares in [0, 1] of the way across and down."""
        if not rows:
            return
        size = max(LETTERS * min(frame.width, frame.height), LEAST)
        panel = self._write(rows, size, (frame.width, frame.height), frame.colour)
        panel.blend(frame, place, round(BORDER * size))


def mirrored(frame: Frame) -> Frame:
    """A copy with left and right exchanged."""
    twin = frame.copy()
    twin.orientation = replace(twin.orientation, flip_x=not twin.orientation.flip_x)
    return twin


def figures(stats: Stats) -> tuple[Row, ...]:
    """The read-out: rate, latency and what was dropped."""
    cells = [
        (f"{stats.fps:.0f}", "frames a second"),
        (f"{stats.latency:.0f} ms", "latency, median"),
        (f"{stats.latency_95:.0f} ms", "latency, 95 %"),
        (f"{stats.dropped} + {stats.skipped}", "dropped, in + out"),
    ]
    return tuple(((value, WHITE), (name, GREY)) for value, name in cells)


def _sentences(shown: Shown, frame: Frame) -> tuple[Row, ...]:
    """What the user must know about the picture, and the message, in lines that fit."""
    letters = max(LETTERS * min(frame.width, frame.height), LEAST)
    lines = textwrap.wrap(shown.message, max(12, int(1.7 * frame.width / letters)))
    return (*KNOWN.get(shown.look.outcome, ()), *(((line, WHITE),) for line in lines))


@dataclass(frozen=True, eq=False)
class Panel:
    """A text on dark ground.   stored (h, w, 3) uint8 components; cover, bare (h, w) opacity and 1 - opacity."""

    stored: Plane
    cover: F32
    bare: F32

    def blend(self, frame: Frame, place: tuple[float, float], margin: int) -> None:
        """Blend it into a frame in place, `margin` pixels from its borders where there is room."""
        high, wide = self.cover.shape
        left = _between(frame.width - wide, place[0], margin)
        top = _between(frame.height - high, place[1], margin)
        x0, y0, w, h = frame.align_roi(left, top, left + wide, top + high)
        picture = frame.read_roi(x0, y0, w, h)
        here = picture[top - y0 :, left - x0 :][:high, :wide]
        here[:] = cv2.blendLinear(np.ascontiguousarray(here), self.stored, self.bare, self.cover)
        frame.write_roi(x0, y0, picture)


def _between(room: int, share: float, margin: int) -> int:
    """Where something begins, pixels, that has `room` to move."""
    return round(min(max(share * room, margin), max(room - margin, room // 2)))


class Writer:
    """Makes panels; the first letter takes a while."""

    def __init__(self) -> None:
        self._font = cv2.FontFace("sans")
        self._width("a", LEAST)

    def panel(self, rows: tuple[Row, ...], size: float, room: tuple[int, int], colour: ColourMatrix) -> Panel:
        """A table with letters of a size, pixels, or smaller ones if it is larger than the room (w, h)."""
        widths = [max(self._width(cell[0], 100) for cell in column) for column in zip(*rows, strict=True)]
        wide = (sum(widths) / 100 + 0.8 * (len(widths) - 1)) + 2 * BORDER
        high = LINE * len(rows) + 2 * BORDER
        size = min(size, room[0] / wide, room[1] / high)
        text, ink = self._written(rows, widths, size, (int(wide * size), int(high * size)))
        cover = OPACITY + (1 - OPACITY) * ink
        stored = np.asarray(cv2.transform(text, colour.from_rgb), np.uint8)
        return Panel(stored, cover, 1 - cover)

    def _written(
        self, rows: tuple[Row, ...], widths: list[int], size: float, extent: tuple[int, int]
    ) -> tuple[Plane, F32]:
        """RGB (h, w, 3) on paper, and how far letters cover it (h, w)."""
        wide, high = extent
        picture = np.full((high, wide, 3), PAPER, np.uint8)
        ink = np.zeros((high, wide), np.uint8)
        for number, row in enumerate(rows):
            x, y = BORDER * size, (BORDER + LINE * number + 1.05) * size
            for (text, colour), width in zip(row, widths, strict=True):
                for image, paint in ((picture, colour), (ink, (255,))):
                    cv2.putText(image, text, (round(x), round(y)), paint, self._font, round(size), 500)
                x += (width / 100 + 0.8) * size
        return picture, np.asarray(ink / np.float32(255), np.float32)

    def _width(self, text: str, size: float) -> int:
        x, _, width, _ = cv2.getTextSize((1, 1), text, (0, 0), self._font, round(size), 500)
        return int(x + width)


def _draw_face(frame: Frame, mesh: F64, settings: Settings) -> None:
    if settings.mask:
        draw_mask(frame, mesh)
    if settings.mesh:
        draw_mesh(frame, mesh)


def draw_mesh(frame: Frame, mesh: F64) -> None:
    """Draw the triangles of a face (81, 2) in place."""
    if (area := _area(frame, mesh)) is not None:
        (x0, y0, _, _), picture = area
        points = _fixed(mesh - (x0, y0))
        cv2.polylines(picture, list(points[_edges()]), False, _stored(frame, GREEN), 1, cv2.LINE_AA, _BITS)
        frame.write_roi(x0, y0, picture)


def draw_mask(frame: Frame, mesh: F64) -> None:
    """Tint what lies within the outline of a face (81, 2) in place."""
    if (area := _area(frame, mesh)) is not None:
        (x0, y0, _, _), picture = area
        tinted = picture.copy()
        outline = _fixed(mesh[SILHOUETTE] - (x0, y0))
        cv2.fillPoly(tinted, [outline], _stored(frame, AMBER), cv2.LINE_AA, _BITS)
        cv2.addWeighted(picture, 1 - TINT, tinted, TINT, 0, dst=picture)
        frame.write_roi(x0, y0, picture)


def draw_ring(frame: Frame, share: float) -> None:
    """Draw a ring around the middle of the picture in place, `share` in [0, 1] of it in colour."""
    short = min(frame.width, frame.height)
    centre, radius = np.array([frame.width - 1, frame.height - 1]) / 2, RING * short
    width = max(4, round(short / 45))
    if (area := _area(frame, np.array([centre - radius - width, centre + radius + width]))) is None:
        return
    (x0, y0, _, _), picture = area
    for end, thick, colour in ((1.0, width, PAPER), (min(max(share, 0.0), 1.0), 0.6 * width, GREEN)):
        turn = 2 * np.pi * np.linspace(-0.25, end - 0.25, 2 + round(CHORDS * end))
        way = np.column_stack([np.cos(turn), np.sin(turn)])
        rim = np.concatenate([(radius + thick / 2) * way, (radius - thick / 2) * way[::-1]])
        if end > 0:
            points = _fixed(centre - (x0, y0) + rim)
            cv2.fillPoly(picture, [points], _stored(frame, colour), cv2.LINE_AA, _BITS)
    frame.write_roi(x0, y0, picture)


def _area(frame: Frame, points: F64) -> tuple[tuple[int, int, int, int], Plane] | None:
    """The rectangle around points (n, 2) and its components; None when nothing of it can be drawn."""
    if not (np.abs(points) < _FAR).all():
        return None
    roi = frame.align_roi(*(points.min(0) - 2), *(points.max(0) + 3))
    return (roi, frame.read_roi(*roi)) if roi[2] > 0 and roi[3] > 0 else None


def _fixed(points: F64) -> NDArray[np.int32]:
    return np.round(points * (1 << _BITS)).astype(np.int32)


def _stored(frame: Frame, colour: Colour) -> list[float]:
    """An RGB colour in the frame's components."""
    return [float(v) for v in frame.colour.from_rgb @ (*colour, 1)]


@cache
def _edges() -> NDArray[np.int32]:
    """The edges (n, 2) of the canonical face's triangles."""
    triangles = ReferenceFrame.canonical(96).triangles
    edges = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    return np.unique(edges, axis=0).astype(np.int32)
