"""Benchmarks of the live application: the clock in the pictures is read rightly, and figures are judged rightly."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.live import clock, latency, soak, throughput
from benchmarks.live.runs import SAMPLES
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame, open_input


def first_frame() -> Frame:
    with open_input(SAMPLES / "p01" / "talk.mp4") as source:
        return next(iter(source))


@pytest.mark.parametrize("code", [0, 1, 123_456, (1 << clock.BITS) - 1])
def test_a_burnt_time_is_read_back_from_planes_and_from_rgb(code: int) -> None:
    frame = first_frame()
    clock.burn(frame, code)
    assert clock.read(frame.luma) == code
    assert clock.read(np.ascontiguousarray(frame.rgb()[..., 1])) == code


def test_a_picture_without_a_clock_has_no_time() -> None:
    frame = first_frame()
    assert clock.read(frame.luma) is None
    for level in (0, 255):
        assert clock.read(np.full((480, 640), level, np.uint8)) is None


def test_a_time_that_was_only_half_drawn_is_none() -> None:
    codes = [round(33_333.3 * n) for n in range(400)]
    halves = 0
    for one, two in pairwise(codes):
        frames = [Frame.from_rgb(np.zeros((16, 320, 3), np.uint8)) for _ in range(2)]
        for frame, code in zip(frames, (one, two), strict=True):
            clock.burn(frame, code)
        torn = np.hstack([frames[0].luma[:, :160], frames[1].luma[:, 160:]])
        halves += clock.read(torn) not in (None, one, two)
    assert halves <= len(codes) * 4 // (1 << clock.CHECK)


def test_time_passes_over_the_end_of_the_clock() -> None:
    assert clock.passed(100, 5100) == 5.0
    assert clock.passed((1 << clock.BITS) - 1000, 4000) == 5.0


def test_the_screen_is_read_from_its_header_on() -> None:
    width, height, colours = 6, 4, 3
    header = np.zeros(clock.XWD_FIELDS, ">u4")
    header[[0, 4, 5, 12, 19]] = 128, width, height, 4 * (width + 2), colours
    pixels = np.arange(height * (width + 2) * 4, dtype=np.uint8)
    padding = bytes(128 - header.nbytes + 12 * colours)
    screen = clock.screen_of(header.tobytes() + padding + pixels.tobytes())
    assert (screen == pixels.reshape(height, width + 2, 4)[:, :width]).all()


def samples(memory: float = 0.0, late: float = 0.0, threads: float = 0.0) -> list[soak.Sample]:
    """Ten minutes in which things grow evenly by so much."""
    shares = np.linspace(0, 1, 600)
    return [
        soak.Sample(600 * s, 300 * (1 + memory * s), round(6 + threads * s), 5 + late * s) for s in shares
    ]


def met(*given: object) -> list[bool]:
    return [criterion.met for criterion in soak.report(*given, PipelineStats()).criteria]


def test_what_grows_is_told_and_what_does_not_is_not() -> None:
    assert met(samples(), 0, 0.03) == [True] * 5
    assert met(samples(memory=0.1), 0, 0.0) == [False, True, True, True, True]
    assert met(samples(late=30.0), 0, 0.0) == [True, False, True, True, True]
    assert met(samples(), 0, -0.5) == [True, True, False, True, True]
    assert met(samples(threads=10), 0, 0.0) == [True, True, True, False, True]
    assert met(samples(), 1, 0.0) == [True, True, True, True, False]


def test_rates_are_medians_of_rounds_and_stand_beside_decoding() -> None:
    rates = {
        ("640x480", way): [throughput.Rate(fps * k, 10.0) for k in (1.0, 0.1, 1.2)]
        for way, fps in {"nowhere": 70.0, "window": 50.0, "decoded only": 700.0}.items()
    }
    report = throughput.report(rates)
    assert [(c.measured, c.met) for c in report.criteria] == [(70.0, True), (50.0, False)]
    assert report.tables[0].rows[0][-1] == pytest.approx(0.1)


def test_median_and_tail_of_the_latency_are_judged() -> None:
    delays = {"nowhere": [10.0] * 90 + [40.0] * 10, "window": [19.0] * 100}
    report = latency.report(delays, {"nowhere": 3, "window": 0})
    assert [c.met for c in report.criteria] == [True, False, True, True]


def test_what_was_seen_in_the_first_seconds_does_not_count_and_nothing_is_not_met() -> None:
    seen = np.array([[100.0, 90.0], [101.0, 80.0], [103.0, 12.0], [104.0, 14.0]])
    assert latency.after_warm_up(seen) == [12.0, 14.0]
    assert latency.after_warm_up(seen[:0]) == []
    report = latency.report({"window": []}, {"window": 600})
    assert not any(c.met for c in report.criteria)
