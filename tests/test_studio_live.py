"""The page Live in a browser whose camera shows a sample person: what comes back is looked at, pixel by pixel."""

import base64
import os
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from made_up import SAMPLES

pytest.importorskip("playwright")
sys.path.append(str(Path(__file__).parents[1] / "docs"))  # scripts of the checkout
import studio_picture
from studio_browser import StudioServer, browser, browser_arguments, camera_file, store_in, studio, visit  # noqa: F401

from guise.aam.landmarks.schemes import INNER51, LOWER_LIP_INNER, UPPER_LIP_INNER
from guise.aam.model import Identity

pytestmark = pytest.mark.slow

TIMEOUT_MS = 60_000
OF_A_RUN = 7  # threads: capture, work, three outputs, what runs them and the detector
READ = """(label) => {
  const video = document.querySelector(`video[aria-label="${label}"]`);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
  if (!canvas.width) return null;
  canvas.getContext("2d").drawImage(video, 0, 0);
  return canvas.toDataURL("image/jpeg", 0.95);
}"""

TWICE_R = """() => {
  for (const _ of [1, 2]) document.body.dispatchEvent(new KeyboardEvent("keydown", {key: "r", bubbles: true}));
}"""


def widest() -> int:
    """The frame of the clip in which the mouth is open widest."""
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"]
    return int((points[:, LOWER_LIP_INNER, 1] - points[:, UPPER_LIP_INNER, 1]).argmax())


@pytest.fixture(scope="module")
def regions() -> tuple[np.ndarray, np.ndarray]:
    """Masks (h, w) of the inner face and of what is far from it in the camera's picture."""
    points = np.load(SAMPLES / "p01" / "talk.npz")["landmarks"][widest()]
    face = np.zeros((480, 640), np.uint8)
    cv2.fillConvexPoly(face, cv2.convexHull(points[INNER51].astype(np.int32)), 1)
    far = np.ones((480, 640), np.uint8)
    centre, size = points.mean(0), np.ptp(points, axis=0).max()
    cv2.circle(far, centre.astype(int).tolist(), int(1.1 * size), 0, -1)
    return face.astype(bool), far.astype(bool)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, p01: Identity) -> Iterator[StudioServer]:
    """A studio that knows the person at the camera."""
    folder = tmp_path_factory.mktemp("studio")
    with store_in(folder) as store:
        replace(p01, name="Robin").save(store.add_person("Robin", None).path)
    with studio(folder) as running:
        yield running


@pytest.fixture(scope="module")
def chrome(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:  # noqa: F811
    """A browser whose camera shows one frame all the time, slowly, so that others get something of the computer."""
    with av.open(str(SAMPLES / "p01" / "talk.mp4")) as clip:
        frame = next(islice(clip.decode(video=0), widest(), None))
        camera = camera_file(tmp_path_factory.mktemp("still") / "camera.y4m", [frame], Fraction(10))
    still = browser.browser_type.launch(executable_path=_executable(), args=browser_arguments(camera))
    yield still
    still.close()


def _executable() -> str | None:
    return shutil.which("chromium") or shutil.which("google-chrome")


def read(page: Any, label: str) -> np.ndarray | None:
    """A video's picture of this moment, RGB (h, w, 3) float, or None."""
    data = page.evaluate(READ, label)
    if data is None:
        return None
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data.split(",")[1]), np.uint8), cv2.IMREAD_COLOR_RGB)
    return np.asarray(image, np.float64)


def result(page: Any) -> np.ndarray:
    picture = read(page, "The result")
    assert picture is not None
    return picture


def until(page: Any, condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + TIMEOUT_MS / 1000
    while time.monotonic() < end:
        if condition():
            return
        page.wait_for_timeout(250)
    pytest.fail(f"never {what}: {page.locator('body').inner_text()}")


def difference(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> float:
    """Mean absolute difference of RGB in a region."""
    return float(np.abs(a - b)[where].mean())


def go_live(page: Any) -> None:
    page.get_by_role("button", name="Start").click()
    until(page, lambda: page.get_by_role("status").first.inner_text() == "", "swapped")
    until(page, lambda: read(page, "The result") is not None, "received")


def choose(page: Any, label: str, option: str) -> None:
    page.get_by_role("combobox", name=label, exact=True).click()
    page.get_by_role("option", name=option).click()


def threads(server: StudioServer) -> int:
    return len(os.listdir(f"/proc/{server.process.pid}/task"))


def test_another_face_comes_back_a_cover_changes_it_and_leaving_ends_it(
    chrome: Any, server: StudioServer, regions: tuple[np.ndarray, np.ndarray]
) -> None:
    face, far = regions
    with visit(chrome, server, "/live") as page:
        face_of = page.get_by_role("group", name="Face to show")
        face_of.get_by_role("button", name="Amara (fictional)").click()
        choose(page, "Who is at the camera", "Robin")
        go_live(page)
        sent = read(page, "Your camera")
        assert sent is not None
        until(page, lambda: difference(result(page), sent, far) < 6, "with the background as it was sent")
        shown = result(page)
        assert difference(shown, sent, face) > 3 * difference(shown, sent, far)
        assert difference(shown, sent, face) > 12

        assert page.get_by_label("Recent latency from the camera on").count() == 0
        page.get_by_role("button", name="Performance").first.click()
        page.get_by_label("Recent latency from the camera on").locator("canvas").wait_for()

        noise = difference(result(page), shown, face)
        page.locator("body").press("o")
        until(page, lambda: "as you chose" in page.get_by_role("status").first.inner_text(), "covered")
        until(page, lambda: difference(result(page), shown, face) > 3 * noise + 5, "seen to be covered")

        live = threads(server)
        page.goto("about:blank")
        until(page, lambda: threads(server) <= live - OF_A_RUN, "ended when its page was left")


def test_recordings_and_snapshots_are_downloads_of_the_result(
    chrome: Any, server: StudioServer, tmp_path: Path
) -> None:
    with visit(chrome, server, "/live") as page:
        choose(page, "Who is at the camera", "Robin")
        go_live(page)
        page.evaluate(TWICE_R)  # the second one is too soon to be meant
        page.get_by_role("button", name="Stop recording").wait_for()
        page.get_by_role("timer").get_by_text("0:02").wait_for()
        with page.expect_download(timeout=TIMEOUT_MS) as film:
            page.get_by_role("button", name="Stop recording").click()
        film.value.save_as(tmp_path / "film.mp4")
        with page.expect_download(timeout=TIMEOUT_MS) as still:
            page.get_by_role("button", name="Snapshot").click()
        still.value.save_as(tmp_path / "still.png")
        page.get_by_role("button", name="Stop").click()
        page.get_by_role("button", name="Start").wait_for()
        assert read(page, "The result") is None
    with av.open(str(tmp_path / "film.mp4")) as container:
        assert container.streams.video[0].width == 640
        assert next(container.decode(video=0)) is not None
    assert cv2.imread(str(tmp_path / "still.png")).shape == (480, 640, 3)


BEEPS_AND_FLASHES = """() => {
  const canvas = Object.assign(document.createElement("canvas"), {width: 320, height: 240});
  const picture = canvas.getContext("2d"), sound = new AudioContext();
  const tone = new OscillatorNode(sound), loudness = new GainNode(sound, {gain: 0});
  const heard = new MediaStreamAudioDestinationNode(sound);
  tone.connect(loudness).connect(heard);
  tone.start();
  let drawn = 0;
  setInterval(() => {
    const on = sound.currentTime % 1 < 0.4;
    loudness.gain.value = on ? 0.5 : 0;
    picture.fillStyle = on ? "#fff" : "#222";
    picture.fillRect(0, 0, 320, 240);
    picture.fillStyle = "#888";
    picture.fillRect(drawn++ % 300, 0, 9, 9);
  }, 66);
  const tracks = [...canvas.captureStream(15).getTracks(), ...heard.stream.getTracks()];
  navigator.mediaDevices.getUserMedia = async () => new MediaStream(tracks);
}"""


def rises(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, 2) times between which values rise through the middle of their range."""
    high = values > (values.min() + values.max()) / 2
    return np.column_stack([times[:-1], times[1:]])[high[1:] & ~high[:-1]]


def test_a_recording_has_the_microphones_sound_in_time_with_the_picture(
    chrome: Any, server: StudioServer, tmp_path: Path
) -> None:
    """A page whose camera flashes and whose microphone beeps at the same moments."""
    with visit(chrome, server, "/live") as page:
        page.evaluate(BEEPS_AND_FLASHES)
        choose(page, "Who is at the camera", "Robin")
        page.get_by_role("button", name="Start").click()
        until(page, lambda: read(page, "The result") is not None, "received")
        page.wait_for_timeout(2000)
        page.get_by_role("button", name="Record").click()
        page.wait_for_timeout(6000)
        with page.expect_download(timeout=TIMEOUT_MS) as film:
            page.get_by_role("button", name="Stop recording").click()
        film.value.save_as(tmp_path / "film.mp4")
    with av.open(str(tmp_path / "film.mp4")) as container:
        bright = [(float(f.time or 0), f.to_ndarray(format="gray").mean()) for f in container.decode(video=0)]
    with av.open(str(tmp_path / "film.mp4")) as container:
        loud = [
            (float(f.time or 0) + (k + 0.5) / 200, np.abs(part).max())
            for f in container.decode(audio=0)
            for k, part in enumerate(np.split(f.to_ndarray()[0][:960], 4))
            if f.samples >= 960
        ]
    flashes, beeps = (rises(*np.array(seen).T) for seen in (bright, loud))
    assert len(beeps) >= 4
    away = [np.maximum(before - beeps[:, 1], beeps[:, 0] - after).min() for before, after in flashes]
    assert np.median(away) < 0.15, (flashes, beeps)  # between two pictures nobody knows when it flashed


RESAMPLED = """async () => {
  const sound = new OfflineAudioContext(1, 44100, 44100);
  await sound.audioWorklet.addModule("/static/microphone.js");
  const blocks = new AudioWorkletNode(sound, "blocks", { channelCount: 2, channelCountMode: "explicit" });
  const tone = new OscillatorNode(sound, { frequency: 441 }), found = [];
  blocks.port.onmessage = ({ data }) => found.push([data.position, Array.from(data.block)]);
  tone.connect(blocks).connect(sound.destination);
  tone.start();
  await sound.startRendering();
  await new Promise((done) => setTimeout(done, 500));
  return found;
}"""


def test_a_microphone_of_another_rate_is_heard_at_its_pitch_and_time(
    chrome: Any, server: StudioServer
) -> None:
    """As in Firefox, where a context has the rate of the microphone."""
    with visit(chrome, server, "/live") as page:
        blocks = page.evaluate(RESAMPLED)
    assert len(blocks) == 48_000 // 1024
    for position, block in blocks:
        left, right = np.array(block).reshape(-1, 2).T
        at = (position + np.arange(len(left))) / 48_000
        expected = np.sin(2 * np.pi * 441 * at)
        np.testing.assert_array_equal(left, right)
        assert np.corrcoef(left, expected)[0, 1] > 0.98


def test_a_newcomer_is_shown_another_face_than_their_own(browser: Any, server: StudioServer) -> None:  # noqa: F811
    """Who is at the camera is the first one of the gallery."""
    with visit(browser, server, "/live") as page:
        faces = page.get_by_role("group", name="Face to show")
        choose(page, "Who is at the camera", "Robin")
        go_live(page)
        pressed = faces.locator("[aria-pressed=true]")
        assert pressed.count() == 1
        until(page, lambda: pressed.get_attribute("aria-label") != "Luca (fictional)", "shown as another")
        shown = pressed.get_attribute("aria-label")
        assert shown != "Robin"
        faces.get_by_role("button", name="Robin").click()  # their own face: it is asked for in words
        question = page.get_by_role("alertdialog")
        assert question.inner_text().startswith("Robin is somebody who may be at the camera.")
        question.get_by_role("button", name="Keep it hidden").click()
        question.wait_for(state="detached")
        until(page, lambda: pressed.get_attribute("aria-label") == shown, "kept hidden")
        faces.get_by_role("button", name="Robin").click()
        question.get_by_role("button", name="Show this face").click()
        faces.get_by_role("button", name="Robin", pressed=True).wait_for()
        page.locator("body").press("3")  # whoever has been enrolled, the fictional faces keep their keys
        faces.get_by_role("button", name="Mei (fictional)", pressed=True).wait_for()


def test_without_a_microphone_the_camera_is_shown_and_recordings_are_silent(
    chrome: Any, server: StudioServer
) -> None:
    with visit(chrome, server, "/live") as page:
        page.evaluate(
            """() => {
              const devices = navigator.mediaDevices, all = devices.getUserMedia.bind(devices);
              devices.getUserMedia = (wanted) =>
                wanted.audio ? Promise.reject(new DOMException("", "NotAllowedError")) : all(wanted);
            }"""
        )
        choose(page, "Who is at the camera", "Robin")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("Recordings have no sound").wait_for(timeout=TIMEOUT_MS)
        until(page, lambda: read(page, "The result") is not None, "received")


def test_a_microphone_that_gives_nothing_is_told_of_and_holds_up_no_recording(
    chrome: Any, server: StudioServer
) -> None:
    with visit(chrome, server, "/live") as page:
        page.evaluate("AudioContext.prototype.createMediaStreamSource = () => ({ connect() {} })")
        choose(page, "Who is at the camera", "Robin")
        page.get_by_role("button", name="Start").click()
        until(page, lambda: read(page, "The result") is not None, "received")
        page.get_by_role("button", name="Record").click()
        page.get_by_text("the microphone gives none").wait_for()
        page.get_by_role("button", name="Stop recording").wait_for()


def test_the_first_use_begins_with_enrolment_and_sends_nothing_bare(
    chrome: Any, server: StudioServer, regions: tuple[np.ndarray, np.ndarray]
) -> None:
    with visit(chrome, server, "/live") as page:
        choose(page, "Who is at the camera", "Enroll me")
        page.get_by_role("button", name="Start").click()
        until(
            page,
            lambda: "Look at the camera" in page.get_by_role("status").first.inner_text(),
            "asked to look",
        )
        until(page, lambda: read(page, "The result") is not None, "received")
        sent, shown = read(page, "Your camera"), result(page)
        assert sent is not None
        assert page.get_by_label("Enrollment").is_visible()
        until(page, lambda: over_face(page, regions[0]), "drawn over the person's own picture")
        assert alike(sent, sent[:, ::1], regions[0]) > 0.99
        assert alike(sent, shown, regions[0]) < 0.6
        assert re.fullmatch(r"\d+ s left.*", page.get_by_text("s left").inner_text())
        until(page, lambda: alike(sent, result(page), regions[1]) > 0.8, "shown with the background")
        assert alike(sent, result(page), regions[0]) < 0.6
        assert page.get_by_label("Enrollment").is_visible()
        choose(page, "Who is at the camera", "Robin")
        until(page, lambda: page.get_by_role("status").first.inner_text() == "", "swapped")


def over_face(page: Any, face: np.ndarray) -> bool:
    """Whether lines over the camera's picture lie about where the face is."""
    path = page.locator("svg path[stroke]").first.get_attribute("d") or ""
    points = np.array(re.findall(r"([\d.]+),([\d.]+)", path), np.float64).reshape(-1, 2)
    return len(points) > 100 and bool(face[np.rint(points.mean(0)).astype(int)[1], int(points[:, 0].mean())])


def alike(a: np.ndarray, b: np.ndarray, where: np.ndarray) -> float:
    """Correlation of the fine detail in a region."""
    fine = [(v - cv2.GaussianBlur(v, (0, 0), 2.0))[where].ravel() for v in (a, b)]
    return float(np.corrcoef(*fine)[0, 1])


def test_somebody_else_is_offered_an_enrolment(browser: Any, server: StudioServer) -> None:  # noqa: F811
    """A clip of another person stands in for the camera; who is thought to be there is Robin."""
    store_clip = SAMPLES / "p06" / "talk.mp4"
    with visit(browser, server, "/people") as page:
        page.locator("input[type=file]").first.set_input_files(str(store_clip))
        page.get_by_text("Your clips").wait_for()
        page.goto(server.url("/live"))
        choose(page, "Camera", "The clip talk")
        choose(page, "Who is at the camera", "Robin")
        page.get_by_role("button", name="Start").click()
        page.get_by_role("button", name="Not Robin? Enroll me").click(timeout=TIMEOUT_MS)
        until(page, lambda: "covered" not in page.get_by_role("status").first.inner_text(), "enrolling")
        page.get_by_label("Enrollment").wait_for()


def test_a_camera_that_is_not_allowed_is_one_sentence(chrome: Any, server: StudioServer) -> None:
    with visit(chrome, server, "/live") as page:
        page.evaluate(
            """() => {
              navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException("", "NotAllowedError"));
            }"""
        )
        page.get_by_role("button", name="Start").click()
        page.get_by_text("allow it next to the address bar").wait_for(timeout=TIMEOUT_MS)
        assert page.get_by_role("button", name="Start").is_enabled()


def test_a_browser_without_streams_of_pictures_shows_the_result_too(
    chrome: Any, server: StudioServer, regions: tuple[np.ndarray, np.ndarray]
) -> None:
    """As in Firefox and Safari."""
    with visit(chrome, server, "/live") as page:
        page.evaluate("delete window.MediaStreamTrackProcessor; delete window.MediaStreamTrackGenerator")
        choose(page, "Who is at the camera", "Robin")
        go_live(page)
        sent = read(page, "Your camera")
        assert sent is not None
        until(
            page, lambda: difference(result(page), sent, regions[1]) < 6, "with the background as it was sent"
        )


def test_a_browser_that_is_too_old_is_one_sentence(chrome: Any, server: StudioServer) -> None:
    with visit(chrome, server, "/live") as page:
        page.evaluate("delete window.VideoFrame")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("too old to send pictures").wait_for(timeout=TIMEOUT_MS)
        assert page.evaluate("document.querySelector('video').srcObject") is None


@pytest.mark.skipif(Path("/dev/video0").exists(), reason="this computer has a camera")
def test_a_computer_without_a_camera_is_one_sentence(chrome: Any, server: StudioServer) -> None:
    with visit(chrome, server, "/live") as page:
        choose(page, "Camera", "The computer's camera")
        page.get_by_role("button", name="Start").click()
        page.get_by_text("the computer's camera cannot be opened").wait_for(timeout=TIMEOUT_MS)
        page.get_by_role("button", name="Start").wait_for(timeout=TIMEOUT_MS)


def test_the_moving_picture_of_the_readme_can_be_filmed(
    chrome: Any, server: StudioServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(studio_picture, "SECONDS_PER_FACE", 1.0)
    with visit(chrome, server, "/live", viewport=studio_picture.VIEW) as page:
        shots = studio_picture.film_live(page, fps=5.0)
        pressed = page.get_by_role("group", name="Face to show").locator("[aria-pressed=true]")
        assert pressed.get_attribute("aria-label") == studio_picture.FACES[-1]
        result = page.get_by_label("The result", exact=True).bounding_box()
    assert len(shots) == 5 * len(studio_picture.FACES)
    x, y, width, height = (int(result[side]) for side in ("x", "y", "width", "height"))
    one, other = (shot[y : y + height, x : x + width].astype(float) for shot in (shots[4], shots[-1]))
    assert np.abs(one - other).mean() > 0.5  # the camera shows one frame all the time: the face has changed


WIDE = """() => {
  const canvas = Object.assign(document.createElement("canvas"), {width: 1280, height: 720});
  const picture = canvas.getContext("2d");
  let drawn = 0;
  setInterval(() => picture.fillRect(drawn++ % 1270, 0, 9, 9), 100);
  navigator.mediaDevices.getUserMedia = async (wanted) => {
    window.wanted = wanted.video;
    return new MediaStream(canvas.captureStream(10).getTracks());
  };
}"""


def test_a_wide_picture_stays_wide_and_fills_a_window_of_its_own(chrome: Any, server: StudioServer) -> None:
    with visit(chrome, server, "/live") as page:
        page.evaluate(WIDE)
        page.get_by_role("switch", name="Microphone").click()
        page.get_by_role("button", name="Start").click()
        until(page, lambda: read(page, "The result") is not None, "received")
        assert result(page).shape == (480, 854, 3)
        assert page.evaluate("wanted.height.ideal") == 480
        assert "width" not in page.evaluate("wanted")
        with page.expect_popup() as popped:
            page.get_by_role("button", name="Pop out").click()
        assert popped.value.title() == "Guise result"
        width = "document.querySelector('video').videoWidth"
        until(page, lambda: popped.value.evaluate(width) == 854, "shown in the other window")
        popped.value.close()
        page.get_by_role("button", name="Full screen").click()
        until(page, lambda: page.evaluate("document.fullscreenElement !== null"), "in full screen")


def test_on_a_phone_the_camera_is_an_inset_and_nothing_is_cut_off(chrome: Any, server: StudioServer) -> None:
    with visit(chrome, server, "/live", viewport={"width": 360, "height": 740}) as page:
        choose(page, "Who is at the camera", "Robin")
        go_live(page)
        own, whole = (
            page.get_by_label(name, exact=True).bounding_box() for name in ("Your camera", "The result")
        )
        assert own["width"] < whole["width"] / 3
        assert whole["x"] < own["x"] < own["x"] + own["width"] < whole["x"] + whole["width"]
        assert whole["y"] < own["y"] < own["y"] + own["height"] < whole["y"] + whole["height"]
        assert page.evaluate("document.documentElement.scrollWidth") <= 360


def test_the_studio_ends_at_once_while_somebody_is_live(chrome: Any, server: StudioServer) -> None:
    page = chrome.new_page()
    page.goto(server.url(f"/live?token={server.token}"))
    choose(page, "Who is at the camera", "Robin")
    go_live(page)
    assert server.stop() == 0
    page.close()
