"""One face through a video: detect on the first and on lost frames, refine in between.

Frames RGB uint8 (h, w, 3); points face81, pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from .face import Face, Float32, Image, Landmarker, overlap
from .plausible import followed
from .schemes import COUNT

Report = Callable[[str], None]

_DOUBTS = 3  # frames running in which the detector must disagree: it errs now and then itself


class Follower:
    """Follows one face, frame by frame.

    Parameters
    ----------
    landmarker : Landmarker
    min_confidence : float
        A face below it is not taken.
    recheck : int
        Every that many frames the detector looks again; 0 for never. The track is given up when the detector
        finds faces only elsewhere in three frames running.
    report : callable, optional
        Called once with a sentence when a frame has several faces.
    """

    def __init__(
        self,
        landmarker: Landmarker,
        min_confidence: float = 0.5,
        recheck: int = 30,
        report: Report | None = None,
    ) -> None:
        self._landmarker = landmarker
        self._min_confidence = min_confidence
        self._recheck = recheck
        self._report = report
        self._index = 0
        self._since = 0
        self._doubts = 0
        self._previous: Face | None = None
        self._last: Face | None = None

    def step(self, rgb: Image) -> Face | None:
        """The face in the next frame; None when there is none."""
        face = self._refined(rgb)
        if face is None:
            face = self._found(rgb)
        elif self._recheck and self._since >= self._recheck:
            face = self._rechecked(rgb, face)
        self._index += 1
        self._since += 1
        self._previous = face
        self._last = face or self._last
        return face

    def _refined(self, rgb: Image) -> Face | None:
        if self._previous is None:
            return None
        face = self._landmarker.refine(rgb, self._previous)
        if face is None or face.confidence < self._min_confidence:
            return None
        return face if followed(self._previous.points, face.points) else None

    def _found(self, rgb: Image) -> Face | None:
        """The face where the last one was, or the largest."""
        faces = self._detected(rgb)
        if self._last is not None:
            last = self._last.box
            near = [f for f in faces if overlap(f.box, last) > 0.2]
            faces = sorted(near, key=lambda f: -overlap(f.box, last)) or faces
        return faces[0] if faces else None

    def _rechecked(self, rgb: Image, face: Face) -> Face:
        """The tracked face, unless the detector finds faces and none of them there."""
        faces = self._detected(rgb)
        if not faces or any(overlap(f.box, face.box) > 0.2 for f in faces):
            self._doubts = 0
            return face
        self._doubts += 1
        if self._doubts < _DOUBTS:
            self._since = self._recheck
            return face
        self._doubts = 0
        return faces[0]

    def _detected(self, rgb: Image) -> list[Face]:
        self._since = 0
        faces = [f for f in self._landmarker.detect(rgb) if f.confidence >= self._min_confidence]
        if len(faces) > 1 and self._report is not None:
            self._report(f"frame {self._index} has {len(faces)} faces; the largest one is taken")
            self._report = None
        return faces


def track_video(
    landmarker: Landmarker,
    frames: Iterable[Image],
    *,
    min_confidence: float = 0.5,
    recheck: int = 30,
    report: Report | None = None,
) -> Float32:
    """Landmarks of one face, the largest at first, through a video.

    Parameters
    ----------
    landmarker : Landmarker
    frames : iterable of (h, w, 3) uint8
    min_confidence, recheck, report
        As for :class:`Follower`.

    Returns
    -------
    (T, 81, 2) float32
        Pixels; NaN for frames without a face.
    """
    follower = Follower(landmarker, min_confidence, recheck, report)
    faces = [follower.step(frame) for frame in frames]
    missing = np.full((COUNT, 2), np.nan, np.float32)
    rows = [missing if face is None else face.points for face in faces]
    return np.array(rows, dtype=np.float32).reshape(len(rows), COUNT, 2)
