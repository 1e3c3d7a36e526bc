"""A detector that looks at every frame, beside the tracker: who else is there, and where a lost face is again."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import cv2
import numpy as np
from numpy.typing import NDArray

from guise.aam.landmarks import Face
from guise.aam.landmarks.builtin import BuiltinLandmarker
from guise.aam.landmarks.detector import FaceDetector
from guise.app.media import Frame
from guise.common.arrays import F32
from guise.common.closing import Closing

Picture = NDArray[np.uint8]

SMALLEST = 12  # pixels, the smallest face that the detector sees
HEIGHT = 240  # pixels, of the picture that it looks at: SMALLEST is a twentieth of it
POSSIBLE = 0.35  # score from which a box is covered, if it is like a face
SURE = 0.75  # score from which it is covered whatever it is like
LIKE = -5.0  # likeness, see `BuiltinLandmarker.likeness`; fingertips and folds of cloth have less
LIKELY = 0.5  # score from which points are looked for in it


class Watch(Closing):
    """Looks for faces in a thread of its own; to a `PersonFollower` it is a landmarker for the frame at hand."""

    name = "watch"

    def __init__(self) -> None:
        self._detector = FaceDetector(smallest=SMALLEST, min_score=POSSIBLE)
        self._landmarker = BuiltinLandmarker(self._detector)
        self._pool = ThreadPoolExecutor(1, "guise-watch")
        self._frame: Frame | None = None
        self._found: Future[tuple[F32, F32]] | None = None

    def look(self, frame: Frame) -> None:
        """Begin with a frame, before it is drawn into; it can be drawn into at once."""
        self._frame = frame
        self._found = self._pool.submit(self._boxes_in, small(frame), (frame.width, frame.height))

    def _boxes_in(self, picture: Picture, size: tuple[int, int]) -> tuple[F32, F32]:
        boxes, scores = self._detector.detect_scored(picture)
        faces = [score >= SURE or self._like(picture, box) for box, score in zip(boxes, scores, strict=True)]
        boxes, scores = boxes[faces], scores[faces]
        scale = np.divide(size, picture.shape[1::-1])
        return ((boxes + 0.5) * np.tile(scale, 2) - 0.5).astype(np.float32), scores

    def _like(self, picture: Picture, box: F32) -> bool:
        return self._landmarker.likeness(picture, box) >= LIKE

    @property
    def boxes(self) -> tuple[F32, F32]:
        """Boxes (n, 4) of the iBUG 68 points and scores (n,) in the frame, largest first; waits for them."""
        if self._found is None:
            return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
        return self._found.result()

    def detect(self, rgb: Picture) -> list[Face]:
        """The faces in the frame at hand, which was not drawn into, largest first."""
        likely = [box for box, score in zip(*self.boxes, strict=True) if score >= LIKELY]
        if self._frame is None or not likely:
            return []
        whole = self._frame.rgb()
        faces = (self._landmarker.points_in_box(whole, box) for box in likely)
        return [face for face in faces if face is not None]

    def refine(self, rgb: Picture, previous: Face) -> Face | None:
        """The face of the frame before, found again."""
        return None if self._frame is None else self._landmarker.refine(self._frame.rgb(), previous)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()


def small(frame: Frame) -> Picture:
    """A frame as the detector looks at it, RGB (h, w, 3); quick, with some grey levels off."""
    width, height = round(frame.width * HEIGHT / frame.height), HEIGHT
    if frame.height <= HEIGHT:
        return frame.rgb()
    if frame.video_frame is None or not frame.orientation.is_identity:
        return np.asarray(cv2.resize(frame.rgb(), (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    scaled = frame.video_frame.reformat(width, height, "rgb24", interpolation="AREA")
    return np.asarray(scaled.to_ndarray(), np.uint8)
