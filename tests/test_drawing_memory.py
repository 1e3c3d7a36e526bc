"""What lasts from frame to frame lasts in seconds: a clock of frames, and shares that fade alike at any rate."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.drawing.memory import LONGEST_STEP, Clock, Memory
from guise.app.media import Frame
from guise.common.decay import FRAME_SECONDS, Decay

SECONDS = st.floats(0, 3)
DECAYS = st.builds(Decay, st.floats(0.01, 0.999), st.floats(0.01, 1))
PICTURE = np.zeros((2, 2, 3), np.uint8)


@given(DECAYS, SECONDS, SECONDS)
def test_what_is_kept_of_what_was_kept_is_what_is_kept_over_both_times(
    decay: Decay, first: float, then: float
) -> None:
    assert decay.over(first) * decay.over(then) == pytest.approx(decay.over(first + then), rel=1e-3)


@given(DECAYS, SECONDS, SECONDS)
def test_less_is_kept_over_longer(decay: Decay, first: float, more: float) -> None:
    assert 0 <= decay.over(first + more) <= decay.over(first) <= 1


@given(DECAYS)
def test_nothing_fades_at_once_and_the_share_is_that_of_its_time(decay: Decay) -> None:
    assert decay.over(0) == 1
    assert decay.over(decay.seconds) == pytest.approx(decay.share)
    assert decay.over(np.inf) == 0


@pytest.mark.parametrize("rate", [24, 25, 30, 50, 60])
def test_a_clock_goes_by_the_times_of_frames(rate: int) -> None:
    clock = Clock()
    for number in range(rate + 1):
        clock.tick(Frame.from_rgb(PICTURE, number, Fraction(1, rate), number))
    assert clock.step == pytest.approx(1 / rate)
    assert clock.now == pytest.approx(1 + FRAME_SECONDS)  # the first came a usual step after nothing


def test_frames_may_come_at_uneven_times() -> None:
    clock, steps = Clock(), []
    for pts in (0, 10, 30, 31):
        clock.tick(Frame.from_rgb(PICTURE, pts, Fraction(1, 100)))
        steps.append(clock.step)
    assert steps[1:] == pytest.approx([0.1, 0.2, 0.01])


@pytest.mark.parametrize("pts", [0, -300, round(100 * LONGEST_STEP) + 1])
def test_a_frame_without_a_time_of_its_own_or_of_another_scene_comes_a_usual_step_later(pts: int) -> None:
    clock = Clock()
    clock.tick(Frame.from_rgb(PICTURE, 0, Fraction(1, 100)))
    clock.tick(Frame.from_rgb(PICTURE, pts, Fraction(1, 100)))
    assert clock.step == FRAME_SECONDS
    assert clock.now == pytest.approx(2 * FRAME_SECONDS)


@given(st.integers(1, 8))
def test_what_is_due_after_some_frames_is_due_in_the_last_of_them(frames: int) -> None:
    """However the times of frames are rounded."""
    clock = Clock()
    clock.tick(Frame.from_rgb(PICTURE))
    due = clock.now + frames / 30
    for number in range(1, frames + 1):
        assert not clock.is_due(due)
        clock.tick(Frame.from_rgb(PICTURE, 33 * number, Fraction(1, 1000)))  # a camera's milliseconds
    assert clock.is_due(due) == (frames < 4)


def test_two_faces_share_no_memory() -> None:
    one, other = Memory(), Memory()
    for name, kept in vars(one).items():
        if kept is not None:
            assert kept is not getattr(other, name)
    one.lids.open[0] = 0.5
    one.cover.eyes.append(np.zeros(1, np.float32))
    one.rims.to_crop[0, 0] = 7
    assert (other.lids.open == 1).all()
    assert other.cover.eyes == []
    assert other.rims.to_crop[0, 0] == 1
