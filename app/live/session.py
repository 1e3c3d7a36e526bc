"""A live session: enrols the person where needed, and swaps their face from the first second on.

A few frames are enough for a model that swaps; it is trained anew as more have been seen, and the last one is kept.
Frames are covered for every output until there is a first model; the unchanged picture goes only to outputs that show
it to the person themselves (`OutputFrame.original`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

from guise.aam.model import Identity
from guise.aam.recognition import same_person, signature
from guise.aam.training import LIMITS, Observation, TrainingError, TrainingOptions
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
GROWTH = 4.0  # by which an enrolment has grown when its model is trained anew
QUICK_PICTURES = 2  # of a model that is soon trained anew; its detail takes half of the time otherwise
PROBLEM_RING_SHARE = 0.05  # of a new enrolment, up to which the problem with the previous one is shown


def forget(identity: Identity) -> None:
    """Do nothing with a model."""


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
    meet : called with every model before it is used: the person's, or those that an enrolment makes of them.
    look : how faces are drawn.
    recording : returns for how many seconds the user has been recording, or None.
    notice : returns a sentence that the user should see now, or "".
    asks : whether a face that is the person's own is covered until they agree.
    """

    identities: Sequence[Identity]
    person: Identity | None = None
    cast: Sequence[CastMember] = ()
    name: str = "me"
    keep: Keep = forget
    meet: Keep = forget
    look: Look = LIVE
    recording: Callable[[], float | None] = lambda: None
    notice: Callable[[], str] = str
    asks: bool = True


class LiveProcessor:
    """Enrols, then swaps: a `guise.app.live.pipeline.FrameProcessor`."""

    def __init__(self, config: SessionConfig, controls: Controls) -> None:
        self._config, self._controls = config, controls
        self._faces: LiveFaces | None = LiveFaces(config.cast, config.look) if config.cast else None
        if config.person is not None:
            self._know(config.person)
        self._enrolment: BackgroundEnrolment | None = None
        self._restart_requested = threading.Event()

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """Change a frame in place."""
        settings = self._controls.settings
        if self._restart_requested.is_set():
            self._restart_requested.clear()
            self.close()
        status = self._enrol(frame) if self._enrolment is not None or self._faces is None else None
        original = frame.copy() if settings.side_by_side or status is not None else None
        result, message = self._hide(frame, settings)
        shown = OutputFrame(
            frame, result, stats, arrived, message, recording=self._config.recording(), original=original
        )
        if status is not None:
            shown = _with_status(shown, status)
        return replace(shown, message=shown.message or self._config.notice())

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

    def _hide(self, frame: Frame, settings: LiveSettings) -> tuple[FaceResult, str]:
        """Swap or cover, in place; and what there is to say about it."""
        if self._faces is None:
            cover_all(frame, settings.style)
            return FaceResult("enrolling", None, 0.0, 1), ""
        message = ""
        if self._controls.is_asking:
            settings, message = replace(settings, mode="off"), _OWN.format(settings.identity + 1)
        return self._faces.process(frame, settings), message

    def _enrol(self, frame: Frame) -> EnrolmentStatus:
        """Show the enrolment a frame, and use the model that it has made."""
        if self._enrolment is None:
            size = self._config.identities[0].reference.resolution
            self._enrolment = BackgroundEnrolment(self._config.name, TrainingOptions(resolution=size))
        status = self._enrolment.observe(frame)
        if (model := self._enrolment.new_model()) is not None:
            self._know(model)
            if self._enrolment.is_complete:
                self._config.keep(model)
                self._enrolment = None
        return status

    def _know(self, person: Identity) -> None:
        """Swap a person by their model from now on; no key shows their own face before they agree."""
        self._config.meet(person)
        if self._config.asks:
            own, faces = signature(person), map(signature, self._config.identities)
            self._controls.ask_for(n for n, face in enumerate(faces) if same_person(own, face))
        if self._faces is not None:
            self._faces.close()
        self._faces = LiveFaces([CastMember(person, self._config.identities)], self._config.look)


def _with_status(shown: OutputFrame, status: EnrolmentStatus) -> OutputFrame:
    """A frame with what there is to see and to say about the enrolment."""
    result = shown.result
    if status.mesh is not None:
        if shown.original is not None:
            draw_mesh(shown.original, status.mesh)
        result = result if result.mesh is not None else replace(result, mesh=status.mesh)
    message = status.sentence or shown.message
    return replace(shown, result=result, message=message, ring=status.ring, missing=status.missing)


class BackgroundEnrolment:
    """An enrolment on screen: collects frames, and trains models of them in a thread while frames go on.

    is_complete : the latest model is of a whole enrolment.
    """

    def __init__(self, name: str, options: TrainingOptions) -> None:
        self.is_complete = False
        self._name, self._options = name, options
        self._model: Identity | None = None
        self._problem, self._share = "", 0.0
        self._thread: threading.Thread | None = None
        self._restart()

    def _restart(self) -> None:
        self._enrolment = OnScreenEnrolment(self._name, options=self._options)
        self._trained = 0.0  # ring up to which there was a training

    def observe(self, frame: Frame) -> EnrolmentStatus:
        """Take the next frame, before it is changed."""
        is_training = self._thread is not None and self._thread.is_alive()
        if is_training and self._trained >= 1:
            return EnrolmentStatus(f"Training your model: {100 * self._share:.0f} %", 1.0, done=True)
        if not is_training and self._trained >= 1 and not self.is_complete:  # it failed
            self._restart()
        status = self._enrolment.observe(frame)
        self._trained = min(self._trained, status.ring)  # somebody else has come
        if not is_training and self._is_due(status.ring):
            self._begin(status.ring)
        problem = f"{self._problem} " if status.ring < PROBLEM_RING_SHARE else ""
        return replace(status, sentence=problem + status.sentence)

    def new_model(self) -> Identity | None:
        """A model that is better than the one that was given before, or None."""
        model, self._model = self._model, None
        return model

    def cancel(self) -> None:
        """Cancel, and wait until the training has ended."""
        self._enrolment.cancel()
        if self._thread is not None:
            self._thread.join()

    def _is_due(self, ring: float) -> bool:
        """Whether so much more has been seen since the last training that another one is worth its time."""
        if self._trained == 0:
            return len(self._enrolment.frames()) >= LIMITS.min_frames
        return ring > self._trained and (ring >= 1 or ring >= GROWTH * self._trained)

    def _begin(self, ring: float) -> None:
        self._trained = ring
        frames = self._enrolment.frames(None if ring >= 1 else QUICK_PICTURES)
        work = partial(self._train, frames, is_last=ring >= 1)
        self._thread = threading.Thread(target=work, name="guise-live-enrol")
        self._thread.start()

    def _train(self, frames: Sequence[Observation], *, is_last: bool) -> None:
        try:
            model = self._enrolment.train(self._note_progress, frames)
        except (EnrolError, TrainingError) as error:
            if is_last:
                self._problem = f"That was not enough ({error})."
            else:
                self._trained = 0.0
        except Interrupted:
            pass
        else:
            self.is_complete, self._model = is_last, model

    def _note_progress(self, stage: str, share: float) -> None:
        self._share = share
