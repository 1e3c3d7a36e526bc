"""The arms of glasses beside a disguise become skin; what is no glasses stays."""

import numpy as np
import pytest
from made_up import FRAME

from guise.aam.landmarks.schemes import LEFT_EYE_OUTER
from guise.aam.parsing import FaceClass, FaceParsing
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.cover import Arms
from guise.app.media import Frame


@pytest.mark.parametrize("kind", [FaceClass.GLASSES, FaceClass.HAIR])
def test_an_arm_beside_the_eye_becomes_skin(kind: FaceClass) -> None:
    scale = 6.0
    head = scale * FRAME.points + 60
    size = np.ceil(head.max(0)).astype(int) + 60
    rgb = np.full((size[1], size[0], 3), (200, 150, 130), np.uint8)
    x, y = np.round(head[LEFT_EYE_OUTER]).astype(int)
    rgb[y - 2 : y + 3, x + 10 : x + 40] = 30
    to_picture = np.array([[size[0] / 64, 0, 0], [0, size[1] / 64, 0]])
    shares = np.zeros((len(FaceClass), 64, 64), np.float32)
    shares[FaceClass.SKIN] = 1
    rows, columns = np.mgrid[:64, :64]
    here = (abs(rows * size[1] / 64 - y) < 6) & (abs(columns * size[0] / 64 - x - 25) < 22)
    shares[FaceClass.SKIN][here], shares[kind][here] = 0, 1
    frame, memory = Frame.from_rgb(rgb), Memory()
    memory.parsed = FaceParsing(shares, to_picture, np.zeros((2, 4))), head
    Arms().cover(FaceInFrame(frame, head, head), memory)
    seen = frame.rgb()[y, x + 15 : x + 35].mean()
    assert (seen > 120) == (kind is FaceClass.GLASSES)
