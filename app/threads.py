"""One thread for the work on a frame, so that the decoder and the encoder have the other cores.

The products of a frame are small: OpenBLAS loses more in waiting for its second thread than it wins, many times over
when the cores are busy (a matrix-vector product of 75,000 x 17: 0.7 ms alone, 7-13 ms beside an encoder).
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import cv2
import numpy as np

_SUFFIXES = ("64_", "")
_PREFIXES = ("scipy_openblas", "openblas")


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Inside, OpenCV and NumPy's own OpenBLAS use one thread; where NumPy has another BLAS it stays as it is."""
    in_opencv, in_blas = cv2.getNumThreads(), _get_blas_threads()
    cv2.setNumThreads(1)
    _set_blas_threads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(in_opencv)
        _set_blas_threads(in_blas)


def _get_blas_threads() -> int:
    found = _openblas()
    return int(getattr(found[0], f"{found[1]}_get_num_threads{found[2]}")()) if found else 1


def _set_blas_threads(count: int) -> None:
    if found := _openblas():
        getattr(found[0], f"{found[1]}_set_num_threads{found[2]}")(count)


@cache
def _openblas() -> tuple[ctypes.CDLL, str, str] | None:
    """The OpenBLAS inside NumPy's wheel with the prefix and suffix of its names, or None."""
    package = Path(np.__file__).parent
    for folder in (package.with_name("numpy.libs"), package / ".dylibs"):
        for file in sorted(folder.glob("*openblas*")) if folder.is_dir() else ():
            with contextlib.suppress(OSError):
                library = ctypes.CDLL(str(file))
                for prefix in _PREFIXES:
                    for suffix in _SUFFIXES:
                        if hasattr(library, f"{prefix}_set_num_threads{suffix}"):
                            return library, prefix, suffix
    return None
