"""`guise rig live`: a camera, file or stream to a receiver of the VMC protocol, a window and a file."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from guise.aam.rig.calibration import load, save
from guise.aam.rig.coefficients import RigCalibration
from guise.app.live.capture import CameraCapture, Capture, FileCapture
from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult
from guise.app.live.options import LiveSettings
from guise.app.live.output import Output, OutputFrame
from guise.app.live.pipeline import Pipeline
from guise.app.live.stats import PipelineStats
from guise.app.live.streams import StreamCapture
from guise.app.media import Frame
from guise.app.rig.asking import AskedCalibration
from guise.app.rig.clip import RigReport, check_rig_output, write_rig_file
from guise.app.rig.curves import CurveRecorder
from guise.app.rig.following import RigFollower
from guise.app.rig.head import open_head
from guise.app.rig.options import RigLiveOptions
from guise.app.rig.preview import RigWindow
from guise.app.rig.shown import RigFrame
from guise.app.rig.vmc import VmcSender
from guise.common.errors import GuiseError, OutputError
from guise.common.files import require_free, write_whole
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread


@dataclass(frozen=True)
class RigLiveReport:
    """What a run did: frames sent to a receiver, the file written, and the pipeline's figures."""

    sent: int
    file: RigReport | None
    milliseconds: float
    stats: PipelineStats

    def as_json(self) -> dict[str, Any]:
        """The report as a JSON object."""
        file = None if self.file is None else self.file.as_json()
        return {"sent": self.sent, "file": file, "milliseconds": self.milliseconds, **self.stats.as_json()}

    def __str__(self) -> str:
        """For a person to read."""
        s = self.stats
        said = (
            f"{s.frames} frames in {s.seconds:.1f} s, {s.outcomes.get('shown', 0)} with a face; {self.sent} sent; "
            f"{s.dropped} dropped; median latency {s.latency:.0f} ms; "
            f"{self.milliseconds:.1f} ms a frame beyond landmarks"
        )
        return said if self.file is None else f"{said}\n{self.file}"


class RigControls(Controls):
    """Keys of the window: C calibrates, M mirrors, Q ends.   asked : set when a calibration is wished for."""

    def __init__(self, *, mirror: bool) -> None:
        super().__init__(settings=LiveSettings(mirror=mirror))
        self.asked = threading.Event()

    def press(self, key: str) -> None:
        """Handle a key."""
        if key == "c":
            self.asked.set()
        elif key in ("m", "q", "escape"):
            super().press(key)


class RigProcessor:
    """Finds coefficients, and calibrates when asked: a `guise.app.live.pipeline.FrameProcessor`.

    asked : set when a calibration is wished for.   keep : called with each.
    """

    def __init__(
        self, calibration: RigCalibration | None, asked: threading.Event, keep: Path | None, say: Say
    ) -> None:
        self.calibration, self.follower = calibration, RigFollower(calibration)
        self.recorder = CurveRecorder()
        self._asked, self._keep, self._say = asked, keep, say
        self._asking: AskedCalibration | None = None
        self._last = ""

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """The coefficients of a frame, which stays as it is."""
        rgb, seconds = frame.rgb(), float(frame.seconds)
        face = self.follower.find(rgb)
        points = None if face is None else face.points
        if self._asked.is_set():
            self._asked.clear()
            self._asking = AskedCalibration()
        message = "" if self._asking is None else self._calibrate(self._asking.see(rgb, points, seconds))
        found = None if points is None else self.follower.estimate(rgb, points, seconds)
        if self._asking is None:
            self.recorder.add(seconds, found)
        result = (
            FaceResult("lost") if face is None else FaceResult("shown", confidence=float(face.confidence))
        )
        return RigFrame(
            frame, result, stats, arrived, message, coefficients=found, points=points,
            calibrated=self.calibration is not None,
        )  # fmt: skip

    def close(self) -> None:
        """Nothing is held."""

    def _calibrate(self, sentence: str) -> str:
        """Say what is asked for, and use and keep what was learned."""
        asking = self._asking
        assert asking is not None
        if sentence != self._last and sentence:
            self._say(sentence)
        self._last = sentence
        if sentence:
            return sentence
        self._asking = None
        if asking.result is None:
            self._say(asking.problem)
            return asking.problem
        self.calibration = asking.result
        self.follower.calibrate(asking.result)
        self._say("Calibrated.")
        if self._keep is not None:
            made = asking.result
            write_whole(self._keep, lambda part: save(made, part))
            self._say(f"Saved the calibration in {self._keep}.")
        return ""


def run_rig_live(
    options: RigLiveOptions, *, progress: Progress = silent, say: Say = mute,
    stopped: threading.Event | None = None, outputs: Sequence[Output] = (),
) -> RigLiveReport:  # fmt: skip
    """Run until the input ends, the user quits or `stopped` is set; an interrupt is a normal end, too.

    outputs : besides those of the options.

    Raises
    ------
    GuiseError
        For mistakes of the user.
    """
    start = time.perf_counter()
    if not (options.window or options.vmc or options.output or outputs):
        raise OutputError(
            "nothing would be shown or sent: give --vmc HOST:PORT or --output FILE, or leave out --no-window"
        )
    is_glb = options.output is not None and options.output.suffix.lower() == ".glb"
    if options.output is not None:
        check_rig_output(
            options.output, [Path(options.input)] if options.input else [], options.head, force=options.force
        )
    elif options.head is not None:
        raise OutputError("--head is for --output OUT.glb, which shows it: give that, or leave it out")
    calibration = _known(options)
    head = open_head(options.head, options.unit, progress, say) if is_glb else None
    controls, stopped = RigControls(mirror=options.mirror), stopped or threading.Event()
    with contextlib.ExitStack() as stack, one_thread():
        own: list[Output] = [*outputs]
        sender = VmcSender(options.vmc) if options.vmc else None
        if sender is not None:
            stack.callback(sender.close)
            own.insert(0, sender)
        if options.window:
            own.append(RigWindow(controls))
        for output in own:
            output.check()
        capture = stack.enter_context(_capture(options, say))
        if calibration is None and options.input is None and (options.window or options.calibration):
            controls.asked.set()
        processor = RigProcessor(calibration, controls.asked, options.calibration, say)
        pipeline = Pipeline(
            capture, lambda: processor, own or [_Nothing()], lambda: _goes_on(controls, stopped)
        )
        with contextlib.suppress(KeyboardInterrupt):
            pipeline.run()
        stats = pipeline.stats
    written = None
    if options.output is not None:
        if not processor.recorder.with_face:
            raise GuiseError(f"no face was seen, and {options.output} was not written")
        written = write_rig_file(
            options.output, processor.recorder, head, processor.calibration, processor.follower, start, ()
        )
    return RigLiveReport(0 if sender is None else sender.sent, written, processor.follower.per_frame, stats)


class _Nothing(Output):
    """Where only a file is written, when all has ended."""

    lossless = True

    def show(self, shown: OutputFrame) -> None:
        """Do nothing."""


def _goes_on(controls: Controls, stopped: threading.Event) -> bool:
    while not controls.requests.empty():
        if controls.requests.get() == "quit":
            return False
    return not stopped.is_set()


def _known(options: RigLiveOptions) -> RigCalibration | None:
    """What a file of an earlier run says; None where it is to be made."""
    if options.calibration is None:
        return None
    if options.calibration.exists():
        return load(options.calibration)
    if options.input is not None:
        raise OutputError(f"{options.calibration} does not exist: make it at the camera, without --input")
    if options.calibration.suffix.lower() != ".npz":
        raise OutputError(f"{options.calibration} must end in .npz")
    require_free(options.calibration, force=False)
    return None


def _capture(options: RigLiveOptions, say: Say) -> Capture:
    if options.input is None:
        return CameraCapture(options.camera, options.size, options.fps, say)
    if "://" in options.input:
        return StreamCapture(options.input, say=say)
    return FileCapture(Path(options.input), paced=options.window or options.vmc is not None)
