"""A person in whose place a face is drawn, on the grid of that face."""

import numpy as np
import pytest
from models import model_file

from guise.aam.model import Identity
from guise.app.drawing.person import TrackedPerson


@pytest.mark.parametrize("resolution", [64, 48])
def test_a_person_is_known_on_the_grid_of_the_face(resolution: int) -> None:
    identity = Identity.load(model_file("p01"))
    person = TrackedPerson.of(identity, resolution)
    reference = person.identity.reference
    assert reference.resolution == resolution
    assert person.mask.shape == reference.size
    assert person.texture.shape == (len(reference.pixels), 3)
    assert person.texels.max() < len(reference.pixels)
    assert np.ptp(person.at_rest[:, 0]) == pytest.approx(np.ptp(reference.points[:, 0]), rel=0.15)
    assert person.estimator(person.at_rest, person.texture[person.texels]).shape == (
        len(person.identity.appearance.neutral_parameters),
    )


def test_at_rest_a_persons_parameters_are_the_neutral_ones() -> None:
    person = TrackedPerson.of(Identity.load(model_file("p01")), 64)
    found = person.estimator(person.at_rest, person.texture[person.texels])
    neutral, spread = (
        person.identity.appearance.neutral_parameters,
        person.identity.appearance.components.deviations,
    )
    away = np.abs((found - neutral) / spread)
    assert away[:5].max() < 0.1  # modes that are well seen at the texels
    assert away.max() < 1
