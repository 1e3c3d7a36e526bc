"""Decode, work and encode concurrently, with bounded queues of frames in between."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from guise.app.media.frame import Frame


class Frames(Protocol):
    """Where frames come from: an input, or a part of one."""

    @property
    def problems(self) -> Sequence[str]:
        """Sentences about what went wrong so far without ending the work."""

    def __iter__(self) -> Iterator[Frame]: ...


class Writer(Protocol):
    """Where frames go: a sink, or a stage before one."""

    def write(self, frame: Frame) -> None:
        """Take the next frame."""


@dataclass(frozen=True)
class ProcessStats:
    """What a run did.

    frames : number written.   seconds : wall time.   problems : those that did not end it, in sentences.
    decode_seconds, ahead_seconds, work_seconds, encode_seconds : wall time of each stage, without waiting.
    encoder_wait_seconds : of the encoder, for frames between its first one and its last.
    """

    frames: int
    seconds: float
    decode_seconds: float
    ahead_seconds: float
    work_seconds: float
    encode_seconds: float
    encoder_wait_seconds: float
    problems: tuple[str, ...]

    @property
    def encoder_idle_share(self) -> float:
        """Share in [0, 1] of the time from its first frame to its last that the encoder waited for frames."""
        return self.encoder_wait_seconds / max(self.encoder_wait_seconds + self.encode_seconds, 1e-9)


class _Channel:
    """A bounded queue between two threads; either can end it.

    `finish` ends it after the frames it holds, `cancel` at once.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._items: deque[Frame] = deque()
        self._changed = threading.Condition()
        self._finished = self._cancelled = False

    def put(self, frame: Frame) -> bool:
        """Wait for room; False when the channel was cancelled."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._items) < self._size or self._cancelled)
            if not self._cancelled:
                self._items.append(frame)
                self._changed.notify_all()
            return not self._cancelled

    def get(self) -> Frame | None:
        """Wait for a frame; None when there are no more."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._finished or self._cancelled)
            if not self._items or self._cancelled:
                return None
            self._changed.notify_all()
            return self._items.popleft()

    def finish(self) -> None:
        with self._changed:
            self._finished = True
            self._changed.notify_all()

    def cancel(self) -> None:
        with self._changed:
            self._cancelled = True
            self._items.clear()
            self._changed.notify_all()


class _Stage:
    """One thread of the pipeline; its first error is kept and cancels the channels."""

    def __init__(self, name: str, body: Callable[[_Stage], None], channels: tuple[_Channel, ...]) -> None:
        self.error: BaseException | None = None
        self.seconds = self.wait_seconds = 0.0
        self._body, self._channels = body, channels
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._body(self)
        except BaseException as error:
            self.error = error
            self._cancel()

    def join(self) -> None:
        """Wait for the thread to end, even through Ctrl-C, which is raised afterwards.

        A sink must not be closed while its thread is still writing.
        """
        interrupt: KeyboardInterrupt | None = None
        while self._thread.is_alive():
            try:
                self._thread.join()
            except KeyboardInterrupt as error:
                interrupt = error
                self._cancel()
        if interrupt is not None:
            raise interrupt

    def _cancel(self) -> None:
        for channel in self._channels:
            channel.cancel()


def process(
    frames: Frames, sink: Writer, work: Callable[[Frame], None],
    *, ahead: Callable[[Frame], None] | None = None, progress: Callable[[int], None] | None = None, queue: int = 2,
) -> ProcessStats:  # fmt: skip
    """Pass every frame of the input through `ahead` and `work`, which change it in place, to the sink.

    Decoding, `ahead` and encoding run in their own threads, `work` and `progress` (frames so far) in the caller's;
    each takes the frames in order, so that two are worked on at once.  At most 3 `queue` + 4 frames exist at a time,
    2 `queue` + 3 without `ahead`.  The first error in any thread stops all of them and is raised once.
    """
    start = time.perf_counter()
    decoded, worked = _Channel(queue), _Channel(queue)
    ready = decoded if ahead is None else _Channel(queue)
    channels = (decoded, ready, worked)
    stages = [_Stage("decode", lambda stage: _decode(stage, frames, decoded), channels)]
    if ahead is not None:
        stages.append(_Stage("ahead", lambda stage: _look(stage, ahead, decoded, ready), channels))
    encoder = _Stage("encode", lambda stage: _encode(stage, sink, worked), channels)
    stages.append(encoder)
    count = 0
    busy = 0.0
    try:
        while (frame := ready.get()) is not None:
            before = time.perf_counter()
            work(frame)
            busy += time.perf_counter() - before
            if not worked.put(frame):
                break
            del frame
            count += 1
            if progress is not None:
                progress(count)
        worked.finish()
    except BaseException:
        for channel in channels:
            channel.cancel()
        raise
    finally:
        _join(stages)
    for stage in stages:
        if stage.error is not None:
            raise stage.error
    looked = stages[1].seconds if ahead is not None else 0.0
    return ProcessStats(
        count, time.perf_counter() - start, stages[0].seconds, looked, busy, encoder.seconds, encoder.wait_seconds,
        tuple(frames.problems),
    )  # fmt: skip


def _join(stages: Sequence[_Stage]) -> None:
    """Wait for every thread, even if Ctrl-C comes while one is waited for."""
    with contextlib.ExitStack() as stack:
        for stage in reversed(stages):
            stack.callback(stage.join)


def replace_frames(
    frames: Frames, sink: Writer, make: Callable[[Frame], Frame],
    *, progress: Callable[[int], None] | None = None,
) -> ProcessStats:  # fmt: skip
    """As `process`, but `make` gives another frame for each, which takes over its time, index and name."""
    replacing = _ReplacingWriter(sink)

    def work(frame: Frame) -> None:
        made = make(frame)
        made.pts, made.time_base, made.index = frame.pts, frame.time_base, frame.index
        made.name, made.duration = frame.name, frame.duration
        replacing.made[frame.index] = made

    return process(frames, replacing, work, progress=progress)


class _ReplacingWriter:
    """Takes the input's frames and writes those that were made for them."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self.made: dict[int, Frame] = {}  # by index

    def write(self, frame: Frame) -> None:
        self._writer.write(self.made.pop(frame.index))


def _decode(stage: _Stage, frames: Frames, decoded: _Channel) -> None:
    iterator = iter(frames)
    while True:
        before = time.perf_counter()
        frame = next(iterator, None)
        stage.seconds += time.perf_counter() - before
        if frame is None:
            decoded.finish()
            return
        if not decoded.put(frame):
            return
        del frame


def _look(stage: _Stage, ahead: Callable[[Frame], None], decoded: _Channel, ready: _Channel) -> None:
    while (frame := decoded.get()) is not None:
        before = time.perf_counter()
        ahead(frame)
        stage.seconds += time.perf_counter() - before
        if not ready.put(frame):
            return
        del frame
    ready.finish()


def _encode(stage: _Stage, sink: Writer, worked: _Channel) -> None:
    ended: float | None = None  # when the last frame was written
    while (frame := worked.get()) is not None:
        before = time.perf_counter()
        stage.wait_seconds += 0.0 if ended is None else before - ended
        sink.write(frame)
        ended = time.perf_counter()
        stage.seconds += ended - before
        del frame
