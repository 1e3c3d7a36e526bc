"""A picture laid out, warped and blended into the frame; what lies beside the face stays to the bit."""

from collections.abc import Iterator
from fractions import Fraction

import av
import numpy as np
import pytest
from drawing import face_at, grid_points, parsing_of
from numpy.testing import assert_array_equal

from guise.aam.parsing import FaceClass
from guise.aam.reference import ReferenceFrame
from guise.aam.relief import Relief
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.blend import Blend
from guise.app.media.frame import Frame
from guise.common.arrays import F32, U8
from guise.render import feather

FRAME = ReferenceFrame.canonical(48)
SIZE = 160, 140
GREY = np.full((*SIZE, 3), 90, np.uint8)
HEAD = FRAME.points + np.array([40, 35])


@pytest.fixture
def blend() -> Iterator[Blend]:
    with Blend(Relief.shipped(FRAME), feather(FRAME.mask, 1.0), "cpu") as blend:
        yield blend


def planes(value: float) -> F32:
    return np.full((3, len(FRAME.pixels)), value, np.float32)


def blended(blend: Blend, share: F32 | None = None, rims: F32 | None = None, *, zoom: float = 1.0) -> U8:
    """A grey frame with a bright face."""
    face, memory = face_at(grid_points(FRAME, zoom) + np.array([40, 35]), GREY), Memory()
    blend.spread(face, memory)
    blend.begin(face, memory)
    face.canvas.planes, face.canvas.share, face.canvas.rims = planes(200), share, rims
    blend.scatter(face, memory)
    blend.composite(face, memory)
    blend.write(face, memory)
    return face.frame.rgb()


def inner(mask: np.ndarray, reach: int) -> tuple[slice, slice]:
    """Rows and columns about the middle of the face in the frame."""
    x, y = HEAD.mean(0).astype(int)
    return slice(y - reach, y + reach), slice(x - reach, x + reach)


def test_a_face_is_drawn_on_its_mesh_and_nothing_beside_it(blend: Blend) -> None:
    made = blended(blend)
    assert (made[inner(FRAME.mask, 8)] == 200).all()
    low, high = HEAD.min(0).astype(int) - 2, HEAD.max(0).astype(int) + 4
    outside = np.ones(SIZE, bool)
    outside[low[1] : high[1], low[0] : high[0]] = False
    assert_array_equal(made[outside], GREY[outside])


@pytest.mark.parametrize(("share", "expected"), [(0.0, 90), (0.5, 145), (1.0, 200)])
def test_a_share_of_it_is_drawn_where_that_is_hidden(blend: Blend, share: float, expected: int) -> None:
    part = np.full(FRAME.size, share, np.float32)
    assert np.abs(blended(blend, part)[inner(FRAME.mask, 8)].astype(int) - expected).max() <= 1
    assert np.abs(blended(blend, None, 1 - part)[inner(FRAME.mask, 8)].astype(int) - expected).max() <= 1
    assert (blended(blend)[inner(FRAME.mask, 8)] == 200).all()  # and all of it once nothing hides it any more


def test_values_are_rounded_and_end_at_black_and_white(blend: Blend) -> None:
    face, memory = face_at(HEAD, GREY), Memory()
    for value, stored in ((-30.0, 0), (99.6, 100), (99.4, 99), (400.0, 255)):
        face.canvas.planes = planes(value)
        blend.scatter(face, memory)
        assert (face.canvas.picture == stored).all()  # beside the mask, too, so that the warp meets no rim


def test_a_face_beside_the_picture_is_not_begun(blend: Blend) -> None:
    for away in (1000, -1000):
        face, memory = face_at(HEAD + away, GREY), Memory()
        blend.spread(face, memory)
        blend.begin(face, memory)
        assert face.canvas.is_outside
    face = face_at(HEAD - np.array([70, 0]), GREY)  # half of it
    blend.spread(face, Memory())
    blend.begin(face, Memory())
    assert not face.canvas.is_outside
    assert face.canvas.corner[0] == 0


def test_the_last_parsing_moves_along_with_the_head_in_the_pixels_of_the_rectangle(blend: Blend) -> None:
    columns = np.broadcast_to(np.arange(64, dtype=np.float32)[None], (64, 64)) / 64
    memory, moved = Memory(), HEAD + np.array([12, -5])
    memory.parsed = parsing_of({FaceClass.SKIN: columns}, SIZE), HEAD
    face = face_at(moved, GREY)
    blend.spread(face, memory)
    blend.begin(face, memory)
    assert face.parsed is not None
    before, _ = memory.parsed
    there = before.at(HEAD, before.shares[FaceClass.SKIN])
    now = face.parsed.at(moved - face.canvas.corner, face.parsed.shares[FaceClass.SKIN])
    np.testing.assert_allclose(now, there, atol=0.01)
    assert np.ptp(there) > 0.2


def test_a_large_face_is_drawn_from_a_finer_picture(blend: Blend) -> None:
    face, memory = face_at(grid_points(FRAME, 2.0), np.full((200, 200, 3), 90, np.uint8)), Memory()
    face.canvas.fine = True
    blend.spread(face, memory)
    blend.begin(face, memory)
    h, w = FRAME.size
    face.canvas.picture = np.full((2 * h, 2 * w, 3), 200, np.uint8)
    face.canvas.picture[:, ::2] = 100  # finer than the grid
    blend.composite(face, memory)
    x, y = (grid_points(FRAME, 2.0).mean(0) - face.canvas.corner).astype(int)
    assert np.ptp(face.canvas.roi[y - 5 : y + 6, x - 5 : x + 6, 0]) > 60


@pytest.mark.parametrize("fmt", ["rgb24", "yuv420p", "yuvj444p"])
@pytest.mark.parametrize("tinted", [False, True])
def test_a_face_in_a_picture_without_colour_has_none(blend: Blend, fmt: str, tinted: bool) -> None:
    rgb = np.random.default_rng(1).integers(0, 256, (*SIZE, 1)).astype(np.uint8).repeat(3, axis=2)
    if tinted:
        rgb[60:80, 60:80, 0] //= 2
    video = av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(format=fmt)
    frame = Frame.from_rgb(rgb) if fmt == "rgb24" else Frame(video, pts=0, time_base=Fraction(1, 30), index=0)
    before, points = frame.copy().rgb(), grid_points(FRAME, 1.0) + np.array([40, 35])
    face, memory = FaceInFrame(frame, points, points, mesh=points), Memory()
    blend.spread(face, memory)
    blend.begin(face, memory)
    face.canvas.planes = planes(0) + np.array([[180], [90], [150]], np.float32)
    blend.scatter(face, memory)
    blend.composite(face, memory)
    blend.write(face, memory)
    drawn = frame.rgb().astype(int)
    assert (np.abs(drawn - before).max(axis=2) > 9).mean() > 0.05
    assert (np.ptp(drawn[inner(FRAME.mask, 8)], axis=2).max() > 20) == tinted


def test_it_says_what_draws(blend: Blend) -> None:
    assert "CPU" in blend.renderer.upper()
