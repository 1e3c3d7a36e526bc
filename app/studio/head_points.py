"""The feature points of a head, on the head itself: where Guise finds them, and where the user clicks instead."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import events, run, ui

from guise.aam.similarity import Failed
from guise.analogy.feature_points import FEATURE_POINT_NAMES, find_feature_points
from guise.analogy.formats.files import read_mesh, write_rig
from guise.analogy.geometry import Surface
from guise.app.studio.analogy_jobs import view_of
from guise.app.studio.site import Studio
from guise.app.studio.store import StudioError, Upload
from guise.common.arrays import F64
from guise.common.files import write_whole

Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # from (right, up, forward) to the scene's axes
BACKGROUND = "#1b1d20"
POINT_HEAD_HEIGHTS = 0.007  # radius
STEP_HEAD_HEIGHTS, FINE_STEP_HEAD_HEIGHTS = 0.01, 0.002  # of a press of an arrow key, and with shift
TURN_RADIANS, CAMERA_HEAD_HEIGHTS = np.radians(30), 2.2
UP, FRONT = np.array([0.0, 0, 1]), np.array([0.0, -1, 0])  # in the scene
ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowDown": (0, -1)}
KEYS = "Keys on the head: arrows move the landmark, with shift by less; n, p: next, previous; l, r: turn the head."
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
        """A place (3,) on the mesh, in the scene."""
        return np.asarray(self._scale * self._turned @ position + self._shift)

    def to_mesh(self, place: F64) -> F64:
        """A place (3,) in the scene, on the mesh."""
        return np.asarray(self._turned.T @ (place - self._shift) / self._scale)


def points_file(head: Upload) -> Path:
    """Where the feature points that the user has set are kept, as the commands read them."""
    return head.path.with_suffix(".landmarks.json")


def _found(head: Upload) -> tuple[Surface, Standing, dict[str, list[float]]]:
    """A head, how it stands, and its feature points as they were set or are found; it is drawn from a GLB beside it."""
    file = read_mesh(head.path)
    write_rig(_drawn(head), file, [], [])
    points = find_feature_points(file.mesh)
    positions = {} if isinstance(points, Failed) else points.as_json()
    view = view_of(file.mesh.vertices, None if isinstance(points, Failed) else points.positions)
    if points_file(head).exists():
        positions = json.loads(points_file(head).read_text(encoding="utf-8"))
    return Surface(file.mesh.vertices, file.mesh.faces, 0.0), Standing(view), positions


def _drawn(head: Upload) -> Path:
    return head.path.with_suffix(".drawn.glb")


async def edit_points(studio: Studio, head: Upload) -> None:
    """Let the user move the feature points of a head in a dialog, and keep them."""
    ui.notify("Looking for the landmarks …")
    found = await run.io_bound(_found, head)
    if found is not None:  # the studio is not closing
        _PointEditor(studio, head, *found).open()


class _PointEditor:
    def __init__(
        self, studio: Studio, head: Upload, surface: Surface, standing: Standing, positions: dict[str, list[float]]
    ) -> None:  # fmt: skip
        self._studio, self._head, self._positions = studio, head, positions
        self._surface, self._standing, self._yaw = surface, standing, 0.0
        self._marks: dict[str, Any] = {}
        self._id = ""

    def open(self) -> None:
        """Show the head, its points and their names."""
        with ui.context.client.content:
            self._dialog = ui.dialog().props("maximized")
        with self._dialog, ui.card().classes("w-full"), ui.element("div").classes("desk"):
            self._build_scene()
            with ui.column().classes("w-full"):
                ui.label(f"Landmarks of {self._head.name}").classes("text-h6").props(
                    "role=heading aria-level=2"
                )
                ui.label(
                    "Choose a landmark, then click its place on the head. Left and right are the person's."
                )
                ui.label(KEYS).classes("opacity-70")
                names = {name: self._words(name) for name in FEATURE_POINT_NAMES}
                self._choice = ui.select(names, value=self._next(), label="Landmark", on_change=self._colour)
                self._choice.props("outlined dense").classes("w-full")
                self._said = ui.label().props('role="status"')
                ui.button("Save", icon="save", on_click=self._save).classes("w-full")
                ui.button("Find them again", on_click=self._forget).props("outline").classes("w-full")
                ui.button("Cancel", color=None, on_click=self._dialog.close).props("flat").classes("w-full")
        for name in self._positions:
            self._mark(name)
        self._colour()
        self._dialog.open()

    def _build_scene(self) -> None:
        camera = ui.scene.perspective_camera(fov=30)
        with ui.element("div").props("tabindex=0 role=application").classes("w-full") as place:
            place.props["aria-label"] = f"Place landmarks by keys. {KEYS}"
            self._scene = ui.scene(
                grid=False, background_color=BACKGROUND, camera=camera, click_events=["click"], on_click=self._clicked
            )  # fmt: skip
        place.on("keydown.up.down.left.right.prevent", self._pressed, ["key", "shiftKey"])
        place.on("keydown.n.p.l.r", self._pressed, ["key", "shiftKey"])
        self._scene.classes("w-full scene").props('role="img"')
        self._scene.props["aria-label"] = (
            f"The head {self._head.name}; drag to turn it, click to place the landmark"
        )
        self._turn(0.0)
        self._id = self._standing.place(self._scene, self._studio.url(_drawn(self._head)))
        light = (
            f"guiseHeads.show({self._scene.id}, ['{self._id}'], -1, 0); guiseHeads.still({self._scene.id})"
        )
        self._scene.on("init", lambda: ui.run_javascript(light))

    def _words(self, name: str) -> str:
        return name.replace("_", " ") + ("" if name in self._positions else " (not placed)")

    def _next(self) -> str:
        """The first landmark that has no place yet."""
        return next(
            (name for name in FEATURE_POINT_NAMES if name not in self._positions), FEATURE_POINT_NAMES[0]
        )

    def _clicked(self, event: events.SceneClickEventArguments) -> None:
        hit = next((hit for hit in event.hits if hit.object_id == self._id), None)
        if hit is None:
            return
        was_placed = self._choice.value in self._positions
        self._place(np.array([hit.x, hit.y, hit.z]))
        if not was_placed:
            self._choice.value = self._next()
        self._colour()

    def _place(self, place: F64) -> None:
        """Put the chosen landmark at a place in the scene."""
        name = str(self._choice.value)
        self._positions[name] = self._standing.to_mesh(place).tolist()
        self._mark(name)
        self._choice.set_options({one: self._words(one) for one in FEATURE_POINT_NAMES})
        self._colour()

    def _pressed(self, event: events.GenericEventArguments) -> None:
        """Move the chosen landmark over the head as it is seen, choose another one, or turn the head."""
        key, count = event.args["key"], len(FEATURE_POINT_NAMES)
        if key in ARROWS:
            step = np.array(ARROWS[key]) * (
                FINE_STEP_HEAD_HEIGHTS if event.args["shiftKey"] else STEP_HEAD_HEIGHTS
            )
            known = self._positions.get(str(self._choice.value))
            start = FRONT if known is None else self._standing.to_scene(np.array(known))
            right = np.array([np.cos(self._yaw), np.sin(self._yaw), 0.0])
            wanted = self._standing.to_mesh(start + step[0] * right + step[1] * UP)
            found = self._surface.closest_points(wanted[None], np.zeros((1, 3))).positions[0]
            self._place(self._standing.to_scene(found))
        elif key in "np":
            at = FEATURE_POINT_NAMES.index(str(self._choice.value)) + (1 if key == "n" else -1)
            self._choice.value = FEATURE_POINT_NAMES[at % count]
        else:
            self._turn(self._yaw + (TURN_RADIANS if key == "r" else -TURN_RADIANS))

    def _turn(self, yaw: float) -> None:
        """Look at the head from an angle about its axis, radians, 0 from the front."""
        self._yaw = yaw
        x, y = CAMERA_HEAD_HEIGHTS * np.array([np.sin(yaw), -np.cos(yaw)])
        self._scene.move_camera(x, y, 0, 0, 0, 0, duration=0)

    def _mark(self, name: str) -> None:
        if name not in self._marks:
            with self._scene:
                self._marks[name] = self._scene.sphere(POINT_HEAD_HEIGHTS)
        self._marks[name].move(*self._standing.to_scene(np.array(self._positions[name])))

    def _colour(self) -> None:
        for name, mark in self._marks.items():
            mark.material(CHOSEN if name == self._choice.value else COLOUR)
        self._said.text = f"{len(self._positions)} of {len(FEATURE_POINT_NAMES)} are placed."

    def _save(self) -> None:
        if len(self._positions) < len(FEATURE_POINT_NAMES):
            raise StudioError(
                f"place all {len(FEATURE_POINT_NAMES)} landmarks first: {self._words(self._next())}"
            )
        write_whole(points_file(self._head), json.dumps(self._positions))
        self._dialog.close()
        ui.notify("Saved: the next transfer uses these landmarks.")

    def _forget(self) -> None:
        points_file(self._head).unlink(missing_ok=True)
        self._dialog.close()
        ui.notify("The next transfer finds the landmarks itself.")
