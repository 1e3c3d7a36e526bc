"""The window on a real X display (Xvfb): what is seen on the screen is the picture, and keys do what they say."""

import ctypes
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from fractions import Fraction
from importlib.util import find_spec
from types import ModuleType

import cv2
import numpy as np
import pytest
from made_up import SAMPLES

from guise.app.live.controls import Controls
from guise.app.live.face import FaceResult
from guise.app.live.output import OutputFrame
from guise.app.live.overlay import Overlay
from guise.app.live.stats import PipelineStats
from guise.app.live.window import Window
from guise.app.media import Frame, open_input
from guise.app.media.orientation import AS_STORED, Orientation
from guise.common.errors import OutputError
from guise.render import create_context, make_compositor

pytestmark = [
    pytest.mark.egl,
    pytest.mark.filterwarnings("ignore:Importing PyGLM:PendingDeprecationWarning"),
]

SCREEN = 900, 700
SIZE = 320, 240


def without(reason: str) -> None:
    if os.environ.get("GUISE_REQUIRE_WINDOW") == "1":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


@pytest.fixture(scope="module")
def screen() -> Iterator[str]:
    """A display of its own, such as ":5", with nothing on it."""
    if shutil.which("Xvfb") is None:
        without("the window is tested on Xvfb, which is not installed")
    read, write = os.pipe()
    size = f"{SCREEN[0]}x{SCREEN[1]}x24"
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", size, "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    yield f":{number}"
    server.terminate()
    server.wait()


@pytest.fixture
def display(screen: str, monkeypatch: pytest.MonkeyPatch) -> str:
    if find_spec("glfw") is None or find_spec("moderngl_window") is None:
        without('the window needs pip install "guise-video[window]"')
    monkeypatch.setenv("DISPLAY", screen)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("PYGLFW_LIBRARY_VARIANT", "x11")
    return screen


@pytest.fixture
def window(display: str) -> Iterator[Window]:
    window = Window(Controls(3), Overlay(["p01", "p02", "p03"]))
    window.open(*SIZE, 30)
    yield window
    window.close()


@pytest.fixture(scope="module")
def talk() -> Frame:
    """The first picture of a sample clip, half as large."""
    with open_input(SAMPLES / "p01" / "talk.mp4") as source:
        video = next(iter(source)).video_frame
    return Frame(video.reformat(*SIZE), pts=0, time_base=Fraction(1, 30), index=0)


def shown(frame: Frame, arrived: float = 0.0, **others: object) -> OutputFrame:
    outcome = others.pop("outcome", "swapped")
    return OutputFrame(frame, FaceResult(outcome), PipelineStats(), arrived, **others)


def show(window: Window, picture: OutputFrame) -> None:
    """Show it, long after the settings have changed, so that nothing is written on it."""
    for later in (0.0, 60.0):
        window.show(OutputFrame(**{**vars(picture), "arrived": picture.arrived + later}))


def on_screen(display: str) -> np.ndarray:
    """RGB (h, w, 3) of the screen."""
    from PIL import ImageGrab

    return np.asarray(ImageGrab.grab(xdisplay=display).convert("RGB"))


def seen(display: str, width: int = SIZE[0], height: int = SIZE[1]) -> np.ndarray:
    """What the window shows, as integers: without a window manager it lies in the corner."""
    return on_screen(display)[:height, :width].astype(int)


def settle(window: Window, done: Callable[[], bool], seconds: float = 10.0) -> bool:
    """Pump until it is done."""
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        assert window.pump()
        time.sleep(0.01)
    return done()


class Keyboard:
    """A keyboard and a mouse of the display, through XTest."""

    def __init__(self, display: str) -> None:
        self._x, self._test = (ctypes.CDLL(name) for name in ("libX11.so.6", "libXtst.so.6"))
        self._x.XOpenDisplay.restype = ctypes.c_void_p
        self._handle = ctypes.c_void_p(self._x.XOpenDisplay(display.encode()))

    def point(self, x: int, y: int) -> None:
        """Move the mouse; keys go to the window below it."""
        self._test.XTestFakeMotionEvent(self._handle, -1, x, y, 0)
        self._x.XSync(self._handle, 0)

    def press(self, *names: str) -> None:
        """Press keys, by their X names, one after the other, and release them in the other order."""
        codes = [
            self._x.XKeysymToKeycode(self._handle, self._x.XStringToKeysym(name.encode())) for name in names
        ]
        for code, down in [*((code, 1) for code in codes), *((code, 0) for code in codes[::-1])]:
            self._test.XTestFakeKeyEvent(self._handle, code, down, 0)
        self._x.XSync(self._handle, 0)

    def close(self) -> None:
        self._x.XCloseDisplay(self._handle)


@pytest.fixture
def keyboard(display: str, window: Window, talk: Frame) -> Iterator[Keyboard]:
    try:
        keyboard = Keyboard(display)
    except OSError as error:
        without(f"keys are pressed through XTest: {error}")
    keyboard.point(100, 100)
    window.show(shown(talk))
    window.pump()
    yield keyboard
    keyboard.close()


PICTURES = {
    "stored": ("yuv420p", AS_STORED),
    "full-range": ("yuvj422p", AS_STORED),
    "chroma-of-every-pixel": ("yuv444p", AS_STORED),
    "chroma-in-pairs": ("nv12", AS_STORED),
    "grey": ("gray", AS_STORED),
    "mirrored": ("yuv420p", Orientation(flip_x=True)),
    "turned": ("yuv420p", Orientation(transpose=True, flip_x=True)),
    "upside-down": ("yuv420p", Orientation(flip_x=True, flip_y=True)),
}


@pytest.mark.parametrize(("format", "orientation"), PICTURES.values(), ids=PICTURES)
@pytest.mark.slow
def test_the_screen_shows_the_frames_own_rgb(
    display: str, talk: Frame, format: str, orientation: Orientation
) -> None:
    """Whatever its planes and however it is turned, to the rounding of the last bit."""
    video = talk.video_frame.reformat(format=format)
    frame = Frame(video, pts=0, time_base=Fraction(1, 30), index=0, orientation=orientation)
    window = Window(Controls(), Overlay(["p01"]))
    window.open(frame.width, frame.height, 30)
    show(window, shown(frame))
    picture = seen(display, frame.width, frame.height)
    window.close()
    assert np.abs(picture - frame.rgb()).max() <= 2


def test_an_rgb_picture_and_other_tags(window: Window, display: str, talk: Frame) -> None:
    """Pictures without planes, and another matrix and range, in one window one after the other."""
    rgb = Frame.from_rgb(talk.rgb()[:, ::-1])
    video = talk.copy().video_frame
    video.colorspace, video.color_range = 1, 2  # BT.709, full
    tagged = Frame(video, pts=0, time_base=Fraction(1, 30), index=0)
    assert np.abs(tagged.rgb().astype(int) - talk.rgb()).max() > 10
    for frame in (rgb, tagged, talk):
        show(window, shown(frame))
        assert np.abs(seen(display) - frame.rgb()).max() <= 2


def test_the_mirror_leaves_letters_readable(window: Window, display: str, talk: Frame) -> None:
    window._controls.change(mirror=True)
    show(window, shown(talk))
    assert np.abs(seen(display) - talk.rgb()[:, ::-1]).max() <= 2
    window.show(shown(talk, message="abc"))
    written = np.abs(seen(display) - talk.rgb()[:, ::-1])[200:].max(2)
    window._controls.change(mirror=False)
    window.show(shown(talk, message="abc"))
    plain = np.abs(seen(display) - talk.rgb())[200:].max(2)
    assert plain.max() > 100
    assert np.corrcoef(written.ravel(), plain.ravel())[0, 1] > 0.7


def test_a_resized_window_keeps_the_proportions(window: Window, display: str, talk: Frame) -> None:
    """Without a new picture, too; the rest is black."""
    show(window, shown(talk))
    window._window.size = 800, 480
    assert settle(
        window, lambda: window._window.buffer_size == (800, 480) and seen(display, 800, 480)[470, 400].any()
    )
    picture = seen(display, 800, 480)
    assert picture[:, :79].max() == picture[:, 721:].max() == 0
    smooth, blocky = (
        np.abs(picture[:, 80:720] - cv2.resize(talk.rgb(), (640, 480), interpolation=how)).mean()
        for how in (cv2.INTER_LINEAR, cv2.INTER_NEAREST)
    )
    assert smooth < 1
    assert smooth < 0.7 * blocky


def test_the_real_face_is_shown_only_when_the_user_asks(window: Window, display: str, talk: Frame) -> None:
    result = Frame.from_rgb(255 - talk.rgb())
    both = shown(result, original=talk)
    show(window, both)
    assert np.abs(seen(display) - result.rgb()).max() <= 2
    window._controls.press("b")
    show(window, both)
    halves = [cv2.resize(frame.rgb(), (160, 120), interpolation=cv2.INTER_AREA) for frame in (talk, result)]
    picture = seen(display)
    assert picture[:60].max() == picture[180:].max() == 0
    assert np.abs(picture[60:180] - np.concatenate(halves, axis=1)).mean() < 4
    window._controls.press("m")
    show(window, both)
    mirrored_halves = np.concatenate([half[:, ::-1] for half in halves], axis=1)
    assert np.abs(seen(display)[60:180] - mirrored_halves).mean() < 4


def test_enrolment_shows_the_person_to_themselves_in_a_corner(
    window: Window, display: str, talk: Frame
) -> None:
    covered = Frame.from_rgb(np.zeros((SIZE[1], SIZE[0], 3), np.uint8))
    show(window, shown(covered, outcome="enrolling", original=talk, ring=0.0))
    corner = seen(display)[-SIZE[1] // 3 :, -SIZE[0] // 3 :]
    own = cv2.resize(talk.rgb(), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    match = cv2.matchTemplate(corner.astype(np.uint8), own, cv2.TM_CCOEFF_NORMED)
    assert match.max() > 0.95
    assert np.abs(seen(display)[:60, :60]).max() < 30


def test_keys_change_the_settings(window: Window, keyboard: Keyboard) -> None:
    controls = window._controls
    for key, done in [
        ("m", lambda: controls.settings.mirror),
        ("3", lambda: controls.settings.identity == 2),
        ("KP_2", lambda: controls.settings.identity == 1),
        ("Up", lambda: controls.settings.alpha == pytest.approx(0.7)),
        ("o", lambda: controls.settings.mode == "off"),
        ("h", lambda: controls.settings.help),
    ]:
        keyboard.press(key)
        assert settle(window, done), key


def test_shortcuts_of_the_desktop_change_nothing(window: Window, keyboard: Keyboard) -> None:
    keyboard.press("Control_L", "m")
    keyboard.press("Alt_L", "o")
    keyboard.press("h")
    assert settle(window, lambda: window._controls.settings.help)
    assert not window._controls.settings.mirror
    assert window._controls.settings.mode == "swap"


def test_a_key_that_is_held_counts_once(window: Window, keyboard: Keyboard) -> None:
    glfw = window._glfw
    for action in (glfw.PRESS, glfw.REPEAT, glfw.REPEAT, glfw.RELEASE):
        window._window.glfw_key_event_callback(None, glfw.KEY_M, 0, action, 0)
        window._window.glfw_key_event_callback(None, glfw.KEY_DOWN, 0, action, 0)
    assert window._controls.settings.mirror
    assert window._controls.settings.alpha == pytest.approx(0.3)  # an arrow goes on


def test_letters_are_those_on_the_keyboard(window: Window, monkeypatch: pytest.MonkeyPatch) -> None:
    """French keyboards have a Q where others have an A; in other scripts the place counts."""
    glfw = window._glfw
    names = {glfw.KEY_A: "q", glfw.KEY_S: "ы", glfw.KEY_F1: None}
    monkeypatch.setattr(glfw, "get_key_name", lambda key, scancode: names[key])
    assert [window._name(key) for key in names] == ["q", "s", ""]


def test_full_screen_and_back(window: Window, keyboard: Keyboard, display: str, talk: Frame) -> None:
    """Escape leaves the full screen first, and only then Guise."""
    keyboard.press("F11")
    assert settle(window, lambda: window._window.buffer_size == SCREEN)
    show(window, shown(talk))
    picture = seen(display, *SCREEN)
    assert picture[:12].max() == picture[-12:].max() == 0
    assert picture[20].any()
    keyboard.press("Escape")
    assert settle(window, lambda: window._window.buffer_size == SIZE)
    assert window._controls.requests.empty()
    keyboard.press("Escape")
    assert settle(window, lambda: not window._controls.requests.empty())
    assert window._controls.requests.get() == "quit"


def test_the_user_closes_it(window: Window, talk: Frame) -> None:
    window.show(shown(talk))
    assert window.pump()
    window._glfw.set_window_should_close(window._glfw.get_current_context(), True)
    assert not window.pump()


def test_a_picture_larger_than_the_screen_fits(display: str) -> None:
    window = Window(Controls(), Overlay(["p01"]))
    window.open(1920, 1080, 30)
    wide, high = window._window.size
    window.close()
    assert wide <= SCREEN[0]
    assert high <= SCREEN[1]
    assert wide / high == pytest.approx(16 / 9, abs=0.01)


def test_the_renderer_of_another_thread_goes_on(window: Window, display: str, talk: Frame) -> None:
    """The face is drawn by a context without a window, before, while and after the window draws with its own."""
    corners = np.array([[0, 0], [31, 0], [0, 31], [31, 31]], np.float32)
    triangles = np.array([[0, 1, 2], [1, 3, 2]], np.int32)
    face = np.full((32, 32, 3), 200, np.uint8)
    drawn: list[int] = []
    stop = threading.Event()

    def work() -> None:
        with make_compositor("gl", triangles, corners, np.ones((32, 32), np.float32)) as compositor:
            while not stop.is_set():
                below = np.zeros((32, 32, 3), np.uint8)
                drawn.append(int(compositor.composite(below, face, corners)[16, 16, 0]))

    thread = threading.Thread(target=work)
    thread.start()
    try:
        for count in (1, 20, 40):
            assert settle(window, lambda count=count: len(drawn) >= count or not thread.is_alive())
            show(window, shown(talk))
            assert np.abs(seen(display) - talk.rgb()).max() <= 2
    finally:
        stop.set()
        thread.join()
    assert set(drawn) == {200}


@pytest.mark.usefixtures("no_thread_left")
def test_it_can_be_opened_again(display: str, talk: Frame) -> None:
    """And where a context without a window is current, beside which GLX would end the process."""
    for _ in range(2):
        create_context()
        window = Window(Controls(), Overlay(["p01"]))
        window.open(*SIZE, 30)
        show(window, shown(talk))
        assert np.abs(seen(display) - talk.rgb()).max() <= 2
        window.close()
        window.close()


def test_without_a_display_one_sentence_says_what_to_do(
    display: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY")
    window = Window(Controls(), Overlay(["p01"]))
    with pytest.raises(OutputError) as caught:
        window.open(*SIZE, 30)
    window.close()
    message = str(caught.value)
    assert message.startswith("no window can be opened (")
    assert "DISPLAY" in message
    assert message.endswith("): use a desktop, or choose --output FILE")


@pytest.mark.parametrize("missing", ["glfw", "moderngl_window.context"])
def test_a_missing_extra_is_named(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing: ModuleType | None = None
    monkeypatch.setitem(sys.modules, missing, nothing)
    window = Window(Controls(), Overlay(["p01"]))
    for ask in (window.check, lambda: window.open(*SIZE, 30)):  # before the person is enrolled, too
        with pytest.raises(OutputError, match=r'needs more packages: pip install "guise-video\[window\]"'):
            ask()
    window.close()
