"""Metrics of points, boxes and confidences.  Pixels, x right, y down; iBUG-68 order; NaN where missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import F64
from guise.aam.landmarks import interocular, iou
from guise.aam.landmarks.schemes import INNER51, LEFT_EYE_OUTER, RIGHT_EYE_OUTER

Bools = NDArray[np.bool_]

FAILURE_ERROR = 10.0  # %, a face with a larger error is a failure
MIN_MATCH_IOU = 0.3  # of boxes, from which they are one face


# -- points ---------------------------------------------------------------------------------------------------


def percent_errors(found: F64, truth: F64) -> F64:
    """Distances (n, p) of points (n, p, 2), % of the true distance between the outer eye corners."""
    return np.asarray(100 * np.linalg.norm(found - truth, axis=2) / interocular(truth)[:, None])


def eye_frame_residuals(found: F64, truth: F64) -> NDArray[np.complex128]:
    """Differences (n, p) in the frame in which the true outer eye corners are level and one apart, x + iy."""
    difference = found - truth
    eyes = truth[:, LEFT_EYE_OUTER] - truth[:, RIGHT_EYE_OUTER]
    turned = (difference[..., 0] + 1j * difference[..., 1]) / (eyes[:, 0] + 1j * eyes[:, 1])[:, None]
    return np.asarray(turned)


def offset_removed_errors(found: F64, truth: F64) -> F64:
    """Errors (n, p) as :func:`percent_errors` after each point's mean residual is taken off, two-fold.

    Schemes put a point of the same name to other places.  The mean of the first half of the faces is taken off the
    second half and the other way round; with fewer than two faces found in a half the result is NaN.
    """
    residual = eye_frame_residuals(found, truth)
    errors = np.full(residual.shape, np.nan)
    halves = slice(0, len(residual) // 2), slice(len(residual) // 2, None)
    for half, other in (halves, halves[::-1]):
        known = residual[other][np.isfinite(residual[other]).any(1)]
        if len(known) >= 2:
            errors[half] = 100 * np.abs(residual[half] - known.mean(0))
    return errors


def face_errors(errors: F64, points: slice = slice(None)) -> F64:
    """Mean (n,) of errors (n, p) over the points that are known; NaN for faces without any."""
    chosen = errors[:, points]
    known = np.isfinite(chosen)
    total = np.where(known, chosen, 0).sum(1)
    return np.asarray(np.where(known.any(1), total / np.maximum(known.sum(1), 1), np.nan))


def mean_of(values: F64) -> float:
    """Mean of the finite values; NaN if there are none."""
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


@dataclass(frozen=True)
class Accuracy:
    """Errors of a set of faces in %: means over the faces found, and the numbers of faces.

    failed : found with a mean error over 10 %.   missing : not found; a failure as well.
    """

    faces: int
    raw: float
    inner: float
    removed: float
    removed_inner: float
    failed: int
    missing: int

    @property
    def failures(self) -> int:
        """Faces that are not found or found wrong."""
        return self.failed + self.missing


def accuracy(found: F64, truth: F64) -> Accuracy:
    """Accuracy of points (n, 68, 2), NaN of faces not found and of points that the truth has not."""
    raw, removed = percent_errors(found, truth), offset_removed_errors(found, truth)
    each = face_errors(raw)
    return Accuracy(
        len(truth), mean_of(each), mean_of(face_errors(raw, INNER51)),
        mean_of(face_errors(removed)), mean_of(face_errors(removed, INNER51)),
        int((each > FAILURE_ERROR).sum()), int(np.isnan(each).sum()),
    )  # fmt: skip


# -- boxes ----------------------------------------------------------------------------------------------------


def matches(found: F64, wanted: F64, min_iou: float = MIN_MATCH_IOU) -> list[int | None]:
    """For each wanted box (n, 4) the found one (m, 4) that is the same face, by largest IoU first, or None."""
    pairs = [(iou(f, w), j, i) for i, f in enumerate(found) for j, w in enumerate(wanted)]
    answer: list[int | None] = [None] * len(wanted)
    used: set[int] = set()
    for overlap, j, i in sorted(pairs, key=lambda pair: -pair[0]):
        if overlap >= min_iou and answer[j] is None and i not in used:
            answer[j] = i
            used.add(i)
    return answer


# -- time -----------------------------------------------------------------------------------------------------


def motion(points: F64, eyes: F64, order: int) -> F64:
    """Size (t,) of the first or second difference in time of points (t, p, 2): root mean square over the points.

    In % of eyes (t,), pixels.  Given at the later (first) or middle (second) frame, NaN where a frame is missing.
    """
    size = np.full(len(points), np.nan)
    difference = np.diff(points, n=order, axis=0)
    sizes = np.sqrt((difference**2).sum(2).mean(1))
    size[1 : 1 + len(sizes)] = 100 * sizes / eyes[1 : 1 + len(sizes)]
    return size


def root_mean_square(values: F64) -> float:
    """Root mean square of the finite values; NaN if there are none."""
    return float(np.sqrt(mean_of(np.asarray(values) ** 2)))


def opening(points: F64, pairs: tuple[tuple[int, int], ...]) -> F64:
    """Mean distance (t,) of pairs of points, in distances between the outer eye corners, of points (t, p, 2)."""
    upper, lower = np.array(pairs).T
    return np.asarray(
        np.linalg.norm(points[:, upper] - points[:, lower], axis=2).mean(1) / interocular(points)
    )


def lag(curve: F64, reference: F64, max_lag: int = 5) -> float:
    """Frames by which a curve (t,) lags behind the reference: peak of their correlation, between frames.

    The peak of a parabola through the best whole shift and its neighbours; NaN when either does not vary or when
    the best shift is the largest tried.

    >>> t = np.arange(200.0)
    >>> round(lag(np.sin((t - 1.5) / 6), np.sin(t / 6)), 1)
    1.5
    """
    known = np.isfinite(curve) & np.isfinite(reference)
    scores = np.array([_correlation(curve, reference, known, s) for s in range(-max_lag, max_lag + 1)])
    if not np.isfinite(scores).all():
        return float("nan")
    best = int(scores.argmax())
    if best in {0, 2 * max_lag}:
        return float("nan")
    before, peak, after = scores[best - 1 : best + 2]
    return float(best - max_lag + (before - after) / (2 * (before - 2 * peak + after)))


def _correlation(curve: F64, reference: F64, known: Bools, shift: int) -> float:
    late, early = (
        slice(max(shift, 0), len(curve) + min(shift, 0)),
        slice(max(-shift, 0), len(curve) - max(shift, 0)),
    )
    both = known[late] & known[early]
    a, b = curve[late][both], reference[early][both]
    if len(a) < 3 or a.std() < 1e-12 or b.std() < 1e-12:
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def depth(curve: F64) -> float:
    """How far a curve (t,) dips below its median: median less the second percentile."""
    known = curve[np.isfinite(curve)]
    return float(np.median(known) - np.quantile(known, 0.02)) if len(known) else float("nan")
