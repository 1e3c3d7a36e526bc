"""The page Live: the browser's camera, or the computer's, with another face."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from nicegui import app as nicegui_app
from nicegui import background_tasks, events, ui
from starlette.websockets import WebSocket

from guise.app.live.capture import CameraCapture, Capture, FileCapture
from guise.app.live.output import Output
from guise.app.live.virtualcam import VirtualCamera
from guise.app.media import MediaError
from guise.app.studio.frame_socket import Peer, PeerOutput
from guise.app.studio.live_elements import Performance
from guise.app.studio.live_faces import NOBODY, LiveCast
from guise.app.studio.live_recording import RecordingButtons
from guise.app.studio.live_run import LiveRun
from guise.app.studio.live_settings import BROWSER, CAMERA_SIZES, COMPUTER, SettingsPanel
from guise.app.studio.live_stage import Stage
from guise.app.studio.site import Studio, camera_error, page, script
from guise.common.errors import GuiseError

IDLE = "Start asks for your camera; no picture leaves this computer."
UPDATE_SECONDS = 0.5  # between two updates of the page
MESH_SECONDS = 0.15  # between two of the mesh over the person's own picture
STRANGER_SECONDS = 3.0  # of a covered face, after which it may be somebody else's
PERMISSION_SECONDS = 120.0  # that the user gets to allow the camera
SOCKET = "/live/frames/"  # address of the websockets, without the id of a peer


def register(studio: Studio) -> None:
    """Add the page /live."""
    runs: set[LiveRun] = set()
    peers: dict[str, Peer] = {}
    nicegui_app.on_shutdown(lambda: _end(runs))

    async def connect(socket: WebSocket, id: str) -> None:
        if (peer := peers.pop(id, None)) is None:
            await socket.close()
        else:
            await peer.serve(socket)

    nicegui_app.add_api_websocket_route(SOCKET + "{id}", connect)
    page(studio, "/live", "Live", lambda: _LivePage(studio, runs, peers).build())


def _end(runs: set[LiveRun]) -> None:
    for run in runs:
        run.stop()


class _LivePage:
    """One visitor's page, with at most one run.

    runs : all runs of the studio, which end with it.   peers : those that wait for their browser, by id.
    """

    def __init__(self, studio: Studio, runs: set[LiveRun], peers: dict[str, Peer]) -> None:
        self.studio, self._runs, self._peers = studio, runs, peers
        self._cast = LiveCast(studio)
        self._controls = self._cast.controls
        self._folder = Path(tempfile.mkdtemp(prefix="guise-live-"))
        self._peer: Peer | None = None
        self._run: LiveRun | None = None
        self._seen = 0.0  # time.monotonic() when the person was last recognised

    def build(self) -> None:
        ui.context.client.on_delete(self._leave)
        script("live.js")
        ui.on("live-camera-ended", self._camera_ended)
        with ui.element("div").classes("desk"):
            with ui.column().classes("picture w-full"):
                self._stage = Stage()
                with ui.row().classes("w-full justify-center gap-2"):
                    self._start_button = ui.button("Start", icon="play_arrow", on_click=self._start)
                    self._stop_button = ui.button("Stop", icon="stop", on_click=self._stop)
                    self._recording = RecordingButtons()
                    self._stage.buttons()
                    self._stranger = ui.button(icon="person_add", on_click=self._enrol_anew)
                self._performance = Performance()
            with ui.column().classes("w-full"):
                self._settings = SettingsPanel(self._cast, self._update_state, self._choose_person)
        ui.keyboard(on_key=self._key)
        self._timer = ui.timer(UPDATE_SECONDS, self._poll, active=False)
        self._mesh_timer = ui.timer(MESH_SECONDS, self._draw_mesh, active=False)
        self._update_state()
        background_tasks.create(asyncio.to_thread(self._cast.prepare), name="prepare live")

    def _update_state(self) -> None:
        """Update buttons, pictures and texts to the state of the run."""
        live = self._run is not None
        self._start_button.set_visibility(not live)
        self._stop_button.set_visibility(live)
        self._recording.of(self._run, self._peer)
        self._settings.live(live)
        self._stage.mirror(self._controls.settings.mirror)
        if live:
            self._stage.begin(own=self._settings.shows_own)
        else:
            self._stranger.set_visibility(False)
            self._stage.end(IDLE)
            self._performance.end()

    # -- actions ---------------------------------------------------------------------------------------

    async def _start(self) -> None:
        """Connect the browser and begin; the user may have to allow the camera first."""
        self._start_button.disable()
        self._stage.say("Allow the camera …" if self._settings.camera == BROWSER else "Connecting …")
        try:
            await self._connect()
        finally:
            self._start_button.enable()
            self._update_state()

    async def _connect(self) -> None:
        peer = Peer(self._settings.lines)
        self._peers[peer.id] = peer
        own = f"getHtmlElement({self._stage.own.id})" if self._settings.camera == BROWSER else "null"
        result, with_sound = (
            f"getHtmlElement({self._stage.result.id})",
            str(self._settings.with_sound).lower(),
        )
        what = f"{own}, {result}, '{SOCKET}{peer.id}', {with_sound}, {self._settings.lines}"
        try:
            begun: dict[str, str] = await ui.run_javascript(
                f"return await guiseLive.begin({what})", timeout=PERMISSION_SECONDS
            )
        finally:
            self._peers.pop(peer.id, None)
        if "error" in begun:
            ui.notify(camera_error(begun["error"]), type="negative")
            return
        if begun["silent"]:
            ui.notify("Recordings have no sound: the microphone is not allowed, or there is none.")
        self._peer = peer
        await self._begin()

    async def _begin(self) -> None:
        """Start a run with the chosen person; without one, if their model cannot be used, the camera is let go."""
        assert self._peer is not None
        try:
            config = await asyncio.to_thread(self._cast.session, self._settings.person)
        except GuiseError:
            await self._stop()
            raise
        outputs: list[Output] = [PeerOutput(self._peer, self._controls)]
        if self._settings.to_virtual_camera:
            outputs.append(VirtualCamera())
        self._seen = time.monotonic()
        camera, alive = self._open_camera(self._peer), self._peer.alive
        self._run = LiveRun(
            camera, config, self._controls, outputs, self._folder, alive, self._peer.microphone
        )
        self._runs.add(self._run)
        self._timer.activate()
        self._mesh_timer.activate()
        self._settings.show()

    def _open_camera(self, peer: Peer) -> Callable[[], Capture]:
        """What opens the chosen source: the browser's camera, the computer's, or a clip, which is repeated."""
        if self._settings.camera == BROWSER:
            return peer.camera
        if self._settings.camera == COMPUTER:
            return partial(_computers_camera, CAMERA_SIZES[self._settings.lines])
        return partial(FileCapture, self.studio.store.upload(self._settings.camera).path, loop=True)

    async def _stop(self) -> None:
        """End the run and the connection."""
        self._timer.deactivate()
        self._mesh_timer.deactivate()
        await self._end_run()
        self._draw_mesh()
        if self._peer is not None:
            self._peer.close()
        self._peer = None
        ui.run_javascript("guiseLive.end()")
        self._update_state()

    async def _end_run(self) -> None:
        if (run := self._run) is not None:
            self._run = None
            await asyncio.to_thread(run.stop)
            self._runs.discard(run)
            self._recording.report(run)

    async def _leave(self) -> None:
        """The tab was closed."""
        await self._end_run()
        if self._peer is not None:
            self._peer.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    async def _camera_ended(self) -> None:
        await self._stop()
        ui.notify("The camera was disconnected: connect it and start again.", type="warning")

    async def _choose_person(self, person: str) -> None:
        """Continue with another person, or enrol."""
        if self._run is not None:
            await self._end_run()
            await self._begin()
            self._update_state()

    def _enrol_anew(self) -> None:
        """Enrol who is at the camera instead of covering them as somebody else."""
        self._stranger.set_visibility(False)
        self._settings.person = NOBODY

    async def _key(self, event: events.KeyEventArguments) -> None:
        """The keys of the window, as far as they make sense here."""
        key = str(event.key.name).lower().removeprefix("arrow")
        if not event.action.keydown or event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta:
            return
        if event.action.repeat and key not in ("up", "down"):
            return
        if key == "e":
            self._enrol_anew()
        elif key == "r":
            await self._recording.toggle()
        elif key == "c":
            await self._recording.snapshot()
        elif key.isdigit():
            await self._settings.choose_face(int(key) - 1)
        elif key in ("up", "down", "s", "p", "o", "m", "k", "l"):
            self._controls.press(key)
            self._settings.show()

    async def _poll(self) -> None:
        """Update the page."""
        run, peer = self._run, self._peer
        if run is None or peer is None:
            return
        if not peer.alive() or not run.running:
            if peer.fault:
                ui.notify(f"Stopped: {peer.fault}.", type="negative")
            await self._stop()
            return
        self._recording.report(run)
        self._stage.show(run.latest, run.recording_seconds)
        self._performance.show(run.stats)
        self._look_for_strangers(run)
        self._settings.follow()

    def _look_for_strangers(self, run: LiveRun) -> None:
        """Offer to enrol who is covered for long although somebody is known."""
        if run.latest is None:
            return
        if run.latest.result.outcome not in ("covered", "lost"):
            self._seen = time.monotonic()
        person = self._settings.person
        self._stranger.text = f"Not {self._cast.people()[person]}? Enroll me"
        is_unknown = person != NOBODY and time.monotonic() - self._seen > STRANGER_SECONDS
        self._stranger.set_visibility(is_unknown)

    def _draw_mesh(self) -> None:
        self._stage.draw_mesh(self._run.latest if self._run is not None else None)


def _computers_camera(size: tuple[int, int]) -> CameraCapture:
    try:
        return CameraCapture(size=size)
    except MediaError as error:
        raise MediaError(
            "the computer's camera cannot be opened: connect one, or use this browser's camera"
        ) from error
