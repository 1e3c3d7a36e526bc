"""The page Live: the browser's camera, or the computer's, with another face."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import app as nicegui_app
from nicegui import events, ui
from starlette.websockets import WebSocket

from guise.aam.model import Identity
from guise.aam.recognition import cosine_similarity, signature
from guise.app.live.capture import CameraCapture, Capture, FileCapture
from guise.app.live.controls import Controls
from guise.app.live.options import LiveSettings
from guise.app.live.output import Output
from guise.app.live.overlay import mesh_path
from guise.app.live.session import SessionConfig
from guise.app.live.virtualcam import VirtualCamera
from guise.app.media import MediaError
from guise.app.people.kept import free_name
from guise.app.studio.dialogs import confirm
from guise.app.studio.frame_socket import Peer, PeerOutput
from guise.app.studio.live_elements import figures, graph, select, video
from guise.app.studio.live_run import LiveRun
from guise.app.studio.portraits import Portraits
from guise.app.studio.site import Studio, camera_error, page, script
from guise.app.swapping.donors import MODEL_SUFFIX, open_donor
from guise.common.errors import GuiseError, OutputError

BROWSER, COMPUTER = "browser", "server"
CAMERAS = {BROWSER: "This browser's camera", COMPUTER: "The computer's camera"}
MODES = {"swap": "Swap", "puppet": "Puppet", "off": "Cover"}
STYLES = {"mosaic": "Mosaic", "solid": "Solid", "blur": "Blur"}
STATES = {
    "swapped": "",
    "covered": "Your face is covered: it cannot be seen well enough.",
    "lost": "No face found: everything is covered.",
    "off": "Your face is covered, as you chose.",
}
NOBODY = ""  # instead of a person's id: enrol
CAMERA_SIZE = (640, 480)  # pixels, of the computer's camera
UPDATE_SECONDS = 0.5  # between two updates of the page
MESH_SECONDS = 0.08  # between two of the mesh over the person's own picture
STRANGER_SECONDS = 3.0  # of a covered face, after which it may be somebody else's
SWITCHES = ("mirror", "mesh", "mask")
KEYS = (
    "1 to 9 face, up and down expression, S swap, P puppet, O cover, M mirror, L mesh, K mask, R record, C snapshot, "
    "E enroll"
)
GRAPH_POINTS = 120  # of the latency graph, one for each update
LISTEN_SECONDS = 5.0  # that the browser gets to begin with its sound
PERMISSION_SECONDS = 120.0  # that the user gets to allow the camera
_PERSON = "live_person"  # the setting: who is at the camera
SOCKET = "/live/frames/"  # address of the websockets, without the id of a peer
FACE = "live_face"  # the setting: whose face is shown first, chosen on the page People


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
        self._faces = studio.faces()
        first = self._first_face()
        real = (n for n, face in enumerate(self._faces) if face.endswith(MODEL_SUFFIX) and n != first)
        self._controls = Controls(len(self._faces), LiveSettings(identity=first, mirror=True), real)
        self._asking = False  # whether a face of a real person may be shown
        self._folder = Path(tempfile.mkdtemp(prefix="guise-live-"))
        self._peer: Peer | None = None
        self._run: LiveRun | None = None
        self._enrolled = ""  # id of the person who has just been enrolled
        self._proposes = studio.store.setting(FACE) not in self._faces  # nobody has chosen a face yet
        self._toggling = False  # a recording is being started or stopped
        self._downloaded: set[Path] = set()
        self._seen = 0.0  # time.monotonic() when the person was last recognised
        self._latencies: deque[float] = deque([0.0] * GRAPH_POINTS, GRAPH_POINTS)
        self._graph: ui.echart | None = None

    def build(self) -> None:
        self._client = ui.context.client
        self._client.on_delete(self._leave)
        script("live.js")
        ui.on("live-camera-ended", self._camera_ended)
        with ui.column().classes("w-full gap-4"):
            self._stage()
            self._choices()
            self._readout()
        self._update_state()
        self._timer = ui.timer(UPDATE_SECONDS, self._poll, active=False)
        self._mesh_timer = ui.timer(MESH_SECONDS, self._draw_mesh, active=False)

    # -- layout ---------------------------------------------------------------------------------------

    def _stage(self) -> None:
        with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            with ui.element("div").classes("relative") as self._camera_place:
                self._own = video("Your camera")
                with ui.element("svg").classes("absolute inset-0 w-full h-full") as self._mesh_picture:
                    self._mesh_picture.props('aria-hidden="true" pointer-events="none"')
                    self._mesh = ui.element("path").props('fill="none" stroke="#5af082" d=""')
            self._result = video("The result")
        with ui.row().classes("w-full items-center no-wrap min-h-12"):
            self._ring = ui.circular_progress(0, min=0, max=1, show_value=False, size="3rem")
            self._ring.props('aria-label="Enrollment"')
            self._message = ui.label().classes("text-h6").props("role=status")
        with ui.row():
            self._start_button = ui.button("Start", icon="play_arrow", on_click=self._start)
            self._stop_button = ui.button("Stop", icon="stop", on_click=self._stop)
            self._record = ui.button("Record", icon="fiber_manual_record", on_click=self._toggle_recording)
            self._record.props("outline")
            self._snap = ui.button("Snapshot", icon="photo_camera", on_click=self._snapshot).props("outline")
            self._stranger = ui.button("Not you? Enroll me", icon="person_add", on_click=self._enrol_anew)
            self._stranger.set_visibility(False)

    def _choices(self) -> None:
        """All settings; most of them can be changed while a run goes on."""
        settings, people = self._controls.settings, self._people()
        remembered = self.studio.store.setting(_PERSON)
        specs = list(self._faces)
        self._portraits = Portraits(
            self.studio, self._faces, specs[settings.identity], "Face to show",
            lambda spec: self._choose_face(specs.index(spec)),
        )  # fmt: skip
        clips = {clip.id: f"The clip {clip.name}" for clip in self.studio.store.clips()}
        with ui.card().classes("w-full"), ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            self._camera = select("Camera", CAMERAS | clips, BROWSER, lambda _: self._update_state())
            person = remembered if remembered in people else NOBODY
            self._person = select("Who is at the camera", people, person, self._choose_person)
            select("Cover style", STYLES, settings.style, self._changer("style"))
            with ui.column().classes("gap-0"):
                ui.label("Mode").props("id=live-mode")
                self._mode = ui.toggle(MODES, value=settings.mode, on_change=self._changer("mode"))
                self._mode.props('aria-labelledby="live-mode"')
            with ui.column().classes("gap-0"):
                alpha = ui.label()
                self._alpha = ui.slider(min=0, max=1, step=0.05, value=settings.alpha)
                self._alpha.on_value_change(self._changer("alpha")).props('aria-label="Expression"')
                alpha.bind_text_from(self._alpha, "value", lambda v: f"Expression let through: {v:.2f}")
            with ui.row():
                self._switches = {
                    name: ui.switch(
                        name.capitalize(), value=getattr(settings, name), on_change=self._changer(name)
                    )
                    for name in SWITCHES
                }
                self._microphone = ui.switch("Microphone", value=True)
                self._microphone.tooltip("The sound of recordings; heard nowhere else")
                self._virtual = ui.switch("Virtual camera")
                self._virtual.set_visibility(_has_virtual_camera())
        ui.label(f"Keys: {KEYS}.").classes("opacity-70")
        ui.keyboard(on_key=self._key)

    def _readout(self) -> None:
        self._figures = ui.label().classes("tabular-nums opacity-70")
        self._performance = ui.expansion("Performance", icon="speed", on_value_change=self._plot)
        self._performance.classes("w-full")

    def _plot(self) -> None:
        """Draw the graph once it is asked for: its library is as large as the rest of the page."""
        if self._graph is None:
            with self._performance:
                self._graph = ui.echart(graph(list(self._latencies))).classes("w-full h-40")
            self._graph.props('role=img aria-label="Recent latency from the camera on"')

    def _update_state(self) -> None:
        """Update buttons, pictures and texts to the state of the run."""
        live = self._run is not None
        self._start_button.set_visibility(not live)
        self._stop_button.set_visibility(live)
        for element in (self._record, self._snap):
            element.set_enabled(live)
        self._camera.set_enabled(not live)
        self._camera_place.set_visibility(self._camera.value == BROWSER)
        if not live:
            self._ring.set_visibility(False)
            self._stranger.set_visibility(False)
            self._message.text = "Start asks for your camera; no picture leaves this computer."
            self._figures.text = ""
        for picture in (self._own, self._result, self._mesh_picture):
            picture.classes(**{"add" if self._controls.settings.mirror else "remove": "-scale-x-100"})

    # -- actions ---------------------------------------------------------------------------------------

    async def _start(self) -> None:
        """Connect the browser and begin; the user may have to allow the camera first."""
        self._start_button.disable()
        self._message.text = "Allow the camera …" if self._camera.value == BROWSER else "Connecting …"
        try:
            await self._connect()
        finally:
            self._start_button.enable()
            self._update_state()

    async def _connect(self) -> None:
        peer = Peer()
        self._peers[peer.id] = peer
        own = f"getHtmlElement({self._own.id})" if self._camera.value == BROWSER else "null"
        with_sound = str(self._microphone.value and self._camera.value in CAMERAS).lower()
        result = f"getHtmlElement({self._result.id})"
        code = f"return await guiseLive.begin({own}, {result}, '{SOCKET}{peer.id}', {with_sound})"
        try:
            begun: dict[str, str] = await ui.run_javascript(code, timeout=PERMISSION_SECONDS)
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
            config = await asyncio.to_thread(self._session_config, self._person.value)
        except GuiseError:
            await self._stop()
            raise
        outputs: list[Output] = [PeerOutput(self._peer, self._controls)]
        if self._virtual.value:
            outputs.append(VirtualCamera())
        self._seen = time.monotonic()
        camera, alive = self._open_camera(self._peer), self._peer.alive
        self._run = LiveRun(
            camera, config, self._controls, outputs, self._folder, alive, self._peer.microphone
        )
        self._runs.add(self._run)
        self._timer.activate()
        self._mesh_timer.activate()
        self._show_settings()

    def _open_camera(self, peer: Peer) -> Callable[[], Capture]:
        """What opens the chosen source: the browser's camera, the computer's, or a clip, which is repeated."""
        if self._camera.value == BROWSER:
            return peer.camera
        if self._camera.value == COMPUTER:
            return _computers_camera
        return partial(FileCapture, self.studio.store.upload(self._camera.value).path, loop=True)

    def _session_config(self, person: str) -> SessionConfig:
        """Load the models.  ModelError when one cannot be used."""
        faces = [
            Identity.load(face) if face.endswith(MODEL_SUFFIX) else open_donor(face) for face in self._faces
        ]
        known = Identity.load(self.studio.store.person(person).path) if person else None
        if known is not None:
            self._propose(known, faces)
        return SessionConfig(faces, known, name="Me", keep=partial(self._keep, faces))

    def _propose(self, person: Identity, faces: Sequence[Identity]) -> None:
        """Unless the user has chosen, show another built-in face than the one that is most like the person's."""
        if self._proposes:
            able = [n for n, face in enumerate(self._faces) if not face.endswith(MODEL_SUFFIX)]
            own = signature(person)
            most = max(able, key=lambda n: cosine_similarity(own, signature(faces[n])))
            self._controls.change(identity=next(n for n in able if n != most))

    async def _choose_face(self, number: int) -> None:
        """Show a face; one that may be the user's own only after they agree."""
        if self._controls.asks_for(number) and not self._asking:
            self._asking, name = True, list(self._faces.values())[number]
            question = f"{name} is somebody who may be at the camera. Show that face, recognisable to anyone?"
            if await confirm(question, "Show this face", "Keep it hidden"):
                self._controls.agree(number)
            self._asking = False
        if 0 <= number < len(self._faces) and not self._controls.asks_for(number):
            self._proposes = False
            self._controls.change(identity=number)
        self._show_settings()

    def _keep(self, faces: Sequence[Identity], made: Identity) -> None:
        """Add a newly enrolled person to the studio's people; called in the run's processing thread."""
        self._propose(made, faces)
        person = self.studio.store.add_person(made.name, None)
        replace(made, name=free_name(made.name, person.path)).save(person.path)
        self._enrolled = person.id

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
            self._report(run)

    async def _leave(self) -> None:
        """The tab was closed."""
        await self._end_run()
        if self._peer is not None:
            self._peer.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    async def _camera_ended(self) -> None:
        await self._stop()
        ui.notify("The camera was disconnected: connect it and start again.", type="warning")

    async def _choose_person(self, event: Any) -> None:
        """Continue with another person, or enrol."""
        person: str = event.value
        if person and person == self._enrolled:
            return
        self.studio.store.remember(_PERSON, person)
        if self._run is not None:
            await self._end_run()
            await self._begin()

    def _enrol_anew(self) -> None:
        """Enrol who is at the camera instead of covering them as somebody else."""
        self._stranger.set_visibility(False)
        self._person.value = NOBODY

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
            await self._toggle_recording()
        elif key == "c":
            await self._snapshot()
        elif key.isdigit():
            await self._choose_face(int(key) - 1)
        elif key in ("up", "down", "s", "p", "o", "m", "k", "l"):
            self._controls.press(key)
            self._show_settings()

    def _show_settings(self) -> None:
        """Have the page show what the keys have changed."""
        settings = self._controls.settings
        self._mode.value, self._alpha.value = settings.mode, settings.alpha
        for name, switch in self._switches.items():
            switch.value = getattr(settings, name)
        self._portraits.press(list(self._faces)[settings.identity])

    def _changer(self, name: str) -> Callable[[Any], None]:
        """A handler that changes a setting."""

        def change(event: Any) -> None:
            self._controls.change(**{name: event.value})
            self._update_state()

        return change

    async def _toggle_recording(self) -> None:
        """Start or stop a recording, once whatever is pressed meanwhile; sound comes only while there is one."""
        if (run := self._run) is None or self._toggling:
            return
        self._toggling = True
        try:
            if not run.recording:
                await self._listen(run)
                run.toggle_recording()
            else:
                run.toggle_recording()
                await ui.run_javascript("return await guiseLive.deafen()", timeout=LISTEN_SECONDS)
        finally:
            self._toggling = False

    async def _listen(self, run: LiveRun) -> None:
        """Have the browser send its sound, and wait for it: a recording that begins without has no sound at all."""
        begun = time.monotonic()
        if not await ui.run_javascript("return await guiseLive.listen()", timeout=LISTEN_SECONDS):
            return
        while run.running and self._peer is not None and not self._peer.microphone.is_on:
            if time.monotonic() > begun + LISTEN_SECONDS:
                ui.notify("This recording has no sound: the microphone gives none.")
                return
            await asyncio.sleep(0.02)

    async def _snapshot(self) -> None:
        if self._run is not None and (path := await asyncio.to_thread(self._run.snapshot)) is not None:
            ui.download.file(path)

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
        self._report(run)
        self._show_latest(run)
        if self._enrolled and self._person.value != self._enrolled:
            self._person.set_options(self._people(), value=self._enrolled)
            self._show_settings()
            self.studio.store.remember(_PERSON, self._enrolled)

    def _draw_mesh(self) -> None:
        """While somebody is being enrolled, draw what was found over their own picture, which no output shows."""
        shown = self._run.latest if self._run is not None else None
        path = ""
        if shown is not None and shown.result.outcome == "enrolling" and shown.result.mesh is not None:
            path = mesh_path(shown.result.mesh)
            self._mesh_picture.props["viewBox"] = f"0 0 {shown.frame.width} {shown.frame.height}"
        if path != self._mesh.props["d"]:
            self._mesh.props["d"] = path
            self._mesh_picture.update()

    def _show_latest(self, run: LiveRun) -> None:
        if (shown := run.latest) is not None:
            self._message.text = shown.message or STATES.get(shown.result.outcome, "")
            self._ring.set_visibility(shown.ring is not None)
            if shown.result.outcome not in ("covered", "lost"):
                self._seen = time.monotonic()
            unknown = self._person.value != NOBODY and time.monotonic() - self._seen > STRANGER_SECONDS
            self._stranger.text = f"This is not {self._people()[self._person.value]}? Enroll me"
            self._stranger.set_visibility(unknown)
            self._ring.value = shown.ring or 0.0
        self._record.text = "Stop recording" if run.recording else "Record"
        stats = run.stats
        self._latencies.append(round(stats.latency, 1))
        self._figures.text = figures(stats)
        if self._graph is not None and self._performance.value:  # it costs the browser several pictures
            self._graph.options["series"][0]["data"] = list(self._latencies)
            self._graph.update()

    def _report(self, run: LiveRun) -> None:
        """Show messages, and download recordings that are complete."""
        while not run.notes.empty():
            ui.notify(run.notes.get())
        for path in run.recorded():
            if path not in self._downloaded:
                self._downloaded.add(path)
                ui.download.file(path)

    def _first_face(self) -> int:
        """Index of the face that was chosen on the page People, or of the first one of the gallery."""
        chosen = self.studio.store.setting(FACE)
        if chosen in self._faces:
            return list(self._faces).index(chosen)
        return next(i for i, face in enumerate(self._faces) if not face.endswith(MODEL_SUFFIX))

    def _people(self) -> dict[str, str]:
        """Ids and names of the people who can be at the camera."""
        return {person.id: person.name for person in self.studio.store.people()} | {
            NOBODY: "Enroll me (20 s)"
        }


def _has_virtual_camera() -> bool:
    try:
        VirtualCamera().check()
    except OutputError:
        return False
    return True


def _computers_camera() -> CameraCapture:
    try:
        return CameraCapture(size=CAMERA_SIZE)
    except MediaError as error:
        raise MediaError(
            "the computer's camera cannot be opened: connect one, or use this browser's camera"
        ) from error
