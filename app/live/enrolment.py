"""Enrolment in front of the camera: look, speak, smile, turn; then a model from the frames that were worth keeping.

Frames come one by one, as the camera gives them; landmarks are found in each.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from threading import Event

import numpy as np
from numpy.typing import NDArray

from guise.aam.appearance import neutral_frames
from guise.aam.landmarks import Face, Follower, Landmarker, LbpDetector, open_landmarker
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION
from guise.aam.training import FEWEST, STILLS, Choice, Observation, TrainingOptions, choose_frames
from guise.app.enrolment.enrol import EnrolError, Progress, box_relation, train
from guise.app.live.album import Album, Shot
from guise.app.media import Frame
from guise.common.arrays import F64
from guise.common.errors import Interrupted
from guise.common.progress import silent

Picture = NDArray[np.uint8]

NEAR = 80.0  # pixels, the narrowest face
DARK = 60.0  # grey level that a tenth of the face must exceed
FAST = 2.5  # inter-ocular distances a second; faster, the picture smears
CLEAR = 0.85  # mean confidence of the points; less, and something hides the face
NEARLY = 0.9  # share of the best so far that is clear too, for cameras that never give a clear picture
TURNED = 35.0  # degrees; farther, half of the face is guessed
LOOK_AROUND = 15  # frames between two looks for other faces
CONFIDENT = 0.5  # from which another face is one
BYSTANDER = 0.3  # share of the face's area from which another face counts
LONGEST = 0.1  # seconds that a frame can count for
AWAY = 4.0  # seconds without a face after which the next one may be somebody else's
LINGER = 0.6  # seconds that a complaint stays, to be read

PROMPTS = (
    (0.0, "Look at the camera, mouth closed"),
    (0.2, "Speak: count aloud, slowly"),
    (0.55, "Smile, then raise your brows"),
    (0.7, "Turn your head a little to each side, slowly"),
)
DONE = "Thank you"


@dataclass(frozen=True, eq=False)
class Step:
    """What to show after a frame.

    Parameters
    ----------
    sentence : what the person should do, or what is wrong.
    ring : share in [0, 1] of the time with a good face that has passed.
    done : there is enough; `train` can be called.
    face : the face that was seen, in the frame's pixels, or None.
    """

    sentence: str
    ring: float
    done: bool
    face: Face | None


class OnScreenEnrolment:
    """Gathers what a model needs from camera frames, then trains it.

    Parameters
    ----------
    name : of the person, for the model.
    seconds : of good frames that are asked for.
    landmarker : the built-in one when None.
    options : of the training; the resolution must be that of the models which this one is to be mixed with.

    `add` and `train` are called one after the other; `cancel` at any time, from any thread.
    """

    def __init__(
        self, name: str, seconds: float = 16.0, landmarker: Landmarker | None = None,
        options: TrainingOptions = TrainingOptions(),
    ) -> None:  # fmt: skip
        self.name, self.seconds, self.options = name, seconds, options
        self._company = _Company(landmarker or open_landmarker("builtin"))
        self._follower = Follower(self._company, CONFIDENT, LOOK_AROUND)
        self._cancelled = Event()
        self._time: float | None = None
        self._complaint, self._until = "", -np.inf
        self._begin()

    def _begin(self) -> None:
        self._album = Album(ReferenceFrame.canonical(self.options.resolution))
        self._good = self._alone = 0.0
        self._clearest = 0.0
        self._last: F64 | None = None

    @property
    def ring(self) -> float:
        """Share in [0, 1] of the time with a good face that has passed."""
        return min(1.0, self._good / self.seconds)

    def add(self, frame: Frame) -> Step:
        """Take the next frame of the camera."""
        passed = self._passed(float(frame.pts * frame.time_base))
        rgb = frame.rgb()
        face = self._follower.step(rgb)
        complaint = self._absence(passed) if face is None else self._seen(rgb, frame.luma, face, passed)
        return Step(self._sentence(complaint), self.ring, self.ring >= 1, face)

    def _passed(self, time: float) -> float:
        """Seconds since the frame before; little when frames were lost."""
        before, self._time = self._time, time
        return 0.0 if before is None else min(time - before, LONGEST)

    def _absence(self, passed: float) -> str:
        self._alone += passed
        self._last = None
        if self._alone > AWAY and self.ring < 1:
            self._begin()
        return "Come into the picture"

    def _seen(self, rgb: Picture, luma: Picture, face: Face, passed: float) -> str:
        """Take a frame with a face if it is good, otherwise say what is wrong."""
        shape, before = face.points.astype(np.float64), self._last
        self._last, self._alone = shape, 0.0
        if self.ring >= 1:
            return ""
        if self._company.besides(face):
            return "Only one person, please"
        fault = (
            _fault_of_place(shape, rgb.shape) or self._hidden(face) or _fault_of_pose(shape, before, passed)
        )
        if fault:
            return fault
        shot = Shot.of(luma, shape)
        if isinstance(shot, Failed):
            return "Come to the middle"
        if shot.brightness < DARK:
            return "More light, please"
        self._good += passed
        self._album.offer(rgb, shot, self.ring)
        return ""

    def _hidden(self, face: Face) -> str:
        """A complaint when the landmarker is less sure of the points than it is of this face when nothing hides it."""
        points = face.point_confidence
        clear = face.confidence if points is None else float(points.mean())
        self._clearest = max(self._clearest, clear)
        return "Show your whole face" if clear < min(CLEAR, NEARLY * self._clearest) else ""

    def _sentence(self, complaint: str) -> str:
        assert self._time is not None
        if self.ring >= 1:
            return DONE
        if complaint:
            self._complaint, self._until = complaint, self._time + LINGER
        if self._time < self._until:
            return self._complaint
        return next(text for start, text in reversed(PROMPTS) if self.ring >= start)

    def cancel(self) -> None:
        """Make a `train` that runs, or is called later, give up."""
        self._cancelled.set()

    def train(self, progress: Progress = silent) -> Identity:
        """The model of the person that was seen.

        progress : called with "training" and the share of it that is done.

        Raises
        ------
        EnrolError, TrainingError
            When there are too few good frames.
        Interrupted
            After `cancel`.
        """

        def watched(stage: str, share: float) -> None:
            if self._cancelled.is_set():
                raise Interrupted("the enrolment was given up; no model was made")
            progress(stage, share)

        frames = self._album.frames()
        if len(frames) < FEWEST:
            raise EnrolError(
                f"a model needs at least {FEWEST} good frames of the face, got {len(frames)}; stay in front of the "
                "camera until the ring is full"
            )
        watched("training", 0.0)
        choice = _choice(frames, self.options)
        return train(
            self.name, dict(enumerate(frames)), choice, self.options, _boxes(frames), ["camera"], watched
        )


class _Company:
    """A landmarker that remembers who else was there when it last looked for faces."""

    def __init__(self, landmarker: Landmarker) -> None:
        self._landmarker = landmarker
        self._faces: list[Face] = []

    @property
    def name(self) -> str:
        return self._landmarker.name

    def detect(self, rgb: Picture) -> list[Face]:
        self._faces = self._landmarker.detect(rgb)
        return self._faces

    def refine(self, rgb: Picture, previous: Face) -> Face | None:
        return self._landmarker.refine(rgb, previous)

    def besides(self, face: Face) -> bool:
        """Whether there were other faces, not much smaller than this one."""
        large = [f for f in self._faces if f.confidence >= CONFIDENT and f.area > BYSTANDER * face.area]
        return len(large) > 1


def _fault_of_place(shape: F64, size: tuple[int, ...]) -> str:
    """What is wrong with where a face (81, 2) is in a picture (h, w, ...)."""
    if np.ptp(shape[:, 0]) < NEAR:
        return "Come nearer"
    height, width = size[:2]
    inside = (shape >= -0.5).all() and (shape < (width - 0.5, height - 0.5)).all()
    if inside:
        return ""
    return "Move back a little" if np.ptp(shape[:, 1]) > 0.8 * height else "Come to the middle"


def _fault_of_pose(shape: F64, before: F64 | None, passed: float) -> str:
    """What is wrong with how a face (81, 2) moves and looks, `passed` seconds after it was at `before`."""
    eyes = float(np.linalg.norm(shape[45] - shape[36]))
    way = 0.0 if before is None else float(np.linalg.norm(shape - before, axis=1).mean())
    if way > FAST * eyes * max(passed, 1 / 60):
        return "Not so fast"
    grid = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    return "Turn back a little" if abs(grid.yaw(grid.align(shape))) > TURNED else ""


def _choice(frames: Sequence[Observation], options: TrainingOptions) -> Choice:
    """Which of the frames serve what; only those at rest have the pictures that the neutral face is made of."""
    shapes = np.stack([frame.shape for frame in frames])
    order = neutral_frames(shapes, ReferenceFrame.canonical(FEATURE_RESOLUTION), len(frames))
    neutral = [i for i in order if frames[i].picture is not None]
    return replace(choose_frames(shapes, options), neutral=neutral[:STILLS])


def _boxes(frames: Sequence[Observation]) -> list[F64]:
    """How the face lies in the detector's box, in the frames that have pictures."""
    detector = LbpDetector()
    boxes = [box_relation(detector.detect(f.picture), f.shape) for f in frames if f.picture is not None]
    return [box for box in boxes if box is not None]
