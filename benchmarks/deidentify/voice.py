"""Disguised voices: the equal error rate of a speaker recogniser, and how much can be understood.

Speakers are voices of espeak-ng, who say other sentences to be known by than those by which they are sought, and the
people of data/real whose clips have sound: the first half of a clip is known, and the second half is sought.  The
recogniser is a simple one: mean and spread of mel cepstra and of their change in time and the pitch's mean and spread,
over two seconds of sound, with linear discriminants that are trained on the known ones (`attackers.Head`).

"naive" knows plain speech; "informed" has disguised the known speech in the same way, and is trained on it.  With
50 % a recogniser does not tell one speaker from another; plain speech tells how good it is at all.

Intelligibility is STOI (Taal et al. 2011), by pystoi, of the disguised sentences against the plain ones, which are
aligned in time; 0.45 to 0.6 is where listeners begin to understand most, and noise of the same level is beside it.

`--voices-python` is a Python with espeakng-loader, numpy, scipy and pystoi.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.filter import Graph
from scipy.fft import dct

from benchmarks import common
from benchmarks.children import ran
from benchmarks.common import F64, Criterion, Report, Table
from benchmarks.deidentify.identity import person_of
from benchmarks.landmarks.clips import real_clips
from benchmarks.landmarks.setting import skipped
from guise.app.measure.attackers import Head
from guise.app.measure.privacy import template
from guise.app.media.new_audio import FREQUENCY_FACTOR
from guise.app.media.whisper import Whisper

NAME, TITLE = "deidentify.voice", "De-identification: voices"
RATE = 16_000  # Hz
SEGMENT_SECONDS, STEP_SECONDS = 2.0, 1.0
WINDOW, HOP = 400, 160
MELS, CEPSTRA = 26, 13
SPEECH_SHARE = 0.02  # of a clip's loudest window, below which one is a pause
MIN_SEGMENTS = 1
VOICES = (
    "Alicia", "Andrea", "Andy", "Annie", "Denis", "Diogo", "Gene", "Jacky", "Lee", "Mario", "Michael", "Mike",
    "Reed", "adam", "anika", "belinda", "boris", "david", "ed", "f2", "f5", "iven", "john", "steph",
)  # fmt: skip
SENTENCES = (
    "The harbour was quiet when the last ferry left for the islands.",
    "Seven brown boxes of old letters stood under the stairs.",
    "My neighbour repairs clocks and never asks for any money.",
    "Please put the blue folder on the table beside the window.",
    "We walked along the river until the lights went out.",
    "A heavy rain had washed the dust from every leaf.",
    "She counted the coins twice and closed the small drawer.",
    "Nobody expected that the bridge would open this year.",
    "The teacher drew a circle and told us to find its middle.",
    "Fresh bread and strong coffee make a cold morning easier.",
    "Their train was late because of a fallen tree.",
    "You can see three church towers from the top of that hill.",
)
Sound = F64
Change = Callable[[Sound], Sound]


def plain(sound: Sound) -> Sound:
    """Nothing changed."""
    return sound


def masked(sound: Sound) -> Sound:
    """As `--audio mask` changes it."""
    low = round(RATE * FREQUENCY_FACTOR)
    graph = Graph()
    graph.link_nodes(
        graph.add_abuffer(sample_rate=RATE, format="flt", layout="mono", time_base=Fraction(1, RATE)),
        graph.add("asetrate", str(low)), graph.add("aresample", str(RATE)),
        graph.add("atempo", f"{RATE / low:.15g}"), graph.add("abuffersink"),
    ).configure()  # fmt: skip
    frame = av.AudioFrame.from_ndarray(np.ascontiguousarray(sound[None], np.float32), "flt", "mono")
    frame.sample_rate, frame.pts = RATE, 0
    graph.push(frame)
    graph.push(None)
    parts = []
    while True:
        try:
            found = graph.pull()
        except (av.error.EOFError, av.error.BlockingIOError):
            break
        parts.append(np.asarray(found.to_ndarray(), np.float64)[0])
    return _fitted(np.concatenate(parts), len(sound))


def whispered(sound: Sound) -> Sound:
    """As `--audio disguise` changes it."""
    whisper = Whisper(RATE, 1)
    one = sound[None].astype(np.float32)
    return _fitted(np.concatenate([whisper(one), whisper.rest()], axis=1)[0].astype(np.float64), len(sound))


def _fitted(sound: Sound, length: int) -> Sound:
    return np.pad(sound, (0, max(0, length - len(sound))))[:length]


CHANGES: Mapping[str, Change] = {"plain": plain, "mask": masked, "disguise": whispered}


def features(sound: Sound) -> F64:
    """(n, d) of each two seconds of sound that are mostly speech."""
    frames = np.lib.stride_tricks.sliding_window_view(sound, WINDOW)[::HOP]
    power = np.abs(np.fft.rfft(frames * np.hamming(WINDOW), 512)) ** 2
    energy = power.sum(1)
    mels = np.log(power @ _mels().T + 1e-6 * max(float(energy.max()), 1e-12))
    cepstra = dct(mels, norm="ortho")[:, 1 : 1 + CEPSTRA]
    change = np.gradient(cepstra, axis=0)
    speech = energy > SPEECH_SHARE * np.percentile(energy, 98)
    pitch = _pitch(frames)
    length, step = (round(s * RATE / HOP) for s in (SEGMENT_SECONDS, STEP_SECONDS))
    rows = []
    for first in range(0, max(1, len(frames) - length + 1), step):
        here = np.flatnonzero(speech[first : first + length]) + first
        if len(here) >= length // 3:
            parts = (cepstra[here].mean(0), cepstra[here].std(0), change[here].std(0))
            rows.append(np.concatenate([*parts, [np.median(pitch[here]), pitch[here].std()]]))
    return np.array(rows).reshape(len(rows), 3 * CEPSTRA + 2)


def _pitch(frames: F64) -> F64:
    """(n,) octaves of the strongest period of each window, between 70 and 400 Hz."""
    spectrum = np.abs(np.fft.rfft(frames, 1024)) ** 2
    likeness = np.fft.irfft(spectrum)[:, :WINDOW]
    low, high = RATE // 400, RATE // 70
    return np.asarray(np.log2(RATE / (low + likeness[:, low:high].argmax(1))))


def _mels() -> F64:
    """(26, 257) triangular weights."""
    edges = 700 * (10 ** (np.linspace(0, 2595 * np.log10(1 + RATE / 2 / 700), MELS + 2) / 2595) - 1)
    bins = np.fft.rfftfreq(512, 1 / RATE)[None]
    low, middle, high = edges[:-2, None], edges[1:-1, None], edges[2:, None]
    return np.asarray(
        np.clip(np.minimum((bins - low) / (middle - low), (high - bins) / (high - middle)), 0, None)
    )


def error_rate(known: list[F64], sought: list[F64]) -> float:
    """Equal error rate, %, of segments (n, d) of each speaker, with a recogniser trained on the known ones."""
    every = np.concatenate(known)
    mean, spread = every.mean(0), every.std(0) + 1e-9
    known, sought = ([(rows - mean) / spread for rows in side] for side in (known, sought))
    head = Head.trained([rows.astype(np.float32) for rows in known])
    templates = np.stack([template(head(rows)) for rows in known])
    scores = [head(rows) @ templates.T for rows in sought]
    own = np.concatenate([s[:, i] for i, s in enumerate(scores)])
    others = np.concatenate([np.delete(s, i, axis=1).ravel() for i, s in enumerate(scores)])
    limits = np.sort(np.concatenate([own, others]))
    missed, taken = (own[None] < limits[:, None]).mean(1), (others[None] >= limits[:, None]).mean(1)
    at = int(np.abs(missed - taken).argmin())
    return 100 * float(missed[at] + taken[at]) / 2


Speakers = dict[str, tuple[list[Sound], list[Sound]]]  # known and sought sounds of each


def synthetic(python: Path, folder: Path, count: int) -> Speakers:
    """Voices of espeak-ng."""
    file, text = folder / "voices.npz", folder / "sentences.txt"
    text.write_text("\n".join(SENTENCES), encoding="utf-8")
    script = Path(__file__).with_name("espeak.py")
    ran(["sh", "-c", '"$@" < "$0"', text, python, script, file, *VOICES[:count]])
    with np.load(file) as stored:
        rate = int(stored["rate"])
        said = {name: _resampled(stored[name], rate) for name in stored.files if name != "rate"}
    half = len(SENTENCES) // 2
    return {
        voice: ([said[f"{voice}.{n}"] for n in range(half)],
                [said[f"{voice}.{n}"] for n in range(half, len(SENTENCES))])
        for voice in VOICES[:count]
    }  # fmt: skip


def _resampled(samples: F64, rate: int) -> Sound:
    from scipy.signal import resample_poly

    return np.asarray(resample_poly(samples.astype(np.float64) / 32768, RATE, rate))


def real(shared: Path) -> Speakers:
    """The people of data/real who can be heard, one clip of each."""
    found: Speakers = {}
    for clip in real_clips(shared):
        sound = heard(clip.video)
        if sound is not None and person_of(clip.video) not in found:
            half = len(sound) // 2
            found[person_of(clip.video)] = ([sound[:half]], [sound[half:]])
    return found


def heard(video: Path) -> Sound | None:
    """A clip's sound, one channel; None where there is none."""
    with av.open(str(video)) as clip:
        if not clip.streams.audio:
            return None
        convert = av.AudioResampler(format="fltp", layout="mono", rate=RATE)
        frames = [*clip.decode(clip.streams.audio[0]), None]
        parts = [out.to_ndarray()[0] for frame in frames for out in convert.resample(frame)]
    sound = np.concatenate(parts).astype(np.float64)
    return sound if float(np.abs(sound).max()) > 1e-3 else None


def rates(speakers: Speakers, change: Change) -> tuple[int, float, float]:
    """The number of speakers, and the equal error rates of the naive and of the informed attacker."""
    rows = []
    for known, sought in speakers.values():
        sides = [_rows(known, plain), _rows(known, change), _rows(sought, change)]
        if all(len(side) >= MIN_SEGMENTS for side in sides):
            rows.append(sides)
    return len(rows), *(error_rate([r[k] for r in rows], [r[2] for r in rows]) for k in (0, 1))


def _rows(sounds: list[Sound], change: Change) -> F64:
    return np.concatenate([features(change(sound)) for sound in sounds])


def understood(python: Path, folder: Path, speakers: Speakers) -> dict[str, float]:
    """Mean STOI of the sought sentences, by change."""
    noise = np.random.default_rng(0)

    def noisy(sound: Sound) -> Sound:
        return sound + noise.standard_normal(len(sound)) * sound.std()

    pairs, names = {}, []
    for what, change in {**CHANGES, "noise of the same level": noisy}.items():
        for voice, (_, sought) in speakers.items():
            sound = np.concatenate(sought[:3])
            pairs[f"clean.{len(names)}"], pairs[f"changed.{len(names)}"] = sound, change(sound)
            names.append((what, voice))
    np.savez(folder / "pairs.npz", **pairs)  # type: ignore[arg-type]
    code = (
        "import json, numpy as np; from pystoi import stoi; f = np.load('pairs.npz'); "
        f"print(json.dumps([stoi(f[f'clean.{{k}}'], f[f'changed.{{k}}'], {RATE}) for k in range({len(names)})]))"
    )
    output = folder / "stoi.json"
    ran(["sh", "-c", 'cd "$0" && "$@" > stoi.json', folder, python, "-c", code])
    values = json.loads(output.read_text(encoding="utf-8"))
    return {
        what: float(np.mean([v for (w, _), v in zip(names, values, strict=True) if w == what]))
        for what in dict.fromkeys(w for w, _ in names)
    }


def measure(options: argparse.Namespace) -> Report:
    """All changes, by synthetic and by real speakers."""
    if options.voices_python is None:
        return skipped(NAME, TITLE, "espeakng-loader and pystoi are missing: give --voices-python")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        speakers = synthetic(options.voices_python.absolute(), folder, 8 if options.quick else len(VOICES))
        stoi = understood(options.voices_python.absolute(), folder, dict(list(speakers.items())[:6]))
    people = real(options.shared)
    rows: list[tuple[object, ...]] = []
    for what, change in CHANGES.items():
        for kind, who in (("espeak-ng", speakers), ("real", people)):
            rows.append((what, kind, *rates(who, change), stoi[what] if kind == "espeak-ng" else "-"))
            common.say(str(rows[-1]))
    informed = {(str(r[0]), str(r[1])): float(str(r[4])) for r in rows}
    return Report(
        NAME,
        TITLE,
        [
            *(
                Criterion(f"equal error rate, informed, disguise, {who}", informed["disguise", who], ">=", 30, "%")
                for who in ("espeak-ng", "real")
            ),
            Criterion("intelligibility (STOI), disguise", stoi["disguise"], ">=", 0.6),
        ],
        [Table(
            "Speakers, equal error rates in %, and STOI",
            ("change", "speakers", "number", "naive", "informed", "STOI"), rows,
        )],
        [f"STOI of speech in noise of the same level: {stoi['noise of the same level']:.2f}."],
    )  # fmt: skip


def arguments() -> argparse.ArgumentParser:
    """The options of this benchmark."""
    parser = common.arguments(__doc__)
    parser.add_argument("--voices-python", type=Path, help="a Python with espeakng-loader and pystoi")
    return parser


if __name__ == "__main__":
    common.run(measure, arguments())
