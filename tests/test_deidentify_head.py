"""Another head in place of the source's: what goes, what stays, and when a head isn't known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import guise.app
from guise.aam.landmarks.schemes import LEFT_TEMPLE, NOSE_ROOT, RIGHT_TEMPLE
from guise.aam.model import Identity
from guise.aam.parsing import HeadParser
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.app.deidentify.stages.gaps import packed, steadied, unpacked
from guise.app.deidentify.stages.head import (
    Around,
    HeadPainter,
    Plate,
    _continued,
    _face,
    knows_head,
)
from guise.app.deidentify.stages.head_matte import FoundHead, Gap, find_head, matte
from guise.app.deidentify.stages.head_still import HeadStill, without_background
from guise.app.deidentify.stages.neck import necked
from guise.app.media import Frame

GALLERY = Path(guise.app.__file__).parent / "gallery"


@pytest.fixture(scope="module")
def source() -> Identity:
    return Identity.load(GALLERY / "p03.guise")


@pytest.fixture(scope="module")
def head(source: Identity) -> FoundHead:
    return find_head(HeadParser(), Frame.from_rgb(source.rest_frame.picture), source.rest_frame.shape)


def test_a_frontal_head_with_long_hair_is_known(source: Identity, head: FoundHead) -> None:
    assert knows_head(head, source.rest_frame.shape)


def test_a_head_behind_a_hand_is_not_known(source: Identity, head: FoundHead) -> None:
    objects = np.where(head.places.face & (np.indices(head.mask.shape)[1] < head.mask.shape[1] / 2), 1, 0)
    assert not knows_head(replace(head, objects=objects.astype(np.float32)), source.rest_frame.shape)


def test_a_head_that_reaches_beyond_where_it_is_looked_for_is_not_known(
    source: Identity, head: FoundHead
) -> None:
    assert not knows_head(replace(head, mask=np.ones_like(head.mask)), source.rest_frame.shape)


def test_the_same_head_is_found_at_any_size_and_again(source: Identity, head: FoundHead) -> None:
    still = source.rest_frame
    height, width = still.picture.shape[:2]
    small = cv2.resize(still.picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    found = find_head(HeadParser(), Frame.from_rgb(small), (still.shape + 0.5) / 2 - 0.5)
    both = [
        one.in_picture(one.mask, (0, 0, w, h)) > 0.5
        for one, w, h in ((found, width // 2, height // 2), (head, width, height))
    ]
    assert (both[0] & both[1][::2, ::2]).sum() > 0.95 * (both[0] | both[1][::2, ::2]).sum()
    again = find_head(HeadParser(), Frame.from_rgb(still.picture), still.shape)
    np.testing.assert_array_equal(again.mask, head.mask)


def test_a_face_outside_the_picture_has_no_head_there(source: Identity) -> None:
    still = source.rest_frame
    found = find_head(HeadParser(), Frame.from_rgb(still.picture), still.shape + 5000)
    assert not knows_head(found, still.shape)
    gap = Gap.of(found)
    assert gap.share((0, 0, 30, 20)).max() == gap.body_share((0, 0, 30, 20)).max() == 0


def test_all_hair_goes_and_the_neck_and_what_is_far_stay(source: Identity, head: FoundHead) -> None:
    height, width = source.rest_frame.picture.shape[:2]
    whole = (0, 0, width, height)
    away = Gap.of(head).share(whole)
    hair, neck = (
        head.in_picture(cells, whole) > 0.9
        for cells in ((head.hair > 0.8) & head.mask & ~head.places.below_jaw, head.places.below_jaw)
    )
    assert hair.sum() > 2000
    assert away[hair].min() > 0.9
    assert away[:, :5].max() < 0.01
    assert away[neck].mean() < 0.3
    body = Gap.of(head).body_share(whole)
    throat = neck & (away < 0.1)
    throat[round(source.rest_frame.shape[:, 1].max() + 0.2 * np.ptp(source.rest_frame.shape[:, 0])) :] = False
    assert body[throat].mean() > 0.8
    assert not (Gap.of(head).body & Gap.of(head).cells).any()


def test_gaps_are_kept_as_they_are(head: FoundHead) -> None:
    gap = Gap.of(head)
    other = Gap(np.eye(3, 5) > 0, np.zeros((3, 5), bool), np.array([7.5, -2.0]), 0.25)
    kept = unpacked(packed({(1, 4): gap, (2, 4): other}))
    assert list(kept) == [(1, 4), (2, 4)]
    for one, again in zip((gap, other), kept.values(), strict=True):
        np.testing.assert_array_equal(one.cells, again.cells)
        np.testing.assert_array_equal(one.body, again.body)
        np.testing.assert_array_equal(one.corner, again.corner)
        assert one.scale == again.scale
    assert unpacked(packed({})) == {}


def test_gaps_are_steady_and_follow_the_face() -> None:
    rng = np.random.default_rng(0)
    disc = np.hypot(*(np.indices((60, 50)) - np.array([[[30]], [[25]]]))) < 20
    shape = rng.uniform(-40, 40, (81, 2))
    gaps, shapes = {}, {}
    for k in range(9):
        cells = disc.copy()
        if k == 4:
            cells[:, 30:] = False  # overlooked once
        moved = np.array([3.0 * k, -2.0 * k])
        size = 1 + 0.02 * k
        gaps[1, k] = Gap(cells, np.zeros_like(cells), size * np.array([-50.0, -60.0]) + moved, 0.5 / size)
        shapes[1, k] = size * shape + moved
    made = steadied(gaps, shapes)[1, 4]
    whole = Gap(disc, np.zeros_like(disc), gaps[1, 4].corner, gaps[1, 4].scale)
    roi = (-60, -70, 150, 150)
    found, wanted = (one.share(roi) > 0.5 for one in (made, whole))
    assert (found & wanted).sum() > 0.93 * (found | wanted).sum()


def test_surroundings_are_continued_smoothly_and_kept() -> None:
    across = np.linspace(20, 200, 90, dtype=np.float32)
    picture = np.repeat(np.broadcast_to(across, (70, 90))[..., None], 3, axis=2).copy()
    known = np.ones((70, 90), np.float32)
    known[15:50, 30:60] = 0
    holed = picture * known[..., None]
    made = _continued(holed, known)
    np.testing.assert_allclose(made[known > 0], picture[known > 0], atol=0.1)
    assert np.abs(made - picture).max() < 45
    assert np.abs(made - picture)[known == 0].mean() < 18
    assert np.isfinite(_continued(holed, np.zeros_like(known))).all()


def test_surroundings_are_not_continued_from_another_head(source: Identity, head: FoundHead) -> None:
    still, gap = source.rest_frame, Gap.of(head)
    height, width = still.picture.shape[:2]
    picture = np.full((height, width, 3), 200, np.uint8)
    beside = int(gap.corners[1, 0])
    picture[:, beside:] = 0
    other = Gap(np.ones((height // 8, (width - beside) // 8 + 3), bool), *dark(beside))
    shown = []
    with HeadPainter(HeadStill.of("p02"), "cpu") as painter:
        for others in ([], [other]):
            painter._last = None
            shown.append(
                painter.behind(Frame.from_rgb(picture), np.ptp(still.shape[:, 0]), gap, others, None)
            )
    away = gap.share(shown[0].roi) > 0.9
    assert shown[0].picture[away].min() < 100
    assert shown[1].picture[away].min() > 190


def dark(beside: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Body, corner and scale of a gap that begins a little before a column."""
    return np.zeros((1, 1), bool), np.array([beside - 16.0, 0.0]), 1 / 8


def test_the_matte_is_the_head_without_background_and_body(source: Identity) -> None:
    still = source.rest_frame
    alpha = matte(HeadParser(), still)
    x, y = still.shape.mean(0).round().astype(int)
    assert alpha[y, x] == 1
    assert alpha[:, :40].max() == 0
    assert alpha[-20:].max() == 0
    above = int(still.shape[:, 1].min()) - 30
    assert alpha[above, x] == 1  # hair


@pytest.mark.parametrize("name", ["p01", "p02", "p04", "p05", "p06", "p07", "p08", "p09"])
def test_no_shelves_or_pictures_behind_a_donor_are_head(name: str) -> None:
    still = Identity.load(GALLERY / f"{name}.guise").rest_frame
    alpha = matte(HeadParser(), still)
    width = np.ptp(still.shape[:, 0])
    x, y = (still.shape.min(0) + still.shape.max(0)) / 2
    beyond = np.hypot(*(np.indices(alpha.shape)[::-1] - np.array([x, y])[:, None, None])) > 1.45 * width
    assert alpha[beyond].max() == 0
    assert 0.9 < alpha.sum() / width**2 < 2.2
    edge = (alpha > 0.02) & (alpha < 0.98)
    assert edge.sum() < 0.1 * alpha.sum()


def test_the_head_is_drawn_and_the_swapped_face_is_kept(source: Identity, head: FoundHead) -> None:
    still = source.rest_frame
    frame = Frame.from_rgb(still.picture)
    with HeadPainter(HeadStill.of("p02"), "cpu") as painter:
        gap = Gap.of(head)
        width = np.ptp(still.shape[:, 0])
        painter.draw(frame, still.shape, gap, painter.behind(frame, width, gap, [], None))
    made, before = frame.rgb().astype(int), still.picture.astype(int)
    x, y = still.shape.mean(0).round().astype(int)
    np.testing.assert_array_equal(
        made[y - 20 : y + 20, x - 20 : x + 20], before[y - 20 : y + 20, x - 20 : x + 20]
    )
    height, width = before.shape[:2]
    hair = head.in_picture((head.hair > 0.9) & head.mask, (0, 0, width, height)) > 0.9
    assert np.median(np.abs(made - before).max(2)[hair]) > 20
    np.testing.assert_array_equal(made[:, :20], before[:, :20])


def drawn_turned(painter: HeadPainter, yaw: float) -> tuple[np.ndarray, np.ndarray]:
    """A head turned by an angle in degrees, on grey: where it is drawn, and its mesh (81, 2)."""
    angle = np.radians(yaw)
    turn = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
    mesh = HeadPose(turn, 180.0, np.array([320.0, 280.0])).apply(SolidPrior.shipped().mean)
    frame = Frame.from_rgb(np.full((520, 640, 3), 90, np.uint8))
    nothing = Gap(np.zeros((2, 2), bool), np.zeros((2, 2), bool), mesh.mean(0), 1.0)
    painter.draw(frame, mesh, nothing, painter.behind(frame, 180.0, nothing, [], None))
    return np.abs(frame.rgb().astype(int) - 90).max(2) > 25, mesh


def test_the_head_lies_behind_its_face_when_it_turns() -> None:
    with HeadPainter(HeadStill.of("p02"), "cpu") as painter:
        beyond = []
        for yaw in (-25.0, 0.0, 25.0):
            drawn, mesh = drawn_turned(painter, yaw)
            columns = np.flatnonzero(drawn[int(mesh[:, 1].min()) - 20])  # hair above the forehead
            beyond.append((columns[0] + columns[-1]) / 2 - mesh[NOSE_ROOT, 0])
    assert beyond[0] > 15
    assert abs(beyond[1]) < 12
    assert beyond[2] < -15


def test_the_far_edge_of_a_turned_face_stays_as_it_is_drawn(source: Identity) -> None:
    mesh, size = source.rest_frame.shape, source.rest_frame.picture.shape[:2]
    width = np.ptp(mesh[:, 0])
    front, turned = (_face(mesh, np.array([aside * width, 0.0]), size) for aside in (0.0, 0.4))
    temple, other = (mesh[k] + (way * 0.03 * width, 0) for k, way in ((RIGHT_TEMPLE, 1), (LEFT_TEMPLE, -1)))
    for at, share in ((temple, 1.0), (other, 0.0)):
        x, y = at.round().astype(int)
        assert front[y, x] == 0
        assert turned[y, x] == pytest.approx(share, abs=0.1)
    assert (turned > 0).sum() < 1.2 * (front > 0).sum()


def test_hair_beside_the_forehead_turns_with_the_ears(source: Identity) -> None:
    still = source.rest_frame
    cut = HeadStill(still.picture, matte(HeadParser(), still), still.shape)
    around = Around(cut)
    width = np.ptp(still.shape[:, 0])
    depth = around._depth + np.array([0.4 * width, 0.0])  # what lies behind is seen more to the right
    moved = (around.placed(still.shape, depth) - around.points)[:, 0] / (0.4 * width)
    middle = (still.shape.min(0) + still.shape.max(0)) / 2
    x, y = ((around.points - middle) / np.ptp(still.shape, axis=0)).T
    here, away = ((np.abs(x - side * 0.55) < 0.1) & (y < -0.1) & (y > -0.35) for side in (1, -1))
    assert moved[here].min() > 0.3
    assert moved[away].max() < 0.2
    assert around.placed(still.shape, around._depth) == pytest.approx(around.points)


def test_what_was_shown_behind_a_head_stays_and_nothing_that_was_seen() -> None:
    with HeadPainter(HeadStill.of("p02"), "cpu") as painter:
        away = np.ones((30, 40), np.float32)
        away[:10] = 0
        painter._last = 4, (10, 20), np.full((30, 40, 3), 100, np.float32), away
        next_, later = (
            painter._steadied(np.zeros((30, 40, 3), np.float32), index, (15, 20)) for index in (5, 7)
        )
    assert next_[10:, :35].min() > 80
    assert next_[:10].max() == 0
    assert next_[:, 35:].max() == 0
    assert later.max() == 0


def test_a_plate_is_known_where_the_pictures_agree_without_heads() -> None:
    rng = np.random.default_rng(0)
    wall = rng.integers(0, 255, (60, 80, 3)).astype(np.uint8)
    pictures, heads = [], []
    for k in range(8):
        picture, head = wall.copy(), np.zeros((60, 80), np.uint8)
        head[20:40, 5 * k : 5 * k + 20] = 1
        picture[head > 0] = 0
        picture[45:, :] = 30 * k  # something that moves
        pictures.append(picture)
        heads.append(head)
    plate = Plate.of(pictures, heads)
    np.testing.assert_array_equal(plate.picture[20:40, 5:40], wall[20:40, 5:40])
    assert plate.known[22:38, 10:40].min() > 0.9
    assert plate.known[50:].max() < 0.1
    assert Plate.of(pictures, [np.ones_like(h) for h in heads]).known.max() == 0


def test_a_still_without_its_background_has_the_colours_of_the_head_only() -> None:
    picture = np.full((20, 30, 3), (250, 240, 230), np.uint8)
    picture[5:15, 8:22] = np.random.default_rng(0).integers(20, 90, (10, 14, 3))
    alpha = np.zeros((20, 30), np.float32)
    alpha[4:16, 7:23] = 0.5
    alpha[5:15, 8:22] = 1
    made = without_background(picture, alpha, 0.9)
    np.testing.assert_array_equal(made[5:15, 8:22], picture[5:15, 8:22])
    assert made.max() < 90


@pytest.mark.parametrize("name", sorted(path.stem for path in (GALLERY / "heads").glob("*.webp")))
def test_a_shipped_head_is_whole_and_its_hair_ends_in_strands(name: str) -> None:
    still = HeadStill.of(name)
    width = np.ptp(still.shape[:, 0])
    face = np.zeros(still.alpha.shape, np.uint8)
    cv2.fillConvexPoly(face, cv2.convexHull(still.shape.astype(np.int32)), 1)
    assert still.alpha[cv2.erode(face, np.ones((9, 9))) > 0].min() > 0.95
    assert max(still.alpha[:3].max(), still.alpha[:, :3].max(), still.alpha[:, -3:].max()) < 0.2
    above = still.alpha[: int(still.shape[:, 1].min())]
    assert ((above > 0.1) & (above < 0.9)).sum() > 0.01 * (above > 0.9).sum()
    assert 0.8 < still.alpha.sum() / width**2 < 3.5


def test_a_head_drawn_smaller_keeps_its_mean_and_loses_what_would_flicker() -> None:
    still = HeadStill.of("p01")
    alpha = still.seen(3.0)[1]
    assert alpha.mean() == pytest.approx(still.alpha.mean(), rel=0.02)
    assert np.abs(np.diff(alpha, axis=1)).max() < 0.6 * np.abs(np.diff(still.alpha, axis=1)).max()
    assert still.seen(0.8)[0] is still.picture


def test_the_neck_takes_the_tone_of_the_head_and_clothes_keep_theirs() -> None:
    mesh = HeadPose(np.eye(3), 120.0, np.array([150.0, 120.0])).apply(SolidPrior.shipped().mean)
    own = np.full((320, 300, 3), (200, 150, 125), np.uint8)
    own[:, :90] = own[:, 210:] = (70, 90, 160)
    head, share = np.full_like(own, (120, 84, 66)), np.zeros((320, 300), np.float32)
    chin = int(mesh[:, 1].max())
    share[: chin + 12] = 1
    made = necked(own, head, share, mesh).astype(int)
    neck = made[:, 150]
    assert np.abs(neck[chin + 13] - (120, 84, 66)).max() < 12  # no seam
    assert np.abs(np.diff(neck[chin + 5 :], axis=0)).max() <= 4
    np.testing.assert_array_equal(made[-5:], own[-5:])
    assert np.abs(made[:, :80] - own[:, :80]).max() <= 3


def test_a_neck_behind_a_collar_stays_as_it_is() -> None:
    mesh = HeadPose(np.eye(3), 120.0, np.array([150.0, 120.0])).apply(SolidPrior.shipped().mean)
    own = np.full((320, 300, 3), (70, 90, 160), np.uint8)
    head, share = np.full_like(own, (120, 84, 66)), np.ones((320, 300), np.float32)
    assert necked(own, head, share, mesh) is own
