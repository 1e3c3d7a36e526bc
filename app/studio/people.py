"""The page People: clips, and the models that are trained on them."""

from __future__ import annotations

from functools import lru_cache, partial

from nicegui import app as nicegui_app
from nicegui import run, ui
from starlette.responses import PlainTextResponse, Response

from guise.aam.model import Identity, ModelError, read_header
from guise.app.media.images import encode_image
from guise.app.people.montage import draw
from guise.app.studio.clip_recorder import ClipRecorder
from guise.app.studio.dialogs import confirm
from guise.app.studio.enrol_job import ENROL_JOB, enrol_job
from guise.app.studio.site import Studio, heading, page, show_job
from guise.app.studio.store import Clip, JobRow, Person
from guise.app.studio.uploads import uploader
from guise.app.swapping.donors import gallery, open_donor
from guise.common.errors import GuiseError

POLL_SECONDS = 1.0  # between two checks for changes made in other tabs


def register(studio: Studio) -> None:
    """Add the page /people, and pictures of the gallery's people."""
    studio.jobs.register(ENROL_JOB, enrol_job)
    page(studio, "/people", "People", lambda: _PeoplePage(studio).build())
    nicegui_app.get("/gallery/{name}.png")(_portrait)

    async def own(id: str) -> Response:
        try:
            path = studio.store.person(id).path
            return Response(
                await run.io_bound(_drawn, str(path), path.stat().st_mtime), media_type="image/png"
            )
        except (GuiseError, OSError):
            return PlainTextResponse("There is nobody with this id.", 404)

    nicegui_app.get("/portraits/{id}.png")(own)


def train(studio: Studio, clip: Clip, name: str = "") -> str:
    """Start training a new person's model on a clip; the id of the job."""
    return _enrol(studio, clip, studio.store.add_person(name or clip.name, clip.id))


def retrain(studio: Studio, person: Person) -> str:
    """Retrain a person's model, for example after their landmarks were corrected; the id of the job.

    Raises StudioError when their clip no longer exists.
    """
    return _enrol(studio, studio.store.clip(person.clip or ""), person)


def _enrol(studio: Studio, clip: Clip, person: Person) -> str:
    about = {"clip": str(clip.path), "called": clip.name, "model": str(person.path), "name": person.name}
    return studio.jobs.start(ENROL_JOB, about | {"person": person.id})


class _PeoplePage:
    """One visitor's page; changes made in other tabs appear here too."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self._shown_state = self._state()

    def build(self) -> None:
        self._add()
        self._people()
        self._gallery()
        ui.timer(POLL_SECONDS, self._poll)

    def _state(self) -> list[tuple[str, bool]]:
        """What the lists depend on, and no more: redrawing would lose a click that is under way."""
        store = self.studio.store
        kept = [row.id for rows in (store.people(), store.clips()) for row in rows]
        return [(id, True) for id in kept] + [(job.id, job.ended) for job in self._jobs()]

    def _poll(self) -> None:
        state = self._state()
        if state != self._shown_state:
            self._shown_state = state
            self._people.refresh()

    def _jobs(self) -> list[JobRow]:
        return [job for job in self.studio.store.jobs() if job.kind == ENROL_JOB and job.state != "done"]

    def _add(self) -> None:
        with ui.card().classes("w-full"):
            heading("Add a person").classes(remove="mt-4")
            name = ui.input("Name").props("outlined dense").classes("w-full max-w-sm")

            def train_named(clip: Clip) -> None:
                train(self.studio, clip, name.value)
                name.value = ""
                self._poll()

            ui.label(
                "A clip of 10 to 30 seconds that shows one face from the front: look into the camera, speak, smile, "
                "turn your head a little."
            )
            with ui.row():
                field = uploader(self.studio, "Upload a clip", train_named)
                recorder = ClipRecorder(field)
            recorder.stage()

    @ui.refreshable_method
    def _people(self) -> None:
        people, jobs, clips = self.studio.store.people(), self._jobs(), self.studio.store.clips()
        heading("Your people")
        if not people and not jobs:
            ui.label("Nobody yet.")
        with ui.element("div").classes("w-full grid gap-4 items-start sm:grid-cols-2"):
            for job in jobs:
                self._job(job)
            for person in people:
                self._person(person)
        if clips:
            heading("Your clips")
        with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2 md:grid-cols-4"):
            for clip in clips:
                self._clip(clip)

    def _job(self, job: JobRow) -> None:
        with ui.card():
            ui.label(job.about["name"]).classes("text-h6")
            if not job.ended:
                show_job(self.studio, job.id, lambda _: self._poll())
                return
            ui.label(job.sentence or "Cancelled.")
            with ui.row():
                ui.button("Try again", on_click=partial(self._retry, job))
                ui.button("Remove", on_click=partial(self._remove_job, job)).props("outline")

    def _retry(self, job: JobRow) -> None:
        self.studio.jobs.start(ENROL_JOB, job.about)
        self.studio.store.remove_job(job.id)
        self._poll()

    def _remove_job(self, job: JobRow) -> None:
        """Remove a failed or cancelled job, and its person if they were new."""
        person = self.studio.store.person(job.about["person"])
        if not person.path.exists():
            self.studio.store.remove_person(person.id)
        self.studio.store.remove_job(job.id)
        self._poll()

    def _person(self, person: Person) -> None:
        with ui.card():
            ui.label(person.name).classes("text-h6 break-all")
            ui.label(f"Added on {person.created[:10]}.")
            for sentence in self._weaknesses(person):
                ui.label(sentence[:1].upper() + sentence[1:] + ".").classes("opacity-70")
            picture, model = self.studio.url(person.montage), self.studio.url(person.path)
            with ui.link(target=picture, new_tab=True).classes("w-full"):
                ui.image(picture).props["alt"] = f"The model of {person.name}"
            with ui.row().classes("items-center"):
                ui.link("Download", model).props["download"] = f"{person.name}.guise"
                button = ui.button("Delete", on_click=partial(self._confirm_delete, person)).props("outline")
                button.props["aria-label"] = f"Delete {person.name}"

    def _weaknesses(self, person: Person) -> list[str]:
        """What to do better in their next clip, as their model says."""
        try:
            return [str(sentence) for sentence in read_header(person.path).facts.get("weaknesses", ())]
        except ModelError:
            return []

    def _clip(self, clip: Clip) -> None:
        with ui.card():
            ui.label(clip.name).classes("text-bold break-all")
            ui.label(clip.created.replace("T", " ")[:16] + " UTC")
            ui.video(self.studio.url(clip.path)).classes("w-full").props["aria-label"] = (
                f"The clip {clip.name}"
            )
            with ui.row().classes("items-center"):
                ui.button("Train", on_click=partial(self._train, clip)).props["aria-label"] = (
                    f"Train on {clip.name}"
                )
                ui.link("Download", self.studio.url(clip.path)).props["download"] = (
                    clip.name + clip.path.suffix
                )
                button = ui.button("Delete", on_click=partial(self._confirm_delete, clip)).props("outline")
                button.props["aria-label"] = f"Delete the clip {clip.name}"

    def _train(self, clip: Clip) -> None:
        train(self.studio, clip)
        self._poll()

    async def _confirm_delete(self, row: Person | Clip) -> None:
        """Delete after the user confirms."""
        what = "the clip" if isinstance(row, Clip) else "the person"
        kept = "" if isinstance(row, Clip) else " Their clip is kept."
        question = f"Delete {what} {row.name}? This cannot be undone.{kept}"
        if await confirm(question, "Delete", "Keep"):
            store = self.studio.store
            (store.remove_person if isinstance(row, Person) else store.remove_clip)(row.id)
            self._poll()

    def _gallery(self) -> None:
        heading("Built-in faces")
        ui.label("Rendered people who do not exist; anybody may show their faces.")
        with ui.row():
            for name in gallery():
                with ui.column().classes("items-center"):
                    ui.image(f"/gallery/{name}.png").classes("w-24").props(f'alt="The fictional face {name}"')
                    ui.label(name)


async def _portrait(name: str) -> Response:
    if name not in gallery():
        return PlainTextResponse(f"There is no built-in face called {name}.", 404)
    return Response(await run.io_bound(_drawn, name), media_type="image/png")


@lru_cache
def _drawn(face: str, changed: float = 0.0) -> bytes:
    """A PNG of the neutral face of somebody of the gallery, or of a model file as it was changed last."""
    appearance = (Identity.load(face) if changed else open_donor(face)).appearance
    return encode_image(draw(appearance, appearance.neutral), None, ".png", {})
