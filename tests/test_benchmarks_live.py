"""Benchmarks of the live application: figures are judged rightly."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.live import throughput
from guise.app.live.stats import PipelineStats


def test_rates_and_latencies_are_medians_of_rounds_and_rates_stand_beside_decoding() -> None:
    rates = {
        ("640x480", way): [throughput.Rate(fps * k, 10.0) for k in (1.0, 0.1, 1.2)]
        for way, fps in {"nowhere": 70.0, "window": 50.0, "decoded only": 700.0}.items()
    }
    late = {
        "nowhere": [PipelineStats(latency=10.0, latency_95=ms) for ms in (40.0, 50.0, 20.0)],
        "window": [PipelineStats(latency=19.0, latency_95=33.0, dropped=2, skipped=1)],
    }
    report = throughput.report(rates, late)
    assert [(c.measured, c.met) for c in report.criteria[:2]] == [(70.0, True), (50.0, False)]
    assert report.tables[0].rows[0][-1] == pytest.approx(0.1)
    assert [(c.measured, c.met) for c in report.criteria[2:]] == [
        (10.0, True), (40.0, False), (19.0, True), (33.0, True),
    ]  # fmt: skip
    assert report.tables[1].rows[1] == ("window", 19.0, 33.0, 3)
