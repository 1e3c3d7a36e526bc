"""Small models of the sample people, trained once in a test run, as files, and what makes others quickly."""

from functools import partial
from pathlib import Path

import numpy as np
from clips import cut
from made_up import SAMPLES
from once import once

from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions

TRACKER = TrackerOptions(stages=3, copies=10, folds=2)
SMALL = TrainingOptions(frames=40, resolution=64, tracker=TRACKER)
QUICK = TrainingOptions(frames=24, tracker=TrackerOptions(stages=2, copies=4, folds=2))  # as large as usual


def short_samples() -> Path:
    """A folder with the first frames of the sample clip that photos are animated by, and its landmarks."""
    return once("samples", _cut_samples)


def _cut_samples(folder: Path) -> None:
    (folder / "p01").mkdir(parents=True)
    cut("p01", folder / "p01" / "talk.mp4", 40, clip="talk.mp4")
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"]
    np.savez(folder / "p01" / "talk.npz", landmarks=points[:40])


def model_file(person: str) -> Path:
    """NAME.guise of a sample person, enrolled on a few frames of the first clip with a small tracker."""
    return enrolled(person, SMALL.resolution)


def enrolled(person: str, resolution: int) -> Path:
    """The same in a resolution, pixels."""
    return once(f"{person}-{resolution}.guise", partial(_enrol, person, resolution))


def _enrol(person: str, resolution: int, path: Path) -> None:
    from guise.app.enrolment.enrol import enrol
    from guise.app.enrolment.landmark_source import LandmarkSource

    options = TrainingOptions(frames=SMALL.frames, resolution=resolution, tracker=TRACKER)
    enrol([SAMPLES / person / "talk.mp4"], LandmarkSource(), name=person, options=options).save(path)
