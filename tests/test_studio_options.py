"""Options and presets of the studio's pages: those of the command line, by the same names, with the same limits."""
# ruff: noqa: F811 (fixtures)

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from clips import cut
from studio_browser import StudioServer, browser, hand_over, page, studio_server  # noqa: F401

from guise.app.cli.commands import command_line, commands
from guise.app.deidentify.options import DeidentifyOptions
from guise.app.enrolment.options import TrainingChoices
from guise.app.media.time_range import TimeRange
from guise.app.studio.deidentify_jobs import options_from
from guise.app.studio.option_form import EncodingOptions, called, taken
from guise.app.studio.store import StudioError
from guise.app.studio.swap_jobs import OPTIONS, settings_from
from guise.common import presets
from guise.common.option import options_of
from guise.common.progress import silent


@pytest.mark.parametrize(
    ("command", "kinds"),
    [
        ("swap", OPTIONS),
        ("deidentify", (DeidentifyOptions, EncodingOptions)),
        ("enroll", (TrainingChoices,)),
    ],
)
def test_every_option_of_a_page_is_one_of_the_command(command: str, kinds: tuple[type, ...]) -> None:
    assert {called(name, told) for kind in kinds for name, (told, _, _) in options_of(kind).items()} <= known(
        command
    )


def known(command: str) -> set[str]:
    parameters = dict(commands(typer.main.get_command(command_line())))[command].params
    return {opt.lstrip("-") for param in parameters for opt in param.opts}


def test_values_become_the_options_of_the_engine() -> None:
    options = options_from(
        {"from": "0:10", "gallery": ["Mei", "Kofi"], "seed": 3, "keyfile": "a.key", "crf": 18}
    )
    assert options.read == TimeRange.between("10", None)
    assert settings_from({"from": "10", "outside": "cut"}, silent).part == TimeRange.between(
        "10", None, "cut"
    )
    assert options.gallery == (Path("Mei"), Path("Kofi"))
    assert (options.seed, options.keyfile, options.encode.crf) == (3, Path("a.key"), 18)
    assert settings_from({"look": "exact", "alpha": 0.2, "unsure": "leave"}, silent).look.exact
    assert options_from({}) == DeidentifyOptions()


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"audio": "loud"}, "audio is one of keep, drop, mask, disguise, got loud"),
        ({"alpha": 2}, "alpha must be from 0 to 1, got 2"),
        ({"seed": "x"}, "seed cannot be x"),
    ],
)
def test_a_value_that_an_option_does_not_take_is_one_sentence(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(StudioError, match=sentence):
        taken(DeidentifyOptions, values)


@pytest.mark.slow
def test_a_preset_is_saved_and_a_part_of_a_video_looked_through(
    page: Any, studio_server: StudioServer, tmp_path: Path
) -> None:
    page.goto(studio_server.url("/deidentify"))
    page.get_by_text("Options and presets").click()
    page.get_by_label("From", exact=True).fill("0.2")
    page.get_by_label("To", exact=True).fill("0.6")
    page.get_by_label("Name of a preset").fill("court")
    page.get_by_role("button", name="Save").click()
    page.get_by_role("button", name="Delete the preset court").wait_for()
    assert presets.preset("court", "deidentify") == {"from": "0.2", "to": "0.6"}
    page.reload()
    page.get_by_text("Options and presets").click()
    page.get_by_role("combobox", name="Preset").click()
    page.get_by_role("option", name="court").click()
    page.wait_for_function("[...document.querySelectorAll('input')].some((field) => field.value === '0.6')")
    hand_over(page, "drop", cut("p01", tmp_path / "anna.mp4", 30), "video/mp4")
    page.get_by_role("button", name="Render").wait_for(timeout=120_000)
    (tracks,) = (studio_server.folder / "jobs").glob("*/out.tracks.json")
    assert json.loads(tracks.read_text())["frames"] == 12  # from 0.2 to 0.6 s, at 30 a second
    page.goto(studio_server.url("/deidentify"))
    page.get_by_text("Options and presets").click()
    page.get_by_role("combobox", name="Preset").click()
    page.get_by_role("option", name="court").click()
    page.get_by_role("button", name="Delete the preset court").click()
    page.get_by_role("button", name="Delete the preset court").wait_for(state="detached")
    assert presets.saved() == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "command", "button", "saved"),
    [
        ("/live", "live", "Kofi (fictional)", {"identity": ["Kofi"], "mode": "swap"}),
        ("/analogy", "analogy image", "Ratio images", {"method": "ratio", "strength": 1.0}),
    ],
)
def test_what_a_page_shows_is_saved_and_shown_again(
    page: Any, studio_server: StudioServer, path: str, command: str, button: str, saved: dict[str, Any]
) -> None:
    page.goto(studio_server.url(path))
    page.get_by_text("Options and presets").click()
    page.get_by_role("button", name=button, exact=True).click()
    page.get_by_label("Name of a preset").fill("desk")
    page.get_by_role("button", name="Save").click()
    page.get_by_role("button", name="Delete the preset desk").wait_for()
    options = presets.preset("desk", command)
    assert saved.items() <= options.items()
    assert options.keys() <= known(command)
    page.reload()
    page.get_by_text("Options and presets").click()
    assert page.locator(f"[aria-pressed=true]:has-text('{button}')").count() == 0
    page.get_by_role("combobox", name="Preset").click()
    page.get_by_role("option", name="desk").click()
    page.locator(f"[aria-pressed=true]:has-text('{button}')").wait_for()
    presets.delete("desk")
