"""What a report says was done."""

from __future__ import annotations

import numpy as np

from guise.app.deidentify.run.results import _counts
from guise.app.swapping.policy import COVERED, LEFT, SWAPPED


def test_every_frame_counts_by_the_worst_that_was_done_there() -> None:
    plan = {"frame": np.array([0, 1, 1, 2, 3]), "done": np.array([SWAPPED, SWAPPED, COVERED, LEFT, SWAPPED])}
    counts = {"without face": 2, "swapped": 2, "covered": 1, "left": 1}
    assert _counts(plan, 6, []) == counts
    of_the_audit = [1, 2, 3, 5]
    counts = {"without face": 1, "swapped": 1, "covered": 3, "left": 1}
    assert _counts(plan, 6, of_the_audit) == counts
