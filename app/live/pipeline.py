"""Capture, processing and outputs, each in its own thread, with a one-frame slot between them: the latest frame wins.

The main thread pumps the outputs that need it.  The first error in any thread ends all of them and is raised once.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Protocol

from guise.app.live.capture import Capture
from guise.app.live.output import Output, OutputFrame
from guise.app.live.stats import PipelineMeter, PipelineStats
from guise.app.media import Frame
from guise.common.channel import Channel

IDLE_SECONDS = 0.02  # the main thread's sleep when no output needs it


class FrameProcessor(Protocol):
    """What is done with each frame; made, used and closed in the processing thread."""

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """Change the frame in place and describe what was done."""

    def close(self) -> None:
        """Release resources."""


class Pipeline:
    """Runs frames from a capture through a processor to outputs.

    Parameters
    ----------
    capture : Capture.   make_processor : makes the processor, in its thread.   outputs : at least one.
    pump : called repeatedly in the main thread; False ends the run.
    """

    def __init__(
        self, capture: Capture, make_processor: Callable[[], FrameProcessor], outputs: Sequence[Output],
        pump: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self._capture, self._make_processor, self._pump = capture, make_processor, pump
        self._channels = [_OutputChannel(output, self) for output in outputs]
        self._captured: Channel[tuple[Frame, float]] = Channel(latest=capture.paced)
        self._meter = PipelineMeter()
        self._errors: list[BaseException] = []
        self._ended = threading.Event()

    @property
    def stats(self) -> PipelineStats:
        """The current figures; from any thread."""
        skipped = sum(channel.slot.dropped for channel in self._channels)
        return self._meter.stats(self._capture.dropped + self._captured.dropped, skipped)

    def stop(self) -> None:
        """End the run soon; from any thread."""
        self._capture.stop()
        self._captured.close()

    def run(self) -> PipelineStats:
        """Run until the capture ends, the user closes an output, `pump` returns False, or an error."""
        here = [channel for channel in self._channels if channel.output.main_thread]
        threads = [
            threading.Thread(target=self._guarded, args=(target,), name=f"guise-live-{name}")
            for name, target in [
                ("capture", self._run_capture),
                ("processor", self._run_processor),
                *((f"output{n}", channel.run) for n, channel in enumerate(self._channels) if channel not in here),
            ]
        ]  # fmt: skip
        try:
            for channel in here:
                channel.output.open(self._capture.width, self._capture.height, self._capture.fps)
            for thread in threads:
                thread.start()
            self._pump_until_end(here)
        finally:
            self._end(here, [thread for thread in threads if thread.ident is not None])
        if self._errors:
            raise self._errors[0]
        return self.stats

    def presented(self, shown: OutputFrame, channel: _OutputChannel) -> None:
        """An output has shown a frame."""
        if channel is self._channels[0]:
            self._meter.count_presented(shown.arrived)

    def _pump_until_end(self, here: list[_OutputChannel]) -> None:
        while not self._ended.is_set():
            busy = False
            for channel in here:
                busy |= channel.show_waiting()
                if not channel.output.pump():
                    self.stop()
            if not self._pump():
                self.stop()
            if not here or not busy:
                self._ended.wait(0.001 if here else IDLE_SECONDS)
        for channel in here:
            channel.show_waiting()

    def _end(self, here: list[_OutputChannel], threads: list[threading.Thread]) -> None:
        self.stop()
        for channel in self._channels:
            if channel.output.main_thread:
                channel.slot.close()
        for thread in threads:
            thread.join()
        for channel in here:
            channel.output.close()

    def _run_capture(self) -> None:
        try:
            for frame in self._capture:
                self._captured.put((frame, self._capture.arrival(frame)))
        finally:
            self._captured.close()

    def _run_processor(self) -> None:
        try:
            processor = self._make_processor()
            try:
                while (captured := self._captured.get()) is not None:
                    self._process(processor, *captured)
            finally:
                processor.close()
        finally:
            for channel in self._channels:
                channel.slot.close()
            self._ended.set()

    def _process(self, processor: FrameProcessor, frame: Frame, arrived: float) -> None:
        shown = processor.process(frame, arrived, self.stats)
        self._meter.count_processed(shown.result.outcome)
        for channel in self._channels:
            channel.slot.put(shown)

    def _guarded(self, target: Callable[[], None]) -> None:
        try:
            target()
        except BaseException as error:
            self._errors.append(error)
            self.stop()
            self._ended.set()


class _OutputChannel:
    """An output and the slot from which it takes frames."""

    def __init__(self, output: Output, pipeline: Pipeline) -> None:
        self.output, self._pipeline = output, pipeline
        self.slot: Channel[OutputFrame] = Channel(latest=not output.lossless)

    def run(self) -> None:
        """Show frames in a thread of their own until no more come."""
        capture = self._pipeline._capture
        try:
            self.output.open(capture.width, capture.height, capture.fps)
            while (shown := self.slot.get()) is not None:
                self._show(shown)
        finally:
            self.slot.close()
            self.output.close()

    def show_waiting(self) -> bool:
        """Show the waiting frame; whether there was one."""
        shown = self.slot.get(timeout=0)
        if shown is not None:
            self._show(shown)
        return shown is not None

    def _show(self, shown: OutputFrame) -> None:
        self.output.show(shown)
        self._pipeline.presented(shown, self)
