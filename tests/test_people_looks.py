"""A face that doesn't move is looked at once; what changes, however slowly, again."""

from __future__ import annotations

import numpy as np
import pytest

from guise.aam.landmarks import Face
from guise.aam.landmarks.schemes import COUNT
from guise.app.people.looks import LIMITS, Looks
from guise.common.arrays import F32, U8

BOX = np.array([20, 30, 80, 90], np.float32)


class Counted:
    """A landmarker that finds a face in every box, and counts."""

    def __init__(self) -> None:
        self.looks = 0

    def look_in_box(self, rgb: U8, box: F32, turn: float) -> tuple[Face, float]:
        self.looks += 1
        corners = np.random.default_rng(0).uniform(box[:2], box[2:], (COUNT, 2))
        return Face.around(corners, 0.9), float(self.looks)

    def refine(self, rgb: U8, previous: Face) -> Face:
        return self.look_in_box(rgb, previous.box, 0.0)[0]


@pytest.fixture
def counted() -> Counted:
    return Counted()


@pytest.fixture
def rgb() -> U8:
    return np.random.default_rng(1).integers(20, 230, (120, 120, 3)).astype(np.uint8)


def noisy(rgb: U8, seed: int) -> U8:
    noise = np.random.default_rng(seed).integers(-2, 3, rgb.shape)
    return (rgb + noise).astype(np.uint8)


def test_a_box_in_a_still_picture_is_looked_at_once(counted: Counted, rgb: U8) -> None:
    looks = Looks(counted)  # type: ignore[arg-type]
    seen = [looks.look_in_box(noisy(rgb, k), BOX + k / 10, 0.0)[1] for k in range(10)]
    assert seen == [1.0] * 10
    assert looks.look_in_box(rgb, BOX, np.pi)[1] == 2  # at another roll
    assert looks.look_in_box(rgb, BOX + 20, 0.0)[1] == 3  # elsewhere


def test_a_face_that_rests_keeps_its_points(counted: Counted, rgb: U8) -> None:
    looks = Looks(counted)  # type: ignore[arg-type]
    face = looks.look_in_box(rgb, BOX, 0.0)[0]
    first = looks.refine(rgb, face)
    assert all(looks.refine(noisy(rgb, k), first) is first for k in range(5))
    assert counted.looks == 2
    changed = rgb.copy()
    changed[50:60, 40:50] += 15
    assert looks.refine(changed, first) is not first


def test_slow_changes_add_up(counted: Counted, rgb: U8) -> None:
    looks = Looks(counted)  # type: ignore[arg-type]
    for step in range(10):
        looks.look_in_box(rgb + np.uint8(step), BOX, 0.0)
    assert counted.looks == 1 + 9 // (LIMITS.max_grey_levels + 1)


def test_a_box_beyond_the_picture_is_always_looked_at(counted: Counted, rgb: U8) -> None:
    looks = Looks(counted)  # type: ignore[arg-type]
    for _ in range(3):
        looks.look_in_box(rgb, BOX + 300, 0.0)
    assert counted.looks == 3


class Refusing(Counted):
    """A landmarker that finds a face nowhere."""

    def __init__(self, likeness: float) -> None:
        super().__init__()
        self.likeness = likeness

    def look_in_box(self, rgb: U8, box: F32, turn: float) -> tuple[None, float]:  # type: ignore[override]
        self.looks += 1
        return None, self.likeness


@pytest.mark.parametrize(("likeness", "expected"), [(-20.0, 3), (LIMITS.refused_likeness + 1, 12)])
def test_a_place_far_from_any_face_is_left_alone_for_some_looks(likeness: float, expected: int) -> None:
    landmarker = Refusing(likeness)
    looks = Looks(landmarker)  # type: ignore[arg-type]
    moving = np.random.default_rng(2).integers(20, 230, (12, 120, 120, 3)).astype(np.uint8)
    for k, rgb in enumerate(moving):
        looks.look_in_box(rgb, BOX + k, 0.0)  # further in all than one look's box reaches
    assert landmarker.looks == expected
