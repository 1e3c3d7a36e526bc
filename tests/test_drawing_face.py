"""What is known of a frame's face: shares that hide it, and how much of it is drawn."""

import numpy as np
from drawing import face_at, parsing_of
from numpy.testing import assert_allclose, assert_array_equal

from guise.aam.parsing import FaceClass
from guise.app.drawing.face import NOTHING, Canvas, Layers, Seen, ramp

CELLS = np.zeros((64, 64), np.float32)


def test_a_ramp_goes_from_one_end_to_the_other() -> None:
    shares = np.array([-1, 0.2, 0.3, 0.4, 2], np.float32)
    assert_allclose(ramp(shares, (0.2, 0.4)), [0, 0, 0.5, 1, 1], atol=1e-6)


def test_layers_tell_how_far_each_kind_of_thing_hides_a_place() -> None:
    hand, hair = CELLS.copy(), CELLS.copy()
    hand[:, :32], hair[32:] = 1, 0.5
    parsing = parsing_of({FaceClass.OCCLUDER: hand, FaceClass.HAIR: hair}, (64, 64))
    layers = Layers.of(parsing, [(FaceClass.OCCLUDER, (0.2, 0.8)), (FaceClass.HAIR, (0.0, 1.0))])
    places = np.array([[10.0, 10], [50, 10], [10, 50], [50, 50]])
    assert_allclose(layers.at(places), [[1, 0], [0, 0], [1, 0.5], [0, 0.5]], atol=1e-6)
    assert_allclose(layers.with_map(CELLS + 1).at(places)[:, 2], 1)
    assert_allclose(layers.without(hand).at(places)[:, 0], 0)
    assert_allclose(layers.without(hand).at(places)[:, 1], [0, 0, 0, 0.5], atol=1e-6)
    one = Layers.of(parsing, [(FaceClass.OCCLUDER, (0.2, 0.8))])
    assert one.hidden.shape == (64, 64, 1)
    assert_allclose(one.at(places)[:, 0], [1, 0, 1, 0], atol=1e-6)


def test_of_a_canvas_is_drawn_what_nothing_covers() -> None:
    canvas, half = Canvas(NOTHING), np.full((4, 3), 0.5, np.float32)
    canvas.cover(None)
    assert canvas.share is None
    canvas.cover(half)
    assert_array_equal(canvas.share, half)
    canvas.cover(half)
    canvas.cover(None)
    assert_array_equal(canvas.share, half * half)


def test_of_a_face_that_is_held_nothing_is_seen() -> None:
    face = face_at(np.zeros((81, 2)))
    assert not face.seen
    assert face.canvas.is_outside
    colours = np.ones((2, 3), np.float32)
    assert Seen(colours[:, :2], colours, colours)


def test_no_two_faces_share_a_canvas() -> None:
    one, other = (face_at(np.zeros((81, 2))) for _ in range(2))
    assert one.canvas is not other.canvas
    assert one.seen is not other.seen
