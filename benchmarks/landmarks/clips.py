"""Real clips: which there are, what is hard about them, and their first frames.

Landmarks beside them are MediaPipe's answers, not the truth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Picture

REAL = ("mp4", "mkv", "mpg")

# What makes a clip hard; all others show one person who looks at the camera.
HARD = {
    "address_o2": "the head turns to profile",
    "studio_d3": "extreme expressions, turns and nods",
    "gesture_bird": "small face, a hand before the mouth, another head at the edge",
    "gesture_book": "small face, chin up, hands below the chin",
    "gesture_learn": "small face, chin up, a hand at the brow",
    "gesture_milk": "small face",
    "gesture_please": "small face",
    "gesture_school": "small face, chin up, hands below the chin",
    "gesture_sorry": "small face, a hand below the chin",
    "gesture_thanks": "small face, a hand before the mouth",
    "gesture_walk": "small face, chin up",
    "street_crowd": "many small faces that come and go",
}
# Clips that training/data.py and training/backgrounds.py read.
TRAINED_ON = ("grid_", "gesture_bird", "gesture_please", "gesture_thanks")


@dataclass(frozen=True, eq=False)
class RealClip:
    """A clip and MediaPipe's landmarks (t, 81, 2) in pixels, NaN where it found no face."""

    name: str
    video: Path
    points: F64

    @property
    def seen(self) -> bool:
        """Whether training may have seen parts of it."""
        return self.name.startswith(TRAINED_ON)

    def frames(self, count: int | None) -> Iterator[Picture]:
        """The first frames as RGB; all of them with None."""
        for frame in islice(common.frames(common.Clip(self.name, self.video, self.points)), count):
            yield frame.rgb()


def real_clips(shared: Path, names: str = "") -> list[RealClip]:
    """Clips of data/real whose names begin with `names`, in order; empty when there are none."""
    folder = shared / "data" / "real"
    videos = sorted(v for kind in REAL for v in folder.glob(f"{names}*.{kind}"))
    return [RealClip(video.stem, video, _largest(video)) for video in videos]


def _largest(video: Path) -> F64:
    with np.load(video.with_suffix(".landmarks.npz")) as stored:
        faces = stored["face81"].astype(np.float64)
    area = np.prod(faces.max(2) - faces.min(2), axis=2)
    return np.asarray(faces[np.arange(len(faces)), np.nan_to_num(area, nan=-1.0).argmax(1)])
