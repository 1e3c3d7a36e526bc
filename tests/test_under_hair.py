"""What hair hides of a face in a photo is filled from the other half, or from another face where both are hidden."""

import numpy as np
import pytest
from made_up import FRAME

from guise.aam.landmarks.schemes import LEFT_BROW, RIGHT_BROW
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.parsing import CELLS, FaceClass, Parsing
from guise.aam.under_hair import hidden_share, uncovered
from guise.common.arrays import F32

FAIR, FRINGE = (200, 160, 140), (20, 15, 10)
RIGHT, LEFT = (soft_parts(FRAME, (brow,), 0.03) > 0.5 for brow in (RIGHT_BROW, LEFT_BROW))


def face(tone: float, brow: float) -> F32:
    """(h, w, 3) somebody with brows so bright."""
    skin = np.where(FRAME.mask[..., None], np.float32(tone) * np.array(FAIR, np.float32), 0)
    return np.where((RIGHT | LEFT)[..., None], np.float32(brow) * skin, skin)


@pytest.mark.parametrize(("hidden", "brow"), [(RIGHT, 0.5), (RIGHT | LEFT, 0.3)])
def test_a_hidden_brow_is_the_other_or_another_persons_in_the_own_tone(hidden: F32, brow: float) -> None:
    own, other = face(1.0, 0.5), face(0.4, 0.3)
    covered = np.where(hidden[..., None], np.array(FRINGE, np.float32), own)
    made = uncovered(covered, hidden.astype(np.float32), other, FRAME)
    np.testing.assert_array_equal(made[~hidden], covered[~hidden])
    np.testing.assert_allclose(np.median(made[RIGHT], 0), brow * np.array(FAIR), rtol=0.06)


def test_a_brow_is_hidden_as_a_whole_and_a_bald_face_is_not() -> None:
    cells = np.zeros((len(FaceClass), CELLS, CELLS), np.float32)
    scale = CELLS / max(FRAME.size)
    parsing = Parsing(cells, np.array([[1 / scale, 0, 0], [0, 1 / scale, 0]]))
    assert not hidden_share(parsing, FRAME.points, FRAME).any()
    end = FRAME.points[RIGHT_BROW]
    x, y = (scale * end.min(0)).astype(int)
    cells[FaceClass.HAIR, y - 2 : y + 5, x - 1 : x + 7] = 1
    share = hidden_share(parsing, FRAME.points, FRAME)
    assert share[RIGHT].min() > 0.5
    assert share[LEFT].max() < 0.05
    assert share[skin_mask(FRAME)].mean() < 0.2
