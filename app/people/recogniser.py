"""A face recogniser that the user brings: an ONNX model and the TOML card that describes it.

The card says everything that is needed to feed the model::

    name = "mobilefacenet"        # optional, for reports; the card's file name without it
    model = "mobilefacenet.onnx"  # path, relative to the card
    sha256 = "64184e22..."        # optional; checked when there

    [input]
    size = [112, 112]             # width, height in pixels
    colour = "rgb"                # rgb or bgr; default rgb
    layout = "nchw"               # nchw or nhwc; default nchw
    mean = 127.5                  # value = (byte - mean) * scale, byte in 0..255;
    scale = 0.00784313725490196   # one number or one per channel; default: mean 0, scale 1/255

    [template]                    # where five points of the face lie in the input, pixels:
    points = [[38.29, 51.70], [73.53, 51.50], [56.03, 71.74], [41.55, 92.37], [70.73, 92.20]]

The five points are the middles of the eyes (the left one in the picture first), the tip of the nose and the corners of
the mouth. The model's first output is the embedding; two faces are compared by the cosine of theirs.

Images RGB uint8 (h, w, 3); pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import LEFT_EYE, MOUTH_CORNERS, NOSE_TIP, RIGHT_EYE
from guise.aam.model_card import CardReader, ModelCard, is_list, is_number
from guise.aam.onnx_model import OnnxModel
from guise.aam.similarity import Failed, align
from guise.common.arrays import F32, F64, U8
from guise.common.errors import GuiseError

_SHRUNK_SCALE = 0.5  # of the picture, below which it is averaged and not interpolated


class RecogniserError(GuiseError):
    """A recogniser or its card that cannot be used; one sentence."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RecogniserCard(ModelCard):
    """What the card of a recogniser says; see the module's text.

    Parameters
    ----------
    template : (5, 2) pixels of the input.
    """

    kind: ClassVar[str] = "recogniser"
    error: ClassVar[type[RecogniserError]] = RecogniserError

    template: F64


def read_recogniser_card(path: Path) -> RecogniserCard:
    """The card in a TOML file; RecogniserError, in one sentence, for anything wrong in it."""
    reader = CardReader(path, RecogniserCard, {"template": ("points",)})
    return RecogniserCard(**reader.common(), template=_template(reader))


def _template(reader: CardReader) -> F64:
    value = reader.section("template").get("points")
    if not is_list(value, 5) or not all(is_list(row, 2) and all(map(is_number, row)) for row in value):
        raise reader.fault("template", "points", "five points [x, y] in pixels", value)
    return np.array(value, np.float64)


class Recogniser:
    """Embeddings of faces whose landmarks are known.

    Parameters
    ----------
    card : path or RecogniserCard.

    Raises
    ------
    RecogniserError
        When the model is missing, isn't an ONNX file, or differs from what the card says.
    """

    def __init__(self, card: Path | RecogniserCard) -> None:
        self.card = card if isinstance(card, RecogniserCard) else read_recogniser_card(card)
        self._model = OnnxModel(self.card)
        self.dimension = len(self._embedding(np.zeros((*self.card.size[::-1], 3), np.uint8)))

    @property
    def name(self) -> str:
        """Shown in reports."""
        return self.card.name

    def __call__(self, rgb: U8, points: NDArray[Any]) -> F32 | None:
        """The embedding (d,), of length one, of the face with landmarks (81, 2) in a picture (h, w, 3).

        None when the points have no extent, or the model gives no usable numbers.
        """
        move = align(five_points(points), self.card.template)
        if isinstance(move, Failed):
            return None
        vector = self._embedding(self._aligned(rgb, np.column_stack([move.linear, move.translation])))
        length = float(np.linalg.norm(vector))
        return vector / np.float32(length) if np.isfinite(length) and length > 0 else None

    def _aligned(self, rgb: U8, matrix: F64) -> U8:
        """The face in the model's input, (height, width, 3); beyond the picture it is black."""
        how = cv2.INTER_AREA if np.linalg.norm(matrix[:, 0]) < _SHRUNK_SCALE else cv2.INTER_LINEAR
        return np.asarray(cv2.warpAffine(rgb, matrix, self.card.size, flags=how), np.uint8)

    def _embedding(self, face: U8) -> F32:
        return self._model(face).astype(np.float32).ravel()


def five_points(points: NDArray[Any]) -> F64:
    """(5, 2) middles of the eyes, tip of the nose, corners of the mouth, of landmarks (81, 2)."""
    shape = np.asarray(points, np.float64)
    return np.stack(
        [shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0), shape[NOSE_TIP], *shape[MOUTH_CORNERS]]
    )
