"""Access control: only the browser that has the token, from the studio's own pages, may talk to the studio.

Plain ASGI around everything else, so that no request, upload or websocket bypasses it.
"""

from __future__ import annotations

import errno
import os
import secrets
import socket
import struct
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, cookie_parser
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOSTS = ("127.0.0.1", "localhost")
NO_TOKEN = "Access needs a token: open the address that guise studio printed in the terminal."
WRONG_HOST = "The studio answers only at 127.0.0.1 and localhost: open the address that guise studio printed."
WRONG_USER = "The studio is another user's: start your own with guise studio."
WRONG_ORIGIN = "This request comes from another site: use the studio's own pages."
FORM_OVERHEAD_BYTES = 1 << 16  # that a form adds to a file
GONE = -1  # instead of the user at an end that its program has closed
NETLINK_SOCK_DIAG, SOCK_DIAG_BY_FAMILY, NLM_F_REQUEST = 4, 20, 1  # of Linux's headers, as the next
TCP_LISTEN, ANY = 10, 0xFFFFFFFF
Address = Sequence[Any] | None
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; media-src 'self' blob:; font-src 'self' data:; "
        "connect-src 'self' blob:; worker-src 'self' blob:; "
        "object-src 'none'; base-uri 'self'; form-action 'self'; frame-ancestors 'none'"
    ),
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(self), microphone=(self), geolocation=()",
    "Referrer-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


class RequestGuard:
    """Passes requests that have the token, come from the studio's own pages and are not too large.

    Parameters
    ----------
    app : the guarded application.
    token : as in the printed address; who has it gets a cookie that no script and no other site can use.
    cookie : its name, different for each port, because browsers share cookies between ports.
    limit : largest upload, bytes.
    """

    def __init__(self, app: ASGIApp, token: str, cookie: str, limit: int) -> None:
        self.app, self._token, self._cookie, self._limit = app, token, cookie, limit
        self._session = secrets.token_urlsafe(24)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is not None and scope["type"] == "websocket":
            await send({"type": "websocket.close"})  # a response with words is an error to some servers
            return
        if refusal is not None:
            await refusal(scope, receive, _with_headers(send))
            return
        await self._pass(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> Response | None:
        """The response to a request that is not passed on, or None."""
        if not may_connect(owner_of(scope.get("client"), scope.get("server")), os.getuid()):
            return PlainTextResponse(WRONG_USER, 403)
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if host.rsplit(":", 1)[0] not in HOSTS:
            return PlainTextResponse(WRONG_HOST, 403)
        safe = scope["type"] == "http" and scope["method"] in ("GET", "HEAD")
        if origin != f"http://{host}" and not (safe and origin is None):
            return PlainTextResponse(WRONG_ORIGIN, 403)
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        if safe and secrets.compare_digest(given.encode(), self._token.encode()):
            return self._welcome(scope["path"])
        session = cookie_parser(headers.get("cookie", "")).get(self._cookie, "")
        if not secrets.compare_digest(session.encode(), self._session.encode()):
            return PlainTextResponse(NO_TOKEN, 403)
        if int(headers.get("content-length") or 0) > self._limit + FORM_OVERHEAD_BYTES:
            return PlainTextResponse(too_large(self._limit), 413)
        return None

    def _welcome(self, path: str) -> Response:
        """Set the cookie and redirect to the same page without the token in its address.

        Browsers send the cookie to every port of this computer: it isn't the token, which only the terminal shows.
        """
        response = RedirectResponse("/" + path.lstrip("/"), 303)
        response.set_cookie(self._cookie, self._session, httponly=True, samesite="strict")
        return response

    async def _pass(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on; one that turns out larger than allowed looks to the studio like a lost connection."""
        count, most, left = 0, self._limit + FORM_OVERHEAD_BYTES, False

        async def counted() -> Message:
            nonlocal count, left
            message = await receive()
            left = left or message["type"] == "http.disconnect"
            count += len(message.get("body", b"")) if message["type"] == "http.request" else 0
            return message if count <= most else {"type": "http.disconnect"}

        async def answered(message: Message) -> None:
            if count <= most:
                await send(message)

        try:
            await self.app(scope, counted, answered)
        except ClientDisconnect:
            pass
        except RuntimeError:
            if not left:  # otherwise Starlette's complaint that nobody has waited for the page
                raise
        if count > most:
            await PlainTextResponse(too_large(self._limit), 413)(scope, receive, send)


def owner_of(client: Address, server: Address, table: Path = Path("/proc/net/tcp")) -> int | None:
    """The user id of the program at the client's end of a connection within 127.0.0.1.

    client, server : address and port of its ends.   table : of all connections, as Linux writes it, which is read
    where the kernel doesn't answer about one.   Returns GONE if the client has hung up, None where nothing tells.
    """
    near, far = (end[1] if end else 0 for end in (client, server))
    for ask in (_ask_kernel, partial(_look_up, table)):
        try:
            owner = ask(near, far)
            return GONE if owner is None and ask(far, near) is None else owner
        except (OSError, AttributeError):  # the latter on other systems
            continue
    return None


def _ask_kernel(near: int, far: int) -> int | None:
    """The owner of a connection's end, by the ports; None if there is none: sock_diag(7).

    On a large computer, reading the table takes 10 ms, which each of the 35 requests of a page would wait for.
    """
    address = socket.inet_aton(HOSTS[0]) + bytes(12)
    end = struct.pack(">HH", near, far) + 2 * address + struct.pack("=III", 0, ANY, ANY)
    question = struct.pack("=BBBxI", socket.AF_INET, socket.IPPROTO_TCP, 0, ANY) + end
    head = struct.pack("=IHHII", 16 + len(question), SOCK_DIAG_BY_FAMILY, NLM_F_REQUEST, 0, 0)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, NETLINK_SOCK_DIAG) as kernel:
        kernel.send(head + question)
        answer = kernel.recv(4096)
    if struct.unpack_from("=H", answer, 4)[0] != SOCK_DIAG_BY_FAMILY:
        error = -struct.unpack_from("=i", answer, 16)[0]
        if error == errno.ENOENT:
            return None
        raise OSError(error, os.strerror(error))
    if answer[17] == TCP_LISTEN:  # it tells of the listener where there is no connection
        return None
    user, inode = struct.unpack_from("=II", answer, 80)
    return int(user) if inode else GONE


def _look_up(table: Path, near: int, far: int) -> int | None:
    """As `_ask_kernel`, from the table of all connections."""
    ends = [f"0100007F:{near:04X}", f"0100007F:{far:04X}"]
    lines = map(str.split, table.read_text().splitlines())
    found = next((fields for fields in lines if fields[1:3] == ends), None)
    if found is None:
        return None
    return int(found[7]) if found[9] != "0" else GONE


def may_connect(owner: int | None, own: int) -> bool:
    """Whether a user may use the studio of the user `own`: a cookie that another's program was sent is no use to it."""
    return owner in (None, 0, own) or own == 0


def too_large(limit: int) -> str:
    """The message about a file above the limit in bytes."""
    return f"The file is larger than {limit / 1e6:.0f} MB: use a smaller one, or a higher --limit of guise studio."


def _with_headers(send: Send) -> Send:
    """`send` with the headers that keep other sites out."""

    async def sending(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers[name] = value
        await send(message)

    return sending
