"""Keys and settings."""

import pytest

from guise.app.live.controls import KEYS, Controls
from guise.app.live.options import LiveSettings


@pytest.mark.parametrize(
    ("key", "name"),
    [("m", "mirror"), ("b", "side_by_side"), ("k", "mask"), ("l", "mesh"), ("f", "readout"), ("h", "help")],
)
def test_a_switch_turns_on_and_off(key: str, name: str) -> None:
    controls = Controls()
    controls.press(key)
    assert getattr(controls.settings, name) is True
    controls.press(key)
    assert controls.settings == LiveSettings()


def test_alpha_stays_in_its_range() -> None:
    controls = Controls()
    for _ in range(20):
        controls.press("up")
    assert controls.settings.alpha == 1
    for _ in range(20):
        controls.press("down")
    assert controls.settings.alpha == 0


def test_a_number_chooses_a_face_that_is_there() -> None:
    controls = Controls(3)
    controls.press("3")
    assert controls.settings.identity == 2
    controls.press("4")
    controls.press("0")
    assert controls.settings.identity == 2


def test_a_face_that_may_be_ones_own_is_shown_when_its_key_is_pressed_again() -> None:
    controls = Controls(3, asks=[0])
    assert controls.is_asking, "also at the start"
    for key, asking in (("2", False), ("1", True), ("3", False), ("1", True), ("1", False)):
        controls.press(key)
        assert controls.is_asking == asking, key
    controls.press("2")
    controls.ask_for([1])
    assert controls.is_asking, "what was pressed before the question is no answer"


def test_modes_and_requests() -> None:
    controls = Controls()
    for key, mode in (("p", "puppet"), ("o", "off"), ("s", "swap")):
        controls.press(key)
        assert controls.settings.mode == mode
    for key in ("r", "c", "e", "q", "escape"):
        controls.press(key)
    assert [controls.requests.get() for _ in range(5)] == ["record", "snapshot", "enrol", "quit", "quit"]


def test_a_key_that_means_nothing_changes_nothing() -> None:
    controls = Controls()
    for key in ("x", "", "f12", "0"):
        controls.press(key)
    assert controls.settings == LiveSettings()
    assert controls.requests.empty()


def test_every_listed_key_does_something() -> None:
    for key in KEYS:
        if len(key) == 1:
            controls = Controls(settings=LiveSettings(mode="puppet" if key in "so" else "swap"))
            before = controls.settings
            controls.press(key)
            assert controls.settings != before or not controls.requests.empty(), key
