"""The page Live: the browser's camera, or the computer's, with another face."""

from __future__ import annotations

import asyncio
import json
import shutil
import tempfile
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import app as nicegui_app
from nicegui import ui

from guise.aam.model import Identity
from guise.app.live.capture import CameraCapture
from guise.app.live.controls import Controls, Settings
from guise.app.live.pipeline import Stats
from guise.app.live.session import Plan
from guise.app.media import MediaError
from guise.app.media.pictures import save_picture
from guise.app.people.montage import montage
from guise.app.studio.rtc import Peer, PeerOutput
from guise.app.studio.show import Show
from guise.app.studio.site import Studio, heading, page
from guise.app.swapping.donors import SUFFIX, open_donor

OWN, SERVER = "browser", "server"
CAMERAS = {OWN: "This browser's camera", SERVER: "The computer's camera"}
MODES = {"swap": "Swap", "puppet": "Puppet", "off": "Cover"}
STYLES = {"mosaic": "Mosaic", "solid": "Solid", "blur": "Blur"}
STATES = {
    "swapped": "",
    "covered": "Your face is covered: it cannot be seen well enough.",
    "lost": "No face is seen: all is covered.",
    "off": "Your face is covered, as you chose.",
}
MISTAKES = {
    "NotAllowedError": "The browser may not use the camera: allow it beside the address, then start again.",
    "NotFoundError": "The browser has found no camera: connect one, or choose the computer's camera.",
    "NotReadableError": "Another program uses the camera: close it, then start again.",
    "NetworkError": (
        "The browser connects nothing while this computer is in no network: join one (no picture is sent there), "
        "or use guise live in a terminal."
    ),
}
NOBODY = ""  # instead of a person's id: enrol
SIZE = (640, 480)  # pixels, of the computer's camera
LOOK = 0.5  # seconds between two looks at what goes on
PAST = 120  # looks that the graph shows
PATIENCE = 120.0  # seconds in which the user may allow the camera
_PERSON = "live_person"  # the setting


def register(studio: Studio) -> None:
    """Add the page / and what it loads."""
    shows: set[Show] = set()
    nicegui_app.add_static_files("/static", Path(__file__).parent / "static")
    nicegui_app.on_shutdown(lambda: _end(shows))
    page(studio, "/", "Live", lambda: _Page(studio, shows).build())


def _end(shows: set[Show]) -> None:
    for show in shows:
        show.stop()


class _Page:
    """One visitor's page, with at most one run.

    shows : all runs of the studio, which end with it.
    """

    def __init__(self, studio: Studio, shows: set[Show]) -> None:
        self.studio, self._shows = studio, shows
        self._faces = studio.faces()
        self._controls = Controls(len(self._faces), Settings(identity=self._fictional(), mirror=True))
        self._folder = Path(tempfile.mkdtemp(prefix="guise-live-"))
        self._peer: Peer | None = None
        self._show: Show | None = None
        self._made = ""  # id of the person that was just learned
        self._offered: set[Path] = set()
        self._past: deque[float] = deque([0.0] * PAST, PAST)

    def build(self) -> None:
        self._client = ui.context.client
        self._client.on_delete(self._leave)
        ui.add_head_html('<script src="/static/live.js"></script>')
        ui.on("live-camera-ended", self._camera_ended)
        with ui.column().classes("w-full gap-4"):
            self._stage()
            self._choices()
            self._readout()
        self._show_state()
        self._timer = ui.timer(LOOK, self._look, active=False)

    # -- what is seen ---------------------------------------------------------------------------------------

    def _stage(self) -> None:
        with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            self._own = _video("Your camera")
            self._result = _video("The result")
        with ui.row().classes("w-full items-center no-wrap min-h-12"):
            self._ring = ui.circular_progress(0, min=0, max=1, show_value=False, size="3rem")
            self._ring.props('aria-label="Enrolment"')
            self._message = ui.label().classes("text-h6").props("role=status")
        with ui.row():
            self._start_button = ui.button("Start", icon="play_arrow", on_click=self._start)
            self._stop_button = ui.button("Stop", icon="stop", on_click=self._stop)
            self._record = ui.button("Record", icon="fiber_manual_record", on_click=self._toggle_recording)
            self._record.props("outline")
            self._snap = ui.button("Snapshot", icon="photo_camera", on_click=self._snapshot).props("outline")

    def _choices(self) -> None:
        """Everything that can be chosen; most of it also while it runs."""
        settings, people = self._controls.settings, self._people()
        remembered = self.studio.store.setting(_PERSON)
        with ui.card().classes("w-full"), ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            self._camera = _select("Camera", CAMERAS, OWN, lambda _: self._show_state())
            person = remembered if remembered in people else next(iter(people))
            self._person = _select("Who is at the camera", people, person, self._choose_person)
            _select(
                "Face to show",
                dict(enumerate(self._faces.values())),
                settings.identity,
                self._changer("identity"),
            )
            _select("What is covered", STYLES, settings.style, self._changer("style"))
            with ui.column().classes("gap-0"):
                ui.label("Mode").props("id=live-mode")
                mode = ui.toggle(MODES, value=settings.mode, on_change=self._changer("mode"))
                mode.props('aria-labelledby="live-mode"')
            with ui.column().classes("gap-0"):
                alpha = ui.label()
                slider = ui.slider(min=0, max=1, step=0.05, value=settings.alpha)
                slider.on_value_change(self._changer("alpha")).props('aria-label="Expression"')
                alpha.bind_text_from(slider, "value", lambda v: f"Expression let through: {v:.2f}")
            with ui.row():
                ui.switch("Mirror", value=settings.mirror, on_change=self._changer("mirror"))
                ui.switch("Mesh", on_change=self._changer("mesh"))
                ui.switch("Mask", on_change=self._changer("mask"))

    def _readout(self) -> None:
        with ui.card().classes("w-full"):
            heading("How fast it is")
            self._figures = ui.label().classes("tabular-nums")
            self._graph = ui.echart(_graph(list(self._past))).classes("w-full h-40")
            self._graph.props('role=img aria-label="Latency on the server, lately"')

    def _show_state(self) -> None:
        """Make buttons, pictures and words fit what goes on."""
        live = self._show is not None
        self._start_button.set_visibility(not live)
        self._stop_button.set_visibility(live)
        for element in (self._record, self._snap):
            element.set_enabled(live)
        self._camera.set_enabled(not live)
        self._own.set_visibility(self._camera.value == OWN)
        if not live:
            self._ring.set_visibility(False)
            self._message.text = "Start, and you are asked for the camera; no picture leaves this computer."
            self._figures.text = figures(Stats())
        for video in (self._own, self._result):
            video.classes(**{"add" if self._controls.settings.mirror else "remove": "-scale-x-100"})

    # -- what happens ---------------------------------------------------------------------------------------

    async def _start(self) -> None:
        """Connect the browser and begin; the camera may have to be allowed first."""
        self._start_button.disable()
        self._message.text = "Allow the camera …" if self._camera.value == OWN else "Connecting …"
        try:
            await self._connect()
        finally:
            self._start_button.enable()
            self._show_state()

    async def _connect(self) -> None:
        own = f"getHtmlElement({self._own.id})" if self._camera.value == OWN else "null"
        code = f"return await guiseLive.begin({own}, getHtmlElement({self._result.id}))"
        offer: dict[str, str] = await ui.run_javascript(code, timeout=PATIENCE)
        if "error" in offer:
            why = offer["error"]
            ui.notify(MISTAKES.get(why, f"The camera cannot be used ({why})."), type="negative")
            return
        self._peer = Peer()
        answer = await self._peer.answer(offer)
        ui.run_javascript(f"guiseLive.accept({json.dumps(answer)})")
        await self._begin()

    async def _begin(self) -> None:
        """Run with the person that is chosen."""
        assert self._peer is not None
        plan = await asyncio.to_thread(self._plan, self._person.value)
        camera = self._peer.camera if self._camera.value == OWN else _computers_camera
        output, alive = PeerOutput(self._peer, self._controls), self._peer.alive
        self._show = Show(camera, plan, self._controls, output, self._folder, alive)
        self._shows.add(self._show)
        self._timer.activate()

    def _plan(self, person: str) -> Plan:
        """Load the models.  ModelError when one cannot be used."""
        faces = [Identity.load(face) if face.endswith(SUFFIX) else open_donor(face) for face in self._faces]
        known = Identity.load(self.studio.store.person(person).path) if person else None
        return Plan(faces, known, name="Me", keep=self._keep)

    def _keep(self, made: Identity) -> None:
        """Add the person who was learned to the studio's people, in the thread of the work."""
        person = self.studio.store.add_person(made.name, None)
        save_picture(person.montage, montage(made))
        made.save(person.path)
        self._made = person.id

    async def _stop(self) -> None:
        """End the run and the connection."""
        self._timer.deactivate()
        await self._end_show()
        if self._peer is not None:
            await self._peer.close()
        self._peer = None
        ui.run_javascript("guiseLive.end()")
        self._show_state()

    async def _end_show(self) -> None:
        if (show := self._show) is not None:
            self._show = None
            await asyncio.to_thread(show.stop)
            self._shows.discard(show)
            self._tell(show)

    async def _leave(self) -> None:
        """The tab was closed."""
        await self._end_show()
        if self._peer is not None:
            await self._peer.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    async def _camera_ended(self) -> None:
        await self._stop()
        ui.notify("The camera is gone: connect it, then start again.", type="warning")

    async def _choose_person(self, event: Any) -> None:
        """Go on with another person, or enrol."""
        person: str = event.value
        if person == self._made:
            return
        self.studio.store.remember(_PERSON, person)
        if self._show is not None:
            await self._end_show()
            await self._begin()

    def _changer(self, name: str) -> Callable[[Any], None]:
        """What takes a new value of a setting."""

        def change(event: Any) -> None:
            self._controls.change(**{name: event.value})
            self._show_state()

        return change

    def _toggle_recording(self) -> None:
        if self._show is not None:
            self._show.record()

    async def _snapshot(self) -> None:
        if self._show is not None and (path := await asyncio.to_thread(self._show.snapshot)) is not None:
            ui.download.file(path)

    async def _look(self) -> None:
        """Show what has happened since the last look."""
        show, peer = self._show, self._peer
        if show is None or peer is None:
            return
        if not peer.alive() or not show.running:
            await self._stop()
            return
        self._tell(show)
        self._show_latest(show)
        if self._made and self._person.value != self._made:
            self._person.set_options(self._people(), value=self._made)
            self.studio.store.remember(_PERSON, self._made)

    def _show_latest(self, show: Show) -> None:
        if (shown := show.latest) is not None:
            self._message.text = shown.message or STATES.get(shown.look.outcome, "")
            self._ring.set_visibility(shown.ring is not None)
            self._ring.value = shown.ring or 0.0
        self._record.text = "End recording" if show.recording else "Record"
        stats = show.stats
        self._past.append(round(stats.latency, 1))
        self._figures.text = figures(stats)
        self._graph.options["series"][0]["data"] = list(self._past)
        self._graph.update()

    def _tell(self, show: Show) -> None:
        """Say what is to be said, and hand over recordings that are complete."""
        while not show.notes.empty():
            ui.notify(show.notes.get())
        for path in show.recorded():
            if path not in self._offered:
                self._offered.add(path)
                ui.download.file(path)

    def _fictional(self) -> int:
        """Which of the faces is the first of the gallery's."""
        return next(i for i, face in enumerate(self._faces) if not face.endswith(SUFFIX))

    def _people(self) -> dict[str, str]:
        """Ids and names of those who can be at the camera."""
        return {person.id: person.name for person in self.studio.store.people()} | {NOBODY: "Enrol me (20 s)"}


def _computers_camera() -> CameraCapture:
    try:
        return CameraCapture(size=SIZE)
    except MediaError as error:
        raise MediaError(
            "the computer's camera cannot be opened: connect one, or use this browser's"
        ) from error


def figures(stats: Stats) -> str:
    """The read-out in words."""
    return (
        f"{stats.fps:.0f} frames a second · latency {stats.latency:.0f} ms, 95 % {stats.latency_95:.0f} ms · "
        f"{stats.dropped + stats.skipped} dropped"
    )


def _video(name: str) -> ui.element:
    """A place for moving pictures."""
    video = ui.element("video").props("autoplay muted playsinline")
    video.props["aria-label"] = name
    return video.classes("w-full rounded bg-black aspect-[4/3] object-contain")


def _select(label: str, options: dict[Any, str], value: Any, change: Callable[[Any], Any]) -> ui.select:
    return (
        ui.select(options, label=label, value=value, on_change=change)
        .classes("w-full")
        .props("outlined dense")
    )


def _graph(past: list[float]) -> dict[str, Any]:
    """Options of a line through latencies, milliseconds."""
    return {
        "animation": False,
        "grid": {"left": 45, "right": 10, "top": 30, "bottom": 10},
        "xAxis": {"type": "category", "show": False},
        "yAxis": {"type": "value", "name": "ms", "min": 0, "splitNumber": 3},
        "textStyle": {"color": "#888"},
        "series": [{"type": "line", "data": past, "showSymbol": False}],
    }
