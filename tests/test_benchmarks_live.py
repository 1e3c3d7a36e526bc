"""Benchmarks of the live application: figures are judged rightly."""

import sys
import threading
import time
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1]))  # the benchmarks are part of the checkout, not of the package

from benchmarks.live import runs, throughput
from guise.app.live.stats import PipelineStats


def test_without_a_virtual_display_one_sentence_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SystemExit) as ended, runs.display():
        pass
    assert ended.value.code == 2
    assert "install Xvfb" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="only Linux tells of threads")
def test_processor_time_is_told_by_threads() -> None:
    def turn() -> None:
        end = time.thread_time() + 0.05
        while time.thread_time() < end:
            pass
        spent.append(runs.used())

    spent: list[dict[str, float]] = []
    thread = threading.Thread(target=turn, name="guise-detector_0")
    thread.start()
    thread.join()
    assert 40 < spent[0]["search for others"] < spent[0]["all"]


def test_rates_and_latencies_are_medians_of_rounds_and_rates_stand_beside_decoding() -> None:
    rates = {
        ("640x480", way): [throughput.Rate(fps * k, 10.0) for k in (1.0, 0.1, 1.2)]
        for way, fps in {
            "nowhere": 70.0,
            "window": 50.0,
            throughput.FILE: 80.0,
            "decoded only": 700.0,
        }.items()
    }
    late = {
        "nowhere": [PipelineStats(latency=10.0, latency_95=ms) for ms in (40.0, 50.0, 20.0)],
        "window": [PipelineStats(latency=19.0, latency_95=33.0, dropped=2, skipped=1)],
    }
    report = throughput.report(rates, late)
    assert [(c.measured, c.met) for c in report.criteria[:2]] == [(70.0, True), (50.0, False)]
    assert report.tables[0].rows[0][-1] == pytest.approx(0.1)
    assert [(c.measured, c.met) for c in report.criteria[2:]] == [
        (10.0, True), (40.0, False), (19.0, True), (33.0, True), (10.0, False), (0.0, True), (0.8, True),
        (3.2, False),
    ]  # fmt: skip
    assert report.tables[1].rows[1] == ("window", 19.0, 33.0, 3)
