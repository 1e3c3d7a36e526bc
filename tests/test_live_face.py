"""What is shown instead of the person: it fails closed when they leave, hide or have company; settings count."""

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.heads import region
from guise.aam.landmarks.schemes import IBUG68
from guise.aam.model import Identity
from guise.app.drawing.face import PAUSE_SECONDS
from guise.app.drawing.look import SWAP
from guise.app.live.face import CastMember, FaceResult, LiveFaces
from guise.app.live.options import LiveSettings
from guise.app.media import Frame, open_input
from guise.app.swapping.policy import LIMITS
from guise.common.arrays import F64, U8, Bool
from guise.common.threads import one_thread

SOLID = LiveSettings(style="solid")
FPS = 30
HEIGHT, WIDTH = 480, 640
BOARD = (60, 90, 160)  # a colour that no hair has
VISITOR = (slice(60, 240), slice(660, 900))  # rows and columns of a wide picture


@pytest.fixture(scope="module")
def talk() -> list[U8]:
    """The first second of a sample clip, RGB."""
    return pictures("p01", FPS)


@pytest.fixture(scope="module")
def visitor() -> list[U8]:
    """Somebody else, with a face some 80 pixels wide."""
    return [picture[:360:2, 80:560:2] for picture in pictures("p06", FPS)]


@pytest.fixture(scope="module")
def truth() -> F64:
    """Where the face is in each picture of the clip, (t, 81, 2)."""
    return np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(float)


@pytest.fixture
def face(p01: Identity) -> Iterator[LiveFaces]:
    with one_thread(), LiveFaces([CastMember(p01, [p01, stiff(p01)])]) as face:
        yield face


def pictures(person: str, count: int) -> list[U8]:
    with open_input(SAMPLES / person / "talk.mp4") as source:
        return [frame.rgb() for frame, _ in zip(source, range(count), strict=False)]


def stiff(identity: Identity) -> Identity:
    """The same person with fewer expressions of their own, and a still in other colours."""
    own = identity.appearance.components
    few = replace(own, basis=own.basis[:, :2], deviations=own.deviations[:2])
    rest_frame = replace(identity.rest_frame, picture=np.asarray(255 - identity.rest_frame.picture, np.uint8))
    return replace(identity, appearance=replace(identity.appearance, components=few), rest_frame=rest_frame)


def empty(seed: int, width: int = WIDTH) -> U8:
    """A picture in which there is nobody."""
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, width, 3), np.uint8)


class Player:
    """Plays pictures to a face at FPS and reports what became of them."""

    def __init__(self, face: LiveFaces) -> None:
        self.face, self.count = face, 0

    def __call__(self, picture: U8, settings: LiveSettings = SOLID) -> tuple[FaceResult, Bool, U8]:
        """What was done, which pixels (h, w) changed, and the picture that is shown."""
        frame = Frame.from_rgb(picture, self.count, Fraction(1, FPS), self.count)
        self.count += 1
        result = self.face.process(frame, settings)
        after = frame.rgb()
        return result, (after != picture).any(axis=2), after


def box(points: F64) -> tuple[slice, slice]:
    """Rows and columns of a face's 68 points (81, 2), the outermost pixel left out."""
    x0, y0, x1, y1 = *points[IBUG68].min(0), *points[IBUG68].max(0)
    return slice(int(y0) + 1, int(y1)), slice(int(x0) + 1, int(x1))


def test_the_person_is_swapped_from_the_first_picture_and_the_background_stays(
    face: LiveFaces, talk: list[U8], truth: F64
) -> None:
    play = Player(face)
    for number, picture in enumerate(talk[:5]):
        result, changed, _ = play(picture)
        assert (result.outcome, result.covered) == ("swapped", 0)
        assert result.mesh is not None
        assert np.linalg.norm(result.mesh[IBUG68] - truth[number][IBUG68], axis=1).mean() < 8
        assert not changed[:, :100].any()
        assert changed[box(truth[number])].mean() > 0.7


@pytest.mark.slow
def test_when_the_person_leaves_a_growing_region_is_covered_then_all(
    face: LiveFaces, talk: list[U8], truth: F64
) -> None:
    play = Player(face)
    for picture in talk[:3]:
        play(picture)
    last, areas, outcomes = box(truth[2]), [], []
    for number in range(round(LIMITS.unseen_seconds * FPS) + 4):
        result, changed, _ = play(empty(number))
        outcomes.append(result.outcome)
        areas.append(changed.mean())
        assert changed[last].mean() > 0.9
    assert outcomes == sorted(outcomes)
    assert set(outcomes) == {"covered", "lost"}
    assert outcomes.index("lost") in range(
        round(LIMITS.unseen_seconds * FPS) - 2, round(LIMITS.unseen_seconds * FPS) + 2
    )
    assert areas == sorted(areas)
    assert areas[0] < 0.6
    assert areas[-1] > 0.99


@pytest.mark.slow
def test_who_returns_is_covered_until_the_face_was_confident_for_a_while(
    face: LiveFaces, talk: list[U8], truth: F64
) -> None:
    play = Player(face)
    for picture in [*talk[:2], *(empty(n) for n in range(40))]:
        play(picture)
    outcomes = []
    for number, picture in enumerate(talk[2:12]):
        result, changed, _ = play(picture)
        outcomes.append(result.outcome)
        assert changed[box(truth[number + 2])].mean() > (0.7 if result.outcome == "swapped" else 0.99)
    first = outcomes.index("swapped")
    assert first >= LIMITS.near_seconds * FPS - 1
    assert set(outcomes[first:]) == {"swapped"}


def hidden_from(picture: U8, shape: F64, share: float) -> tuple[U8, slice, slice]:
    """A picture with a board in front of a face (81, 2) from a share of its height down; rows and columns above.

    The board is pale: one of the hair's colour that touches the hair is taken for a lock of it (`_hair_coloured`).
    """
    rows, columns = box(shape)
    top = rows.start + round(share * (rows.stop - rows.start))
    hidden = picture.copy()
    hidden[top:, columns] = BOARD
    return hidden, slice(rows.start, top), columns


def test_a_face_that_is_hidden_is_covered(face: LiveFaces, talk: list[U8], truth: F64) -> None:
    play = Player(face)
    play(talk[0])
    hidden, rows, columns = hidden_from(talk[1], truth[1], 0.2)
    result, changed, _ = play(hidden)
    assert (result.outcome, result.mesh) == ("covered", None)
    assert changed[rows, columns].mean() > 0.99


@pytest.mark.parametrize("share", [0.45, 0.5, 0.6])
def test_a_face_behind_a_board_is_swapped_around_it(
    face: LiveFaces, talk: list[U8], truth: F64, share: float
) -> None:
    play = Player(face)
    play(talk[0])
    hidden, rows, columns = hidden_from(talk[1], truth[1], share)
    for _ in range(round(PAUSE_SECONDS * FPS)):
        result, changed, _ = play(hidden)
        assert result.outcome == "swapped"
    assert changed[rows, columns].mean() > 0.7
    assert changed[rows.stop + 20 : rows.stop + 40, columns].mean() < 0.1


@pytest.mark.slow
def test_somebody_else_is_covered_beside_the_swap_and_for_a_while_after(
    face: LiveFaces, talk: list[U8], visitor: list[U8]
) -> None:
    play = Player(face)
    play(wide(talk[0]))
    for number in range(1, 4):
        result, changed, _ = play(wide(talk[number], visitor[number]))
        assert (result.outcome, result.covered) == ("swapped", 1)
        assert changed[VISITOR][30:130, 70:170].mean() > 0.99
    covered = []
    for number in range(4, 4 + round(LIMITS.unseen_seconds * FPS) + 4):
        result, changed, _ = play(wide(talk[number]))
        assert result.outcome == "swapped"
        covered.append(bool(changed[VISITOR].any()))
    assert covered == sorted(covered, reverse=True)
    assert covered.count(True) in range(
        round(LIMITS.unseen_seconds * FPS) - 1, round(LIMITS.unseen_seconds * FPS) + 2
    )


@pytest.mark.slow
def test_somebody_else_alone_is_never_shown(face: LiveFaces, talk: list[U8]) -> None:
    play = Player(face)
    play(talk[0])
    for picture in pictures("p06", 40):
        result, changed, _ = play(picture)
        assert result.outcome in ("covered", "lost")
        assert changed[140:340, 240:400].mean() > 0.99


def test_off_covers_who_is_there_and_all_when_nobody_is(face: LiveFaces, talk: list[U8], truth: F64) -> None:
    play, off = Player(face), replace(SOLID, mode="off", unsure="leave")
    for number, picture in enumerate(talk[:3]):
        result, changed, after = play(picture, off)
        assert (result.outcome, result.mesh, result.covered) == ("off", None, 1)
        assert np.ptp(after[box(truth[number])].reshape(-1, 3), axis=0).max() <= 1
        assert 0.05 < changed.mean() < 0.6
    for number in range(round(LIMITS.unseen_seconds * FPS) + 2):
        result, changed, _ = play(empty(number), off)
    assert result.outcome == "off"
    assert changed.mean() > 0.99


def test_unsure_leave_shows_what_cannot_be_swapped_and_nothing_else(face: LiveFaces, talk: list[U8]) -> None:
    play, bare = Player(face), replace(SOLID, unsure="leave")
    assert play(talk[0], bare)[0].outcome == "swapped"
    result, changed, _ = play(empty(0), bare)
    assert result.outcome == "shown"
    assert not changed.any()
    assert play(empty(1), SOLID)[1].any()


@pytest.mark.slow
def test_a_puppet_shows_nothing_of_the_picture(p01: Identity, talk: list[U8]) -> None:
    puppet = replace(SOLID, mode="puppet")
    shown = []
    for seed in (0, 1):
        with LiveFaces([CastMember(p01, [p01])]) as face:
            result, _, after = Player(face)(empty(seed), puppet)
            assert result.outcome == "swapped"
            shown.append(after)
    assert (shown[0] == shown[1]).all()
    magenta = talk[0].copy()
    magenta[:, :100] = (255, 0, 255)
    with LiveFaces([CastMember(p01, [p01])]) as face:
        _, changed, after = Player(face)(magenta, puppet)
    assert changed[:, :100].all()
    assert (after[..., 1] > 0)[:, :100].mean() > 0.9


@pytest.mark.parametrize("changes", [{"identity": 1, "mode": "puppet"}, {"identity": 1}])
@pytest.mark.slow
def test_the_chosen_face_takes_effect_at_once_and_back(
    face: LiveFaces, talk: list[U8], changes: dict[str, object]
) -> None:
    assert_effect(face, talk, replace(SOLID, mode=changes.get("mode", "swap")), replace(SOLID, **changes))


@pytest.mark.slow
def test_alpha_takes_effect_at_once_and_back(face: LiveFaces, talk: list[U8]) -> None:
    assert_effect(face, talk, replace(SOLID, identity=1, alpha=0.0), replace(SOLID, identity=1, alpha=1.0))


SETTLING_FRAMES = 12  # until light and grain stay the same on one picture


def assert_effect(face: LiveFaces, talk: list[U8], one: LiveSettings, other: LiveSettings) -> None:
    play = Player(face)
    for _ in range(SETTLING_FRAMES):
        play(talk[-1], one)
    first, second, again = (play(talk[-1], settings)[2].astype(int) for settings in (one, other, one))
    assert np.abs(first - second).max() > 10
    assert np.abs(first - again).mean() < 0.5 * np.abs(first - second).mean()


def wide(picture: U8, other: U8 | None = None) -> U8:
    """A picture with a bare wall to its right, and somebody there."""
    canvas = np.full((HEIGHT, 960, 3), 120, np.uint8)
    canvas[:, :WIDTH] = picture
    if other is not None:
        canvas[VISITOR] = other
    return canvas


def test_the_region_of_a_cover_takes_in_the_whole_head(face: LiveFaces, talk: list[U8], truth: F64) -> None:
    _, changed, _ = Player(face)(talk[0], replace(SOLID, mode="off"))
    inner = truth[0][IBUG68]
    x0, y0, x1, y1 = region(np.concatenate([inner.min(0), inner.max(0)]), 0.85).astype(int)
    middle = (x0 + x1) // 2
    assert changed[max(y0, 0) : y1, middle].all()
    assert changed[(y0 + y1) // 2, x0:x1].all()


def test_a_puppet_leaves_the_model_of_its_face_as_it_was(
    face: LiveFaces, p01: Identity, talk: list[U8]
) -> None:
    before = p01.appearance.neutral.copy()
    for number, picture in enumerate(talk[:5]):
        face.process(Frame.from_rgb(picture, number, Fraction(1, FPS), number), LiveSettings(mode="puppet"))
    np.testing.assert_array_equal(p01.appearance.neutral, before)


def test_live_only_objects_in_front_of_the_face_are_kept(p01: Identity) -> None:
    """What looks like hair or glasses in front could be the person's own face."""
    with LiveFaces([CastMember(p01, [p01])], replace(SWAP, renderer="cpu")) as face:
        assert face.look.in_front == "objects"
