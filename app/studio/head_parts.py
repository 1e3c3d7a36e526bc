"""The parts of a head, on the head itself: what Guise takes each component for, and what the user says that it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from nicegui import run, ui

from guise.analogy.anatomy import KINDS
from guise.analogy.formats.files import read_mesh, write_rig
from guise.analogy.geometry import Surface
from guise.analogy.mesh import MeshError
from guise.app.meshes.parts import NamedHead, name_parts, parts_toml
from guise.app.meshes.points import AUTO, feature_points_of
from guise.app.studio.analogy_jobs import view_of
from guise.app.studio.head_dialog import CHOSEN, HeadDialog, Standing, drawn
from guise.app.studio.head_points import points_file
from guise.app.studio.site import Studio
from guise.app.studio.store import StudioError, Upload
from guise.common.arrays import F64
from guise.common.files import write_whole

KEYS = "Keys on the head: n, p: next, previous part; l, r: turn the head."
SAID_BY = {"file": "your choice", "points": "its landmarks", "place": "its place", "name": "its name"}
DOT_HEAD_HEIGHTS, MOST_DOTS = 0.008, 3000


def parts_file(head: Upload) -> Path:
    """Where the kinds that the user has set are kept, as the commands read them."""
    return head.path.with_suffix(".parts.toml")


def _found(head: Upload) -> tuple[NamedHead, Standing]:
    """A head with its parts, and how it stands; it is drawn from a GLB beside it."""
    file = read_mesh(head.path)
    write_rig(drawn(head), file, [], [])
    placed, given = points_file(head), parts_file(head)
    try:
        points = feature_points_of(file, str(placed) if placed.exists() else AUTO).positions
    except MeshError as error:
        raise StudioError(f"no face is found on {head.name}: place its landmarks first") from error
    named = name_parts(file, points, given if given.exists() else None)
    return named, Standing(view_of(file.mesh.vertices, points))


async def edit_parts(studio: Studio, head: Upload) -> None:
    """Let the user say in a dialog what the parts of a head are, and keep it."""
    ui.notify("Looking at the parts …")
    found = await run.io_bound(_found, head)
    if found is not None:  # the studio is not closing
        _PartEditor(studio, head, *found).open(f"Parts of {head.name}")


class _PartEditor(HeadDialog):
    what, keys, letters = "part", KEYS, "n.p.l.r"

    def __init__(self, studio: Studio, head: Upload, named: NamedHead, standing: Standing) -> None:
        super().__init__(studio, head, standing)
        self._named, self._file = named, named.file
        self._parts = sorted(named.components, key=lambda part: -len(part.rows))
        mesh = self._file.mesh
        self._surface = Surface(mesh.vertices, mesh.faces, 0.0)
        self._part_of = np.zeros(len(mesh.vertices), np.intp)
        for number, part in enumerate(self._parts):
            self._part_of[part.rows] = number

    def controls(self) -> None:
        """The parts, and their kinds."""
        ui.label(
            "Click a part of the head, or choose it, and say what it is. The next transfer moves it as such."
        )
        ui.label(KEYS).classes("opacity-70")
        self._part = ui.select(self._words(), value=0, label="Part", on_change=self._show)
        self._kind = ui.select(list(KINDS), label="What it is", on_change=self._change)
        for select in (self._part, self._kind):
            select.props("outlined dense").classes("w-full")
        self._said = ui.label().props('role="status"')
        self.button("Save", self._save, "icon=save")
        self.button("Download parts.toml", self._download)
        self.button("Name them again", self._forget)
        self.button("Cancel", self.dialog.close, "flat")
        with self.scene:
            self._dots = self.scene.point_cloud([[0, 0, 0]], point_size=DOT_HEAD_HEIGHTS).material(CHOSEN)
        self.scene.on("init", self._see_through)
        self._show()

    def clicked(self, place: F64) -> None:
        hit = self._surface.closest_points(self.standing.to_mesh(place)[None], np.zeros((1, 3)))
        self._part.value = int(self._part_of[self._file.mesh.faces[hit.faces[0]][0]])

    def pressed(self, key: str, *, shift: bool) -> None:
        """Choose another part."""
        if key in ("n", "p"):
            self._part.value = (int(self._part.value) + (1 if key == "n" else -1)) % len(self._parts)

    def _words(self) -> dict[int, str]:
        return {
            k: f"{k + 1}. {part.kind}{f', {part.name}' if part.name else ''}: {len(part.rows):,} vertices"
            for k, part in enumerate(self._parts)
        }

    def _see_through(self) -> None:
        ui.run_javascript(f"guiseHeads.seeThrough({self.scene.id}, '{self._dots.id}')")

    def _show(self) -> None:
        """Show the chosen part, also where others hide it."""
        part = self._parts[int(self._part.value)]
        rows = part.rows[:: -(-len(part.rows) // MOST_DOTS)]
        self._dots.set_points(self.standing.to_scene(self._file.mesh.vertices[rows]).round(4).tolist())
        self._see_through()
        self._kind.value = part.kind
        self._said.text = (
            f"Part {int(self._part.value) + 1} of {len(self._parts)}: {part.kind}, by {SAID_BY[part.by]}."
        )

    def _change(self) -> None:
        """Take the chosen kind."""
        k = int(self._part.value)
        if self._kind.value != self._parts[k].kind:
            self._parts[k] = replace(self._parts[k], kind=self._kind.value, by="file")
            self._part.set_options(self._words())
            self._show()

    def _toml(self, *, given: bool) -> str:
        """A file of the parts that the user has named, or of all."""
        told = [part for part in self._parts if part.by == "file" or not given]
        return parts_toml(Path(self.head.name), replace(self._named, components=told).parts)

    def _save(self) -> None:
        if not any(part.kind == "face skin" for part in self._parts):
            raise StudioError("no part is face skin: say which carries the face")
        write_whole(parts_file(self.head), self._toml(given=True))
        self.dialog.close()
        ui.notify("Saved: the next transfer to this head takes its parts for what you said.")

    def _download(self) -> None:
        ui.download.content(self._toml(given=False), f"{self.head.name}.parts.toml")

    def _forget(self) -> None:
        parts_file(self.head).unlink(missing_ok=True)
        self.dialog.close()
        ui.notify("The next transfer names the parts itself.")
