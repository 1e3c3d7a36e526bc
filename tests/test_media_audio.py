"""Masked sound: lower in pitch and formants, in step with the picture, of the same length."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from numpy.typing import NDArray
from test_media import FAST, SHARED, STEADY, make_clip
from test_media_packets import put_together

from guise.app.media import open_input
from guise.app.media.new_audio import FREQUENCY_FACTOR
from guise.app.media.packets import PacketSink, assemble

Sound = NDArray[np.float64]


def voice(seconds: float, rate: int, *, pitch: float = 160.0, formant: float = 900.0) -> Sound:
    """Syllables of a buzz with one formant, four a second, of uneven length and strength."""
    time = np.arange(round(seconds * rate)) / rate
    buzz = sum(
        np.sin(2 * np.pi * k * pitch * time) / (1 + ((k * pitch - formant) / 150) ** 2)
        for k in range(1, int(rate / 2.2 / pitch))
    )
    rng = np.random.default_rng(0)
    strength = np.repeat(rng.choice([0.02, 0.3, 1.0], len(time) // (rate // 8) + 1), rate // 8)[: len(time)]
    return np.asarray(0.2 * buzz * np.convolve(strength, np.hanning(rate // 50) / (rate // 100), "same"))


def make_film(
    path: Path, sound: Sound, rate: int, *, codec: str = "aac", channels: int = 1, layout: str = "mono",
    gap: tuple[int, int] | None = None,
) -> Path:  # fmt: skip
    """A clip with that sound; `gap` leaves the samples between two numbers out, and their time empty."""
    video = make_clip(path.with_name("video.mp4"))
    with av.open(str(video)) as source, av.open(str(path), "w") as out:
        copy = out.add_stream_from_template(source.streams.video[0], opaque=True)
        stream = out.add_stream(codec, rate, {"strict": "experimental"})
        stream.codec_context.layout = layout
        for packet in source.demux(video=0):
            if packet.dts is not None:
                packet.stream = copy
                out.mux(packet)
        for start in range(0, len(sound), 1024):
            if gap is not None and gap[0] <= start < gap[1]:
                continue
            part = np.repeat(sound[None, start : start + 1024].astype(np.float32), channels, axis=0)
            frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(part), "fltp", layout)
            frame.sample_rate, frame.pts, frame.time_base = rate, start, Fraction(1, rate)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


def masked(clip: Path, suffix: str = "") -> Path:
    out = clip.with_name("masked" + (suffix or clip.suffix))
    put_together(clip, out, FAST, audio="mask", private=True)
    return out


def hear(path: Path) -> tuple[Sound, int, Fraction]:
    """The sound of a file (channels, n), its rate, and when it starts."""
    with av.open(str(path)) as clip:
        stream = clip.streams.audio[0]
        frames = list(clip.decode(stream))
        convert = av.AudioResampler(format="fltp", layout=stream.layout, rate=stream.rate)
        parts = [out.to_ndarray() for frame in [*frames, None] for out in convert.resample(frame)]
        return (
            np.concatenate(parts, axis=1).astype(float),
            stream.rate,
            frames[0].pts * Fraction(frames[0].time_base),
        )


def envelope(sound: Sound, rate: int) -> Sound:
    """Loudness (n,) in steps of 2 ms, smoothed over 20 ms."""
    step = rate // 500
    power = (sound[: len(sound) // step * step].reshape(-1, step) ** 2).mean(axis=1)
    return np.asarray(np.log(1e-3 + np.sqrt(np.convolve(power, np.hanning(10) / 5, "same"))))


def lag(old: Sound, new: Sound, rate: int) -> tuple[float, float]:
    """How late the second is, seconds, and the correlation of the loudness there."""
    a, b = envelope(old, rate), envelope(new, rate)
    n, most = min(len(a), len(b)), 40
    inner = slice(most, n - most)
    found = {k: float(np.corrcoef(a[inner], b[most + k : n - most + k])[0, 1]) for k in range(-most, most)}
    best = max(found, key=lambda k: found[k])
    return best / 500, found[best]


def peak(sound: Sound, rate: int, low: float, high: float) -> float:
    """The strongest frequency between two, hertz, smoothed over 40 Hz where formants are looked for."""
    power = np.abs(np.fft.rfft(sound * np.hanning(len(sound)))) ** 2
    frequencies = np.fft.rfftfreq(len(sound), 1 / rate)
    if high > 400:
        width = max(int(400 / frequencies[1]), 1)
        power = np.convolve(power, np.hanning(width), "same")
    inside = (frequencies >= low) & (frequencies <= high)
    return float(frequencies[inside][power[inside].argmax()])


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.slow
def test_pitch_and_formants_are_lowered_and_nothing_else(tmp_path: Path, suffix: str) -> None:
    clip = make_film(tmp_path / f"in{suffix}", voice(6, 44100), 44100)
    (old, rate, start), (new, new_rate, new_start) = hear(clip), hear(masked(clip))
    assert (rate, start) == (new_rate, new_start)
    assert abs(new.shape[1] - old.shape[1]) <= 1024  # the last packet is filled up
    assert peak(new[0], rate, 100, 200) == pytest.approx(float(FREQUENCY_FACTOR) * 160, rel=0.02)
    assert peak(new[0], rate, 100, 200) < 0.85 * peak(old[0], rate, 100, 200)
    assert peak(old[0], rate, 500, 1500) == pytest.approx(900, rel=0.08)
    assert peak(new[0], rate, 500, 1500) == pytest.approx(float(FREQUENCY_FACTOR) * 900, rel=0.08)
    late, alike = lag(old[0], new[0], rate)
    assert abs(late) <= 0.02
    assert alike > 0.95


@pytest.mark.slow
def test_it_stays_in_step_for_minutes(tmp_path: Path) -> None:
    clip = make_film(tmp_path / "in.mp4", voice(120, 16000), 16000)
    (old, rate, _), (new, _, _) = hear(clip), hear(masked(clip))
    for second in (0, 60, 114):
        piece = slice(second * rate, (second + 6) * rate)
        late, alike = lag(old[0, piece], new[0, piece], rate)
        assert abs(late) <= 0.02
        assert alike > 0.95


def test_real_speech_stays_in_step(tmp_path: Path) -> None:
    clip = SHARED / "data/real/room_s18.mp4"
    if not clip.exists():
        pytest.skip(f"{clip} is not there")
    parts = [tmp_path / "0.packets"]
    with open_input(clip) as source:
        with PacketSink(parts[0], source, FAST, parts[0]) as sink:
            sink.write(next(iter(source)))
        assemble(tmp_path / "out.mp4", source, parts, FAST, tags={}, private=True, audio="mask")
    (old, rate, start), (new, _, new_start) = hear(clip), hear(tmp_path / "out.mp4")
    assert start == new_start
    for second in (0, 3, 6):
        piece = slice(second * rate, (second + 3) * rate)
        late, alike = lag(old[0, piece], new[0, piece], rate)
        assert abs(late) <= 0.02
        assert alike > 0.9


def test_a_gap_in_the_sound_stays_where_it_is(tmp_path: Path) -> None:
    rate = 32000
    gap = (40 * 1024, 70 * 1024)
    clip = make_film(tmp_path / "in.mkv", voice(6, rate), rate, codec="pcm_s16le", gap=gap)
    new, _, start = hear(masked(clip, ".mov"))
    whole = voice(6, rate)
    assert start == 0
    assert new.shape[1] == pytest.approx(len(whole), abs=64)
    silent = new[0, gap[0] + rate // 20 : gap[1] - rate // 20]
    assert np.abs(silent).max() < 1e-3
    after = slice(gap[1], len(whole))
    late, alike = lag(whole[after], new[0, after], rate)
    assert abs(late) <= 0.02
    assert alike > 0.9


@pytest.mark.parametrize(
    ("codec", "rate", "layout", "inner", "outer", "result"),
    [
        ("aac", 48000, "5.1", ".mp4", ".mp4", "aac"), ("libmp3lame", 22050, "mono", ".mkv", ".mkv", "mp3"),
        ("flac", 44100, "stereo", ".mkv", ".mkv", "flac"), ("pcm_s24le", 32000, "stereo", ".mov", ".mov", "pcm_s24le"),
        ("libopus", 48000, "stereo", ".mkv", ".mp4", "opus"), ("vorbis", 44100, "stereo", ".mkv", ".mkv", "aac"),
        ("pcm_u8", 44100, "stereo", ".mkv", ".mp4", "aac"),
    ],
)  # fmt: skip
@pytest.mark.slow
def test_codec_rate_and_channels(
    tmp_path: Path, codec: str, rate: int, layout: str, inner: str, outer: str, result: str
) -> None:
    channels = av.AudioLayout(layout).nb_channels
    clip = make_film(
        tmp_path / f"in{inner}", voice(2, rate), rate, codec=codec, channels=channels, layout=layout
    )
    with av.open(str(masked(clip, outer))) as film:
        stream = film.streams.audio[0]
        assert stream.codec_context.codec.canonical_name == result
        assert (stream.rate, stream.layout.name) == (rate, layout)
    (old, _, start), (new, _, new_start) = hear(clip), hear(tmp_path / f"masked{outer}")
    assert abs(new_start - start) < Fraction(1, 100)
    assert abs(new.shape[1] - old.shape[1]) <= 2048
    assert abs(lag(old[0], new[0], rate)[0]) <= 0.02


def test_the_same_bytes_each_time(tmp_path: Path) -> None:
    clip = make_film(tmp_path / "in.mp4", voice(2, 44100), 44100)
    first = masked(clip).read_bytes()
    (tmp_path / "masked.mp4").unlink()
    assert masked(clip).read_bytes() == first


def test_a_film_without_sound_has_none(tmp_path: Path) -> None:
    clip = make_clip(tmp_path / "in.mp4", STEADY)
    with av.open(str(masked(clip))) as film:
        assert [stream.type for stream in film.streams] == ["video"]
