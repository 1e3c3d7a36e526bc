"""The sound of live recordings: in time with the pictures, whatever the connection does to it."""

from pathlib import Path

import av
import numpy as np
import pytest

from guise.app.live.face import FaceResult
from guise.app.live.microphone import KEPT_SECONDS, Microphone
from guise.app.live.output import OutputFrame
from guise.app.live.recorder import VideoRecorder
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame
from guise.app.media.audio_reader import SAMPLE_RATE
from guise.app.media.sound_track import in_time

BLOCK = SAMPLE_RATE // 50


class Clock:
    """A clock that a test sets."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


def sound(count: int = BLOCK, value: float = 0.5) -> np.ndarray:
    return np.full((count, 2), value, np.float32)


def test_blocks_have_the_times_of_the_promptest_whatever_the_others_took() -> None:
    clock = Clock()
    microphone = Microphone(clock)
    late = np.random.default_rng(0).uniform(0, 0.2, 200)
    late[100] = 0.0
    for k, delay in enumerate(late):
        clock.now = 100.0 + (k + 1) / 50 + delay
        microphone.put(777 + k * BLOCK, sound())
    times = np.array([at for at, _ in microphone.take()])
    np.testing.assert_allclose(np.diff(times)[-50:], 0.02, atol=1e-9)
    assert times[-1] == pytest.approx(100.0 + 199 / 50)


def test_sound_that_nobody_takes_is_forgotten_and_what_is_taken_is_gone() -> None:
    clock = Clock()
    microphone = Microphone(clock)
    for k in range(500):
        clock.now = 100.0 + (k + 1) / 50
        microphone.put(k * BLOCK, sound())
    assert microphone.is_on
    assert len(microphone.take()) == pytest.approx(50 * KEPT_SECONDS, abs=2)
    assert microphone.take() == []
    clock.now += 2 * KEPT_SECONDS
    assert not microphone.is_on


def test_a_sender_that_begins_anew_has_its_own_clock() -> None:
    clock = Clock()
    microphone = Microphone(clock)
    for begun in (100.0, 107.0):
        for k in range(3):
            clock.now = begun + (k + 1) / 50
            microphone.put(k * BLOCK, sound())
    assert microphone.take()[-1][0] == pytest.approx(107.0 + 2 / 50)


@pytest.mark.parametrize(
    ("at", "length", "silent"),
    [(1.0, 960, 0), (1.04, 960, 0), (1.1, 960 + 4800, 4800), (0.99, 960, 0), (0.9, 0, 0)],
)
def test_gaps_are_silent_and_what_overlaps_is_left_out(at: float, length: int, silent: int) -> None:
    block = in_time(sound(), at, 1.0, 0.06)
    assert len(block) == length
    assert not block[:silent].any()
    assert block[silent:].all()


def record(path: Path, microphone: Microphone | None, clock: Clock) -> None:
    """Two seconds of grey, with a beep of the microphone's at 1.0 s, of which a block is lost."""
    recorder = VideoRecorder(path, microphone=microphone)
    frame = Frame.from_rgb(np.full((48, 64, 3), 99, np.uint8))
    if microphone is not None:
        microphone.put(0, sound(value=0))
    recorder.open(64, 48, 25.0)
    for k in range(50):
        for half in range(2):
            clock.now = 100.0 + k / 25 + half / 50 + 0.02
            if microphone is not None and 2 * k + half != 20:
                microphone.put((2 * k + half + 1) * BLOCK, sound(value=0.5 if k >= 25 else 0.0))
        recorder.show(OutputFrame(frame, FaceResult("off"), PipelineStats(), 100.0 + k / 25))
    recorder.close()


def test_a_recording_has_the_sound_at_its_time(tmp_path: Path) -> None:
    clock = Clock()
    record(tmp_path / "film.mp4", Microphone(clock), clock)
    with av.open(str(tmp_path / "film.mp4")) as container:
        assert len(container.streams.audio) == 1
        frames = list(container.decode(audio=0))
    start = float(frames[0].time or 0)
    samples = np.concatenate([frame.to_ndarray()[0] for frame in frames])
    loud = np.abs(samples) > 0.25
    assert start + loud.argmax() / SAMPLE_RATE == pytest.approx(1.0, abs=0.03)
    assert len(samples) / SAMPLE_RATE == pytest.approx(2.0, abs=0.06)


def test_a_recording_without_sound_has_no_track_for_it(tmp_path: Path) -> None:
    for microphone in (None, Microphone(Clock())):
        path = tmp_path / f"{microphone is None}.mp4"
        recorder = VideoRecorder(path, microphone=microphone)
        recorder.open(64, 48, 25.0)
        frame = Frame.from_rgb(np.full((48, 64, 3), 99, np.uint8))
        recorder.show(OutputFrame(frame, FaceResult("off"), PipelineStats(), 100.0))
        recorder.close()
        with av.open(str(path)) as container:
            assert not container.streams.audio
            assert len(list(container.decode(video=0))) == 1
