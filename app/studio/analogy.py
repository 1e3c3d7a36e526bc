"""The page Analogy: transfer the expression of a photo or clip to another photo, and of a head to another head.

Results are jobs "analogy-photo" and "analogy-head", listed under the form that starts them.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from guise.app.meshes.options import TransferOptions as HeadOptions
from guise.app.meshes.points import AUTO
from guise.app.photos.options import AnalogyOptions as PhotoOptions
from guise.app.studio.analogy_jobs import MONTAGE, PICTURE, SOURCE, TARGET, ZIP, head, photo
from guise.app.studio.dialogs import confirm
from guise.app.studio.file_picker import FilePicker
from guise.app.studio.head_dialog import BACKGROUND, Standing
from guise.app.studio.head_parts import edit_parts, parts_file
from guise.app.studio.head_points import edit_points, points_file
from guise.app.studio.option_form import PresetChoice, taken
from guise.app.studio.site import Studio, advanced, choice_row, heading, page, script, sentence, show_job
from guise.app.studio.store import JobRow, StudioError, Upload
from guise.app.studio.uploads import CLIP, MESH, shown
from guise.app.studio.uploads import PICTURE as IMAGE

PATH = "/analogy"
PHOTO, HEAD = "analogy-photo", "analogy-head"
PHOTO_METHODS = {"tents": "Vertex tents", "ratio": "Ratio images", "warp": "Geometry only"}
HEAD_METHODS = {
    "tents": "Vertex tents",
    "gradients": "Deformation gradients",
    "cloning": "Expression cloning",
}
MOUTHS = {"fill": "Filled", "none": "As in the paper"}
PHOTO_INTRO = "Copy the expression from photo 1 to 2 onto photo 3, with its wrinkles and shading."
HEAD_INTRO = (
    "Copy the expressions of one head onto another, whatever their meshes. Guise finds the landmarks; you can place "
    "them yourself."
)
HEAD_COMMANDS = ["analogy mesh transfer", "analogy mesh rig", "analogy mesh sequence"]
HALF_DISTANCE_HEADS = 0.62  # of a head from the middle of the scene, in head heights


def register(studio: Studio) -> None:
    """Add the page and its jobs."""
    studio.jobs.register(PHOTO, photo)
    studio.jobs.register(HEAD, head)
    page(studio, PATH, "Analogy", lambda: _page(studio))


def _page(studio: Studio) -> None:
    script("heads.js")
    with ui.tabs().classes("w-full") as tabs:
        photos, heads = ui.tab("Photos"), ui.tab("Heads")
    with ui.tab_panels(tabs, value=photos).classes("w-full bg-transparent"):
        with ui.tab_panel(photos).classes("p-0"):
            _PhotoForm(studio).build()
        with ui.tab_panel(heads).classes("p-0"):
            _HeadForm(studio).build()


class _AnalogyForm:
    """A form and its results.   kind : of its jobs."""

    kind = ""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio

    def _start(self, about: Callable[[], dict[str, Any]]) -> None:
        self.studio.jobs.start(self.kind, about())
        self._results.refresh()

    @ui.refreshable_method
    def _results(self) -> None:
        """Newest first, without cancelled ones."""
        jobs = [job for job in self.studio.store.jobs() if job.kind == self.kind and job.state != "cancelled"]
        if jobs:
            heading("Results")
        for job in jobs:
            with ui.card().classes("w-full"):
                self._job(job)

    def _job(self, job: JobRow) -> None:
        with ui.row().classes("w-full items-center"):
            ui.label(job.about["title"]).classes("text-bold grow break-all").props(
                "role=heading aria-level=3"
            )
            if job.ended:
                button = ui.button("Delete", color=None, on_click=partial(self._delete, job)).props("flat")
                button.props["aria-label"] = f"Delete {job.about['title']}"
        if not job.ended:
            show_job(self.studio, job.id, lambda _: self._results.refresh())
        elif job.state == "failed":
            ui.label(sentence(job.sentence)).props('role="status"')
        else:
            self._result(job, self.studio.store.folder_of(job.id))
            for note in (job.result["sentence"], *job.result["notes"]):
                ui.label(note).classes("opacity-70")

    def _result(self, job: JobRow, folder: Path) -> None:
        raise NotImplementedError

    def _link(self, words: str, path: Path, name: str) -> None:
        ui.link(words, self.studio.url(path)).props["download"] = name + path.suffix

    async def _delete(self, job: JobRow) -> None:
        if await confirm("Delete this result? The uploaded files are kept.", "Delete", "Keep"):
            self.studio.store.remove_job(job.id)
            self._results.refresh()


class _PhotoForm(_AnalogyForm):
    kind = PHOTO

    def build(self) -> None:
        """The form and its results."""
        ui.label(PHOTO_INTRO).classes("mb-2")
        with ui.card().classes("w-full"):
            with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-3"):
                self._s = FilePicker(self.studio, "Photo 1", "Photo 1: somebody at rest", (IMAGE,))
                self._s1 = FilePicker(
                    self.studio,
                    "Photo 2",
                    "Photo 2: the same person with an expression, or a clip",
                    (IMAGE, CLIP),
                )
                self._t = FilePicker(
                    self.studio, "Photo 3", "Photo 3: who gets the expression, at rest", (IMAGE,)
                )
            ui.label(
                "With a clip, photo 1 can be left out: the frame nearest to a face at rest takes its place."
            ).classes("opacity-70")
            with ui.row().classes("items-center w-full no-wrap pr-4"):
                ui.label("Strength of expression").classes("w-48")
                self._strength = ui.slider(min=0, max=2, step=0.1, value=1.0)
                self._strength.props('label aria-label="Strength of expression"')
            with advanced():
                PresetChoice(["analogy image", "analogy animate"], self._options, self._use).build()
                self._method = choice_row("Method", PHOTO_METHODS, next(iter(PHOTO_METHODS)))
                self._mouth = choice_row("Open mouth", MOUTHS, next(iter(MOUTHS)))
            ui.button("Create", on_click=lambda: self._start(self._about))
        self._results()

    def _options(self) -> dict[str, Any]:
        return {
            "method": self._method.value, "open-mouth": self._mouth.value, "strength": self._strength.value
        }  # fmt: skip

    def _use(self, given: dict[str, Any]) -> None:
        chosen = taken(PhotoOptions, given)
        self._method.value, self._mouth.value, self._strength.value = (
            chosen.method,
            chosen.mouth,
            chosen.strength,
        )

    def _about(self) -> dict[str, Any]:
        s, s1, t = self._s.chosen, self._s1.chosen, self._t.chosen
        if not s1 or not t:
            raise StudioError("choose photos 2 and 3 first")
        moves = s1[0].kind == CLIP.name
        if not s and not moves:
            raise StudioError("choose photo 1 first: only a clip can do without it")
        files = {str(row.path): row.name for row in (*s, *s1, *t)}
        return {
            "files": files, "s": str(s[0].path) if s else None, "s1": str(s1[0].path), "t": str(t[0].path),
            "moves": moves, "title": f"{t[0].name}, as {s1[0].name}",
            "method": self._method.value, "mouth": self._mouth.value, "strength": self._strength.value,
        }  # fmt: skip

    def _result(self, job: JobRow, folder: Path) -> None:
        made, title = folder / job.result["output"], job.about["title"]
        if made.name == PICTURE:
            with ui.element("div").classes("desk"):
                shown(self.studio, made, f"The result: {title}").classes("full")
                with ui.column().classes("w-full"):
                    shown(self.studio, folder / MONTAGE, "Photos 1, 2, 3 and the result").classes(
                        "w-full rounded"
                    )
                    self._link("Download picture", made, title)
                    self._link("Download all four", folder / MONTAGE, f"{title}, all")
        else:
            video = ui.video(self.studio.url(made)).classes("w-full").style("max-height: 70vh")
            video.props["aria-label"] = f"The video {title}"
            self._link("Download video", made, title)


class _HeadForm(_AnalogyForm):
    kind = HEAD

    def build(self) -> None:
        """The form and its results."""
        ui.label(HEAD_INTRO).classes("mb-2")
        with ui.card().classes("w-full"):
            with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-3"):
                self._source = FilePicker(self.studio, "Source", "Source: a head at rest, or a rig", (MESH,))
                self._expressions = FilePicker(
                    self.studio, "Expressions", "Its expressions, unless it is a rig", (MESH,), several=True
                )
                self._target = FilePicker(self.studio, "Target", "Target: another head at rest", (MESH,))
            with ui.row().classes("items-center"):
                ui.label("Look at landmarks and parts, or set them yourself:")
                for words, picker in (("source", self._source), ("target", self._target)):
                    button = ui.button(f"Landmarks of the {words}", icon="place")
                    button.on_click(partial(self._edit, picker, edit_points)).props("outline")
                button = ui.button("Parts of the target", icon="face")
                button.on_click(partial(self._edit, self._target, edit_parts)).props("outline")
            self._keep_rigid = ui.switch("Keep eyes and teeth in place")
            with advanced():
                PresetChoice(HEAD_COMMANDS, self._options, self._use).build()
                self._method = choice_row("Method", HEAD_METHODS, next(iter(HEAD_METHODS)))
            ui.button("Transfer", on_click=lambda: self._start(self._about))
        self._results()

    def _options(self) -> dict[str, Any]:
        return {"method": self._method.value, "keep-rigid": self._keep_rigid.value}

    def _use(self, given: dict[str, Any]) -> None:
        chosen = taken(HeadOptions, given)
        self._method.value, self._keep_rigid.value = chosen.method, chosen.keep_rigid

    async def _edit(self, picker: FilePicker, edit: Callable[[Studio, Upload], Awaitable[None]]) -> None:
        if not picker.chosen:
            raise StudioError("choose a head first")
        await edit(self.studio, picker.chosen[0])

    def _about(self) -> dict[str, Any]:
        source, expressions, target = self._source.chosen, self._expressions.chosen, self._target.chosen
        if not source or not target:
            raise StudioError("choose a source and a target first")
        files = {str(row.path): row.name for row in (*source, *expressions, *target)}
        placed = [points_file(one[0]) for one in (source, target)]
        landmarks = [str(file) if file.exists() else AUTO for file in placed]
        return {
            "files": files, "source": str(source[0].path), "expressions": [str(row.path) for row in expressions],
            "target": str(target[0].path), "title": f"{target[0].name}, as {source[0].name}",
            "method": self._method.value, "keep_rigid": self._keep_rigid.value,
            "landmarks": landmarks if set(landmarks) != {AUTO} else None,
            "parts": str(parts_file(target[0])) if parts_file(target[0]).exists() else None,
        }  # fmt: skip

    def _result(self, job: JobRow, folder: Path) -> None:
        HeadScene(self.studio, job, folder).build()
        with ui.row():
            self._link("Download rig (GLB)", folder / TARGET, job.about["title"])
            self._link("Download a mesh for each expression (ZIP)", folder / ZIP, job.about["title"])


class HeadScene:
    """The source and the result of a finished job, which can be turned, with one of their expressions.

    folder : of the job's files.
    """

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
        for file, view, x in places:
            self._heads.append(Standing(view, x).place(self._scene, self._studio.url(self._folder / file)))
        with ui.row().classes("w-full items-center no-wrap"):
            options: dict[int, str] = {-1: "at rest"} | dict(enumerate(names))
            self._shape = ui.select(options, value=0, label="Expression", on_change=self._show).classes(
                "w-48"
            )
            self._amount = ui.slider(min=0, max=1.5, step=0.05, value=1.0, on_change=self._show)
            self._amount.props('label aria-label="Amount"')
        ui.label().bind_text_from(self._shape, "value", self._summary).classes("opacity-70")

    def _show(self) -> None:
        shape, amount = int(self._shape.value), float(self._amount.value)
        ui.run_javascript(f"guiseHeads.show({self._scene.id}, {self._heads}, {shape}, {amount})")

    def _summary(self, shape: int) -> str:
        return "" if shape < 0 else f"{self._job.result['names'][shape]}: {self._job.result['told'][shape]}."
