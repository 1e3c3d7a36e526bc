"""Records a clip with the browser's camera and hands it to an upload field.

MediaRecorder writes it in the browser; nothing of it leaves the browser before the end, and sound is not recorded.
"""

from __future__ import annotations

from nicegui import ui

LONGEST = 20  # seconds
SHORTEST = 5
HINTS = {
    0: "Look into the camera.",
    4: "Say a few sentences.",
    11: "Smile, and close your eyes once or twice.",
    15: "Turn your head slowly to the left and to the right.",
}
MISTAKES = {
    "NotAllowedError": "The browser may not use the camera: allow it beside the address, then record again.",
    "NotFoundError": "The browser has found no camera: connect one, or upload a clip.",
    "NotReadableError": "Another program uses the camera: close it, then record again.",
}
_START = """
try {
  const stream = await navigator.mediaDevices.getUserMedia({video: {width: {ideal: 1280}, height: {ideal: 720}}});
  const video = getHtmlElement(VIDEO), pieces = [];
  const recorder = video.recorder = new MediaRecorder(stream, {videoBitsPerSecond: 8e6});
  recorder.ondataavailable = (event) => pieces.push(event.data);
  recorder.onstop = () => {
    stream.getTracks().forEach((track) => track.stop());
    video.srcObject = null;
    const type = recorder.mimeType, name = type.includes("mp4") ? "recording.mp4" : "recording.webm";
    if (video.wanted) getElement(FIELD).$refs.qRef.addFiles([new File(pieces, name, {type})]);
  };
  video.srcObject = stream;
  recorder.start();
  return "";
} catch (error) {
  return error.name;
}
"""


class Recorder:
    """A button that records up to LONGEST seconds; `stage` is where the camera's picture and what to do appear."""

    def __init__(self, field: ui.upload) -> None:
        self._field = field
        self._seconds = 0
        self._begin = ui.button("Record with the camera", icon="videocam", on_click=self._start)

    def stage(self) -> None:
        """Make the place for the picture, hidden until then."""
        with ui.column().classes("w-full items-start") as self._stage:
            self._video = ui.element("video").props("autoplay muted playsinline aria-label=Camera")
            self._video.classes("w-full max-w-md rounded -scale-x-100")
            with ui.row().classes("items-center"):
                self._ring = ui.circular_progress(0, min=0, max=LONGEST, show_value=False)
                self._ring.props('aria-label="Time"')
                self._hint = ui.label().props("role=status").classes("text-h6")
            with ui.row():
                self._finish = ui.button("Use it", icon="check", on_click=lambda: self._stop(wanted=True))
                self._drop = ui.button("Throw away", on_click=lambda: self._stop(wanted=False)).props(
                    "outline"
                )
        self._timer = ui.timer(1.0, self._tick, active=False)
        self._show(recording=False)

    async def _start(self) -> None:
        """Ask for the camera, which may take the user a while."""
        self._show(recording=True)
        self._hint.text = "Allow the camera …"
        code = _START.replace("VIDEO", str(self._video.id)).replace("FIELD", str(self._field.id))
        mistake = await ui.run_javascript(code, timeout=120.0)
        if mistake:
            self._show(recording=False)
            ui.notify(MISTAKES.get(mistake, f"The camera cannot be used ({mistake})."), type="negative")
            return
        self._seconds, self._hint.text = 0, HINTS[0]
        self._drop.enable()
        self._timer.activate()

    def _tick(self) -> None:
        self._seconds += 1
        self._ring.value = self._seconds
        self._hint.text = HINTS.get(self._seconds, self._hint.text)
        self._finish.set_enabled(self._seconds >= SHORTEST)
        if self._seconds >= LONGEST:
            self._stop(wanted=True)

    def _stop(self, *, wanted: bool) -> None:
        """End the recording; a wanted one is uploaded."""
        self._timer.deactivate()
        video = f"getHtmlElement({self._video.id})"
        ui.run_javascript(f"{video}.wanted = {str(wanted).lower()}; {video}.recorder.stop()")
        self._show(recording=False)

    def _show(self, *, recording: bool) -> None:
        self._stage.set_visibility(recording)
        self._begin.set_enabled(not recording)
        self._ring.value = 0
        self._finish.disable()
        self._drop.disable()
