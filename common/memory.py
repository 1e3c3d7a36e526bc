"""Memory returned to the system, so that a long run of many stages stays as small as its largest stage.

The allocator of glibc raises its threshold to the size of the pictures it serves, keeps these in a heap for each
thread, and hardly ever returns those.  Other systems are not affected.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8  # of mallopt, malloc.h
_RETURNED_BYTES = 1 << 22  # size from which freed memory is returned to the system
_MAX_HEAPS = 2


def one_heap() -> None:
    """Let the threads that are made from now on share one heap: what one of them frees serves the others."""
    _set(_ARENA_MAX, 1)


def _set(parameter: int, value: int) -> ctypes.CDLL | None:
    """The C library, whose allocator has been given a parameter; None if it is not glibc."""
    if sys.platform != "linux":
        return None
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL("libc.so.6")
        library.mallopt(parameter, value)
        return library
    return None


@cache
def _glibc() -> ctypes.CDLL | None:
    """The C library, configured to return large blocks; None if it is not glibc."""
    _set(_ARENA_MAX, _MAX_HEAPS)
    return _set(_MMAP_THRESHOLD, _RETURNED_BYTES)


def free_bytes() -> int:
    """Memory that processes may still take without swapping; as much as there is where the system doesn't say."""
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            name, _, amount = line.partition(":")
            if name == "MemAvailable":
                return 1024 * int(amount.split()[0])
    return sys.maxsize


@contextlib.contextmanager
def given_back() -> Iterator[None]:
    """Return the memory that is freed inside to the system, and what unused cycles hold, such as PyAV's frames.

    Cycles are few and are hardly ever looked for, and a frame of 1080p has 3 MB.
    """
    library = _glibc()
    try:
        yield
    finally:
        gc.collect()
        if library is not None:
            library.malloc_trim(0)
