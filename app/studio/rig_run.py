"""A run behind the page Rig: from a camera or a clip to the head in the browser, to a receiver, and to curves."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from guise.aam.rig.coefficients import RigCalibration
from guise.app.live.capture import Capture
from guise.app.live.output import Output, OutputFrame
from guise.app.rig.curves import CurveRecorder, RigCurves
from guise.app.rig.live import CurveOutput, RigControls, RigProcessor
from guise.app.rig.shown import RigFrame
from guise.app.rig.turns import gltf_rotation
from guise.app.rig.vmc import VmcSender
from guise.app.studio.frame_socket import HEADER, Peer
from guise.app.studio.live_run import CameraRun

COEFFICIENTS = b"RIG "  # the format of a message


class CoefficientOutput(Output):
    """Sends coefficients to the browser: 52 weights, then quaternions x y z w of head, left and right eye, float32.

    The axes are those of glTF; a frame without a face is a header alone.
    clip : every frame is shown, at its time; otherwise the latest, at once.
    """

    def __init__(self, peer: Peer, *, clip: bool) -> None:
        self._peer, self.lossless = peer, clip
        self._begun: float | None = None

    def show(self, shown: OutputFrame) -> None:
        """Send those of a frame."""
        assert isinstance(shown, RigFrame)
        seconds = float(shown.frame.seconds)
        if self.lossless:
            self._begun = time.perf_counter() - seconds if self._begun is None else self._begun
            time.sleep(max(0.0, self._begun + seconds - time.perf_counter()))
        self._peer.send(packed(shown, seconds))


def packed(shown: RigFrame, seconds: float) -> bytes:
    """The message for a frame."""
    found = shown.coefficients
    header = HEADER.pack(COEFFICIENTS, 0, 0, 0, 0, seconds, shown.frame.index % (1 << 32))
    if found is None:
        return header
    turns = gltf_rotation(np.concatenate([found.head[None], found.eyes]))
    return header + np.concatenate([found.weights, turns.ravel()]).astype(np.float32).tobytes()


class VmcStream(Output):
    """To a receiver, while there is one.   sender : to it, or None."""

    sender: VmcSender | None = None

    def show(self, shown: OutputFrame) -> None:
        """Send a frame."""
        if (sender := self.sender) is not None:
            sender.show(shown)

    def use(self, sender: VmcSender | None) -> None:
        """Send to another receiver, or to none."""
        before, self.sender = self.sender, sender
        if before is not None:
            before.close()


class RigRun(CameraRun):
    """A run whose curves can be recorded.   calibration, controls, keep : see `RigProcessor`.

    clip : it is recorded from the beginning, and smoothed as a whole when it has ended.
    """

    def __init__(
        self, open_capture: Callable[[], Capture], calibration: RigCalibration | None, controls: RigControls,
        keep: Callable[[RigCalibration], None], outputs: Sequence[Output], wanted: Callable[[], bool],
        *, clip: bool,
    ) -> None:  # fmt: skip
        self._clip, self._curves = clip, CurveOutput(CurveRecorder() if clip else None)
        super().__init__(
            open_capture,
            lambda: RigProcessor(calibration, controls, keep, smooth=not clip),
            [*outputs, self._curves],
            wanted,
        )

    @property
    def recording_seconds(self) -> float | None:
        """For how long the user has been recording; None while they are not."""
        if (recorder := self._curves.recorder) is None:
            return None
        return recorder.rows[-1][0] - recorder.rows[0][0] if recorder.rows else 0.0

    def record(self) -> None:
        """Start a recording with the next frame."""
        self._curves.recorder = CurveRecorder()

    def recorded(self) -> RigCurves | None:
        """End the recording; what was recorded, None for nothing or no face."""
        recorder, self._curves.recorder = self._curves.recorder, None
        if recorder is None or not recorder.with_face:
            return None
        return recorder.curves(smooth=self._clip)
