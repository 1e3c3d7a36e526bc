"""Drawing landmarks onto a frame: points, face outline, number and confidence.

Only the rectangle around a face is converted and written back.  Pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face
from guise.aam.landmarks.schemes import CLOSED_LINES, OPEN_LINES
from guise.app.media import Frame

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

# One colour for each of neighbouring tracks.
_OUTLINES: tuple[Colour, ...] = (
    (80, 200, 255), (255, 170, 60), (190, 130, 255), (120, 230, 120), (255, 110, 150), (240, 230, 90)
)  # fmt: skip
_CONFIDENT_COLOUR, _DOUBTFUL_COLOUR = np.array([90, 255, 120]), np.array([255, 60, 40])  # of points
_LABEL_BACKGROUND = (24, 24, 24)
_FRACTION_BITS = 4  # of a pixel, in OpenCV's drawing
_MAX_COORDINATE_PIXELS = 2**14  # beyond, points are not drawn: OpenCV takes 16 bits and the fraction
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_face(
    frame: Frame, face: Face, number: int | None = None, irises: NDArray[np.float64] | None = None
) -> None:
    """Draw a face on the frame, in place.

    Parameters
    ----------
    frame : Frame
    face : its points are drawn from red to green by their confidence, or by the face's.
    number : of its track, shown beside the confidence and chosen for the outline's colour.
    irises : (2, 3) x, y and radius, NaN of a shut eye; None for none.
    """
    if not (np.abs(face.points) < _MAX_COORDINATE_PIXELS).all():
        return
    size = float(np.ptp(face.points, axis=0).max())
    text = f"{'' if number is None else f'#{number} '}{face.confidence:.2f}"
    scale = min(max(size / 400, 0.35), 1.5)
    (wide, high), _ = cv2.getTextSize(text, _FONT, scale, 1)
    left, top = face.points.min(axis=0) - size / 40 - 3
    right, bottom = face.points.max(axis=0) + size / 40 + 4
    label_x = int(np.clip(left, 0, max(frame.width - wide - 6, 0)))
    label_y = int(np.clip(top - high - 8, 0, max(frame.height - high - 8, 0)))
    x0, y0, w, h = frame.align_roi(
        min(left, label_x), min(top, label_y), max(right, label_x + wide + 6), max(bottom, label_y + high + 8)
    )
    if w < 1 or h < 1:
        return
    picture = frame.rgb_roi(x0, y0, w, h)
    outline = _OUTLINES[(number or 0) % len(_OUTLINES)]
    _draw_points(picture, face, face.points - (x0, y0), outline, size)
    for iris in () if irises is None else irises[np.isfinite(irises).all(1)]:
        x, y, radius = np.round((iris - (x0, y0, 0)) * (1 << _FRACTION_BITS)).astype(int).tolist()
        cv2.circle(picture, (x, y), radius, outline, max(1, round(size / 250)), cv2.LINE_AA, _FRACTION_BITS)
    _draw_label(picture, text, (label_x - x0, label_y - y0), (wide, high), scale)
    stored = cv2.transform(picture, frame.colour.from_rgb)
    frame.write_roi(x0, y0, np.asarray(stored, np.uint8))


def _draw_points(
    picture: Picture, face: Face, points: NDArray[np.float32], outline: Colour, size: float
) -> None:
    fixed = np.round(points * (1 << _FRACTION_BITS)).astype(np.int32)
    thickness = max(1, round(size / 250))
    for group, closed in [*((g, True) for g in CLOSED_LINES), *((g, False) for g in OPEN_LINES)]:
        cv2.polylines(picture, [fixed[group]], closed, outline, thickness, cv2.LINE_AA, _FRACTION_BITS)
    confidence = (
        face.point_confidence if face.point_confidence is not None else np.full(len(points), face.confidence)
    )
    radius = round(max(1.0, size / 150) * (1 << _FRACTION_BITS))
    for (x, y), share in zip(fixed.tolist(), np.clip(confidence, 0, 1), strict=True):
        red, green, blue = (share * _CONFIDENT_COLOUR + (1 - share) * _DOUBTFUL_COLOUR).tolist()
        cv2.circle(picture, (x, y), radius, (red, green, blue), -1, cv2.LINE_AA, _FRACTION_BITS)


def _draw_label(
    picture: Picture, text: str, corner: tuple[int, int], size: tuple[int, int], scale: float
) -> None:
    (x, y), (wide, high) = corner, size
    cv2.rectangle(picture, (x, y), (x + wide + 5, y + high + 7), _LABEL_BACKGROUND, -1)
    cv2.putText(picture, text, (x + 3, y + high + 3), _FONT, scale, (255, 255, 255), 1, cv2.LINE_AA)
