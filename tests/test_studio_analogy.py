"""The page Analogy in a browser: an expression goes from photo to photo, from a clip, and from head to head."""
# ruff: noqa: F811 (fixtures)

import io
import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clips import cut
from made_up import SAMPLES
from studio_browser import StudioServer, browser, page, studio_server, visit  # noqa: F401

from guise.analogy.feature_points import FEATURE_POINT_NAMES, find_feature_points, load_feature_points
from guise.analogy.formats.files import read_mesh, read_rig
from guise.app.media import open_input
from guise.app.media.images import read_deep
from guise.app.media.pictures import save_picture

pytestmark = pytest.mark.slow

HEADS = SAMPLES / "heads"
LONG = 120_000  # milliseconds, on a busy machine


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """s.png, s1.png with another expression, t.png of another person."""
    folder = tmp_path_factory.mktemp("photos")
    for name, person, index in (("s", "p01", 0), ("s1", "p01", 60), ("t", "p06", 0)):
        with open_input(SAMPLES / person / "talk.mp4") as source:
            rgb = next(frame.rgb().copy() for frame in source if frame.index == index)
        save_picture(folder / f"{name}.png", rgb)
    return folder


@pytest.fixture
def desk(page: Any, studio_server: StudioServer) -> Any:
    page.goto(studio_server.url("/analogy"))
    return page


def upload(desk: Any, slot: str, *files: Path) -> None:
    """Upload files into a slot, and wait until they are shown."""
    place = desk.get_by_role("group", name=slot, exact=True)
    place.locator("input[type=file]").set_input_files([str(file) for file in files])
    for file in files:
        place.locator(f"[aria-label='{file.stem}'], video").first.wait_for()


def downloaded(desk: Any, words: str) -> bytes:
    with desk.expect_download() as waiting:
        desk.get_by_role("link", name=words).first.click()
    return Path(waiting.value.path()).read_bytes()


def test_a_photo_gets_the_expression_of_another(desk: Any, photos: Path, tmp_path: Path) -> None:
    for slot, name in (("Photo 1", "s"), ("Photo 2", "s1"), ("Photo 3", "t")):
        upload(desk, slot, photos / f"{name}.png")
    desk.get_by_role("button", name="Create").click()
    desk.get_by_role("link", name="Download picture").wait_for(timeout=LONG)
    made = tmp_path / "made.png"
    made.write_bytes(downloaded(desk, "Download picture"))
    before, after = (read_deep(path).rgb8().astype(int) for path in (photos / "t.png", made))
    assert after.shape == before.shape
    changed = np.abs(after - before).max(2) > 8
    assert 0.002 < changed.mean() < 0.2  # the face, and nothing else
    assert not changed[:40].any()
    assert not changed[:, :40].any()
    desk.get_by_role("button", name="Delete t, as s1").click()
    desk.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
    desk.get_by_role("link", name="Download picture").wait_for(state="detached")


def test_a_clip_moves_a_photo(desk: Any, photos: Path, tmp_path: Path) -> None:
    upload(desk, "Photo 2", cut("p01", tmp_path / "talk.mp4", 12))
    upload(desk, "Photo 3", photos / "t.png")
    desk.get_by_role("button", name="Create").click()
    desk.get_by_text("12 of 12 frames animated.").wait_for(timeout=LONG)
    assert b"ftyp" in downloaded(desk, "Download video")[:16]


def test_what_is_missing_is_said(desk: Any, photos: Path) -> None:
    desk.get_by_role("button", name="Create").click()
    desk.get_by_text("choose photos 2 and 3 first").wait_for()


def test_what_is_no_picture_is_refused(desk: Any, tmp_path: Path, studio_server: StudioServer) -> None:
    bad = tmp_path / "bad.png"
    bad.write_bytes(b"no picture")
    desk.get_by_role("group", name="Photo 3", exact=True).locator("input[type=file]").set_input_files(
        str(bad)
    )
    desk.get_by_text("bad is not an image that can be read").wait_for()
    assert not list((studio_server.folder / "uploads").glob("*.part*"))


def test_a_head_gets_the_expressions_of_another_and_both_can_be_turned(desk: Any, tmp_path: Path) -> None:
    desk.get_by_role("tab", name="Heads").click()
    upload(desk, "Source", HEADS / "mean.obj")
    upload(desk, "Expressions", HEADS / "mean_smile.obj", HEADS / "mean_surprise.obj")
    upload(desk, "Target", HEADS / "other.obj")
    desk.get_by_role("button", name="Transfer").click()
    desk.get_by_role("link", name="Download rig").wait_for(timeout=LONG)
    rig = tmp_path / "rig.glb"
    rig.write_bytes(downloaded(desk, "Download rig"))
    assert sorted(read_rig(rig).names) == ["mean_smile", "mean_surprise"]
    with zipfile.ZipFile(io.BytesIO(downloaded(desk, "Download a mesh for each"))) as packed:
        assert len(packed.namelist()) == 2
        packed.extract(packed.namelist()[0], tmp_path)
    one = read_mesh(tmp_path / packed.namelist()[0]).mesh.vertices
    rest = read_mesh(HEADS / "other.obj").mesh.vertices
    assert one.shape == rest.shape
    assert 0.02 < np.linalg.norm(one - rest, axis=1).max() < 1
    _turn(desk)


def test_a_landmark_is_placed_by_a_click_on_the_head(desk: Any, studio_server: StudioServer) -> None:
    desk.get_by_role("tab", name="Heads").click()
    upload(desk, "Target", HEADS / "other.obj")
    desk.get_by_role("button", name="Landmarks of the target").click()
    scene = desk.get_by_role("img", name="click to place the landmark")
    scene.wait_for(timeout=LONG)
    desk.get_by_text("20 of 20 are placed.").wait_for()
    desk.get_by_role("combobox", name="Landmark", exact=True).click()
    desk.get_by_role("option", name="nose tip").click()
    id = int(scene.get_attribute("id").removeprefix("c"))
    desk.wait_for_function(
        "(id) => [...getElement(id).objects.values()].filter((o) => o.mesh).length > 21", arg=id
    )
    desk.wait_for_timeout(1500)
    box = scene.bounding_box()
    desk.mouse.click(box["x"] + 0.53 * box["width"], box["y"] + 0.5 * box["height"])
    desk.wait_for_timeout(500)
    desk.get_by_role("button", name="Save").click()
    desk.get_by_text("the next transfer uses these landmarks").wait_for()
    (file,) = (studio_server.folder / "uploads").glob("*.landmarks.json")
    mesh = read_mesh(HEADS / "other.obj").mesh
    points, found = load_feature_points(file, mesh), find_feature_points(mesh)
    moved = np.linalg.norm(points.positions - found.positions, axis=1)
    nose = FEATURE_POINT_NAMES.index("nose_tip")
    assert 0.01 < moved[nose] < 1
    assert np.delete(moved, nose).max() < 1e-3


def test_a_part_is_clicked_and_called_what_the_transfer_takes_it_for(
    desk: Any, studio_server: StudioServer
) -> None:
    desk.get_by_role("tab", name="Heads").click()
    upload(desk, "Source", HEADS / "mean.obj")
    upload(desk, "Expressions", HEADS / "mean_smile.obj")
    upload(desk, "Target", HEADS / "arkit.glb")
    desk.get_by_role("button", name="Parts of the target").click()
    place = desk.get_by_role("application", name="Place parts by keys")
    place.wait_for(timeout=LONG)
    place.focus()
    desk.keyboard.press("n")
    desk.get_by_text("Part 2 of").wait_for()
    scene = desk.get_by_role("img", name="click to place the part")
    ready = "(id) => [...getElement(id).objects.values()].filter((o) => o.mesh).length > 2"
    desk.wait_for_function(ready, arg=int(scene.get_attribute("id").removeprefix("c")))
    desk.wait_for_timeout(1500)
    box = scene.bounding_box()
    desk.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    desk.get_by_text("face skin, by its landmarks").wait_for()
    for _ in range(2):
        place.focus()
        desk.keyboard.press("n")
    said = desk.get_by_text(re.compile(r"^Part 3 of \d+: ")).inner_text()
    assert "face skin" not in said
    desk.get_by_role("combobox", name="What it is").click()
    desk.get_by_role("option", name="glasses").click()
    desk.get_by_text("glasses, by your choice").wait_for()
    with desk.expect_download() as waiting:
        desk.get_by_role("button", name="Download parts.toml").click()
    kinds = [one["kind"] for one in tomllib.loads(Path(waiting.value.path()).read_text())["part"]]
    assert "glasses" in kinds
    assert "face skin" in kinds
    desk.get_by_role("button", name="Save").click()
    (file,) = (studio_server.folder / "uploads").glob("*.parts.toml")
    assert [one["kind"] for one in tomllib.loads(file.read_text())["part"]] == ["glasses"]
    desk.get_by_role("button", name="Transfer").click()
    desk.get_by_text(re.compile("Parts of the target: .*glasses")).first.wait_for(timeout=LONG)


def test_a_landmark_is_placed_by_keys(desk: Any, studio_server: StudioServer) -> None:
    desk.get_by_role("tab", name="Heads").click()
    upload(desk, "Source", HEADS / "mean.obj")
    desk.get_by_role("button", name="Landmarks of the source").click()
    place = desk.get_by_role("application", name="Place landmarks by keys")
    place.wait_for(timeout=LONG)
    nose = FEATURE_POINT_NAMES.index("nose_tip")
    place.focus()
    for _ in range(nose):
        desk.keyboard.press("n")
    desk.get_by_text("nose tip", exact=True).first.wait_for()
    for _ in range(3):
        desk.keyboard.press("ArrowUp")
    desk.get_by_role("button", name="Save").focus()
    desk.keyboard.press("Enter")
    desk.get_by_text("the next transfer uses these landmarks").wait_for()
    files = (studio_server.folder / "uploads").glob("*.landmarks.json")
    mesh = read_mesh(HEADS / "mean.obj").mesh
    found = find_feature_points(mesh)
    file = max(files, key=lambda file: file.stat().st_mtime)
    moved = load_feature_points(file, mesh).positions - found.positions
    height = float(np.ptp(mesh.vertices[:, 1]))
    assert 0.01 * height < moved[nose, 1] < 0.04 * height
    assert np.abs(np.delete(moved, nose, axis=0)).max() < 1e-3


def _turn(desk: Any) -> None:
    """What is seen changes when it is dragged, and when the expression is taken away."""
    scene = desk.get_by_role("img", name="drag to turn them")
    desk.wait_for_function(
        "(id) => getElement(id).objects.size > 2", arg=int(scene.get_attribute("id").removeprefix("c"))
    )
    desk.wait_for_timeout(1500)
    before = scene.screenshot()
    box = scene.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    desk.mouse.move(x, y)
    desk.mouse.down()
    desk.mouse.move(x + 80, y, steps=5)
    desk.mouse.up()
    desk.wait_for_timeout(1000)
    turned = scene.screenshot()
    assert turned != before
    desk.get_by_role("combobox", name="Expression", exact=True).click()
    desk.get_by_role("option", name="at rest").click()
    desk.wait_for_timeout(1500)
    assert scene.screenshot() != turned


def test_a_job_tells_of_files_by_the_names_that_the_user_gave_them(
    desk: Any, photos: Path, tmp_path: Path
) -> None:
    empty = tmp_path / "wall.png"
    save_picture(empty, np.full((240, 320, 3), 128, np.uint8))
    upload(desk, "Photo 1", photos / "s.png")
    upload(desk, "Photo 2", photos / "s1.png")
    upload(desk, "Photo 3", empty)
    desk.get_by_role("button", name="Create").click()
    message = desk.get_by_role("status").filter(has_text="wall")
    message.wait_for(timeout=LONG)
    assert "/" not in message.inner_text()
