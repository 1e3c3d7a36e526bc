"""Nothing is drawn behind a turned head's silhouette, the nose hides the far cheek, and folds are smoothed."""

import cv2
import numpy as np
import pytest
from drawing import face_at, turned_head

from guise.aam.landmarks.schemes import (
    JAW,
    LEFT_EYE_OUTER,
    LOWER_LIDS,
    RIGHT_EYE_OUTER,
    UPPER_LIDS,
)
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import STRAIGHT, Relief
from guise.aam.solid_shape import HeadPose, Sight, SolidPrior
from guise.app.drawing.face import FaceInFrame, Seen
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.texture import Enlargement
from guise.app.drawing.passes.turned import Folds, Silhouette, smooth, soften_edges, whole_cosines
from guise.common.arrays import F32, F64
from guise.render import make_compositor

FRAME = ReferenceFrame.canonical(96)
FACE = SolidPrior.shipped().mean
RELIEF = Relief.shipped(FRAME)
FINE = Relief.shipped(ReferenceFrame.canonical())
TEXELS = np.arange(0, len(FRAME.pixels), 7)
SILHOUETTE = Silhouette(RELIEF, TEXELS)


def head(yaw: float) -> HeadPose:
    return turned_head(yaw, 120.0, (100.0, 110.0))


def seen_at(yaw: float) -> FaceInFrame:
    """A face turned by degrees, drawn where it is found."""
    face = face_at(head(yaw).apply(FACE))
    face.sight = Sight.of(RELIEF.normals(FACE), whole_cosines(RELIEF), head(yaw))
    some = np.ones((len(TEXELS), 3), np.float32)
    face.seen = Seen(some[:, :2], some, some)
    return face


def drawn_share(yaw: float) -> F32 | None:
    face = seen_at(yaw)
    SILHOUETTE.share(face, Memory())
    return face.canvas.share


def share(yaw: float) -> F64:
    made = drawn_share(yaw)
    return np.ones(FRAME.size) if made is None else made.astype(np.float64)


@pytest.mark.parametrize("yaw", [0, 8, -8])
def test_from_the_front_all_of_the_face_is_drawn(yaw: float) -> None:
    rim = FRAME.points[JAW[[0, -1]], 0]
    columns = np.arange(FRAME.size[1])
    inner = FRAME.mask & (columns > rim[0] + 0.15 * np.ptp(rim)) & (columns < rim[1] - 0.15 * np.ptp(rim))
    assert (share(yaw)[inner] > 0.99).all()
    assert drawn_share(0) is None


def test_the_far_cheek_fades_and_the_near_one_stays() -> None:
    x, y = np.round(FRAME.points[JAW[[2, -3]]]).astype(int).T
    near, far = share(60)[y, x]
    assert near == 1
    assert far < 0.2
    assert share(-60)[y, x] == pytest.approx([far, near], abs=0.15)
    eyes = np.round(FRAME.points[[RIGHT_EYE_OUTER, LEFT_EYE_OUTER]]).astype(int)
    assert share(60)[eyes[0, 1], eyes[0, 0]] == 1


def test_texels_agree_with_the_picture() -> None:
    picture = share(50)[FRAME.mask][::7]
    face = seen_at(50)
    SILHOUETTE.hide_texels(face, Memory())
    assert face.seen.visible is not None
    assert np.abs(face.seen.visible - picture).mean() < 0.03
    hidden = np.zeros(len(TEXELS), np.float32)
    face.seen.visible = hidden  # behind something that is in front as well
    SILHOUETTE.hide_texels(face, Memory())
    assert not face.seen.visible.any()


@pytest.mark.parametrize("yaw", [35, -50])
def test_what_is_drawn_in_front_is_what_lies_in_front(yaw: float) -> None:
    """Each pixel shows about the nearest of the triangles there: colours are depths."""
    pose = head(yaw)
    solid = RELIEF.solid(FACE)
    depth, sampler = (solid @ pose.rotation.T)[:, 2], RELIEF.mesh.sampler
    texture = np.repeat(
        RELIEF.mesh.scatter((depth[sampler.vertices] * sampler.weights).sum(0))[..., None], 3, 2
    )
    stored = np.clip(128 + 150 * texture, 0, 255).astype(np.float32)
    whole = np.ones(FRAME.size, np.float32)
    with make_compositor("cpu", RELIEF.front_last, RELIEF.points.astype(np.float32), whole) as compositor:
        shown = compositor.warp((220, 200), stored, pose.apply(solid))
    seen = np.full((220, 200), np.inf)
    for triangle in RELIEF.triangles:
        with make_compositor("cpu", triangle[None], RELIEF.points.astype(np.float32), whole) as compositor:
            one = compositor.warp((220, 200), stored, pose.apply(solid))
        seen = np.where(one[..., 3] > 0, np.minimum(seen, one[..., 0].astype(float)), seen)
    covered = np.isfinite(seen) & (shown[..., 3] > 0)
    wrong = shown[..., 0][covered] > seen[covered] + 8
    assert wrong.mean() < 0.01


@pytest.fixture(scope="module")
def folds() -> Folds:
    return Folds(FINE)


def turned(degrees: float) -> np.ndarray:
    """(81 + k, 2) the mean head, turned, seen from the front."""
    turn = np.radians(degrees)
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    return FINE.reference.resolution * (FINE.solid(SolidPrior.shipped().mean) @ rotation)[:, :2]


def noise() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (*FINE.reference.size, 3), np.uint8)


def smoothed(folds: Folds, mesh: np.ndarray, zoom: float = 1.0) -> np.ndarray:
    picture, fold = noise(), folds.at(mesh, zoom)
    if fold is not None:
        smooth(picture, fold)
    return picture


def fineness(picture: np.ndarray) -> np.ndarray:
    """(w,) mean difference of luma between a pixel and the one below it, in each column."""
    return np.abs(np.diff(picture[..., 0].astype(float), axis=0)).mean(0)


def test_a_face_from_the_front_stays_as_it_is(folds: Folds) -> None:
    assert (smoothed(folds, FINE.seen(FINE.reference.points, STRAIGHT)) == noise()).all()


def test_shut_eyes_are_no_fold(folds: Folds) -> None:
    """Lids close over the eye, which is not seen then; their rims stay sharp."""
    shut = FINE.reference.points.copy()
    shut[UPPER_LIDS] = shut[LOWER_LIDS] - (0, 0.2)
    assert (smoothed(folds, FINE.seen(shut, STRAIGHT)) == noise()).all()


def halves(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those of the left and of the right half of a face, but for its edges."""
    width = len(columns)
    return columns[width // 10 : width // 2], columns[width // 2 : -(width // 10)]


@pytest.mark.parametrize("way", [-1, 1])
def test_the_far_side_of_the_nose_is_smoothed_and_the_near_cheek_is_not(folds: Folds, way: int) -> None:
    ratio = fineness(smoothed(folds, turned(way * 40))) / fineness(noise())
    far, near = halves(ratio)[::way]
    assert near.mean() > 0.97
    assert far.mean() < 0.8


def test_no_detail_is_added_where_a_face_is_smoothed(folds: Folds) -> None:
    h, w = FINE.reference.size
    detail = np.full((2 * h, 2 * w), 100.0, np.float32)
    face = seen_at(40)
    face.zoom = 2.0
    face.canvas.picture, face.canvas.fine = np.zeros((h, w, 3), np.uint8), True
    face.canvas.fold = folds.at(turned(40), 1.0)
    Enlargement(detail, cv2.INTER_CUBIC).enlarge(face, Memory())
    far, near = halves(face.canvas.picture[..., 0].mean(0) / 100)
    assert near.mean() > 0.97
    assert far.mean() < 0.8


def test_a_larger_face_is_squeezed_alike(folds: Folds) -> None:
    small, large = (smoothed(folds, zoom * turned(40), zoom) != noise() for zoom in (0.5, 2.0))
    assert large.any()
    assert small.mean() >= large.mean()


@pytest.mark.parametrize("way", [-1, 1])
def test_the_edge_of_a_turned_nose_is_softened_where_the_cheek_is_behind_it(folds: Folds, way: int) -> None:
    mesh = turned(way * 40)
    mesh = mesh - mesh.min(0) + 10
    fold = folds.at(mesh, 1.0)
    assert fold is not None
    assert len(fold.edges) > 5
    w, h = np.ceil(mesh.max(0)).astype(int) + 10
    before = np.random.default_rng(0).integers(0, 256, (h, w, 3), np.uint8)
    after = before.copy()
    soften_edges(after, fold.edges)
    ys, xs = np.nonzero((after != before).any(2))
    ends = fold.edges.reshape(-1, 2)
    to_edges = np.linalg.norm(np.stack([xs, ys], 1)[:, None] - ends, axis=2).min(1)
    longest = np.linalg.norm(fold.edges[:, 0] - fold.edges[:, 1], axis=1).max()
    assert to_edges.max() < longest / 2 + 4
    x, y = fold.edges.mean(1).round().astype(int).T
    across = np.abs(np.diff(after[..., 0].astype(float), axis=1))[y, x].mean()
    assert across < 0.6 * np.abs(np.diff(before[..., 0].astype(float), axis=1))[y, x].mean()


@pytest.mark.parametrize("degrees", [-60, -40, -25, 25, 40, 60])
def test_nothing_is_blurred_where_a_turned_head_ends(folds: Folds, degrees: float) -> None:
    """Behind those edges is the picture, which must stay as it is."""
    mesh = 2 * turned(degrees)
    mesh = mesh - mesh.min(0) + 20
    fold = folds.at(mesh, 2.0)
    assert fold is not None
    w, h = np.ceil(mesh.max(0)).astype(int) + 20
    drawn = np.zeros((h, w), np.uint8)
    for triangle in np.round(mesh[FINE.triangles]).astype(np.int32):
        cv2.fillConvexPoly(drawn, triangle, 255)
    changed = np.repeat(drawn[..., None], 3, axis=2)
    soften_edges(changed, fold.edges)
    assert (changed[..., 0] != drawn).mean() < 1e-3


def test_edges_are_softened_within_the_part_of_a_frame(folds: Folds) -> None:
    fold = folds.at(turned(40), 1.0)
    assert fold is not None
    part = np.zeros((20, 20, 3), np.uint8)
    soften_edges(part, fold.edges - (10_000, 0))
    x, y = fold.edges[0, 0].astype(int)
    soften_edges(part, fold.edges - (x, y))
    assert (part == 0).all()


def test_a_straight_face_has_no_folds_and_a_turned_one_is_smoothed_as_it_is_drawn(folds: Folds) -> None:
    for degrees, folded in ((0.0, False), (40.0, True)):
        face, memory = face_at(FINE.reference.points), Memory()
        face.sight = Sight.of(FINE.normals(FACE), whole_cosines(FINE), turned_head(degrees, 160.0))
        face.canvas.mesh, face.canvas.picture = turned(degrees), noise()
        folds.find(face, memory)
        folds.smooth(face, memory)
        assert (face.canvas.fold is not None) == folded
        assert (face.canvas.picture != noise()).any() == folded
