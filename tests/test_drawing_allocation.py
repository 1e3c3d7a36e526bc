"""Frame after frame in the same memory: none is taken from the system, none kept, no more for a larger picture."""

from __future__ import annotations

import json
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import SWAP
from guise.app.media import Frame, open_input
from guise.app.swapping.donors import open_donor

pytestmark = pytest.mark.slow

CLIP = SAMPLES / "p01" / "talk2.mp4"
WARM_UP, FRAMES = 12, 44
SETTLED = 10  # frames after which all buffers are there
PAGES = """
import json, resource, sys
from pathlib import Path
from guise.aam.model import Identity
from test_drawing_allocation import FRAMES, swapping

seen = []
for _ in swapping(Identity.load(Path(sys.argv[1]))):
    seen.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
    if len(seen) == FRAMES:
        break
print(json.dumps(seen))
"""


def engine_of(person: Identity) -> Engine:
    return Engine(person, Donor.of(open_donor("p02")), BuiltinLandmarker(), replace(SWAP, renderer="cpu"))


def swapping(person: Identity) -> Iterator[Frame]:
    """The frames of a clip, as each is swapped."""
    with open_input(CLIP) as media, engine_of(person) as engine:
        for frame in media:
            assert engine.swap(frame).outcome == "swapped"
            yield frame


@pytest.mark.skipif(sys.platform != "linux", reason="pages are counted by Linux")
def test_a_frame_takes_no_memory_from_the_system(p01: Identity, tmp_path: Path) -> None:
    p01.save(tmp_path / "p01.guise")
    printed = subprocess.run(
        [sys.executable, "-c", PAGES, str(tmp_path / "p01.guise")],
        cwd=Path(__file__).parent, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    pages = np.diff(json.loads(printed))[WARM_UP:]
    assert np.median(pages) < 32  # of 4 kB: less than any picture that is drawn
    assert pages.mean() < 100


def test_nothing_of_a_frame_is_kept(p01: Identity) -> None:
    held: list[int] = []
    for count, _ in enumerate(swapping(p01)):
        if count == WARM_UP:
            tracemalloc.start()
        elif count > WARM_UP:
            held.append(tracemalloc.get_traced_memory()[0])
        if count == FRAMES:
            break
    tracemalloc.stop()
    assert min(held[-10:]) - min(held[10:20]) < 100_000  # less than a picture


@pytest.fixture(scope="module")
def rgb() -> list[np.ndarray]:
    with open_input(CLIP) as media:
        return [frame.rgb() for frame in islice(media, SETTLED + 5)]


def most_taken(person: Identity, rgb: list[np.ndarray], border: int) -> float:
    """Bytes that a frame with a border of so many pixels takes at most while it is swapped, beside its luma."""
    taken = []
    with engine_of(person) as engine:
        for index, picture in enumerate(rgb):
            sides = ((border, border), (border, border), (0, 0))
            frame = Frame.from_rgb(np.pad(picture, sides, mode="edge"), index=index)
            assert frame.luma.size
            if index < SETTLED:
                engine.swap(frame)
                continue
            tracemalloc.start()
            assert engine.swap(frame).outcome == "swapped"
            taken.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    return float(np.median(taken))


def test_a_face_takes_no_more_in_a_larger_picture(p01: Identity, rgb: list[np.ndarray]) -> None:
    assert most_taken(p01, rgb, 500) < 1.1 * most_taken(p01, rgb, 0)
