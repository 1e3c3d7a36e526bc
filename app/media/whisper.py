"""A disguised voice: whispered, with everybody's long-term spectrum; a noise vocoder that works as samples come.

Speech is reduced to the energies of a few bands, as in Shannon et al. (1995, Science 270), and made again from noise.
So pitch, intonation and timbre of the voice are gone, while the words stay.  Each band's level gets the mean and the
spread of speech in general instead of its own, running ones; how fast it changes is limited; and the places of the
bands drift.  Noise and drift follow from the first sound, so that the result is reproducible, but not by somebody who
doesn't have the original.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from guise.common.arrays import F32, F64


@dataclass(frozen=True)
class WhisperShape:
    """Windows, bands and rates."""

    window_seconds: float = 0.02
    bands: int = 8
    range_hz: tuple[float, float] = (80.0, 8000.0)
    kept_share: float = 0.5  # of a band's energy from one window to the next
    mean_seconds: float = 1.0  # over which a band's mean and spread are taken
    spread: float = 1.6  # standard deviation of a band's level in speech in general, nepers of energy
    least_spread: float = 0.3  # of the band's own, so that a steady one does not become a lively one
    most_spreads: tuple[float, float] = (4.0, 2.5)  # from the mean, below it and above it
    speech_share: float = 0.05  # of the loudest mean so far: what is below it is a pause
    drift_seconds: float = 0.3  # from one stretch of the mel scale to the next,
    max_drift: float = 0.4  # which is at most this share
    slope_knee_hz: float = 500.0  # from which the energy of speech falls, by 9 dB an octave


SHAPE = WhisperShape()
_SMALL = 1e-12


class Whisper:
    """Changes the voice in a stream of sound; the result lags behind by nothing.

    rate : samples a second.   channels : each is changed for itself.
    """

    def __init__(self, rate: int, channels: int) -> None:
        self._hop = max(1, round(SHAPE.window_seconds * rate / 2))
        self._window = np.sqrt(np.hanning(2 * self._hop + 1)[:-1])
        self._bands, self._target = _bands(rate, 2 * self._hop)
        self._forget = np.exp(-self._hop / (SHAPE.mean_seconds * rate))
        self._noise: np.random.Generator | None = None  # begun by the first sound, which no attacker has
        self._pending = np.zeros((channels, self._hop))  # of the input; the first half window is before it
        self._tail = np.zeros((channels, self._hop))
        self._energy: F64 | None = None
        self._moments = np.zeros((3, channels, len(self._bands)))  # energy, its logarithm, the square of that
        self._weight = np.zeros((channels, 1))
        self._loudest = np.zeros((channels, 1))
        self._skip = self._hop
        self._drift, self._drift_step, self._drift_frames = 0.0, 0.0, 0

    def __call__(self, samples: F32) -> F32:
        """As many of the changed samples (channels, m) as are known after these (channels, n)."""
        self._pending = np.concatenate([self._pending, samples.astype(np.float64)], axis=1)
        parts = [np.zeros((len(samples), 0))]
        while self._pending.shape[1] >= 2 * self._hop:
            made = self._window * self._changed(self._window * self._pending[:, : 2 * self._hop])
            parts.append(self._tail + made[:, : self._hop])
            self._tail, self._pending = made[:, self._hop :], self._pending[:, self._hop :]
        out = np.concatenate(parts, axis=1)
        skipped = min(self._skip, out.shape[1])
        self._skip -= skipped
        return np.asarray(out[:, skipped:], np.float32)

    def rest(self) -> F32:
        """The samples that are still to come at the end."""
        return self(np.zeros((len(self._tail), 2 * self._hop), np.float32))

    def _changed(self, frame: F64) -> F64:
        """A windowed frame (channels, n) made again from noise."""
        if not frame.any():
            return frame
        if self._noise is None:
            self._noise = np.random.default_rng(list(sha256(frame.tobytes()).digest()))
        energy = np.abs(np.fft.rfft(frame)) ** 2 @ self._bands.T
        if self._energy is not None:
            energy = SHAPE.kept_share * self._energy + (1 - SHAPE.kept_share) * energy
        self._energy = energy
        loud = energy.sum(1, keepdims=True)
        self._loudest = np.maximum(self._loudest * self._forget, loud)
        level = np.log(energy + _SMALL)
        learned = np.where(loud > SHAPE.speech_share * self._loudest, 1 - self._forget, 0.0)
        self._moments += learned * (np.stack([energy, level, level**2]) - self._moments)
        self._weight += learned * (1 - self._weight)
        mean, middle, square = self._moments / np.maximum(self._weight, _SMALL)
        own = np.sqrt(np.maximum(square - middle**2, SHAPE.least_spread**2))
        low, high = SHAPE.most_spreads
        spreads = SHAPE.spread * np.clip((level - middle) / own, -low, high)
        energy = self._target * mean.sum(1, keepdims=True) * np.exp(spreads - SHAPE.spread**2 / 2)
        bins = self._drifted(energy, self._noise) @ self._bands
        # Twice the energy, as the first window takes half of it.
        real, imaginary = self._noise.standard_normal((2, *bins.shape))
        return np.asarray(np.fft.irfft(np.sqrt(bins) * (real + 1j * imaginary), frame.shape[1]))

    def _drifted(self, energy: F64, noise: np.random.Generator) -> F64:
        """The energies (channels, bands) with their places on the mel scale stretched by a share that drifts."""
        if self._drift_frames <= 0:
            self._drift_frames = max(1, round(SHAPE.drift_seconds / SHAPE.window_seconds * 2))
            self._drift_step = (noise.uniform(-1, 1) * SHAPE.max_drift - self._drift) / self._drift_frames
        self._drift_frames -= 1
        self._drift += self._drift_step
        places = np.arange(energy.shape[1]) * (1 + self._drift)
        low = np.minimum(places.astype(int), energy.shape[1] - 2)
        share = np.clip(places - low, 0, 1)
        return np.asarray(energy[:, low] * (1 - share) + energy[:, low + 1] * share)


def _bands(rate: int, size: int) -> tuple[F64, F64]:
    """Weights (bands, bins) of the bands, squares sum to 1 in each, and the share of the energy (bands,) of speech."""
    low, high = SHAPE.range_hz[0], min(SHAPE.range_hz[1], 0.48 * rate)
    edges = _hertz(np.linspace(_mel(low), _mel(high), SHAPE.bands + 2))
    bins = np.fft.rfftfreq(size, 1 / rate)
    rising = (bins - edges[:-2, None]) / (edges[1:-1] - edges[:-2])[:, None]
    falling = (edges[2:, None] - bins) / (edges[2:] - edges[1:-1])[:, None]
    weights = np.clip(np.minimum(rising, falling), 0, None)
    nearest = np.abs(bins - edges[1:-1, None]).argmin(1)  # a narrow band has at least one
    weights[np.arange(len(weights)), nearest] = np.maximum(weights[np.arange(len(weights)), nearest], 0.5)
    weights /= np.sqrt((weights**2).sum(1, keepdims=True))
    target = np.minimum(1.0, (SHAPE.slope_knee_hz / edges[1:-1]) ** 3) * (edges[2:] - edges[:-2])
    return weights, target / target.sum()


def _mel(hertz: float) -> float:
    return float(2595 * np.log10(1 + hertz / 700))


def _hertz(mel: F64) -> F64:
    return np.asarray(700 * (10 ** (mel / 2595) - 1))
