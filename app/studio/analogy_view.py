"""A scene with two heads that can be turned, the source and the result, showing one of their expressions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from guise.app.studio.analogy_jobs import SOURCE, TARGET
from guise.app.studio.site import Studio
from guise.app.studio.store import JobRow

HALF_DISTANCE_HEADS = 0.62  # of a head from the middle of the scene, in head heights
Z_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # from (right, up, forward) to the scene's axes
BACKGROUND = "#1b1d20"


class HeadScene:
    """The heads of a finished job.   folder : of its files."""

    def __init__(self, studio: Studio, job: JobRow, folder: Path) -> None:
        self._studio, self._job, self._folder = studio, job, folder
        self._heads: list[str] = []

    def build(self) -> None:
        """The scene and its controls."""
        names = self._job.result["names"]
        with ui.element("div").classes("w-full rounded overflow-hidden"):
            self._scene = ui.scene(
                grid=False, background_color=BACKGROUND, camera=ui.scene.perspective_camera(fov=30)
            )
        self._scene.classes("w-full h-96").props('role="img"')
        self._scene.props["aria-label"] = (
            f"Source and target of {self._job.about['title']}; drag to turn them"
        )
        self._scene.move_camera(0, -2.6, 0, 0, 0, 0, duration=0)
        self._scene.on("init", self._show)
        places = zip(
            (SOURCE, TARGET),
            self._job.result["stands"],
            (-HALF_DISTANCE_HEADS, HALF_DISTANCE_HEADS),
            strict=True,
        )
        with self._scene:
            for file, stand, x in places:
                self._heads.append(self._head(self._studio.url(self._folder / file), stand, x))
        with ui.row().classes("w-full items-center no-wrap"):
            options: dict[int, str] = {-1: "at rest"} | dict(enumerate(names))
            self._shape = ui.select(options, value=0, label="Expression", on_change=self._show).classes(
                "w-48"
            )
            self._amount = ui.slider(min=0, max=1.5, step=0.05, value=1.0, on_change=self._show)
            self._amount.props('label aria-label="Amount"')
        ui.label().bind_text_from(self._shape, "value", self._summary).classes("opacity-70")

    def _head(self, url: str, stand: dict[str, Any], x: float) -> str:
        """Id of a head that is placed upright at unit height."""
        turned, scale = Z_UP @ np.array(stand["turned"]), 1 / stand["height"]
        middle = scale * Z_UP @ np.array(stand["centre"])
        made = self._scene.gltf(url).scale(scale).rotate_R(turned.tolist())
        made.move(x - middle[0], -middle[1], -middle[2])
        return made.id

    def _show(self) -> None:
        shape, amount = int(self._shape.value), float(self._amount.value)
        ui.run_javascript(f"guiseHeads.show({self._scene.id}, {self._heads}, {shape}, {amount})")

    def _summary(self, shape: int) -> str:
        return "" if shape < 0 else f"{self._job.result['names'][shape]}: {self._job.result['told'][shape]}."
