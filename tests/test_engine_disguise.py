"""A disguise: other proportions within the same outline, over everything that lies there."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file
from numpy.typing import NDArray

from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    BROWS,
    EYES,
    FOREHEAD,
    HAIRLINE,
    JAW,
    LEFT_EYE,
    LIPS,
    MIRROR,
    NOSE,
    NOSE_ROOT,
    OUTLINE,
    RIGHT_EYE,
)
from guise.aam.model import Identity
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.solid_shape import HeadPose, SolidPrior, depth_across
from guise.app.media import open_input
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.app.swapping.place import convex, proportions
from guise.app.swapping.silhouette import View
from guise.common.arrays import F64

FRAME = ReferenceFrame.canonical(160)


def _areas(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed areas (t,) of the mesh's triangles, twice."""
    a, b, c = (points[FRAME.triangles[:, k]] for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def _apart(points: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(points[LEFT_EYE].mean(0) - points[RIGHT_EYE].mean(0)))


def _brows(points: NDArray[np.float64]) -> float:
    """Height of the brows over the eyes."""
    return float(points[EYES, 1].mean() - points[BROWS, 1].mean())


def test_eyes_lie_farther_apart_and_brows_higher() -> None:
    before, after = FRAME.points, proportions(FRAME) @ FRAME.points
    assert _apart(after) > 1.03 * _apart(before)
    assert _brows(after) > 1.03 * _brows(before)
    np.testing.assert_array_equal(after[LIPS], before[LIPS])


def test_outline_and_nose_stay() -> None:
    still = np.r_[OUTLINE, NOSE]
    np.testing.assert_allclose((proportions(FRAME) @ FRAME.points)[still], FRAME.points[still], atol=1e-9)


def test_both_sides_change_alike() -> None:
    moved = proportions(FRAME) @ FRAME.points - FRAME.points
    np.testing.assert_allclose(moved[list(MIRROR)] * [-1, 1], moved, atol=0.01 * FRAME.resolution)


def test_place_size_and_turn_in_the_picture_do_not_matter() -> None:
    turn = 1.7 * np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    first = proportions(FRAME) @ (FRAME.points @ turn + (300, -20))
    np.testing.assert_allclose(first, (proportions(FRAME) @ FRAME.points) @ turn + (300, -20), atol=1e-9)


@pytest.mark.parametrize("yaw", [-35, 0, 35])
def test_no_triangle_that_can_be_seen_turns_over(yaw: float) -> None:
    head = FRAME.points + yaw * FRAME.yaw_mode
    before, after = _areas(head), _areas(proportions(FRAME) @ head)
    large = np.abs(before) > 0.1 * np.abs(_areas(FRAME.points))
    assert (np.sign(after[large]) == np.sign(before[large])).all()


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


def _swapped(source: Identity, options: EngineOptions) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
    """What a swap by p06 changes in a frame of the source (h, w, 3), and the mesh (81, 2)."""
    shape = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        frame = next(iter(clip))
        before = frame.rgb().astype(int)
        with Engine(source, Identity.load(model_file("p06")), None, options) as engine:
            mesh = engine.draw(frame, shape)
        return frame.rgb() - before, mesh


@pytest.mark.slow
def test_a_disguise_is_drawn_on_the_same_outline(p01: Identity) -> None:
    _, plain = _swapped(p01, EngineOptions(renderer="cpu"))
    _, disguised = _swapped(p01, EngineOptions(renderer="cpu", disguise=True))
    assert plain.shape == disguised.shape == (POINTS, 2)
    np.testing.assert_allclose(disguised[OUTLINE], plain[OUTLINE])
    assert 1.05 < _apart(disguised) / _apart(plain) < 1.3


@pytest.mark.parametrize("disguise", [False, True])
@pytest.mark.slow
def test_a_disguise_covers_what_the_source_has_over_the_forehead(p01: Identity, disguise: bool) -> None:
    mask = p01.appearance.mask.copy()
    mask[: int(p01.reference.points[BROW_TOPS, 1].mean())] = False  # as if a fringe hung down to the brows
    fringed = replace(p01, appearance=replace(p01.appearance, mask=mask))
    changes, mesh = _swapped(fringed, EngineOptions(renderer="cpu", disguise=disguise))
    x, y = np.round((mesh[HAIRLINE] + mesh[NOSE_ROOT]) / 2).astype(int)  # between brows and hair
    assert np.abs(changes[y - 4 : y, x - 3 : x + 4]).any() == disguise


def turned(yaw: float) -> HeadPose:
    """A head 170 pixels wide, turned by degrees."""
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return HeadPose(rotation, 170.0, np.array([320.0, 240.0]))


def added_to(yaw: float) -> tuple[F64, View]:
    """What a disguise adds to the points (81, 2) of a turned head, in face widths, and how it is seen."""
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    face, pose = SolidPrior.shipped().mean, turned(yaw)
    rest, head = other.appearance.neutral_shape, pose.apply(face)
    placed = []
    for reach in (0.0, 0.1):
        options = EngineOptions(renderer="cpu", disguise=True, jaw=reach, forehead=2 * reach)
        with Engine(person, other, None, options) as engine:
            view = View.of(engine.painter.relief.normals(face), pose)
            placed.append(engine.painter.place(rest, head, view)[0])
    return (placed[1] - placed[0]) / 170, view


@pytest.mark.parametrize("yaw", [-45.0, 45.0])
@pytest.mark.slow
def test_what_is_added_to_a_turned_head_recedes_and_ends_at_its_far_side(yaw: float) -> None:
    added, view = added_to(yaw)
    far, near = sorted((np.linalg.norm(added[part], axis=1) for part in (JAW[2:6], JAW[11:15])), key=np.mean)
    assert far.max() < 0.02
    assert near.min() > 0.08
    assert added[HAIRLINE, 1] < -0.15
    assert added[HAIRLINE] @ view.across / np.linalg.norm(view.across) > 0.1


def test_a_higher_forehead_leaves_the_hair_at_the_temples() -> None:
    (added, _), plain = added_to(0.0), FRAME.points[FOREHEAD]
    grown = added[FOREHEAD] + (plain - FRAME.points[NOSE].mean(0)) / FRAME.resolution
    assert np.ptp(grown[:, 0]) < 1.1 * np.ptp(plain[:, 0]) / FRAME.resolution  # hardly wider,
    assert added[HAIRLINE, 1] < -0.15  # but higher
    assert (added[FOREHEAD[3:10], 1] < -2 * abs(added[FOREHEAD[3:10], 0])).all()


@pytest.mark.parametrize("yaw", [-30, 0, 30])
def test_the_far_cheek_of_a_turned_head_has_no_notches(yaw: float) -> None:
    pose = turned(yaw)
    seen = Relief.shipped(FRAME).seen(pose.apply(SolidPrior.shipped().mean), depth_across(pose, STRAIGHT))
    made = convex(seen)
    moved = np.linalg.norm(made - seen, axis=1)
    others = np.setdiff1d(np.arange(len(seen)), JAW)
    assert not moved[others].any()
    assert (moved.max() > 1) == (yaw != 0)
    hull = cv2.convexHull(np.delete(seen, FOREHEAD, axis=0).astype(np.float32))
    depths = [cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in made[JAW]]
    np.testing.assert_allclose(depths, 0, atol=0.01)


def test_the_border_of_a_disguise_is_as_soft_everywhere_as_it_is_drawn() -> None:
    person = Identity.load(model_file("p01"))
    options = EngineOptions(renderer="cpu", disguise=True, jaw=0.1)
    with Engine(person, person, None, options) as engine:
        painter, reference = engine.painter, person.reference
        alpha, within = painter._alpha, reference.mask
        mesh, _ = painter.place(person.appearance.neutral_shape, reference.points)
        places = painter.sampler(np.arange(within.sum())).positions(painter.relief.seen(mesh, STRAIGHT))
    hull = cv2.convexHull(mesh.astype(np.float32))
    depth = np.array([cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in places])
    assert alpha[within][depth > 6].min() > 0.95
    assert np.median(alpha[within][depth < 1]) < 0.05
    assert (alpha[~within] == 0).all()
