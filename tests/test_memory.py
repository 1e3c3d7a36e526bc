"""Memory goes back to the system."""

import subprocess
import sys
import threading
import weakref
from pathlib import Path

import av
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


HEAPS = """
import ctypes, sys, threading
from guise.common.memory import one_heap

if sys.argv[1] == "one":
    one_heap()
libc, together = ctypes.CDLL("libc.so.6"), threading.Barrier(4)
libc.fdopen.restype, libc.malloc.restype = ctypes.c_void_p, ctypes.c_void_p

def work():
    together.wait()
    libc.malloc(ctypes.c_size_t(1000))
    together.wait()

threads = [threading.Thread(target=work) for _ in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
stream = ctypes.c_void_p(libc.fdopen(1, b"w"))
libc.malloc_info(0, stream)
libc.fflush(stream)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only glibc is told")
@pytest.mark.parametrize("heaps", ["one", "several"])
def test_threads_share_one_heap_if_told(heaps: str) -> None:
    told = subprocess.run([sys.executable, "-c", HEAPS, heaps], capture_output=True, text=True, check=True)
    assert (told.stdout.count("<heap nr=") == 1) == (heaps == "one")


def test_what_unused_cycles_hold_is_let_go() -> None:
    held = av.VideoFrame(16, 16, "yuv420p")
    with given_back():
        assert not held.side_data  # which refers to the frame that refers to it
        gone = weakref.ref(held.side_data)
        del held
    assert gone() is None


def test_an_error_comes_through() -> None:
    with pytest.raises(KeyError), given_back():
        raise KeyError
