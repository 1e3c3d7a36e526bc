"""Brows: as thick as they are whatever lids do, and never the person's own beside the drawn ones."""

import numpy as np
import pytest
from drawing import drawn_on, face_at
from made_up import SAMPLES
from models import model_file
from numpy.testing import assert_array_equal

from guise.aam.landmarks.schemes import BROWS, LEFT_BROW, NOSE_TIP, RIGHT_BROW, UPPER_LIDS
from guise.aam.model import Identity
from guise.aam.parsing import CELLS, FaceClass, Parsing
from guise.aam.reference import POINTS, MeshSampler, ReferenceFrame
from guise.aam.relief import STRAIGHT
from guise.aam.solid_shape import Sight
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes.brows import DrawnBrows, HeadBrows, cover_brows
from guise.app.media import open_input
from guise.common.arrays import F64, U8

FRAME = ReferenceFrame.canonical(160)
SMALL = ReferenceFrame.canonical(32)


SCALE = 8.0  # pixels per grid pixel
HEAD = SMALL.points * SCALE + 80
SIZE = tuple(int(n) for n in HEAD.max(0)[::-1] + 80)
WIDTH = SCALE * SMALL.resolution
PIXELS_PER_CELL = max(SIZE) / CELLS
SKIN, HAIR = (150, 120, 140), (40, 126, 130)
TRACES = [np.round(HEAD[brow]).astype(int) for brow in (RIGHT_BROW, LEFT_BROW)]


def painted(factor: int) -> U8:
    """A texture with brows: bright skin, and dark strips as thick as brows below their points."""
    h, w = FRAME.size
    ys, xs = (np.mgrid[: factor * h, : factor * w] + 0.5) / factor - 0.5
    picture = np.full((factor * h, factor * w, 3), 200, np.uint8)
    for brow in (RIGHT_BROW, LEFT_BROW):
        x, y = FRAME.points[brow].T
        below = ys - np.interp(xs, x, y)
        picture[(xs >= x[0]) & (xs <= x[-1]) & (below > 0) & (below < 0.035 * FRAME.resolution)] = 40
    return picture


def thickness(picture: U8, brow: np.ndarray) -> float:
    """Of the dark strip in the middle of a brow, share of what it was."""
    column = round(FRAME.points[brow, 0].mean() * picture.shape[1] / FRAME.size[1])
    rows = slice(0, round(FRAME.points[UPPER_LIDS, 1].max() * picture.shape[0] / FRAME.size[0]))
    return float((200.0 - picture[rows, column, 0]).sum())


def farther(share: float) -> F64:
    """The face with brows farther above the lids, by a share of the distance."""
    points = FRAME.points.copy()
    points[BROWS, 1] += share * (points[BROWS, 1] - points[UPPER_LIDS, 1].mean())
    return points


DRAWN = DrawnBrows(FRAME)


def keep(picture: U8, drawn: F64, at_rest: F64) -> U8:
    """A texture with brows as thick as at rest (81, 2) of a face drawn as (81, 2)."""
    face = drawn_on(picture, drawn, picture, fine=len(picture) > FRAME.size[0])
    face.shape, face.sight = drawn, Sight(STRAIGHT, np.ones(1, np.float32), at_rest)
    DRAWN.keep_thick(face, Memory())
    return face.canvas.picture


@pytest.mark.parametrize("factor", [1, 2])
@pytest.mark.parametrize("share", [-0.15, 0.3, 0.6])
def test_the_texture_of_a_brow_shrinks_as_its_triangles_grow(factor: int, share: float) -> None:
    before = painted(factor)
    after = before.copy()
    keep(after, farther(share), FRAME.points)
    for brow in (RIGHT_BROW, LEFT_BROW):
        drawn = thickness(after, brow) * (1 + share) / thickness(before, brow)
        assert drawn == pytest.approx(1, abs=0.12)


def test_a_brow_is_drawn_as_thick_as_at_rest_all_along() -> None:
    """Where triangles meet, too."""
    drawn, before, factor = FRAME.points.copy(), painted(2), 2
    drawn[UPPER_LIDS, 1] += 0.5 * (drawn[UPPER_LIDS, 1].mean() - drawn[BROWS, 1].mean())
    after = before.copy()
    keep(after, drawn, FRAME.points)
    ys, xs = (np.mgrid[: len(after), : after.shape[1]] + 0.5) / factor - 0.5
    places = MeshSampler.build(FRAME, np.column_stack([xs.ravel(), ys.ravel()])).positions(drawn)
    tall = factor * np.gradient(places[:, 1].reshape(xs.shape), axis=0)
    above = ys < FRAME.points[UPPER_LIDS, 1].max()
    for brow in (RIGHT_BROW, LEFT_BROW):
        first, *_, last = FRAME.points[brow, 0]
        columns = (xs[0] > first + 6) & (xs[0] < last - 6)
        dark, dark_before = ((above * (200.0 - p[..., 0]))[:, columns] for p in (after, before))
        share = (dark * tall[:, columns]).sum(0) / dark_before.sum(0)
        assert np.abs(share - 1).max() < 0.1


def test_a_face_at_rest_stays_as_it_is() -> None:
    picture = painted(1)
    keep(picture, FRAME.points, FRAME.points)
    assert (picture == painted(1)).all()


def test_nothing_but_the_skin_from_brow_to_lid_changes() -> None:
    rng = np.random.default_rng(5)
    before = rng.integers(0, 255, (*FRAME.size, 3), dtype=np.uint8)
    after = before.copy()
    keep(after, farther(0.5), FRAME.points)
    rows = np.flatnonzero((before != after).any((1, 2)))
    assert rows.min() >= np.floor(FRAME.points[BROWS, 1].min())
    assert rows.max() <= np.ceil(FRAME.points[UPPER_LIDS, 1].max()) + 8  # the corners of the eyes lie lower


def test_lids_above_brows_do_no_harm() -> None:
    picture = painted(1)
    keep(picture, farther(-3), farther(-2))
    assert picture.shape == painted(1).shape


def near(brow: np.ndarray, reach: float) -> np.ndarray:
    """(h, w) bool, pixels that lie within a reach of a brow's points."""
    ys, xs = np.mgrid[: SIZE[0], : SIZE[1]]
    away = np.hypot(xs[..., None] - brow[:, 0], ys[..., None] - brow[:, 1]).min(-1)
    return np.asarray(away < reach)


HAIRS = near(np.concatenate(TRACES), 0.025 * WIDTH)


def picture() -> U8:
    """A face with dark brows, in stored components."""
    made = np.full((*SIZE, 3), SKIN, np.uint8)
    made[HAIRS] = HAIR
    return made


def parsed(front: FaceClass | None = None) -> Parsing:
    """Skin and brows; `front` lies before the right brow."""
    shares = np.zeros((len(FaceClass), CELLS, CELLS), np.float32)
    rows = np.minimum((np.arange(CELLS) * PIXELS_PER_CELL).astype(int), SIZE[0] - 1)
    columns = np.minimum((np.arange(CELLS) * PIXELS_PER_CELL).astype(int), SIZE[1] - 1)
    hairs = HAIRS[np.ix_(rows, columns)].astype(np.float32)
    shares[FaceClass.BROWS], shares[FaceClass.SKIN] = hairs, 1 - hairs
    if front is not None:
        before = near(TRACES[0], 0.08 * WIDTH)[np.ix_(rows, columns)]
        shares[:, before] = 0
        shares[front, before] = 1
    return Parsing(shares, np.array([[PIXELS_PER_CELL, 0, 0], [0, PIXELS_PER_CELL, 0]]))


def test_brows_become_skin_and_the_rest_stays() -> None:
    shown = picture()
    cover_brows(shown, HEAD, parsed(), WIDTH)
    for brow in TRACES:
        middle = shown[brow[1:4, 1], brow[1:4, 0]].astype(int)
        assert np.abs(middle - SKIN).max() <= 6
    assert_array_equal(shown[tuple(np.round(HEAD[NOSE_TIP]).astype(int)[::-1])], SKIN)


@pytest.mark.parametrize("front", [FaceClass.HAIR, FaceClass.GLASSES, FaceClass.OCCLUDER])
def test_what_lies_before_a_brow_stays(front: FaceClass) -> None:
    before, shown = picture(), picture()
    cover_brows(shown, HEAD, parsed(front), WIDTH)
    right = tuple(TRACES[0][2, ::-1])
    assert_array_equal(shown[right], before[right])
    assert np.abs(shown[tuple(TRACES[1][2, ::-1])].astype(int) - SKIN).max() <= 6


def test_a_brow_with_no_skin_beside_it_stays() -> None:
    shares = parsed().shares.copy()
    shares[FaceClass.HAIR] += shares[FaceClass.SKIN]
    shares[FaceClass.SKIN] = 0
    shown = picture()
    cover_brows(shown, HEAD, Parsing(shares, parsed().to_picture), WIDTH)
    assert_array_equal(shown, picture())


def test_a_head_beyond_the_picture_is_no_error() -> None:
    shown = picture()
    cover_brows(shown, HEAD - 2 * np.array(SIZE[::-1]), parsed(), WIDTH)
    assert_array_equal(shown, picture())


def test_brows_are_painted_over_once_a_frame_is_parsed_wherever_others_are_drawn() -> None:
    """On their line, too: what is drawn there may end before they do."""
    face = drawn_on(picture(), HEAD, picture(), zoom=SCALE)
    assert_array_equal(face.mesh, HEAD)
    DrawnBrows(SMALL).cover_own(face, Memory())
    assert_array_equal(face.canvas.roi, picture())
    face.parsed = parsed()
    DrawnBrows(SMALL).cover_own(face, Memory())
    for brow in TRACES:
        assert np.abs(face.canvas.roi[tuple(brow[2, ::-1])].astype(int) - SKIN).max() <= 6


def test_the_heads_brows_are_looked_for_in_every_frame_and_others_points_stay() -> None:
    person, memory = Identity.load(model_file("p01")), Memory()
    shape = np.load(SAMPLES / "p01" / "talk2.npz")["landmarks"][0].astype(np.float64)
    with open_input(SAMPLES / "p01" / "talk2.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    wrong = shape.copy()
    wrong[BROWS, 1] += 0.02 * np.ptp(shape[:, 0])
    face = face_at(wrong, rgb)
    HeadBrows(person.appearance).follow(face, memory)
    others = np.setdiff1d(np.arange(POINTS), BROWS)
    assert_array_equal(face.head[others], wrong[others])
    assert np.abs(face.head - shape)[BROWS, 1].mean() < np.abs(wrong - shape)[BROWS, 1].mean()
    assert memory.brows.shifts is not None
