"""Decode, work and encode concurrently, with bounded queues of frames in between."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from guise.app.media.frame import Frame
from guise.common.channel import Channel


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


class _Stage:
    """A step of the pipeline: takes frames, works on each and gives it on, in a thread of its own or in the caller's.

    take : the next frame, None at the end.   given : where frames go, if anywhere.   progress : told their number.

    Attributes
    ----------
    taking_seconds, seconds : wall time in `take` and in `work`.
    wait_seconds : in `take`, between the first frame and the last.
    error : the first error in a thread of its own.
    """

    def __init__(
        self, take: Callable[[], Frame | None], work: Callable[[Frame], object], given: Channel[Frame] | None,
        progress: Callable[[int], None] | None = None,
    ) -> None:  # fmt: skip
        self.taking_seconds = self.wait_seconds = self.seconds = 0.0
        self.frames = 0
        self.error: BaseException | None = None
        self._take, self._work, self._given, self._progress = take, work, given, progress

    def run(self) -> None:
        """Until there are no more frames, or nobody takes them any more."""
        while (frame := self._taken()) is not None:
            before = time.perf_counter()
            self._work(frame)
            self.seconds += time.perf_counter() - before
            if self._given is not None and not self._given.put(frame):
                return
            del frame
            self.frames += 1
            if self._progress is not None:
                self._progress(self.frames)
        if self._given is not None:
            self._given.close()

    def _taken(self) -> Frame | None:
        before = time.perf_counter()
        frame = self._take()
        seconds = time.perf_counter() - before
        self.taking_seconds += seconds
        self.wait_seconds += seconds if self.frames and frame is not None else 0.0
        return frame

    def start(self, name: str, cancel: Callable[[], None]) -> None:
        """Run in a thread; an error is kept, and cancels the others."""
        self._cancel = cancel
        self._thread = threading.Thread(target=self._guarded, name=name, daemon=True)
        self._thread.start()

    def _guarded(self) -> None:
        try:
            self.run()
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
    channels: list[Channel[Frame]] = [Channel(queue) for _ in range(3)]
    decoded, ready, worked = channels
    source = iter(frames)
    decoder = _Stage(lambda: next(source, None), lambda frame: None, decoded)
    looker = _Stage(decoded.get, ahead, ready) if ahead else None
    worker = _Stage(ready.get if ahead else decoded.get, work, worked, progress)
    encoder = _Stage(worked.get, sink.write, None)
    threads = {"decode": decoder} | ({"ahead": looker} if looker else {}) | {"encode": encoder}

    def cancel() -> None:
        for channel in channels:
            channel.close(discard=True)

    with contextlib.ExitStack() as stack:
        for name, stage in threads.items():
            stage.start(name, cancel)
            stack.callback(stage.join)  # every thread is waited for, even if Ctrl-C comes meanwhile
        try:
            worker.run()
        except BaseException:
            cancel()
            raise
    for stage in threads.values():
        if stage.error is not None:
            raise stage.error
    return ProcessStats(
        worker.frames, time.perf_counter() - start, decoder.taking_seconds, looker.seconds if looker else 0.0,
        worker.seconds, encoder.seconds, encoder.wait_seconds, tuple(frames.problems),
    )  # fmt: skip
