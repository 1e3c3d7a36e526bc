"""What the pages with a camera share: the connection to the browser, and one run behind each visitor's page."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Generic, TypeVar

from nicegui import app as nicegui_app
from nicegui import ui
from starlette.websockets import WebSocket

from guise.app.studio.frame_socket import Peer
from guise.app.studio.live_run import CameraRun
from guise.app.studio.site import camera_error, script
from guise.common.errors import GuiseError

PERMISSION_SECONDS = 120.0  # that the user gets to allow the camera
UPDATE_SECONDS = 0.5  # between two updates of a page

Run = TypeVar("Run", bound=CameraRun)


class Visitors:
    """All visitors of a page.   path : of its websockets, without the id of a peer.   runs : all of theirs."""

    def __init__(self, path: str) -> None:
        self.path, self.runs = path, set[CameraRun]()
        self._waiting: dict[str, Peer] = {}
        nicegui_app.add_api_websocket_route(path + "{id}", self._connect)
        nicegui_app.on_shutdown(self._end)

    @contextmanager
    def expect(self, peer: Peer) -> Iterator[None]:
        """Let a browser connect to a peer meanwhile."""
        self._waiting[peer.id] = peer
        try:
            yield
        finally:
            self._waiting.pop(peer.id, None)

    async def _connect(self, socket: WebSocket, id: str) -> None:
        if (peer := self._waiting.pop(id, None)) is None:
            await socket.close()
        else:
            await peer.serve(socket)

    def _end(self) -> None:
        for run in self.runs:
            run.stop()


class CameraPage(Generic[Run]):
    """One visitor's page, with at most one run.

    lines : of the camera's pictures, at most.   folder : for files of the visit, which end with it.
    """

    update_seconds = UPDATE_SECONDS

    def __init__(self, visitors: Visitors) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="guise-live-"))
        self.run: Run | None = None
        self.peer: Peer | None = None
        self._visitors = visitors

    def prepare(self) -> None:
        """Load what all such pages need."""
        ui.context.client.on_delete(self._leave)
        script("live.js")
        ui.on("live-camera-ended", self._camera_ended)
        self.timer = ui.timer(self.update_seconds, self._poll, active=False)

    def run_buttons(self) -> None:
        """The buttons that begin and end a run."""
        self._start_button = ui.button("Start", icon="play_arrow", on_click=self.start)
        self._stop_button = ui.button("Stop", icon="stop", on_click=self.stop)

    def new_peer(self) -> Peer:
        """The end of a new connection."""
        raise NotImplementedError

    def asked(self, address: str) -> str:
        """What the browser is asked for: arguments of guiseLive.begin."""
        raise NotImplementedError

    async def make_run(self, peer: Peer) -> Run:
        """Begin a run, or raise GuiseError."""
        raise NotImplementedError

    def say_waiting(self) -> None:
        """Say that the browser is waited for."""
        raise NotImplementedError

    def report(self, run: Run) -> None:
        """Show how a run is going; also called once when it has ended."""
        raise NotImplementedError

    def follow(self, run: Run) -> None:
        """Show what else changes while it goes on."""

    def update_state(self) -> None:
        """Update buttons to the state of the run; pages do the rest."""
        self._start_button.set_visibility(self.run is None)
        self._stop_button.set_visibility(self.run is not None)

    async def start(self) -> None:
        """Connect the browser and begin; the user may have to allow the camera first."""
        self._start_button.disable()
        self.say_waiting()
        try:
            await self._connect()
        finally:
            self._start_button.enable()
            self.update_state()

    async def _connect(self) -> None:
        peer = self.new_peer()
        with self._visitors.expect(peer):
            code = f"return await guiseLive.begin({self.asked(self._visitors.path + peer.id)})"
            begun: dict[str, str] = await ui.run_javascript(code, timeout=PERMISSION_SECONDS)
        if "error" in begun:
            ui.notify(camera_error(begun["error"]), type="negative")
            return
        if begun["silent"]:
            ui.notify("Recordings have no sound: the microphone is not allowed, or there is none.")
        self.peer = peer
        await self.begin()

    async def begin(self) -> None:
        """Start a run; without one, if something of it cannot be used, the camera is let go."""
        assert self.peer is not None
        try:
            self.run = await self.make_run(self.peer)
        except GuiseError:
            await self.stop()
            raise
        self._visitors.runs.add(self.run)
        self.timer.activate()

    async def stop(self) -> None:
        """End the run and the connection."""
        self.timer.deactivate()
        await self.end_run()
        if self.peer is not None:
            self.peer.close()
        self.peer = None
        ui.run_javascript("guiseLive.end()")
        self.update_state()

    async def end_run(self) -> None:
        """End the run, but not the connection."""
        if (run := self.run) is not None:
            self.run = None
            await asyncio.to_thread(run.stop)
            self._visitors.runs.discard(run)
            self.report(run)

    async def _leave(self) -> None:
        """The tab was closed."""
        try:
            await self.end_run()
        finally:
            if self.peer is not None:
                self.peer.close()
            shutil.rmtree(self.folder, ignore_errors=True)

    async def _camera_ended(self) -> None:
        await self.stop()
        ui.notify("The camera was disconnected: connect it and start again.", type="warning")

    async def _poll(self) -> None:
        """Update the page."""
        run, peer = self.run, self.peer
        if run is None or peer is None:
            return
        if not peer.alive() or not run.running:
            if peer.fault:
                ui.notify(f"Stopped: {peer.fault}.", type="negative")
            await self.stop()
            return
        self.report(run)
        self.follow(run)
