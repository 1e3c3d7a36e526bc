"""The stage of the page Live: the result as large as the window allows, the camera as an inset, and what is said."""

from __future__ import annotations

from nicegui import ui

from guise.app.live.output import OutputFrame, clock
from guise.app.live.overlay import mesh_path
from guise.app.studio.live_elements import video

STATES = {
    "swapped": "",
    "covered": "Your face is covered: it cannot be seen well enough.",
    "lost": "No face found: everything is covered.",
    "off": "Your face is covered, as you chose.",
    "enrolling": "Everything is covered until enough of you has been seen.",
}


class Stage:
    """What a visitor sees of a run, and what they are told meanwhile.

    Attributes
    ----------
    own, result : video elements with the camera's picture and with what came of it; the latter may be another element.
    """

    own_name = "Your camera"

    def __init__(self) -> None:
        with ui.element("div").classes("stage-place"):
            with ui.element("div").classes("stage") as box:
                self._box = box
                self.result = self.build_result()
                with ui.element("div").classes("inset") as self._inset:
                    self.own = video(self.own_name)
                    with ui.element("svg").classes("absolute inset-0 w-full h-full") as self._drawing:
                        self._drawing.props('aria-hidden="true" pointer-events="none"')
                        self._mesh = ui.element("path").props('fill="none" stroke="#5af082" d=""')
                self._path = ""
                self._clock = ui.label().classes("clock tabular-nums").props("role=timer")
                self._clock.props["aria-label"] = "Recorded"
            with ui.element("div").classes("words") as self._words:
                self._ring = ui.circular_progress(0, min=0, max=1, show_value=False, size="2.5rem")
                self._ring.props('aria-label="Enrollment"')
                with ui.column().classes("gap-0"):
                    self._message = ui.label().classes("text-bold").props("role=status")
                    self._missing = ui.label().classes("tabular-nums")
        box.on("dblclick", js_handler=f"() => guiseLive.fillScreen({box.id})")

    def build_result(self) -> ui.element:
        """The place of the result."""
        return video("The result")

    def fill_button(self) -> None:
        """Add what shows the stage on the whole screen."""
        fill = ui.button("Full screen", icon="fullscreen").props("outline")
        fill.on("click", js_handler=f"() => guiseLive.fillScreen({self._box.id})")

    def buttons(self) -> None:
        """Add what shows the stage elsewhere."""
        self.fill_button()
        pop = ui.button("Pop out", icon="open_in_new").props("outline").classes("max-sm:hidden")
        pop.on("click", js_handler=f"() => guiseLive.popOut({self.result.id})")
        pop.tooltip("The result alone in a window of its own, for OBS and the like")

    def mirror(self, on: bool) -> None:
        """Show all pictures as in a mirror, or not."""
        for picture in (self.own, self.result, self._drawing):
            picture.classes(**{"add" if on else "remove": "-scale-x-100"})

    def say(self, message: str, missing: str = "", ring: float | None = None) -> None:
        """Say something, and how far the enrolment is."""
        self._message.text, self._missing.text = message, missing
        self._ring.value = ring or 0.0
        self._ring.set_visibility(ring is not None)
        self._missing.set_visibility(bool(missing))
        self._words.classes(**{"remove" if message or missing else "add": "silent"})

    def begin(self, *, own: bool) -> None:
        """A run has begun.   own : show the camera's own picture."""
        self._inset.set_visibility(own)
        self._words.classes(remove="idle")

    def end(self, sentence: str) -> None:
        """There is no run; say so in the middle."""
        self._inset.set_visibility(False)
        self._words.classes("idle")
        self.say(sentence)
        self.show(None, None)

    def show(self, shown: OutputFrame | None, recorded: float | None) -> None:
        """Say what there is to say about a frame.   recorded : seconds so far, or None."""
        if shown is not None:
            self.say(shown.message or STATES.get(shown.result.outcome, ""), shown.missing, shown.ring)
        self._clock.set_visibility(recorded is not None)
        self._clock.text = "" if recorded is None else f"● {clock(recorded)}"

    def draw_mesh(self, shown: OutputFrame | None) -> None:
        """While somebody is enrolled, draw what was found over their own picture, which no output shows."""
        path, size = "", (1, 1)
        if shown is not None and shown.ring is not None and shown.result.mesh is not None:
            path, size = mesh_path(shown.result.mesh), (shown.frame.width, shown.frame.height)
        if path != self._path:
            self._path = path
            ui.run_javascript(f"guiseLive.outline({self._mesh.id}, '{path}', {size[0]}, {size[1]})")
