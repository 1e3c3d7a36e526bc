"""The page Landmarks in a browser: points are moved by mouse, touch and keys, propagated, saved, trained on."""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import clips
import numpy as np
import pytest
from studio_browser import StudioServer, browser, store_in, studio, visit  # noqa: F401

from guise.aam.landmarks import load_annotations
from guise.aam.model import rename_model
from guise.app.studio.store import CLIP, Person

pytestmark = pytest.mark.slow

GALLERY = Path(__file__).parents[1] / "app" / "gallery"
FRAMES = 24
EYE, JAW, NOSE = 36, 4, 30
READY = 60_000  # milliseconds


class Desk:
    """The page of the person, in a browser.

    file : of the landmarks.
    """

    def __init__(self, page: Any, file: Path) -> None:
        self.page, self.file = page, file
        self.picture = page.get_by_role("application")
        self.picture.wait_for()
        page.locator("svg path[d*=h0]").first.wait_for(state="attached")
        self.status = page.get_by_role("status").first

    def dots(self) -> np.ndarray:
        """The points (81, 2) as drawn, CSS pixels of the page."""
        path = self.page.locator("svg path[d*=h0]").first
        places = re.findall(r"M([-0-9.]+),([-0-9.]+)h0", path.get_attribute("d"))
        box = self.picture.bounding_box()
        return np.array(places, float) * box["width"] / 720 + (box["x"], box["y"])

    def scale(self) -> float:
        """CSS pixels to a pixel of the frame, from what is drawn of the points in the file."""
        drawn, points = self.dots(), self.points()[self.row()]
        return float(np.ptp(drawn[:, 0]) / np.ptp(points[:, 0]))

    def points(self) -> np.ndarray:
        return load_annotations(self.file).points

    def row(self) -> int:
        return int(re.match(r"Frame (\d+)", self.status.inner_text())[1]) - 1

    def button(self, name: str) -> Any:
        return self.page.get_by_role("button", name=name, exact=True)

    def says(self, text: str) -> None:
        self.page.get_by_text(text).first.wait_for()

    def save(self) -> np.ndarray:
        """Save, and give the points (t, 81, 2) in the file."""
        self.button("Save").click()
        self.says("Saved.")
        self.page.wait_for_function("!window.onbeforeunload")
        return self.points()


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Person]:
    """Ann, trained on a short clip, and Bob, whose clip is gone, in a studio's folder."""
    with store_in(tmp_path_factory.mktemp("landmarks") / "studio") as store:
        clip = store.add_upload(CLIP, "talk", ".mp4")
        clips.cut("p01", clip.path, FRAMES)
        known = {"Ann": store.add_person("Ann", clip.id), "Bob": store.add_person("Bob", None)}
        for person in known.values():
            shutil.copy(GALLERY / "p01.guise", person.path)
            rename_model(person.path, person.name)
    return known


@pytest.fixture(scope="module")
def studio_server(people: dict[str, Person]) -> Iterator[StudioServer]:
    with studio(people["Ann"].path.parents[1]) as server:
        yield server


Opened = Callable[..., AbstractContextManager[Desk]]


@pytest.fixture
def opened(studio_server: StudioServer, browser: Any, people: dict[str, Person]) -> Opened:  # noqa: F811
    """Opens Ann's page with the landmarks as they were found."""
    (clip,) = (studio_server.folder / "clips").glob("*.mp4")
    file, found = clip.with_suffix(".landmarks.npz"), studio_server.folder.parent / "found.npz"
    if found.exists():
        shutil.copy(found, file)

    @contextmanager
    def open_page(**context: Any) -> Iterator[Desk]:
        path = f"/landmarks/{people['Ann'].id}"
        with visit(browser, studio_server, path, **context) as page:
            page.set_default_timeout(READY)
            desk = Desk(page, file)
            if not found.exists():
                shutil.copy(file, found)
            yield desk

    return open_page


@pytest.fixture
def desk(opened: Opened) -> Iterator[Desk]:
    with opened(viewport={"width": 1100, "height": 1100}) as desk:
        yield desk


def drag(desk: Desk, start: np.ndarray, by: tuple[float, float]) -> None:
    mouse = desk.page.mouse
    x, y = start.tolist()
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + by[0] / 2, y + by[1] / 2)
    mouse.move(x + by[0], y + by[1])
    mouse.up()


@pytest.mark.parametrize("size", [(1440, 900), (1024, 768), (390, 844)])
def test_the_picture_fits_the_window(opened: Opened, size: tuple[int, int]) -> None:
    width, height = size
    with opened(viewport={"width": width, "height": height}) as desk:
        desk.page.evaluate("scrollTo(0, 0)")
        box = desk.picture.bounding_box()
        assert box["y"] + box["height"] <= height
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width
        assert box["width"] >= min(width - 40, 288)
        assert desk.page.evaluate("document.documentElement.scrollWidth") <= width
        dots = desk.dots()
        assert (dots >= (box["x"], box["y"])).all()
        assert (dots <= (box["x"] + box["width"], box["y"] + box["height"])).all()


def test_a_dragged_point_is_saved_where_it_was_dropped(desk: Desk) -> None:
    before, row, scale = desk.points(), desk.row(), desk.scale()
    drag(desk, desk.dots()[EYE] + (3, 2), (40, -25))
    desk.says("corrected: right eye, point 36")
    moved = desk.save() - before
    assert moved[row, EYE] == pytest.approx(np.array([40, -25]) / scale, abs=0.05)
    moved[row, EYE] = 0
    assert np.abs(moved).max() == 0


def test_a_finger_drags_a_point_too(opened: Opened) -> None:
    with opened(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True) as desk:
        before, row, scale = desk.points(), desk.row(), desk.scale()
        start = desk.dots()[JAW]
        fingers = desk.page.context.new_cdp_session(desk.page)
        for kind, way in (("touchStart", 0), ("touchMove", 15), ("touchMove", 30), ("touchEnd", None)):
            at = [] if way is None else [{"x": start[0] + way, "y": start[1] - way}]
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": at})
        desk.says("corrected: jaw, point 4")
        moved = desk.save() - before
        assert moved[row, JAW] == pytest.approx(np.array([30, -30]) / scale, abs=0.05)
        moved[row, JAW] = 0
        assert np.abs(moved).max() == 0
        assert desk.page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_everything_is_done_by_keys(desk: Desk) -> None:
    before, row = desk.points(), desk.row()
    keys = desk.page.keyboard
    while desk.page.evaluate("document.activeElement.getAttribute('role')") != "application":
        keys.press("Tab")
    for _ in range(2):
        keys.press("n")
    keys.press("p")
    desk.says("point 1,")
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "Shift+ArrowLeft"):
        keys.press(key)
    keys.press("PageDown")
    desk.says(f"Frame {row + 2} of {FRAMES}, as found")
    keys.press("ArrowUp")
    desk.says(f"Frame {row + 2} of {FRAMES}, corrected")
    keys.press("Control+z")
    desk.says(f"Frame {row + 2} of {FRAMES}, as found")
    keys.press("s")
    desk.says("Saved.")
    moved = desk.points() - before
    assert moved[row, 1] == pytest.approx((1.8, 1), abs=1e-3)
    moved[row, 1] = 0
    assert np.abs(moved).max() == 0


def test_a_correction_is_mirrored_carried_forward_and_undone(desk: Desk) -> None:
    before, row = desk.points(), desk.row()
    drag(desk, desk.dots()[JAW], (-40, 0))
    desk.button("Mirror").click()
    desk.button("Carry forward").click()
    desk.says("Carried forward to")
    after = desk.save()
    there = desk.points()[row] - before[row]
    assert there[JAW][0] < -5
    assert there[12][0] > 5
    wider = np.linalg.norm(after[:, 12] - after[:, JAW], axis=1)
    assert (wider[row:] > 1.1 * np.linalg.norm(before[:, 12] - before[:, JAW], axis=1)[row:]).all()
    for _ in range(3):
        desk.button("Undo").click()
    desk.says("as found")
    assert np.array_equal(desk.save(), before)


def test_a_mistake_is_one_sentence(desk: Desk) -> None:
    drag(desk, desk.dots()[NOSE], (5, 5))
    desk.button("Mirror").click()
    desk.says("this point lies on the axis of the face")


def test_an_empty_place_moves_the_picture_and_not_a_point(desk: Desk) -> None:
    before = desk.dots()
    corner = desk.picture.bounding_box()
    drag(desk, np.array([corner["x"] + 20, corner["y"] + 20]), (0, 50))
    for _ in range(50):
        desk.page.wait_for_timeout(100)
        if np.abs(desk.dots() - before - (0, 50)).max() < desk.scale():
            break
    assert desk.dots() - before == pytest.approx(np.tile([0, 50], (81, 1)), abs=desk.scale())
    assert desk.button("Save").is_disabled()


def test_what_another_window_saved_is_not_lost_unasked(opened: Opened) -> None:
    with opened() as first, opened() as second:
        first.picture.focus()
        second.picture.focus()
        first.page.keyboard.press("ArrowRight")
        kept = first.save()
        second.page.keyboard.press("ArrowLeft")
        second.button("Save").click()
        second.says("saved in another window")
        second.page.get_by_role("alertdialog").get_by_role("button", name="Cancel").click()
        assert np.array_equal(second.points(), kept)
        second.button("Save").click()
        second.page.get_by_role("alertdialog").get_by_role("button", name="Replace").click()
        second.says("Saved.")
        moved = kept - second.points()
        assert moved[first.row(), 0] == pytest.approx((2, 0), abs=1e-3)


def test_the_person_is_retrained_from_the_saved_points(desk: Desk, people: dict[str, Person]) -> None:
    before = {name: person.path.read_bytes() for name, person in people.items()}
    desk.button("Save and retrain").click()
    desk.says("Retrained:")
    assert people["Ann"].path.read_bytes() != before["Ann"]
    assert people["Bob"].path.read_bytes() == before["Bob"]


def test_who_has_no_clip_is_not_offered(
    studio_server: StudioServer,
    browser: Any,  # noqa: F811
    people: dict[str, Person],
) -> None:
    with visit(browser, studio_server, "/landmarks") as page:
        page.get_by_text("Ann").wait_for()
        assert page.get_by_text("Bob").count() == 0
        for path in (people["Bob"].id, "nobody"):
            page.goto(studio_server.url(f"/landmarks/{path}"))
            page.get_by_text("no longer exists").wait_for()
        page.complaints.clear()  # the browser calls a page of status 404 an error
