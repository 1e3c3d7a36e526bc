"""The calibration at the camera: asks for rest, brows, smile, jaw and pucker in turn, two seconds each."""

from __future__ import annotations

from dataclasses import dataclass, field

from guise.aam.rig.calibration import ASKED, CalibrationError, Calibrator
from guise.aam.rig.coefficients import RigCalibration
from guise.common.arrays import U8, Floating
from guise.common.tuned import derived

STEP_SECONDS = derived(2.0, "seconds", "a second to get there, and a second to hold it")
READY_SHARE = derived(0.4, "share", "of a step, in which somebody reads what is asked for")
SENTENCES = {
    "rest": "Look at the camera with a face at rest.",
    "brows": "Raise your brows as far as you can.",
    "smile": "Smile as wide as you can.",
    "jaw": "Open your mouth as wide as you can.",
    "pucker": "Pucker your lips as for a kiss.",
}


@dataclass(eq=False)
class AskedCalibration:
    """One run of it.   result : what was learned, once it has ended well.   problem : a sentence, once it has not."""

    calibrator: Calibrator = field(default_factory=Calibrator)
    result: RigCalibration | None = None
    problem: str = ""
    _begun: float | None = None

    def see(self, rgb: U8, points: Floating | None, seconds: float) -> str:
        """Take the next frame, whose face may be lost; the sentence to show, "" at the end."""
        if self._begun is None:
            if points is None:
                return "Come before the camera: your face is not seen."
            self._begun = seconds
        steps = list(ASKED)
        passed = (seconds - self._begun) / STEP_SECONDS
        if passed >= len(steps):
            self._end(steps)
            return ""
        step = steps[int(passed)]
        if points is not None and passed % 1 >= READY_SHARE:
            self.calibrator.see(rgb, points, step)
        return f"{int(passed) + 1} of {len(steps)}: {SENTENCES[step]}"

    def _end(self, steps: list[str]) -> None:
        missing = [step for step in steps if step not in self.calibrator.seen]
        if missing:
            self.problem = f"Not calibrated: no face was seen for {', '.join(missing)}. C tries again."
            return
        try:
            self.result = self.calibrator.result()
        except CalibrationError as error:
            self.problem = f"Not calibrated: {error}."
