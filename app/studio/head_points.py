"""The feature points of a head, on the head itself: where Guise finds them, and where the user clicks instead."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import run, ui

from guise.aam.similarity import Failed
from guise.analogy.feature_points import FEATURE_POINT_NAMES, find_feature_points
from guise.analogy.formats.files import read_mesh, write_rig
from guise.analogy.geometry import Surface
from guise.app.studio.analogy_jobs import view_of
from guise.app.studio.head_dialog import CHOSEN, COLOUR, HeadDialog, Standing, drawn
from guise.app.studio.site import Studio
from guise.app.studio.store import StudioError, Upload
from guise.common.arrays import F64
from guise.common.files import write_whole

POINT_HEAD_HEIGHTS = 0.007  # radius
STEP_HEAD_HEIGHTS, FINE_STEP_HEAD_HEIGHTS = 0.01, 0.002  # of a press of an arrow key, and with shift
UP, FRONT = np.array([0.0, 0, 1]), np.array([0.0, -1, 0])  # in the scene
ARROWS = {"ArrowLeft": (-1, 0), "ArrowRight": (1, 0), "ArrowUp": (0, 1), "ArrowDown": (0, -1)}
KEYS = "Keys on the head: arrows move the landmark, with shift by less; n, p: next, previous; l, r: turn the head."


def points_file(head: Upload) -> Path:
    """Where the feature points that the user has set are kept, as the commands read them."""
    return head.path.with_suffix(".landmarks.json")


def _found(head: Upload) -> tuple[Surface, Standing, dict[str, list[float]]]:
    """A head, how it stands, and its feature points as they were set or are found; it is drawn from a GLB beside it."""
    file = read_mesh(head.path)
    write_rig(drawn(head), file, [], [])
    points = find_feature_points(file.mesh)
    positions = {} if isinstance(points, Failed) else points.as_json()
    view = view_of(file.mesh.vertices, None if isinstance(points, Failed) else points.positions)
    if points_file(head).exists():
        positions = json.loads(points_file(head).read_text(encoding="utf-8"))
    return Surface(file.mesh.vertices, file.mesh.faces, 0.0), Standing(view), positions


async def edit_points(studio: Studio, head: Upload) -> None:
    """Let the user move the feature points of a head in a dialog, and keep them."""
    ui.notify("Looking for the landmarks …")
    found = await run.io_bound(_found, head)
    if found is not None:  # the studio is not closing
        _PointEditor(studio, head, *found).open(f"Landmarks of {head.name}")


class _PointEditor(HeadDialog):
    what, keys, letters = "landmark", KEYS, "n.p.l.r"

    def __init__(
        self, studio: Studio, head: Upload, surface: Surface, standing: Standing, positions: dict[str, list[float]]
    ) -> None:  # fmt: skip
        super().__init__(studio, head, standing)
        self._positions, self._surface = positions, surface
        self._marks: dict[str, Any] = {}

    def controls(self) -> None:
        """The names of the points."""
        ui.label("Choose a landmark, then click its place on the head. Left and right are the person's.")
        ui.label(KEYS).classes("opacity-70")
        names = {name: self._words(name) for name in FEATURE_POINT_NAMES}
        self._choice = ui.select(names, value=self._next(), label="Landmark", on_change=self._colour)
        self._choice.props("outlined dense").classes("w-full")
        self._said = ui.label().props('role="status"')
        self.button("Save", self._save, "icon=save")
        self.button("Find them again", self._forget)
        self.button("Cancel", self.dialog.close, "flat")
        for name in self._positions:
            self._mark(name)
        self._colour()

    def _words(self, name: str) -> str:
        return name.replace("_", " ") + ("" if name in self._positions else " (not placed)")

    def _next(self) -> str:
        """The first landmark that has no place yet."""
        return next(
            (name for name in FEATURE_POINT_NAMES if name not in self._positions), FEATURE_POINT_NAMES[0]
        )

    def clicked(self, place: F64) -> None:
        was_placed = self._choice.value in self._positions
        self._place(place)
        if not was_placed:
            self._choice.value = self._next()
        self._colour()

    def _place(self, place: F64) -> None:
        """Put the chosen landmark at a place in the scene."""
        name = str(self._choice.value)
        self._positions[name] = self.standing.to_mesh(place).tolist()
        self._mark(name)
        self._choice.set_options({one: self._words(one) for one in FEATURE_POINT_NAMES})
        self._colour()

    def pressed(self, key: str, *, shift: bool) -> None:
        """Move the chosen landmark over the head as it is seen, or choose another one."""
        if key in ARROWS:
            step = np.array(ARROWS[key]) * (FINE_STEP_HEAD_HEIGHTS if shift else STEP_HEAD_HEIGHTS)
            known = self._positions.get(str(self._choice.value))
            start = FRONT if known is None else self.standing.to_scene(np.array(known))
            right = np.array([np.cos(self.yaw), np.sin(self.yaw), 0.0])
            wanted = self.standing.to_mesh(start + step[0] * right + step[1] * UP)
            found = self._surface.closest_points(wanted[None], np.zeros((1, 3))).positions[0]
            self._place(self.standing.to_scene(found))
        else:
            at = FEATURE_POINT_NAMES.index(str(self._choice.value)) + (1 if key == "n" else -1)
            self._choice.value = FEATURE_POINT_NAMES[at % len(FEATURE_POINT_NAMES)]

    def _mark(self, name: str) -> None:
        if name not in self._marks:
            with self.scene:
                self._marks[name] = self.scene.sphere(POINT_HEAD_HEIGHTS)
        self._marks[name].move(*self.standing.to_scene(np.array(self._positions[name])))

    def _colour(self) -> None:
        for name, mark in self._marks.items():
            mark.material(CHOSEN if name == self._choice.value else COLOUR)
        self._said.text = f"{len(self._positions)} of {len(FEATURE_POINT_NAMES)} are placed."

    def _save(self) -> None:
        if len(self._positions) < len(FEATURE_POINT_NAMES):
            raise StudioError(
                f"place all {len(FEATURE_POINT_NAMES)} landmarks first: {self._words(self._next())}"
            )
        write_whole(points_file(self.head), json.dumps(self._positions))
        self.dialog.close()
        ui.notify("Saved: the next transfer uses these landmarks.")

    def _forget(self) -> None:
        points_file(self.head).unlink(missing_ok=True)
        self.dialog.close()
        ui.notify("The next transfer finds the landmarks itself.")
