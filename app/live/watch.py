"""A detector that looks at every frame, beside the tracker: who else is there, and where a lost face is again."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from aam.landmarks import Face
from aam.landmarks.builtin import BuiltinLandmarker
from aam.landmarks.detector import FaceDetector
from app.media import Frame
from render.closing import Closing

F32 = NDArray[np.float32]
Picture = NDArray[np.uint8]

SMALLEST = 0.05  # of the picture's height, the smallest face that is looked for
POSSIBLE = 0.35  # score from which a box is covered
LIKELY = 0.5  # score from which points are looked for in it


class Watch(Closing):
    """Looks for faces in a thread of its own; to a `PersonFollower` it is a landmarker for the frame at hand."""

    name = "watch"

    def __init__(self) -> None:
        detector = FaceDetector(smallest=SMALLEST, min_score=POSSIBLE)
        self._detector, self._landmarker = detector, BuiltinLandmarker(detector)
        self._pool = ThreadPoolExecutor(1, "guise-watch")
        self._rgb: Picture = np.zeros((1, 1, 3), np.uint8)
        self._found: Future[tuple[F32, F32]] | None = None

    def look(self, frame: Frame) -> None:
        """Begin with a frame, before it is drawn into."""
        self._rgb = frame.rgb()
        self._found = self._pool.submit(self._detector.detect_scored, self._rgb)

    @property
    def boxes(self) -> tuple[F32, F32]:
        """Boxes (n, 4) of the iBUG 68 points and scores (n,) in the frame, largest first; waits for them."""
        if self._found is None:
            return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
        return self._found.result()

    def detect(self, rgb: Picture) -> list[Face]:
        """The faces in the frame at hand, largest first."""
        boxes, scores = self.boxes
        faces = (
            self._landmarker.points_in_box(self._rgb, b)
            for b, s in zip(boxes, scores, strict=True)
            if s >= LIKELY
        )
        return [face for face in faces if face is not None]

    def refine(self, rgb: Picture, previous: Face) -> Face | None:
        """The face of the frame before, found again."""
        return self._landmarker.refine(self._rgb, previous)

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown()
