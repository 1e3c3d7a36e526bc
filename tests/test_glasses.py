"""A donor's glasses come along if that is wished, on their head's place and pose, and only over who wears none."""

from dataclasses import replace

import numpy as np
import pytest
from models import model_file
from numpy.testing import assert_array_equal
from worn_glasses import with_glasses

from guise.aam.glasses import WornGlasses
from guise.aam.landmarks.schemes import LIPS, NOSE_ROOT
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.look import LIVE, SWAP, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.blend import Blend
from guise.app.media import Frame
from guise.common.arrays import U8

KEEP = replace(SWAP, glasses="keep")


def wearing(name: str) -> Identity:
    """A person who was enrolled with glasses, as their frame at rest shows."""
    bare = Identity.load(model_file(name))
    rest = bare.rest_frame
    return replace(bare, rest_frame=replace(rest, picture=with_glasses(rest.picture, rest.shape)))


@pytest.fixture(scope="module")
def person() -> Identity:
    return Identity.load(model_file("p02"))


@pytest.fixture(scope="module")
def donor() -> Identity:
    return wearing("p01")


def swapped(person: Identity, donor: Identity, look: Look) -> U8:
    """The person's frame at rest with the donor's face."""
    rest = person.rest_frame
    frame = Frame.from_rgb(rest.picture.copy())
    with Engine(person, Donor.of(donor), None, look) as engine:
        engine.draw(frame, rest.shape)
    return frame.rgb()


def darkened(person: Identity, donor: Identity, look: Look = KEEP) -> np.ndarray:
    """(h, w) share of its brightness that each pixel loses by the donor's glasses."""
    bare, worn = (
        swapped(person, donor, one).astype(float).mean(2) for one in (replace(look, glasses="off"), look)
    )
    return np.asarray(1 - worn / np.maximum(bare, 1))


def test_who_wears_none_has_none() -> None:
    assert WornGlasses.of(Identity.load(model_file("p01")).rest_frame) is None


def test_rims_and_bridge_are_dark_and_nothing_else_is(donor: Identity) -> None:
    rest, worn = donor.rest_frame, WornGlasses.of(donor.rest_frame)
    assert worn is not None
    points = rest.shape @ worn.to_crop[:, :2].T + worn.to_crop[:, 2]
    x, y = np.round(points[NOSE_ROOT]).astype(int)
    assert worn.ratio[y - 25 : y + 26, x].min() < 0.4  # the bridge
    below = worn.ratio[int(points[LIPS, 1].min()) :]
    assert np.abs(below - 1).max(initial=0) == 0
    dark = worn.ratio < 0.7
    assert 0.01 < dark.mean() < 0.12
    assert np.median(worn.ratio) == 1


@pytest.mark.parametrize("look", [SWAP, LIVE])
def test_they_lie_before_the_eyes_of_the_person_and_leave_the_rest(
    person: Identity, donor: Identity, look: Look
) -> None:
    change = darkened(person, donor, replace(look, glasses="keep"))
    shape = person.rest_frame.shape
    size = np.ptp(shape[:, 0])
    ys, xs = np.nonzero(change > 0.3)
    assert len(xs) > 0.002 * size**2
    assert abs(xs.mean() - shape[NOSE_ROOT, 0]) < 0.08 * size
    assert abs(ys.mean() - shape[NOSE_ROOT, 1]) < 0.12 * size
    assert 0.45 * size < np.ptp(xs) < 1.1 * size
    mouth = np.s_[int(shape[LIPS, 1].min()) : int(shape[LIPS, 1].max())]
    assert np.abs(change[mouth]).max() < 0.02


def test_who_wears_glasses_keeps_their_own(donor: Identity) -> None:
    assert_array_equal(swapped(wearing("p02"), donor, KEEP), swapped(wearing("p02"), donor, SWAP))


def test_a_donor_without_glasses_is_drawn_as_ever(person: Identity) -> None:
    bare = Identity.load(model_file("p01"))
    assert_array_equal(swapped(person, bare, KEEP), swapped(person, bare, SWAP))


@pytest.mark.parametrize("kind", [FaceClass.OCCLUDER, FaceClass.HAIR])
def test_hands_and_hair_stay_in_front_of_them(
    person: Identity, donor: Identity, kind: FaceClass, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hidden(self: Blend, face: FaceInFrame, memory: Memory) -> None:
        begin(self, face, memory)
        assert face.parsed is not None
        shares = face.parsed.shares.copy()
        shares[kind] = 1
        face.parsed = replace(face.parsed, shares=shares)

    begin = Blend.begin
    monkeypatch.setattr(Blend, "begin", hidden)
    assert np.abs(darkened(person, donor)).max() < 0.02
