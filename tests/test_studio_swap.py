"""The page Swap in a browser: a video goes up, a face is chosen and looked at, and the swapped video comes back."""
# ruff: noqa: F811 (fixtures)

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clips import cut, empty_scene
from made_up import SAMPLES
from studio_browser import StudioServer, browser, hand_over, page, studio_server  # noqa: F401

from guise.app.media import open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import save_picture

LONG = 120_000  # milliseconds, on a busy machine
pytestmark = [pytest.mark.filterwarnings("ignore:unclosed"), pytest.mark.slow]


@pytest.fixture
def desk(page: Any, studio_server: StudioServer) -> Any:
    page.get_by_role("link", name="Swap", exact=True).click()
    page.get_by_role("button", name="Try a sample clip").wait_for()
    return page


def test_a_video_is_previewed_swapped_and_downloaded(
    desk: Any, studio_server: StudioServer, tmp_path: Path
) -> None:
    clip = cut("p01", tmp_path / "anna.mp4", 24)
    desk.locator("input[type=file]").set_input_files(str(clip))
    desk.get_by_text("in 24 of 24 frames").wait_for(timeout=LONG)
    faces = desk.get_by_role("group", name="Face of person 1")
    assert faces.locator("[aria-pressed=true]").count() == 1  # a face is proposed
    desk.get_by_text("drawn in").wait_for()
    before = desk.get_by_role("img", name="After", exact=True).get_attribute("src")
    faces.get_by_role("button", name="Mei").click()
    desk.wait_for_function(f"document.querySelector('img[alt=After]').src.length != {len(before)}")
    assert faces.get_by_role("button", name="Mei").get_attribute("aria-pressed") == "true"

    desk.get_by_role("button", name="Swap the video").click()
    desk.get_by_text("24 of 24 frames swapped").wait_for(timeout=LONG)
    with desk.expect_download() as waiting:
        desk.get_by_role("link", name="Download video").click()
    assert waiting.value.suggested_filename == "anna_swapped.mp4"
    with open_input(clip) as old, open_input(Path(waiting.value.path())) as new:
        pairs = [(a.rgb().astype(int), b.rgb().astype(int)) for a, b in zip(old, new, strict=True)]
    assert all(np.abs(a - b).max() > 30 for a, b in pairs)

    desk.get_by_role("button", name="Delete", exact=True).click()
    desk.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
    desk.get_by_role("button", name="Try a sample clip").wait_for()
    assert list((studio_server.folder / "jobs").iterdir()) == []


def test_a_photo_gets_the_face_of_another_photo(desk: Any, tmp_path: Path) -> None:
    for person in ("p01", "p06"):
        with open_input(SAMPLES / person / "talk.mp4") as media:
            save_picture(tmp_path / f"{person}.png", next(iter(media)).rgb())
    hand_over(desk, "drop", tmp_path / "p01.png", "image/png")
    desk.get_by_text("drawn in").wait_for(timeout=LONG)
    hand_over(desk, "paste", tmp_path / "p06.png", "image/png")
    desk.get_by_role("alertdialog").get_by_role("button", name="Yes, or it is me").click()
    face = desk.get_by_role("group", name="Face of person 1").get_by_role("button", name="p06")
    face.wait_for()
    assert face.get_attribute("aria-pressed") == "true"
    desk.get_by_role("button", name="Swap the photo").click()
    with desk.expect_download() as waiting:
        desk.get_by_role("link", name="Download photo").click(timeout=LONG)
    before, after = (
        read_deep(path).rgb8().astype(int) for path in (tmp_path / "p01.png", Path(waiting.value.path()))
    )
    changed = np.abs(after - before).max(2) > 30
    assert 0.005 < changed.mean() < 0.2  # the face, and nothing else
    assert not changed[:40].any()


def test_nobody_to_swap_is_one_sentence(desk: Any, tmp_path: Path) -> None:
    hand_over(desk, "drop", empty_scene(tmp_path / "empty.mp4"), "video/mp4")
    desk.get_by_text("nobody is seen long enough in empty").wait_for(timeout=LONG)


def test_a_video_that_is_gone_is_one_sentence(desk: Any, studio_server: StudioServer) -> None:
    desk.goto(studio_server.url("/swap/nothing"))
    desk.get_by_text("this job no longer exists").wait_for()
    desk.complaints.clear()  # the browser calls a page of status 404 an error
