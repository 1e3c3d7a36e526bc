"""Small faces: the signers of real/gesture_* and the passers-by of real/street_crowd, beside CenterFace at 0.5.

Where a signer's face is, MediaPipe's landmarks beside the clip say, or, where it found none, CenterFace (the box
nearest to the middle of the picture).  Each frame is searched for itself; "box" is a box of the landmarker's detector,
"face" a face with the confidence that the trackers take, "followed" one that is followed from frame to frame.  Boxes
overlap by at least 0.3; CenterFace's reach up to the hair, so that they never agree fully.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks import common
from benchmarks.common import F64, Criterion, Picture, Report, Table
from benchmarks.landmarks import setting
from benchmarks.landmarks.clips import RealClip, real_clips
from benchmarks.landmarks.metrics import matches
from benchmarks.landmarks.peers import MISSING, Peer
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.landmarks.tracking import MultiFaceTracker

NAME, TITLE = "landmarks.small_faces", "Small and many faces"
FRAME_STEP = 3


@dataclass
class Signer:
    """One gesture clip: frames with a reference and those in which it is hit."""

    clip: RealClip
    side: list[float]
    frames: int = 0
    box: int = 0
    face: int = 0
    followed: int = 0


@dataclass
class Crowd:
    """Faces of all frames searched, with which of CenterFace's are hit; `new` are those that CenterFace has not."""

    theirs: int = 0
    hit: int = 0
    ours: int = 0
    new: int = 0

    def add(self, ours: F64, theirs: F64) -> None:
        """One more frame's boxes (n, 4) and (m, 4)."""
        hit = sum(m is not None for m in matches(ours, theirs))
        self.theirs, self.hit = self.theirs + len(theirs), self.hit + hit
        self.ours, self.new = self.ours + len(ours), self.new + len(ours) - hit

    @property
    def share(self) -> float:
        """CenterFace's faces that ours finds too, %."""
        return 100 * self.hit / self.theirs if self.theirs else float("nan")


def boxes(landmarker: Any, rgb: Picture) -> F64:
    """Landmark boxes (n, 4) of the detector; of all faces where there is no detector to ask."""
    detector = getattr(landmarker, "detector", None)
    if detector is None:
        return setting.boxes_of(setting.points_of(landmarker.detect(rgb)))
    return np.array([detector.fit.apply(box) for box in detector.detect(rgb)], np.float64).reshape(-1, 4)


def faces(landmarker: Any, rgb: Picture) -> F64:
    """Boxes (n, 4) of the iBUG-68 points of the faces that the trackers would take."""
    return setting.boxes_of(setting.points_of(setting.sure(landmarker.detect(rgb))))


def wanted(given: F64, rgb: Picture, peer: Peer | None) -> F64:
    """Box (1, 4) of the signer's face, or (0, 4) where nobody knows it, from given points (81, 2)."""
    if np.isfinite(given).all():
        return setting.boxes_of(given[None, IBUG68])
    found = peer.boxes(rgb)[:, :4] if peer else np.zeros((0, 4))
    return found[np.argsort(np.abs(found[:, [0, 2]].mean(1) - rgb.shape[1] / 2))[:1]]


def signer(clip: RealClip, landmarker: Any, peer: Peer | None, every: int) -> Signer:
    """One gesture clip."""
    tracker, result = MultiFaceTracker(landmarker), Signer(clip, [])
    for index, rgb in enumerate(clip.frames(None)):
        followed = setting.boxes_of(setting.points_of(list(tracker.update(rgb).values())))
        target = wanted(clip.points[index], rgb, peer) if index % every == 0 else np.zeros((0, 4))
        if len(target):
            result.frames += 1
            result.side.append(float((target[0, 2:] - target[0, :2]).max()))
            result.box += matches(boxes(landmarker, rgb), target) != [None]
            result.face += matches(faces(landmarker, rgb), target) != [None]
            result.followed += matches(followed, target) != [None]
    return result


def measure(options: argparse.Namespace) -> Report:
    """Signers, then the crowd."""
    clips = real_clips(options.shared, "gesture_")[: 2 if options.quick else None]
    if not clips:
        return setting.skipped(NAME, TITLE, f"no gesture clips in {options.shared / 'data' / 'real'}")
    landmarker = setting.landmarker(options)
    every = 10 if options.quick else options.every
    report = Report(NAME, TITLE)
    peer = (
        Peer(options.peers_python, "centerface", setting.CENTERFACE_MIN_SCORE)
        if options.peers_python
        else None
    )
    try:
        signers = []
        for clip in clips:
            signers.append(signer(clip, landmarker, peer, every))
            common.say(f"{clip.name}: {signers[-1].box} boxes in {signers[-1].frames} frames")
        crowds = crowd(options, landmarker, peer, every) if peer else None
    finally:
        if peer:
            peer.__exit__(None, None, None)
    report.criteria = criteria(signers, crowds)
    report.tables = [signer_table(signers)] + ([crowd_table(crowds)] if crowds else [])
    if peer is None:
        report.notes.append(MISSING.format("CenterFace") + "  Only frames with given landmarks were counted.")
    return report


def crowd(options: argparse.Namespace, landmarker: Any, peer: Peer, every: int) -> dict[str, Crowd] | None:
    """Boxes and faces of the street clip against CenterFace's."""
    clips = real_clips(options.shared, "street_crowd")
    if not clips:
        return None
    found = {"boxes": Crowd(), "faces": Crowd()}
    for index, rgb in enumerate(clips[0].frames(None)):
        if index % every == 0:
            theirs = peer.boxes(rgb)[:, :4]
            found["boxes"].add(boxes(landmarker, rgb), theirs)
            found["faces"].add(faces(landmarker, rgb), theirs)
    return found


def criteria(signers: list[Signer], crowds: dict[str, Crowd] | None) -> list[Criterion]:
    """Targets for the detector's boxes, and the same for faces."""
    frames = max(sum(s.frames for s in signers), 1)
    made = []
    for what, text in (("box", "a box on"), ("face", "a face found on")):
        share = 100 * sum(getattr(s, what) for s in signers) / frames
        made.append(Criterion(f"gesture frames with {text} the signer", share, ">=", 95.0, "%"))
    for what, counts in (crowds or {}).items():
        made.append(
            Criterion(f"CenterFace's faces of street_crowd among our {what}", counts.share, ">=", 90.0, "%")
        )
    return made


def signer_table(signers: list[Signer]) -> Table:
    """A row for each clip."""
    columns = ("clip", "frames", "size, px", "box, %", "face, %", "followed, %", "in the training data")
    rows = []
    for s in signers:
        n, side = max(s.frames, 1), float(np.median(s.side)) if s.side else float("nan")
        seen = "background" if s.clip.seen else "no"
        rows.append(
            (s.clip.name, s.frames, side, 100 * s.box / n, 100 * s.face / n, 100 * s.followed / n, seen)
        )
    return Table("Signers; size is the longer side of the reference box", columns, rows)


def crowd_table(crowds: dict[str, Crowd]) -> Table:
    """Boxes and faces."""
    columns = ("ours", "CenterFace's", "found by ours too", "%", "ours in all", "not CenterFace's")
    rows = [(what, c.theirs, c.hit, c.share, c.ours, c.new) for what, c in crowds.items()]
    return Table("street_crowd, faces of all frames searched", columns, rows)


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = common.arguments(__doc__)
    made.add_argument("--every", type=int, default=FRAME_STEP, help="take one frame in so many")
    return made


if __name__ == "__main__":
    common.run(measure, parser())
