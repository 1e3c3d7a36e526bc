"""Memory given back to the system, so that a long run of many stages stays as small as its largest.

The allocator of glibc raises its threshold to the size of the pictures that it sees, keeps them in a heap for each
thread, and hardly ever gives those back.  Other systems are left as they are.
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Iterator
from functools import cache

_MMAP_THRESHOLD, _ARENA_MAX = -3, -8  # of mallopt, malloc.h
_LARGE = 1 << 20  # bytes, from which memory is the system's own again when it is freed
_HEAPS = 2


@cache
def _glibc() -> ctypes.CDLL | None:
    """The C library, told to give large pieces back; None where it is another one."""
    if sys.platform != "linux":
        return None
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL("libc.so.6")
        library.mallopt(_MMAP_THRESHOLD, _LARGE)
        library.mallopt(_ARENA_MAX, _HEAPS)
        return library
    return None


@contextlib.contextmanager
def given_back() -> Iterator[None]:
    """What is freed inside goes back to the system."""
    library = _glibc()
    try:
        yield
    finally:
        if library is not None:
            library.malloc_trim(0)
