"""The person's own brows are painted over with skin; hair, glasses and things in front of them stay."""

import numpy as np
import pytest
from made_up import FRAME
from numpy.testing import assert_array_equal

from guise.aam.landmarks.schemes import LEFT_BROW, NOSE_TIP, RIGHT_BROW
from guise.aam.parsing import CELLS, FaceClass, Parsing
from guise.app.swapping.brow_cover import cover_brows
from guise.common.arrays import U8

SCALE = 8.0  # pixels per grid pixel
HEAD = FRAME.points * SCALE + 80
SIZE = tuple(int(n) for n in HEAD.max(0)[::-1] + 80)
WIDTH = SCALE * FRAME.resolution
PIXELS_PER_CELL = max(SIZE) / CELLS
DRAWN = HEAD + np.array([0, 0.1 * WIDTH])  # a face whose brows lie lower
SKIN, HAIR = (150, 120, 140), (40, 126, 130)
BROWS = [np.round(HEAD[brow]).astype(int) for brow in (RIGHT_BROW, LEFT_BROW)]


def near(brow: np.ndarray, reach: float) -> np.ndarray:
    """(h, w) bool, pixels that lie within a reach of a brow's points."""
    ys, xs = np.mgrid[: SIZE[0], : SIZE[1]]
    away = np.hypot(xs[..., None] - brow[:, 0], ys[..., None] - brow[:, 1]).min(-1)
    return np.asarray(away < reach)


HAIRS = near(np.concatenate(BROWS), 0.025 * WIDTH)


def picture() -> U8:
    """A face with dark brows, in stored components."""
    made = np.full((*SIZE, 3), SKIN, np.uint8)
    made[HAIRS] = HAIR
    return made


def parsed(front: FaceClass | None = None) -> Parsing:
    """Skin and brows; `front` lies before the right brow."""
    shares = np.zeros((len(FaceClass), CELLS, CELLS), np.float32)
    rows = np.minimum((np.arange(CELLS) * PIXELS_PER_CELL).astype(int), SIZE[0] - 1)
    columns = np.minimum((np.arange(CELLS) * PIXELS_PER_CELL).astype(int), SIZE[1] - 1)
    hairs = HAIRS[np.ix_(rows, columns)].astype(np.float32)
    shares[FaceClass.BROWS], shares[FaceClass.SKIN] = hairs, 1 - hairs
    if front is not None:
        before = near(BROWS[0], 0.08 * WIDTH)[np.ix_(rows, columns)]
        shares[:, before] = 0
        shares[front, before] = 1
    return Parsing(shares, np.array([[PIXELS_PER_CELL, 0, 0], [0, PIXELS_PER_CELL, 0]]))


def test_brows_become_skin_and_the_rest_stays() -> None:
    shown = picture()
    cover_brows(shown, HEAD, DRAWN, parsed(), WIDTH)
    for brow in BROWS:
        middle = shown[brow[1:4, 1], brow[1:4, 0]].astype(int)
        assert np.abs(middle - SKIN).max() <= 6
    assert_array_equal(shown[tuple(np.round(HEAD[NOSE_TIP]).astype(int)[::-1])], SKIN)


@pytest.mark.parametrize("front", [FaceClass.HAIR, FaceClass.GLASSES, FaceClass.OCCLUDER])
def test_what_lies_before_a_brow_stays(front: FaceClass) -> None:
    before, shown = picture(), picture()
    cover_brows(shown, HEAD, DRAWN, parsed(front), WIDTH)
    right = tuple(BROWS[0][2, ::-1])
    assert_array_equal(shown[right], before[right])
    assert np.abs(shown[tuple(BROWS[1][2, ::-1])].astype(int) - SKIN).max() <= 6


def test_a_brow_on_the_line_of_the_drawn_one_stays() -> None:
    longer = HEAD.copy()
    longer[RIGHT_BROW] += 0.1 * (HEAD[RIGHT_BROW] - HEAD[RIGHT_BROW][-1])
    shown = picture()
    cover_brows(shown, HEAD, longer, parsed(), WIDTH)
    assert_array_equal(shown, picture())


def test_a_brow_with_no_skin_beside_it_stays() -> None:
    shares = parsed().shares.copy()
    shares[FaceClass.HAIR] += shares[FaceClass.SKIN]
    shares[FaceClass.SKIN] = 0
    shown = picture()
    cover_brows(shown, HEAD, DRAWN, Parsing(shares, parsed().to_picture), WIDTH)
    assert_array_equal(shown, picture())


def test_a_head_beyond_the_picture_is_no_error() -> None:
    shown = picture()
    cover_brows(shown, HEAD - 2 * np.array(SIZE[::-1]), DRAWN, parsed(), WIDTH)
    assert_array_equal(shown, picture())
