"""The studio's server: who is let in, what is taken, how it starts and ends."""

import asyncio
import base64
import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping
from contextlib import nullcontext
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from studio_browser import LIMIT, StudioServer, studio, studio_server  # noqa: F401

from guise.app.studio.request_guard import GONE, RequestGuard, may_connect, owner_of

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
POLLING = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
NO_TOKEN = "Access needs a token: open the address that guise studio printed in the terminal."
WRONG_ORIGIN = "This request comes from another site: use the studio's own pages."
pytestmark = [pytest.mark.filterwarnings("ignore:unclosed"), pytest.mark.slow]


@pytest.fixture
def server(studio_server: StudioServer) -> StudioServer:  # noqa: F811
    return studio_server


def ask(
    server: StudioServer, path: str, method: str = "GET", *, cookie: bool = True, body: object = None, **headers: str
) -> tuple[int, Mapping[str, str], str]:  # fmt: skip
    """Status, headers and text of an answer; `headers` by name, with underscores."""
    connection = HTTPConnection("127.0.0.1", server.port, timeout=30)
    given = {name.replace("_", "-"): value for name, value in headers.items()}
    if cookie:
        given["Cookie"] = server.cookie
    connection.request(method, path, body=body, headers=given, encode_chunked="Transfer-Encoding" in given)
    answer = connection.getresponse()
    text = "" if answer.status == 101 else answer.read().decode()
    connection.close()
    return answer.status, answer.headers, text


def upgrade(
    server: StudioServer, *, cookie: bool = True, **headers: str
) -> tuple[int, Mapping[str, str], str]:
    """The answer to the opening of a websocket."""
    key = base64.b64encode(os.urandom(16)).decode()
    return ask(
        server, SOCKET, cookie=cookie, Connection="Upgrade", Upgrade="websocket", Sec_WebSocket_Key=key,
        Sec_WebSocket_Version="13", **headers,
    )  # fmt: skip


def own(server: StudioServer) -> str:
    return f"http://127.0.0.1:{server.port}"


@pytest.mark.parametrize(
    "path", ["/", "/people", "/files/clips/x.mp4", "/gallery/p01.png", POLLING, "/nowhere"]
)
def test_nothing_is_shown_without_the_token(server: StudioServer, path: str) -> None:
    assert ask(server, path, cookie=False)[::2] == (403, NO_TOKEN)
    wrong = f"guise_{server.port}={'x' * len(server.token)}"
    assert ask(server, path, cookie=False, Cookie=wrong)[::2] == (403, NO_TOKEN)
    assert ask(server, f"{path}{'&' if '?' in path else '?'}token=%C3%A9%00", cookie=False)[0] == 403


def test_the_token_becomes_a_cookie_and_leaves_the_address(server: StudioServer) -> None:
    status, headers, _ = ask(server, f"/people?token={server.token}", cookie=False)
    assert (status, headers["Location"]) == (303, "/people")
    name, *flags = headers["Set-Cookie"].split("; ")
    assert name == server.cookie
    assert server.token not in headers["Set-Cookie"]
    assert {flag.lower() for flag in flags} == {"httponly", "path=/", "samesite=strict"}
    assert ask(server, "/people")[0] == 200


def test_the_cookie_is_no_token_and_the_token_no_cookie(server: StudioServer) -> None:
    """Every port of this computer is sent the cookie."""
    session = server.cookie.split("=")[1]
    assert ask(server, f"/people?token={session}", cookie=False)[::2] == (403, NO_TOKEN)
    as_cookie = f"guise_{server.port}={server.token}"
    assert ask(server, "/people", cookie=False, Cookie=as_cookie)[::2] == (403, NO_TOKEN)


def test_a_connection_is_known_by_its_user(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        with socket.create_connection(listener.getsockname()) as client, listener.accept()[0]:
            ends = client.getsockname(), listener.getsockname()
            assert owner_of(*ends) == os.getuid()
            client.close()
            assert owner_of(*ends) == GONE
        with socket.create_connection(listener.getsockname()) as client:
            ends = client.getsockname(), listener.getsockname()
            with listener.accept()[0]:
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                client.close()  # at once, without a trace
                assert owner_of(*ends) == GONE


def test_where_the_kernel_is_not_asked_the_table_tells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(socket, "AF_NETLINK", raising=False)
    table = tmp_path / "tcp"
    table.write_text(
        "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n"
        "   0: 0100007F:1F90 0100007F:C350 01 00000000:00000000 00:00000000 00000000  1001 0 4711 1\n"
        "   1: 0100007F:1F92 0100007F:C350 04 00000000:00000000 00:00000000 00000000     0 0 0 1\n"
        "   2: 0100007F:C350 0100007F:1F93 01 00000000:00000000 00:00000000 00000000  1000 0 4712 1\n"
    )
    server = "127.0.0.1", 50_000
    assert owner_of(("127.0.0.1", 8080), server, table) == 1001
    assert owner_of(("127.0.0.1", 8082), server, table) == GONE
    assert owner_of(("127.0.0.1", 8081), server, table) == GONE
    assert owner_of(("127.0.0.1", 8083), server, table) is None  # of another network namespace
    assert owner_of(None, None, tmp_path / "none") is None


def test_no_header_says_who_has_connected() -> None:
    """It would be taken for the connection of whatever port it names."""
    clients = []

    async def app(scope: Any, receive: Any, send: Any) -> None:
        clients.append(scope["client"])

    from guise.app.studio.server import configuration

    config = configuration(app)
    config.load()
    headers = [(b"x-forwarded-for", b"127.0.0.1:4711")]
    client = "127.0.0.1", 50_000
    asyncio.run(config.loaded_app({"type": "http", "client": client, "headers": headers}, None, None))  # type: ignore[arg-type]
    assert clients == [client]


@pytest.mark.parametrize(
    ("owner", "user", "may"),
    [(1000, 1000, True), (1001, 1000, False), (0, 1000, True), (None, 1000, True), (GONE, 1000, False)],
)
def test_another_users_program_is_refused(owner: int | None, user: int, may: bool) -> None:
    assert may_connect(owner, user) == may


def test_a_refused_websocket_is_no_error_and_ctrl_c_ends_it_with_nothing_to_say(tmp_path: Path) -> None:
    with studio(tmp_path) as server:
        assert upgrade(server, cookie=False)[0] == 403
        assert upgrade(server, Origin=own(server))[0] == 101
        assert server.stop(signal.SIGINT) == 0
        assert server.said() == ""


@pytest.mark.parametrize("left", [True, False])
def test_a_page_that_nobody_has_waited_for_is_no_error(left: bool) -> None:
    """As Starlette's middleware complains when the browser goes away while a page is made."""
    sent: list[Any] = []

    async def site(scope: Any, receive: Any, send: Any) -> None:
        if left:
            await receive()
        raise RuntimeError("No response returned.")

    async def gone() -> dict[str, str]:
        return {"type": "http.disconnect"}

    async def keep(message: Any) -> None:
        sent.append(message)

    guard = RequestGuard(site, "token", "guise", 100)
    host = (b"host", b"127.0.0.1:80")
    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"token=token", "headers": [host]}
    asyncio.run(guard(scope, gone, keep))
    cookie = dict(sent.pop(0)["headers"])[b"set-cookie"].split(b";")[0]
    scope |= {"query_string": b"", "headers": [host, (b"cookie", cookie)]}
    with nullcontext() if left else pytest.raises(RuntimeError):
        asyncio.run(guard(scope, gone, keep))


def test_what_is_at_no_address_is_a_page_of_the_studio_and_a_file_a_sentence(server: StudioServer) -> None:
    status, _, page = ask(server, "/nothing/here")
    assert status == 404
    assert "There is no such page" in page
    assert "Go to the start" in page
    status, _, said = ask(server, "/files/clips/nothing.mp4")
    assert (status, said) == (404, "There is no such file.")


def test_other_programs_cookies_do_no_harm(server: StudioServer) -> None:
    """Browsers send the cookies of all ports of this computer."""
    cookies = f'a={{"b": [1, 2]}}; broken; c=d e; {server.cookie}; =x'
    assert ask(server, "/people", cookie=False, Cookie=cookies)[0] == 200


@pytest.mark.parametrize("path", ["//evil.example", "/\\evil.example", "/%5Cevil.example"])
def test_the_token_leads_to_no_other_site(server: StudioServer, path: str) -> None:
    _, headers, _ = ask(server, f"{path}?token={server.token}", cookie=False)
    assert headers["Location"][0] == "/"
    assert headers["Location"][1] not in "/\\"


def test_answers_keep_other_sites_out(server: StudioServer) -> None:
    for cookie in (True, False):
        headers = ask(server, "/people", cookie=cookie)[1]
        assert headers["X-Frame-Options"] == "DENY"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "default-src 'self'" in headers["Content-Security-Policy"]
        assert "http" not in headers["Content-Security-Policy"]
        assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
@pytest.mark.parametrize(
    "origin", [None, "http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1"]
)
def test_changes_come_from_the_studios_own_pages(
    server: StudioServer, method: str, origin: str | None
) -> None:
    headers = {} if origin is None else {"Origin": origin}
    status, _, text = ask(server, "/people", method, **headers)
    assert (status, text) == (403, WRONG_ORIGIN)
    assert ask(server, "/people", method, Origin=own(server))[0] in (404, 405)


@pytest.mark.parametrize("path", ["/people", "/files/clips/x.mp4", POLLING])
def test_another_site_reads_nothing(server: StudioServer, path: str) -> None:
    """For a browser other ports of this computer are the same site, and get the cookie."""
    assert ask(server, path, Origin="http://127.0.0.1:1")[::2] == (403, WRONG_ORIGIN)
    assert ask(server, "/people", Origin=own(server))[0] == 200


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""])
def test_another_name_for_this_computer_is_refused(server: StudioServer, host: str) -> None:
    """A page of another site whose name suddenly means this computer (DNS rebinding) gets nothing."""
    status, _, text = ask(server, "/people", Host=host, Origin=f"http://{host}")
    assert status == 403
    assert text.startswith("The studio answers only at 127.0.0.1")


def test_a_websocket_needs_token_and_origin(server: StudioServer) -> None:
    assert upgrade(server, Origin=own(server))[0] == 101
    for headers in ({}, {"Origin": "http://evil.example"}, {"Origin": own(server), "Host": "evil.example"}):
        assert upgrade(server, **headers)[0] == 403
    assert upgrade(server, Origin=own(server), cookie=False)[0] == 403


@pytest.mark.parametrize("path", ["/people", "/_nicegui/client/x/upload/1"])
def test_what_is_too_large_is_refused(server: StudioServer, path: str) -> None:
    sentence = f"The file is larger than {LIMIT} MB: use a smaller one, or a higher --limit of guise studio."
    large = (LIMIT + 1) * 10**6
    answer = ask(server, path, "POST", Origin=own(server), Content_Length=str(large))
    assert answer[::2] == (413, sentence)


@pytest.mark.parametrize(
    "trick",
    ["../studio.sqlite", "..%2fstudio.sqlite", "%2e%2e/studio.sqlite", "%2e%2e%2fstudio.sqlite", "..\\studio.sqlite",
     "/etc/passwd", "%2fetc%2fpasswd", "./../../studio.sqlite", "x%00.mp4"],
)  # fmt: skip
def test_no_path_leads_out_of_the_folder(server: StudioServer, trick: str) -> None:
    assert (server.folder / "studio.sqlite").exists()
    for folder in ("clips", "people", "jobs"):
        status, _, text = ask(server, f"/files/{folder}/{trick}")
        assert status in (404, 400), trick
        assert "SQLite" not in text
        assert "root:" not in text
    assert ask(server, "/files/studio.sqlite")[0] == 404
    assert ask(server, "/gallery/..%2f..%2fx.guise.png")[0] == 404
    assert ask(server, "/gallery/x.guise.png")[0] == 404


def test_a_file_of_the_folder_is_shown_and_in_parts(server: StudioServer) -> None:
    """A browser seeks in a video by asking for parts."""
    (server.folder / "clips" / "made.mp4").write_bytes(b"0123456789")
    assert ask(server, "/files/clips/made.mp4")[::2] == (200, "0123456789")
    status, headers, text = ask(server, "/files/clips/made.mp4", Range="bytes=2-4")
    assert (status, text, headers["Content-Range"]) == (206, "234", "bytes 2-4/10")


def test_the_studio_listens_on_this_computer_only(server: StudioServer) -> None:
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)} - {
        "127.0.0.1"
    }
    for address in others:
        with pytest.raises(OSError), socket.create_connection((address, server.port), timeout=2):  # noqa: PT011
            pass


def test_a_port_that_is_taken_is_one_sentence(server: StudioServer, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "guise", "studio", "--no-open", "--folder", str(tmp_path)]
    done = subprocess.run([*command, "--port", str(server.port)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"error: port {server.port} is in use: choose another --port\n"


def test_a_signal_ends_it_as_ctrl_c_does(tmp_path: Path) -> None:
    with studio(tmp_path) as server:
        assert server.stop(signal.SIGTERM) == 0
