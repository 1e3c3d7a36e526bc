"""The engine: what becomes of a frame, a first one, one without the person, one in which they are turned away."""

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction

import cv2
import numpy as np
import pytest
from drawing import turned_head
from made_up import SAMPLES
from models import model_file

from guise.aam.model import Identity
from guise.aam.similarity import Failed
from guise.aam.solid_shape import SolidPrior
from guise.aam.tracker import Fit
from guise.app.drawing.donor import Donor
from guise.app.drawing.engine import DOUBT_DEGREES, Engine
from guise.app.drawing.face import NOTHING, STRAIGHT_AHEAD, FaceInFrame
from guise.app.drawing.look import DISGUISE, LIVE, PAPER, SWAP, Look
from guise.app.drawing.memory import Drawn, Memory
from guise.app.drawing.passes.surface import gradient_energy, grain_energy
from guise.app.media import Frame, open_input
from guise.common.arrays import F64, U8

CLIP = SAMPLES / "p01" / "talk2.mp4"
CPU = replace(SWAP, renderer="cpu")
NOBODY = Failed("nobody")


@pytest.fixture(scope="module")
def p01() -> Identity:
    return Identity.load(model_file("p01"))


@pytest.fixture(scope="module")
def p02() -> Identity:
    return Identity.load(model_file("p02"))


@pytest.fixture(scope="module")
def clip() -> list[U8]:
    """Some frames of somebody, RGB."""
    with open_input(CLIP) as media:
        return [frame.rgb() for frame, _ in zip(media, range(12), strict=False)]


@pytest.fixture(scope="module")
def truth() -> F64:
    """Where the face is in each, (t, 81, 2)."""
    return np.load(CLIP.with_suffix(".npz"))["landmarks"].astype(np.float64)


def frame_of(rgb: U8, number: int = 0, rate: int = 30) -> Frame:
    return Frame.from_rgb(rgb, number, Fraction(1, rate), number)


def fit_of(shape: F64) -> Fit:
    return Fit(shape, np.zeros(1), 0.1, 1.0)


def outcomes(yaws: list[float], look: Look, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    found, made, face = iter(yaws), [], SolidPrior.shipped().mean
    with (
        open_input(SAMPLES / "p01" / "talk.mp4") as media,
        Engine(person, Donor.of(other), None, look) as engine,
    ):
        fit = lambda luma: fit_of(turned_head(next(found)).apply(face))  # noqa: E731
        monkeypatch.setattr(engine.tracker, "update", fit)
        for _, frame in zip(yaws, media, strict=False):
            made.append(engine.swap(frame).outcome)
    return made


def test_a_profile_is_not_swapped_until_it_turns_back_far_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    turns = [0.0, 40, 73, 79, 84, 73, 73, 60, 20]
    look = replace(CPU, hold_seconds=1 / 30)
    expected = ["swapped"] * 3 + ["held", "lost", "lost", "lost", "swapped", "swapped"]
    assert outcomes(turns, look, monkeypatch) == expected


def test_by_the_papers_formulas_a_profile_is_nothing_special(monkeypatch: pytest.MonkeyPatch) -> None:
    assert outcomes([0.0, 80, 80], replace(PAPER, renderer="cpu"), monkeypatch) == ["swapped"] * 3


def test_doubt_grows_as_a_head_turns_away(p01: Identity, p02: Identity, clip: list[U8]) -> None:
    face, doubts = SolidPrior.shipped().mean, []
    for yaw in (0.0, 50.0, sum(DOUBT_DEGREES) / 2, 70.5):
        with Engine(p01, Donor.of(p02), None, CPU) as engine:
            doubts.append(engine.swap_tracked(frame_of(clip[0]), fit_of(turned_head(yaw).apply(face))).doubt)
    assert doubts[:2] == [0, 0]
    assert 0 < doubts[2] < doubts[3] <= 1


def test_the_first_frame_of_a_face_is_drawn_once_after_a_rehearsal_on_a_copy(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64
) -> None:
    drawn: list[Frame] = []
    with Engine(p01, Donor.of(p02), None, CPU) as engine:
        note: Callable[[FaceInFrame, Memory], None] = lambda face, memory: drawn.append(face.frame)  # noqa: E731
        engine.plan = replace(engine.plan, drawing=(note, *engine.plan.drawing))
        frames = [frame_of(clip[number], number) for number in range(3)]
        engine.swap_tracked(frames[0], fit_of(truth[0]))
        engine.swap_tracked(frames[1], fit_of(truth[1]))
        engine.swap_tracked(frames[2], NOBODY)
    assert [frame is frames[0] for frame in drawn[:2]] == [False, True]
    assert [frame is own for frame, own in zip(drawn[2:], frames[1:], strict=True)] == [True, True]


@pytest.mark.parametrize("blurred", [True, False], ids=["a soft picture", "a grainy picture"])
def test_the_first_frame_is_about_as_sharp_and_grainy_as_the_picture(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64, blurred: bool
) -> None:
    soft = cv2.GaussianBlur(clip[0], (0, 0), 9.0)
    grainy = cv2.GaussianBlur(clip[0], (0, 0), 1.0) + np.random.default_rng(0).normal(
        0, 4, (*clip[0].shape[:2], 1)
    )
    shown = np.clip(soft if blurred else grainy, 0, 255).astype(np.uint8)
    made = []
    for rehearsed in (True, False):
        with Engine(p01, Donor.of(p02), None, CPU) as engine:
            if not rehearsed:
                engine.memory.drawn = Drawn(0.0, truth[0], STRAIGHT_AHEAD, truth[0], NOTHING)
            frame = frame_of(shown)
            engine.draw(frame, truth[0])
            low, high = truth[0].min(0), truth[0].max(0)
            inner = frame.align_roi(*(low + (high - low) / 4), *(high - (high - low) / 4))
            energy = (gradient_energy if blurred else grain_energy)(frame.read_yuv(*inner))
            made.append(np.median(energy))
    first, plain = made
    assert first < 0.85 * plain if blurred else first > 2 * plain


@pytest.mark.parametrize("look", [SWAP, LIVE, DISGUISE, PAPER], ids=lambda look: look.kind)
def test_with_a_fresh_memory_an_engine_draws_as_a_new_one(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64, look: Look
) -> None:
    """All that lasts is in the memory: no pass keeps anything."""
    pictures = []
    for used in (True, False):
        with Engine(p01, Donor.of(p02), None, replace(look, renderer="cpu")) as engine:
            for number in range(6):
                if used:
                    engine.draw(frame_of(clip[number] // 2, number), truth[number])
                else:
                    engine.solid.update(
                        truth[number]
                    )  # which is learnt of the person, not of a face's frames
            engine.reset()
            made = [frame_of(clip[number], number) for number in (6, 7, 8)]
            for frame, shape in zip(made, truth[6:9], strict=True):
                engine.draw(frame, shape)
            pictures.append([frame.rgb() for frame in made])
    for one, other in zip(*pictures, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("rate", [25, 30, 60])
def test_a_lost_face_is_held_for_as_long_at_any_frame_rate(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64, rate: int
) -> None:
    with Engine(p01, Donor.of(p02), None, CPU) as engine:
        engine.swap_tracked(frame_of(clip[0], 0, rate), fit_of(truth[0]))
        made = [engine.swap_tracked(frame_of(clip[0], n, rate), NOBODY).outcome for n in range(1, rate // 2)]
    held = made.count("held")
    assert made == ["held"] * held + ["lost"] * (len(made) - held)
    assert held / rate <= CPU.hold_seconds + 1e-3 < (held + 1) / rate


def test_a_held_face_is_drawn_where_it_was_and_nothing_is_measured(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64
) -> None:
    """The frame shows somebody else there, or nobody."""
    with Engine(p01, Donor.of(p02), None, CPU) as engine:
        for number in range(6):
            before = engine.swap_tracked(frame_of(clip[number], number), fit_of(truth[number]))
        memory = engine.memory
        light, surface = memory.light, replace(memory.surface)
        noise = np.random.default_rng(0).integers(0, 256, clip[0].shape, np.uint8)
        for number in (6, 7):
            frame = frame_of(noise, number)
            result = engine.swap_tracked(frame, NOBODY)
            assert (result.outcome, result.fit) == ("held", NOBODY)
            assert before.mesh is not None
            np.testing.assert_array_equal(result.mesh, before.mesh)
            x, y = np.round(truth[5].mean(0)).astype(int)
            assert (
                frame.rgb()[y - 5 : y + 6, x - 5 : x + 6] != noise[y - 5 : y + 6, x - 5 : x + 6]
            ).mean() > 0.8
        assert memory.light is light
        for name in ("gain", "own_share", "variance", "began", "sharpness_seen", "grain_seen"):
            assert getattr(memory.surface, name) == getattr(surface, name)


def test_a_lost_frame_stays_as_it_is_and_the_next_face_is_a_new_one(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64
) -> None:
    with Engine(p01, Donor.of(p02), None, replace(CPU, hold_seconds=0.0)) as engine:
        engine.swap_tracked(frame_of(clip[0], 0), fit_of(truth[0]))
        memory, frame = engine.memory, frame_of(clip[1], 1)
        result = engine.swap_tracked(frame, NOBODY)
        assert (result.outcome, result.mesh) == ("lost", None)
        np.testing.assert_array_equal(frame.rgb(), clip[1])
        assert engine.memory is not memory
        assert engine.memory.drawn is None


def test_alpha_takes_effect(p01: Identity, p02: Identity, clip: list[U8], truth: F64) -> None:
    made = []
    for alpha in (0.0, 1.0):
        with Engine(p01, Donor.of(p02), None, CPU) as engine:
            engine.alpha = alpha
            assert engine.alpha == alpha
            frame = frame_of(clip[5])
            engine.draw(frame, truth[5])
            made.append(frame.rgb())
    assert (made[0] != made[1]).any()


def test_a_face_outside_the_picture_leaves_it_as_it_is(
    p01: Identity, p02: Identity, clip: list[U8], truth: F64
) -> None:
    with Engine(p01, Donor.of(p02), None, CPU) as engine:
        frame = frame_of(clip[0])
        engine.draw(frame, truth[0] + 5000)
        np.testing.assert_array_equal(frame.rgb(), clip[0])
