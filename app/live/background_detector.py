"""Face detection on every frame in a thread beside the tracker: finds bystanders and re-acquires a lost face."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks import Face
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.app.media import Frame
from guise.common.arrays import F32, U8
from guise.common.closing import Closing


@dataclass(frozen=True)
class DetectionLimits:
    """What the background detector finds and keeps."""

    picture_height_pixels: int = 240  # of the downscaled frame
    min_face_pixels: int = 12  # in the downscaled frame, a twentieth of its height
    min_score: float = 0.35  # of a box that is covered if it also looks like a face
    min_certain_score: float = 0.75  # of a box that is covered in any case
    min_likeness: float = -5.0  # see `BuiltinLandmarker.likeness`; fingertips and folds of cloth have less
    min_landmark_score: float = 0.5  # of a box in which landmarks are sought


LIMITS = DetectionLimits()


class BackgroundDetector(Closing):
    """Detects faces in its own thread; `PersonTracker` uses it as a landmarker for the current frame."""

    name = "background detector"

    def __init__(self) -> None:
        self._detector = FaceDetector(smallest=LIMITS.min_face_pixels, min_score=LIMITS.min_score)
        self._landmarker = BuiltinLandmarker(self._detector)
        self._pool = ThreadPoolExecutor(1, "guise-detector")
        self._frame: Frame | None = None
        self._found: Future[tuple[F32, F32]] | None = None

    def submit(self, frame: Frame) -> None:
        """Start detection in a frame; the caller may draw into the frame as soon as this returns."""
        self._frame = frame
        self._found = self._pool.submit(self._boxes_in, downscaled(frame), (frame.width, frame.height))

    def _boxes_in(self, picture: U8, size: tuple[int, int]) -> tuple[F32, F32]:
        boxes, scores = self._detector.detect_scored(picture)
        kept = [
            score >= LIMITS.min_certain_score or self._looks_like_face(picture, box)
            for box, score in zip(boxes, scores, strict=True)
        ]
        boxes, scores = boxes[kept], scores[kept]
        scale = np.divide(size, picture.shape[1::-1])
        return ((boxes + 0.5) * np.tile(scale, 2) - 0.5).astype(np.float32), scores

    def _looks_like_face(self, picture: U8, box: F32) -> bool:
        return self._landmarker.likeness(picture, box) >= LIMITS.min_likeness

    @property
    def boxes(self) -> tuple[F32, F32]:
        """Boxes (n, 4) of the iBUG 68 points and scores (n,) in the frame, largest first; waits for the detector."""
        if self._found is None:
            return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
        return self._found.result()

    def detect(self, rgb: U8) -> list[Face]:
        """The faces in the current frame, which must not have been drawn into, largest first; `rgb` is not used."""
        boxes = [box for box, score in zip(*self.boxes, strict=True) if score >= LIMITS.min_landmark_score]
        if self._frame is None or not boxes:
            return []
        whole = self._frame.rgb()
        faces = (self._landmarker.points_in_box(whole, box) for box in boxes)
        return [face for face in faces if face is not None]

    def refine(self, rgb: U8, previous: Face) -> Face | None:
        """The previous frame's face, located in the current frame."""
        return None if self._frame is None else self._landmarker.refine(self._frame.rgb(), previous)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()


def downscaled(frame: Frame) -> U8:
    """The detector's input, RGB (h, w, 3); a fast conversion whose grey levels may be slightly off."""
    height = LIMITS.picture_height_pixels
    width = round(frame.width * height / frame.height)
    if frame.height <= height:
        return frame.rgb()
    if frame.video_frame is None or not frame.orientation.is_identity:
        return np.asarray(cv2.resize(frame.rgb(), (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    scaled = frame.video_frame.reformat(width, height, "rgb24", interpolation="AREA")
    return np.asarray(scaled.to_ndarray(), np.uint8)
