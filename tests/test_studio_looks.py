"""The studio's pages on a desktop, a tablet and a phone, in light and dark: nothing serious against accessibility."""
# ruff: noqa: F811 (fixtures)

from pathlib import Path
from typing import Any

import pytest
from clips import cut
from made_up import SAMPLES
from studio_browser import StudioServer, browser, hand_over, studio_server, visit  # noqa: F401

from guise.app.media import open_input
from guise.app.media.pictures import save_picture

axe = pytest.importorskip("axe_playwright_python.sync_playwright")

PAGES = ("/", "/live", "/swap", "/people", "/landmarks", "/deidentify", "/analogy", "/rig")
COLOURS = {"runOnly": ["color-contrast"]}
LOOKS = (  # width, colour scheme, and what is looked for; the second differs from the first in colours alone
    (1440, "light", {}),
    (1440, "dark", COLOURS),
    (1024, "light", {}),
    (390, "dark", {}),
)
SERIOUS = ("serious", "critical")
pytestmark = [pytest.mark.filterwarnings("ignore:unclosed"), pytest.mark.slow]


@pytest.fixture(scope="module")
def filled(
    studio_server: StudioServer, browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> StudioServer:
    """A studio with a clip in it."""
    clip = cut("p01", tmp_path_factory.mktemp("clip") / "anna.mp4", 8)
    with visit(browser, studio_server, "/analogy") as page:
        page.locator("input[type=file]").first.wait_for(state="attached")
        page.goto(studio_server.url("/people"))
        page.locator("input[type=file]").first.set_input_files(str(clip))
        page.get_by_text("The person shown here agreed").click()
        page.get_by_role("button", name="Learn from this clip").click()
        page.get_by_role("progressbar", name="Progress").or_(page.get_by_text("Try again")).first.wait_for()
    return studio_server


@pytest.mark.parametrize("path", PAGES)
def test_no_page_has_a_serious_fault(browser: Any, filled: StudioServer, path: str) -> None:
    with visit(browser, filled, path) as page:
        page.get_by_role("heading", level=1).wait_for()
        assert faults(page) == []


@pytest.mark.parametrize("path", ["/swap", "/deidentify"])
def test_the_page_of_a_dropped_photo_has_no_serious_fault(
    browser: Any, filled: StudioServer, path: str, tmp_path: Path
) -> None:
    with open_input(SAMPLES / "p01" / "talk.mp4") as media:
        save_picture(tmp_path / "anna.png", next(iter(media)).rgb())
    with visit(browser, filled, path) as page:
        hand_over(page, "drop", tmp_path / "anna.png", "image/png")
        page.get_by_text("drawn in").wait_for(timeout=120_000)
        assert faults(page) == []


def faults(page: Any) -> list[tuple[Any, ...]]:
    """What axe finds serious on a page with each of LOOKS."""
    found = []
    for width, scheme, options in LOOKS:
        page.set_viewport_size({"width": width, "height": 844})
        page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
        dark = "(dark) => document.body.classList.contains('body--dark') === dark"
        page.wait_for_function(dark, arg=scheme == "dark")
        page.wait_for_timeout(300)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        answer = axe.Axe().run(page, options={"preload": False} | options).response["violations"]
        found += [
            (width, scheme, fault["id"], [node["html"][:100] for node in fault["nodes"]][:3])
            for fault in answer
            if fault["impact"] in SERIOUS
        ]
    return found
