"""The five looks, and what each of them settles."""

from dataclasses import FrozenInstanceError, replace
from typing import get_args

import numpy as np
import pytest
from models import model_file

from guise.aam.extrapolation import DEFAULT_ALPHA, Extrapolator
from guise.aam.model import Identity
from guise.app.drawing.donor import Donor
from guise.app.drawing.look import DISGUISE, LIVE, LOOKS, PAPER, PUPPET, SWAP, Kind
from guise.app.drawing.plan import Plan


def test_there_is_one_look_of_each_kind() -> None:
    assert list(LOOKS) == list(get_args(Kind))
    assert list(LOOKS.values()) == [SWAP, LIVE, DISGUISE, PUPPET, PAPER]
    assert all(look.kind == kind for kind, look in LOOKS.items())


def test_a_look_does_not_change() -> None:
    with pytest.raises(FrozenInstanceError):
        SWAP.alpha = 0.0  # type: ignore[misc]


def test_only_a_swap_and_the_papers_formulas_show_the_sources_eyes() -> None:
    assert [look.kind for look in LOOKS.values() if look.eyes == "source"] == ["swap", "paper"]
    assert (DISGUISE.eyes, DISGUISE.mouth) == ("painted", "source")


def test_only_a_swap_keeps_glasses_in_front_and_a_live_face_no_hair_either() -> None:
    assert (SWAP.in_front, LIVE.in_front, DISGUISE.in_front) == ("all", "objects", "hair")


@pytest.mark.parametrize("exact", [False, True])
def test_the_papers_formula_is_neither_anchored_nor_gated_if_it_is_exact(exact: bool) -> None:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    plan = Plan.of(person, Donor.of(other), replace(PAPER, renderer="cpu", exact=exact))
    plain = Extrapolator(person.appearance, other.appearance, DEFAULT_ALPHA, anchored=False, gate=1.0)
    rest = person.appearance.neutral_parameters
    expression = rest + np.random.default_rng(0).normal(0, 20, len(rest)).astype(np.float32)
    made, at_rest = (plan.texture.extrapolator.apply(parameters) for parameters in (expression, rest))
    assert np.allclose(made, plain.apply(expression), atol=1e-3) == exact
    assert np.allclose(at_rest, plain.apply(rest), atol=1e-3) == exact
    plan.blend.close()
