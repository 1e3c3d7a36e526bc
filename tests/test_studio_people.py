"""The page People in a browser: record, upload, enrol, look, download, delete; and the layout of all pages."""
# ruff: noqa: F811 (fixtures)

import socket
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from clips import cut, empty_scene
from made_up import SAMPLES
from studio_browser import LIMIT, StudioServer, browser, hand_over, page, studio, visit  # noqa: F401
from studio_held import HOLD

from guise.aam.model import Identity
from guise.app.media import open_input
from guise.app.media.pictures import save_picture

PROGRAM = (str(Path(__file__).with_name("studio_held.py")),)
ENROL = 120_000  # milliseconds, on a busy machine
AMBER = "rgb(245, 158, 11)"
TRICK = "../../../evil <b>x<.mp4"
pytestmark = [pytest.mark.filterwarnings("ignore:unclosed"), pytest.mark.slow]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of a sample person: enough to learn from, in a few seconds."""
    return cut("p01", tmp_path_factory.mktemp("clip") / "anna.mp4", 24)


class Studios:
    """A studio after the other: one that a test has left with files in it is not used again."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._count = folder, 0
        self._open: AbstractContextManager[StudioServer] | None = None

    def current(self) -> StudioServer:
        if self._open is None:
            self._count += 1
            self._open = studio(self._folder / str(self._count), program=PROGRAM)
            self._server = self._open.__enter__()
        return self._server

    def close(self) -> None:
        if self._open is not None:
            self._open.__exit__(None, None, None)
            self._open = None


@pytest.fixture(scope="module")
def studios(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Studios]:
    studios = Studios(tmp_path_factory.mktemp("studios"))
    yield studios
    studios.close()


@pytest.fixture
def studio_server(studios: Studios) -> Iterator[StudioServer]:
    """An empty studio, which each test leaves as it was."""
    server = studios.current()
    yield server
    if left := kept(server):
        studios.close()
    assert left == set()


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Nobody is learned meanwhile, so that a test comes in time however busy the machine is."""
    folder.mkdir(exist_ok=True)
    (folder / HOLD).touch()
    try:
        yield
    finally:
        (folder / HOLD).unlink()


def kept(server: StudioServer) -> set[str]:
    """The files that the studio keeps."""
    folders = ("clips", "people", "jobs", "incoming")
    files = (path for name in folders for path in (server.folder / name).rglob("*") if path.is_file())
    return {str(path.relative_to(server.folder)) for path in files}


def upload(page: Any, file: Any) -> None:
    page.locator("input[type=file]").first.set_input_files(file)


def learn(page: Any, file: Any = None) -> None:
    """Upload a clip, unless there is one, and have somebody learned from it, who agreed."""
    if file is not None:
        upload(page, file)
    begin = page.get_by_role("button", name="Learn from this clip")
    begin.wait_for()
    assert begin.is_disabled()
    page.get_by_text("The person shown here agreed to this").click()
    begin.click()
    begin.wait_for(state="detached")


def remove(page: Any, name: str) -> None:
    page.get_by_role("button", name=name).click()
    page.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
    page.get_by_role("button", name=name).wait_for(state="detached")


def test_a_person_is_uploaded_learned_downloaded_and_deleted(
    page: Any, browser: Any, studio_server: StudioServer, clip: Path, tmp_path: Path
) -> None:  # fmt: skip
    """The tab is closed while the job runs, and another one sees the person and deletes them."""
    with held(studio_server.folder):
        page.get_by_label("Name", exact=True).fill("Anna")
        learn(page, clip)
        page.get_by_role("progressbar", name="Progress").wait_for()
    with visit(browser, studio_server) as other:
        page.close()
        other.get_by_role("button", name="Delete Anna", exact=True).wait_for(timeout=ENROL)
        other.get_by_role("img", name="The face of Anna").wait_for()
        other.get_by_text("Details").click()
        montage = other.get_by_role("img", name="The model of Anna").locator("img")
        picture = other.request.get(studio_server.url(montage.get_attribute("src"))).body()
        assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).shape[0] > 300
        with other.expect_download() as download:
            other.locator("a[download='Anna.guise']").click()
        assert download.value.suggested_filename == "Anna.guise"
        download.value.save_as(tmp_path / "Anna.guise")
        assert Identity.load(tmp_path / "Anna.guise").name == "Anna"
        other.get_by_role("button", name="Rename Anna").click()
        other.get_by_role("dialog").get_by_label("A new name").fill("Bea")
        other.get_by_role("button", name="Save").click()
        other.get_by_role("button", name="Swap with Bea").click()
        other.wait_for_url("**/swap")
        other.goto(studio_server.url("/people"))
        other.get_by_role("button", name="Rename Bea").click()
        other.get_by_role("dialog").get_by_label("A new name").fill("Anna")
        other.get_by_role("button", name="Save").click()
        remove(other, "Delete Anna")
        remove(other, "Delete the clip anna")


def test_a_clip_is_recorded_with_the_camera(page: Any, studio_server: StudioServer) -> None:
    page.get_by_label("Name", exact=True).fill("Camera")
    page.get_by_role("button", name="Record with the camera").click()
    use = page.get_by_role("button", name="Use it")
    with held(studio_server.folder):
        use.and_(page.locator(":enabled")).click()
        learn(page)
        page.get_by_role("button", name="Cancel").click()
        page.get_by_text("Cancelled.").wait_for()
    (file,) = (studio_server.folder / "clips").iterdir()
    with av.open(str(file)) as video:
        frames = [frame.to_ndarray(format="gray") for frame in video.decode(video=0)]
    assert frames[0].shape == (480, 640)
    assert len(frames) > 1  # how many depends on how busy the machine is
    assert np.std(frames[-1]) > 20
    page.get_by_role("button", name="Remove").click()
    remove(page, "Delete the clip recording")


def test_a_discarded_recording_is_nowhere(page: Any, studio_server: StudioServer) -> None:
    """Not even when it ended by itself before."""
    page.get_by_role("button", name="Record with the camera").click()
    discard = page.get_by_role("button", name="Discard")
    discard.and_(page.locator(":enabled")).wait_for()
    page.evaluate("guiseRecorder.end(document.querySelector('video'))")  # as after 20 seconds
    page.wait_for_function("document.querySelector('video').srcObject === null")
    discard.click()
    page.get_by_label("Camera", exact=True).wait_for(state="hidden")
    assert kept(studio_server) == set()


def test_what_is_not_a_video_is_refused_with_a_sentence(page: Any, tmp_path: Path) -> None:
    upload(page, {"name": "a.mp4", "mimeType": "video/mp4", "buffer": b"this is text" * 99})
    page.get_by_text("a isn't a video that Guise reads").wait_for()
    upload(page, {"name": "a.html", "mimeType": "text/html", "buffer": b"<script>"})
    page.get_by_text("This isn't a video or a photo: use an .mp4").wait_for()
    large = tmp_path / "large.mp4"
    with large.open("wb") as file:
        file.truncate((LIMIT + 1) * 10**6)
    upload(page, large)
    page.get_by_text(f"The file is larger than {LIMIT} MB").wait_for()


def test_a_failure_is_reported_with_the_clips_own_name(page: Any, tmp_path: Path) -> None:
    learn(page, empty_scene(tmp_path / "wall.mp4"))
    page.get_by_text("no face found in wall; use a clip that shows the face from the front").wait_for()
    page.get_by_role("button", name="Remove").click()
    remove(page, "Delete the clip wall")


def test_a_name_is_text_and_not_a_path(page: Any, studio_server: StudioServer, clip: Path) -> None:
    with held(studio_server.folder):
        learn(page, {"name": TRICK, "mimeType": "video/mp4", "buffer": clip.read_bytes()})
        page.get_by_role("button", name="Cancel").click()
        page.get_by_role("button", name="Remove").click()
    (file,) = (studio_server.folder / "clips").iterdir()
    assert file.stem.isalnum()
    assert not list(studio_server.folder.parent.rglob("*evil*"))
    remove(page, "Delete the clip evil <b>x<")


def test_a_broken_upload_leaves_nothing(page: Any, studio_server: StudioServer, clip: Path) -> None:
    page.route("**/upload/*", lambda route: route.abort())
    upload(page, clip)
    page.get_by_text("The upload was interrupted: try again.").wait_for()
    page.complaints.clear()
    id = page.locator(".q-uploader").first.get_attribute("id").removeprefix("c")
    path = f"/_nicegui/client/{page.evaluate('window.clientId')}/upload/{id}"
    half_an_upload(studio_server, path, clip)
    assert too_much(studio_server, path) == 413
    assert kept(studio_server) == set()


def half_an_upload(server: StudioServer, path: str, clip: Path) -> None:
    """Begin to send a file of 3 MB, which is written to the disk meanwhile, and hang up."""
    lines = (
        f"POST {path} HTTP/1.1", f"Host: 127.0.0.1:{server.port}", f"Origin: http://127.0.0.1:{server.port}",
        f"Cookie: {server.cookie}", "Content-Type: multipart/form-data; boundary=x", "Content-Length: 6000000", "",
        "--x", 'Content-Disposition: form-data; name="file"; filename="half.mp4"', "", "",
    )  # fmt: skip
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.sendall("\r\n".join(lines).encode() + clip.read_bytes()[:1000] + bytes(3 * 10**6))


def too_much(server: StudioServer, path: str) -> int:
    """The status of an upload that does not say how large it is, and is too large."""
    head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.mp4"\r\n\r\n'
    headers = {
        "Cookie": server.cookie,
        "Origin": server.url(""),
        "Content-Type": "multipart/form-data; boundary=x",
    }
    connection = HTTPConnection("127.0.0.1", server.port, timeout=60)
    body = (head, *[bytes(10**6)] * LIMIT, bytes(10**5))
    connection.request("POST", path, body, headers | {"Transfer-Encoding": "chunked"}, encode_chunked=True)
    status = connection.getresponse().status
    connection.close()
    return status


def test_two_browsers_see_the_same(page: Any, browser: Any, studio_server: StudioServer, clip: Path) -> None:
    with held(studio_server.folder), visit(browser, studio_server) as other:
        learn(page, clip)
        other.get_by_role("button", name="Cancel").click()
        for visitor in (page, other):
            visitor.get_by_text("Cancelled.").wait_for()
        page.get_by_role("button", name="Remove").click()
        other.get_by_text("Cancelled.").wait_for(state="detached")
        remove(other, "Delete the clip anna")
        page.get_by_text("Your clips").wait_for(state="hidden")


def test_a_queued_job_can_be_cancelled_while_it_starts(
    page: Any, studio_server: StudioServer, clip: Path
) -> None:
    """Its button stays the same one, so that no click on it is lost."""
    with held(studio_server.folder):
        for name in ("First", "Second"):
            page.get_by_label("Name", exact=True).fill(name)
            learn(page, clip)
            page.get_by_text(name, exact=True).wait_for()
        first, second = (page.locator(".q-card", has=page.get_by_text(name, exact=True)).last
                         for name in ("First", "Second"))  # fmt: skip
        second.get_by_text("waiting for other jobs").wait_for()
        cancel = second.get_by_role("button", name="Cancel").element_handle()
        first.get_by_role("button", name="Cancel").click()
        second.get_by_text("held").wait_for()
        page.wait_for_timeout(2500)  # until the page has been looked over again
        cancel.click()
        second.get_by_text("Cancelled.").wait_for()
        for card in (first, second):
            card.get_by_role("button", name="Remove").click()
            card.wait_for(state="detached")
    for _ in range(2):
        page.get_by_role("button", name="Delete the clip anna").first.click()
        page.get_by_role("alertdialog").get_by_role("button", name="Delete").click()
        page.get_by_role("alertdialog").wait_for(state="detached")
    page.get_by_text("Your clips").wait_for(state="hidden")


def test_built_in_faces_are_shown(page: Any) -> None:
    page.wait_for_function("[...document.images].filter((i) => i.naturalWidth > 100).length >= 7")


def test_a_restart_keeps_what_was_begun(browser: Any, clip: Path, tmp_path: Path) -> None:
    with held(tmp_path), studio(tmp_path, program=PROGRAM) as server:
        with visit(browser, server) as page:
            page.get_by_label("Name", exact=True).fill("Anna")
            learn(page, clip)
            page.get_by_role("progressbar", name="Progress").wait_for()
        assert server.stop() == 0
    with studio(tmp_path, program=PROGRAM) as server, visit(browser, server) as page:
        page.get_by_role("button", name="Delete Anna", exact=True).wait_for(timeout=ENROL)


def test_dark_is_chosen_with_the_keyboard_and_remembered(
    page: Any, browser: Any, studio_server: StudioServer
) -> None:
    page.emulate_media(color_scheme="light")
    page.locator("body.body--light").wait_for()
    page.get_by_role("button", name="Colours").press("Enter")
    page.get_by_role("menuitem", name="Dark").press("Enter")
    page.locator("body.body--dark").wait_for()
    with visit(browser, studio_server) as other:
        other.locator("body.body--dark").wait_for()
        other.get_by_role("button", name="Colours").click()
        other.get_by_role("menuitem", name="Light").click()
        other.locator("body.body--light").wait_for()


def test_the_keyboard_reaches_everything_visibly(page: Any) -> None:
    seen = []
    for _ in range(13):
        page.keyboard.press("Tab")
        ring = "(style => style.outlineColor + style.boxShadow)(getComputedStyle(document.activeElement))"
        seen.append(tuple(page.evaluate(f"[document.activeElement.textContent.trim(), {ring}]")))
    words = [word for word, _ in seen]
    pages = ["Live", "Swap", "People", "Landmarks", "De-identify", "Analogy", "Rig"]
    assert words[:9] == ["Skip to content", "Guise", *pages]
    assert {"upload", "videocam"} <= {word.split("Choose")[0].split("Record")[0] for word in words}
    assert [word for word, style in seen if word and AMBER not in style] == []
    assert page.locator("main").count() == 1


def test_a_photo_is_learned_after_consent_and_then_deleted(
    page: Any, studio_server: StudioServer, tmp_path: Path
) -> None:
    photo = tmp_path / "carla.png"
    with open_input(SAMPLES / "p06" / "talk.mp4") as media:
        save_picture(photo, next(iter(media)).rgb())
    hand_over(page, "paste", photo, "image/png", "body")
    learn = page.get_by_role("button", name="Learn from this photo")
    learn.wait_for()
    assert learn.is_disabled()
    page.get_by_text("The person shown here agreed").click()
    learn.click()
    page.get_by_role("button", name="Delete carla", exact=True).wait_for(timeout=ENROL)
    page.get_by_text("Learned from one photo.").wait_for()
    assert list((studio_server.folder / "uploads").iterdir()) == []
    remove(page, "Delete carla")


def test_a_wish_for_what_is_not_there_is_answered_by_a_page_of_status_404(
    page: Any, studio_server: StudioServer
) -> None:
    for path in ("/swap/nothing", "/deidentify/nothing"):
        answer = page.goto(studio_server.url(path))
        assert answer is not None
        assert answer.status == 404
        page.get_by_text("no longer exists").wait_for()
    page.complaints.clear()  # the browser calls it an error


def test_every_page_asks_for_consent_before_anything_is_made(browser: Any, tmp_path: Path) -> None:
    with studio(tmp_path / "new", agreed=False) as server, visit(browser, server, "/swap") as visitor:
        agree = visitor.get_by_role("button", name="I agree")
        for path in (
            "/live",
            "/people",
            "/landmarks",
            "/deidentify",
            "/analogy",
            "/rig",
            "/swap/nothing",
            "/",
            "/swap",
        ):
            visitor.goto(server.url(path))
            agree.wait_for()
            assert visitor.locator("input, [data-drop]").count() == 0
        agree.click()
        visitor.locator("[data-drop]").first.wait_for()  # the page that was asked for
        visitor.goto(server.url("/"))
        for name in ("Live", "Swap a video", "De-identify"):
            visitor.locator("main").get_by_role("link", name=name).wait_for()
        assert visitor.evaluate("fetch('/favicon.ico').then((r) => r.headers.get('content-type'))") == (
            "image/svg+xml"
        )


@pytest.mark.parametrize("path", ["/", "/people", "/swap", "/landmarks", "/deidentify", "/analogy"])
def test_pages_fit_a_phone(browser: Any, studio_server: StudioServer, path: str) -> None:
    phone = {"viewport": {"width": 360, "height": 740}, "has_touch": True, "is_mobile": True}
    with visit(browser, studio_server, path, **phone) as page:
        page.get_by_role("link", name="De-identify", exact=True).wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        box = page.get_by_role("button", name="Colours").bounding_box()
        assert box["x"] + box["width"] <= 360
