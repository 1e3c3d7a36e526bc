"""`guise live`: which capture, whose model, which outputs; and the report of a run."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from guise.aam.model import Identity
from guise.app.enrolment.enrol import LandmarkSource
from guise.app.live.capture import CameraCapture, Capture, FileCapture, Say
from guise.app.live.controls import Controls, Settings
from guise.app.live.output import Output, Shown
from guise.app.live.overlay import Overlay
from guise.app.live.pipeline import Pipeline, Stats
from guise.app.live.recorder import Recorder, Recordings, snapshot
from guise.app.live.session import JAW, LiveWork, Plan
from guise.app.live.window import Window
from guise.app.media import EncodeOptions
from guise.app.media.source import VideoSource
from guise.app.people import cache as models
from guise.app.swapping.donors import gallery, open_donor
from guise.app.swapping.options import Options
from guise.app.swapping.run import Settings as RunSettings
from guise.app.swapping.run import person_in
from guise.common.errors import OutputError
from guise.common.progress import Progress
from guise.common.threads import one_thread

WINDOW, VIRTUAL = "window", "virtualcam"
STAYS = 4.0  # seconds for which a sentence is shown


@dataclass(frozen=True)
class LiveOptions:
    """What the user asks of `guise live`.

    Parameters
    ----------
    source : a file or the address of a stream, or None for the camera.
    camera : its number.
    identities : models whose faces are shown; none: the gallery's.
    person : model of who is at the camera, or None.
    outputs : "window", "virtualcam" or files.
    headless : no window, every frame of a file, as fast as it goes.
    size, fps : asked of the camera.   loop : play a file again and again.
    enrol : make a new model of the person though there is one.
    settings : to begin with.   options : how the engine draws.   encode, force : of files.
    """

    source: str | None = None
    camera: int = 0
    identities: Sequence[Path] = ()
    person: Path | None = None
    outputs: Sequence[str] = (WINDOW,)
    headless: bool = False
    size: tuple[int, int] = (1280, 720)
    fps: float = 30.0
    loop: bool = False
    enrol: bool = False
    settings: Settings = field(default_factory=Settings)
    options: Options = field(default_factory=lambda: Options(jaw=JAW))
    encode: EncodeOptions = field(default_factory=EncodeOptions)
    force: bool = False


@dataclass(frozen=True)
class LiveReport:
    """What a run did: the files of --output that were written, and the figures of the pipeline at its end."""

    files: tuple[str, ...]
    stats: Stats

    def as_json(self) -> dict[str, Any]:
        """The report as JSON holds it."""
        return {"files": list(self.files), **self.stats.as_json()}

    def __str__(self) -> str:
        """One line for a person to read."""
        s = self.stats
        did = ", ".join(f"{count} {name}" for name, count in sorted(s.outcomes.items())) or "nothing shown"
        return (
            f"{s.frames} frames in {s.seconds:.1f} s: {did}; {s.dropped} dropped; latency {s.latency:.0f} ms, "
            f"95 % {s.latency_95:.0f} ms"
        )


class Snapshots(Output):
    """Writes the next picture to a file when it is asked to.

    Parameters
    ----------
    folder : in which.   say : called with what happened.
    """

    def __init__(self, folder: Path, say: Say) -> None:
        self._folder, self._say, self._wanted = folder, say, threading.Event()

    def take(self) -> None:
        """Of the next picture; from any thread."""
        self._wanted.set()

    def show(self, shown: Shown) -> None:
        """Look at a picture."""
        if self._wanted.is_set():
            self._wanted.clear()
            try:
                self._say(f"Snapshot {snapshot(shown.frame, self._folder)}.")
            except OutputError as error:
                self._say(str(error))


class Notices:
    """What is said while it runs: to the terminal, and for some seconds in the picture."""

    def __init__(self, say: Say) -> None:
        self._say, self._last, self._until = say, "", 0.0

    def say(self, text: str) -> None:
        """Say a sentence; from any thread."""
        self._last, self._until = text, time.monotonic() + STAYS
        self._say(text)

    def current(self) -> str:
        """What is to be seen now."""
        return self._last if time.monotonic() < self._until else ""


def run_live(options: LiveOptions, *, progress: Progress, say: Say) -> LiveReport:
    """Run until the source ends or the user does.

    Raises
    ------
    OutputError, MediaError, ModelError, RendererError, EnrolError
        For a user's mistake.
    """
    _check(options)
    notices = Notices(say)
    say = notices.say
    identities = [Identity.load(path) for path in options.identities] or [open_donor(n) for n in gallery()]
    controls = Controls(len(identities), options.settings)
    with contextlib.ExitStack() as stack, one_thread():
        capture = stack.enter_context(_capture(options, say))
        recordings, snapshots = Recordings(Path.cwd(), options.encode, say), Snapshots(Path.cwd(), say)
        outputs = [_output(name, options, capture, controls, identities, say) for name in options.outputs]
        outputs += _sound(options, capture, say)
        person = _person(options, capture, identities[0], progress, say)
        plan = Plan(
            identities, person, name=capture.name, keep=lambda made: _keep(_key(options, capture), made, say),
            options=options.options, recording=lambda: recordings.recording, notice=notices.current,
        )  # fmt: skip
        session = _Session(plan, controls, recordings, snapshots)
        pipeline = Pipeline(capture, session.make, [*outputs, recordings, snapshots], session.pump)
        try:
            stats = pipeline.run()
        except KeyboardInterrupt:  # as good an end as any, but for a file that is to be whole
            if options.headless:
                raise
            stats = pipeline.stats
    files = [str(output.path) for output in outputs if isinstance(output, Recorder)]
    return LiveReport(tuple(files), stats)


class _Session:
    """Answers what the user asks for, in the main thread."""

    def __init__(self, plan: Plan, controls: Controls, recordings: Recordings, snapshots: Snapshots) -> None:
        self._plan, self._controls = plan, controls
        self._recordings, self._snapshots = recordings, snapshots
        self._work: LiveWork | None = None

    def make(self) -> LiveWork:
        """The work, in its thread."""
        self._work = LiveWork(self._plan, self._controls)
        return self._work

    def pump(self) -> bool:
        """Do what was asked for; False to end."""
        while not self._controls.requests.empty():
            asked = self._controls.requests.get()
            if asked == "quit":
                return False
            if asked == "enrol" and self._work is not None:
                self._work.enrol()
            if asked == "record":
                self._recordings.toggle()
            if asked == "snapshot":
                self._snapshots.take()
        return True


def _check(options: LiveOptions) -> None:
    """Raise OutputError for outputs that do not go together."""
    files = [name for name in options.outputs if name not in (WINDOW, VIRTUAL)]
    if options.headless and (options.source is None or not files or len(files) < len(options.outputs)):
        raise OutputError(
            "--headless needs --source FILE and writes files: add --output OUT.mp4, and no window"
        )
    if options.headless and options.loop:
        raise OutputError("--headless ends with the file: leave out --loop")
    if len(set(options.outputs)) < len(options.outputs):
        raise OutputError("each --output must be given once: two go to the same place")


def _capture(options: LiveOptions, say: Say) -> Capture:
    if options.source is None:
        return CameraCapture(options.camera, options.size, options.fps, say)
    if "://" in options.source:
        from guise.app.live.streams import StreamCapture

        return StreamCapture(options.source, say=say)
    return FileCapture(Path(options.source), loop=options.loop, paced=not options.headless)


def _output(
    name: str, options: LiveOptions, capture: Capture, controls: Controls, identities: Sequence[Identity], say: Say
) -> Output:  # fmt: skip
    if name == WINDOW:
        return Window(controls, Overlay([identity.name for identity in identities]))
    if name == VIRTUAL:
        from guise.app.live.virtualcam import VirtualCamera

        return VirtualCamera()
    once = isinstance(capture, FileCapture) and not options.loop
    source = capture.source if isinstance(capture, FileCapture) and once else None
    return Recorder(
        Path(name), source=source, encode=options.encode, force=options.force,
        whole=options.headless, say=None if options.headless else say,
    )  # fmt: skip


def _sound(options: LiveOptions, capture: Capture, say: Say) -> list[Output]:
    """The sound of a file that is seen in the window."""
    if WINDOW not in options.outputs or not isinstance(capture, FileCapture) or not capture.source.has_audio:
        return []
    from guise.app.live.sound import Sound

    assert isinstance(capture.source, VideoSource)
    return [Sound(capture.source, say)]


def _person(
    options: LiveOptions, capture: Capture, like: Identity, progress: Progress, say: Say
) -> Identity | None:
    """The model of who is in the picture: given, kept from before, or made from the file; None: on the screen."""
    if options.person is not None:
        return Identity.load(options.person)
    known = None if options.enrol else models.cached(_key(options, capture), say)
    if known is not None and known.frame.id == like.frame.id:
        return known
    if not isinstance(capture, FileCapture):
        return None
    made = person_in(
        capture.source, LandmarkSource(), like, replace(RunSettings(), progress=progress, say=say)
    )
    models.keep(_key(options, capture), made)
    return made


def _key(options: LiveOptions, capture: Capture) -> str:
    return models.file_key(capture.source.path) if isinstance(capture, FileCapture) else capture.name


def _keep(key: str, made: Identity, say: Callable[[str], None]) -> None:
    say(f"your model is kept in {models.keep(key, made)}; --enrol makes a new one")
