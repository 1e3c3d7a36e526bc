"""Faces through a video: detect on the first and on lost frames, refine in between.

:class:`Follower` follows one face, :class:`MultiFollower` all of them.

Frames RGB uint8 (h, w, 3); points face81, pixels, x right, y down, pixel centres at integers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from guise.aam.landmarks.face import Face, Float32, Image, Landmarker, overlap
from guise.aam.landmarks.plausible import followed
from guise.aam.landmarks.schemes import COUNT

Report = Callable[[str], None]

_SAME = 0.2  # overlap of boxes from which they are taken for the same face
_DOUBLE = 0.5  # overlap from which two tracks have come to the same face
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
        return _refined(self._landmarker, rgb, self._previous, self._min_confidence)

    def _found(self, rgb: Image) -> Face | None:
        """The face where the last one was, or the largest."""
        faces = self._detected(rgb)
        if self._last is not None:
            last = self._last.box
            near = [f for f in faces if overlap(f.box, last) > _SAME]
            faces = sorted(near, key=lambda f: -overlap(f.box, last)) or faces
        return faces[0] if faces else None

    def _rechecked(self, rgb: Image, face: Face) -> Face:
        """The tracked face, unless the detector finds faces and none of them there."""
        faces = self._detected(rgb)
        if not faces or any(overlap(f.box, face.box) > _SAME for f in faces):
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


class MultiFollower:
    """Follows every face, frame by frame; each keeps its number, which is never given to another one.

    The detector looks where there is no face to follow, every ``recheck`` frames, and in the ``recheck`` frames
    after a face was lost; a face that comes back within ``patience`` frames to where it was has its number again.
    A new face that the detector sees in none of its next three looks was none and is given up.

    Parameters
    ----------
    landmarker : Landmarker
    min_confidence : float
        A face below it is not taken.
    recheck : int
        Frames, at least 1.
    patience : int
        Frames.
    """

    def __init__(
        self, landmarker: Landmarker, min_confidence: float = 0.5, recheck: int = 5, patience: int = 30
    ) -> None:
        self._landmarker = landmarker
        self._min_confidence = min_confidence
        self._recheck = recheck
        self._patience = patience
        self._since = recheck
        self._next = 0
        self._live: dict[int, Face] = {}
        self._lost: dict[int, Face] = {}
        self._missing: dict[int, int] = {}  # frames since a lost face was there
        self._unproved: dict[int, int] = {}  # looks of the detector that did not see a new face again

    def step(self, rgb: Image) -> dict[int, Face]:
        """The faces in the next frame by their numbers, which count from 0 as faces appear, larger ones first."""
        self._since += 1
        self._refine(rgb)
        if self._should_search():
            self._search(rgb)
        self._forget()
        return dict(sorted(self._live.items()))

    def _refine(self, rgb: Image) -> None:
        """Follow each face; of two that come to the same place the one that moved less stays."""
        before, self._live = self._live, {}
        found = {n: _refined(self._landmarker, rgb, face, self._min_confidence) for n, face in before.items()}
        faces = [(overlap(face.box, before[n].box), n, face) for n, face in found.items() if face is not None]
        for _, number, face in sorted(faces, key=lambda entry: (-entry[0], entry[1])):
            if all(overlap(face.box, other.box) < _DOUBLE for other in self._live.values()):
                self._live[number] = face
        for number in before.keys() - self._live.keys():
            self._lost[number], self._missing[number] = before[number], 0

    def _should_search(self) -> bool:
        recently = any(age < self._recheck for age in self._missing.values())
        return not self._live or recently or self._since >= self._recheck

    def _search(self, rgb: Image) -> None:
        """Take the faces that are not followed yet: with their number if they were lost near by, else a new one."""
        self._since = 0
        faces = [f for f in self._landmarker.detect(rgb) if f.confidence >= self._min_confidence]
        self._prove(faces)
        faces = [f for f in faces if all(overlap(f.box, g.box) <= _SAME for g in self._live.values())]
        pairs = [(overlap(f.box, g.box), n, i) for i, f in enumerate(faces) for n, g in self._lost.items()]
        numbers: dict[int, int] = {}
        for share, number, index in sorted(pairs, key=lambda pair: -pair[0]):
            if share > _SAME and index not in numbers and number not in numbers.values():
                numbers[index] = number
        for index, face in enumerate(faces):
            self._take(numbers.get(index), face)

    def _prove(self, faces: list[Face]) -> None:
        """Trust the new faces that are seen again; give up those that three looks have not seen again."""
        for number in self._live.keys() & self._unproved.keys():
            if any(overlap(f.box, self._live[number].box) > _SAME for f in faces):
                del self._unproved[number]
                continue
            self._unproved[number] += 1
            if self._unproved[number] == _DOUBTS:
                del self._live[number], self._unproved[number]

    def _take(self, number: int | None, face: Face) -> None:
        if number is None:
            number, self._next = self._next, self._next + 1
            self._unproved[number] = 0
        else:
            del self._lost[number], self._missing[number]
        self._live[number] = face

    def _forget(self) -> None:
        for number in list(self._missing):
            self._missing[number] += 1
            if self._missing[number] > self._patience:
                del self._lost[number], self._missing[number]
                self._unproved.pop(number, None)


def _refined(landmarker: Landmarker, rgb: Image, previous: Face, min_confidence: float) -> Face | None:
    """The face of the frame before in this one; None when lost, unsure, or when no face can move like that."""
    face = landmarker.refine(rgb, previous)
    if face is None or face.confidence < min_confidence or not followed(previous.points, face.points):
        return None
    return face


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
