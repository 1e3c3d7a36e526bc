"""The arms of a person's glasses beside a face that is drawn without them: they become what is beside them.

A. Telea, "An image inpainting technique based on the fast marching method", Journal of Graphics Tools 9(1), 2004.
Pixels, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks.schemes import OUTER_EYE_CORNERS
from guise.aam.parsing import FaceClass
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.common.small import mean
from guise.common.tuned import tuned


@dataclass(frozen=True)
class ArmsLimits:
    """Where arms are looked for, face widths from the outer corner of an eye."""

    aside: float = tuned(0.3, "face widths", "deidentify.identity")
    reach: float = tuned(0.14, "face widths", "deidentify.identity")  # up and down, and inwards
    share: float = tuned(0.12, "share", "landmarks.parsing")  # of glasses, from which a pixel is an arm's
    around: float = tuned(0.03, "face widths", "deidentify.identity")  # from which it is painted
    least: float = tuned(0.5, "share", "landmarks.parsing")  # of glasses, where they are seen best


LIMITS = ArmsLimits()


def cover_arms(face: FaceInFrame, memory: Memory) -> None:
    """Paint over the arms of glasses in the frame."""
    if memory.parsed is None or memory.parsed[0].shares[FaceClass.GLASSES].max() < LIMITS.least:
        return
    (parsing, then), frame, head = memory.parsed, face.frame, face.head
    width, moved = float(np.ptp(head[:, 0])), mean(head - then, 0)
    for eye, sign in zip(OUTER_EYE_CORNERS, (-1, 1), strict=True):
        (x, y), out, reach = head[eye], sign * LIMITS.aside * width, LIMITS.reach * width
        x0, x1 = sorted((x - sign * reach, x + out))
        left, top, w, h = frame.align_roi(x0, y - reach, x1, y + reach)
        if min(w, h) < 2:
            continue
        here = parsing.from_place(*((left, top) - moved))
        shares = cv2.warpAffine(
            here.shares[FaceClass.GLASSES],
            here.to_cells,
            (w, h),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        arms = (shares > LIMITS.share).astype(np.uint8)
        if arms.any():
            part = np.ascontiguousarray(frame.read_yuv(left, top, w, h))
            made = cv2.inpaint(part, arms, LIMITS.around * width, cv2.INPAINT_TELEA)
            frame.write_yuv(left, top, np.asarray(made, np.uint8))
