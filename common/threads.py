"""One thread for small matrix work, so that the decoder and the encoder have the other cores.

The products of a frame and of a tracker's training are small: OpenBLAS loses more in waiting for its second thread
than it wins, many times over when the cores are busy (a matrix-vector product of 75,000 x 17: 0.5 ms alone, 7 to
13 ms beside an encoder; an enrolment: 3.9 s of processor time, or 9.3 s).
"""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np

_NAMES = [
    f"{prefix}_{{}}_num_threads{suffix}"
    for prefix in ("scipy_openblas", "openblas")
    for suffix in ("64_", "")
]


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Inside, OpenCV and the OpenBLAS of NumPy and, once imported, of SciPy use one thread; another BLAS is left."""
    in_opencv = cv2.getNumThreads()
    in_blas = [(library, name, int(getattr(library, name.format("get"))())) for library, name in _libraries()]
    cv2.setNumThreads(1)
    for library, name, _ in in_blas:
        getattr(library, name.format("set"))(1)
    try:
        yield
    finally:
        cv2.setNumThreads(in_opencv)
        for library, name, count in in_blas:
            getattr(library, name.format("set"))(count)


def _libraries() -> list[tuple[ctypes.CDLL, str]]:
    found = [
        _openblas(_folder(np)),
        _openblas(_folder(sys.modules["scipy"])) if "scipy" in sys.modules else None,
    ]
    return [library for library in found if library is not None]


def _folder(package: ModuleType) -> Path:
    """Where a wheel keeps the libraries of a package."""
    home = Path(str(package.__file__)).parent
    return home / ".dylibs" if (home / ".dylibs").is_dir() else home.with_name(f"{home.name}.libs")


@cache
def _openblas(folder: Path) -> tuple[ctypes.CDLL, str] | None:
    """The OpenBLAS in a folder, with the pattern of its functions' names, or None."""
    for file in sorted(folder.glob("*openblas*")) if folder.is_dir() else ():
        with contextlib.suppress(OSError):
            library = ctypes.CDLL(str(file))
            for name in _NAMES:
                if hasattr(library, name.format("set")):
                    return library, name
    return None
