"""Nothing is drawn behind a turned head's silhouette, and the nose hides the far cheek."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import BROWS, BROWS_AND_EYES, JAW, LEFT_EYE_OUTER, RIGHT_EYE_OUTER
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import Relief
from guise.aam.shape_transfer import ShapeTransfer
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.app.swapping.silhouette import Silhouette, View, front_last
from guise.common.arrays import F64
from guise.render import make_compositor

FRAME = ReferenceFrame.canonical(96)
FACE = SolidPrior.shipped().mean
RELIEF = Relief.shipped(FRAME)
TEXELS = np.stack(np.divmod(FRAME.pixels[::7], FRAME.size[1])[::-1], axis=1).astype(np.float64)
SILHOUETTE = Silhouette(RELIEF, TEXELS)


def cosines(yaw: float) -> F64:
    return View.of(RELIEF.normals(FACE), head(yaw)).cosines


def head(yaw: float) -> HeadPose:
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return HeadPose(rotation, 120.0, np.array([100.0, 110.0]))


def share(yaw: float) -> F64:
    made = SILHOUETTE.share(cosines(yaw))
    return np.ones(FRAME.size) if made is None else made.astype(np.float64)


@pytest.mark.parametrize("yaw", [0, 8, -8])
def test_from_the_front_all_of_the_face_is_drawn(yaw: float) -> None:
    rim = FRAME.points[JAW[[0, -1]], 0]
    columns = np.arange(FRAME.size[1])
    inner = FRAME.mask & (columns > rim[0] + 0.15 * np.ptp(rim)) & (columns < rim[1] - 0.15 * np.ptp(rim))
    assert (share(yaw)[inner] > 0.99).all()
    assert SILHOUETTE.share(cosines(0)) is None


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
    assert np.abs(SILHOUETTE.visible(cosines(50)) - picture).mean() < 0.03


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
    with make_compositor("cpu", front_last(RELIEF), RELIEF.points.astype(np.float32), whole) as compositor:
        shown = compositor.warp((220, 200), stored, pose.apply(solid))
    seen = np.full((220, 200), np.inf)
    for triangle in RELIEF.triangles:
        with make_compositor("cpu", triangle[None], RELIEF.points.astype(np.float32), whole) as compositor:
            one = compositor.warp((220, 200), stored, pose.apply(solid))
        seen = np.where(one[..., 3] > 0, np.minimum(seen, one[..., 0].astype(float)), seen)
    covered = np.isfinite(seen) & (shown[..., 3] > 0)
    wrong = shown[..., 0][covered] > seen[covered] + 8
    assert wrong.mean() < 0.01


def test_brows_and_eyes_stay_within_the_head() -> None:
    transfer = ShapeTransfer(FRAME.points, FRAME.points, FRAME)
    transfer.solid[BROWS, 2] -= 0.15  # a forehead that bulges
    pose = head(50)
    shape = pose.apply(transfer.source.rest)
    made = transfer.apply(shape, pose)
    hull = FRAME.align(shape)
    assert made[BROWS_AND_EYES, 0].max() <= hull[:, 0].max() + 0.3
    assert transfer.apply(head(0).apply(transfer.source.rest), head(0))[BROWS] == pytest.approx(
        FRAME.align(head(0).apply(transfer.source.rest))[BROWS], abs=0.5
    )
