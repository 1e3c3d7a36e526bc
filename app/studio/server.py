"""The studio's server: on this computer only, for the browser that has the token."""

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

from guise.app.studio import analogy, deidentify, landmarks, live, people
from guise.app.studio.guard import Guard
from guise.app.studio.jobs import Jobs
from guise.app.studio.site import Studio, StudioOptions, serve_files
from guise.app.studio.store import Store, StudioError
from guise.common.errors import GuiseError

HOST = "127.0.0.1"
PATIENCE = (
    15.0  # seconds for which a page that does not answer is kept; the processor may be busy with other work
)
PAGES = (live, people, landmarks, deidentify, analogy)


def serve(folder: Path, port: int, limit: int, announce: Callable[[str], None]) -> None:
    """Run the studio until it is interrupted.

    folder : what it keeps.   port : 0 for any.   limit : bytes of an upload.
    announce : called with the address when browsers may come.
    Raises StudioError when the folder or the port is not free.
    """
    with _listen(port) as listener:
        store = Store(folder)
        tempfile.tempdir = str(store.incoming)
        jobs = Jobs(store)
        token, port = secrets.token_urlsafe(24), listener.getsockname()[1]
        guard = Guard(_site(Studio(store, jobs, StudioOptions(limit))), token, f"guise_{port}", limit)
        nicegui_app.on_startup(lambda: announce(f"http://{HOST}:{port}/?token={token}"))
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
        raise StudioError(f"port {port} is not free: choose another --port") from error


def _site(studio: Studio) -> FastAPI:
    """All pages in one application, which fetches nothing from elsewhere."""
    site = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    logging.getLogger("nicegui").addFilter(_is_fault)
    serve_files(studio)
    for module in PAGES:
        module.register(studio)
    ui.run_with(site, title="Guise", show_welcome_message=False, language="en-US", reconnect_timeout=PATIENCE)
    return site


def _run(site: Guard, listener: socket.socket) -> None:
    config = uvicorn.Config(site, log_level="warning", access_log=False, timeout_graceful_shutdown=1)
    uvicorn.Server(config).run(sockets=[listener])


def _is_fault(record: logging.LogRecord) -> bool:
    """Whether a log record is none about a user's mistake, which the page itself tells."""
    return not (record.exc_info and isinstance(record.exc_info[1], GuiseError))
