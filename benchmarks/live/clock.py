"""A clock burnt into pictures: a row of black and white cells that codes the time, and a watcher that reads it.

The time is in microseconds of `time.perf_counter`, which on Linux is the same for all processes, and repeats after
some 16 s; a check beside it tells it from anything else.  Run as a script it watches a display's file (XWD) and prints
when each code was first seen, in seconds, and how many milliseconds had passed, until no new code comes any more.
"""

from __future__ import annotations

import mmap
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from guise.app.media import Frame

BITS, CHECK = 24, 8
CELLS = BITS + CHECK
HIGH = 8  # pixels of a cell
WHITE, BLACK, GREY = 235, 16, 128
EVERY = 0.0005  # seconds between two looks at a display
PATIENCE = 5.0  # seconds without a new code after which the watcher ends
XWD_FIELDS = 25


def now() -> int:
    """Microseconds, BITS of them."""
    return round(1e6 * time.perf_counter()) % (1 << BITS)


def passed(code: int, at: int) -> float:
    """Milliseconds from one time to a later one."""
    return ((at - code) % (1 << BITS)) / 1e3


def burn(frame: Frame, code: int) -> None:
    """Write a time over the lowest rows of a picture, as wide as it is."""
    word = (code << CHECK) | _check(code)
    bits = np.array([(word >> k) & 1 for k in range(CELLS)], bool)
    columns = np.arange(frame.width) * CELLS // frame.width
    strip = np.full((HIGH, frame.width, 3), GREY, np.uint8)
    strip[..., 0] = np.where(bits[columns], WHITE, BLACK)
    frame.write_roi(0, frame.height - HIGH, strip)


def read(grey: NDArray[np.uint8]) -> int | None:
    """The time in a picture (h, w), or None when there is none."""
    height, width = grey.shape
    middles = (2 * np.arange(CELLS) + 1) * width // (2 * CELLS)
    bits = grey[height - HIGH // 2, middles] > GREY
    word = int((bits.astype(np.uint64) << np.arange(CELLS, dtype=np.uint64)).sum())
    code = word >> CHECK
    return code if word & ((1 << CHECK) - 1) == _check(code) else None


def _check(code: int) -> int:
    """CHECK bits that a code has beside it; black throughout and white throughout are no codes."""
    return (code * 0x9E3779B1 >> 16 & 0xFF) ^ 0xA5


def watch(file: Path, width: int, height: int) -> None:
    """Print time and delay of each new code in the left upper corner (w, h) of a display, until there are no more."""
    with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as memory:
        screen = screen_of(memory)
        last, at = None, time.perf_counter()
        while time.perf_counter() - at < PATIENCE:
            code = read(screen[:height, :width, 1])
            if code is not None and code != last:
                last, at = code, time.perf_counter()
                print(f"{at:.3f} {passed(code, now()):.2f}", flush=True)
            time.sleep(EVERY)
        del screen


def screen_of(memory: mmap.mmap | bytes) -> NDArray[np.uint8]:
    """The pixels (h, w, 4) BGRX of a screen in XWD format, as they are at any time."""
    header = np.frombuffer(memory, ">u4", XWD_FIELDS).astype(int)
    size, width, height, line, colours = header[[0, 4, 5, 12, 19]]
    pixels = np.frombuffer(memory, np.uint8, height * line, size + 12 * colours)
    return pixels.reshape(height, line // 4, 4)[:, :width]


if __name__ == "__main__":
    watch(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
