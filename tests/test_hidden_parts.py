"""What isn't seen of a face in a photo is filled from the other half, or from another face where both are hidden."""

import numpy as np
import pytest
from made_up import FRAME

from guise.aam.hidden_parts import hidden_share, uncovered
from guise.aam.landmarks.schemes import LEFT_BROW, NOSE_TIP, RIGHT_BROW
from guise.aam.mask import skin_mask, soft_parts
from guise.aam.parsing import CELLS, FaceClass, Parsing
from guise.aam.solid_shape import HeadPose, SolidPrior
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


def test_only_a_turned_head_hides_its_nose() -> None:
    cells, prior = np.zeros((len(FaceClass), CELLS, CELLS), np.float32), SolidPrior.shipped()
    x, y = np.round(FRAME.points[NOSE_TIP]).astype(int)
    shares = []
    for yaw in np.radians([0, 25]):
        rotation = np.array([[np.cos(yaw), 0, -np.sin(yaw)], [0, 1, 0], [np.sin(yaw), 0, np.cos(yaw)]])
        shape = HeadPose(rotation, 100.0, np.zeros(2)).apply(prior.mean)
        shares.append(hidden_share(Parsing(cells, np.eye(2, 3)), shape, FRAME))
    assert not shares[0].any()
    assert shares[1][y, x] > 0.9
    assert shares[1][RIGHT | LEFT].max() < 0.1
