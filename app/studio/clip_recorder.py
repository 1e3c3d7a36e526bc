"""Records a clip with the browser's camera (static/recorder.js) and hands it to an upload field."""

from __future__ import annotations

from nicegui import ui

from guise.app.studio.site import camera_error, script

MAX_SECONDS = 20
MIN_SECONDS = 5
HINTS = {
    0: "Look into the camera.",
    4: "Say a few sentences.",
    11: "Smile, and close your eyes once or twice.",
    15: "Turn your head slowly to the left and to the right.",
    MAX_SECONDS: "That is enough: use it, or discard it.",
}


class ClipRecorder:
    """A button that records up to MAX_SECONDS; the clip is taken when the user says so.

    `stage` adds the place for the camera's picture and the hints.
    """

    def __init__(self, field: ui.upload) -> None:
        script("recorder.js")
        self._field = field
        self._seconds = 0
        self._begin = ui.button("Record with the camera", icon="videocam", on_click=self._start)

    def stage(self) -> None:
        """Add the place for the picture, hidden until recording starts."""
        with ui.column().classes("w-full items-start") as self._stage:
            self._video = ui.element("video").props("autoplay muted playsinline aria-label=Camera")
            self._video.classes("w-full max-w-md rounded -scale-x-100")
            with ui.row().classes("items-center"):
                self._ring = ui.circular_progress(0, min=0, max=MAX_SECONDS, show_value=False)
                self._ring.props('aria-label="Time"')
                self._hint = ui.label().props("role=status").classes("text-h6")
            with ui.row():
                self._finish = ui.button("Use it", icon="check", on_click=lambda: self._choose(wanted=True))
                self._discard = ui.button("Discard", on_click=lambda: self._choose(wanted=False))
                self._discard.props("outline")
        self._timer = ui.timer(1.0, self._tick, active=False)
        self._show(recording=False)

    async def _start(self) -> None:
        """Ask for the camera, which may take the user a while."""
        self._show(recording=True)
        self._hint.text = "Allow the camera …"
        code = f"return await guiseRecorder.start({self._element()}, {self._field.id})"
        error = await ui.run_javascript(code, timeout=120.0)
        if error:
            self._show(recording=False)
            ui.notify(camera_error(error), type="negative")
            return
        self._seconds, self._hint.text = 0, HINTS[0]
        self._discard.enable()
        self._timer.activate()

    def _tick(self) -> None:
        self._seconds += 1
        self._ring.value = self._seconds
        self._hint.text = HINTS.get(self._seconds, self._hint.text)
        self._finish.set_enabled(self._seconds >= MIN_SECONDS)
        if self._seconds >= MAX_SECONDS:
            self._timer.deactivate()
            ui.run_javascript(f"guiseRecorder.end({self._element()})")

    def _choose(self, *, wanted: bool) -> None:
        """End the recording; a wanted one is uploaded."""
        self._timer.deactivate()
        ui.run_javascript(f"guiseRecorder.choose({self._element()}, {str(wanted).lower()})")
        self._show(recording=False)

    def _element(self) -> str:
        """The video element, in JavaScript."""
        return f"getHtmlElement({self._video.id})"

    def _show(self, *, recording: bool) -> None:
        self._stage.set_visibility(recording)
        self._begin.set_enabled(not recording)
        self._ring.value = 0
        self._finish.disable()
        self._discard.disable()
