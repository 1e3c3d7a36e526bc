"""Where two pictures differ."""

from functools import partial

import cv2
import numpy as np

from guise.aam.changes import changed_parts


def test_parts_that_differ_are_told_with_what_is_about_them() -> None:
    """At half the size: two parts near each other are one, noise of encoding is none."""
    before = np.random.default_rng(1).integers(0, 255, (720, 1280), np.uint8) // 4 + 60
    small = partial(cv2.resize, dsize=(640, 360), interpolation=cv2.INTER_AREA)
    after = before + np.random.default_rng(2).integers(0, 4, before.shape, np.uint8)
    assert changed_parts(small(before), small(after), 0.5) == []
    for x, y in ((100, 100), (230, 100), (1100, 600)):
        after[y : y + 100, x : x + 100] = 20
    parts = sorted(changed_parts(small(before), small(after), 0.5))
    wanted = [(50, 50, 380, 250), (1050, 550, 1250, 720)]
    np.testing.assert_allclose(parts, wanted, atol=20)
