"""A live run: from a capture through enrolment, if need be, and the face to the outputs.

What leaves for any output is covered until there is a model of the person; the picture as it came goes only to outputs
that show it to the person themselves (`Shown.original`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from guise.aam.model import Identity
from guise.aam.training import TrainingError, TrainingOptions
from guise.app.enrolment.enrol import EnrolError
from guise.app.live.controls import Controls, Settings
from guise.app.live.enrolment import OnScreenEnrolment
from guise.app.live.face import LiveFace, Look
from guise.app.live.output import Shown
from guise.app.live.overlay import draw_mesh
from guise.app.live.pipeline import Stats
from guise.app.media import Frame
from guise.app.swapping.cover import cover_all
from guise.app.swapping.options import Options
from guise.common.errors import Interrupted

Keep = Callable[[Identity], None]

JAW = 0.035  # face widths by which the face is drawn beyond the jaw, so that nothing of the real one shows
AGAIN = 0.05  # share of the ring up to which the reason of a new beginning is shown


def forget(identity: Identity) -> None:
    """Keep no model."""


@dataclass(frozen=True)
class Plan:
    """What a live run needs to know.

    Parameters
    ----------
    identities : whose faces can be shown.
    person : model of who is at the camera, or None: they are enrolled on the screen.
    name : of the person, for a model that is made.
    keep : takes a model that was made.
    options : how the engine draws.
    recording : says whether a file is being written that the user asked for.
    notice : a sentence that the user should see now, or "".
    """

    identities: Sequence[Identity]
    person: Identity | None = None
    name: str = "me"
    keep: Keep = forget
    options: Options = field(default_factory=lambda: Options(jaw=JAW))
    recording: Callable[[], bool] = lambda: False
    notice: Callable[[], str] = str


class LiveWork:
    """Works on each picture, see `guise.app.live.pipeline.Work`: enrols, then swaps."""

    def __init__(self, plan: Plan, controls: Controls) -> None:
        self._plan, self._controls = plan, controls
        self._face = LiveFace(plan.person, plan.identities, plan.options) if plan.person else None
        self._learner: Learner | None = None
        self._again = threading.Event()

    def step(self, frame: Frame, arrived: float, stats: Stats) -> Shown:
        """Change a frame in place."""
        settings = self._controls.settings
        if self._again.is_set():
            self._again.clear()
            self.close()
        if self._face is None:
            return self._enrol(frame, arrived, stats, settings)
        original = frame.copy() if settings.side_by_side else None
        look = self._face.step(frame, settings)
        return self._shown(frame, look, stats, arrived, original=original)

    def enrol(self) -> None:
        """Begin a new enrolment with the next picture; from any thread."""
        self._again.set()

    def close(self) -> None:
        """Release the face and give up what is learned."""
        if self._face is not None:
            self._face.close()
        if self._learner is not None:
            self._learner.cancel()
        self._face = self._learner = None

    def _enrol(self, frame: Frame, arrived: float, stats: Stats, settings: Settings) -> Shown:
        if self._learner is None:
            size = self._plan.identities[0].frame.resolution
            self._learner = Learner(self._plan.name, TrainingOptions(resolution=size))
        seen = self._learner.see(frame)
        if self._learner.made is not None:
            self._plan.keep(self._learner.made)
            self._face = LiveFace(self._learner.made, self._plan.identities, self._plan.options)
            self._learner = None
        original = frame.copy()
        cover_all(frame, settings.style)
        if seen.mesh is not None:
            draw_mesh(original, seen.mesh)
            draw_mesh(frame, seen.mesh)
        look = Look("enrolling", seen.mesh, 0.0, 1)
        return self._shown(frame, look, stats, arrived, seen.sentence, seen.ring, original)

    def _shown(
        self, frame: Frame, look: Look, stats: Stats, arrived: float, message: str = "",
        ring: float | None = None, original: Frame | None = None,
    ) -> Shown:  # fmt: skip
        message = message or self._plan.notice()
        return Shown(frame, look, stats, arrived, message, ring, self._plan.recording(), original)


@dataclass(frozen=True, eq=False)
class Progress:
    """What to show of an enrolment: a sentence, the share in [0, 1] of the ring, and the face's mesh or None."""

    sentence: str
    ring: float
    mesh: np.ndarray | None = None


class Learner:
    """An enrolment on the screen: frames are gathered, then a model is trained beside the pictures that go on.

    made : the model, when there is one.
    """

    def __init__(self, name: str, options: TrainingOptions) -> None:
        self.made: Identity | None = None
        self._name, self._options = name, options
        self._problem, self._share = "", 0.0
        self._thread: threading.Thread | None = None
        self._begin()

    def _begin(self) -> None:
        self._enrolment = OnScreenEnrolment(self._name, options=self._options)

    def see(self, frame: Frame) -> Progress:
        """Take the next frame, before it is covered."""
        if self._thread is not None and self._thread.is_alive():
            return Progress(f"Learning your face: {100 * self._share:.0f} %", 1.0)
        if self._thread is not None and self.made is None:  # it failed
            self._thread = None
            self._begin()
        step = self._enrolment.add(frame)
        if step.done and self._thread is None:
            self._thread = threading.Thread(target=self._train, name="guise-live-enrol")
            self._thread.start()
        points = None if step.face is None else step.face.points.astype(np.float64)
        problem = f"{self._problem} " if step.ring < AGAIN else ""
        return Progress(problem + step.sentence, step.ring, points)

    def cancel(self) -> None:
        """Give up, and wait until the training has."""
        self._enrolment.cancel()
        if self._thread is not None:
            self._thread.join()

    def _train(self) -> None:
        try:
            self.made = self._enrolment.train(self._progress)
        except (EnrolError, TrainingError) as error:
            self._problem = f"That was not enough ({error})."
        except Interrupted:
            pass

    def _progress(self, stage: str, share: float) -> None:
        self._share = share
