"""A live session: enrols the person where needed, then swaps their face.

Frames are covered for every output until there is a model of the person; the unchanged picture goes only to outputs
that show it to the person themselves (`OutputFrame.original`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from guise.aam.model import Identity
from guise.aam.recognition import same_person, signature
from guise.aam.training import TrainingError, TrainingOptions
from guise.app.drawing.look import LIVE, Look
from guise.app.enrolment.enrol import EnrolError
from guise.app.live.controls import Controls
from guise.app.live.enrolment import EnrolmentStatus, OnScreenEnrolment
from guise.app.live.face import CastMember, FaceResult, LiveFaces
from guise.app.live.options import LiveSettings
from guise.app.live.output import OutputFrame
from guise.app.live.overlay import draw_mesh
from guise.app.live.stats import PipelineStats
from guise.app.media import Frame
from guise.app.swapping.cover import cover_all
from guise.common.errors import Interrupted

Keep = Callable[[Identity], None]

_OWN = "Face {0} may be your own, and stays covered: choose it again (key {0}) to show it."
PROBLEM_RING_SHARE = 0.05  # of a new enrolment, up to which the problem with the previous one is shown


def forget(identity: Identity) -> None:
    """Discard a model."""


@dataclass(frozen=True)
class SessionConfig:
    """Settings of a live session.

    Parameters
    ----------
    identities : donors to choose from.
    person : model of the person at the camera; None to enrol them on screen.
    cast : instead of both, several people and the face of each; everybody else is covered.
    name : of the person, for a new model.
    keep : called with a new model.
    look : how faces are drawn.
    recording : returns whether the user is recording.
    notice : returns a sentence that the user should see now, or "".
    asks : whether a face that is the person's own is covered until they agree.
    """

    identities: Sequence[Identity]
    person: Identity | None = None
    cast: Sequence[CastMember] = ()
    name: str = "me"
    keep: Keep = forget
    look: Look = LIVE
    recording: Callable[[], bool] = lambda: False
    notice: Callable[[], str] = str
    asks: bool = True


class LiveSession:
    """Enrols, then swaps: a `guise.app.live.pipeline.FrameProcessor`."""

    def __init__(self, config: SessionConfig, controls: Controls) -> None:
        self._config, self._controls = config, controls
        cast = config.cast or ([CastMember(config.person, config.identities)] if config.person else [])
        self._faces = LiveFaces(cast, config.look) if cast else None
        if config.person is not None:
            self._ask_for_own(config.person)
        self._enrolment: BackgroundEnrolment | None = None
        self._restart_requested = threading.Event()

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """Change a frame in place."""
        settings = self._controls.settings
        if self._restart_requested.is_set():
            self._restart_requested.clear()
            self.close()
        if self._faces is None:
            return self._enrol(frame, arrived, stats, settings)
        original = frame.copy() if settings.side_by_side else None
        message = ""
        if self._controls.is_asking:
            settings, message = replace(settings, mode="off"), _OWN.format(settings.identity + 1)
        result = self._faces.process(frame, settings)
        return self._shown(frame, result, stats, arrived, message, original=original)

    def enrol(self) -> None:
        """Start a new enrolment with the next frame; from any thread."""
        self._restart_requested.set()

    def close(self) -> None:
        """Release the face and cancel the enrolment."""
        if self._faces is not None:
            self._faces.close()
        if self._enrolment is not None:
            self._enrolment.cancel()
        self._faces = self._enrolment = None

    def _enrol(
        self, frame: Frame, arrived: float, stats: PipelineStats, settings: LiveSettings
    ) -> OutputFrame:
        if self._enrolment is None:
            size = self._config.identities[0].reference.resolution
            self._enrolment = BackgroundEnrolment(self._config.name, TrainingOptions(resolution=size))
        status = self._enrolment.observe(frame)
        if self._enrolment.model is not None:
            self._ask_for_own(self._enrolment.model)
            self._config.keep(self._enrolment.model)
            member = CastMember(self._enrolment.model, self._config.identities)
            self._faces = LiveFaces([member], self._config.look)
            self._enrolment = None
        original = frame.copy()
        cover_all(frame, settings.style)
        if status.mesh is not None:
            draw_mesh(original, status.mesh)
            draw_mesh(frame, status.mesh)
        result = FaceResult("enrolling", status.mesh, 0.0, 1)
        return self._shown(frame, result, stats, arrived, status.sentence, status.ring, original)

    def _ask_for_own(self, person: Identity) -> None:
        """Have no key show the person's own face before they agree."""
        if self._config.asks:
            own, faces = signature(person), map(signature, self._config.identities)
            self._controls.ask_for(n for n, face in enumerate(faces) if same_person(own, face))

    def _shown(
        self, frame: Frame, result: FaceResult, stats: PipelineStats, arrived: float, message: str = "",
        ring: float | None = None, original: Frame | None = None,
    ) -> OutputFrame:  # fmt: skip
        message = message or self._config.notice()
        return OutputFrame(frame, result, stats, arrived, message, ring, self._config.recording(), original)


class BackgroundEnrolment:
    """An enrolment on screen: collects frames, then trains a model in a thread while frames go on.

    model : the trained model, when there is one.
    """

    def __init__(self, name: str, options: TrainingOptions) -> None:
        self.model: Identity | None = None
        self._name, self._options = name, options
        self._problem, self._share = "", 0.0
        self._thread: threading.Thread | None = None
        self._restart()

    def _restart(self) -> None:
        self._enrolment = OnScreenEnrolment(self._name, options=self._options)

    def observe(self, frame: Frame) -> EnrolmentStatus:
        """Take the next frame, before it is covered."""
        if self._thread is not None and self._thread.is_alive():
            return EnrolmentStatus(f"Training your model: {100 * self._share:.0f} %", 1.0, done=True)
        if self._thread is not None and self.model is None:  # it failed
            self._thread = None
            self._restart()
        status = self._enrolment.observe(frame)
        if status.done and self._thread is None:
            self._thread = threading.Thread(target=self._train, name="guise-live-enrol")
            self._thread.start()
        problem = f"{self._problem} " if status.ring < PROBLEM_RING_SHARE else ""
        return replace(status, sentence=problem + status.sentence)

    def cancel(self) -> None:
        """Cancel, and wait until the training has ended."""
        self._enrolment.cancel()
        if self._thread is not None:
            self._thread.join()

    def _train(self) -> None:
        try:
            self.model = self._enrolment.train(self._note_progress)
        except (EnrolError, TrainingError) as error:
            self._problem = f"That was not enough ({error})."
        except Interrupted:
            pass

    def _note_progress(self, stage: str, share: float) -> None:
        self._share = share
