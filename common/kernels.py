"""The compiled kernels of `render/native/`, and their NumPy twins where none are built.

A twin is a function that is decorated with `kernel`: its name is the kernel's, and so is what it does.  Both are given
the same arrays and write their results into some of them, C-contiguous but for the first axis.  All instruction
sets give the same bytes; a kernel and its twin differ by at most 1/255 in a picture and 1e-3 pixels in places.

The environment's GUISE_KERNELS chooses: `numpy` for the twins, or one of the compiled sets, by default the best.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib import import_module
from typing import Any, TypeVar

from guise.common.errors import GuiseError

CHOICE = "GUISE_KERNELS"
NUMPY = "numpy"
F = TypeVar("F", bound=Callable[..., Any])

TWINS: dict[str, Callable[..., Any]] = {}


class KernelError(GuiseError):
    """A choice of kernels that this computer doesn't have."""


def _load() -> tuple[Any, str]:
    wanted = os.environ.get(CHOICE, "")
    try:
        module = None if wanted == NUMPY else import_module("guise.common._kernels")
    except ImportError:
        module = None
    names = [NUMPY] if module is None else module.sets()
    if wanted and wanted not in names:
        raise KernelError(f"{CHOICE} is {wanted!r}, but here only {', '.join([*names, NUMPY])} can be had")
    if module is None:
        return None, NUMPY
    module.use(wanted or names[0])
    return module, wanted or names[0]


COMPILED, RUNNING = _load()  # the module or None, and the name of the instruction set, or `numpy`


def kernel(twin: F) -> F:
    """The compiled function of a twin's name, or the twin."""
    TWINS[twin.__name__] = twin
    found: F = getattr(COMPILED, twin.__name__, twin)
    return found
