"""`guise live`: chooses capture, model and outputs, runs the pipeline and reports."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guise.aam.model import Identity
from guise.app.enrolment.landmark_source import LandmarkSource
from guise.app.enrolment.source_person import source_person
from guise.app.live.capture import CameraCapture, Capture, FileCapture
from guise.app.live.controls import Controls
from guise.app.live.face import MAX_PEOPLE, CastMember
from guise.app.live.feeds import Program
from guise.app.live.options import LiveOptions
from guise.app.live.output import Output, OutputFrame
from guise.app.live.overlay import Overlay
from guise.app.live.pipeline import Pipeline
from guise.app.live.recorder import Recordings, VideoRecorder, snapshot
from guise.app.live.session import LiveProcessor, SessionConfig
from guise.app.live.stats import PipelineStats
from guise.app.live.window import Window
from guise.app.media.input import VideoInput
from guise.app.people import kept
from guise.app.swapping.donors import gallery, open_donor, open_face
from guise.app.swapping.report import SwapSettings
from guise.common.errors import OutputError
from guise.common.progress import Progress, Say
from guise.common.threads import one_thread

WINDOW, VIRTUAL_CAMERA = "window", "virtualcam"
NOTICE_SECONDS = 4.0  # for which a message stays in the picture


@dataclass(frozen=True)
class LiveReport:
    """What a run did: the files written for --output, and the pipeline's final figures."""

    files: tuple[str, ...]
    stats: PipelineStats

    def as_json(self) -> dict[str, Any]:
        """The report as a JSON object."""
        return {"files": list(self.files), **self.stats.as_json()}

    def __str__(self) -> str:
        """One line for a person to read."""
        s = self.stats
        where = "".join(f"{file}: " for file in self.files)
        did = ", ".join(f"{count} {name}" for name, count in sorted(s.outcomes.items())) or "nothing shown"
        return (
            f"{where}{s.frames} frames in {s.seconds:.1f} s: {did}; {s.dropped} dropped; "
            f"median latency {s.latency:.0f} ms, 95th percentile {s.latency_95:.0f} ms"
        )


class Snapshots(Output):
    """Writes the next frame to a file on request.

    Parameters
    ----------
    folder : for the files.   say : called with one sentence about each snapshot.
    """

    def __init__(self, folder: Path, say: Say) -> None:
        self._folder, self._say, self._wanted = folder, say, threading.Event()

    def take(self) -> None:
        """Request a snapshot of the next frame; from any thread."""
        self._wanted.set()

    def show(self, shown: OutputFrame) -> None:
        """Write the frame if a snapshot was requested."""
        if self._wanted.is_set():
            self._wanted.clear()
            try:
                self._say(f"Saved {snapshot(shown.frame, self._folder)}.")
            except OutputError as error:
                self._say(str(error))


class Notices:
    """Messages during a run: to the terminal, and for a few seconds in the picture."""

    def __init__(self, say: Say) -> None:
        self._say, self._last, self._until = say, "", 0.0

    def say(self, text: str) -> None:
        """Show a sentence; from any thread."""
        self._last, self._until = text, time.monotonic() + NOTICE_SECONDS
        self._say(text)

    def current(self) -> str:
        """The sentence to show now, or ""."""
        return self._last if time.monotonic() < self._until else ""


def run_live(
    options: LiveOptions, *, progress: Progress, say: Say, program: Program | None = None
) -> LiveReport:
    """Run until the input ends, the user quits or the program says so.

    program : what a program that calls gives and takes, in place of the camera and beside the outputs.

    Raises
    ------
    GuiseError
        For mistakes of the user.
    """
    _check(options)
    program = program or Program()
    notices = Notices(say)
    say = notices.say
    cast = [CastMember(open_face(who), [open_face(face)]) for who, face in options.cast.items()]
    identities = [open_face(face) for face in options.identities] or [open_donor(n) for n in gallery()]
    identities = [face for member in cast for face in member.faces] or identities
    controls = Controls(len(identities), options.settings)
    with contextlib.ExitStack() as stack, one_thread():
        capture = stack.enter_context(program.capture or _capture(options, say))
        recordings, snapshots = Recordings(Path.cwd(), options.encode, say), Snapshots(Path.cwd(), say)
        outputs = [_output(name, options, capture, controls, identities, say) for name in options.outputs]
        for output in outputs:
            output.check()
        outputs += [*program.outputs, *_sound(options, capture, say)]
        person = None if cast else _person(options, capture, identities[0], progress, say)
        config = SessionConfig(
            identities, person, cast, name=capture.name or "me", keep=lambda made: _keep(capture.name, made, say),
            look=options.look, recording=lambda: recordings.seconds, notice=notices.current,
            asks=capture.paced,
        )  # fmt: skip
        requests = _RequestHandler(config, controls, recordings, snapshots, say, program.stopped)
        pipeline = Pipeline(
            capture, requests.make_session, [*outputs, recordings, snapshots], requests.handle
        )
        try:
            stats = pipeline.run()
        except KeyboardInterrupt:  # a normal end, except for a file that must be complete
            if not capture.paced:
                raise
            stats = pipeline.stats
        for problem in capture.media.problems if isinstance(capture, FileCapture) else ():
            say(f"{capture.name}: {problem}")
    files = [
        str(output.path) for output in outputs if isinstance(output, VideoRecorder) and output.is_written
    ]
    return LiveReport(tuple(files), stats)


class _RequestHandler:
    """Carries out the user's requests, in the main thread."""

    def __init__(
        self,
        config: SessionConfig,
        controls: Controls,
        recordings: Recordings,
        snapshots: Snapshots,
        say: Say,
        stopped: threading.Event,
    ) -> None:
        self._config, self._controls, self._say, self._stopped = config, controls, say, stopped
        self._recordings, self._snapshots = recordings, snapshots
        self._session: LiveProcessor | None = None

    def make_session(self) -> LiveProcessor:
        """The session; called in the processing thread."""
        self._session = LiveProcessor(self._config, self._controls)
        return self._session

    def handle(self) -> bool:
        """Carry out pending requests; False to quit."""
        while not self._controls.requests.empty():
            request = self._controls.requests.get()
            if request == "quit":
                return False
            if request == "enrol" and self._config.cast:
                self._say(
                    "Other people are covered: to show a face on them, too, enroll them and name them with --map."
                )
            elif request == "enrol" and self._session is not None:
                self._session.enrol()
            if request == "record":
                self._recordings.toggle()
            if request == "snapshot":
                self._snapshots.take()
        return not self._stopped.is_set()


def _check(options: LiveOptions) -> None:
    """Raise OutputError for options that contradict each other."""
    if len(options.cast) > MAX_PEOPLE:
        raise OutputError(f"--map takes up to {MAX_PEOPLE} people live, got {len(options.cast)}")
    if len(set(options.outputs)) < len(options.outputs):
        raise OutputError("two --output options name the same place: give each only once")


def _capture(options: LiveOptions, say: Say) -> Capture:
    if options.input is None:
        return CameraCapture(options.camera, options.size, options.fps, say)
    if "://" in options.input:
        from guise.app.live.streams import StreamCapture

        return StreamCapture(options.input, say=say)
    is_watched = WINDOW in options.outputs or VIRTUAL_CAMERA in options.outputs
    return FileCapture(Path(options.input), loop=options.loop, paced=is_watched or options.loop)


def _output(
    name: str, options: LiveOptions, capture: Capture, controls: Controls, identities: Sequence[Identity], say: Say
) -> Output:  # fmt: skip
    if name == WINDOW:
        return Window(controls, Overlay([identity.name for identity in identities]))
    if name == VIRTUAL_CAMERA:
        from guise.app.live.virtualcam import VirtualCamera

        return VirtualCamera()
    once = isinstance(capture, FileCapture) and not options.loop
    media = capture.media if isinstance(capture, FileCapture) and once else None
    return VideoRecorder(
        Path(name), media=media, encode=options.encode, force=options.force,
        whole=not capture.paced, say=say if capture.paced else None,
    )  # fmt: skip


def _sound(options: LiveOptions, capture: Capture, say: Say) -> list[Output]:
    """The sound of a file that is shown in the window."""
    if WINDOW not in options.outputs or not isinstance(capture, FileCapture) or not capture.media.has_audio:
        return []
    from guise.app.live.sound import SoundOutput

    assert isinstance(capture.media, VideoInput)
    return [SoundOutput(capture.media, say)]


def _person(
    options: LiveOptions, capture: Capture, like: Identity, progress: Progress, say: Say
) -> Identity | None:
    """The model of the person in the picture: given, cached or made from the file; None: to be enrolled on screen."""
    if options.source is not None:
        return open_face(options.source)
    if isinstance(capture, FileCapture):
        settings = SwapSettings(keep_people=True, progress=progress, say=say)
        return source_person(capture.media, LandmarkSource(), like, settings, anew=options.enrol)
    known = None if options.enrol or not capture.name else kept.cached(capture.name, say)
    return known if known is not None and known.reference.id == like.reference.id else None


def _keep(camera: str, made: Identity, say: Say) -> None:
    if not camera:  # a program, which may show anybody
        return
    say(
        f"Saved your model in {kept.keep(camera, made)}. It is biometric data: guise people delete removes it, and "
        "--enroll makes a new one."
    )
