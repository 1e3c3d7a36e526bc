"""Small models of the sample people, trained once in a test run, as files."""

from functools import partial
from pathlib import Path

from made_up import SAMPLES
from once import once

from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions

TRACKER = TrackerOptions(stages=3, copies=10, folds=2)
SMALL = TrainingOptions(frames=40, resolution=64, tracker=TRACKER)


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
