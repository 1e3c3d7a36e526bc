"""The part of a frame in which landmarks are corrected: geometry, picture, drawing, what a pointer means."""

import re

import numpy as np
import pytest
from made_up import SAMPLES

from guise.aam.landmarks.schemes import RIGHT_EYE_OUTER
from guise.app.studio.landmark_view import LIMITS, SCREEN, FrameView, name_of

TRUTH = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"].astype(np.float32)
WHOLE = FrameView.whole(640, 480)


def test_the_whole_view_shows_the_frame_between_bars() -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    shown = WHOLE.picture(rgb)
    assert shown.shape == (SCREEN, SCREEN, 3)
    bar = (640 - 480) // 2 * SCREEN // 640
    assert np.ptp(shown[: bar - 3].reshape(-1, 3), axis=0).max() == 0
    assert np.ptp(shown[-bar + 3 :].reshape(-1, 3), axis=0).max() == 0
    assert shown[bar:-bar].std() > 20


@pytest.mark.parametrize(
    "view", [WHOLE, FrameView(100, 50, 97, 640, 480), FrameView(-20, 300, 400, 640, 480)]
)
def test_pictures_and_places_agree(view: FrameView) -> None:
    """A bright pixel is where `to_screen` says, and `to_frame` takes it back."""
    rgb = np.zeros((480, 640, 3), np.uint8)
    rgb[331, 123] = 255
    if not (view.x <= 123 < view.x + view.size and view.y <= 331 < view.y + view.size):
        view = FrameView(100, 300, 97, 640, 480)
    light = view.picture(rgb)[..., 0].astype(float) - view.picture(0 * rgb)[..., 0]
    light = np.maximum(light, 0)
    ys, xs = np.mgrid[:SCREEN, :SCREEN] + 0.5
    centre = np.array([(light * xs).sum(), (light * ys).sum()]) / light.sum()
    assert view.to_screen((123, 331)) == pytest.approx(centre, abs=0.05 * view.scale + 0.02)
    assert view.to_frame(view.to_screen(TRUTH[0])) == pytest.approx(TRUTH[0], abs=1e-4)


def test_a_view_around_points_holds_them_with_room() -> None:
    view = WHOLE.around(TRUTH[0])
    places = view.to_screen(TRUTH[0])
    assert places.min() > 0
    assert places.max() < SCREEN
    assert np.ptp(places, axis=0).max() == pytest.approx(SCREEN / LIMITS.face_margin, rel=0.02)


def test_zooming_keeps_the_place_and_ends_at_the_whole_and_at_a_few_pixels() -> None:
    view = WHOLE.around(TRUTH[0])
    eye = TRUTH[0, RIGHT_EYE_OUTER]
    near = view.zoomed(2, eye)
    assert near.size == pytest.approx(view.size / 2, abs=1)
    assert near.to_screen(eye) == pytest.approx(view.to_screen(eye), abs=near.scale)
    assert view.zoomed(1000, eye).size == LIMITS.min_size_pixels
    assert view.zoomed(0.001, eye) == WHOLE


def test_moving_follows_the_pointer_and_stops_at_the_edge_of_the_frame() -> None:
    view = FrameView(300, 200, 120, 640, 480)
    moved = view.moved((60, -30))
    assert moved.to_screen((333, 222)) - view.to_screen((333, 222)) == pytest.approx((60, -30))
    assert view.moved((1e5, 1e5)) == FrameView(0, 0, 120, 640, 480)
    assert view.moved((-1e5, -1e5)) == FrameView(520, 360, 120, 640, 480)


def test_a_pointer_takes_the_nearest_point_and_none_far_away() -> None:
    view = WHOLE.around(TRUTH[0])
    for point in (0, 36, 57, 80):
        assert view.nearest(TRUTH[0], view.to_screen(TRUTH[0, point]) - 2) == point
    assert view.nearest(TRUTH[0], (1, 1)) is None
    assert view.nearest(np.full((81, 2), np.nan, np.float32), (1, 1)) is None


def test_the_drawing_has_every_point_where_it_is() -> None:
    view = WHOLE.around(TRUTH[0])
    drawn = view.drawing(TRUTH[0], 36)
    for path in re.findall(r'd="((?:M[-0-9.]+,[-0-9.]+h0)+)"', drawn):
        found = np.array(re.findall(r"M([-0-9.]+),([-0-9.]+)h0", path), float)
        assert found == pytest.approx(view.to_screen(TRUTH[0]), abs=0.01)
    assert drawn.count("h0M") == 2 * 80
    x, y = view.to_screen(TRUTH[0, RIGHT_EYE_OUTER])
    ring = LIMITS.ring_radius_units
    assert f"M{x - ring:.2f},{y:.2f}a" in drawn
    assert f"a{ring},{ring}" in drawn
    assert f"a{ring},{ring}" not in view.drawing(TRUTH[0], None)
    assert view.drawing(np.full((81, 2), np.nan, np.float32), None) == ""


def test_every_point_has_a_name_of_its_own() -> None:
    assert len({name_of(point) for point in range(81)}) == 81
    assert name_of(0) == "jaw, point 0"
