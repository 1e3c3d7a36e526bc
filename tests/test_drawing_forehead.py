"""The forehead of a disguise: no brow is stretched, and no skin is far."""

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
from guise.app.drawing.passes.forehead import LIMITS, LOBE, Forehead, Hairline, skin_grain

FRAME = ReferenceFrame.canonical(160)
REACH = 0.28
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


def test_detail_is_read_where_the_texture_is() -> None:
    y = np.mgrid[: FRAME.size[0], : FRAME.size[1]].astype(np.float32)[0]
    forehead = Forehead.of(FRAME, REACH)
    fine = cv2.resize(y, (2 * FRAME.size[1], 2 * FRAME.size[0]))
    coarse = cv2.remap(y, forehead.places, None, cv2.INTER_LINEAR) * (1 - forehead.softened)
    inner = np.s_[BROWS_ROW - 9 : BROWS_ROW - 2, MIDDLE]
    assert forehead.detailed(fine)[::2, ::2][inner] == pytest.approx(coarse[inner], abs=1.5)


def test_a_forehead_is_drawn_with_the_grain_of_the_cheeks_and_nothing_else(p01: Identity) -> None:
    frame, hairline = p01.reference, Hairline(p01.reference, p01.appearance.neutral_texture, REACH)
    grey = np.full((*frame.size, 3), 120, np.uint8)
    face = drawn_on(grey, frame.points, grey.copy())
    hairline.draw(face, Memory())
    x, top = np.round(frame.points[HAIRLINE]).astype(int)
    drawn = face.canvas.picture[..., 0].astype(float)
    near = drawn[top + 1 : top + 4, x - 5 : x + 6]
    assert abs(near.mean() - 120) < 3
    assert near.std() > 0.2
    assert (face.canvas.picture[..., 1:] == 120).all()
    chin = round(frame.points[JAW[8], 1]) - 4
    assert (drawn[chin - 4 : chin, x - 3 : x + 4] == 120).all()
