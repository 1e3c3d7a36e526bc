"""The built-in face detector: a small network that ships with the package.

`aam/data/detector.onnx` is made by `training/train_detector.py` and rounded to 8 bits by `round_detector.py` there
(`aam/data/detector.md` has data, licence and figures). For cells of 8, 16 and 32 pixels it gives how likely the centre
of a face is there, and the box.

Boxes are ``x0 y0 x1 y1`` float32 pixels of the given picture, pixel centres at integers, largest first: the tight box
of the 68 iBUG points, also where it reaches beyond the picture's edge. Images are RGB (h, w, 3) or grey (h, w), uint8.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from guise.aam.landmarks.boxes import check_smallest, no_boxes, smallest_pixels, strongest
from guise.aam.landmarks.face import BoxFit
from guise.aam.onnx_model import ShippedNetwork
from guise.common.arrays import F32, F64, U8, side_by_side
from guise.common.kernels import kernel

MIN_FACE_PIXELS = 12  # that the network sees reliably
_STRIDES = (8, 16, 32)
MIDDLE_GREY = 127.5  # 0 for the network
UNIT_STRIDES = 2  # of the network's distances
_FIT = BoxFit()


@dataclass(eq=False)
class FaceDetector:
    """Faces of any size, turned up to about 45 degrees, also partly hidden or cut by the picture's edge.

    Time follows the area of the picture that the network sees, the given one scaled down by `smallest` and `longest`.

    Parameters
    ----------
    smallest : float
        Smallest face to find: a share of the picture's height up to 1, or pixels above 1 (12 at least).
    longest : int
        Pixels, the longer side of the picture that the network sees at most; larger pictures are scaled down further.
    min_score : float
        In [0, 1]; boxes below are dropped.
    threads : int
        Of onnxruntime.

    Examples
    --------
    >>> FaceDetector().detect(np.zeros((120, 160, 3), np.uint8)).shape
    (0, 4)
    """

    smallest: float = 24
    longest: int = 1280
    min_score: float = 0.5
    threads: int = 1
    fit: BoxFit = _FIT
    name: str = field(default="builtin", init=False)

    def __post_init__(self) -> None:
        """Check the options and load the network."""
        check_smallest(self.smallest)
        self._session = ShippedNetwork("detector.onnx", self.threads, keeps=True)
        self._memory: list[F32] = []  # of the network's pictures, each of one call at a time

    def detect(self, image: U8) -> F32:
        """Boxes (n, 4)."""
        return self.detect_scored(image)[0]

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        """Boxes (n, 4) and scores (n,) in [0, 1]."""
        small = self._scaled(image)
        rgb = cv2.cvtColor(small, cv2.COLOR_GRAY2RGB) if small.ndim == 2 else small
        levels = self._answers(side_by_side(rgb))
        found = [
            _peaks(maps[0], stride, self.min_score) for maps, stride in zip(levels, _STRIDES, strict=True)
        ]
        boxes, scores = (np.concatenate(parts) for parts in zip(*found, strict=True))
        if len(boxes) == 0:
            return no_boxes()
        scale = np.array(image.shape[1::-1]) / small.shape[1::-1]
        return strongest((boxes + 0.5) * np.tile(scale, 2) - 0.5, scores, self.min_score)

    def _answers(self, rgb: U8) -> list[F32]:
        """The network's levels for the picture (h, w, 3) that it sees."""
        memory = self._memory.pop() if self._memory else np.empty(0, np.float32)
        if memory.size < rgb.size:
            memory = np.empty(rgb.size, np.float32)
        planes = memory[: rgb.size].reshape(3, *rgb.shape[:2])
        colour_planes(rgb, MIDDLE_GREY, planes)
        levels: list[F32] = self._session.run(None, {"image": planes[None]})
        self._memory.append(memory)
        return levels

    def _scaled(self, image: U8) -> Any:
        height, width = image.shape[:2]
        smallest = smallest_pixels(self.smallest, image)
        factor = min(1.0, MIN_FACE_PIXELS / smallest, self.longest / max(height, width))
        size = (max(1, round(width * factor)), max(1, round(height * factor)))
        return image if size == (width, height) else cv2.resize(image, size, interpolation=cv2.INTER_AREA)


@kernel
def colour_planes(picture: U8, middle: float, planes: F32) -> None:
    """Write the components of a picture (h, w, 3) less a middle value, one after another, to planes (3, h, w)."""
    np.subtract(cv2.split(picture), np.float32(middle), out=planes)


def _peaks(maps: F32, stride: int, least: float) -> tuple[F64, F64]:
    """Boxes (n, 4) and scores (n,) of the cells that look most like a centre among their neighbours.

    maps : (5, h, w) of one level: logit, and left, top, right, bottom of the box in units of 2 strides from the cell.
    """
    logit = maps[0]
    highest = cv2.dilate(logit, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((logit == highest) & (logit >= _logit(least)))
    reach = maps[1:, rows, columns].T.astype(np.float64) * (UNIT_STRIDES * stride)
    centre = np.column_stack([columns, rows]) * float(stride) + (stride - 1) / 2
    scores = 1 / (1 + np.exp(-logit[rows, columns].astype(np.float64)))
    return np.concatenate([centre - reach[:, :2], centre + reach[:, 2:]], axis=1), scores


def _logit(share: float) -> float:
    share = min(max(share, 1e-6), 1 - 1e-6)
    return float(np.log(share / (1 - share)))
