"""Time of each stage of a frame on this computer, and of a whole file beside its transcode, which is the limit.

Stages are measured by calling the engine's parts one after the other: milliseconds, without decoding and encoding.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from guise.aam.model import Identity
from guise.aam.tracker import Fit
from guise.aam.training import TrainingOptions
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import SWAP
from guise.app.drawing.plan import Plan, Step
from guise.app.media import Frame, MediaError, open_input, open_sink, process
from guise.app.swapping.file import swap_file
from guise.app.swapping.report import SwapReport, SwapSettings
from guise.common.progress import Progress, Say, mute, silent
from guise.common.report import Report
from guise.common.threads import one_thread
from guise.render import RendererError
from guise.render.compositor import Renderer

T = TypeVar("T")
RENDERERS: tuple[Renderer, ...] = ("cpu", "gl")
MEASURED_FRAMES = 150
ENROLMENT_FRAMES = 60  # enough for a tracker of the usual size
WARM_UP_FRAMES = 10  # that are not counted
FILE_ROUNDS = 3  # of swap and transcode


@dataclass(frozen=True)
class Timing(Report):
    """Milliseconds of a stage: median, 95th percentile, and the number of frames."""

    renderer: str
    stage: str
    median: float
    p95: float
    frames: int


class _Clock:
    """Records times by stage."""

    def __init__(self) -> None:
        self._frames: list[dict[str, float]] = []
        self._frame: dict[str, float] = defaultdict(float)

    def add(self, stage: str, work: Callable[[], T]) -> T:
        """The result of `work`, whose time is added to that of a stage of this frame."""
        start = time.perf_counter()
        result = work()
        self._frame[stage] += 1e3 * (time.perf_counter() - start)
        return result

    def add_rest(self, stage: str, work: Callable[[], object]) -> None:
        """Do work, and add what its stages leave of its time to one more stage of this frame."""
        start, known = time.perf_counter(), sum(self._frame.values())
        work()
        told = sum(self._frame.values()) - known
        self._frame[stage] += 1e3 * (time.perf_counter() - start) - told

    def end_frame(self, *, kept: bool) -> None:
        """Begin with the next frame."""
        if kept:
            self._frames.append(self._frame)
        self._frame = defaultdict(float)

    def timings(self, renderer: str) -> list[Timing]:
        """Median and 95th percentile of every stage, and of their sum."""
        counted = self._frames[WARM_UP_FRAMES:]
        times = {stage: np.array([frame[stage] for frame in counted]) for stage in counted[0]}
        times["all"] = np.sum(list(times.values()), axis=0)
        return [
            Timing(
                renderer, stage, round(float(np.median(t)), 3), round(float(np.quantile(t, 0.95)), 3), len(t)
            )
            for stage, t in times.items()
        ]


def prepare(
    clip: Path | None, source: str | None, identity: str | None, samples: Path | None,
    *, progress: Progress = silent, say: Say = mute,
) -> tuple[Path, Identity, Identity]:  # fmt: skip
    """Clip, person in it, and identity; default: a sample clip, the person enrolled from it, and the same person."""
    from guise.app.enrolment.enrol import enrol
    from guise.app.enrolment.landmark_source import LandmarkSource
    from guise.app.swapping.donors import open_face
    from guise.app.tools.demo import HEAD, find_samples

    training_clip = clip
    if clip is None:
        folder = find_samples(samples) / HEAD
        clip, training_clip = folder / "talk2.mp4", folder / "talk.mp4"
    assert training_clip is not None
    if source is not None:
        person = open_face(source)
    else:
        say(f"enrolling the person in {training_clip.name}")
        options = TrainingOptions(frames=ENROLMENT_FRAMES)
        person = enrol(
            [training_clip], LandmarkSource(), name="bench", options=options, progress=progress, say=say
        )
    shown = person if identity is None else open_face(identity)
    return clip, person.at_resolution(shown.reference.resolution), shown


def measure(
    clip: Path, source: Identity, target: Identity, *, frames: int = MEASURED_FRAMES, say: Say = mute
) -> list[Timing]:
    """Timings of the stages with each renderer; one that is not available is reported and left out."""
    timings = []
    for renderer in RENDERERS:
        try:
            with one_thread():
                timings += _measure_one(clip, source, target, renderer, frames)
        except RendererError as error:
            say(f"renderer {renderer} was left out: {error}")
    return timings


@dataclass(frozen=True)
class WholeFile:
    """A whole clip swapped by a command's way, and transcoded alone, which is the limit; medians of some rounds.

    Parameters
    ----------
    frames : of the clip.
    seconds, transcode_seconds : wall time.   processor_seconds, transcode_processor_seconds : of all threads.
    first_packet_seconds : from the call to the first encoded picture; the start of a command comes before it.
    encoder_idle_share : share in [0, 1] of the time that the encoder waited for frames.
    """

    frames: int
    seconds: float
    transcode_seconds: float
    processor_seconds: float
    transcode_processor_seconds: float
    first_packet_seconds: float
    encoder_idle_share: float

    @property
    def over_transcode(self) -> float:
        """Wall time of the swap over that of the transcode."""
        return self.seconds / self.transcode_seconds

    @property
    def processor_over_transcode(self) -> float:
        """The same of the processor's time."""
        return self.processor_seconds / self.transcode_processor_seconds

    def as_json(self) -> dict[str, Any]:
        """The figures as JSON holds them."""
        return {key: round(value, 4) for key, value in asdict(self).items()}


def measure_file(clip: Path, source: Identity, target: Identity, *, rounds: int = FILE_ROUNDS) -> WholeFile:
    """A clip swapped and transcoded in turn."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        pairs = [
            (_swapped(clip, source, target, folder / f"s{k}.mp4"), _transcoded(clip, folder / f"t{k}.mp4"))
            for k in range(rounds)
        ]
    swaps, transcodes = zip(*pairs, strict=True)
    return WholeFile(
        swaps[0].report.frames,
        median(s.seconds for s in swaps),
        median(seconds for seconds, _ in transcodes),
        median(s.processor for s in swaps),
        median(processor for _, processor in transcodes),
        median(s.report.times.first_packet_seconds or 0.0 for s in swaps),
        median(s.report.times.encoder_idle_share for s in swaps),
    )


@dataclass(frozen=True)
class _Swapped:
    report: SwapReport
    seconds: float
    processor: float


def _swapped(clip: Path, source: Identity, target: Identity, output: Path) -> _Swapped:
    wall, processor = time.perf_counter(), time.process_time()
    report = swap_file(clip, target, output, source=source)
    return _Swapped(report, time.perf_counter() - wall, time.process_time() - processor)


def _transcoded(clip: Path, output: Path) -> tuple[float, float]:
    """Wall and processor seconds of decoding and encoding alone."""
    wall, processor = time.perf_counter(), time.process_time()
    with open_input(clip) as media, open_sink(output, media) as sink:
        process(media, sink, lambda frame: None)
    return time.perf_counter() - wall, time.process_time() - processor


def _measure_one(
    clip: Path, source: Identity, target: Identity, renderer: Renderer, frames: int
) -> list[Timing]:
    clock, done, donor = _Clock(), 0, Donor.of(target)
    with (
        open_input(clip) as media,
        Engine(source, donor, SwapSettings().face_finder(), replace(SWAP, renderer=renderer)) as engine,
    ):
        engine.plan = _timed(engine, clock)
        for frame in media:
            done += _timed_swap(engine, frame, clock)
            if done >= frames + WARM_UP_FRAMES:
                break
    if done <= WARM_UP_FRAMES:
        raise MediaError(
            f"{clip} shows the source person in {done} frames, too few to measure: give a longer clip, or the "
            "model of the person in it with --source"
        )
    return clock.timings(renderer)


def _timed(engine: Engine, clock: _Clock) -> Plan:
    """The engine's plan with a clock around each pass; a pass is named by its module."""

    def watched(step: Step) -> Step:
        name = step.__module__.rsplit(".", 1)[-1].replace("_", " ")
        return lambda face, memory: clock.add(name, lambda: step(face, memory))

    plan = engine.plan
    seeing, placing, drawing = (
        tuple(map(watched, steps)) for steps in (plan.seeing, plan.placing, plan.drawing)
    )
    return replace(plan, seeing=seeing, placing=placing, drawing=drawing)


def _timed_swap(engine: Engine, frame: Frame, clock: _Clock) -> bool:
    """As Engine.swap, with a clock around its parts; False when the person is lost."""
    fit = clock.add("track", lambda: engine.track(frame))
    if isinstance(fit, Fit):
        clock.add_rest("solid shape", lambda: engine.swap_tracked(frame, fit))
    clock.end_frame(kept=isinstance(fit, Fit))
    return isinstance(fit, Fit)
