"""The page People: clips, and the models that are learned from them."""

from __future__ import annotations

from functools import lru_cache, partial

from nicegui import app as nicegui_app
from nicegui import run, ui
from starlette.responses import PlainTextResponse, Response

from guise.app.media.images import encode_image
from guise.app.people.montage import draw
from guise.app.studio.enrol_job import KIND, enrol_job
from guise.app.studio.questions import agreed
from guise.app.studio.recorder import Recorder
from guise.app.studio.site import Studio, heading, page, show_job
from guise.app.studio.store import Clip, JobRow, Person
from guise.app.studio.uploads import uploader
from guise.app.swapping.donors import gallery, open_donor

LOOK = 1.0  # seconds between two looks at what other tabs have changed


def register(studio: Studio) -> None:
    """Add the page /people, and pictures of the gallery's people."""
    studio.jobs.register(KIND, enrol_job)
    page(studio, "/people", "People", lambda: _Page(studio).build())
    nicegui_app.get("/gallery/{name}.png")(_portrait)


def learn(studio: Studio, clip: Clip, name: str = "") -> str:
    """Begin to learn a new person from a clip; the id of the job."""
    return _enrol(studio, clip, studio.store.add_person(name or clip.name, clip.id))


def learn_again(studio: Studio, person: Person) -> str:
    """Begin to learn a person anew, such as after their landmarks were corrected; the id of the job.

    Raises StudioError when their clip is no longer there.
    """
    return _enrol(studio, studio.store.clip(person.clip or ""), person)


def _enrol(studio: Studio, clip: Clip, person: Person) -> str:
    about = {"clip": str(clip.path), "called": clip.name, "model": str(person.path), "name": person.name}
    return studio.jobs.start(KIND, about | {"person": person.id})


class _Page:
    """One visitor's page; what another tab changes appears here too."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self._shown = self._state()

    def build(self) -> None:
        self._add()
        self._people()
        self._gallery()
        ui.timer(LOOK, self._look)

    def _state(self) -> list[tuple[str, bool]]:
        """What the lists depend on, and no more: what is drawn anew forgets a click that is on its way."""
        store = self.studio.store
        kept = [row.id for rows in (store.people(), store.clips()) for row in rows]
        return [(id, True) for id in kept] + [(job.id, job.ended) for job in self._jobs()]

    def _look(self) -> None:
        state = self._state()
        if state != self._shown:
            self._shown = state
            self._people.refresh()

    def _jobs(self) -> list[JobRow]:
        return [job for job in self.studio.store.jobs() if job.kind == KIND and job.state != "done"]

    def _add(self) -> None:
        with ui.card().classes("w-full"):
            heading("Add a person").classes(remove="mt-4")
            name = ui.input("Name").props("outlined dense").classes("w-full max-w-sm")

            def learn_named(clip: Clip) -> None:
                learn(self.studio, clip, name.value)
                name.value = ""
                self._look()

            ui.label(
                "A clip of 10 to 30 seconds that shows one face from the front: look, speak, smile, turn a little."
            )
            with ui.row():
                field = uploader(self.studio, "Upload a clip", learn_named)
                recorder = Recorder(field)
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
                show_job(self.studio, job.id, lambda _: self._look())
                return
            ui.label(job.sentence or "Cancelled.")
            with ui.row():
                ui.button("Try again", on_click=partial(self._again, job))
                ui.button("Remove", on_click=partial(self._forget, job)).props("outline")

    def _again(self, job: JobRow) -> None:
        self.studio.jobs.start(KIND, job.about)
        self.studio.store.remove_job(job.id)
        self._look()

    def _forget(self, job: JobRow) -> None:
        """Remove a job that came to nothing, and the place of its person if they were new."""
        person = self.studio.store.person(job.about["person"])
        if not person.path.exists():
            self.studio.store.remove_person(person.id)
        self.studio.store.remove_job(job.id)
        self._look()

    def _person(self, person: Person) -> None:
        with ui.card():
            ui.label(person.name).classes("text-h6 break-all")
            ui.label(f"Learned on {person.created[:10]}.")
            picture, model = self.studio.url(person.montage), self.studio.url(person.path)
            with ui.link(target=picture, new_tab=True).classes("w-full"):
                ui.image(picture).props["alt"] = f"What the model of {person.name} has learned"
            with ui.row().classes("items-center"):
                ui.link("Download", model).props["download"] = f"{person.name}.guise"
                button = ui.button("Delete", on_click=partial(self._ask, person)).props("outline")
                button.props["aria-label"] = f"Delete {person.name}"

    def _clip(self, clip: Clip) -> None:
        with ui.card():
            ui.label(clip.name).classes("text-bold break-all")
            ui.label(clip.created.replace("T", " ")[:16] + " UTC")
            ui.video(self.studio.url(clip.path)).classes("w-full").props["aria-label"] = (
                f"The clip {clip.name}"
            )
            with ui.row().classes("items-center"):
                ui.button("Learn", on_click=partial(self._learn, clip)).props["aria-label"] = (
                    f"Learn {clip.name}"
                )
                ui.link("Download", self.studio.url(clip.path)).props["download"] = (
                    clip.name + clip.path.suffix
                )
                button = ui.button("Delete", on_click=partial(self._ask, clip)).props("outline")
                button.props["aria-label"] = f"Delete the clip {clip.name}"

    def _learn(self, clip: Clip) -> None:
        learn(self.studio, clip)
        self._look()

    async def _ask(self, row: Person | Clip) -> None:
        """Delete after a question."""
        what = "the clip" if isinstance(row, Clip) else "the person"
        kept = "" if isinstance(row, Clip) else " Their clip is kept."
        question = f"Delete {what} {row.name}? This cannot be undone.{kept}"
        if await agreed(question, "Delete", "Keep"):
            store = self.studio.store
            (store.remove_person if isinstance(row, Person) else store.remove_clip)(row.id)
            self._look()

    def _gallery(self) -> None:
        heading("Ready faces")
        ui.label("Rendered people who do not exist; they can be shown by anybody.")
        with ui.row():
            for name in gallery():
                with ui.column().classes("items-center"):
                    ui.image(f"/gallery/{name}.png").classes("w-24").props(f'alt="The fictional face {name}"')
                    ui.label(name)


async def _portrait(name: str) -> Response:
    if name not in gallery():
        return PlainTextResponse(f"There is no ready face {name}.", 404)
    return Response(await run.io_bound(_drawn, name), media_type="image/png")


@lru_cache
def _drawn(name: str) -> bytes:
    """A PNG of a gallery person's neutral face."""
    look = open_donor(name).appearance
    return encode_image(draw(look, look.neutral), None, ".png", {})
