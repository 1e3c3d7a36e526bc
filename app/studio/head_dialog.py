"""A head in a dialog of the page Analogy, which can be turned, and of which places are clicked."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, ui

from guise.app.studio.site import Studio
from guise.app.studio.store import Upload
from guise.common.arrays import F64

Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # from (right, up, forward) to the scene's axes
BACKGROUND = "#1b1d20"
TURN_RADIANS, CAMERA_HEAD_HEIGHTS = np.radians(30), 2.2
COLOUR, CHOSEN = "#5af082", "#f59e0b"


class Standing:
    """A head that stands upright in a scene, as high as 1.   view : as `view_of` gives it.   x : of its middle."""

    def __init__(self, view: dict[str, Any], x: float = 0.0) -> None:
        self._turned, self._scale = Z_UP @ np.array(view["turned"]), 1 / view["height"]
        middle = self._scale * Z_UP @ np.array(view["centre"])
        self._shift = np.array([x, 0, 0]) - middle

    def place(self, scene: ui.scene, url: str, *, mirror: bool = False) -> str:
        """Put the head of a GLB into a scene, maybe as in a mirror; its id there."""
        side = -1 if mirror else 1
        with scene:
            made = scene.gltf(url).rotate_R(self._turned.tolist())
        made.scale(side * self._scale, self._scale, self._scale).move(side * self._shift[0], *self._shift[1:])
        return made.id

    def to_scene(self, position: F64) -> F64:
        """Places (..., 3) on the mesh, in the scene."""
        return np.asarray(self._scale * position @ self._turned.T + self._shift)

    def to_mesh(self, place: F64) -> F64:
        """A place (3,) in the scene, on the mesh."""
        return np.asarray(self._turned.T @ (place - self._shift) / self._scale)


def drawn(head: Upload) -> Path:
    """The GLB of a head that the browser draws."""
    return head.path.with_suffix(".drawn.glb")


class HeadDialog:
    """Shows a head beside what is said and chosen of it.

    what : is clicked on it, in words.   keys : that do something, besides those that turn it, in words.
    """

    what = keys = letters = ""

    def __init__(self, studio: Studio, head: Upload, standing: Standing) -> None:
        self.studio, self.head, self.standing, self.yaw = studio, head, standing, 0.0
        self._id = ""

    def clicked(self, place: F64) -> None:
        """A place (3,) in the scene on the head was clicked."""
        raise NotImplementedError

    def pressed(self, key: str, *, shift: bool) -> None:
        """A key of `letters`, or an arrow, was pressed."""

    def controls(self) -> None:
        """What is said and chosen."""
        raise NotImplementedError

    def open(self, title: str) -> None:
        """Show the dialog."""
        with ui.context.client.content:
            self.dialog = ui.dialog().props("maximized")
        self.dialog.props["aria-label"] = title
        with self.dialog, ui.card().classes("w-full"), ui.element("div").classes("desk"):
            self._build_scene()
            with ui.column().classes("w-full"):
                ui.label(title).classes("text-h6").props("role=heading aria-level=2")
                self.controls()
        self.dialog.open()

    def button(
        self, words: str, then: Callable[[], Awaitable[None] | None], style: str = "outline"
    ) -> ui.button:
        """A button as wide as the column."""
        button = ui.button(words, on_click=then).classes("w-full")
        return button.props(style) if style else button

    def _build_scene(self) -> None:
        camera = ui.scene.perspective_camera(fov=30)
        with ui.element("div").props("tabindex=0 role=application").classes("w-full") as place:
            place.props["aria-label"] = f"Place {self.what}s by keys. {self.keys}"
            self.scene = ui.scene(
                grid=False, background_color=BACKGROUND, camera=camera, click_events=["click"], on_click=self._clicked
            )  # fmt: skip
        place.on("keydown.up.down.left.right.prevent", self._pressed, ["key", "shiftKey"])
        place.on(f"keydown.{self.letters}", self._pressed, ["key", "shiftKey"])
        self.scene.classes("w-full scene").props('role="img"')
        self.scene.props["aria-label"] = (
            f"The head {self.head.name}; drag to turn it, click to place the {self.what}"
        )
        self._turn(0.0)
        self._id = self.standing.place(self.scene, self.studio.url(drawn(self.head)))
        light = f"guiseHeads.show({self.scene.id}, ['{self._id}'], -1, 0); guiseHeads.still({self.scene.id})"
        self.scene.on("init", lambda: ui.run_javascript(light))

    def _clicked(self, event: events.SceneClickEventArguments) -> None:
        hit = next((hit for hit in event.hits if hit.object_id == self._id), None)
        if hit is not None:
            self.clicked(np.array([hit.x, hit.y, hit.z]))

    def _pressed(self, event: events.GenericEventArguments) -> None:
        key = event.args["key"]
        if key in ("l", "r"):
            self._turn(self.yaw + (TURN_RADIANS if key == "r" else -TURN_RADIANS))
        else:
            self.pressed(key, shift=event.args["shiftKey"])

    def _turn(self, yaw: float) -> None:
        """Look at the head from an angle about its axis, radians, 0 from the front."""
        self.yaw = yaw
        x, y = CAMERA_HEAD_HEIGHTS * np.array([np.sin(yaw), -np.cos(yaw)])
        self.scene.move_camera(x, y, 0, 0, 0, 0, duration=0)
