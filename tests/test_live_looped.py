"""A clip that is played again and again: times go on, and nothing of a pass is left when it has ended."""

import sys
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pytest

from guise.app.live.capture import FileCapture

LENGTH = 5


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A video of LENGTH pictures, each brighter than the one before."""
    path = tmp_path / "clip.mp4"
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", 30)
        video.width, video.height = 64, 48
        for index in range(LENGTH):
            grey = np.full((48, 64, 3), 40 * index, np.uint8)
            out.mux(video.encode(av.VideoFrame.from_ndarray(grey, "rgb24")))
        out.mux(video.encode(None))
    return path


def test_times_go_on_and_pictures_begin_again(clip: Path) -> None:
    with FileCapture(clip, loop=True, paced=False) as capture:
        seen = [(frame.pts * frame.time_base, frame.luma.mean()) for frame in islice(capture, 3 * LENGTH)]
    steps = np.diff([float(time) for time, _ in seen])
    np.testing.assert_allclose(steps, 1 / 30)
    brightness = np.array([mean for _, mean in seen]).reshape(3, LENGTH)
    assert (np.diff(brightness, axis=1) > 10).all()
    np.testing.assert_array_equal(brightness[1:], brightness[:2])


def test_without_a_loop_it_ends(clip: Path) -> None:
    with FileCapture(clip, paced=False) as capture:
        assert len(list(capture)) == LENGTH


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="open files are counted in /proc")
def test_a_pass_that_has_ended_is_closed(clip: Path) -> None:
    with FileCapture(clip, loop=True, paced=False) as capture:
        frames, counts = iter(capture), []
        for _ in range(6):
            list(islice(frames, LENGTH))
            counts.append(times_open(clip))
    assert max(counts[2:]) <= counts[1]
    assert times_open(clip) == 0


def times_open(path: Path) -> int:
    """How often this process has a file open."""
    entries = list(Path("/proc/self/fd").iterdir())
    return sum(entry.is_symlink() and entry.readlink() == path for entry in entries)
