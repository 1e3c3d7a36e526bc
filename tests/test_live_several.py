"""Several people at the camera: each gets their own face wherever they sit, and who is not known is covered."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.model import Identity
from guise.app.live.face import CastMember, LiveFaces
from guise.app.live.options import LiveSettings
from guise.app.media import Frame, open_input
from guise.app.swapping.donors import open_donor
from guise.common.arrays import U8
from guise.common.threads import one_thread

pytestmark = pytest.mark.slow

SOLID = LiveSettings(style="solid")
FPS, FRAMES = 30, 12
FACE = (slice(140, 340), slice(240, 400))  # rows and columns of a face in a sample clip


def pictures(person: str) -> list[U8]:
    with open_input(SAMPLES / person / "talk.mp4") as source:
        return [frame.rgb() for frame, _ in zip(source, range(FRAMES), strict=False)]


@pytest.fixture(scope="module")
def both() -> tuple[list[U8], list[U8]]:
    """Two sample people, for a while."""
    return pictures("p01"), pictures("p06")


@pytest.fixture(scope="module")
def p06() -> Identity:
    return Identity.load(model_file("p06"))


@pytest.fixture
def faces(p01: Identity, p06: Identity) -> Iterator[LiveFaces]:
    cast = [CastMember(p01, [open_donor("p03")]), CastMember(p06, [open_donor("p04")])]
    with one_thread(), LiveFaces(cast) as faces:
        yield faces


def played(faces: LiveFaces, shown: list[U8]) -> list[tuple[str, int, U8]]:
    """What was done with each picture, how much was covered, and the picture that came of it."""
    done = []
    for number, picture in enumerate(shown):
        frame = Frame.from_rgb(picture, number, Fraction(1, FPS), number)
        result = faces.process(frame, SOLID)
        done.append((result.outcome, result.covered, frame.rgb()))
    return done


def test_each_gets_their_own_face_on_either_side(faces: LiveFaces, both: tuple[list[U8], list[U8]]) -> None:
    one, other = both
    beside = [np.hstack(pair) for pair in zip(one, other, strict=True)]
    apart = played(faces, beside)
    assert [done for done, _, _ in apart[4:]] == ["swapped"] * (FRAMES - 4)
    assert [covered for _, covered, _ in apart[4:]] == [0] * (FRAMES - 4)
    last = apart[-1][2]
    alone = [frames[-1][FACE] for frames in both]
    for number, own in enumerate(alone):
        shown = last[:, number * 640 :][:, :640][FACE]
        assert np.abs(shown.astype(int) - own).mean() > 4
    places_swapped = played(faces, [np.hstack(pair) for pair in zip(other, one, strict=True)] * 2)
    for number, own in enumerate(alone[::-1]):  # nobody's own face is seen meanwhile
        for _, _, picture in places_swapped[:-1]:
            assert np.abs(picture[:, number * 640 :][:, :640][FACE].astype(int) - own).mean() > 4
    assert places_swapped[-1][:2] == ("swapped", 0)


def test_a_newcomer_is_covered(p06: Identity, both: tuple[list[U8], list[U8]]) -> None:
    one, other = both
    with one_thread(), LiveFaces([CastMember(p06, [open_donor("p04")])]) as faces:
        done = played(faces, [np.hstack(pair) for pair in zip(one, other, strict=True)])
    for outcome, covered, picture in done[4:]:
        assert (outcome, covered) == ("swapped", 1)
        assert picture[FACE].reshape(-1, 3).std(0).max() < 1


def test_nobody_known_covers_everything(p06: Identity, both: tuple[list[U8], list[U8]]) -> None:
    with one_thread(), LiveFaces([CastMember(p06, [open_donor("p04")])]) as faces:
        done = played(faces, both[0])
    assert all(picture[FACE].reshape(-1, 3).std(0).max() < 1 for _, _, picture in done)
