"""A clock burnt into frames: a row of black and white cells that encodes the time, and a watcher that reads it.

The time is in microseconds of `time.perf_counter`, which on Linux is the same for all processes, and repeats after
some 16 s; a checksum beside it distinguishes it from anything else.  Run as a script it watches a display's file (XWD)
and prints when each code was first seen, in seconds, and its age in milliseconds, until no new code comes any more.
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
CELL_HEIGHT_PIXELS = 8
WHITE, BLACK, GREY = 235, 16, 128
DISPLAY_POLL_SECONDS = 0.0005  # between two reads of a display
WATCH_TIMEOUT_SECONDS = 5.0  # without a new code, after which the watcher ends
XWD_FIELDS = 25


def now() -> int:
    """Microseconds, modulo 2**BITS."""
    return round(1e6 * time.perf_counter()) % (1 << BITS)


def passed(code: int, at: int) -> float:
    """Milliseconds from one time to a later one."""
    return ((at - code) % (1 << BITS)) / 1e3


def burn(frame: Frame, code: int) -> None:
    """Write a time over the lowest rows of a frame, in its full width."""
    word = (code << CHECK) | _check(code)
    bits = np.array([(word >> k) & 1 for k in range(CELLS)], bool)
    columns = np.arange(frame.width) * CELLS // frame.width
    strip = np.full((CELL_HEIGHT_PIXELS, frame.width, 3), GREY, np.uint8)
    strip[..., 0] = np.where(bits[columns], WHITE, BLACK)
    frame.write_roi(0, frame.height - CELL_HEIGHT_PIXELS, strip)


def read(grey: NDArray[np.uint8]) -> int | None:
    """The time in a picture (h, w), or None when there is none."""
    height, width = grey.shape
    middles = (2 * np.arange(CELLS) + 1) * width // (2 * CELLS)
    bits = grey[height - CELL_HEIGHT_PIXELS // 2, middles] > GREY
    word = int((bits.astype(np.uint64) << np.arange(CELLS, dtype=np.uint64)).sum())
    code = word >> CHECK
    return code if word & ((1 << CHECK) - 1) == _check(code) else None


def _check(code: int) -> int:
    """CHECK bits of checksum; all black and all white are not valid codes."""
    return (code * 0x9E3779B1 >> 16 & 0xFF) ^ 0xA5


def watch(file: Path, width: int, height: int) -> None:
    """Print time and delay of each new code in the left upper corner (w, h) of a display, until there are no more."""
    with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as memory:
        screen = screen_of(memory)
        last, at = None, time.perf_counter()
        while time.perf_counter() - at < WATCH_TIMEOUT_SECONDS:
            code = read(screen[:height, :width, 1])
            if code is not None and code != last:
                last, at = code, time.perf_counter()
                print(f"{at:.3f} {passed(code, now()):.2f}", flush=True)
            time.sleep(DISPLAY_POLL_SECONDS)
        del screen


def screen_of(memory: mmap.mmap | bytes) -> NDArray[np.uint8]:
    """A live view (h, w, 4) BGRX of the pixels of a screen in XWD format."""
    header = np.frombuffer(memory, ">u4", XWD_FIELDS).astype(int)
    size, width, height, line, colours = header[[0, 4, 5, 12, 19]]
    pixels = np.frombuffer(memory, np.uint8, height * line, size + 12 * colours)
    return pixels.reshape(height, line // 4, 4)[:, :width]


if __name__ == "__main__":
    watch(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
