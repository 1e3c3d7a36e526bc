"""What one process of a test run makes and the others use."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

FOLDER = Path(os.environ["GUISE_TEST_RUN"])  # made and removed by conftest.py


def once(name: str, make: Callable[[Path], object]) -> Path:
    """The file or folder of that name: made by who comes first in this test run, while the others wait.

    make : writes it at the path that it is given.
    """
    path = FOLDER / name
    with (FOLDER / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            part = FOLDER / f"part-{name}"
            make(part)
            part.rename(path)
    return path
