"""One thread for small matrix work, so that the decoder and the encoder get the other cores.

The products of a frame and of a tracker's training are small: OpenBLAS loses more in waiting for its second thread
than it gains, many times over when the cores are busy (a matrix-vector product of 75,000 x 17: 0.5 ms alone, 7 to
13 ms beside an encoder; an enrolment: 3.9 s of processor time, or 9.3 s).
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from functools import cache

import cv2
from threadpoolctl import ThreadpoolController


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Inside, OpenCV and the BLAS libraries of NumPy and, once imported, of `scipy.linalg` use one thread."""
    in_opencv = cv2.getNumThreads()
    cv2.setNumThreads(1)
    blas = _blas("scipy.linalg._fblas" in sys.modules)
    alone = max([library.get_num_threads() for library in blas.lib_controllers], default=1) == 1
    try:
        with contextlib.nullcontext() if alone else blas.limit(limits=1):
            yield
    finally:
        cv2.setNumThreads(in_opencv)


@cache
def _blas(scipy: bool) -> ThreadpoolController:
    """The libraries loaded so far, with SciPy's or without: looking for them takes 35 ms."""
    return ThreadpoolController().select(user_api="blas")
