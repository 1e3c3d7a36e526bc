"""Beyond what a swap can show, a turned head isn't swapped; a nodding or half-turned one is."""

import numpy as np
import pytest
from made_up import SAMPLES
from models import model_file

from guise.aam.model import Identity
from guise.aam.solid_shape import HeadPose, SolidPrior
from guise.aam.tracker import Fit
from guise.aam.views import Views
from guise.app.media import open_input
from guise.app.swapping.engine import Engine
from guise.app.swapping.options import EngineOptions
from guise.common.arrays import F64


def seen(yaw: float) -> F64:
    """The mean face in a picture of 640 x 480, turned by degrees."""
    y = np.radians(yaw)
    rotation = np.array([[np.cos(y), 0, -np.sin(y)], [0, 1, 0], [np.sin(y), 0, np.cos(y)]])
    return HeadPose(rotation, 170.0, np.array([320.0, 240.0])).apply(SolidPrior.shipped().mean)


def outcomes(yaws: list[float], options: EngineOptions, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    person, other = (Identity.load(model_file(name)) for name in ("p01", "p02"))
    found, made = iter(yaws), []
    with (
        open_input(SAMPLES / "p01" / "talk.mp4") as media,
        Engine(person, other, None, options) as engine,
    ):
        fit = lambda luma: Fit(seen(next(found)), np.zeros(1), 0.1, 1.0)  # noqa: E731
        monkeypatch.setattr(engine.tracker, "update", fit)
        for _, frame in zip(yaws, media, strict=False):
            made.append(engine.swap(frame).outcome)
    return made


@pytest.mark.slow
def test_a_profile_is_not_swapped_until_it_turns_back_far_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    turns = [0.0, 40, 73, 79, 84, 73, 73, 60, 20]
    options = EngineOptions(renderer="cpu", hold_frames=1)
    expected = ["swapped"] * 3 + ["held", "lost", "lost", "lost", "swapped", "swapped"]
    assert outcomes(turns, options, monkeypatch) == expected


def test_views_say_what_was_seen_and_what_is_guessed() -> None:
    views = Views.of([seen(yaw) for yaw in np.linspace(-20, 35, 12)])
    assert views.yaw == pytest.approx((-20, 35), abs=2)
    assert views.guessed == (views.yaw[0] - 25, views.yaw[1] + 25)
    assert f"turned {views.yaw[0]} to {views.yaw[1]} degrees" in str(views)
