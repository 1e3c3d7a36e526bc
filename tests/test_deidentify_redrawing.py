"""Who is still recognised is found out in the part of a file that shows them longest."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from guise.app.deidentify.run.redrawing import telling_segments
from guise.app.deidentify.stages.alike import LIMITS
from guise.app.deidentify.stages.case import Case
from guise.app.deidentify.stages.jobs import tried_frames
from guise.app.swapping.policy import COVERED, SWAPPED, FaceTreatment

SPANS = [(0, 100), (100, 200), (200, 300), (300, 400)]


@pytest.mark.parametrize(
    ("shown", "expected"),
    [
        ({1: range(0, 20)}, (0,)),
        ({1: range(90, 260)}, (1,)),  # ten frames, a hundred and sixty
        ({1: range(10, 30), 2: range(300, 400)}, (0, 3)),
        ({1: range(10, 30), 3: range(200, 300)}, (2,)),  # two tracks of one person
        ({}, ()),
    ],
)
def test_the_segment_that_shows_somebody_longest_tells(
    shown: dict[int, range], expected: tuple[int, ...]
) -> None:
    rows = [(frame, track, SWAPPED) for track, frames in shown.items() for frame in frames]
    rows += [(frame, 1, COVERED) for frame in range(300, 400)]
    plan = dict(zip(("frame", "track", "done"), np.array(rows).T, strict=True))
    tracks = [SimpleNamespace(number=number, person=person) for number, person in ((1, 1), (2, 2), (3, 1))]
    case: Any = SimpleNamespace(
        scan=SimpleNamespace(segments=SPANS), span=SPANS.__getitem__, plan=plan, tracks=tracks
    )
    assert telling_segments(cast(Case, case)) == expected


def test_a_trial_takes_frames_of_everybody() -> None:
    box = np.zeros(4, np.float32)
    planned = {
        frame: [
            FaceTreatment(who, SWAPPED if who < 3 else COVERED, box, 1.0)
            for who in (1, 2, 3)
            if frame >= 100 * who
        ]
        for frame in range(400)
    }
    assert tried_frames(planned)[0] == 100
    assert tried_frames(planned)[-1] == 399
    assert len(set(tried_frames(planned)) & set(range(200, 400))) > LIMITS.tried_frames
    assert tried_frames({}) == ()
