"""One thread for small matrix work, so that the decoder and the encoder get the other cores.

The products of a frame and of a tracker's training are small: OpenBLAS loses more in waiting for its second thread
than it gains, many times over when the cores are busy (a matrix-vector product of 75,000 x 17: 0.5 ms alone, 7 to
13 ms beside an encoder; an enrolment: 3.9 s of processor time, or 9.3 s).
"""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

import cv2
from threadpoolctl import ThreadpoolController


class one_thread:  # called as a function, as those of contextlib
    """Inside, OpenCV and the BLAS libraries of NumPy and, once imported, of `scipy.linalg` use one thread."""

    def __enter__(self) -> None:
        self._in_opencv = cv2.getNumThreads()
        self._before: list[tuple[Any, int]] = []
        cv2.setNumThreads(1)
        for library in _blas("scipy.linalg._fblas" in sys.modules):
            count = library.get_num_threads()
            if count != 1:
                self._before.append((library, count))
                library.set_num_threads(1)

    def __exit__(self, *error: object) -> None:
        for library, count in self._before:
            library.set_num_threads(count)
        cv2.setNumThreads(self._in_opencv)


@cache
def _blas(scipy: bool) -> list[Any]:
    """The libraries loaded so far, with SciPy's or without: looking for them takes 35 ms."""
    return list(ThreadpoolController().select(user_api="blas").lib_controllers)
