"""What happens to a track in each frame: nothing is left open at its ends, in its gaps or next to doubt."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.swapping.decide import (
    COVERED,
    LEFT,
    SWAPPED,
    Bystanders,
    TrackObservations,
    decide,
    eroded,
    without_short,
)


def rows(frames: list[int], trust: float | list[float] = 0.9, x: float = 10.0) -> TrackObservations:
    boxes = np.array([[x + f, 20, x + f + 40, 70] for f in frames], np.float32)
    turns = np.array([0.1 * f for f in frames], np.float32)
    turns = np.angle(np.exp(1j * turns)).astype(np.float32)
    return TrackObservations(
        np.array(frames, np.int32), boxes, turns, np.broadcast_to(np.float32(trust), len(frames)).copy()
    )


def test_a_face_that_is_always_trusted_is_swapped_in_every_frame_in_which_it_is_seen() -> None:
    made = decide(rows(list(range(100))), "swap", total=100, rate=30, cuts=[])
    assert made.frames.tolist() == list(range(100))
    assert (made.done == SWAPPED).all()
    np.testing.assert_array_equal(made.growth, 1)


def test_the_turn_of_a_face_that_rolls_over_in_a_gap_goes_on_evenly() -> None:
    made = decide(rows([*range(28), *range(36, 60)]), "cover", total=60, rate=30, cuts=[])
    np.testing.assert_allclose(np.exp(1j * made.turns), np.exp(0.1j * made.frames), atol=1e-5)


def test_a_track_is_covered_for_a_margin_of_time_beyond_its_ends() -> None:
    made = decide(rows(list(range(50, 100))), "swap", total=200, rate=30, cuts=[])
    outside = (made.frames < 50) | (made.frames > 99)
    assert made.frames[0] <= 50 - 0.4 * 30
    assert made.frames[-1] >= 99 + 0.4 * 30
    assert (made.done[outside] == COVERED).all()
    assert (made.growth[outside] > 1).all()


def test_the_margin_does_not_reach_into_another_shot() -> None:
    made = decide(rows(list(range(50, 100))), "swap", total=200, rate=30, cuts=[45, 103])
    assert (made.frames[0], made.frames[-1]) == (45, 102)


def test_a_gap_is_covered_along_the_way_between_its_ends() -> None:
    known = [*range(0, 40), *range(60, 100)]
    made = decide(rows(known), "swap", total=100, rate=30, cuts=[])
    assert (made.done[40:60] == COVERED).all()
    middle, size = (made.boxes[50, :2] + made.boxes[50, 2:]) / 2, made.boxes[50, 2:] - made.boxes[50, :2]
    np.testing.assert_allclose(middle, [80, 45], atol=1e-3)
    np.testing.assert_allclose(size, [46, 50], atol=1e-3)  # what 0.1 s before and after it are covered, too


def test_frames_next_to_doubt_are_doubted_too() -> None:
    trust = [0.9] * 100
    trust[50] = 0.2
    made = decide(rows(list(range(100)), trust), "swap", total=100, rate=30, cuts=[])
    assert np.flatnonzero(made.done == COVERED).tolist() == list(range(47, 54))


def test_a_swap_that_would_only_flash_up_is_a_cover() -> None:
    trust = [0.0] * 40 + [0.9] * 12 + [0.0] * 40
    made = decide(rows(list(range(92)), trust), "swap", total=92, rate=30, cuts=[])
    assert (made.done == COVERED).all()


@pytest.mark.parametrize(("action", "code"), [("cover", COVERED), ("leave", LEFT)])
def test_the_user_s_word_counts_in_every_frame(action: str, code: int) -> None:
    made = decide(rows(list(range(30, 60))), action, total=90, rate=30, cuts=[])  # type: ignore[arg-type]
    assert (made.done == code).all()
    assert {*range(30, 60)} <= {*made.frames.tolist()}


@given(
    st.lists(st.floats(0, 1), min_size=1, max_size=120),
    st.integers(0, 40),
    st.sampled_from([12.0, 25.0, 60.0]),
)
def test_nothing_is_swapped_that_is_not_trusted_and_nothing_seen_is_forgotten(
    trust: list[float], start: int, rate: float
) -> None:
    frames = list(range(start, start + len(trust)))
    made = decide(rows(frames, trust), "swap", total=start + len(trust) + 10, rate=rate, cuts=[])
    by_frame = dict(zip(made.frames.tolist(), made.done.tolist(), strict=True))
    assert by_frame.keys() >= {*frames}
    doubted = [f for f, t in zip(frames, trust, strict=True) if np.float32(t) < 0.5]
    assert all(by_frame[f] == COVERED for f in doubted)


def test_eroding_leaves_nothing_of_a_short_list_with_doubt() -> None:
    assert not eroded(np.array([True, False, True]), 3).any()
    assert eroded(np.array([True, True]), 3).all()


def test_short_runs_go_and_long_ones_stay() -> None:
    flags = np.array([1, 1, 1, 0, 1, 0, 0, 1, 1], bool)
    assert without_short(flags, 2).tolist() == [True, True, True, False, False, False, False, True, True]


def test_a_bystander_is_covered_in_the_frames_about_each_sight_of_it() -> None:
    seen = Bystanders(
        np.array([10], np.int32),
        np.array([[0, 0, 9, 9]], np.float32),
        np.array([0.6], np.float32),
        np.array([1.5], np.float32),
    )
    around = seen.spread(total=100, rate=30, cuts=[12])
    assert around.frames.tolist() == list(range(4, 12))
    np.testing.assert_array_equal(around.boxes, np.repeat(seen.boxes, 8, axis=0))
    np.testing.assert_array_equal(around.turns, np.repeat(seen.turns, 8))


def test_without_bystanders_there_is_nothing_to_spread() -> None:
    none = Bystanders(np.zeros(0, np.int32), np.zeros((0, 4), np.float32), *np.zeros((2, 0), np.float32))
    assert len(none.spread(total=5, rate=30, cuts=[]).frames) == 0
