"""Videos as browsers record them: WebM with a clock of milliseconds, frames as they came, and no rate said."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from guise.app.media import open_input

TICK = Fraction(1, 1000)


def record(path: Path, times: list[int]) -> Path:
    """A recording with frames at these milliseconds."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libvpx", 1000, {"deadline": "realtime"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for time in times:
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), time % 250, np.uint8), "rgb24")
            frame.pts, frame.time_base = time, TICK
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


@pytest.mark.parametrize("step", [33, 100])
@pytest.mark.slow
def test_the_rate_is_that_of_the_frames_not_of_the_clock(tmp_path: Path, step: int) -> None:
    times = [step * i + i % 3 for i in range(90)]
    with open_input(record(tmp_path / "recording.webm", times)) as source:
        assert float(source.frame_rate) == pytest.approx(1000 / step, rel=0.01)
        assert source.frame_count == pytest.approx(90, abs=2)
        assert [round(1000 * frame.pts * frame.time_base) for frame in source] == times


def test_a_single_frame_has_a_rate(tmp_path: Path) -> None:
    with open_input(record(tmp_path / "recording.webm", [0])) as source:
        assert 0 < source.frame_rate < 100
