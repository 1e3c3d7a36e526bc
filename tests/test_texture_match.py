"""A texture matches where it can be seen, whatever hides the rest."""

import numpy as np
import pytest

from guise.aam.appearance import Components, principal_components
from guise.aam.reference import ReferenceFrame
from guise.aam.texture_match import TextureMatcher, normalised, residual
from guise.common.arrays import F32, Bool

NOISE = 0.1
REFERENCE = ReferenceFrame.canonical(32)
PLACES = len(REFERENCE.pixels)


@pytest.fixture(scope="module")
def own() -> F32:
    """A person's textures (m, n): smooth fields, three of which vary, and a little noise."""
    rng = np.random.default_rng(0)
    ys, xs = np.divmod(REFERENCE.pixels, REFERENCE.size[1])
    fields = np.stack([np.sin(xs / 3), np.cos(ys / 4), np.sin((xs + ys) / 5), np.cos((xs - ys) / 6)])
    weights = np.column_stack([2 + 0 * rng.normal(size=80), rng.normal(size=(80, 3))])
    return np.stack([normalised(np.float32(w @ fields)) for w in weights]) + np.float32(
        NOISE * rng.normal(size=(80, PLACES))
    )


@pytest.fixture(scope="module")
def components(own: F32) -> Components:
    return principal_components(own[:60], 0.95)


@pytest.fixture(scope="module")
def matcher(components: Components) -> TextureMatcher:
    return TextureMatcher(components, np.arange(PLACES), REFERENCE, NOISE)


@pytest.fixture(scope="module")
def lower() -> Bool:
    """The lower half of the face."""
    return REFERENCE.pixels > np.median(REFERENCE.pixels)


def test_what_is_hidden_changes_nothing(matcher: TextureMatcher, own: F32, lower: Bool) -> None:
    seen = own[-1].copy()
    before = matcher.match(seen, lower)
    seen[lower] = 100
    assert matcher.match(seen, lower) == before


def test_the_visible_part_of_the_person_matches_as_the_whole_does(
    matcher: TextureMatcher, own: F32, lower: Bool, components: Components
) -> None:
    whole = matcher.match(own[-1])
    part = matcher.match(3 * own[-1] + 50, lower)
    assert whole.residual == pytest.approx(residual(own[-1], components.mean, components.basis.T), rel=1e-3)
    assert part.residual < 1.3 * whole.residual
    assert whole.foreign_share == part.foreign_share == 0


def test_something_else_does_not_match_in_whole_or_in_part(matcher: TextureMatcher, lower: Bool) -> None:
    other = np.float32(np.random.default_rng(1).normal(size=PLACES))
    assert matcher.match(other).residual > 0.8
    assert matcher.match(other, lower).residual > 0.6


def test_nothing_visible_is_no_match(matcher: TextureMatcher, own: F32) -> None:
    nothing = matcher.match(own[0], np.ones(PLACES, bool))
    assert nothing.residual == float("inf")
    assert nothing.foreign_share == 1
