"""Enrols, and swaps frames of a clip in memory: the process that `benchmarks.frame_work` starts of each revision.

It imports nothing of the benchmarks, and of Guise only what other revisions have as well.
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import sys
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import guise
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.media import open_input
from guise.common.threads import one_thread

TOOL = ord("C") << 24 | ord("T") << 16  # of callgrind's requests
START, STOP = TOOL + 4, TOOL + 5


def save_model(clip: Path, model: Path) -> None:
    """Enrol the person of a clip with the landmarks beside it."""
    points = landmark_file(clip)
    enrol([clip], LandmarkSource(files=[points] if points else []), name=clip.stem).save(model)


def counter() -> Callable[[int], None]:
    """What tells callgrind to start or to stop counting; without it nothing happens.

    It is the macro VALGRIND_DO_CLIENT_REQUEST of valgrind.h on x86-64: turns of a register that leave it as it was,
    with the request in another.
    """
    page = mmap.mmap(-1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    page.write(bytes.fromhex("4889f8 31d2 48c1c703 48c1c70d 48c1c73d 48c1c733 4887db 4889d0 c3"))
    code = ctypes.c_char.from_buffer(page)  # which must outlive its use
    call = ctypes.CFUNCTYPE(ctypes.c_long, ctypes.c_void_p)(ctypes.addressof(code))

    def tell(request: int, code: object = code) -> None:
        given = (ctypes.c_ulong * 6)(request)
        call(ctypes.addressof(given))

    return tell


def swap_on_request(clip: Path, person: Path, donor: Path, count: int) -> None:
    """Decode so many frames; for each number read, swap as many more of them and print seconds of the processor.

    Callgrind counts from the second number on.
    """
    tell = counter() if platform.machine() == "x86_64" else lambda request: None
    with guise.Swapper(donor, person, renderer="cpu") as swapper, open_input(clip) as media:
        frames = iter(list(islice(media, count)))
        print("ready", flush=True)
        with one_thread():
            for number, line in enumerate(sys.stdin):
                part = list(islice(frames, int(line)))
                start = time.process_time()
                if number:
                    tell(START)
                for frame in part:
                    swapper._engine.swap(frame)
                tell(STOP)
                print(time.process_time() - start, flush=True)


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:4]]
    if len(sys.argv) == 3:
        save_model(files[0], files[1])
    else:
        swap_on_request(files[0], files[1], files[2], int(sys.argv[4]))
