"""The forehead of a disguise: no brow is stretched, no skin is far, and hair lies over its rim."""

import cv2
import numpy as np
import pytest
from drawing import drawn_on

from guise.aam.landmarks.schemes import (
    BROW_TOPS,
    BROWS,
    HAIRLINE,
    JAW,
    OUTER_EYE_CORNERS,
    RIGHT_NOSTRIL,
    SILHOUETTE,
    TEMPLES,
)
from guise.aam.light import LUMA
from guise.aam.model import Identity
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.face import BROW_THICKNESS
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.forehead import LIMITS, LOBE, Forehead, Hairline, outward, skin_grain, strands
from guise.common.arrays import F64, Bool

FRAME = ReferenceFrame.canonical(160)
REACH = 0.28
BEYOND = outward(FRAME, 0.05, REACH)
MIDDLE = round(FRAME.points[HAIRLINE, 0])
BROWS_ROW = round(FRAME.points[BROW_TOPS, 1].mean())


def test_a_forehead_that_stays_is_read_where_it_is() -> None:
    y, x = np.mgrid[: FRAME.size[0], : FRAME.size[1]]
    forehead = Forehead.of(FRAME, 0.0)
    np.testing.assert_allclose(forehead.places, np.dstack([x, y]), atol=1e-4)
    assert not forehead.softened.any()


def test_above_brows_the_texture_is_not_stretched() -> None:
    rows = np.arange(BROWS_ROW - 9, BROWS_ROW - 2)
    read = Forehead.of(FRAME, REACH).places[rows, MIDDLE, 1]
    stretch = 1 + REACH * FRAME.resolution / (BROWS_ROW - FRAME.points[HAIRLINE, 1])
    drawn_rows = stretch * np.diff(rows)
    assert np.diff(read) == pytest.approx(drawn_rows, rel=0.15)
    assert stretch > 2


def test_what_is_read_is_skin_of_the_forehead_and_the_temples() -> None:
    places = Forehead.of(FRAME, REACH).places
    hull = FRAME.points[SILHOUETTE].astype(np.float32)
    mirrored = Forehead.of(FRAME, REACH).softened > 0.99
    assert mirrored.sum() > 500
    read = places[mirrored]
    rim = (BROW_THICKNESS + LIMITS.softening - LIMITS.rim) * FRAME.resolution  # where brows are near it
    inside = [cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in read]
    assert min(inside) > -rim - 1
    for feature in FRAME.points[[*BROWS, *OUTER_EYE_CORNERS]]:
        near = np.linalg.norm(read - feature, axis=1) < 0.02 * FRAME.resolution
        assert near.sum() <= 1  # a pixel of the rim, beside the end of a brow


def test_only_what_is_drawn_above_the_hairline_is_added() -> None:
    added = Forehead.of(FRAME, REACH).added
    top = round(FRAME.points[HAIRLINE, 1])
    assert added[top + 2, MIDDLE] == 1
    assert not added[BROWS_ROW - 10 :, MIDDLE].any()
    assert added[round(FRAME.points[BROWS, 1].max()) + 12 :].max() < 0.1
    assert not Forehead.of(FRAME, 0.0).added.any()


def test_below_the_ears_nothing_changes() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (*FRAME.size, 3), np.uint8)
    made = Forehead.of(FRAME, REACH).continued(picture)
    below = round(FRAME.points[[JAW[LOBE], JAW[-1 - LOBE]], 1].max()) + 2
    np.testing.assert_array_equal(made[below:], picture[below:])
    assert (made[:BROWS_ROW] != picture[:BROWS_ROW]).any()


def test_what_is_at_the_rim_of_the_temples_is_not_read() -> None:
    picture = np.full((*FRAME.size, 3), 100, np.uint8)
    for x, y in np.round(FRAME.points[TEMPLES]).astype(int):
        cv2.circle(picture, (x, y), round(0.5 * LIMITS.rim * FRAME.resolution), (200, 200, 200), -1)
    assert (picture[FRAME.mask, 0] > 150).sum() > 20
    made = Forehead.of(FRAME, REACH).continued(picture)
    assert made[FRAME.mask].max() < 125


def test_a_forehead_has_the_grain_of_the_cheeks(p01: Identity) -> None:
    grain, frame = skin_grain(p01.appearance.neutral_texture, p01.reference), p01.reference
    luma = frame.scatter(p01.appearance.neutral_texture @ LUMA)
    fine = luma - cv2.GaussianBlur(luma, (0, 0), LIMITS.softening * frame.resolution)
    x, y = np.round(frame.points[[RIGHT_NOSTRIL, JAW[2]]].mean(0)).astype(int)
    cheek = fine[y - 5 : y + 5, x - 5 : x + 5]
    assert grain.shape == frame.size
    assert 0.5 < grain.std() / cheek.std() < 2
    assert abs(grain.mean()) < 0.1 * grain.std()
    np.testing.assert_array_equal(grain, skin_grain(p01.appearance.neutral_texture, p01.reference))


def test_hair_shades_the_skin_below_it_and_nothing_else() -> None:
    lit = Forehead.of(FRAME, REACH).lit
    top = round(FRAME.points[HAIRLINE, 1])
    assert lit[top + 1, MIDDLE] < 1 - 0.7 * LIMITS.shadow
    assert (np.diff(lit[top + 1 : BROWS_ROW, MIDDLE]) >= -1e-6).all()
    assert lit[round(FRAME.points[[JAW[LOBE], JAW[-1 - LOBE]], 1].max()) :].min() > 0.99
    assert (Forehead.of(FRAME, 0.0).lit == 1).all()


def test_detail_is_read_where_the_texture_is() -> None:
    y = np.mgrid[: FRAME.size[0], : FRAME.size[1]].astype(np.float32)[0]
    forehead = Forehead.of(FRAME, REACH)
    fine = cv2.resize(y, (2 * FRAME.size[1], 2 * FRAME.size[0]))
    coarse = cv2.remap(y, forehead.places, None, cv2.INTER_LINEAR)
    inner = np.s_[BROWS_ROW - 9 : BROWS_ROW - 2, MIDDLE]
    assert forehead.detailed(fine)[::2, ::2][inner] == pytest.approx(coarse[inner], abs=1.5)


def _drawn() -> tuple[F64, Bool]:
    """A disguise's mesh at rest, and where it is drawn."""
    mesh = FRAME.points + BEYOND
    mesh = mesh - np.floor(mesh.min(0)) + 2
    canvas = np.zeros(np.ceil(mesh.max(0)[::-1]).astype(int) + 3, np.uint8)
    cv2.fillConvexPoly(canvas, cv2.convexHull(np.round(mesh).astype(np.int32)), 1)
    return mesh, canvas > 0


def test_strands_lie_over_the_rim_of_the_forehead_only() -> None:
    mesh, inside = _drawn()
    skin = strands(mesh, inside, BEYOND, FRAME.resolution)
    depth = cv2.distanceTransform(np.pad(inside, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    assert (skin[inside & (depth > (LIMITS.reach + 0.01) * FRAME.resolution)] == 1).all()
    assert (skin[int(mesh[JAW[1], 1]) :] == 1).all()
    top = round(mesh[HAIRLINE, 1])
    columns = np.s_[round(mesh[HAIRLINE, 0]) - 30 : round(mesh[HAIRLINE, 0]) + 31]
    means = [skin[top + row, columns].mean() for row in (1, 7, 20)]
    assert means[0] < 0.2 < means[1] < 0.8 < means[2]
    assert skin[top + 7, columns].std() > 0.1


def test_strands_do_not_change_from_one_frame_to_the_next() -> None:
    mesh, inside = _drawn()
    first, second = (strands(mesh, inside, BEYOND, FRAME.resolution) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_without_a_higher_forehead_there_are_no_strands() -> None:
    mesh, inside = _drawn()
    assert (strands(mesh, inside, outward(FRAME, 0.05, 0.0), FRAME.resolution) == 1).all()


def test_a_hairline_is_drawn_with_shade_and_the_grain_of_the_cheeks(p01: Identity) -> None:
    frame, hairline = p01.reference, Hairline(p01.reference, p01.appearance.neutral_texture, REACH)
    grey = np.full((*frame.size, 3), 120, np.uint8)
    face = drawn_on(grey, frame.points, grey.copy())
    hairline.draw(face, Memory())
    x, top = np.round(frame.points[HAIRLINE]).astype(int)
    drawn = face.canvas.picture[..., 0].astype(float)
    brows = round(frame.points[BROW_TOPS, 1].mean())
    near, far = drawn[top + 1 : top + 4, x - 5 : x + 6], drawn[brows - 6 : brows - 3, x - 5 : x + 6]
    assert near.mean() < far.mean() - 5
    assert near.std() > 0.2
    assert (face.canvas.picture[..., 1:] == 120).all()
    chin = round(frame.points[JAW[8], 1]) - 4
    assert (drawn[chin - 4 : chin, x - 3 : x + 4] == 120).all()
