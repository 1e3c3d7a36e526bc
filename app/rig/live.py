"""`guise rig live`: a camera, file or stream to a receiver of the VMC protocol, a window and a file."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from guise.aam.rig.calibration import load, save
from guise.aam.rig.coefficients import Coefficients, RigCalibration
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
from guise.app.rig.clip import RigReport, check_rig_output, open_shown_head, write_rig_file
from guise.app.rig.curves import CurveRecorder
from guise.app.rig.following import RigFollower
from guise.app.rig.options import RigLiveOptions
from guise.app.rig.preview import RigWindow
from guise.app.rig.shown import RigFrame
from guise.app.rig.turns import turn_beside
from guise.app.rig.vmc import VmcSender
from guise.common.arrays import F64
from guise.common.errors import GuiseError, OutputError
from guise.common.files import require_free, write_whole
from guise.common.progress import Progress, Say, mute, silent
from guise.common.threads import one_thread

SENTENCE_SECONDS = 3.0  # for which a sentence is shown


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
    """Keys: C calibrates, H has the head look straight ahead, M mirrors, Q ends.

    asked, centred : set when a calibration, or a head that looks straight ahead as it is held now, is wished for.
    """

    def __init__(self, *, mirror: bool) -> None:
        super().__init__(settings=LiveSettings(mirror=mirror))
        self.asked, self.centred = threading.Event(), threading.Event()

    def press(self, key: str) -> None:
        """Handle a key."""
        if key == "c":
            self.asked.set()
        elif key == "h":
            self.centred.set()
        elif key in ("m", "q", "escape"):
            super().press(key)


class CurveOutput(Output):
    """Records the coefficients of what is shown, but for calibrations.   recorder : None while nothing is recorded."""

    lossless = True

    def __init__(self, recorder: CurveRecorder | None = None) -> None:
        self.recorder = recorder

    def show(self, shown: OutputFrame) -> None:
        """Take a frame."""
        assert isinstance(shown, RigFrame)
        if (recorder := self.recorder) is not None and not shown.calibrating:
            recorder.add(float(shown.frame.seconds), shown.coefficients)


class RigProcessor:
    """Finds coefficients, and calibrates when asked: a `guise.app.live.pipeline.FrameProcessor`.

    controls : the user's wishes.   keep : called with each calibration.   smooth : over the frames so far.
    """

    def __init__(
        self, calibration: RigCalibration | None, controls: RigControls, keep: Callable[[RigCalibration], None],
        say: Say = mute, *, smooth: bool = True,
    ) -> None:  # fmt: skip
        self.calibration, self.follower = calibration, RigFollower(calibration, smooth=smooth)
        self._controls, self._keep, self._say = controls, keep, say
        self._asking: AskedCalibration | None = None
        self._message, self._until = "", -math.inf
        self._ahead: F64 | None = None  # the turn of a head that looks straight ahead

    def process(self, frame: Frame, arrived: float, stats: PipelineStats) -> OutputFrame:
        """The coefficients of a frame, which stays as it is."""
        rgb, seconds = frame.rgb(), float(frame.seconds)
        face = self.follower.find(rgb)
        points = None if face is None else face.points
        if self._controls.asked.is_set():
            self._controls.asked.clear()
            self._asking = AskedCalibration()
        if self._asking is not None:
            self._tell(self._calibrate(self._asking.see(rgb, points, seconds)), seconds)
        found = None if points is None else self._ahead_of(self.follower.estimate(rgb, points, seconds))
        result = (
            FaceResult("lost") if face is None else FaceResult("shown", confidence=float(face.confidence))
        )
        return RigFrame(
            frame, result, stats, arrived, self._message if seconds < self._until else "", coefficients=found,
            points=points, calibrated=self.calibration is not None, calibrating=self._asking is not None,
        )  # fmt: skip

    def close(self) -> None:
        """Nothing is held."""

    def _ahead_of(self, found: Coefficients) -> Coefficients:
        """With the head's turn beside that in which the user looked straight ahead."""
        if self._controls.centred.is_set():
            self._controls.centred.clear()
            self._ahead = found.head
        return found if self._ahead is None else found._replace(head=turn_beside(found.head, self._ahead))

    def _tell(self, sentence: str, seconds: float) -> None:
        """Show a sentence for a while, and say it once."""
        if sentence != self._message:
            self._say(sentence)
        self._message, self._until = sentence, seconds + SENTENCE_SECONDS

    def _calibrate(self, sentence: str) -> str:
        """What to say: what is asked for, or what came of it, which is used and kept."""
        asking = self._asking
        assert asking is not None
        if sentence:
            return sentence
        self._asking = None
        if asking.result is None:
            return asking.problem
        self.calibration = asking.result
        self.follower.calibrate(asking.result)
        self._keep(asking.result)
        return "Calibrated."


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
    if options.output is not None:
        check_rig_output(
            options.output, [Path(options.input)] if options.input else [], options.head, force=options.force
        )
    elif options.head is not None:
        raise OutputError(
            "--head is for --output OUT.glb or .vrm, which shows it: give that, or leave it out"
        )
    calibration = _known(options)
    head = None if options.output is None else open_shown_head(options.output, options, progress, say)
    controls, stopped = RigControls(mirror=options.mirror), stopped or threading.Event()
    recorder = CurveRecorder() if options.output is not None else None
    with contextlib.ExitStack() as stack, one_thread():
        own: list[Output] = [*outputs]
        sender = VmcSender(options.vmc, presets=options.presets) if options.vmc else None
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
        processor = RigProcessor(calibration, controls, partial(_keep, options.calibration, say), say)
        own.append(CurveOutput(recorder))
        pipeline = Pipeline(capture, lambda: processor, own, lambda: _goes_on(controls, stopped))
        with contextlib.suppress(KeyboardInterrupt):
            pipeline.run()
        stats = pipeline.stats
    written = None
    if options.output is not None and recorder is not None:
        if not recorder.with_face:
            raise GuiseError(f"no face was seen, and {options.output} was not written")
        written = write_rig_file(
            options.output, recorder.curves(), head, processor.calibration, processor.follower, start, ()
        )
    return RigLiveReport(0 if sender is None else sender.sent, written, processor.follower.per_frame, stats)


def _keep(path: Path | None, say: Say, calibration: RigCalibration) -> None:
    if path is not None:
        write_whole(path, lambda part: save(calibration, part))
        say(f"Saved the calibration in {path}.")


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
