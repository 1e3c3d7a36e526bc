"""Linear expression transfer: the projector's identities, alpha's ends, the optimum, anchoring, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up import FRAME, appearance
from numpy.testing import assert_allclose

from guise.aam.appearance import SHAPE_ENTRIES, AppearanceModel
from guise.aam.extrapolation import DEFAULT_ALPHA, Extrapolator, ReferenceMismatchError
from guise.aam.landmarks.schemes import RIGHT_EYE, RIGHT_MOUTH_CORNER
from guise.aam.reference import ReferenceFrame

ALPHAS = st.floats(0, 1)
SOURCE, TARGET = appearance(1, modes=5), appearance(2, modes=8)
PLAIN = {"anchored": False, "gate": 1.0}


def some_parameters(seed: int, model: AppearanceModel = SOURCE) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=model.components.modes) * model.components.deviations).astype(np.float32)


def projector(model: AppearanceModel, vector: np.ndarray) -> np.ndarray:
    basis = model.components.basis
    return basis @ (basis.T @ vector)


def test_projector_keeps_its_own_basis_and_is_idempotent() -> None:
    for model in (SOURCE, TARGET):
        basis = model.components.basis
        assert_allclose(projector(model, basis), basis, atol=1e-5)
        other = projector(model, SOURCE.components.mean)
        assert_allclose(projector(model, other), other, rtol=1e-4, atol=1e-3)


def test_projector_of_the_target_removes_nothing_from_the_target() -> None:
    same = Extrapolator(TARGET, TARGET, 0.0, **PLAIN)
    assert_allclose(same.matrix, TARGET.components.basis, rtol=2**-11, atol=1e-5)  # of half floats


def test_alpha_one_is_direct_transfer() -> None:
    rho = some_parameters(3)
    moved = Extrapolator(SOURCE, TARGET, 1.0, **PLAIN).apply(rho) - TARGET.components.mean
    assert_allclose(moved, SOURCE.components.basis @ rho, atol=0.02)  # grey levels, of half floats


def test_alpha_zero_is_projection_onto_the_target() -> None:
    rho = some_parameters(4)
    moved = Extrapolator(SOURCE, TARGET, 0.0, **PLAIN).apply(rho) - TARGET.components.mean
    direct = SOURCE.components.basis @ rho
    assert_allclose(moved, projector(TARGET, direct), atol=1e-3)
    assert np.linalg.norm(moved) < 0.5 * np.linalg.norm(direct)


@given(st.floats(0.02, 1), st.integers(0, 1000))
def test_the_answer_minimises_the_cost_of_theorem_one(alpha: float, seed: int) -> None:
    rng, phi = np.random.default_rng(seed), 1 / alpha - 1
    seen = (SOURCE.components.basis @ some_parameters(seed)).astype(np.float64)
    answer = Extrapolator(SOURCE, TARGET, alpha, **PLAIN).matrix.astype(np.float64) @ some_parameters(seed)

    def cost(y: np.ndarray) -> float:
        outside = y - projector(TARGET, y)
        return float(((y - seen) ** 2).sum() + phi * (outside**2).sum())

    least = cost(answer)
    steps = [rng.normal(size=len(answer)) for _ in range(4)]
    steps += [TARGET.components.basis[:, 0], seen / np.linalg.norm(seen), answer - seen]
    for step in steps:
        size = 0.05 * np.linalg.norm(seen) / max(np.linalg.norm(step), 1e-9)
        if np.linalg.norm(step) > 1e-3:
            assert cost(answer + size * step) > least
            assert cost(answer - size * step) > least


@given(ALPHAS, ALPHAS, st.floats(0, 1), st.booleans())
def test_alpha_changed_live_is_alpha_built_in(
    before: float, after: float, gate: float, anchored: bool
) -> None:
    live = Extrapolator(SOURCE, TARGET, before, anchored=anchored, gate=gate)
    live.alpha = after
    built = Extrapolator(SOURCE, TARGET, after, anchored=anchored, gate=gate)
    assert live.alpha == after
    assert_allclose(live.matrix, built.matrix, atol=1e-7)
    assert_allclose(live.apply(some_parameters(0)), built.apply(some_parameters(0)), atol=1e-3)


@given(ALPHAS)
def test_between_the_ends_the_answer_is_their_blend(alpha: float) -> None:
    rho = some_parameters(5)
    ends = [Extrapolator(SOURCE, TARGET, a).apply(rho) for a in (0.0, 1.0)]
    blend = (1 - alpha) * ends[0] + alpha * ends[1]
    assert_allclose(Extrapolator(SOURCE, TARGET, alpha).apply(rho), blend, atol=2e-3)


@pytest.mark.parametrize("alpha", [0.0, DEFAULT_ALPHA, 1.0])
def test_the_neutral_face_becomes_the_neutral_face(alpha: float) -> None:
    """Texture exactly; the shape is turned, but only as far as the two neutral faces differ in yaw."""
    moved = Extrapolator(SOURCE, TARGET, alpha).apply(SOURCE.neutral_parameters)
    assert_allclose(moved[SHAPE_ENTRIES:], TARGET.neutral[SHAPE_ENTRIES:], atol=1e-4)
    yaw = FRAME.yaw(TARGET.shape_of(moved))
    assert yaw == pytest.approx(FRAME.yaw(SOURCE.neutral_shape), abs=0.5)
    turn = TARGET.shape_of(moved) - TARGET.neutral_shape
    along = FRAME.yaw_mode * (turn * FRAME.yaw_mode).sum() / (FRAME.yaw_mode**2).sum()
    assert_allclose(turn, along, atol=1e-3)


def test_unanchored_means_map_to_means() -> None:
    moved = Extrapolator(SOURCE, TARGET, 0.6, anchored=False).apply(np.zeros(5, np.float32))
    assert_allclose(moved, TARGET.components.mean)
    assert not np.allclose(moved, Extrapolator(SOURCE, TARGET, 0.6).apply(np.zeros(5, np.float32)), atol=1)


def test_the_gate_holds_back_texture_away_from_eyes_and_mouth_only() -> None:
    rho = some_parameters(6)
    open_, closed = (Extrapolator(SOURCE, TARGET, 1.0, gate=g).apply(rho) for g in (1.0, 0.0))
    assert_allclose(closed[:SHAPE_ENTRIES], open_[:SHAPE_ENTRIES], atol=1e-3)
    held = FRAME.scatter(np.abs(open_ - closed)[SHAPE_ENTRIES:].reshape(-1, 3).mean(1))
    eye, cheek = (
        FRAME.points[RIGHT_EYE].mean(0),
        (FRAME.points[RIGHT_EYE].mean(0) + FRAME.points[RIGHT_MOUTH_CORNER]) / 2,
    )
    at_eye, on_cheek = (held[round(y), round(x)] for x, y in (eye, cheek))
    assert on_cheek > 10 * max(at_eye, 1e-3)


def test_of_texture_that_does_not_move_nothing_is_shown_and_shapes_stay() -> None:
    rho = some_parameters(6)
    moving = np.ones(FRAME.size, np.float32)
    moving[: FRAME.size[0] // 2] = 0
    still = np.repeat(moving[FRAME.mask] == 0, 3)
    for limit in (None, 0.1):
        made, usual = (
            Extrapolator(SOURCE, TARGET, 0.5, max_deviations=limit, moving=shown).apply(rho)
            for shown in (moving, None)
        )
        assert_allclose(made[SHAPE_ENTRIES:][still], TARGET.neutral[SHAPE_ENTRIES:][still], atol=1e-3)
        assert_allclose(made[SHAPE_ENTRIES:][~still], usual[SHAPE_ENTRIES:][~still], atol=1e-3)
        assert_allclose(made[:SHAPE_ENTRIES], usual[:SHAPE_ENTRIES], atol=1e-3)


def test_the_movement_of_a_fair_face_is_scaled_to_the_tone_of_a_dark_one() -> None:
    rho, tone = some_parameters(5), np.float32([0.5, 0.4, 0.3])
    moved = Extrapolator(SOURCE, TARGET, 1.0, tone=tone, **PLAIN).apply(rho) - TARGET.components.mean
    direct = SOURCE.components.basis @ rho
    assert_allclose(moved[:SHAPE_ENTRIES], direct[:SHAPE_ENTRIES], atol=1e-3)
    texture = direct[SHAPE_ENTRIES:].reshape(-1, 3) * tone
    assert_allclose(moved[SHAPE_ENTRIES:].reshape(-1, 3), texture, atol=1e-3)
    assert_allclose(SOURCE.components.basis @ rho, direct)


def test_a_model_transfers_to_itself_unchanged() -> None:
    rho = some_parameters(7)
    moved = Extrapolator(SOURCE, SOURCE, 0.3).apply(rho)
    assert_allclose(moved, SOURCE.components.synthesise(rho), rtol=1e-4, atol=2e-2)


def test_what_the_target_never_showed_is_held_at_a_limit() -> None:
    free = Extrapolator(SOURCE, TARGET, gate=1.0)
    limited = Extrapolator(SOURCE, TARGET, gate=1.0, max_deviations=4.0)
    rest, some = SOURCE.neutral_parameters, some_parameters(3) - SOURCE.neutral_parameters
    basis, most = TARGET.components.basis, 4.0 * TARGET.components.deviations
    far = limited.apply(rest + 1000 * some) - limited.apply(rest)
    assert (np.abs(basis.T @ far) <= 1.01 * most).all()
    assert (np.abs(basis.T @ (free.apply(rest + 1000 * some) - free.apply(rest))) > most).any()
    assert_allclose(limited.apply(rest + 1e-3 * some), free.apply(rest + 1e-3 * some), atol=1e-4)


@pytest.mark.parametrize("alpha", [-0.01, 1.01, float("nan")])
def test_alpha_outside_its_range_is_refused(alpha: float) -> None:
    with pytest.raises(ValueError, match=r"alpha must be in \[0, 1\], got"):
        Extrapolator(SOURCE, TARGET, alpha)


def test_models_of_different_reference_frames_are_refused() -> None:
    other = appearance(3, reference=ReferenceFrame.canonical(40))
    with pytest.raises(ReferenceMismatchError) as caught:
        Extrapolator(SOURCE, other)
    assert str(caught.value) == (
        "the two models have different reference frames (32 and 40 pixels across the face); "
        "enroll both with the same --resolution"
    )
