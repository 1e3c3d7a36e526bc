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
from guise.app.studio.analogy_jobs import view_of
from guise.app.studio.site import Studio
from guise.app.studio.store import StudioError, Upload
from guise.common.arrays import F64
from guise.common.files import write_whole

Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # from (right, up, forward) to the scene's axes
BACKGROUND = "#1b1d20"
POINT_HEAD_HEIGHTS = 0.007  # radius
COLOUR, CHOSEN = "#5af082", "#f59e0b"


class Standing:
    """A head that stands upright in a scene, as high as 1.   view : as `view_of` gives it.   x : of its middle."""

    def __init__(self, view: dict[str, Any], x: float = 0.0) -> None:
        self._turned, self._scale = Z_UP @ np.array(view["turned"]), 1 / view["height"]
        middle = self._scale * Z_UP @ np.array(view["centre"])
        self._shift = np.array([x, 0, 0]) - middle

    def place(self, scene: ui.scene, url: str) -> str:
        """Put the head of a GLB into a scene; its id there."""
        with scene:
            made = scene.gltf(url).scale(self._scale).rotate_R(self._turned.tolist())
        made.move(*self._shift)
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


def _found(head: Upload) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """How a head stands, and its feature points as they were set or are found; it is drawn from a GLB beside it."""
    file = read_mesh(head.path)
    write_rig(_drawn(head), file, [], [])
    points = find_feature_points(file.mesh)
    positions = {} if isinstance(points, Failed) else points.as_json()
    view = view_of(file.mesh.vertices, None if isinstance(points, Failed) else points.positions)
    if points_file(head).exists():
        positions = json.loads(points_file(head).read_text(encoding="utf-8"))
    return view, positions


def _drawn(head: Upload) -> Path:
    return head.path.with_suffix(".drawn.glb")


async def edit_points(studio: Studio, head: Upload) -> None:
    """Let the user move the feature points of a head in a dialog, and keep them."""
    ui.notify("Looking for the landmarks …")
    found = await run.io_bound(_found, head)
    if found is not None:  # the studio is not closing
        _PointEditor(studio, head, Standing(found[0]), found[1]).open()


class _PointEditor:
    def __init__(
        self, studio: Studio, head: Upload, standing: Standing, positions: dict[str, list[float]]
    ) -> None:
        self._studio, self._head, self._standing, self._positions = studio, head, standing, positions
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
        self._scene = ui.scene(
            grid=False, background_color=BACKGROUND, camera=camera, click_events=["click"], on_click=self._clicked
        )  # fmt: skip
        self._scene.classes("w-full scene").props('role="img"')
        self._scene.props["aria-label"] = (
            f"The head {self._head.name}; drag to turn it, click to place the landmark"
        )
        self._scene.move_camera(0, -2.2, 0, 0, 0, 0, duration=0)
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
        name, was_placed = str(self._choice.value), self._choice.value in self._positions
        self._positions[name] = self._standing.to_mesh(np.array([hit.x, hit.y, hit.z])).tolist()
        self._mark(name)
        self._choice.set_options({one: self._words(one) for one in FEATURE_POINT_NAMES})
        if not was_placed:
            self._choice.value = self._next()
        self._colour()

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
