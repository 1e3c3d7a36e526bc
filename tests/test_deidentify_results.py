"""One truth: what reports, sentences and tables count is what can be seen in the pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from guise.aam.landmarks.schemes import mean_geometry
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.deidentify.covers import (
    BYSTANDER,
    COLUMNS,
    FOUND,
    REASONS,
    UNSURE_FIT,
    covers_of,
    numbered,
    rows_from,
)
from guise.app.deidentify.report.page import COUNTS, frame_shares
from guise.app.deidentify.report.report import frames_with, outcome, unverified, verdict
from guise.app.deidentify.run.results import outcomes_of, renderers_of
from guise.app.deidentify.stages.render import as_drawn
from guise.app.deidentify.tracks import FileReport
from guise.app.drawing.engine import SwapResult
from guise.app.media import Frame
from guise.app.swapping.policy import COVERED, LEFT, NOBODY, SWAPPED, FaceTreatment
from guise.app.swapping.session import SwapSession
from guise.common.text import counted

FACE = mean_geometry().mean - mean_geometry().mean.mean()
MIDDLES = {1: (50, 80), 2: (150, 80)}  # of two people's faces
HALF, RED, GREY = 12, (0, 0, 255), 127  # green, blue, red, as pictures are stored
NOTHING, DRAWN, FAILED, COVER, LEAVE, UNDER_COVER, UNDER_FIND, TURNED = range(8)


class Engine:
    """Draws a red face."""

    renderer, doubt = "cpu", 0.0

    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> SwapResult:
        if not isinstance(fit, Fit):
            return SwapResult("lost", fit)
        x, y = fit.shape.mean(0).astype(int) - HALF
        frame.write_roi(int(x), int(y), np.full((2 * HALF, 2 * HALF, 3), RED, np.uint8))
        return SwapResult("swapped", fit, fit.shape, self.doubt)

    def close(self) -> None:
        """Nothing is held."""


def mesh(who: int) -> np.ndarray:
    return np.stack([FACE.real, FACE.imag], axis=1) / np.ptp(FACE.real) * HALF + MIDDLES[who]


def planned(who: int, case: int) -> Iterator[FaceTreatment]:
    """What is to be done with a face."""
    x, y = MIDDLES[who]
    box = np.array([x - HALF, y - HALF, x + HALF, y + HALF], np.float32)
    done = {COVER: COVERED, LEAVE: LEFT}.get(case, SWAPPED)
    if case != NOTHING:
        yield FaceTreatment(who, done, box, 1.0, reason=UNSURE_FIT if done == COVERED else 0)
    if case in (UNDER_COVER, UNDER_FIND):
        yield FaceTreatment(
            NOBODY, COVERED, box + 2, 1.0, reason=FOUND if case == UNDER_FIND else BYSTANDER, cover=9
        )


def seen(rgb: np.ndarray, before: np.ndarray, who: int) -> str:
    """What became of a face, from the pixels."""
    x, y = MIDDLES[who]
    if (rgb[y, x] == before[y, x]).all():
        return "as before"
    return "swapped" if rgb[y, x, 0] > GREY + 60 else "covered"


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 7)), min_size=1, max_size=12))
def test_what_is_counted_is_what_can_be_seen(cases: list[tuple[int, int]]) -> None:
    before = np.zeros((160, 200, 3), np.uint8)
    before[..., 2] = 200
    done, looks, engines = {}, [], {who: Engine() for who in MIDDLES}
    with SwapSession(engines.__getitem__, "solid") as session:  # type: ignore[arg-type]
        for index, case in enumerate(cases):
            frame = Frame.from_rgb(before.copy(), index=index)
            plan = [one for who, what in zip(MIDDLES, case, strict=True) for one in planned(who, what)]
            fits: dict[int, Fit | Failed] = {
                who: Failed("hidden") if what == FAILED else Fit(mesh(who), np.zeros(0), 0, 1)
                for who, what in zip(MIDDLES, case, strict=True)
            }
            for who, what in zip(MIDDLES, case, strict=True):
                engines[who].doubt = float(what == TURNED)
            done[index] = as_drawn(plan, session.treat(frame, plan, fits))
            looks.append([seen(frame.rgb(), before, who) for who in MIDDLES])
    rows, frames = rows_from(done), len(cases)
    report = FileReport("a", "b", frames, np.arange(frames) / 25, 200, 160, (), outcomes_of(rows, [1, 2]), (),
                        tuple(covers_of(rows)))  # fmt: skip
    for kind in ("swapped", "covered"):
        shown = [index for index, look in enumerate(looks) if kind in look]
        assert frames_with(report, kind).tolist() == shown
        said = f"{kind} in {counted(len(shown), 'frame')}" in verdict(report)
        assert said == bool(shown)
    left = sum(LEAVE in case for case in cases)
    covered = sum("covered" in look and LEAVE not in case for case, look in zip(cases, looks, strict=True))
    table = {share.words: share.frames for share in frame_shares(report.counts)}
    assert table[COUNTS["covered"]] == covered
    assert table[COUNTS["left"]] == left
    assert table[COUNTS["without face"]] == sum(case == (NOTHING, NOTHING) for case in cases)
    assert sum(table.values()) == frames
    under = {index for one in report.covers for index in range(one.first, one.last + 1)}
    assert {index for index, look in enumerate(looks) if "covered" in look} <= under
    first = next((k for k, case in enumerate(cases) if case != (NOTHING, NOTHING)), frames)
    watched = [k for k, case in enumerate(cases) if case == (NOTHING, NOTHING) and k > first]
    assert unverified(report).tolist() == watched
    assert outcome(report) == (3 if watched else 0)


def test_covers_have_a_number_each_and_say_why() -> None:
    box = np.array([10, 10, 30, 30], np.float32)
    unsure = FaceTreatment(1, COVERED, box, 1.0, reason=UNSURE_FIT)
    other = FaceTreatment(NOBODY, COVERED, box + 90, 1.0, confidence=0.5, reason=BYSTANDER, cover=1)
    swap = FaceTreatment(1, SWAPPED, box, 1.0)
    rows = rows_from({0: [unsure, other], 1: [unsure], 2: [swap], 3: [unsure, other]})
    told = [(one.number, one.track, one.first, one.last, one.reason) for one in covers_of(rows)]
    why = REASONS[UNSURE_FIT]
    assert told == [(1, 0, 0, 3, REASONS[BYSTANDER]), (2, 1, 0, 1, why), (3, 1, 3, 3, why)]
    assert covers_of(rows)[0].box == (100, 100, 120, 120)
    assert {name: kind.dtype.type for name, kind in rows_from({}).items()} == COLUMNS


def test_detections_of_one_place_share_a_number_while_they_follow_each_other() -> None:
    box = np.array([10, 10, 30, 30], np.float32)
    frames = np.array([0, 0, 3, 30, 31], np.int32)
    boxes = np.array([box, box + 90, box + 3, box, box + 90])
    assert numbered(frames, boxes, 18).tolist() == [1, 2, 1, 3, 4]
    assert numbered(frames, boxes, 40).tolist() == [1, 2, 1, 1, 2]


def test_machines_that_draw_in_different_ways_are_named_once_each() -> None:
    jobs = [
        {"renderer": name} for name in ("CPU: avx2 kernels", "", "CPU: numpy kernels", "CPU: avx2 kernels")
    ]
    assert renderers_of(jobs) == "CPU: avx2 kernels and CPU: numpy kernels"
    assert renderers_of(jobs[1:2]) == ""
