"""The policy: nothing is left open at a track's ends, in its gaps or next to doubt, at any frame rate."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from guise.app.swapping.policy import (
    COVERED,
    LEFT,
    LIMITS,
    SWAPPED,
    Bystanders,
    FacePlace,
    FollowedFace,
    TrackObservations,
    UnfollowedFaces,
    decide,
    eroded,
    frames_within,
    without_short,
)

RATES = (25.0, 60.0)


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
    assert made.frames[0] == 50 - LIMITS.unseen_seconds * 30
    assert made.frames[-1] == 99 + LIMITS.unseen_seconds * 30
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
    around = seen.spread(total=100, rate=10, cuts=[12])
    assert around.frames.tolist() == list(range(4, 12))
    np.testing.assert_array_equal(around.boxes, np.repeat(seen.boxes, 8, axis=0))
    np.testing.assert_array_equal(around.turns, np.repeat(seen.turns, 8))


def test_a_bystander_who_rests_has_few_covers_in_a_frame_and_one_who_walks_has_all() -> None:
    frames = np.arange(60, dtype=np.int32)
    most = {}
    for step in (0, 9):
        boxes = np.array([[step * f, 0, step * f + 9, 9] for f in frames], np.float32)
        seen = Bystanders(frames, boxes, np.ones(60, np.float32), np.zeros(60, np.float32))
        spread = seen.spread(total=60, rate=30, cuts=[])
        assert {*spread.frames.tolist()} == {*range(60)}
        most[step] = np.bincount(spread.frames).max()
    assert most == {0: 2 * frames_within(LIMITS.near_seconds, 30) + 1, 9: 2 * 18 + 1}


def test_a_bystander_who_rests_is_covered_between_two_sights() -> None:
    frames = np.array([10, 20], np.int32)
    boxes = np.array([[0, 0, 9, 9]] * 2, np.float32)
    seen = Bystanders(frames, boxes, np.ones(2, np.float32), np.zeros(2, np.float32))
    assert {*range(10, 21)} <= {*seen.spread(total=40, rate=30, cuts=[]).frames.tolist()}


def test_a_face_that_is_followed_from_its_next_sight_on_was_no_bystander() -> None:
    box, near = np.array([0, 0, 9, 9], np.float32), frames_within(LIMITS.near_seconds, 30)
    one = (np.array([20], np.int32), box[None], *np.ones((2, 1), np.float32))
    whole = {*range(20 - 18, 20 + 18 + 1)}
    for frames, left in (
        ([], whole),
        ([22], {*range(20 - 18, 20 + near + 1)}),
        ([18], {*range(20 - near, 20 + 18 + 1)}),
        ([20, 22], whole),  # both are there at once
        ([20 + near + 1], whole),
    ):
        followed = {frame: [box + 3] for frame in frames}
        spread = Bystanders(*one, followed).spread(total=60, rate=30, cuts=[])
        assert {*spread.frames.tolist()} == left
    elsewhere = Bystanders(*one, {21: [box + 9]}).spread(total=60, rate=30, cuts=[])
    assert {*elsewhere.frames.tolist()} == whole


def test_without_bystanders_there_is_nothing_to_spread() -> None:
    none = Bystanders(np.zeros(0, np.int32), np.zeros((0, 4), np.float32), *np.zeros((2, 0), np.float32))
    assert len(none.spread(total=5, rate=30, cuts=[]).frames) == 0


@given(st.lists(st.tuples(st.integers(1, 12), st.integers(1, 12)), min_size=1, max_size=4), st.integers(0, 5))
def test_what_is_done_at_a_time_does_not_depend_on_the_frame_rate(
    spells: list[tuple[int, int]], before: int
) -> None:
    """A face is trusted and unseen in turn, for multiples of 0.2 s, which are whole frames at both rates."""
    edges = 0.2 * (before + np.cumsum([0, *(count for spell in spells for count in spell)]))
    total, done = float(edges[-1]) + 1, []
    instants = np.arange(0, total, 0.001)
    for rate in RATES:
        times = (np.arange(round(total * rate)) + 0.5) / rate
        seen = np.flatnonzero((np.searchsorted(edges, times) % 2 == 1) & (times < edges[-1]))
        made = decide(rows(seen.tolist(), x=0), "swap", total=len(times), rate=rate, cuts=[])
        by_frame = np.full(len(times), -1)
        by_frame[made.frames] = made.done
        done.append(by_frame[np.minimum((instants * rate).astype(int), len(times) - 1)])
    changes = np.count_nonzero(np.diff(done[0])) + 2
    assert np.count_nonzero(done[0] != done[1]) * 0.001 <= changes * 0.041  # a frame at the lower rate


@pytest.mark.parametrize("unseen", [0.04, 0.2, 0.4, 0.56])
def test_a_cover_is_as_large_at_either_frame_rate(unseen: float) -> None:
    grown = []
    for rate in RATES:
        gap = range(round(1 * rate), round((1 + 2 * unseen) * rate))
        seen = [f for f in range(round(4 * rate)) if f not in gap]
        made = decide(rows(seen), "cover", total=round(4 * rate), rate=rate, cuts=[])
        grown.append(made.growth.max())
        face = FollowedFace()
        face.see(1.0, PLACE)
        ahead, live = made.growth[round((1 + unseen) * rate)], face.region(1 + unseen)
        assert live is not None
        assert np.ptp(live[::2]) / np.ptp(PLACE.region()[::2]) == pytest.approx(1 + 2 * unseen)
        assert ahead == pytest.approx(1 + 2 * unseen, abs=LIMITS.growth_per_second / rate + 1e-6)
    assert grown[0] == pytest.approx(grown[1], abs=LIMITS.growth_per_second / min(RATES))


PLACE = FacePlace(np.array([100.0, 100, 140, 150]), 0.0)


def run(rate: float, seconds: float) -> np.ndarray:
    """Times of frames."""
    return 5 + np.arange(1, round(seconds * rate) + 1) / rate


@pytest.mark.parametrize("rate", RATES)
def test_a_followed_face_is_distrusted_for_a_while_after_doubt(rate: float) -> None:
    face = FollowedFace()
    assert face.is_trusted(4.9, 0.9)
    assert not face.is_trusted(5, 0.4)
    trusted = [face.is_trusted(now, 0.9) for now in run(rate, 1.0)]
    assert trusted == sorted(trusted)
    assert trusted.index(True) / rate == pytest.approx(LIMITS.near_seconds, abs=1 / rate)


@pytest.mark.parametrize("rate", RATES)
def test_an_unseen_face_is_covered_ever_farther_until_it_has_left(rate: float) -> None:
    face = FollowedFace()
    assert face.has_left(0)
    assert face.region(0) is None
    face.see(5, PLACE)
    regions = [face.region(now) for now in run(rate, 1.0)]
    known = [one for one in regions if one is not None]
    assert len(known) / rate == pytest.approx(LIMITS.unseen_seconds, abs=1 / rate)
    assert all(one is None for one in regions[len(known) :])
    widths = [np.ptp(one[::2]) for one in known]
    assert widths == sorted(widths)
    assert widths[-1] / np.ptp(PLACE.region()[::2]) == pytest.approx(2.2, abs=2 / rate)


def test_a_cover_holds_the_face_where_it_was_detected_when_the_fit_lags() -> None:
    face, moved = FollowedFace(), FacePlace(PLACE.box - (16, 0, 16, 0), 0.0)
    face.see(1.0, PLACE)
    stranger = FacePlace(PLACE.box + 100, 0.0)
    assert [face.holds(1.0, one) for one in (moved, stranger)] == [True, False]
    covered = face.region(1.0, [moved, stranger])
    assert covered is not None
    np.testing.assert_allclose(covered[:2], np.minimum(PLACE.region(), moved.region())[:2])
    np.testing.assert_allclose(covered[2:], np.maximum(PLACE.region(), moved.region())[2:])


def test_a_lost_face_is_followed_by_what_is_detected_where_it_was() -> None:
    face = FollowedFace()
    face.see(1.0, PLACE)
    far, near = (FacePlace(PLACE.box + shift, 0.0) for shift in (90, 10))
    face.look_for(1.5, [far])
    assert not face.holds(1.5, far)
    face.look_for(1.6, [far, near])
    assert not face.has_left(2.2)
    assert face.holds(2.2, near)


@pytest.mark.parametrize("rate", RATES)
def test_an_unfollowed_face_stays_covered_for_as_long_as_an_unseen_one(rate: float) -> None:
    faces = UnfollowedFaces()
    assert len(faces.see(5, [PLACE])) == 1
    assert len(faces.see(5.01, [FacePlace(PLACE.box + 1, 0.0)])) == 1  # it rests: one cover
    counts = [len(faces.see(now + 0.01, [])) for now in run(rate, 1.0)]
    assert sum(counts) / rate == pytest.approx(LIMITS.unseen_seconds, abs=1 / rate)
    assert counts == sorted(counts, reverse=True)
