"""The frame in which a user says that the face is at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from clips import cut
from made_up import FRAME, appearance
from models import model_file

from guise.aam.appearance import neutral_frames, openness, rest_weights
from guise.aam.landmarks import open_landmarker
from guise.aam.landmarks.schemes import BROWS, LOWER_INNER_LIP
from guise.aam.model import Identity
from guise.aam.solid_shape import SolidPrior
from guise.aam.training import TrainingError, TrainingOptions, choose_frames
from guise.app.enrolment.enrol import EnrolError
from guise.app.enrolment.rest import at_rest, frame_at
from guise.common.arrays import F64


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cut("p01", tmp_path_factory.mktemp("rest") / "clip.mp4", 12)


def moving(count: int = 40) -> F64:
    """Shapes of a face whose brows go up and down while it talks."""
    rng = np.random.default_rng(2)
    shapes = np.repeat(100 + 2 * FRAME.points[None], count, axis=0) + rng.normal(0, 0.2, (count, 81, 2))
    shapes[:, BROWS, 1] -= np.linspace(0, 16, count)[:, None]
    shapes[:, LOWER_INNER_LIP, 1] += 6 + 6 * rng.random((count, 1))
    return shapes


def test_the_frame_at_a_time_is_the_one_shown_then(clip: Path) -> None:
    frame = frame_at(clip, 0.0)
    later = frame_at(clip, 0.25)
    assert frame.index == 0
    assert float((later.pts - frame.pts) * frame.time_base) <= 0.25
    assert float((later.pts + later.duration - frame.pts) * frame.time_base) > 0.25


def test_a_time_after_the_end_is_refused(clip: Path) -> None:
    with pytest.raises(EnrolError, match=r"--rest 99 lies after the end of clip.mp4, which lasts 0\.\d+ s"):
        frame_at(clip, 99)


def test_the_person_rests_where_they_are_said_to(clip: Path) -> None:
    person = Identity.load(model_file("p01"))
    chosen = at_rest(person, clip, 0.2, open_landmarker("builtin"))
    assert chosen.knows_rest
    assert not person.knows_rest
    shape = chosen.appearance.neutral_shape
    assert np.abs(shape - person.appearance.neutral_shape).max() < 0.2 * FRAME.resolution
    assert np.isfinite(chosen.appearance.neutral_parameters).all()


def test_frames_like_the_chosen_one_make_the_neutral_face() -> None:
    shapes = moving()
    assert neutral_frames(shapes, FRAME, 5, shapes[3])[0] == 3
    lowered = rest_weights(shapes, FRAME, shapes[1]) @ openness(shapes)[:, 2]
    usual = rest_weights(shapes, FRAME) @ openness(shapes)[:, 2]
    assert lowered < usual - 0.02


@pytest.mark.parametrize(("frontal", "expected"), [(10, 0.0), (1, 20.0)])
def test_a_face_turned_aside_in_most_frames_rests_in_the_many_frontal_ones(
    frontal: int, expected: float
) -> None:
    """Of 40 frames; a single frontal one is not enough."""
    yaws = np.where(np.arange(40) < frontal, 0.0, 20.0) + np.random.default_rng(1).normal(0, 0.5, 40)
    shapes = 100 + FRAME.points + yaws[:, None, None] * FRAME.yaw_mode
    at_rest = FRAME.align(np.tensordot(rest_weights(shapes, FRAME), shapes, 1))
    assert FRAME.yaw(at_rest) == pytest.approx(expected, abs=8)  # as a regression takes in all frames
    near = [FRAME.yaw(FRAME.align(shapes[i])) for i in neutral_frames(shapes, FRAME)]
    assert np.median(near) == pytest.approx(expected, abs=2.5)


def test_a_frame_without_a_face_cannot_be_at_rest() -> None:
    shapes = moving()
    shapes[5] = np.nan
    with pytest.raises(TrainingError, match="give a time at which it is seen"):
        choose_frames(shapes, TrainingOptions(rest_frame=5))


def test_raised_brows_of_a_face_that_is_said_to_rest_are_its_own() -> None:
    raised = FRAME.align(appearance(1).neutral_shape)
    raised[BROWS, 1] -= 0.05 * FRAME.resolution
    guessed, known = (SolidPrior.shipped().rest_of(raised, still=still) for still in (False, True))
    away = [np.abs(fit.points - raised)[BROWS].mean() / FRAME.resolution for fit in (guessed, known)]
    assert away[1] < 0.002
    assert away[0] > 2 * away[1]
