"""Tests marked `egl` need a GL context: without one they are skipped, or fail if GUISE_REQUIRE_EGL=1."""

import os
from functools import cache

import pytest


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "egl: needs an EGL context (GUISE_REQUIRE_EGL=1: fail without one)")


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("egl") is None or not (reason := _why_no_gl()):
        return
    if os.environ.get("GUISE_REQUIRE_EGL") == "1":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@cache
def _why_no_gl() -> str:
    from render import GLMissing, probe_gl

    found = probe_gl()
    return found.reason if isinstance(found, GLMissing) else ""
