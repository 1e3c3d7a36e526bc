"""Streams from the network: the newest picture, back after an interruption, one sentence when nothing comes."""

from __future__ import annotations

import contextlib
import http.server
import itertools
import socket
import threading
import time
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

from guise.app.live import capture as captures
from guise.app.live.capture import CameraCapture
from guise.app.live.streams import StreamCapture
from guise.app.media import Frame, MediaError

SIZE = (160, 120)
BITS = 10


def numbered(number: int, size: tuple[int, int] = SIZE) -> av.VideoFrame:
    """A picture that shows its number as white and black columns, the least bit first."""
    bits = (number >> np.arange(BITS)) & 1
    row = np.repeat(bits * 235, size[0] // BITS).astype(np.uint8)
    return av.VideoFrame.from_ndarray(np.broadcast_to(row[:, None], (size[1], size[0], 3)).copy(), "rgb24")


def number_in(frame: Frame) -> int:
    row = frame.luma[frame.height // 2].reshape(BITS, -1).mean(1)
    return int(((row > 128) << np.arange(BITS)).sum())


def send(
    where: Any, numbers: Iterable[int], stop: threading.Event, fps: float = 50, size: tuple[int, int] = SIZE
) -> None:
    """Send numbered pictures as MPEG-TS, a keyframe in every ten, at the pace of a camera."""
    with av.open(where, "w", format="mpegts") as out:
        stream = out.add_stream(
            "libx264", round(fps), {"preset": "ultrafast", "tune": "zerolatency", "g": "10"}
        )
        stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        start = time.perf_counter()
        for count, number in enumerate(numbers):
            frame = numbered(number, size)
            frame.pts, frame.time_base = count, Fraction(1, round(fps))
            out.mux(stream.encode(frame))
            if stop.wait(max(0.0, start + count / fps - time.perf_counter())):
                return
        out.mux(stream.encode(None))


class Pipe:
    """What can be written to and nothing else."""

    def __init__(self, file: Any) -> None:
        self.write = file.write


class Server:
    """A web server on this computer; each connection gets the next of some answers."""

    def __init__(self, *answers: Any) -> None:
        self.answers, self.stop = list(answers), threading.Event()
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                answer = outer.answers.pop(0) if outer.answers else 404
                if isinstance(answer, int):
                    self.send_error(answer)
                    return
                self.send_response(200)
                if isinstance(answer, bytes):
                    self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                with contextlib.suppress(OSError, av.error.FFmpegError):
                    self.wfile.write(answer) if isinstance(answer, bytes) else answer(
                        Pipe(self.wfile), outer.stop
                    )

            def log_message(self, *_: object) -> None:
                pass

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = False
        self.url = f"http://127.0.0.1:{self._server.server_port}/camera"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def pictures(numbers: Iterable[int], **how: Any) -> Any:
    return lambda where, stop: send(where, numbers, stop, **how)


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pause between two tries is short."""
    monkeypatch.setattr(captures, "RECONNECT_SECONDS", 0.05)


@pytest.fixture
def port() -> int:
    """A free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def udp_camera(port: int, numbers: range) -> Iterator[None]:
    stop = threading.Event()
    where = f"udp://127.0.0.1:{port}?pkt_size=1316"
    thread = threading.Thread(target=send, args=(where, numbers, stop))
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.usefixtures("no_thread_left")
def test_a_stream_that_is_interrupted_is_waited_for_and_comes_back() -> None:
    said: list[str] = []
    answers = [pictures(range(0, 15)), 404, pictures(range(100, 115)), pictures(range(200, 500))]
    with Server(*answers) as server, StreamCapture(server.url, said.append, timeout=5) as capture:
        assert (capture.width, capture.height, capture.name) == (*SIZE, server.url)
        seen, times = [], []
        for frame in capture:
            seen.append(number_in(frame))
            times.append(frame.pts * frame.time_base)
            if seen[-1] >= 205:
                capture.stop()
    assert said == [f"{server.url} has stopped sending pictures; waiting for it", f"{server.url} is back"] * 2
    assert seen == sorted(set(seen))
    assert {0, 14, 100, 114, 200} <= set(seen)
    assert all(a < b for a, b in itertools.pairwise(times))


@pytest.mark.usefixtures("no_thread_left")
def test_a_camera_that_sends_datagrams_is_unplugged_and_back(port: int) -> None:
    said: list[str] = []
    with contextlib.ExitStack() as plugs:
        plugged = plugs.enter_context(contextlib.ExitStack())
        plugged.enter_context(udp_camera(port, range(0, 500)))

        def say(sentence: str) -> None:
            said.append(sentence)
            if "waiting" in sentence:
                plugs.enter_context(udp_camera(port, range(500, 1000)))

        with StreamCapture(f"udp://127.0.0.1:{port}", say, timeout=1.5) as capture:
            seen = []
            for frame in capture:
                seen.append(number_in(frame))
                if len(seen) == 5:
                    plugged.close()
                if seen[-1] >= 500:
                    capture.stop()
    name = f"udp://127.0.0.1:{port}"
    assert said == [f"{name} has stopped sending pictures; waiting for it", f"{name} is back"]
    assert seen == sorted(seen)


@pytest.mark.usefixtures("no_thread_left")
def test_pictures_keep_the_size_that_they_had_before_the_interruption() -> None:
    answers = [pictures(range(0, 10)), pictures(range(100, 200), size=(320, 240))]
    with Server(*answers) as server, StreamCapture(server.url, lambda _: None) as capture:
        sizes = set()
        for frame in capture:
            sizes.add((frame.width, frame.height))
            if number_in(frame) >= 105:
                capture.stop()
    assert sizes == {SIZE}


@pytest.mark.usefixtures("no_thread_left")
def test_what_is_too_slow_for_a_stream_gets_its_newest_pictures() -> None:
    """Three times slower than the camera: without care, two of three pictures would lie in wait."""
    sent = [0]

    def counted() -> Iterator[int]:
        for sent[0] in range(1000):
            yield sent[0]

    with Server(pictures(counted())) as server, StreamCapture(server.url, lambda _: None) as capture:
        seen, behind = [], []
        for frame in capture:
            seen.append(number_in(frame))
            behind.append(sent[0] - seen[-1])
            time.sleep(3 / 50)
            if seen[-1] >= 250:
                capture.stop()
    assert seen == sorted(set(seen))
    assert max(behind) < 100  # of the 167 that waiting would have made by now


@pytest.mark.usefixtures("no_thread_left")
@pytest.mark.parametrize("suffix", ["mp4", "mkv"])
def test_a_file_on_a_server_is_played_once_at_its_own_pace(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"clip.{suffix}"
    with av.open(
        str(path), "w", container_options={"movflags": "faststart"} if suffix == "mp4" else {}
    ) as out:
        stream = out.add_stream("libx264", 25, {"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        for number in range(15):
            out.mux(stream.encode(numbered(number)))
        out.mux(stream.encode(None))
    said: list[str] = []
    with Server(path.read_bytes()) as server, StreamCapture(server.url, said.append) as capture:
        begun = time.perf_counter()
        seen = [number_in(frame) for frame in capture]
    assert seen == list(range(15))
    assert time.perf_counter() - begun >= 14 / 25
    assert said == []


@pytest.mark.usefixtures("no_thread_left")
def test_waiting_for_a_stream_can_be_stopped() -> None:
    waiting = threading.Event()
    with (
        Server(pictures(range(0, 10))) as server,
        StreamCapture(server.url, lambda sentence: waiting.set()) as capture,
    ):
        taker = threading.Thread(target=lambda: [None for _ in capture])
        taker.start()
        assert waiting.wait(30)
        capture.stop()
        taker.join(30)
        assert not taker.is_alive()


# -- nothing comes ------------------------------------------------------------------------------------------


def refused(match: str, url: str) -> None:
    with pytest.raises(MediaError, match=match) as caught:
        StreamCapture(url, timeout=0.3)
    text = str(caught.value)
    assert text.endswith(".")
    assert "\n" not in text
    assert "secret" not in text


@pytest.mark.usefixtures("no_thread_left")
def test_an_address_that_does_not_answer_is_one_sentence(port: int) -> None:
    with socket.socket() as taken:  # bound, and does not listen
        taken.bind(("127.0.0.1", 0))
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        for protocol in ("http", "rtsp", "rtmp"):
            refused(
                rf"{protocol}://{where}/door cannot be played \(Connection refused\): check the address",
                f"{protocol}://me:secret@{where}/door?token=secret",
            )
    refused(r"udp://127.0.0.1:\d+ cannot be played \(no data arrives\)", f"udp://127.0.0.1:{port}")


@pytest.mark.usefixtures("no_thread_left")
def test_a_server_that_is_silent_is_given_up() -> None:
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        refused(r"cannot be played \(no data arrives\)", f"http://127.0.0.1:{silent.getsockname()[1]}/")


@pytest.mark.usefixtures("no_thread_left")
def test_what_is_no_stream_is_said() -> None:
    with Server(404, b"<html>Welcome</html>") as server:
        refused(r"cannot be played \(.*404", server.url)
        refused(r"cannot be played \(Invalid data", server.url)
    refused("is not the address of a stream: it must begin with rtsp,", "gopher://example.org/1")


def test_a_playlist_on_the_network_cannot_open_files_of_this_computer(tmp_path: Path) -> None:
    (tmp_path / "private.ts").write_bytes(b"G" * 188 * 20)
    playlist = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile://{}\n#EXT-X-ENDLIST\n"
    with Server(playlist.format(tmp_path / "private.ts").encode()) as server:
        refused("cannot be played|has no pictures|ended before", server.url + ".m3u8")


class _Camera:
    """A camera of OpenCV that gives two pictures each time it is plugged in; it is not found at the second try."""

    opened = 0

    def __init__(self, index: int) -> None:
        _Camera.opened += 1
        self._left = 0 if _Camera.opened == 2 else 2

    def isOpened(self) -> bool:
        return self._left > 0

    def read(self) -> tuple[bool, np.ndarray | None]:
        self._left -= 1
        return (True, np.full((48, 64, 3), (10, 20, 30), np.uint8)) if self._left >= 0 else (False, None)

    def get(self, name: int) -> float:
        return {cv2.CAP_PROP_FRAME_WIDTH: 64.0, cv2.CAP_PROP_FRAME_HEIGHT: 48.0}[name]

    def set(self, name: int, value: float) -> None: ...

    def release(self) -> None: ...


def test_an_unplugged_camera_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(captures, "RECONNECT_SECONDS", 0.01)
    monkeypatch.setattr(captures.cv2, "VideoCapture", _Camera)
    said: list[str] = []
    with CameraCapture(7, say=said.append) as capture:
        assert (capture.width, capture.height) == (64, 48)
        frames = list(itertools.islice(capture, 3))
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert frames[0].pts < frames[1].pts < frames[2].pts
    assert frames[2].rgb()[0, 0].tolist() == [30, 20, 10]
    assert said == ["camera 7 has stopped sending pictures; waiting for it", "camera 7 is back"]
