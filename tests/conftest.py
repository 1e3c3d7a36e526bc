"""Tests marked `egl` need a GL context: without one they are skipped, or fail if GUISE_REQUIRE_EGL=1.

Those marked `slow` take more than a blink of processor time; `make test-fast` leaves them out, and each run names the
tests that should be marked and are not.  The files with most of them run first: one that came last would keep a single
core busy.
"""

import gc
import os
import resource
import shutil
import signal
import sys
import tempfile
import threading
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path

import pytest

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the program; read when NumPy is imported
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["GUISE_TEST_RUN"] = tempfile.mkdtemp(prefix="guise-tests-")  # of all workers, see once.py
os.environ["GUISE_PEOPLE"] = tempfile.mkdtemp(dir=os.environ["GUISE_TEST_RUN"])  # never the user's own
os.environ["GUISE_SETTINGS"] = tempfile.mkdtemp(dir=os.environ["GUISE_TEST_RUN"])

import numpy as np
from hypothesis import settings
from made_up import SAMPLES

from guise.aam.model import Identity

SLOW_SECONDS = 2.0  # of processor time, on a busy machine as well
TOOK = "processor seconds"

gc.disable()  # until all tests are collected
settings.register_profile("default", deadline=None, max_examples=50)
settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True, print_blob=True)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


def pytest_configure(config: pytest.Config) -> None:
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in a shell's background
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.addinivalue_line("markers", "slow: takes more than half a second of processor time")
    config.addinivalue_line("markers", "egl: needs an EGL context (GUISE_REQUIRE_EGL=1: fail without one)")


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ["GUISE_TEST_RUN"], ignore_errors=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: (-slow[item.path], item.path))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Note how long a test took that should not be slow."""
    before = processor_seconds()
    yield
    if item.get_closest_marker("slow") is None and (took := processor_seconds() - before) > SLOW_SECONDS:
        item.user_properties.append((TOOK, took))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    reports = [report for kind in ("passed", "failed") for report in terminalreporter.stats.get(kind, [])]
    seconds = {report.nodeid: dict(report.user_properties).get(TOOK, 0.0) for report in reports}
    if found := sorted((name for name in seconds if seconds[name]), key=lambda name: -seconds[name]):
        terminalreporter.section("slow tests that are not marked slow")
        for name in found:
            terminalreporter.write_line(f"{seconds[name]:.1f} s of processor time: {name}")


def processor_seconds() -> float:
    """Of this process and of those that it has started and that have ended."""
    spent = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in spent)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("egl") is None or not (reason := _why_no_gl()):
        return
    if os.environ.get("GUISE_REQUIRE_EGL") == "1":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def pytest_collection_finish() -> None:
    """What has been collected stays to the end: no garbage collection need look through it again."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """A browser is open from one test module to the next, but not beside tests that need none."""
    if "studio_browser" in sys.modules and "browser" not in getattr(nextitem, "fixturenames", ()):
        sys.modules["studio_browser"].close_browser()


@cache
def _why_no_gl() -> str:
    from guise.render import GLMissing, probe_gl

    found = probe_gl()
    return found.reason if isinstance(found, GLMissing) else ""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, so that messages hold short names."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def no_thread_left() -> Iterator[None]:
    """The test must end with no thread more than there were (an earlier test's library may have left some)."""
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) <= before


@pytest.fixture(scope="session")
def p01() -> Identity:
    """The first sample person, enrolled on a few frames of the first clip with a small tracker."""
    from models import enrolled

    return Identity.load(enrolled("p01", 96))


@pytest.fixture
def quick_training(monkeypatch: pytest.MonkeyPatch) -> None:
    """People who are learned without options get a tracker trained on less: where it matters only that they are."""
    from guise.aam.tracker_training import TrackerOptions

    less = {"stages": 2, "copies": 4, "folds": 2}
    defaults = tuple(less.get(option.name, option.default) for option in fields(TrackerOptions))
    monkeypatch.setattr(TrackerOptions.__init__, "__defaults__", defaults)


@pytest.fixture(scope="session")
def talk2() -> tuple[list[np.ndarray], np.ndarray]:
    """Every second frame of the first person's second clip: luma (h, w) uint8, and the true landmarks."""
    from guise.app.media import open_input

    with open_input(SAMPLES / "p01" / "talk2.mp4") as source:
        luma = [frame.luma.copy() for frame in source if frame.index % 2 == 0]
    truth = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][::2].astype(float)
    return luma, truth
