"""A whispered voice: of the same length and loudness, without the pitch, and the same however it is cut up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_media import FAST
from test_media_audio import hear, make_film, voice
from test_media_packets import put_together

from guise.app.media.whisper import Whisper
from guise.common.arrays import F32

RATE = 16_000


def whispered(sound: F32, step: int) -> F32:
    whisper = Whisper(RATE, len(sound))
    parts = [whisper(sound[:, k : k + step]) for k in range(0, sound.shape[1], step)]
    return np.concatenate([*parts, whisper.rest()], axis=1)[:, : sound.shape[1]]


@pytest.fixture(scope="module")
def speech() -> F32:
    return np.asarray(voice(3.0, RATE)[None], np.float32)


def test_how_a_sound_is_cut_up_changes_nothing(speech: F32) -> None:
    np.testing.assert_allclose(whispered(speech, 1024), whispered(speech, 333), atol=1e-6)


def test_the_envelope_stays_and_the_pitch_goes(speech: F32) -> None:
    made = whispered(speech, 1024)
    assert made.shape == speech.shape
    loud = [
        np.sqrt((one[0, : RATE * 3 // 800 * 800].reshape(-1, 800) ** 2).mean(1)) for one in (speech, made)
    ]
    assert np.corrcoef(*loud)[0, 1] > 0.8
    assert 0.3 < loud[1].mean() / loud[0].mean() < 3
    assert periodicity(speech[0], 160) > 0.8
    assert periodicity(made[0], 160) < 0.3


def periodicity(sound: F32, pitch: float) -> float:
    period = round(RATE / pitch)
    return float(np.corrcoef(sound[:-period], sound[period:])[0, 1])


def test_silence_stays_silence() -> None:
    assert not whispered(np.zeros((2, RATE), np.float32), 1024).any()


def test_the_noise_is_of_the_sound_itself(speech: F32) -> None:
    other = speech + np.float32(1e-4) * np.sin(np.arange(speech.shape[1]), dtype=np.float32)
    a, b = whispered(speech, 1024)[0], whispered(other, 1024)[0]
    assert abs(float(np.corrcoef(a, b)[0, 1])) < 0.1


def test_a_film_is_whispered_in_step(tmp_path: Path) -> None:
    film = make_film(tmp_path / "film.mp4", voice(2.0, 44_100), 44_100)
    made = film.with_name("whispered.mp4")
    put_together(film, made, FAST, audio="disguise", private=True)
    (before, _, first), (after, rate, start) = hear(film), hear(made)
    assert rate == 44_100
    assert abs(float(start - first)) < 0.03
    assert abs(after.shape[1] - before.shape[1]) <= 2048
    n = min(after.shape[1], before.shape[1]) // 4410 * 4410
    loud = [np.sqrt((s[0, :n].reshape(-1, 4410) ** 2).mean(1)) for s in (before, after)]
    assert np.corrcoef(*loud)[0, 1] > 0.7


def test_a_lively_voice_and_a_flat_one_become_alike() -> None:
    time, noise = np.arange(4 * RATE) / RATE, np.random.default_rng(1).standard_normal(4 * RATE)
    swell = np.sin(2 * np.pi * 2 * time)
    voices = [np.float32(0.05 * noise * np.exp(depth * swell))[None] for depth in (0.2, 0.6)]
    own = [spread(one) for one in voices]
    flat, lively = (spread(whispered(one, 1024)) for one in voices)
    assert own[1] > 2 * own[0]
    assert lively < 1.3 * flat


def spread(sound: F32) -> float:
    """Standard deviation of the level after the first second, nepers."""
    windows = sound[0, RATE : len(sound[0]) // 800 * 800].reshape(-1, 800)
    return float(np.log((windows**2).mean(1)).std())
