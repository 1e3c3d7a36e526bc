"""A live run behind a page: from a camera through the face to the browser, with recordings and snapshots."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue

from guise.app.live.capture import Capture
from guise.app.live.controls import Controls
from guise.app.live.output import Output, Shown
from guise.app.live.pipeline import Pipeline, Stats
from guise.app.live.recorder import Recordings, snapshot
from guise.app.live.session import LiveWork, Plan
from guise.common.failures import explain, trace
from guise.common.threads import one_thread


class Show:
    """Runs in threads of its own from the beginning until `stop`, the end of the capture, or an error.

    Parameters
    ----------
    open_capture : opens it, in such a thread.
    plan, controls : see `guise.app.live.session`.
    output : where the pictures go.
    folder : for recordings and snapshots.
    wanted : asked all the time; False ends it.

    Attributes
    ----------
    notes : sentences for the user, in the order in which they came.
    latest : what was shown last, or None.
    """

    def __init__(
        self, open_capture: Callable[[], Capture], plan: Plan, controls: Controls, output: Output, folder: Path,
        wanted: Callable[[], bool] = lambda: True,
    ) -> None:  # fmt: skip
        self.notes: SimpleQueue[str] = SimpleQueue()
        self._open, self._folder, self._wanted = open_capture, folder, wanted
        self._recordings, self._last = Recordings(folder, say=self._say), _Last()
        self._plan = replace(plan, recording=lambda: self._recordings.recording)
        self._controls, self._outputs = controls, [output, self._recordings, self._last]
        self._pipeline: Pipeline | None = None
        self._stopped = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="guise-studio-live")
        self._thread.start()

    @property
    def stats(self) -> Stats:
        """As they are now."""
        return self._pipeline.stats if self._pipeline is not None else Stats()

    @property
    def latest(self) -> Shown | None:
        """What was shown last."""
        return self._last.shown

    @property
    def recording(self) -> bool:
        """Whether a file is being written."""
        return self._recordings.recording

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._thread.is_alive()

    def record(self) -> None:
        """Begin or end a recording."""
        self._recordings.toggle()

    def snapshot(self) -> Path | None:
        """Write what was shown last to a file; None before the first picture."""
        return snapshot(self.latest.frame, self._folder) if self.latest is not None else None

    def recorded(self) -> list[Path]:
        """The recordings that are complete, oldest first."""
        return sorted(self._folder.glob("*.mp4"))

    def stop(self) -> None:
        """End, and wait for it; from another thread."""
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
                    self._pipeline = Pipeline(capture, self._work, self._outputs, self._wanted)
                self._pipeline.run()
        except Exception as error:
            trace(error)
            self._say(explain(error)[0])

    def _work(self) -> LiveWork:
        return LiveWork(self._plan, self._controls)

    def _say(self, sentence: str) -> None:
        """Note a sentence, without the folder, which is nothing to the user."""
        self.notes.put(sentence.replace(f"{self._folder}/", ""))


class _Last(Output):
    """Keeps what was shown last."""

    shown: Shown | None = None

    def show(self, shown: Shown) -> None:
        self.shown = shown
