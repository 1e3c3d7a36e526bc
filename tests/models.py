"""Small models of the sample people, trained once in a test run, as files."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

from made_up import SAMPLES

from guise.aam.tracker_training import TrackerOptions
from guise.aam.training import TrainingOptions
from guise.app.enrolment.enrol import enrol
from guise.app.enrolment.landmark_source import LandmarkSource

SMALL = TrainingOptions(frames=40, resolution=64, tracker=TrackerOptions(stages=3, copies=10, folds=2))


@cache
def model_file(person: str) -> Path:
    """NAME.guise of a sample person, enrolled on a few frames of the first clip with a small tracker."""
    identity = enrol([SAMPLES / person / "talk.mp4"], LandmarkSource(), name=person, options=SMALL)
    path = _folder() / f"{person}.guise"
    identity.save(path)
    return path


@cache
def _folder() -> Path:
    folder = Path(tempfile.mkdtemp(prefix="guise-models-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
