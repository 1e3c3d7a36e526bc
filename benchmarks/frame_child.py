"""Enrols, and swaps frames of a clip in memory: the process that `benchmarks.frame_work` starts of each revision.

It imports nothing of the benchmarks, and of Guise only what other revisions have as well.
"""

from __future__ import annotations

import sys
import time
from itertools import islice
from pathlib import Path

import guise
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource, landmark_file
from guise.app.media import open_input
from guise.common.threads import one_thread


def save_model(clip: Path, model: Path) -> None:
    """Enrol the person of a clip with the landmarks beside it."""
    points = landmark_file(clip)
    enrol([clip], LandmarkSource(files=[points] if points else []), name=clip.stem).save(model)


def swap_on_request(clip: Path, person: Path, donor: Path, count: int) -> None:
    """Decode so many frames; for each number read, swap as many more of them and print seconds of the processor."""
    with guise.Swapper(donor, person, renderer="cpu") as swapper, open_input(clip) as media:
        frames = iter(list(islice(media, count)))
        print("ready", flush=True)
        with one_thread():
            for line in sys.stdin:
                part = list(islice(frames, int(line)))
                start = time.process_time()
                for frame in part:
                    swapper._engine.swap(frame)
                print(time.process_time() - start, flush=True)


if __name__ == "__main__":
    files = [Path(name) for name in sys.argv[1:4]]
    if len(sys.argv) == 3:
        save_model(files[0], files[1])
    else:
        swap_on_request(files[0], files[1], files[2], int(sys.argv[4]))
