"""Pass a video through `make`, which gives another picture for each frame, while decoding and encoding go on."""

from __future__ import annotations

from collections.abc import Callable

from guise.app.media import Frame, MediaInput, ProcessStats, Sink, process


class _Exchange(Sink):
    """Takes the source's frames and writes the pictures that were made for them."""

    def __init__(self, sink: Sink) -> None:
        super().__init__(sink.path, force=True)
        self._sink = sink
        self.made: dict[int, Frame] = {}

    def write(self, frame: Frame) -> None:
        self._sink.write(self.made.pop(frame.index))


def remake(
    source: MediaInput,
    sink: Sink,
    make: Callable[[Frame], Frame],
    *,
    progress: Callable[[int], None] | None = None,
) -> ProcessStats:
    """As `guise.app.media.process`, with new pictures in place of changed ones; they take over the frames' times."""
    exchange = _Exchange(sink)

    def work(frame: Frame) -> None:
        made = make(frame)
        made.pts, made.time_base, made.index = frame.pts, frame.time_base, frame.index
        made.name, made.duration = frame.name, frame.duration
        exchange.made[frame.index] = made

    return process(source, exchange, work, progress=progress)
