"""The studio's server: reachable from this computer only, by the browser that has the token."""

from __future__ import annotations

import logging
import secrets
import socket
import tempfile
from collections.abc import Callable
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from nicegui import app as nicegui_app
from nicegui import ui
from starlette.types import ASGIApp

from guise.app.studio import analogy, deidentify, landmarks, live, people, rig, start, swap
from guise.app.studio.jobs import JobQueue
from guise.app.studio.request_guard import RequestGuard
from guise.app.studio.site import STATIC, Studio, serve_files, serve_missing
from guise.app.studio.store import Store, StudioError
from guise.common.errors import GuiseError

HOST = "127.0.0.1"
PAGE_LIFETIME_SECONDS = (
    15.0  # for which the page of an unresponsive browser is kept; the processor may be busy
)
PAGES = (start, live, swap, people, landmarks, deidentify, analogy, rig)


def serve(
    folder: Path, port: int, limit: int, announce: Callable[[str], None],
    begin: Callable[[Studio], str] = lambda studio: "/",
) -> None:  # fmt: skip
    """Run the studio until it is interrupted.

    folder : for everything it keeps.   port : 0 for any.   limit : bytes of an upload.
    announce : called with the address once the server answers.   begin : gives the page of that address.
    Raises StudioError when the folder or the port is in use.
    """
    with _listen(port) as listener:
        store = Store(folder)
        tempfile.tempdir = str(store.incoming)
        jobs = JobQueue(store)
        token, port = secrets.token_urlsafe(24), listener.getsockname()[1]
        studio = Studio(store, jobs, limit)
        guard = RequestGuard(_site(studio), token, f"guise_{port}", limit)
        first = begin(studio)
        nicegui_app.on_startup(lambda: announce(f"http://{HOST}:{port}{first}?token={token}"))
        try:
            jobs.open()
            _run(guard, listener)
        except KeyboardInterrupt:
            return
        finally:
            jobs.close()
            store.close()


def _listen(port: int) -> socket.socket:
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        raise StudioError(f"port {port} is in use: choose another --port") from error


def _site(studio: Studio) -> FastAPI:
    """All pages in one application that loads nothing from other hosts."""
    site = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    logging.getLogger("nicegui").addFilter(_is_unexpected)
    logging.getLogger("nicegui").setLevel(logging.ERROR)  # its warnings are for its own developers
    serve_files(studio)
    serve_missing(studio)
    for module in PAGES:
        module.register(studio)
    ui.run_with(
        site,
        title="Guise",
        show_welcome_message=False,
        favicon=STATIC / "favicon.svg",
        language="en-US",
        reconnect_timeout=PAGE_LIFETIME_SECONDS,
        gzip_middleware_factory=None,  # nothing leaves this computer
        tailwind=False,  # its compiler takes longer than all else in a page: see studio.css
    )
    return site


def _run(site: RequestGuard, listener: socket.socket) -> None:
    uvicorn.Server(configuration(site)).run(sockets=[listener])


def configuration(site: ASGIApp) -> uvicorn.Config:
    """How the studio is served; no header may say who has connected."""
    return uvicorn.Config(
        site, log_level="warning", access_log=False, timeout_graceful_shutdown=1, ws_per_message_deflate=False,
        proxy_headers=False,
    )  # fmt: skip


def _is_unexpected(record: logging.LogRecord) -> bool:
    """Whether a log record is about something other than a user's mistake, which the page itself shows."""
    return not (record.exc_info and isinstance(record.exc_info[1], GuiseError))
