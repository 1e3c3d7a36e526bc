"""Pictures of a model: mean, neutral, still, and the first modes at two standard deviations; and a portrait.

Each face is drawn on its own shape, so that modes of shape show as well as modes of texture.
"""

from __future__ import annotations

import cv2
import numpy as np

from guise.aam.appearance import AppearanceModel
from guise.aam.model import Identity
from guise.app.media.pictures import SHEET, Picture, labelled, sheet
from guise.common.arrays import F32
from guise.render import feather, make_compositor

MODE_DEVIATIONS = 2.0
DEFAULT_MODES = 6
FACE_PIXELS = 150  # across a face
PORTRAIT_PIXELS = 240
PORTRAIT_FACE_HEIGHTS = 0.75  # from the middle of a face to the sides of its portrait
BORDER_FACE_WIDTHS = 0.12
FEATHER_FACE_WIDTHS = 0.01  # standard deviation


def montage(identity: Identity, modes: int = DEFAULT_MODES) -> Picture:
    """Rows: mean, neutral and still; then modes at minus and plus two standard deviations (h, w, 3)."""
    look = identity.appearance
    components = look.components
    shown = min(modes, components.modes)
    faces = {"mean": components.mean, "neutral": look.neutral}
    rows = [[labelled(draw(look, face), name) for name, face in faces.items()] + [_still(identity)]]
    for sign, name in ((-1, "-"), (1, "+")):
        row = []
        for k in range(shown):
            step = np.float32(sign * MODE_DEVIATIONS) * components.deviations[k] * components.basis[:, k]
            share = components.deviations[k] ** 2 / max(components.total_variance, 1e-12)
            caption = f"mode {k + 1} {name}{MODE_DEVIATIONS:.0f} sd ({100 * share:.0f} %)"
            row.append(labelled(draw(look, components.mean + step), caption))
        rows.append(row)
    return sheet(rows)


def portrait(identity: Identity, side: int = PORTRAIT_PIXELS) -> Picture:
    """The head at rest, as it was enrolled (side, side, 3)."""
    picture, shape = identity.rest_frame.picture, identity.rest_frame.shape
    centre, reach = shape.mean(0), PORTRAIT_FACE_HEIGHTS * np.ptp(shape[:, 1])
    reach = min(reach, *centre, *(picture.shape[1::-1] - centre))
    x0, y0, x1, y1 = np.round([*(centre - reach), *(centre + reach)]).astype(int)
    return np.asarray(cv2.resize(picture[y0:y1, x0:x1], (side, side), interpolation=cv2.INTER_AREA), np.uint8)


def draw(look: AppearanceModel, vector: F32, face: int = FACE_PIXELS) -> Picture:
    """An appearance on its own shape, `face` pixels across, on dark paper (h, w, 3)."""
    reference = look.reference
    zoom = face / reference.resolution
    border = BORDER_FACE_WIDTHS * reference.resolution
    height, width = (round((side + 2 * border) * zoom) for side in reference.size)
    paper = np.full((height, width, 3), SHEET.background, np.uint8)
    alpha = feather(look.mask, FEATHER_FACE_WIDTHS * reference.resolution)
    with make_compositor(
        "cpu", reference.triangles, reference.points.astype(np.float32), alpha
    ) as compositor:
        mesh = (look.shape_of(vector) + border) * zoom
        return compositor.composite(paper, look.picture(vector), mesh)


def _still(identity: Identity) -> Picture:
    """The enrolment frame's face, as high as the drawn ones."""
    height, width = draw(identity.appearance, identity.appearance.neutral).shape[:2]
    shape, picture = identity.rest_frame.shape, identity.rest_frame.picture
    centre, scale = (shape.min(0) + shape.max(0)) / 2, FACE_PIXELS / np.ptp(shape[:, 0])
    offset = np.array([width, height]) / 2 - centre * scale
    matrix = np.array([[scale, 0, offset[0]], [0, scale, offset[1]]])
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    crop = cv2.warpAffine(
        picture,
        matrix,
        (width, height),
        flags=how,
        borderValue=(SHEET.background, SHEET.background, SHEET.background),
    )
    return labelled(np.asarray(crop, np.uint8), "still")
