"""How far a tracked face can be trusted: whose it is, how much of it is hidden, whether it is in profile.

Where the landmarker's points and the person's tracker agree, the face lies at their mean, otherwise at the points.
What the person's model cannot explain there (a profile, another person) lowers the confidence, which decides between
swap and cover.  A hand or another object that the parsing sees in front doesn't, as long as enough of the face is
visible and that is the person's.  Pixels as shown, x right, y down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from guise.aam.landmarks import interocular
from guise.aam.landmarks.schemes import INNER51
from guise.aam.parsing import FaceClass, FaceParser
from guise.aam.similarity import Failed
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker import FaceMatch, Fit, Tracker
from guise.app.drawing.face import parse_frame
from guise.app.media import Frame
from guise.common.arrays import F32, F64
from guise.common.tuned import tuned


@dataclass(frozen=True)
class TrustLimits:
    """Thresholds of trust; each logistic function gives a confidence of one half at its limit."""

    # mean distance of tracker and landmarker, up to which their mean is taken
    agreement_interocular: float = tuned(0.06, "inter-ocular distances", "deidentify.swapped")
    # of the visible face, that isn't the person's texture (beside objects twice that), and the width of the function
    occluded_share: float = tuned(0.08, "share", "deidentify.leaks")
    occluded_share_width: float = tuned(0.015, "share", "deidentify.leaks")
    # of a place, from which an object hides it; beside objects, where nothing is compared either; from how much is seen
    object_share: float = tuned(0.15, "share", "deidentify.leaks")
    edge_share: float = tuned(0.08, "share", "deidentify.leaks")
    object_edge_cells: int = tuned(2, "cells", "deidentify.leaks")
    min_hidden_share: float = tuned(0.02, "share of the face", "deidentify.leaks")
    hidden_share: float = tuned(0.6, "share of the face", "deidentify.leaks")  # behind objects
    hidden_share_width: float = tuned(0.02, "share of the face", "deidentify.leaks")
    # As less of the face is compared, it must be more like the person's.
    residual_gain_behind_objects: float = tuned(1.3, "ratio", "deidentify.leaks")
    # confidence from which nothing in front is searched for
    unquestioned: float = tuned(0.9, "confidence", "deidentify.swapped")
    # to which a head may be turned, or nod
    profile_degrees: float = tuned(42.0, "degrees", "deidentify.leaks")
    profile_degrees_width: float = tuned(2.0, "degrees", "deidentify.leaks")
    # of a rough pose, up to which it is not looked at more closely
    surely_frontal_degrees: float = tuned(26.0, "degrees", "live.throughput")
    # by which a landmarker's confidence counts
    landmarker_gain: float = tuned(1.25, "ratio", "deidentify.swapped")


LIMITS = TrustLimits()


@dataclass(frozen=True, eq=False)
class LocatedFace:
    """Where a face lies, (81, 2), and the confidence in [0, 1] that a swap there is right."""

    shape: F64
    confidence: float


class TrustJudge:
    """Judges how far faces can be trusted.  Not for several threads at once."""

    def __init__(self) -> None:
        self._parser = FaceParser()

    def locate(self, tracker: Tracker, frame: Frame, points: F64, confidence: float) -> LocatedFace:
        """A person's face near a landmarker's points (81, 2) in a frame.

        confidence : the landmarker's, in [0, 1]; all that tells a face in a photo, where it is not hidden.
        """
        if not len(tracker.pixels):
            seen = min(_landmarker_trust(confidence), _frontal_trust(points))
            return LocatedFace(points, min(seen, self._uncovered(frame, points)))
        fit = tracker.fit(frame.luma, points)
        shape = points
        if isinstance(fit, Fit) and _distance(fit.shape, points) < LIMITS.agreement_interocular:
            shape = (fit.shape + points) / 2
        return LocatedFace(shape, min(self.trust(tracker, frame, shape), _landmarker_trust(confidence)))

    def _uncovered(self, frame: Frame, shape: F64) -> float:
        """1 where objects leave enough of the face at a shape (81, 2)."""
        parsing = parse_frame(self._parser, frame, shape)
        hidden = parsing.at(shape, parsing.share(FaceClass.OCCLUDER)) > LIMITS.object_share
        return _falling(float(hidden.mean()), LIMITS.hidden_share, LIMITS.hidden_share_width)

    def trust(self, tracker: Tracker, frame: Frame, shape: F64) -> float:
        """Confidence in [0, 1] that the face at a shape (81, 2) is the person's, visible enough and frontal."""
        match = tracker.match(frame.luma, shape)
        if isinstance(match, Failed):
            return 0.0
        whole = min(match.confidence, _unexplained(match, LIMITS.occluded_share))
        if whole < LIMITS.unquestioned:
            whole = max(whole, self._trust_behind_objects(tracker, frame, shape))
        return min(whole, _frontal_trust(shape))

    def _trust_behind_objects(self, tracker: Tracker, frame: Frame, shape: F64) -> float:
        """The same of what objects leave of the face; 0 where there is none, or where that is too little."""
        parsing = parse_frame(self._parser, frame, shape)
        places, objects = tracker.places(shape), parsing.share(FaceClass.OCCLUDER)
        hidden = parsing.at(places, objects) > LIMITS.object_share
        if hidden.mean() < LIMITS.min_hidden_share:
            return 0.0
        near = parsing.at(places, _grown(objects, LIMITS.object_edge_cells)) > LIMITS.edge_share
        match = tracker.match(frame.luma, shape, near)
        if isinstance(match, Failed):
            return 0.0
        own = tracker.quality.confidence(LIMITS.residual_gain_behind_objects * match.residual)
        unexplained = _unexplained(match, 2 * LIMITS.occluded_share)
        return min(
            own, unexplained, _falling(float(hidden.mean()), LIMITS.hidden_share, LIMITS.hidden_share_width)
        )


def _grown(cells: F32, reach: int) -> F32:
    side = 2 * reach + 1
    return np.asarray(cv2.dilate(cells, np.ones((side, side), np.uint8)), np.float32)


def _unexplained(match: FaceMatch, max_share: float) -> float:
    """1 where the person's texture explains the face, 0 where much of it is something else's."""
    return _falling(match.occluded_share, max_share, LIMITS.occluded_share_width)


def _falling(value: float, limit: float, width: float) -> float:
    """A logistic function, one half at the limit."""
    return float(1 / (1 + np.exp(np.clip((value - limit) / width, -50, 50))))


def _landmarker_trust(confidence: float) -> float:
    """A landmarker's confidence, which is about the last per cents of the points' accuracy: a doubt only when low."""
    return min(1.0, LIMITS.landmarker_gain * confidence)


def _frontal_trust(shape: F64) -> float:
    """1 for a frontal face, less than one half for a profile."""
    prior = SolidPrior.shipped()
    turned = _turned_degrees(prior.rough_pose(shape))
    if turned > LIMITS.surely_frontal_degrees:
        turned = _turned_degrees(prior.fit(shape).pose)
    return _falling(turned, LIMITS.profile_degrees, LIMITS.profile_degrees_width)


def _turned_degrees(pose: HeadPose) -> float:
    return float(np.hypot(*pose.angles[:2]))


def _distance(a: F64, b: F64) -> float:
    return float(np.linalg.norm(a[INNER51] - b[INNER51], axis=1).mean() / max(float(interocular(b)), 1e-6))
