"""A run behind a page, from a camera to the browser; that of the page Live has recordings and snapshots."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

from guise.app.live.capture import Capture
from guise.app.live.controls import Controls
from guise.app.live.microphone import Microphone
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import FrameProcessor, Pipeline
from guise.app.live.recorder import Recordings, snapshot
from guise.app.live.session import LiveProcessor, SessionConfig
from guise.app.live.stats import PipelineStats
from guise.common.failures import explain, trace
from guise.common.threads import one_thread


class CameraRun:
    """A run in threads of its own from construction until `stop`, the capture's end or an error.

    Parameters
    ----------
    open_capture, make_processor : called in threads of the run.
    outputs : where the frames go, the first one is measured.
    wanted : called repeatedly; False ends the run.

    Attributes
    ----------
    notes : sentences for the user, oldest first.
    """

    def __init__(
        self, open_capture: Callable[[], Capture], make_processor: Callable[[], FrameProcessor],
        outputs: Sequence[Output], wanted: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self.notes: SimpleQueue[str] = SimpleQueue()
        self._open, self._make_processor, self._wanted = open_capture, make_processor, wanted
        self._latest = _LatestFrame()
        self._outputs = [*outputs, self._latest]
        self._pipeline: Pipeline | None = None
        self._stopped = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="guise-studio-live")
        self._thread.start()

    @property
    def stats(self) -> PipelineStats:
        """The pipeline's current figures."""
        return self._pipeline.stats if self._pipeline is not None else PipelineStats()

    @property
    def latest(self) -> OutputFrame | None:
        """The last frame that was shown, or None."""
        return self._latest.shown

    @property
    def running(self) -> bool:
        """Whether the run has not ended yet."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """End the run and wait until it has ended; from another thread."""
        with self._lock:
            self._stopped = True
            if self._pipeline is not None:
                self._pipeline.stop()
        self._thread.join()

    def _run(self) -> None:
        try:
            with closing(self._open()) as capture, one_thread():
                with self._lock:
                    if self._stopped:
                        return
                    self._pipeline = Pipeline(capture, self._make_processor, self._outputs, self._wanted)
                self._pipeline.run()
        except Exception as error:
            trace(error)
            self._say(explain(error)[0])

    def _say(self, sentence: str) -> None:
        """Add a sentence for the user."""
        self.notes.put(sentence)


class LiveRun(CameraRun):
    """A live session with recordings and snapshots.

    config, controls : see `guise.app.live.session`.   folder : for recordings and snapshots.
    microphone : the sound of recordings, or None.
    """

    def __init__(
        self, open_capture: Callable[[], Capture], config: SessionConfig, controls: Controls,
        outputs: Sequence[Output], folder: Path, wanted: Callable[[], bool] = lambda: True,
        microphone: Microphone | None = None,
    ) -> None:  # fmt: skip
        self._folder = folder
        self._recordings = Recordings(folder, say=self._say, microphone=microphone)
        config = replace(config, recording=lambda: self._recordings.seconds)
        super().__init__(
            open_capture, lambda: LiveProcessor(config, controls), [*outputs, self._recordings], wanted
        )

    @property
    def recording(self) -> bool:
        """Whether the user is recording."""
        return self._recordings.recording

    @property
    def recording_seconds(self) -> float | None:
        """For how long the user has been recording; None while they are not."""
        return self._recordings.seconds

    def toggle_recording(self) -> None:
        """Start or stop a recording."""
        self._recordings.toggle()

    def snapshot(self) -> Path | None:
        """Write the last frame to a file; None before the first frame."""
        return snapshot(self.latest.frame, self._folder) if self.latest is not None else None

    def recorded(self) -> list[Path]:
        """The complete recordings, oldest first."""
        return sorted(self._folder.glob("*.mp4"))

    def _say(self, sentence: str) -> None:
        """Without the folder, which is temporary."""
        super()._say(sentence.replace(f"{self._folder}/", ""))


class _LatestFrame(Output):
    """Keeps the last frame."""

    shown: OutputFrame | None = None

    def show(self, shown: OutputFrame) -> None:
        self.shown = shown
