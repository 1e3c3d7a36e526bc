"""The page Rig: the camera, or a clip, drives a head, a receiver of the VMC protocol, and files of curves."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from functools import partial
from typing import Any

from nicegui import app as nicegui_app
from nicegui import events, ui
from starlette.responses import FileResponse

from guise.aam.rig.coefficients import RigCalibration
from guise.aam.rig.names import ARKIT_NAMES
from guise.app.live.capture import FileCapture
from guise.app.rig.curves import RigCurves
from guise.app.rig.formats import write_curves
from guise.app.rig.live import RigControls
from guise.app.rig.vmc import PORT, VmcSender
from guise.app.studio.camera_page import CameraPage, Visitors
from guise.app.studio.file_picker import FilePicker
from guise.app.studio.frame_socket import MOST_LINES, Peer
from guise.app.studio.live_elements import Performance
from guise.app.studio.rig_heads import RIG, DrawnRig
from guise.app.studio.rig_run import CoefficientOutput, RigRun, VmcStream
from guise.app.studio.rig_stage import RigStage
from guise.app.studio.site import Studio, heading, page, script
from guise.app.studio.store import StudioError, Upload
from guise.app.studio.uploads import CLIP
from guise.common.errors import OutputError

PATH = "/rig"
SOCKET = "/rig/frames/"  # address of the websockets, without the id of a peer
SHIPPED = "/rig/head.glb"  # address of the head that ships
IDLE = "Start asks for your camera, to follow your face."
PRIVACY = (
    "No picture leaves this computer, and none is kept. The head shows nobody's face: what is recorded or sent, when "
    "you say so, are 52 numbers and the turns of head and eyes. Use only clips of people who agreed."
)
KEYS = "C calibrate, H recentre the head, M mirror, R record"
FORMS = {"csv": "Live Link CSV", "jsonl": "JSON lines", "glb": "Animated GLB"}
RECEIVER = "rig_receiver"  # the remembered setting


def register(studio: Studio) -> None:
    """Add the page /rig."""
    visitors, shipped = Visitors(SOCKET), studio.store.incoming / "arkit.drawn.glb"
    nicegui_app.add_api_route(SHIPPED, lambda: FileResponse(shipped))
    page(studio, PATH, "Rig", lambda: _RigPage(studio, visitors).build())


@dataclass(frozen=True, eq=False)
class RecordedCurves:
    """Curves.   number : of it on this page.   name : for the user."""

    number: int
    name: str
    curves: RigCurves


class _RigPage(CameraPage[RigRun]):
    """One visitor's page."""

    update_seconds = 0.2

    def __init__(self, studio: Studio, visitors: Visitors) -> None:
        super().__init__(visitors)
        self.studio = studio
        self._controls, self._vmc = RigControls(mirror=True), VmcStream()
        self._calibration: RigCalibration | None = None
        self._rig: DrawnRig | None = None
        self._recordings: list[RecordedCurves] = []
        self._count = 0  # of the recordings ever made
        self._playing: Upload | None = None  # the clip of the run

    async def build(self) -> None:
        """The whole page."""
        self.prepare()
        ui.context.client.on_delete(lambda: self._vmc.use(None))
        script("heads.js")
        script("rig.js")
        with ui.element("div").classes("desk"):
            with ui.column().classes("picture w-full"):
                self._stage = RigStage()
                with ui.row().classes("w-full justify-center gap-2"):
                    self._buttons()
                self._performance = Performance()
                self._list()
            with ui.column().classes("w-full"):
                self._choices()
        ui.keyboard(on_key=self._key)
        await self._show_head()
        self.update_state()

    def _buttons(self) -> None:
        self.run_buttons()
        self._record = ui.button("Record", icon="fiber_manual_record", on_click=self._toggle_recording)
        self._calibrate = ui.button("Calibrate", icon="tune", on_click=lambda: self._controls.press("c"))
        self._calibrate.tooltip("Ten seconds: rest, brows, smile, open mouth, puckered lips")
        self._centre = ui.button("Recentre", icon="center_focus_strong")
        self._centre.on_click(lambda: self._controls.press("h"))
        self._centre.tooltip("The head looks straight ahead as you hold yours now")
        for button in (self._record, self._calibrate, self._centre):
            button.props("outline")
        self._stage.fill_button()

    def _choices(self) -> None:
        ui.label(PRIVACY)
        with ui.card().classes("w-full"):
            self._head = FilePicker(
                self.studio, "Head", "Your own head: a GLB or VRM with ARKit's shapes", (RIG,), changed=self._show_head
            )  # fmt: skip
            self._shapes = ui.label().classes("opacity-70").props("role=status")
            self._clip = FilePicker(
                self.studio, "Clip", "A clip in place of the camera", (CLIP,), changed=self.update_state
            )  # fmt: skip
        self._mirror = ui.switch("Mirror", value=True, on_change=self._set_mirror)
        known = self.studio.store.setting(RECEIVER) or f"127.0.0.1:{PORT}"
        with ui.row().classes("w-full items-center no-wrap"):
            self._address = ui.input("VMC receiver, host:port", value=known).props("outlined dense")
            self._address.classes("grow")
            self._sends = ui.switch("Send", on_change=self._send)
        with ui.expansion("Coefficients", icon="bar_chart").classes("w-full"):
            rows = "".join(f"<label>{name}<meter max=1></meter></label>" for name in ARKIT_NAMES)
            self._meters = ui.html(f'<div class="weights">{rows}</div>', sanitize=False).classes("w-full")
        ui.label(f"Keys: {KEYS}.").classes("opacity-70")

    def update_state(self) -> None:
        """Update buttons, pictures and texts to the state of the run."""
        super().update_state()
        live, chosen = self.run is not None, next(iter(self._clip.chosen), None)
        for button in (self._record, self._calibrate):
            button.set_enabled(live and self._playing is None)
        self._centre.set_enabled(live)
        self._stage.mirror(self._controls.settings.mirror)
        if live:
            self._stage.begin(own=True)
        else:
            self._stage.end(f"Start plays {chosen.name}." if chosen else IDLE)
            self._performance.end()
            ui.run_javascript(f"guiseRig.end(getHtmlElement({self._stage.own.id}))")

    # -- actions ---------------------------------------------------------------------------------------

    async def _show_head(self) -> None:
        """Show the chosen head, or the one that ships."""
        own = next(iter(self._head.chosen), None)
        if own is None:
            url, file = SHIPPED, self.studio.store.incoming / "arkit.drawn.glb"
        else:
            file = own.path.with_suffix(".drawn.glb")
            url = self.studio.url(file)
        rig = await asyncio.to_thread(DrawnRig.of, None if own is None else own.path, file)
        self._rig = rig
        turns = ", ".join(rig.head.nodes) or "as a whole, for it has no node for the head"
        name = own.name if own else "The head that ships"
        self._shapes.text = f"{name} has {rig.head.shapes} of 52 shapes, and turns {turns}."
        self._stage.show_head(rig, url)

    def say_waiting(self) -> None:
        self._stage.say("Connecting …" if self._clip.chosen else "Allow the camera …")

    def new_peer(self) -> Peer:
        return Peer()

    def asked(self, address: str) -> str:
        own = f"getHtmlElement({self._stage.own.id})"
        clip = next(iter(self._clip.chosen), None)
        ui.run_javascript(
            f"guiseRig.meters = [...getHtmlElement({self._meters.id}).querySelectorAll('meter')]"
        )
        url = "" if clip is None else self.studio.url(clip.path)
        show = f"guiseRig.showing({own}, '{url}')"
        return f"{'null' if clip else own}, null, '{address}', false, {MOST_LINES}, {show}"

    async def make_run(self, peer: Peer) -> RigRun:
        """A run of the camera, or of a clip, of which every frame is shown and recorded, once."""
        self._playing = clip = next(iter(self._clip.chosen), None)
        camera = peer.camera if clip is None else partial(FileCapture, clip.path, paced=False)
        outputs = [CoefficientOutput(peer, clip=clip is not None), self._vmc]
        return RigRun(
            camera, self._calibration, self._controls, self._keep, outputs, peer.alive, clip=clip is not None
        )  # fmt: skip

    def _keep(self, calibration: RigCalibration) -> None:
        self._calibration = calibration

    def report(self, run: RigRun) -> None:
        while not run.notes.empty():
            ui.notify(run.notes.get())
        if not run.running:
            self._end_recording(run)

    def follow(self, run: RigRun) -> None:
        self._stage.show(run.latest, run.recording_seconds)
        self._performance.show(run.stats)
        self._record.text = "Record" if run.recording_seconds is None else "Stop recording"

    def _toggle_recording(self) -> None:
        if (run := self.run) is None or self._playing is not None:
            return
        if run.recording_seconds is None:
            run.record()
        else:
            self._end_recording(run)
        self.follow(run)

    def _end_recording(self, run: RigRun) -> None:
        """List what a run has recorded."""
        if run.recording_seconds is None:
            return
        clip = self._playing
        self._record.text = "Record"
        if (curves := run.recorded()) is None:
            ui.notify("Nothing is recorded: no face was seen.", type="warning")
            return
        self._count += 1
        name = f"{clip.name if clip else 'rig'}-{self._count}"
        self._recordings.insert(0, RecordedCurves(self._count, name, curves))
        self._list.refresh()

    @ui.refreshable_method
    def _list(self) -> None:
        """Recordings, newest first."""
        if self._recordings:
            heading("Recordings")
            ui.label("They last until this page is closed.").classes("opacity-70")
        for one in self._recordings:
            with ui.row().classes("w-full items-center gap-2"):
                seconds = one.curves.seconds
                words = f"{one.name}: {seconds[-1] - seconds[0]:.1f} s, {len(seconds)} frames"
                ui.label(words).classes("grow break-all")
                for form, label in FORMS.items():
                    button = ui.button(label, icon="download", on_click=partial(self._download, one, form))
                    button.props("outline").props["aria-label"] = f"{label} of {one.name}"
                button = ui.button(icon="delete", color=None, on_click=partial(self._delete, one)).props(
                    "flat round"
                )
                button.props["aria-label"] = f"Delete {one.name}"

    async def _download(self, one: RecordedCurves, form: str) -> None:
        """Write a file in the format of a suffix; a GLB is of the head that is shown."""
        assert self._rig is not None
        path = self.folder / f"{one.number}.{form}"
        await asyncio.to_thread(write_curves, path, one.curves, self._rig.head)
        ui.download.file(path, f"{one.name}.{form}")

    def _delete(self, one: RecordedCurves) -> None:
        self._recordings.remove(one)
        for form in FORMS:
            (self.folder / f"{one.number}.{form}").unlink(missing_ok=True)
        self._list.refresh()

    async def _send(self, event: events.ValueChangeEventArguments[Any]) -> None:
        """Send to the receiver from now on, or no longer."""
        self._address.set_enabled(not event.value)
        if not event.value:
            self._vmc.use(None)
            return
        try:
            self._vmc.use(await asyncio.to_thread(VmcSender, str(self._address.value).strip()))
        except OutputError as error:
            self._sends.value = False
            raise StudioError(str(error).replace("--vmc", "the address of the receiver")) from error
        self.studio.store.remember(RECEIVER, self._address.value)

    def _set_mirror(self, event: events.ValueChangeEventArguments[Any]) -> None:
        self._controls.change(mirror=event.value)
        self._stage.mirror(event.value)

    def _key(self, event: events.KeyEventArguments) -> None:
        """The keys of the window, and R."""
        modified = event.modifiers.ctrl or event.modifiers.alt or event.modifiers.meta
        if not event.action.keydown or event.action.repeat or modified:
            return
        key = str(event.key.name).lower()
        if key == "r":
            self._toggle_recording()
        elif key == "m":
            self._mirror.value = not self._mirror.value
        elif key == "h" or (key == "c" and self._playing is None):
            self._controls.press(key)
