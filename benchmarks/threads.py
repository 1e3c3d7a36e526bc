"""One thread for figures that say so; imports nothing that starts threads."""

import os
import sys

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread(module: str) -> None:
    """Start this module anew with every library held to one thread, unless it already is."""
    if any(os.environ.get(name) != "1" for name in VARIABLES):
        os.environ.update(dict.fromkeys(VARIABLES, "1"))
        os.execv(sys.executable, [sys.executable, "-m", module, *sys.argv[1:]])
    import cv2

    cv2.setNumThreads(1)
