"""One person followed through frames: points of the built-in landmarker, coefficients, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from guise.aam.landmarks import Face, FaceTracker
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.rig.calibration import ASKED, Calibrator
from guise.aam.rig.coefficients import Coefficients, RigCalibration, RigEstimator
from guise.app.media import open_input
from guise.common.arrays import U8, Floating
from guise.common.errors import GuiseError
from guise.common.progress import Say, mute


class RigFollower:
    """Coefficients of the largest face, frame by frame; used by one thread.

    face : of the last frame.
    milliseconds : of processor time for coefficients so far, in `count` frames, landmarks left out.
    """

    def __init__(self, calibration: RigCalibration | None, *, smooth: bool = True, say: Say = mute) -> None:
        self._tracker = FaceTracker(BuiltinLandmarker(), report=say)
        self._smooth = smooth
        self.face: Face | None = None
        self.milliseconds, self.count = 0.0, 0
        self.calibrate(calibration)

    def calibrate(self, calibration: RigCalibration | None) -> None:
        """Use what is known of the person from now on."""
        self._estimator = RigEstimator(calibration, smooth=self._smooth)

    def find(self, rgb: U8) -> Face | None:
        """The face in the next frame."""
        self.face = self._tracker.update(rgb)
        return self.face

    def estimate(self, rgb: U8, points: Floating, seconds: float) -> Coefficients:
        """Coefficients of a face with points (81, 2)."""
        began = time.thread_time()
        found = self._estimator(rgb, points, seconds)
        self.milliseconds += 1000 * (time.thread_time() - began)
        self.count += 1
        return found

    def __call__(self, rgb: U8, seconds: float) -> Coefficients | None:
        """Of the next frame, None without a face."""
        face = self.find(rgb)
        return None if face is None else self.estimate(rgb, face.points, seconds)

    @property
    def per_frame(self) -> float:
        """Milliseconds of processor time a frame beyond landmarks."""
        return round(self.milliseconds / max(self.count, 1), 3)


def calibration_of(clip: Path, progress: Callable[[float], None] = lambda share: None) -> RigCalibration:
    """What a clip teaches in which a person does in equal parts what `ASKED` names.

    Raises GuiseError when a part shows no face.
    """
    calibrator, tracker = Calibrator(), FaceTracker(BuiltinLandmarker())
    rows = []
    with open_input(clip) as media:
        for frame in media:
            rgb = frame.rgb()
            face = tracker.update(rgb)
            rows.append(None if face is None else calibrator.estimator.components(rgb, face.points)[0])
            progress(min(1.0, len(rows) / max(1, media.frame_count or 1)))
    for k, step in enumerate(ASKED):
        at, end = (len(rows) * part // len(ASKED) for part in (k, k + 1))
        seen = [row for row in rows[at:end] if row is not None]
        if not seen:
            raise GuiseError(
                f"{clip} cannot calibrate: its part {k + 1} of {len(ASKED)}, {step}, shows no face: record all parts"
            )
        calibrator.seen[step] = seen
    return calibrator.result()
