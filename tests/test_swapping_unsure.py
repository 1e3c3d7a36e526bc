"""A face that is lost but may be visible is covered: where it is detected, and for a while where it was."""

import numpy as np
import pytest

from guise.aam.landmarks.schemes import IBUG68, mean_geometry
from guise.app.media import Frame
from guise.app.swapping.unsure import LIMITS, LostFaceCover
from guise.common.arrays import F32, U8

FACE = mean_geometry().mean
MESH = np.column_stack([80 + 14 * FACE.real, 70 + 14 * FACE.imag])


class Detector:
    """Finds what it is told to find, upright: in pictures with a white corner."""

    def __init__(self) -> None:
        self.found: list[tuple[float, float, float, float, float]] = []

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        is_upright = image.shape[:2] == (160, 200) and image[:8, :8].min() > 200
        rows = np.array(self.found if is_upright else [], np.float32).reshape(-1, 5)
        return rows[:, :4], rows[:, 4]


@pytest.fixture
def detector() -> Detector:
    return Detector()


def noise() -> Frame:
    rgb = np.random.default_rng(0).integers(0, 255, (160, 200, 3), dtype=np.uint8)
    rgb[:10, :10] = 255
    return Frame.from_rgb(rgb)


def changed(cover: LostFaceCover) -> np.ndarray | None:
    """Where a frame of noise is changed (h, w), or None when nothing is covered."""
    frame = noise()
    before = frame.rgb()
    covered = cover.cover(frame)
    where = (frame.rgb() != before).any(2)
    assert where.any() == covered
    return where if covered else None


def test_before_anybody_was_seen_only_a_clear_face_is_covered(detector: Detector) -> None:
    cover = LostFaceCover(detector)
    assert changed(cover) is None
    detector.found = [(20, 20, 60, 60, 0.3)]
    assert changed(cover) is None
    detector.found = [(20, 20, 60, 60, 0.3), (120, 80, 160, 120, 0.9)]
    where = changed(cover)
    assert where is not None
    assert where[85:115, 125:155].mean() > 0.9
    assert not where[20:60, 20:60].any()


def test_a_faint_face_where_the_person_was_is_covered_and_others_are_not(detector: Detector) -> None:
    cover = LostFaceCover(detector)
    cover.seen(MESH)
    detector.found = [(62, 52, 96, 90, 0.2), (150, 100, 190, 140, 0.99)]
    where = changed(cover)
    assert where is not None
    assert where[55:88, 65:94].mean() > 0.9
    assert not where[110:140, 160:190].any()


def test_what_nobody_detects_stays_covered_for_a_while_and_is_then_left(detector: Detector) -> None:
    cover = LostFaceCover(detector)
    cover.seen(MESH)
    areas = [changed(cover) for _ in range(LIMITS.blind_frames + 3)]
    assert all(area is not None for area in areas[: LIMITS.blind_frames])
    assert areas[-1] is None
    sums = [area.sum() for area in areas[: LIMITS.blind_frames] if area is not None]
    assert sums[-1] > sums[0]


def test_the_cover_follows_the_face(detector: Detector) -> None:
    cover = LostFaceCover(detector)
    cover.seen(MESH)
    for shift in (10, 20, 30, 40):
        detector.found = [(60 + shift, 50, 95 + shift, 85, 0.4)]
        where = changed(cover)
        assert where is not None
        assert where[55:80, 65 + shift : 90 + shift].mean() > 0.9


def test_the_cover_of_an_upside_down_face_reaches_over_its_forehead(detector: Detector) -> None:
    areas = []
    for mesh in (MESH, 160 - MESH):
        cover = LostFaceCover(detector)
        cover.seen(mesh)
        where = changed(cover)
        assert where is not None
        inner = mesh[IBUG68]
        rows = np.flatnonzero(where.any(1))
        areas.append((inner[:, 1].min() - rows.min(), rows.max() - inner[:, 1].max()))
    (above, below), (under, over) = areas
    assert above > below + 4
    assert over > under + 4


def test_a_cover_comes_in_over_a_face_that_turns_away(detector: Detector) -> None:
    cover, changes = LostFaceCover(detector), []
    cover.seen(MESH)
    for share in (0.0, 0.3, 0.7, 1.0):
        frame = noise()
        before = frame.rgb().astype(int)
        cover.fade(frame, share)
        changes.append(np.abs(frame.rgb() - before).mean())
    assert changes[0] == 0
    assert (np.diff(changes) > 0.1 * changes[-1]).all()
