"""The studio in a process of its own and a Chromium browser, for tests.

`from studio_browser import browser, page, studio_server  # noqa: F401` in a test module; `page` was opened at
the printed address without a cookie; its test fails when the browser logs an error or requests anything
from another host.  GUISE_TEST_SCREEN="390x844 dark" is the screen of visitors whose test chooses none.  Where there is
no Chromium the tests are skipped, or fail if GUISE_REQUIRE_BROWSER=1.
"""

import atexit
import base64
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, cached_property
from http.client import HTTPConnection
from pathlib import Path
from tempfile import TemporaryFile, mkdtemp
from typing import IO, Any
from urllib.parse import parse_qs, urlsplit

import av
import pytest
from made_up import SAMPLES

from guise.app.studio.consent import AGREED
from guise.app.studio.store import Store

SCREEN = os.environ.get("GUISE_TEST_SCREEN", "")
TIMEOUT_MS = 60_000  # after which a browser action has failed
LIMIT = 50  # MB, largest upload to the servers in tests
CAMERA = SAMPLES / "p01" / "talk.mp4"
_HELD = ExitStack()  # the browser and what drives it
_OPEN: list[Any] = []  # the browser, if it is open


@dataclass
class StudioServer:
    """A running studio.

    address : as printed, with the token.   folder : what it keeps.
    """

    address: str
    folder: Path
    process: "subprocess.Popen[str]"
    errors: IO[str]

    @cached_property
    def token(self) -> str:
        return parse_qs(urlsplit(self.address).query)["token"][0]

    @cached_property
    def port(self) -> int:
        return urlsplit(self.address).port or 80

    @cached_property
    def cookie(self) -> str:
        """The header that lets a request in."""
        connection = HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.request("GET", f"/people?token={self.token}")
        headers = connection.getresponse().headers
        connection.close()
        return headers["Set-Cookie"].split("; ")[0]

    def url(self, path: str = "/") -> str:
        """An address on it, without the token."""
        return f"http://127.0.0.1:{self.port}{path}"

    def stop(self, number: int = signal.SIGINT) -> int:
        """End it as Ctrl-C does, and return the exit code."""
        self.process.send_signal(number)
        return self.process.wait(30)

    def said(self) -> str:
        """What it has written on stderr."""
        self.errors.seek(0)
        return self.errors.read()


@contextmanager
def studio(
    folder: Path, *, limit: int = LIMIT, program: tuple[str, ...] = ("-m", "guise"), agreed: bool = True
) -> Iterator[StudioServer]:
    """A studio on a free port.   agreed : whether the user has agreed before."""
    with store_in(folder) as store:
        store.remember(AGREED, agreed)
    command = [sys.executable, *program, "studio", "--folder", str(folder), "--port", "0", "--no-open"]
    environment = os.environ | {
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "GUISE_PEOPLE": str(folder / "people"),
    }
    with TemporaryFile("w+") as errors, subprocess.Popen(
        [*command, "--limit", str(limit), "--json"], stdout=subprocess.PIPE, stderr=errors, text=True,
        env=environment, cwd=SAMPLES.parent, start_new_session=True,
    ) as process:  # fmt: skip
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line, "the studio did not start"
            yield StudioServer(json.loads(line)["address"], folder, process, errors)
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)


@contextmanager
def store_in(folder: Path) -> Iterator[Store]:
    """What a studio in a folder will keep, before it runs."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GUISE_PEOPLE", str(folder / "people"))
        store = Store(folder)
        yield store
        store.close()


@pytest.fixture(scope="module")
def studio_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StudioServer]:
    """A studio with an empty folder, for all tests of a module."""
    with studio(tmp_path_factory.mktemp("studio")) as server:
        yield server


@pytest.fixture(scope="module")
def browser() -> Any:
    """Chromium without a window, whose camera loops the first sample person's clip.

    It stays open for the next test module that needs it; conftest.py closes it before the first test that does not,
    as there is an event loop in this thread while Playwright runs.
    """
    chromium = _require_chromium()
    if not _OPEN:
        from playwright.sync_api import sync_playwright

        chrome_maker = _HELD.enter_context(sync_playwright()).chromium
        chrome = chrome_maker.launch(executable_path=chromium, args=browser_arguments(_camera()))
        _HELD.callback(chrome.close)
        _OPEN.append(chrome)
    return _OPEN[0]


def close_browser() -> None:
    """End the browser, if there is one."""
    _OPEN.clear()
    _HELD.close()


def browser_arguments(camera: Path) -> list[str]:
    """What Chromium is started with; all pages of the studio are of one process, which has its scripts compiled.

    camera : the film that stands in for the camera.
    """
    return [
        "--no-sandbox",
        "--process-per-site",
        "--renderer-process-limit=1",
        "--use-fake-device-for-media-stream",
        "--use-fake-ui-for-media-stream",
        f"--use-file-for-fake-video-capture={camera}",
    ]


@pytest.fixture
def page(studio_server: StudioServer, browser: Any) -> Iterator[Any]:
    """A new visitor who has opened the printed address."""
    with visit(browser, studio_server) as visitor:
        yield visitor


@contextmanager
def visit(browser: Any, server: StudioServer, path: str = "/people", **context: Any) -> Iterator[Any]:
    """A page of a browser context without cookies; errors and requests to other hosts fail the test at its end.

    A test that causes errors on purpose clears `page.complaints`.
    """
    options = _screen() | context
    visitor = _context(browser, server, options)
    page = visitor.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda asked: _note_foreign(asked.url, server, complaints))
    page.complaints = complaints
    try:
        page.goto(server.url(f"{path}?token={server.token}"))
        yield page
    finally:  # a page that a failed test leaves would go on with its stream
        for left in visitor.pages[1:]:
            left.close()
        visitor.clear_cookies()
        _left(browser).append((options, visitor))
    assert not complaints, "; ".join(complaints)


def hand_over(page: Any, how: str, path: Path, kind: str, place: str = "[data-drop]") -> None:
    """Drop a file on a place of a page, or paste it there.   how : "drop" or "paste".   kind : its media type."""
    page.wait_for_function("window.did_handshake")  # from then on the page takes files
    page.locator(place).first.evaluate(
        """(place, [how, data, name, type]) => {
            const files = new DataTransfer(), bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
            files.items.add(new File([bytes], name, { type }));
            const about = { bubbles: true, cancelable: true, dataTransfer: files, clipboardData: files };
            place.dispatchEvent(how === "drop" ? new DragEvent(how, about) : new ClipboardEvent(how, about));
        }""",
        [how, base64.b64encode(path.read_bytes()).decode(), path.name, kind],
    )


def _context(browser: Any, server: StudioServer, options: dict[str, Any]) -> Any:
    """A context without cookies that nobody uses; one that was used before has the studio's scripts compiled.

    Its first page is no visitor's: it stays open, and with it the process of the pages.
    """
    left = _left(browser)
    for place, (known, context) in enumerate(left):
        if known == options:
            del left[place]
            return context
    context = browser.new_context(**options)
    context.new_page().goto(server.url("/"))
    return context


def _left(browser: Any) -> list[tuple[dict[str, Any], Any]]:
    """Contexts that visitors have left, with their options."""
    if not hasattr(browser, "left"):
        browser.left = []
    return browser.left  # type: ignore[no-any-return]


def _screen() -> dict[str, Any]:
    """The context of a visitor with SCREEN."""
    if not SCREEN:
        return {}
    size, scheme = SCREEN.split()
    width, height = map(int, size.split("x"))
    return {"viewport": {"width": width, "height": height}, "color_scheme": scheme}


@cache
def _camera() -> Path:
    """The sample person's clip as a camera, made once in a test run."""
    folder = Path(mkdtemp(prefix="guise-camera-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    with av.open(str(CAMERA)) as clip:
        rate = clip.streams.video[0].average_rate
        assert rate is not None
        return camera_file(folder / "camera.y4m", clip.decode(video=0), rate)


def camera_file(path: Path, frames: Iterable[av.VideoFrame], rate: Fraction) -> Path:
    """Frames for Chromium's fake camera, which shows them in a loop at that rate, in Hz: YUV4MPEG2, without sound."""
    with path.open("wb") as out:
        for i, frame in enumerate(frames):
            if i == 0:
                out.write(
                    b"YUV4MPEG2 W%d H%d F%d:%d Ip C420jpeg\n"
                    % (frame.width, frame.height, *rate.as_integer_ratio())
                )
            out.write(b"FRAME\n" + frame.to_ndarray(format="yuv420p").tobytes())
    return path


def _note_foreign(url: str, server: StudioServer, complaints: list[str]) -> None:
    parts = urlsplit(url)
    if parts.scheme not in ("data", "blob") and parts.netloc != f"127.0.0.1:{server.port}":
        complaints.append(f"asked for {url}")


def _require_chromium() -> str:
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        reason = "there is no Chromium"
        if os.environ.get("GUISE_REQUIRE_BROWSER") == "1":
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    return chromium
