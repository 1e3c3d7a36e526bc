"""Embeddings of faces by a recogniser that the project has no part in (models/mobilefacenet.onnx).

It sees RGB 112 x 112, aligned by five points of the landmarks.  Cosine similarity.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import onnxruntime as ort

from benchmarks import common
from benchmarks.common import F64, Clip, Picture
from guise.aam.landmarks.schemes import LEFT_EYE, MOUTH_CORNERS, NOSE_TIP, RIGHT_EYE
from guise.aam.similarity import Similarity, align
from guise.common.arrays import F32

TEMPLATE = np.array([[38.29, 51.70], [73.53, 51.50], [56.03, 71.74], [41.55, 92.37], [70.73, 92.20]])


class Recogniser:
    """Unit embeddings of aligned faces."""

    def __init__(self, model: Path) -> None:
        settings = ort.SessionOptions()
        settings.log_severity_level = 3
        self._session = ort.InferenceSession(str(model), settings, providers=["CPUExecutionProvider"])
        self._input = self._session.get_inputs()[0].name

    def __call__(self, rgb: Picture, shape: F64) -> F32:
        """(128,) of the face with landmarks (81, 2) in a picture (h, w, 3)."""
        face = (aligned(rgb, shape).astype(np.float32) - 127.5) / 127.5
        vector = self._session.run(None, {self._input: face.transpose(2, 0, 1)[None]})[0][0]
        return np.asarray(vector / np.linalg.norm(vector), np.float32)


def aligned(rgb: Picture, shape: F64) -> Picture:
    """The face (112, 112, 3), by the least-squares similarity of five points to the recogniser's template."""
    five = np.stack(
        [shape[RIGHT_EYE].mean(0), shape[LEFT_EYE].mean(0), shape[NOSE_TIP], *shape[MOUTH_CORNERS]]
    )
    move = align(five, TEMPLATE)
    assert isinstance(move, Similarity)
    matrix = np.column_stack([move.linear, move.translation])
    how = cv2.INTER_AREA if move.scale < 0.5 else cv2.INTER_LINEAR
    return np.asarray(cv2.warpAffine(rgb, matrix, (112, 112), flags=how), np.uint8)


def person(clip: Clip, indices: set[int], recognise: Recogniser) -> F32:
    """The mean embedding (128,) of a person over some frames of a clip."""
    found = [
        recognise(frame.rgb(), clip.points[frame.index])
        for frame in common.frames(clip)
        if frame.index in indices and np.isfinite(clip.points[frame.index]).all()
    ]
    return unit(np.mean(found, axis=0))


def unit(vector: F32) -> F32:
    """A vector of length one."""
    return np.asarray(vector / np.linalg.norm(vector), np.float32)


def spread(count: int, number: int) -> list[int]:
    """Indices evenly spread over `count` frames, the ends left out."""
    return [int(i) for i in np.unique(np.round((np.arange(number) + 0.5) * count / number - 0.5))]
