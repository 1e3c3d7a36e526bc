"""What hangs loose beside a head before a plain background goes with it; bodies and patterns stay."""

import cv2
import numpy as np

from guise.app.deidentify.stages.head_matte import Gap
from guise.app.deidentify.stages.loose import _loose, _plain, _wide
from guise.common.arrays import F32

SIZE, WIDTH = (260, 240), 100.0
HEAD = cv2.circle(np.zeros(SIZE, np.uint8), (120, 100), 60, 1, -1) > 0


def scene(*, pattern: float = 0.0) -> F32:
    """A head with a strand at its left, over a body, before a wall that becomes brighter to the right."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    wall = np.dstack([150 + 0.2 * x, 160 + 0.1 * x, 170 + 0.1 * y]) + pattern * np.sin(x / 4)[..., None]
    made = wall.astype(np.float32)
    made[HEAD] = (200, 150, 130)
    cv2.line(made, (75, 135), (60, 190), (60, 40, 30), 3)
    made[215:, 40:200] = (30, 30, 90)
    return made


def test_a_strand_goes_and_the_body_stays() -> None:
    beside = ~HEAD & (np.arange(SIZE[0])[:, None] < 110)
    plain = _plain(scene(), ~HEAD, beside, WIDTH)
    assert plain is not None
    odd = ~(HEAD | plain)
    body = _wide(odd, 0.1 * WIDTH)
    assert body[230, 120]
    loose = _loose(odd & ~body, HEAD, WIDTH)
    assert loose[165:185, 55:75].any(1).all()
    assert not loose[220:].any()
    assert not loose[:, 140:].any()


def test_before_a_pattern_nothing_is_told() -> None:
    beside = ~HEAD & (np.arange(SIZE[0])[:, None] < 110)
    assert _plain(scene(pattern=40), ~HEAD, beside, WIDTH) is None


def test_a_gap_grows_by_parts_of_a_picture_of_another_size() -> None:
    cells, body = np.ones((10, 10), bool), np.zeros((10, 10), bool)
    gap = Gap(cells, body, np.array([100.0, 80.0]), 0.25)
    part = np.zeros((80, 80), bool)
    part[60:70, 10:20] = True
    grown = gap.with_parts(part, np.zeros_like(part), np.array([50.0, 60.0]), 0.5)
    shares = grown.share((0, 0, 240, 240))
    assert shares[190, 80] > 0.9
    assert shares[100, 120] > 0.9
    assert shares[190, 120] < 0.1
    assert shares[60, 60] < 0.1
