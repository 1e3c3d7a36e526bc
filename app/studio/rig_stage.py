"""The stage of the page Rig: a head in three dimensions, the camera or clip as an inset, and what is said."""

from __future__ import annotations

from nicegui import ui

from guise.app.live.output import OutputFrame
from guise.app.rig.shown import RigFrame
from guise.app.studio.head_dialog import BACKGROUND, CAMERA_HEAD_HEIGHTS
from guise.app.studio.live_stage import Stage
from guise.app.studio.rig_heads import DrawnRig

FRAMES_PER_SECOND = 30
NO_FACE = "No face is seen: come before the camera."


class RigStage(Stage):
    """What a visitor sees of a run."""

    own_name = "Your camera or clip"

    def __init__(self) -> None:
        self._head, self._url, self._mirrored = "", "", True
        self._drawn: DrawnRig | None = None
        super().__init__()
        self.result.classes("head")

    def build_result(self) -> ui.element:
        camera = ui.scene.perspective_camera(fov=30, near=0.01)
        self.scene = ui.scene(
            grid=False, background_color=BACKGROUND, camera=camera, fps=FRAMES_PER_SECOND, click_events=[]
        )
        self.scene.classes("w-full h-full").props('role="img"')
        self.scene.props["aria-label"] = "The head that your face drives; drag to turn it"
        self.scene.move_camera(0, -CAMERA_HEAD_HEIGHTS, 0, 0, 0, 0, duration=0)
        self.scene.on("init", self._begin)
        return self.scene

    def _begin(self) -> None:
        ui.run_javascript(f"guiseRig.rest({self.scene.id}); guiseHeads.light({self.scene.id})")
        self._use()

    def show_head(self, drawn: DrawnRig, url: str) -> None:
        """Show another head.   url : of its file."""
        self._drawn, self._url = drawn, url
        self._place()

    def mirror(self, on: bool) -> None:
        self.own.classes(**{"add" if on else "remove": "-scale-x-100"})
        if on != self._mirrored:
            self._mirrored = on
            self._place()

    def _place(self) -> None:
        if self._drawn is None:
            return
        if self._head:
            self.scene.objects[self._head].delete()
        self._head = self._drawn.place(self.scene, self._url, mirror=self._mirrored)
        self._use()

    def _use(self) -> None:
        if self._drawn is not None:
            centre = self._drawn.centre.tolist()
            ui.run_javascript(f"guiseRig.use({self.scene.id}, '{self._head}', {centre})")

    def end(self, sentence: str) -> None:
        super().end(sentence)
        self._words.classes(remove="idle")

    def show(self, shown: OutputFrame | None, recorded: float | None) -> None:
        super().show(None, recorded)
        if isinstance(shown, RigFrame):
            self.say(shown.message or ("" if shown.coefficients is not None else NO_FACE))
