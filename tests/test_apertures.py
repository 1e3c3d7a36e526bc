"""The source's own mouth and eyes, drawn through the identity's lips and lids."""

import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.landmarks.schemes import INNER_LIPS, LEFT_BROW, LEFT_EYE, RIGHT_EYE
from guise.aam.mask import soft_parts
from guise.aam.model import Identity
from guise.aam.parsing import FaceClass, Parsing
from guise.aam.reference import ReferenceFrame
from guise.app.media import ColourMatrix, Frame, open_input
from guise.app.swapping.apertures import Aperture, DrawnLid, _eye_seen, eye_openings
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions

FRAME = ReferenceFrame.canonical(96)
SAME = ColourMatrix(*(np.eye(3, 4, dtype=np.float32) for _ in range(2)))


@pytest.mark.parametrize("factor", [1, 2])
def test_an_aperture_shows_what_the_frame_shows_there_and_nothing_around_it_changes(factor: int) -> None:
    h, w = FRAME.size
    roi = np.zeros((2 * h, 2 * w, 3), np.uint8)
    roi[..., 0] = np.linspace(50, 200, 2 * w)  # on the source's face, twice as large as the grid's
    picture = np.full((factor * h, factor * w, 3), 255, np.uint8)
    Aperture(FRAME, INNER_LIPS, factor).fill(picture, roi, (FRAME.points + 0.5) * 2 - 0.5, SAME)
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
    Aperture(FRAME, RIGHT_EYE, 1).fill(picture, np.round(roi).astype(np.uint8), FRAME.points + 0.5, SAME)
    inside = soft_parts(FRAME, (RIGHT_EYE,), 0.0) > 0.9
    assert picture[inside, 0].std() > 0.9 * roi[..., 0].std()


@pytest.mark.parametrize(
    ("lids", "beside", "expected"),
    [(1.0, 1.0, 255), (0.1, 1.0, 0), (1.0, 0.1, 255), (0.4, 0.1, 0), (0.4, 1.0, 133)],
)
def test_an_eye_may_be_the_sources_only_while_it_is_shut(lids: float, beside: float, expected: int) -> None:
    """Half open counts as shut only beside an eye that is."""
    h, w = FRAME.size
    head = FRAME.points.copy()
    for eye, share in ((LEFT_EYE, lids), (RIGHT_EYE, beside)):
        middle = head[eye, 1].mean()
        head[eye, 1] = middle + share * (head[eye, 1] - middle)
    picture = np.full((h, w, 3), 255, np.uint8)
    Aperture(FRAME, LEFT_EYE, 1, at_rest=FRAME.points).fill(picture, np.zeros_like(picture), head, SAME)
    x, y = FRAME.points[LEFT_EYE].mean(0).round().astype(int)
    assert float(picture[y, x, 0]) == pytest.approx(expected, abs=3)


def parsed(shares: dict[FaceClass, np.ndarray]) -> Parsing:
    """A parsing of the grid, given shares of some classes (64, 64)."""
    maps = np.zeros((len(FaceClass), 64, 64), np.float32)
    for kind, share in shares.items():
        maps[kind] = share
    h, w = FRAME.size
    return Parsing(maps, np.array([[w / 64, 0, 0], [0, h / 64, 0]]))


def shown(parsing: Parsing) -> np.ndarray:
    """(h, w) share of a black source in the texture while its left eye is shut."""
    head = FRAME.points.copy()
    head[LEFT_EYE, 1] = head[LEFT_EYE, 1].mean()
    picture = np.full((*FRAME.size, 3), 255, np.uint8)
    eye = Aperture(FRAME, LEFT_EYE, 1, at_rest=FRAME.points)
    eye.fill(picture, np.zeros_like(picture), head, SAME, None, parsing)
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
    places = np.stack(np.meshgrid(np.arange(20, 40), np.arange(20, 80)), -1).astype(np.float32)
    seen = _eye_seen(parsed({FaceClass.EYES: lower_half}), places)
    middle = FRAME.size[0] / 2
    assert (seen[places[..., 1] > middle + 3] == 1).all()
    assert seen[places[..., 1] < middle - 3] == pytest.approx(lid)
    assert (_eye_seen(None, places) == 1).all()


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
def test_a_disguises_lid_is_drawn_over_a_shut_eye_and_only_there(factor: int) -> None:
    h, w = FRAME.size
    eye = soft_parts(FRAME, (LEFT_EYE,), 0.0).repeat(factor, 0).repeat(factor, 1)
    picture = np.full((factor * h, factor * w, 3), 150, np.uint8)
    picture[eye > 0.5] = 40
    lid, openings = DrawnLid(FRAME, LEFT_EYE, factor, FRAME.points), eye_openings(FRAME.points)
    opened, shut = picture.copy(), picture.copy()
    lid.fill(opened, openings)
    lid.fill(shut, 0.2 * openings)
    assert (opened == picture).all()
    assert shut[eye > 0.8, 1].mean() > 130  # skin
    assert (shut[eye > 0.3, 1].astype(int) - shut[eye > 0.3, 0]).max() > 30  # lashes
    around = soft_parts(FRAME, (LEFT_EYE,), 0.05).repeat(factor, 0).repeat(factor, 1) == 0
    assert (shut[around] == picture[around]).all()


def test_a_disguise_never_shows_the_source() -> None:
    assert EngineOptions(eyes="source", mouth="source", disguise=True).source_parts == ()
    assert EngineOptions(eyes="donor", disguise=True).shut_parts == ()
    assert EngineOptions(eyes="donor", light="paper").shut_parts == ()
    parts = EngineOptions(eyes="source", mouth="source").source_parts
    assert [list(p) for p in parts] == [list(p) for p in (RIGHT_EYE, LEFT_EYE, INNER_LIPS)]
    assert EngineOptions(eyes="donor", mouth="donor").source_parts == ()


def drawn(options: EngineOptions) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A frame before and after a swap, and the drawn mesh."""
    p01, p02 = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    with open_input(SAMPLES / "p01" / "talk.mp4") as media, Engine(p01, p02, None, options) as engine:
        frame: Frame = next(iter(media))
        before = frame.rgb()
        shape = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][0].astype(float)
        return before, engine.draw(frame, shape), frame.rgb()


@pytest.mark.slow
def test_eyes_are_the_sources_only_where_that_is_chosen() -> None:
    before, mesh, own = drawn(EngineOptions(eyes="source", renderer="cpu"))
    _, _, other = drawn(EngineOptions(eyes="donor", renderer="cpu"))
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
