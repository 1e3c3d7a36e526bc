"""The page Live: the browser's camera, or the computer's, with another face."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from functools import partial

from nicegui import background_tasks, events, ui

from guise.app.live.capture import CameraCapture, Capture, FileCapture
from guise.app.live.output import Output
from guise.app.live.virtualcam import VirtualCamera
from guise.app.media import MediaError
from guise.app.studio.camera_page import CameraPage, Visitors
from guise.app.studio.frame_socket import Peer, PeerOutput
from guise.app.studio.live_elements import Performance
from guise.app.studio.live_faces import NOBODY, LiveCast
from guise.app.studio.live_recording import RecordingButtons
from guise.app.studio.live_run import LiveRun
from guise.app.studio.live_settings import BROWSER, CAMERA_SIZES, COMPUTER, SettingsPanel
from guise.app.studio.live_stage import Stage
from guise.app.studio.site import Studio, page

IDLE = "Start asks for your camera; no picture leaves this computer."
MESH_SECONDS = 0.15  # between two of the mesh over the person's own picture
STRANGER_SECONDS = 3.0  # of a covered face, after which it may be somebody else's
SOCKET = "/live/frames/"  # address of the websockets, without the id of a peer


def register(studio: Studio) -> None:
    """Add the page /live."""
    visitors = Visitors(SOCKET)
    page(studio, "/live", "Live", lambda: _LivePage(studio, visitors).build())


class _LivePage(CameraPage[LiveRun]):
    """One visitor's page."""

    def __init__(self, studio: Studio, visitors: Visitors) -> None:
        super().__init__(visitors)
        self.studio = studio
        self._cast = LiveCast(studio)
        self._controls = self._cast.controls
        self._seen = 0.0  # time.monotonic() when the person was last recognised

    def build(self) -> None:
        """The whole page."""
        self.prepare()
        with ui.element("div").classes("desk"):
            with ui.column().classes("picture w-full"):
                self._stage = Stage()
                with ui.row().classes("w-full justify-center gap-2"):
                    self.run_buttons()
                    self._recording = RecordingButtons()
                    self._stage.buttons()
                    self._stranger = ui.button(icon="person_add", on_click=self._enrol_anew)
                self._performance = Performance()
            with ui.column().classes("w-full"):
                self._settings = SettingsPanel(self._cast, self.update_state, self._choose_person)
        ui.keyboard(on_key=self._key)
        self._mesh_timer = ui.timer(MESH_SECONDS, self._draw_mesh, active=False)
        self.update_state()
        background_tasks.create(asyncio.to_thread(self._cast.prepare), name="prepare live")

    def update_state(self) -> None:
        """Update buttons, pictures and texts to the state of the run."""
        super().update_state()
        live = self.run is not None
        self._mesh_timer.active = live
        self._recording.of(self.run, self.peer)
        self._settings.live(live)
        self._stage.mirror(self._controls.settings.mirror)
        if live:
            self._stage.begin(own=self._settings.shows_own)
        else:
            self._draw_mesh()
            self._stranger.set_visibility(False)
            self._stage.end(IDLE)
            self._performance.end()

    # -- actions ---------------------------------------------------------------------------------------

    def say_waiting(self) -> None:
        self._stage.say("Allow the camera …" if self._settings.camera == BROWSER else "Connecting …")

    def new_peer(self) -> Peer:
        return Peer(self._settings.lines)

    def asked(self, address: str) -> str:
        own = f"getHtmlElement({self._stage.own.id})" if self._settings.camera == BROWSER else "null"
        result, with_sound = (
            f"getHtmlElement({self._stage.result.id})",
            str(self._settings.with_sound).lower(),
        )
        return f"{own}, {result}, '{address}', {with_sound}, {self._settings.lines}"

    async def make_run(self, peer: Peer) -> LiveRun:
        """A run with the chosen person."""
        config = await asyncio.to_thread(self._cast.session, self._settings.person)
        outputs: list[Output] = [PeerOutput(peer, self._controls)]
        if self._settings.to_virtual_camera:
            outputs.append(VirtualCamera())
        self._seen = time.monotonic()
        self._settings.show()
        camera = self._open_camera(peer)
        return LiveRun(camera, config, self._controls, outputs, self.folder, peer.alive, peer.microphone)

    def _open_camera(self, peer: Peer) -> Callable[[], Capture]:
        """What opens the chosen source: the browser's camera, the computer's, or a clip, which is repeated."""
        if self._settings.camera == BROWSER:
            return peer.camera
        if self._settings.camera == COMPUTER:
            return partial(_computers_camera, CAMERA_SIZES[self._settings.lines])
        return partial(FileCapture, self.studio.store.upload(self._settings.camera).path, loop=True)

    async def _choose_person(self, person: str) -> None:
        """Continue with another person, or enrol."""
        if self.run is not None:
            await self.end_run()
            await self.begin()
            self.update_state()

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

    def report(self, run: LiveRun) -> None:
        self._recording.report(run)

    def follow(self, run: LiveRun) -> None:
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
        self._stage.draw_mesh(self.run.latest if self.run is not None else None)


def _computers_camera(size: tuple[int, int]) -> CameraCapture:
    try:
        return CameraCapture(size=size)
    except MediaError as error:
        raise MediaError(
            "the computer's camera cannot be opened: connect one, or use this browser's camera"
        ) from error
