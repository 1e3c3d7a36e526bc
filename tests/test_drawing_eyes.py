"""Eyes and mouth: the source's own through the identity's lids and lips, a disguise's painted anew, lids that shut."""

from dataclasses import replace

import numpy as np
import pytest
from drawing import drawn_on, grid_points, parsing_of
from made_up import SAMPLES
from models import model_file
from numpy.testing import assert_allclose

from guise.aam.irises import Irises, nose_length
from guise.aam.landmarks.schemes import (
    EYES,
    INNER_LIPS,
    LEFT_BROW,
    LEFT_EYE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_LIDS,
    RIGHT_EYE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    UPPER_LIDS,
)
from guise.aam.light import LUMA
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, FaceParser, FaceParsing, Parsing
from guise.aam.reference import ReferenceFrame
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import Engine
from guise.app.drawing.face import FaceInFrame
from guise.app.drawing.look import DISGUISE, SWAP, Look
from guise.app.drawing.memory import Memory
from guise.app.drawing.passes import eyes as drawn_eyes
from guise.app.drawing.passes.eyes import (
    EYEBALL,
    LIMITS,
    Aperture,
    DrawnLid,
    Eyeballs,
    LidCloser,
    ShutShares,
    eye_openings,
)
from guise.app.drawing.passes.irises import eye_seen
from guise.app.media import Frame, open_input
from guise.common.arrays import F32, F64, U8, Bool

FRAME = ReferenceFrame.canonical(96)


def filled(
    aperture: Aperture, picture: U8, roi: U8, head: F64, parsing: Parsing | None = None, *, fine: bool = False
) -> U8:
    """A picture with what a rectangle shows of a head (81, 2)."""
    face = drawn_on(roi, head, picture, fine=fine)
    face.parsed = parsing
    shut = ShutShares(FRAME.points)(eye_openings(head))
    aperture.fill(face, Memory(), shut, head, nose_length(head))
    return picture


@pytest.mark.parametrize("factor", [1, 2])
def test_an_aperture_shows_what_the_frame_shows_there_and_nothing_around_it_changes(factor: int) -> None:
    h, w = FRAME.size
    roi = np.zeros((2 * h, 2 * w, 3), np.uint8)
    roi[..., 0] = np.linspace(50, 200, 2 * w)  # on the source's face, twice as large as the grid's
    picture = np.full((factor * h, factor * w, 3), 255, np.uint8)
    filled(Aperture(FRAME, INNER_LIPS, factor, FRAME.points), picture, roi, grid_points(FRAME, 2))
    x, y = FRAME.points[INNER_LIPS].mean(0)
    at = round((y + 0.5) * factor - 0.5), round((x + 0.5) * factor - 0.5)
    assert picture[at][0] == pytest.approx(50 + 150 * x / w, abs=3)
    assert picture[at][1] <= 3
    share = soft_parts(FRAME, (INNER_LIPS,), 0.0).repeat(factor, 0).repeat(factor, 1)
    assert (picture[share == 0] == 255).all()


def test_fine_stripes_keep_their_contrast_in_an_aperture() -> None:
    h, w = FRAME.size
    columns = np.arange(w + 8)
    roi = np.repeat((120 + 40 * np.sin(columns * 2 * np.pi / 5))[None, :, None], h + 8, 0).repeat(3, 2)
    picture = np.full((h, w, 3), 120, np.uint8)
    filled(
        Aperture(FRAME, RIGHT_EYE, 1, FRAME.points),
        picture,
        np.round(roi).astype(np.uint8),
        FRAME.points + 0.5,
    )
    inside = soft_parts(FRAME, (RIGHT_EYE,), 0.0) > 0.9
    assert picture[inside, 0].std() > 0.9 * roi[..., 0].std()


@pytest.mark.parametrize(
    ("lids", "beside", "expected"),
    [(1.0, 1.0, 255), (0.1, 1.0, 0), (1.0, 0.1, 255), (0.4, 0.1, 133), (0.4, 1.0, 133)],
)
def test_an_eye_may_be_the_sources_only_while_it_is_shut(lids: float, beside: float, expected: int) -> None:
    """Whatever the other one does."""
    h, w = FRAME.size
    head = FRAME.points.copy()
    for eye, share in ((LEFT_EYE, lids), (RIGHT_EYE, beside)):
        middle = head[eye, 1].mean()
        head[eye, 1] = middle + share * (head[eye, 1] - middle)
    picture = np.full((h, w, 3), 255, np.uint8)
    filled(Aperture(FRAME, LEFT_EYE, 1, FRAME.points, only_shut=True), picture, np.zeros_like(picture), head)
    x, y = FRAME.points[LEFT_EYE].mean(0).round().astype(int)
    assert float(picture[y, x, 0]) == pytest.approx(expected, abs=3)


def parsed(shares: dict[FaceClass, np.ndarray]) -> Parsing:
    """A parsing of the grid, given shares of some classes (64, 64)."""
    return parsing_of(shares, FRAME.size)


def shown(parsing: Parsing) -> np.ndarray:
    """(h, w) share of a black source in the texture while its left eye is shut."""
    head = FRAME.points.copy()
    head[LEFT_EYE, 1] = head[LEFT_EYE, 1].mean()
    picture = np.full((*FRAME.size, 3), 255, np.uint8)
    eye = Aperture(FRAME, LEFT_EYE, 1, FRAME.points, only_shut=True)
    filled(eye, picture, np.zeros_like(picture), head, parsing)
    return 1 - picture[..., 0] / 255


def test_the_lid_of_a_shut_eye_is_the_sources_up_to_the_brow_and_no_farther() -> None:
    share, brow = shown(parsed({})), FRAME.points[LEFT_BROW]
    x = round(brow[2, 0])
    rows = np.arange(int(brow[2, 1]), int(FRAME.points[LEFT_EYE, 1].min()) + 1)
    below = (rows - brow[2, 1]) / FRAME.resolution
    assert share[rows[below > 0.07], x].min() > 0.9
    assert share[rows[below < 0.02], x].max() < 0.1


def test_no_brow_of_the_source_shows_above_a_shut_eye() -> None:
    brow_above_lid = np.zeros((64, 64), np.float32)
    brow_above_lid[: int(FRAME.points[LEFT_EYE, 1].mean() * 64 / FRAME.size[0]) - 1] = 1
    bare, hairy = shown(parsed({})), shown(parsed({FaceClass.BROWS: brow_above_lid}))
    top = int(FRAME.points[LEFT_EYE, 1].min()) - 3
    assert bare[top].max() > 0.5
    assert hairy[top].max() == 0
    lower = int(FRAME.points[LEFT_EYE, 1].max())
    assert bare[lower:].max() > 0.5
    assert np.allclose(bare[lower:], hairy[lower:], atol=0.02)


@pytest.mark.parametrize(("most", "lid"), [(1.0, 0.0), (0.3, 1.0)])
def test_what_the_parsing_takes_for_lid_is_no_eye_unless_it_sees_no_eye_at_all(
    most: float, lid: float
) -> None:
    lower_half = np.zeros((64, 64), np.float32)
    lower_half[32:] = most
    places = np.stack(np.meshgrid(np.arange(20, 40), np.arange(20, 80)), -1).astype(np.float32).reshape(-1, 2)
    to_cells = parsed({}).to_cells
    seen = eye_seen(lower_half, to_cells, places)
    middle = FRAME.size[0] / 2
    assert (seen[places[:, 1] > middle + 3] == 1).all()
    assert seen[places[:, 1] < middle - 3] == pytest.approx(lid)
    assert (eye_seen(np.zeros((1, 1), np.float32), to_cells, places) == 1).all()


def test_a_parsing_can_be_read_from_a_part_of_its_picture() -> None:
    shares = np.arange(64.0)[None].repeat(64, 0)
    whole = parsed({FaceClass.SKIN: shares})
    part = whole.from_place(7, -3)
    point = np.array([[30.0, 40.0]])
    skin = [
        one.at(there, one.shares[FaceClass.SKIN]) for one, there in ((whole, point), (part, point - [7, -3]))
    ]
    assert skin[0] == pytest.approx(skin[1], abs=0.05)


@pytest.mark.parametrize("factor", [1, 2])
def test_a_shut_eye_has_the_sources_lashes_in_the_tone_of_the_drawn_skin(factor: int) -> None:
    h, w = FRAME.size
    head = grid_points(FRAME, factor)
    head[LEFT_EYE, 1] = head[LEFT_EYE, 1].mean()
    socket, skin = np.array([70, 150, 110], np.uint8), np.array([150, 126, 130], np.uint8)
    roi = np.tile(socket, (factor * h, factor * w, 1))
    row = round(float(head[LEFT_EYE, 1].mean()))
    roi[row - factor + 1 : row + factor, :, 0] = 20
    picture = np.tile(skin, (factor * h, factor * w, 1))
    eye = Aperture(FRAME, LEFT_EYE, factor, FRAME.points, only_shut=True)
    filled(eye, picture, roi, head, fine=factor == 2)
    column = round(float(head[LEFT_EYE, 0].mean()))
    top = int(factor * FRAME.points[LEFT_EYE, 1].min())
    lid = np.median(picture[top - 4 * factor : top - factor, column].astype(float), axis=0)
    assert picture[row, column, 0] < 0.5 * skin[0]
    assert abs(lid[0] - skin[0]) < 0.2 * (skin[0] - socket[0])
    assert np.abs(lid[1:] - skin[1:]).max() < 5


@pytest.mark.parametrize("factor", [1, 2])
def test_a_disguises_lid_is_drawn_over_a_shut_eye_and_only_there(factor: int) -> None:
    h, w = FRAME.size
    eye = soft_parts(FRAME, (LEFT_EYE,), 0.0).repeat(factor, 0).repeat(factor, 1)
    picture = np.full((factor * h, factor * w, 3), 150, np.uint8)
    picture[eye > 0.5] = 40
    lid, openings = DrawnLid(FRAME, LEFT_EYE, factor), eye_openings(FRAME.points)
    shares = ShutShares(FRAME.points, LIMITS.drawn_earlier)
    opened, shut = picture.copy(), picture.copy()
    lid.fill(opened, shares(openings))
    lid.fill(shut, shares((0.2 * openings[0], 0.2 * openings[1])))
    assert (opened == picture).all()
    assert shut[eye > 0.8, 1].mean() > 130  # skin
    assert (shut[eye > 0.3, 1].astype(int) - shut[eye > 0.3, 0]).max() > 30  # lashes
    around = soft_parts(FRAME, (LEFT_EYE,), 0.05).repeat(factor, 0).repeat(factor, 1) == 0
    assert (shut[around] == picture[around]).all()


def drawn(look: Look) -> tuple[U8, F64, U8]:
    """A frame before and after a swap, and the drawn mesh."""
    p01, p02 = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    with open_input(SAMPLES / "p01" / "talk.mp4") as media, Engine(p01, Donor.of(p02), None, look) as engine:
        frame: Frame = next(iter(media))
        before = frame.rgb()
        shape = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
        return before, engine.draw(frame, shape), frame.rgb()


def test_eyes_are_the_sources_only_where_that_is_chosen() -> None:
    before, mesh, own = drawn(replace(SWAP, eyes="source", renderer="cpu"))
    _, _, other = drawn(replace(SWAP, eyes="donor", renderer="cpu"))
    changed = np.abs(own.astype(float) - other).max(2) > 8
    ys, xs = np.nonzero(changed)
    assert len(ys) > 20
    eyes = mesh[[*RIGHT_EYE, *LEFT_EYE]]
    margin = 0.05 * np.ptp(mesh[:, 0])
    assert xs.min() > eyes[:, 0].min() - margin
    assert xs.max() < eyes[:, 0].max() + margin
    assert ys.min() > eyes[:, 1].min() - margin
    assert ys.max() < eyes[:, 1].max() + margin
    assert not np.array_equal(before, own)


def test_the_mouth_is_the_sources_only_where_that_is_chosen() -> None:
    _, mesh, own = drawn(replace(SWAP, mouth="source", renderer="cpu"))
    _, _, other = drawn(replace(SWAP, mouth="donor", renderer="cpu"))
    ys, xs = np.nonzero(np.abs(own.astype(float) - other).max(2) > 8)
    mouth, margin = mesh[INNER_LIPS], 0.05 * np.ptp(mesh[:, 0])
    assert len(ys) > 20
    places = np.column_stack([xs, ys])
    assert (places > mouth.min(0) - margin).all()
    assert (places < mouth.max(0) + margin).all()


@pytest.mark.parametrize("look", [SWAP, DISGUISE])
def test_a_disguise_shows_nothing_of_the_sources_eyes(look: Look) -> None:
    """Whatever colour they have."""
    p01, p02 = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    shape = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
    with open_input(SAMPLES / "p01" / "talk.mp4") as media:
        rgb = next(iter(media)).rgb()
    x, y = np.round(shape[list(LEFT_EYE)].mean(0)).astype(int)
    gleam = rgb.copy()
    gleam[y - 2 : y + 3, x - 2 : x + 3] = (0, 255, 0)
    made = []
    for shown in (rgb, gleam):
        frame = Frame.from_rgb(shown)
        with Engine(p01, Donor.of(p02), None, replace(look, renderer="cpu")) as engine:
            engine.draw(frame, shape)
        made.append(frame.rgb().astype(int))
    green = np.abs(made[1] - made[0])[y - 8 : y + 9, x - 12 : x + 13].max()
    assert (green > 80) == (look is SWAP)
    if look is DISGUISE:
        assert green < 40


@pytest.fixture(scope="module")
def identity() -> Identity:
    return Identity.load(model_file("p06"))


@pytest.fixture
def eyeballs(identity: Identity) -> Eyeballs:
    shape, texture = identity.appearance.neutral_shape, identity.appearance.neutral_texture
    irises = Irises.at_rest(identity.reference, shape, texture)
    return Eyeballs(identity.reference, irises, shape, texture)


def _drawn(eyeballs: Eyeballs, identity: Identity, x: float, mesh: F64 | None = None, y: float = 0.0) -> F32:
    """The brightness (h, w) of a texture whose eyes look at a place; of skin is 200."""
    mesh = identity.appearance.neutral_shape if mesh is None else mesh
    face, memory = FaceInFrame(Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)), mesh, mesh, mesh=mesh), Memory()
    face.canvas.texture = np.full((identity.reference.mask.sum(), 3), 200, np.float32)
    memory.gaze.parsed = np.array([[x, y], [x, y]])
    eyeballs.paint(face, memory)
    return np.asarray(identity.reference.scatter(face.canvas.texture) @ LUMA)


def _dark(picture: F32, identity: Identity, eye: tuple[int, ...]) -> float:
    """Column of what is dark in an eye, eye widths from its middle."""
    points = identity.reference.points[list(eye)]
    low, high = np.round(points.min(0)).astype(int), np.round(points.max(0)).astype(int)
    window = picture[low[1] + 1 : high[1], low[0] + 3 : high[0] - 2]
    weights = np.clip(np.median(window) - window, 0, None).sum(0)
    return float(weights @ np.arange(window.shape[1]) / weights.sum()) / np.ptp(points[:, 0])


def test_both_irises_are_where_the_source_has_them(eyeballs: Eyeballs, identity: Identity) -> None:
    left, right = (_drawn(eyeballs, identity, x) for x in (-0.1, 0.1))
    for eye in (tuple(RIGHT_EYE), tuple(LEFT_EYE)):
        assert _dark(right, identity, eye) - _dark(left, identity, eye) == pytest.approx(0.2, abs=0.07)


def test_an_iris_half_under_the_lid_still_reflects_the_light(
    eyeballs: Eyeballs, identity: Identity, monkeypatch: pytest.MonkeyPatch
) -> None:
    lit = _drawn(eyeballs, identity, 0.0, y=-0.15)
    monkeypatch.setattr(drawn_eyes, "EYEBALL", replace(EYEBALL, reflected=0.0))
    unlit = _drawn(eyeballs, identity, 0.0, y=-0.15)
    for eye in (RIGHT_EYE, LEFT_EYE):
        inside = soft_parts(identity.reference, (eye,), 0.0) > 0.8
        assert (lit - unlit)[inside].max() > 40


def test_only_eyes_are_drawn(eyeballs: Eyeballs, identity: Identity) -> None:
    picture = _drawn(eyeballs, identity, 0.0)
    changed = (np.abs(picture - 200) > 1) & identity.reference.mask
    ys, xs = np.nonzero(changed)
    eyes = identity.reference.points[EYES]
    near = 0.06 * identity.reference.resolution
    assert (np.column_stack([xs, ys]) > eyes.min(0) - near).all()
    assert (np.column_stack([xs, ys]) < eyes.max(0) + near).all()
    assert changed.sum() > 150


def test_a_shut_eye_shows_no_iris(eyeballs: Eyeballs, identity: Identity) -> None:
    shape = identity.appearance.neutral_shape
    shut = shape.copy()
    for eye in (RIGHT_EYE, LEFT_EYE):
        shut[eye, 1] = shape[eye, 1].max() - 0.02 * (shape[eye, 1].max() - shape[eye, 1])
    of_gaze = [
        np.abs(np.diff([_drawn(eyeballs, identity, x, mesh) for x in (-0.1, 0.1)], axis=0)).sum()
        for mesh in (shape, shut)
    ]
    assert of_gaze[1] < 0.5 * of_gaze[0]


@pytest.fixture(scope="module")
def seen_lids() -> tuple[FaceParsing, F64]:
    """A parsed frame of the first sample person with open eyes, and the true landmarks."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as clip:
        rgb = next(iter(clip)).rgb()
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(np.float64)
    return FaceParser().parse(rgb, points), points


def with_skin_for_eyes(parsing: FaceParsing, where: Bool) -> FaceParsing:
    """The same with skin in some of the columns (64,) where eyes are."""
    shares = parsing.shares.copy()
    shares[FaceClass.SKIN][:, where] += shares[FaceClass.EYES][:, where]
    shares[FaceClass.EYES][:, where] = 0
    return FaceParsing(shares, parsing.to_picture, parsing.irises)


class Lids:
    """A closer with what it remembers, that sees a parsed frame each tenth of a second."""

    def __init__(self) -> None:
        self.closer, self.memory = LidCloser(), Memory()

    def see(self, parsing: FaceParsing, points: F64) -> None:
        self.memory.clock.now += 0.1
        self.memory.cover.parsed_at = self.memory.clock.now - 0.1
        face = FaceInFrame(Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)), points, points, parsing=parsing)
        self.closer.see(face, self.memory)

    def __call__(self, points: F64) -> F64:
        face = FaceInFrame(Frame.from_rgb(np.zeros((8, 8, 3), np.uint8)), points, points)
        self.closer.see(face, self.memory)  # a frame that isn't parsed tells nothing
        self.closer.close(face, self.memory)
        return face.head


def test_open_eyes_stay_as_they_are(seen_lids: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen_lids
    closer = Lids()
    closer.see(parsing, points)
    assert_allclose(closer(points), points)


def test_lids_shut_when_the_eyes_are_no_longer_seen_and_open_again(
    seen_lids: tuple[FaceParsing, F64],
) -> None:
    parsing, points = seen_lids
    closer, everywhere = Lids(), np.ones(parsing.shares.shape[2], bool)
    closer.see(parsing, points)
    closer.see(with_skin_for_eyes(parsing, everywhere), points)
    shut = closer(points)
    assert_allclose(shut[UPPER_LIDS], points[LOWER_LIDS])
    others = np.setdiff1d(np.arange(len(points)), UPPER_LIDS)
    assert (shut[others] == points[others]).all()
    closer.see(parsing, points)
    assert_allclose(closer(points), points)


def test_each_eye_is_judged_by_itself(seen_lids: tuple[FaceParsing, F64]) -> None:
    parsing, points = seen_lids
    middle = parsing.to_cells[:, :2] @ points[EYES].mean(0) + parsing.to_cells[:, 2]
    right_side = np.arange(parsing.shares.shape[2]) < middle[0]
    closer = Lids()
    closer.see(parsing, points)
    closer.see(with_skin_for_eyes(parsing, right_side), points)
    assert_allclose(closer(points)[RIGHT_UPPER_LID], points[RIGHT_LOWER_LID])
    assert_allclose(closer(points)[LEFT_UPPER_LID], points[LEFT_UPPER_LID])
    assert (points[LEFT_LOWER_LID] != points[LEFT_UPPER_LID]).all()


def test_eyes_of_which_nothing_was_ever_seen_are_left_alone(seen_lids: tuple[FaceParsing, F64]) -> None:
    """Behind dark glasses the parsing tells nothing."""
    parsing, points = seen_lids
    closer = Lids()
    closer.see(with_skin_for_eyes(parsing, np.ones(parsing.shares.shape[2], bool)), points)
    assert_allclose(closer(points), points)
    assert_allclose(closer(points)[RIGHT_EYE], points[RIGHT_EYE])


def test_of_a_small_face_lids_stay_as_they_were_found(seen_lids: tuple[FaceParsing, F64]) -> None:
    """The parsing saw a blurred eye 12 pixels wide for a second and then never again."""
    parsing, points = seen_lids
    small, unseen = 0.2 * points, with_skin_for_eyes(parsing, np.ones(parsing.shares.shape[2], bool))
    closer = Lids()
    for one in (parsing, unseen):
        closer.see(FaceParsing(one.shares, 0.2 * one.to_picture, one.irises), small)
    assert_allclose(closer(small), small)
