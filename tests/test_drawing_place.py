"""Where a face is drawn: within the same outline, and the frame's jaw line goes with it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from drawing import face_at, turned_head
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
    LIPS,
    NOSE,
    NOSE_ROOT,
    OUTLINE,
)
from guise.aam.model import Identity
from guise.aam.reference import POINTS, ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.solid_shape import Sight, SolidPrior
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.look import DISGUISE, PAPER, SWAP, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.forehead import outward
from guise.app.drawing.passes.place import OUTLINE_WARP, Place, RigidPlace, warp_outline
from guise.app.drawing.passes.turned import whole_cosines
from guise.app.media import Frame, open_input
from guise.common.arrays import F64, U8

FRAME = ReferenceFrame.canonical(160)
WIDTH = float(FRAME.resolution)
HEAD = FRAME.points + np.array([120.0, 60.0])


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


def _swapped(source: Identity, look: Look) -> tuple[NDArray[np.int_], NDArray[np.float64]]:
    """What a swap by p06 changes in a frame of the source (h, w, 3), and the mesh (81, 2)."""
    shape = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        frame = next(iter(clip))
        before = frame.rgb().astype(int)
        with Engine(source, Donor.of(Identity.load(model_file("p06"))), None, look) as engine:
            mesh = engine.draw(frame, shape)
        return frame.rgb() - before, mesh


def test_a_disguise_is_drawn_on_the_same_outline(p01: Identity) -> None:
    _, plain = _swapped(p01, replace(SWAP, renderer="cpu"))
    _, disguised = _swapped(p01, replace(DISGUISE, renderer="cpu", jaw=0.0, forehead=0.0))
    assert plain.shape == disguised.shape == (POINTS, 2)
    np.testing.assert_allclose(disguised[OUTLINE], plain[OUTLINE])
    away = np.linalg.norm(disguised - plain, axis=1)[np.r_[EYES, BROWS, NOSE, LIPS]]
    assert away.max() > 0.03 * np.ptp(plain[:, 0])


@pytest.mark.parametrize("look", [PAPER, DISGUISE])
def test_a_disguise_covers_what_the_source_has_over_the_forehead(p01: Identity, look: Look) -> None:
    mask = p01.appearance.mask.copy()
    mask[: int(p01.reference.points[BROW_TOPS, 1].mean())] = False  # as if a fringe hung down to the brows
    fringed = replace(p01, appearance=replace(p01.appearance, mask=mask))
    changes, mesh = _swapped(fringed, replace(look, renderer="cpu"))
    x, y = np.round((mesh[HAIRLINE] + mesh[NOSE_ROOT]) / 2).astype(int)  # between brows and hair
    assert np.abs(changes[y - 4 : y, x - 3 : x + 4]).any() == (look is DISGUISE)


def added_to(yaw: float) -> tuple[F64, Sight]:
    """What a disguise adds to the points (81, 2) of a turned head, in face widths, and how it is seen."""
    relief, face, pose = Relief.shipped(FRAME), SolidPrior.shipped().mean, turned_head(yaw)
    sight = Sight.of(relief.normals(face), whole_cosines(relief), pose)
    placed = []
    for reach in (0.0, 0.1):
        drawn = face_at(pose.apply(face))
        drawn.shape, drawn.sight = FRAME.points, sight
        Place(FRAME, outward(FRAME, reach, 2 * reach)).lay(drawn, Memory())
        placed.append(drawn.mesh)
    return (placed[1] - placed[0]) / 170, sight


@pytest.mark.parametrize("yaw", [-45.0, 45.0])
def test_what_is_added_to_a_turned_head_recedes_and_ends_at_its_far_side(yaw: float) -> None:
    added, sight = added_to(yaw)
    far, near = sorted((np.linalg.norm(added[part], axis=1) for part in (JAW[2:6], JAW[11:15])), key=np.mean)
    assert far.max() < 0.02
    assert near.min() > 0.08
    assert added[HAIRLINE, 1] < -0.15
    assert added[HAIRLINE] @ sight.across / np.linalg.norm(sight.across) > 0.1


@pytest.mark.slow
def test_a_higher_forehead_leaves_the_hair_at_the_temples() -> None:
    (added, _), plain = added_to(0.0), FRAME.points[FOREHEAD]
    grown = added[FOREHEAD] + (plain - FRAME.points[NOSE].mean(0)) / FRAME.resolution
    assert np.ptp(grown[:, 0]) < 1.1 * np.ptp(plain[:, 0]) / FRAME.resolution  # hardly wider,
    assert added[HAIRLINE, 1] < -0.15  # but higher
    assert (added[FOREHEAD[3:10], 1] < -2 * abs(added[FOREHEAD[3:10], 0])).all()


def scene() -> U8:
    """A bright head on a dark ground with noise, 400 x 420."""
    picture = np.random.default_rng(1).integers(20, 60, (420, 400, 3), dtype=np.uint8)
    cv2.fillConvexPoly(picture, cv2.convexHull(np.round(HEAD).astype(np.int32)), (220, 190, 170))
    return picture


def wider(share: float) -> F64:
    """The head with a wider jaw."""
    mesh = HEAD.copy()
    mesh[JAW] += share * (HEAD[JAW] - HEAD[JAW].mean(0)) * [1, 0]
    return mesh


def after(mesh: F64) -> U8:
    frame = Frame.from_rgb(scene())
    warp_outline(frame, HEAD, mesh, WIDTH)
    return frame.rgb()


def test_the_heads_edge_goes_where_the_drawn_jaw_is() -> None:
    row = int(HEAD[JAW][4, 1])
    before, now = (picture[row].mean(1) > 120 for picture in (scene(), after(wider(0.08))))
    moved = wider(0.08)[JAW][4, 0] - HEAD[JAW][4, 0]
    assert moved < -3
    assert now.argmax() - before.argmax() == pytest.approx(moved, abs=1.5)


def test_pixels_beyond_the_reach_stay_as_they_are() -> None:
    mesh = wider(0.08)
    ys, xs = np.mgrid[:420, :400]
    away = np.linalg.norm(np.stack([xs, ys], -1)[:, :, None] - mesh[JAW], axis=3).min(2)
    far = away > (OUTLINE_WARP.outer_reach + OUTLINE_WARP.cell + 0.05) * WIDTH
    assert far.mean() > 0.3
    np.testing.assert_array_equal(after(mesh)[far], scene()[far])


def test_where_the_outlines_agree_nothing_changes() -> None:
    np.testing.assert_array_equal(after(HEAD), scene())


def test_a_head_that_leaves_the_picture_is_no_error() -> None:
    frame = Frame.from_rgb(scene())
    warp_outline(frame, HEAD + 1000, wider(0.08) + 1000, WIDTH)
    np.testing.assert_array_equal(frame.rgb(), scene())


def test_a_face_lies_on_the_head_whatever_its_own_place_and_size() -> None:
    face = face_at(1.5 * FRAME.points + (30, 7))
    face.shape = FRAME.points
    Place(FRAME, np.zeros((POINTS, 2))).lay(face, Memory())
    np.testing.assert_allclose(face.mesh, face.head, atol=1e-6)
    assert face.zoom == pytest.approx(1.5)
    face.shape = 0.3 * FRAME.points + 100  # the papers' shapes lie anywhere
    RigidPlace(FRAME).lay(face, Memory())
    np.testing.assert_allclose(face.mesh, face.head, atol=1e-6)
    assert face.zoom == pytest.approx(5.0)


def test_by_the_papers_the_outline_follows_the_head_and_the_features_do_not() -> None:
    face = face_at(wider(0.2))
    face.shape = HEAD
    RigidPlace(FRAME).lay(face, Memory())
    away = np.linalg.norm(face.mesh - HEAD, axis=1)
    assert away[JAW[4]] > 0.5 * np.linalg.norm(wider(0.2)[JAW[4]] - HEAD[JAW[4]])
    assert away[EYES].max() < 0.2 * away[JAW[4]]
