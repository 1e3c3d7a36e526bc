"""Tracklets of segments become tracks of a video."""

import numpy as np

from guise.app.people.cuts import CutDetector, is_cut
from guise.app.people.faces import SegmentFaces
from guise.app.people.link import link

RNG = np.random.default_rng(0)
SCENE = RNG.integers(0, 256, (18, 32), dtype=np.uint8)
OTHER = RNG.integers(0, 256, (18, 32), dtype=np.uint8)


def found(
    *tracklets: tuple[range, float], cuts: tuple[int, ...] = (), ends: tuple[np.ndarray, ...] = (SCENE, SCENE)
) -> SegmentFaces:
    """A segment with tracklets of the given frames, 40 pixels wide, at the given x."""
    rows = [(n, f, x) for n, (frames, x) in enumerate(tracklets) for f in frames]
    boxes = np.array([[x, 50, x + 40, 90] for _, _, x in rows], np.float32).reshape(-1, 4)
    return SegmentFaces(
        np.array([n for n, _, _ in rows], np.int32), np.array([f for _, f, _ in rows], np.int32),
        np.ones(len(rows), np.float32), boxes, np.zeros(len(rows), np.float32),
        np.zeros((len(rows), 81, 2), np.float32),
        np.zeros(0, np.int32), np.zeros((0, 4), np.float32), np.zeros(0, np.float32), np.zeros(0, np.float32),
        np.array(cuts, np.int32), np.stack(ends),
    )  # fmt: skip


def members(chains: list) -> list[list[tuple[int, int]]]:
    return [[(p.segment, p.number) for p in chain] for chain in chains]


def test_a_track_goes_on_through_a_joint() -> None:
    chains, cuts = link([found((range(0, 100), 10)), found((range(100, 200), 12))], [0, 100], 30)
    assert members(chains) == [[(0, 0), (1, 0)]]
    assert cuts == []


def test_two_people_keep_their_tracks_through_a_joint() -> None:
    first = found((range(0, 100), 10), (range(0, 100), 300))
    second = found((range(100, 200), 301), (range(100, 200), 11))
    chains, _ = link([first, second], [0, 100], 30)
    assert sorted(members(chains)) == [[(0, 0), (1, 1)], [(0, 1), (1, 0)]]


def test_a_short_absence_is_a_gap_and_a_long_one_is_the_end() -> None:
    short, _ = link([found((range(0, 50), 10), (range(80, 120), 30))], [0], 30)
    long, _ = link([found((range(0, 50), 10), (range(150, 200), 30))], [0], 30)
    assert members(short) == [[(0, 0), (0, 1)]]
    assert members(long) == [[(0, 0)], [(0, 1)]]


def test_nothing_goes_on_over_a_cut() -> None:
    inside, cuts = link([found((range(0, 50), 10), (range(50, 90), 10), cuts=(50,))], [0], 30)
    assert members(inside) == [[(0, 0)], [(0, 1)]]
    assert cuts == [50]
    between = [found((range(0, 100), 10)), found((range(100, 200), 10), ends=(OTHER, OTHER))]
    chains, cuts = link(between, [0, 100], 30)
    assert members(chains) == [[(0, 0)], [(1, 0)]]
    assert cuts == [100]


def test_a_face_elsewhere_or_of_another_size_is_another_one() -> None:
    apart, _ = link([found((range(0, 50), 10), (range(51, 90), 200))], [0], 30)
    assert len(apart) == 2


def test_a_video_without_faces_has_no_tracks() -> None:
    assert link([found()], [0], 30) == ([], [])


def test_a_cut_is_told_from_noise_and_from_a_change_of_light() -> None:
    noisy = np.clip(SCENE.astype(int) + RNG.integers(-20, 21, SCENE.shape), 0, 255).astype(np.uint8)
    darker = (SCENE * 0.6).astype(np.uint8)
    assert is_cut(SCENE, OTHER)
    assert not is_cut(SCENE, noisy)
    assert not is_cut(SCENE, darker)


def test_a_cut_that_changes_little_is_sudden_and_a_motion_that_changes_more_is_not() -> None:
    """Two faces before one ground, in nearly the same light; then a thing that moves faster and faster."""
    face, other = (np.full((18, 32), 120, np.uint8) for _ in range(2))
    face[4:14, 11:21] = RNG.integers(60, 180, (10, 10))
    other[4:14, 11:21] = RNG.integers(60, 180, (10, 10))

    def cuts(pictures: list[np.ndarray]) -> list[int]:
        detector = CutDetector()
        return [k for k, picture in enumerate(pictures) if detector.update(picture)]

    def noisy(picture: np.ndarray) -> np.ndarray:
        return np.clip(picture + (RNG.random(picture.shape) > 0.8), 0, 255).astype(np.uint8)

    assert not is_cut(face, other)
    assert cuts([noisy(face) for _ in range(9)] + [noisy(other) for _ in range(9)]) == [9]
    assert cuts([face, face, face, other]) == []  # too early to know how much changes
    moving = []
    for k in range(20):
        picture = np.full((18, 32), 120, np.uint8)
        picture[4:14, k : k + 8] = 250
        moving.append(noisy(picture))
    assert cuts(moving) == []
    darker = [noisy((SCENE * share).astype(np.uint8)) for share in [1.0] * 8 + [0.6] * 8]
    assert cuts(darker) == []
