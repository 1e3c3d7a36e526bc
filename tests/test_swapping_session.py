"""One session: faces are drawn, a lost one is covered where it is or was, covers lie on top."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from guise.aam.landmarks.glances import Glancer
from guise.aam.landmarks.rolls import RolledBoxes
from guise.aam.landmarks.schemes import IBUG68, mean_geometry
from guise.aam.similarity import Failed
from guise.aam.tracker import Fit
from guise.app.drawing.engine import SwapResult
from guise.app.media import Frame
from guise.app.swapping.policy import COVERED, LEFT, LIMITS, SWAPPED, FaceTreatment
from guise.app.swapping.session import SwapSession
from guise.common.arrays import F32, U8, Bool

FACE = mean_geometry().mean
MESH = np.column_stack([80 + 14 * FACE.real, 70 + 14 * FACE.imag])
LOST = Failed("hidden")
FPS = 30


def fit(mesh: np.ndarray = MESH) -> Fit:
    return Fit(mesh, np.zeros(0), 0.0, 1.0)


class Detector:
    """Finds what it is told to find, upright: in pictures with a white corner."""

    def __init__(self) -> None:
        self.found: list[tuple[float, float, float, float, float]] = []

    def detect_scored(self, image: U8) -> tuple[F32, F32]:
        is_upright = image.shape[:2] == (160, 200) and image[:8, :8].min() > 200
        rows = np.array(self.found if is_upright else [], np.float32).reshape(-1, 5)
        return rows[:, :4], rows[:, 4]


class Engine:
    """Draws nothing, or a black square about the face's middle, and notes what it is told."""

    def __init__(self, *, square: int = 0) -> None:
        self.painter, self.square, self.doubt = self, square, 0.0
        self.renderer, self.absent, self.closed = "cpu", 0, False

    def swap_tracked(self, frame: Frame, fit: Fit | Failed) -> SwapResult:
        if not isinstance(fit, Fit):
            self.absent += 1
            return SwapResult("lost", fit)
        if self.square:
            x, y = fit.shape.mean(0).astype(int) - self.square // 2
            frame.write_roi(int(x), int(y), np.zeros((self.square, self.square, 3), np.uint8))
        return SwapResult("swapped", fit, fit.shape, self.doubt)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def detector() -> Detector:
    return Detector()


def noise(number: int = 0) -> Frame:
    rgb = np.random.default_rng(0).integers(0, 255, (160, 200, 3), dtype=np.uint8)
    rgb[:10, :10] = 255
    return Frame.from_rgb(rgb, number, Fraction(1, FPS), number)


class Follower:
    """A session that follows one person, frame by frame."""

    def __init__(self, detector: Detector, engine: Engine | None = None) -> None:
        self.session = SwapSession(lambda _: engine or Engine(), "mosaic", detector)  # type: ignore[arg-type,return-value]
        self.count = 0

    def seen(self, mesh: np.ndarray) -> None:
        assert self.session.follow(noise(self.count), 1, fit(mesh)).outcome == "swapped"
        self.count += 1

    def changed(self) -> Bool | None:
        """Where the next frame of noise, in which the person is lost, is changed (h, w), or None."""
        frame = noise(self.count)
        self.count += 1
        before = frame.rgb()
        row = self.session.follow(frame, 1, LOST)
        where = (frame.rgb() != before).any(2)
        assert row.mesh is None
        assert where.any() == (row.outcome == "covered")
        return where if row.outcome == "covered" else None


def test_before_anybody_was_seen_only_a_clear_face_is_covered(detector: Detector) -> None:
    cover = Follower(detector)
    assert cover.changed() is None
    detector.found = [(20, 20, 60, 60, 0.3)]
    assert cover.changed() is None
    detector.found = [(20, 20, 60, 60, 0.3), (120, 80, 160, 120, 0.9)]
    where = cover.changed()
    assert where is not None
    assert where[85:115, 125:155].mean() > 0.9
    assert not where[20:60, 20:60].any()


def test_a_faint_face_where_the_person_was_is_covered_and_others_are_not(detector: Detector) -> None:
    cover = Follower(detector)
    cover.seen(MESH)
    detector.found = [(62, 52, 96, 90, 0.2), (150, 100, 190, 140, 0.99)]
    where = cover.changed()
    assert where is not None
    assert where[55:88, 65:94].mean() > 0.9
    assert not where[110:140, 160:190].any()


def test_what_nobody_detects_stays_covered_for_a_while_and_is_then_left(detector: Detector) -> None:
    cover = Follower(detector)
    cover.seen(MESH)
    most = round(LIMITS.unseen_seconds * FPS)
    areas = [cover.changed() for _ in range(most + 3)]
    assert all(area is not None for area in areas[:most])
    assert areas[most:] == [None] * 3
    sums = [area.sum() for area in areas[:most] if area is not None]
    assert sums[-1] > sums[0]


def test_a_lost_face_is_seen_at_a_glance_where_no_detector_finds_it(
    detector: Detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    box, score, turn = (np.array(v, np.float32) for v in ([[75, 60, 105, 95]], [0.6], [0]))
    seen = RolledBoxes(box, score, turn)
    monkeypatch.setattr(Glancer, "likely", lambda self, judge, image, number: seen)
    cover = Follower(detector)
    cover.seen(MESH)
    for _ in range(round(LIMITS.unseen_seconds * FPS) + 3):  # what nobody sees is left by then
        where = cover.changed()
    assert where is not None
    assert where[62:93, 78:102].mean() > 0.9


def test_the_cover_follows_the_face(detector: Detector) -> None:
    cover = Follower(detector)
    cover.seen(MESH)
    for shift in (10, 20, 30, 40):
        detector.found = [(60 + shift, 50, 95 + shift, 85, 0.4)]
        where = cover.changed()
        assert where is not None
        assert where[55:80, 65 + shift : 90 + shift].mean() > 0.9


def test_the_cover_of_an_upside_down_face_reaches_over_its_forehead(detector: Detector) -> None:
    areas = []
    for mesh in (MESH, 160 - MESH):
        cover = Follower(detector)
        cover.seen(mesh)
        where = cover.changed()
        assert where is not None
        inner = mesh[IBUG68]
        rows = np.flatnonzero(where.any(1))
        areas.append((inner[:, 1].min() - rows.min(), rows.max() - inner[:, 1].max()))
    (above, below), (under, over) = areas
    assert above > below + 4
    assert over > under + 4


def test_a_cover_comes_in_over_a_face_that_turns_away(detector: Detector) -> None:
    engine = Engine()
    session, changes = SwapSession(lambda _: engine, "mosaic", detector), []  # type: ignore[arg-type,return-value]
    for engine.doubt in (0.0, 0.3, 0.7, 1.0):
        frame = noise()
        before = frame.rgb().astype(int)
        session.follow(frame, 1, fit())
        changes.append(np.abs(frame.rgb() - before).mean())
    assert changes[0] == 0
    assert (np.diff(changes) > 0.1 * changes[-1]).all()


def test_without_covers_a_lost_face_stays_as_it_is(detector: Detector) -> None:
    detector.found = [(60, 50, 95, 85, 0.99)]
    session = SwapSession(lambda _: Engine(), None, detector)  # type: ignore[arg-type,return-value]
    for given in (fit(), LOST):
        frame = noise()
        outcome = session.follow(frame, 1, given).outcome
        np.testing.assert_array_equal(frame.rgb(), noise().rgb())
    assert outcome == "lost"


def treatment(who: int, done: int, x: float = 60, size: float = 35) -> FaceTreatment:
    return FaceTreatment(who, done, np.array([x, 50, x + size, 50 + size], np.float32), 1.0)


def test_each_face_is_drawn_covered_or_left_as_planned_and_covers_lie_on_top() -> None:
    engines = {1: Engine(square=30), 2: Engine(square=30)}
    plan = [
        treatment(1, SWAPPED),
        treatment(0, COVERED, 75),
        treatment(3, LEFT, 150),
        treatment(2, SWAPPED, 20, 10),
    ]
    frame, drawn = noise(), []
    with SwapSession(engines.__getitem__, "solid") as session:  # type: ignore[arg-type]
        rows = session.treat(frame, plan, {1: fit(), 2: fit(MESH - 40)}, lambda _, row: drawn.append(row.who))
    assert [(row.who, row.outcome) for row in rows] == [
        (2, "swapped"), (1, "swapped"), (0, "covered"), (3, "left")
    ]  # fmt: skip
    assert drawn == [2, 1]  # the smaller one first
    assert np.ptp(frame.rgb()[55:80, 80:105].reshape(-1, 3), axis=0).max() == 0  # nothing drawn shows through
    np.testing.assert_array_equal(frame.rgb()[:, 150:], noise().rgb()[:, 150:])
    assert all(engine.closed for engine in engines.values())


def test_a_face_that_cannot_be_swapped_is_covered_and_who_is_absent_is_forgotten() -> None:
    engine = Engine()
    session = SwapSession(lambda _: engine, "solid")  # type: ignore[arg-type,return-value]
    session.treat(noise(), [treatment(1, SWAPPED)], {1: fit()})
    frame = noise()
    [row] = session.treat(frame, [treatment(1, SWAPPED)], {1: LOST})
    assert (row.outcome, row.mesh) == ("covered", None)
    assert np.ptp(frame.rgb()[55:80, 65:90].reshape(-1, 3), axis=0).max() == 0
    session.treat(noise(), [], {})
    assert engine.absent == 2


def test_who_may_be_left_is_never_covered() -> None:
    engine = Engine()
    session = SwapSession(lambda _: engine, "solid")  # type: ignore[arg-type,return-value]
    one = replace(treatment(1, SWAPPED), otherwise=LEFT)
    engine.doubt = 1.0
    for given, outcome in ((fit(), "swapped"), (LOST, "left")):
        frame = noise()
        assert [row.outcome for row in session.treat(frame, [one], {1: given})] == [outcome]
        np.testing.assert_array_equal(frame.rgb(), noise().rgb())
