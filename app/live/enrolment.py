"""Enrolment in front of the camera: look, speak, smile, turn; then a model is trained from the keyframes.

Frames come one by one from the camera; landmarks are found in each.  Pixels, x right, y down.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from threading import Event

import numpy as np

from guise.aam.appearance import neutral_frames
from guise.aam.landmarks import Face, FaceTracker, Landmarker, LbpDetector, open_landmarker
from guise.aam.landmarks.schemes import LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import Failed
from guise.aam.tracker import FEATURE_RESOLUTION
from guise.aam.training import LIMITS as TRAINING_LIMITS
from guise.aam.training import Choice, Observation, TrainingOptions, choose_frames
from guise.app.enrolment.enrol import EnrolError, box_relation, train
from guise.app.live.keyframes import FrameFeatures, KeyframeAlbum
from guise.app.media import Frame
from guise.common.arrays import F64, U8
from guise.common.errors import Interrupted
from guise.common.progress import Progress, silent


@dataclass(frozen=True)
class EnrolmentLimits:
    """When a frame counts towards the enrolment, and what is said when it does not."""

    min_face_width_pixels: float = 80.0
    min_brightness: float = 60.0  # grey level, 90th percentile of the face
    max_speed: float = 2.5  # inter-ocular distances per second; faster motion blurs the face
    min_point_confidence: float = 0.85  # mean; less, and something hides the face
    min_relative_confidence: float = (
        0.9  # to the best so far, enough too: some cameras never reach the limit above
    )
    min_turn_degrees: float = 12.0  # to each side, below which a view is missing
    max_yaw_degrees: float = 35.0  # beyond it, half of the landmarks are guesses
    detection_interval_frames: int = 15  # between two searches for other faces
    min_face_confidence: float = 0.5
    min_bystander_area: float = 0.3  # of the person's face; smaller faces do not matter
    max_frame_seconds: float = 0.1  # for which one frame can count
    max_absence_seconds: float = 4.0  # without a face; after it, the next face may be somebody else's
    complaint_seconds: float = 0.6  # for which a complaint stays, to be read


LIMITS = EnrolmentLimits()
PROMPTS = (
    (0.0, "Look at the camera, mouth closed"),
    (0.2, "Speak: count aloud, slowly"),
    (0.55, "Smile, then raise your brows"),
)
TURN_PROMPTS_FROM = 0.7  # of the ring, from which views that are missing are asked for
TURN_PROMPTS = ("Turn a little to your right, slowly", "Turn a little to your left, slowly")
TURNS = ("turn right", "turn left")
DONE = "Thank you"


@dataclass(frozen=True, eq=False)
class EnrolmentStatus:
    """What to show after a frame.

    Parameters
    ----------
    sentence : what the person should do, or what is wrong.
    ring : share in [0, 1] of the required good frames, by time.
    done : there are enough frames; `train` can be called.
    face : the detected face, in the frame's pixels, or None.
    missing : what is still needed: seconds of good frames, and turns of the head.
    """

    sentence: str
    ring: float
    done: bool
    face: Face | None = None
    missing: str = ""

    @property
    def mesh(self) -> F64 | None:
        """Landmarks (81, 2) of the detected face."""
        return None if self.face is None else self.face.points.astype(np.float64)


class OnScreenEnrolment:
    """Collects keyframes from a camera, then trains a model.

    Parameters
    ----------
    name : of the person, for the model.
    seconds : of good frames that are required.
    landmarker : default: the built-in one.
    options : of the training; the resolution must match that of the models this one will be used with.

    `observe` and `train` are called one after the other; `cancel` at any time, from any thread.
    """

    def __init__(
        self, name: str, seconds: float = 16.0, landmarker: Landmarker | None = None,
        options: TrainingOptions = TrainingOptions(),
    ) -> None:  # fmt: skip
        self.name, self.seconds, self.options = name, seconds, options
        self._landmarker = _BystanderLandmarker(landmarker or open_landmarker("builtin"))
        self._tracker = FaceTracker(
            self._landmarker, LIMITS.min_face_confidence, LIMITS.detection_interval_frames
        )
        self._cancelled = Event()
        self._time: float | None = None
        self._complaint, self._until = "", -np.inf
        self._restart()

    def _restart(self) -> None:
        self._album = KeyframeAlbum(ReferenceFrame.canonical(self.options.resolution))
        self._good_seconds = self._absent_seconds = 0.0
        self._best_confidence = 0.0
        self._turned = 0.0, 0.0  # farthest yaws that counted, to the image's left and right
        self._last: F64 | None = None

    @property
    def ring(self) -> float:
        """Share in [0, 1] of the required good frames, by time."""
        return min(1.0, self._good_seconds / self.seconds)

    def observe(self, frame: Frame) -> EnrolmentStatus:
        """Take the camera's next frame."""
        elapsed = self._elapsed(frame.seconds)
        rgb = frame.rgb()
        face = self._tracker.update(rgb)
        complaint = self._miss(elapsed) if face is None else self._consider(rgb, frame.luma, face, elapsed)
        return EnrolmentStatus(self._sentence(complaint), self.ring, self.ring >= 1, face, self._missing())

    def _elapsed(self, time: float) -> float:
        """Seconds since the previous frame, limited for when frames were dropped."""
        before, self._time = self._time, time
        return 0.0 if before is None else min(time - before, LIMITS.max_frame_seconds)

    def _miss(self, elapsed: float) -> str:
        """Note a frame without a face; what to say about it."""
        self._absent_seconds += elapsed
        self._last = None
        if self._absent_seconds > LIMITS.max_absence_seconds and self.ring < 1:
            self._restart()
        return "Come into view"

    def _consider(self, rgb: U8, luma: U8, face: Face, elapsed: float) -> str:
        """Take a frame with a face if it is good, otherwise return a complaint."""
        shape, before = face.points.astype(np.float64), self._last
        self._last, self._absent_seconds = shape, 0.0
        if self.ring >= 1:
            return ""
        if self._landmarker.sees_bystanders(face):
            return "Only one person, please"
        fault = (
            _fault_of_place(shape, rgb.shape) or self._hidden(face) or _fault_of_pose(shape, before, elapsed)
        )
        if fault:
            return fault
        features = FrameFeatures.of(luma, shape)
        if isinstance(features, Failed):
            return "Move to the middle"
        if features.brightness < LIMITS.min_brightness:
            return "More light, please"
        self._good_seconds += elapsed
        self._note_turn(_yaw(shape))
        self._album.offer(rgb, features, self.ring)
        return ""

    def _hidden(self, face: Face) -> str:
        """A complaint when the points are less confident than they are for this face when nothing hides it."""
        points = face.point_confidence
        confidence = face.confidence if points is None else float(points.mean())
        self._best_confidence = max(self._best_confidence, confidence)
        limit = min(LIMITS.min_point_confidence, LIMITS.min_relative_confidence * self._best_confidence)
        return "Show your whole face" if confidence < limit else ""

    def _sentence(self, complaint: str) -> str:
        assert self._time is not None
        if self.ring >= 1:
            return DONE
        if complaint:
            self._complaint, self._until = complaint, self._time + LIMITS.complaint_seconds
        if self._time < self._until:
            return self._complaint
        return self._prompt(self.ring)

    def _note_turn(self, yaw: float) -> None:
        """A frame counted in which the head was turned by a yaw, degrees."""
        self._turned = (min(self._turned[0], yaw), max(self._turned[1], yaw))

    def _prompt(self, ring: float) -> str:
        """What to do next: at the end the turns that are missing; to the image's left is to the person's right."""
        if ring >= TURN_PROMPTS_FROM:
            for prompt, is_missing in zip(TURN_PROMPTS, self._turns_missing(), strict=True):
                if is_missing:
                    return prompt
        return next(text for start, text in reversed(PROMPTS) if ring >= start)

    def _turns_missing(self) -> list[bool]:
        """Whether the person has not yet turned enough to their right, and to their left."""
        return [abs(turned) < LIMITS.min_turn_degrees for turned in self._turned]

    def _missing(self) -> str:
        if self.ring >= 1:
            return ""
        turns = [turn for turn, is_missing in zip(TURNS, self._turns_missing(), strict=True) if is_missing]
        return " · ".join([f"{ceil((1 - self.ring) * self.seconds)} s left", *turns])

    def frames(self, pictures: int | None = None) -> list[Observation]:
        """The best frames so far, to be trained on; with the pictures of so many, training is quicker."""
        return self._album.frames(pictures)

    def cancel(self) -> None:
        """Abort a running or future `train`."""
        self._cancelled.set()

    def train(self, progress: Progress = silent, frames: Sequence[Observation] | None = None) -> Identity:
        """Train the model of the enrolled person.

        progress : called with "training" and the completed share.   frames : of `frames`, default: all there are now.

        Raises
        ------
        EnrolError, TrainingError
            When there are too few good frames.
        Interrupted
            After `cancel`.
        """

        def watched(stage: str, share: float) -> None:
            if self._cancelled.is_set():
                raise Interrupted("the enrollment was cancelled; no model was made")
            progress(stage, share)

        frames = self.frames() if frames is None else frames
        if len(frames) < TRAINING_LIMITS.min_frames:
            raise EnrolError(
                f"a model needs at least {TRAINING_LIMITS.min_frames} good frames of the face, got {len(frames)}; "
                "stay in front of the camera until the ring is full"
            )
        watched("training", 0.0)
        choice = _choice(frames, self.options)
        return train(
            self.name, dict(enumerate(frames)), choice, self.options, _boxes(frames), ["camera"], watched
        )


class _BystanderLandmarker:
    """A landmarker that remembers the other faces of its last detection."""

    def __init__(self, landmarker: Landmarker) -> None:
        self._landmarker = landmarker
        self._faces: list[Face] = []

    @property
    def name(self) -> str:
        return self._landmarker.name

    def detect(self, rgb: U8) -> list[Face]:
        self._faces = self._landmarker.detect(rgb)
        return self._faces

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        return self._landmarker.refine(rgb, previous)

    def sees_bystanders(self, face: Face) -> bool:
        """Whether there were other faces not much smaller than this one."""
        min_area = LIMITS.min_bystander_area * face.area
        large = [f for f in self._faces if f.confidence >= LIMITS.min_face_confidence and f.area > min_area]
        return len(large) > 1


def _fault_of_place(shape: F64, size: tuple[int, ...]) -> str:
    """A complaint about the position of a face (81, 2) in a picture (h, w, ...), or ""."""
    if np.ptp(shape[:, 0]) < LIMITS.min_face_width_pixels:
        return "Come closer"
    height, width = size[:2]
    inside = (shape >= -0.5).all() and (shape < (width - 0.5, height - 0.5)).all()
    if inside:
        return ""
    return "Move back a little" if np.ptp(shape[:, 1]) > 0.8 * height else "Move to the middle"


def _fault_of_pose(shape: F64, before: F64 | None, elapsed: float) -> str:
    """A complaint about motion or yaw of a face (81, 2), `elapsed` seconds after it was at `before`, or ""."""
    eyes = float(np.linalg.norm(shape[LEFT_EYE_OUTER] - shape[RIGHT_EYE_OUTER]))
    distance = 0.0 if before is None else float(np.linalg.norm(shape - before, axis=1).mean())
    if distance > LIMITS.max_speed * eyes * max(elapsed, 1 / 60):
        return "Move more slowly"
    return "Turn back a little" if abs(_yaw(shape)) > LIMITS.max_yaw_degrees else ""


def _yaw(shape: F64) -> float:
    """Degrees by which the head of a face (81, 2) is turned to the image's right."""
    grid = ReferenceFrame.canonical(FEATURE_RESOLUTION)
    return grid.yaw(grid.align(shape))


def _choice(frames: Sequence[Observation], options: TrainingOptions) -> Choice:
    """Which frames serve which purpose; only those at rest have the pictures from which the neutral face is made."""
    shapes = np.stack([frame.shape for frame in frames])
    order = neutral_frames(shapes, ReferenceFrame.canonical(FEATURE_RESOLUTION), len(frames))
    neutral = [i for i in order if frames[i].picture is not None]
    return replace(choose_frames(shapes, options), neutral=neutral[: TRAINING_LIMITS.rest_frames])


def _boxes(frames: Sequence[Observation]) -> list[F64]:
    """How the face lies in the detector's box, in the frames that have pictures."""
    detector = LbpDetector()
    boxes = [box_relation(detector.detect(f.picture), f.shape) for f in frames if f.picture is not None]
    return [box for box in boxes if box is not None]
