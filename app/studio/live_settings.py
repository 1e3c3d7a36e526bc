"""The settings of the page Live, beside the stage: faces, who is at the camera, how the picture is made."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from guise.app.drawing.look import DrawingChoices
from guise.app.live.options import LiveSettings
from guise.app.live.virtualcam import VirtualCamera
from guise.app.studio.live_elements import select
from guise.app.studio.live_faces import NOBODY, LiveCast
from guise.app.studio.option_form import PresetChoice, taken
from guise.app.studio.portraits import Portraits
from guise.app.studio.site import advanced
from guise.common.errors import OutputError

BROWSER, COMPUTER = "browser", "server"
CAMERAS = {BROWSER: "This browser's camera", COMPUTER: "The computer's camera"}
SIZES = {
    480: "480p, smoother",
    720: "720p, sharper",
}  # by lines of the picture, which keeps the camera's aspect
CAMERA_SIZES = {480: (854, 480), 720: (1280, 720)}  # pixels, of the computer's camera, by lines
MODES = {"swap": "Swap", "puppet": "Puppet", "off": "Cover"}
STYLES = {"mosaic": "Mosaic", "solid": "Solid", "blur": "Blur"}
SWITCHES = ("mirror", "mesh", "mask")
KEYS = (
    "1 to 9 fictional face, up and down expression, S swap, P puppet, O cover, M mirror, L mesh, K mask, R record, "
    "C snapshot, E enroll"
)
PERSON = "live_person"  # the remembered setting: who is at the camera


class SettingsPanel:
    """All settings; most of them can be changed while a run goes on.

    Parameters
    ----------
    changed : called when something was chosen that the page shows elsewhere.
    person_chosen : called with the id of another person at the camera.
    """

    def __init__(
        self, cast: LiveCast, changed: Callable[[], None], person_chosen: Callable[[str], Awaitable[None]]
    ) -> None:
        self._cast, self._controls, self._changed = cast, cast.controls, changed
        self._person_chosen, self._pressed = person_chosen, cast.chosen
        settings, specs = self._controls.settings, list(cast.faces)
        self._portraits = Portraits(
            cast.studio,
            cast.faces,
            cast.chosen,
            "Face to show",
            lambda spec: self.choose_face(specs.index(spec)),
        )
        with ui.column().classes("gap-0 w-full"):
            ui.label("Mode").props("id=live-mode")
            self._mode = ui.toggle(MODES, value=settings.mode, on_change=self._changer("mode"))
            self._mode.props('aria-labelledby="live-mode"')
        with ui.column().classes("gap-0 w-full"):
            alpha = ui.label()
            self._alpha = ui.slider(min=0, max=1, step=0.05, value=settings.alpha)
            self._alpha.on_value_change(self._changer("alpha")).props('aria-label="Strength of expression"')
            alpha.bind_text_from(self._alpha, "value", lambda v: f"Strength of expression: {v:.2f}")
        self._sources()
        with advanced():
            PresetChoice(["live"], self._options, self._use).build()
            self._style = select("Cover style", STYLES, settings.style, self._changer("style"))
            self._size = select("Resolution", SIZES, 480, lambda _: None)
            self._switches = {name: self._switch(name) for name in SWITCHES}
            ui.label(f"Keys: {KEYS}.").classes("opacity-70")

    def _options(self) -> dict[str, Any]:
        """What is set, by options of `guise live`."""
        now, size = self._controls.settings, CAMERA_SIZES[self.lines]
        return {
            "identity": [self._cast.names[now.identity]], "mode": now.mode, "alpha": now.alpha, "cover": now.style,
            "mirror": now.mirror, "size": f"{size[0]}x{size[1]}",
        }  # fmt: skip

    async def _use(self, given: dict[str, Any]) -> None:
        """Take the options of a preset; its first face that is known here is shown, if the user may."""
        settings, drawing = taken(LiveSettings, given), taken(DrawingChoices, given)
        self._controls.change(
            mode=settings.mode, style=settings.style, alpha=drawing.alpha, mirror=given.get("mirror", True)
        )
        lines = str(given.get("size", "")).rpartition("x")[2]
        self._size.value = int(lines) if lines in map(str, SIZES) else min(SIZES)
        names, wanted = self._cast.names, given.get("identity", [])
        for name in [wanted] if isinstance(wanted, str) else wanted:
            if name in names:
                await self._cast.choose(names.index(name))
                break
        self.show()
        self._changed()

    def _sources(self) -> None:
        people, store = self._cast.people(), self._cast.studio.store
        remembered = store.setting(PERSON)
        clips = {clip.id: f"The clip {clip.name}" for clip in store.clips()}
        person = remembered if remembered in people else NOBODY
        self._person = select("Who is at the camera", people, person, self._choose_person)
        self._camera = select("Camera", CAMERAS | clips, BROWSER, lambda _: self._changed())
        with ui.row():
            self._own = ui.switch("Own picture", value=True, on_change=lambda _: self._changed())
            self._microphone = ui.switch("Microphone", value=True)
            self._microphone.tooltip("The sound of recordings; heard nowhere else")
            self._virtual = ui.switch("Virtual camera")
            self._virtual.set_visibility(_has_virtual_camera())

    @property
    def camera(self) -> str:
        """BROWSER, COMPUTER or a clip's id."""
        return str(self._camera.value)

    @property
    def lines(self) -> int:
        """Of the picture that is asked of the camera."""
        return int(self._size.value)

    @property
    def person(self) -> str:
        """The id of who is at the camera, or NOBODY."""
        return str(self._person.value)

    @person.setter
    def person(self, value: str) -> None:
        self._person.value = value

    @property
    def with_sound(self) -> bool:
        """Whether recordings have the microphone's sound."""
        return bool(self._microphone.value) and self.camera in CAMERAS

    @property
    def to_virtual_camera(self) -> bool:
        """Whether a call program gets the result."""
        return bool(self._virtual.value)

    @property
    def shows_own(self) -> bool:
        """Whether the camera's own picture is shown."""
        return bool(self._own.value) and self.camera == BROWSER

    def live(self, on: bool) -> None:
        """A run has begun or ended: what the camera is asked for can be changed only between two runs."""
        for element in (self._camera, self._size):
            element.set_enabled(not on)

    def show(self) -> None:
        """Show what the keys have changed."""
        settings = self._controls.settings
        self._mode.value, self._alpha.value, self._style.value = settings.mode, settings.alpha, settings.style
        for name, switch in self._switches.items():
            switch.value = getattr(settings, name)
        self._pressed = self._cast.chosen
        self._portraits.press(self._pressed)

    def follow(self) -> None:
        """Show the face that was proposed, and choose the person who has just been enrolled."""
        if self._pressed != self._cast.chosen:
            self.show()
        if self._cast.enrolled and self.person != self._cast.enrolled:
            self._person.set_options(self._cast.people(), value=self._cast.enrolled)
            self._cast.studio.store.remember(PERSON, self._cast.enrolled)

    async def choose_face(self, number: int) -> None:
        """Show another face, if the user may."""
        await self._cast.choose(number)
        self.show()

    def _switch(self, name: str) -> ui.switch:
        return ui.switch(
            name.capitalize(), value=getattr(self._controls.settings, name), on_change=self._changer(name)
        )

    def _changer(self, name: str) -> Callable[[Any], None]:
        """A handler that changes a setting."""

        def change(event: Any) -> None:
            self._controls.change(**{name: event.value})
            self._changed()

        return change

    async def _choose_person(self, event: Any) -> None:
        """Continue with another person, or enrol."""
        if not event.value or event.value != self._cast.enrolled:
            self._cast.studio.store.remember(PERSON, event.value)
            await self._person_chosen(event.value)


def _has_virtual_camera() -> bool:
    try:
        VirtualCamera().check()
    except OutputError:
        return False
    return True
