"""Points of brows go to their hair, as the parsing shows it."""

import numpy as np
import pytest
from made_up import SAMPLES
from numpy.testing import assert_allclose

from guise.aam.brow_lift import LIMITS, BrowLift
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, RIGHT_BROW, RIGID_WEIGHTS
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing
from guise.aam.reference import ReferenceFrame
from guise.aam.similarity import align_planar
from guise.app.media import open_input
from guise.common.arrays import F64

REFERENCE = ReferenceFrame.canonical()


@pytest.fixture(scope="module")
def seen() -> tuple[FaceParsing, F64]:
    """A parsed frame of the first sample person, and the points that the landmarker finds."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    points = open_landmarker("builtin").detect(rgb)[0].points.astype(np.float64)
    return FaceParser().parse(rgb, points), points


def down(points: F64, face_widths: float) -> F64:
    linear = align_planar(REFERENCE.points, points, RIGID_WEIGHTS).linear
    return np.asarray(face_widths * REFERENCE.resolution * linear[1])


def lifted(parsing: FaceParsing, points: F64) -> F64:
    lift = BrowLift()
    lift.see(parsing, points)
    return lift(points)


def test_brows_that_lie_on_their_hair_stay(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    moved = lifted(parsing, points) - points
    assert np.linalg.norm(moved[BROWS], axis=1).max() < np.linalg.norm(down(points, 0.02))
    others = np.setdiff1d(np.arange(len(points)), BROWS)
    assert (moved[others] == 0).all()


@pytest.mark.parametrize("away", [-0.03, 0.02, 0.04])
def test_brows_that_were_left_behind_follow_most_of_the_way(
    seen: tuple[FaceParsing, F64], away: float
) -> None:
    parsing, points = seen
    behind = points.copy()
    behind[BROWS] += down(points, away)
    expected = lifted(parsing, points) + (1 - LIMITS.strength) * (behind - points)
    assert np.abs(lifted(parsing, behind) - expected)[BROWS].max() < np.linalg.norm(down(points, 0.01))


def test_a_brow_that_is_hidden_keeps_its_points(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    shares = parsing.shares.copy()
    middle = parsing.to_cells[:, :2] @ points.mean(0) + parsing.to_cells[:, 2]
    hidden = np.arange(shares.shape[2]) < middle[0]  # the person's right side
    shares[FaceClass.HAIR][:, hidden] += shares[FaceClass.BROWS][:, hidden]
    shares[FaceClass.BROWS][:, hidden] = 0
    behind = points.copy()
    behind[BROWS] += down(points, 0.03)
    moved = lifted(FaceParsing(shares, parsing.to_picture, parsing.irises), behind) - behind
    assert_allclose(moved[RIGHT_BROW], 0, atol=1e-9)
    assert (moved[LEFT_BROW] @ down(points, 1) < 0).all()


def test_shifts_are_steady_and_forgotten_at_a_reset(seen: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen
    behind = points.copy()
    behind[BROWS] += down(points, 0.04)
    lift = BrowLift()
    assert (lift(points) == points).all()
    lift.see(parsing, points)
    lift.see(parsing, behind)
    at_once = lifted(parsing, behind) - behind
    assert np.linalg.norm((lift(behind) - behind)[BROWS]) < 0.6 * np.linalg.norm(at_once[BROWS])
    lift.reset()
    assert not lift.has_seen
    assert (lift(points) == points).all()
