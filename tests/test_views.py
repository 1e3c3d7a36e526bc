"""What an enrolment tells of the turns that it showed."""

import numpy as np
import pytest
from drawing import turned_head

from guise.aam.solid_shape import SolidPrior
from guise.aam.views import Views


def test_views_say_what_was_seen_and_what_is_guessed() -> None:
    face = SolidPrior.shipped().mean
    views = Views.of([turned_head(yaw).apply(face) for yaw in np.linspace(-20, 35, 12)])
    assert views.yaw == pytest.approx((-20, 35), abs=2)
    assert views.guessed == (views.yaw[0] - 25, views.yaw[1] + 25)
    assert f"turned {views.yaw[0]} to {views.yaw[1]} degrees" in str(views)
