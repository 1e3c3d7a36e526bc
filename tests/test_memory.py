"""Memory goes back to the system."""

import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from guise.common.memory import given_back

PAGE = 4096


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE


@pytest.mark.skipif(sys.platform != "linux", reason="only glibc is told")
def test_pictures_of_many_threads_are_not_kept() -> None:
    def work() -> None:
        pictures = [np.ones(5_000_000, np.uint8) for _ in range(20)]
        del pictures[::2]

    before = resident()
    with given_back():
        threads = [threading.Thread(target=work) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert resident() - before < 40_000_000


def test_an_error_comes_through() -> None:
    with pytest.raises(KeyError), given_back():
        raise KeyError
