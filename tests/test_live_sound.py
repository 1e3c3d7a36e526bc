"""The sound of a file stays with its pictures, whatever the device's own clock does."""

from __future__ import annotations

import ctypes.util
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from clips import cut

from guise.app.live.face import FaceResult
from guise.app.live.output import OutputFrame
from guise.app.live.sound import SAMPLE_RATE, Fill, SoundError, SoundOutput, stretched
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame
from guise.app.media.audio_reader import AudioReader
from guise.app.media.input import VideoInput
from guise.common.closing import Closing

ROOT = Path(__file__).parents[1]
FPS = 25
BLOCK = 1024
OFF = 0.01  # seconds out of step that nobody notices; a frame lasts 0.04


def telling(path: Path, seconds: float, *, first: float = 0.0, rate: int = 8000) -> Path:
    """A file whose sound tells its time: the level is the share of `seconds` that has passed."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", FPS, {"preset": "ultrafast", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        voice = out.add_stream("pcm_f32le", rate, layout="stereo")
        step = rate // 10
        for number in range(round(seconds * 10)):
            levels = np.arange(number * step, (number + 1) * step, dtype=np.float32) / (rate * seconds)
            block = av.AudioFrame.from_ndarray(levels.repeat(2)[None], "flt", "stereo")
            block.sample_rate, block.pts = rate, number * step
            out.mux(voice.encode(block))
            if number % 10 == 0:  # pictures are of no account here
                frame = av.VideoFrame.from_ndarray(np.zeros((32, 32, 3), np.uint8), "rgb24")
                frame.pts, frame.time_base = round(1000 * (first + number / 10)), Fraction(1, 1000)
                out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


class Clock:
    """A clock that is advanced by hand."""

    now = 1000.0

    def __call__(self) -> float:
        return self.now


class Device(Closing):
    """A device that takes a block when its own clock, which is fast by a share, says so; heard `delay` later."""

    def __init__(self, clock: Clock, fast: float, delay: float) -> None:
        self._clock, self._step, self._delay = clock, BLOCK / SAMPLE_RATE / (1 + fast), delay
        self._next = clock.now
        self._fill: Fill | None = None
        self.heard: list[tuple[float, np.ndarray]] = []
        self.closed = False

    def __call__(self, fill: Fill) -> Device:
        self._fill = fill
        return self

    def run_until(self, now: float) -> None:
        assert self._fill is not None
        while self._next <= now:
            self._clock.now = self._next
            block = np.full((BLOCK, 2), np.nan, np.float32)
            self._fill(block, self._next + self._delay)
            self.heard.append((self._next + self._delay, block))
            self._next += self._step
        self._clock.now = now

    def close(self) -> None:
        self.closed = True


Place = Callable[[int], tuple[int, int]]  # number of a picture -> its index in the file, its pts


def played(
    path: Path,
    device: Device,
    clock: Clock,
    seconds: float,
    place: Place = lambda n: (n, n),
    tempo: float = 1.0,
) -> np.ndarray:
    """Show pictures for so long, at moments that vary; where the sound was ahead of them, seconds, by block."""
    rng = np.random.default_rng(0)
    with VideoInput(path) as source:
        sound = SoundOutput(source, device=device, clock=clock)
        sound.open(32, 32, FPS)
        begun = clock.now
        for number in range(round(seconds * FPS)):
            device.run_until(begun + number / FPS / tempo + rng.uniform(0, 0.02))
            index, pts = place(number)
            frame = Frame.from_rgb(np.zeros((2, 2, 3), np.uint8), pts, Fraction(1, FPS), index)
            sound.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), clock.now))
        sound.close()
    assert device.closed
    moments = np.array([at for at, _ in device.heard]) - begun - 0.01  # in the middle of when they are shown
    return np.array([block[0, 0] for _, block in device.heard]) * length_of(path) - moments * tempo


def length_of(path: Path) -> float:
    with VideoInput(path) as source, AudioReader(source) as reader:
        last = 0.0
        while (read := reader.read()) is not None:
            last = read[0] + len(read[1]) / SAMPLE_RATE
    return last


@pytest.mark.parametrize("fast", [-0.001, 0.001])
@pytest.mark.slow
def test_sound_stays_with_the_pictures_however_fast_the_device_is(tmp_path: Path, fast: float) -> None:
    """A minute, in which the device alone would run away by 60 ms."""
    clock = Clock()
    ahead = played(telling(tmp_path / "in.mkv", 65), Device(clock, fast, 0.06), clock, 60)
    settled = ahead[200:]
    assert np.abs(settled).max() < OFF
    assert abs(settled[:500].mean() - settled[-500:].mean()) < 0.002


def test_sound_begins_with_the_first_picture(tmp_path: Path) -> None:
    clock = Clock()
    device = Device(clock, 0.0, 0.06)
    ahead = played(telling(tmp_path / "in.mkv", 10), device, clock, 5)
    silent = sum(not block.any() for _, block in device.heard)
    assert silent <= 1 + 0.1 / (BLOCK / SAMPLE_RATE)
    assert np.abs(ahead[silent + 1 :]).max() < 0.03


def test_sound_begins_again_with_the_pictures_of_a_loop(tmp_path: Path) -> None:
    clock, each = Clock(), 8 * FPS
    device = Device(clock, 0.0003, 0.03)
    path = telling(tmp_path / "in.mkv", 10)
    ahead = played(path, device, clock, 80, lambda n: (n % each, n))
    passes = np.array([(at - 1000.0 - 0.01) // 8 for at, _ in device.heard])
    within = np.array([(at - 1000.0 - 0.01) % 8 for at, _ in device.heard])
    settled = (within > 3) & (within < 7.9)
    assert np.abs((ahead + 8 * passes)[settled]).max() < OFF + 0.01


def test_sound_follows_pictures_that_jump_or_are_slow(tmp_path: Path) -> None:
    clock = Clock()
    path = telling(tmp_path / "in.mkv", 60)
    ahead = played(path, Device(clock, 0.0, 0.05), clock, 20, lambda n: (n, n if n < 250 else n + 500))
    jumped = np.abs(ahead[-200:] - 20)
    assert jumped.max() < OFF
    slow = played(path, Device(clock, 0.0, 0.05), clock, 30, tempo=0.999)
    assert np.abs(slow[200:]).max() < OFF


def test_pictures_that_begin_late_in_the_file_have_their_own_sound(tmp_path: Path) -> None:
    clock = Clock()
    path = telling(tmp_path / "in.mkv", 20, first=3.0)
    ahead = played(path, Device(clock, 0.0, 0.05), clock, 10)
    assert np.abs(ahead[200:] - 3).max() < OFF


def test_sound_stops_soon_after_the_pictures_do(tmp_path: Path) -> None:
    clock = Clock()
    device = Device(clock, 0.0, 0.05)
    with VideoInput(telling(tmp_path / "in.mkv", 20)) as source:
        sound = SoundOutput(source, device=device, clock=clock)
        sound.open(32, 32, FPS)
        for number in range(50):
            device.run_until(1000 + number / FPS)
            frame = Frame.from_rgb(np.zeros((2, 2, 3), np.uint8), number, Fraction(1, FPS), number)
            sound.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), clock.now))
        device.run_until(1000 + 50 / FPS + 3)
        sound.close()
    late = [block.any() for at, block in device.heard if at > 1000 + 50 / FPS + 1.5]
    assert len(late) > 50
    assert not any(late)


def test_faster_and_slower_sound_has_the_same_tones() -> None:
    wave = np.sin(np.arange(2000) / 20).astype(np.float32)[:, None].repeat(2, 1)
    for taken in (995, 1000, 1005):
        heard = stretched(wave[:taken], 1000, taken)
        assert heard.shape == (1000, 2)
        np.testing.assert_allclose(heard[:, 0], np.sin(np.arange(1000) * taken / 1000 / 20), atol=2e-3)
    assert len(stretched(wave[:500], 1000, 1005)) == pytest.approx(500, abs=3)


@pytest.mark.usefixtures("no_thread_left")
def test_without_a_device_there_is_one_note_and_silence(tmp_path: Path) -> None:
    def none(fill: Fill) -> Closing:
        raise SoundError("there is no sound device")

    said: list[str] = []
    with VideoInput(telling(tmp_path / "in.mkv", 2)) as source:
        sound = SoundOutput(source, said.append, none)
        sound.open(32, 32, FPS)
        for number in range(10):
            frame = Frame.from_rgb(np.zeros((2, 2, 3), np.uint8), number, Fraction(1, FPS), number)
            sound.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), 0.0))
        sound.close()
    assert said == ["Sound is off: there is no sound device."]


NULL = "</usr/share/alsa/alsa.conf>\npcm.!default {type null}\npcm.null_device {type null hint {show on}}\n"
PLAY = """
import sys, time
from pathlib import Path
from guise.app.live.capture import FileCapture
from guise.app.live.face import FaceResult
from guise.app.live.output import OutputFrame
from guise.app.live.sound import SoundOutput
from guise.app.live.stats import PipelineStats

with FileCapture(Path(sys.argv[1])) as capture:
    sound = SoundOutput(capture.media, print)
    fill, played = sound._sound.fill, [0.0]

    def heard(block, at):
        fill(block, at)
        played[0] += float(abs(block).max())

    sound._sound.fill = heard
    sound.open(32, 32, 25)
    for frame in capture:
        sound.show(OutputFrame(frame, FaceResult("swapped"), PipelineStats(), time.perf_counter()))
    sound.close()
    print("played" if played[0] else "silent")
"""


@pytest.mark.skipif(
    not Path("/usr/share/alsa/alsa.conf").exists(), reason="no ALSA, whose null device is used"
)
def test_the_real_library_plays_to_a_device_that_is_not_heard(tmp_path: Path) -> None:
    found = ctypes.util.find_library("portaudio")
    if importlib.util.find_spec("sounddevice") is None or found is None:
        pytest.skip("no PortAudio or no sounddevice (extra window)")
    (tmp_path / "asoundrc").write_text(NULL)
    clip = cut("p01", tmp_path / "in.mp4", 20)
    run = subprocess.run(
        [sys.executable, "-c", PLAY, str(clip)], cwd=ROOT, capture_output=True, text=True, check=True,
        env={**os.environ, "ALSA_CONFIG_PATH": str(tmp_path / "asoundrc")},
    )  # fmt: skip
    assert run.stdout == "played\n"


def test_a_missing_extra_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    said: list[str] = []
    with VideoInput(telling(tmp_path / "in.mkv", 1)) as source:
        sound = SoundOutput(source, said.append)
        sound.open(32, 32, FPS)
        sound.close()
    assert said == ['Sound is off: sounddevice is not installed; run pip install "guise-video[window]".']
