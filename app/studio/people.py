"""The page People: clips, and the models that are trained on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial
from typing import Any

from nicegui import app as nicegui_app
from nicegui import run, ui
from starlette.responses import PlainTextResponse, Response

from guise.aam.model import Identity, ModelError, read_header
from guise.app.enrolment.options import TrainingChoices
from guise.app.media.image_writing import encode_image
from guise.app.people.montage import montage, portrait
from guise.app.photos.enrol_photos import MAX_PHOTOS
from guise.app.studio.clip_recorder import ClipRecorder
from guise.app.studio.dialogs import asked, confirm
from guise.app.studio.enrol_job import ENROL_JOB, enrol_job, keep_person
from guise.app.studio.live_faces import FACE as LIVE_FACE
from guise.app.studio.option_form import NO_OPTIONS, OptionForm
from guise.app.studio.site import Studio, empty_state, heading, local_time, page, sentence, show_job
from guise.app.studio.store import JobRow, Person, StudioError, Upload
from guise.app.studio.swap import FACE as SWAP_FACE
from guise.app.studio.uploads import CLIP, PHOTO, shown, uploader
from guise.app.swapping.donors import FIRST_NAMES, gallery, open_donor
from guise.common.errors import GuiseError

ADVICE = (
    "A clip of 10 to 30 seconds is best: look into the camera, speak, smile, turn your head a little.",
    "One photo is enough, from the front and at rest. Teeth and turned views are then guessed.",
)
POLL_SECONDS = 1.0  # between two checks for changes made in other tabs


def register(studio: Studio) -> None:
    """Add the page /people, and pictures of the gallery's people."""
    studio.jobs.register(ENROL_JOB, enrol_job, keep_person)
    page(studio, "/people", "People", lambda: _PeoplePage(studio).build())
    nicegui_app.get("/gallery/{name}.png")(_portrait)

    async def own(id: str, pictured: Callable[[str, float], bytes]) -> Response:
        try:
            path = studio.store.person(id).path
            drawn = await run.io_bound(pictured, str(path), path.stat().st_mtime)
            return Response(drawn, media_type="image/png")
        except (GuiseError, OSError):
            return PlainTextResponse("There is nobody with this id.", 404)

    async def portrait_of(id: str) -> Response:
        return await own(id, _drawn)

    async def montage_of(id: str) -> Response:
        return await own(id, _montage)

    nicegui_app.get("/portraits/{id}.png")(portrait_of)
    nicegui_app.get("/montages/{id}.png")(montage_of)


def train(studio: Studio, clip: Upload, name: str = "", options: Mapping[str, Any] = NO_OPTIONS) -> str:
    """Start training a new person's model on a clip; the id of the job.   options : of `guise enroll`, by name."""
    return _enrol(studio, clip, studio.store.add_person(name or clip.name, clip.id), options)


def retrain(studio: Studio, person: Person) -> str:
    """Retrain a person's model, for example after their landmarks were corrected; the id of the job.

    Raises StudioError when their clip no longer exists.
    """
    return _enrol(studio, studio.store.upload(person.clip or ""), person)


def _enrol(studio: Studio, clip: Upload, person: Person, options: Mapping[str, Any] = NO_OPTIONS) -> str:
    material = {"clip": str(clip.path), "files": {str(clip.path): clip.name}, "options": dict(options)}
    return _start(studio, person, material)


def _start(studio: Studio, person: Person, material: dict[str, Any]) -> str:
    about = {"model": str(person.path), "name": person.name, "person": person.id} | material
    return studio.jobs.start(ENROL_JOB, about)


class _PeoplePage:
    """One visitor's page; changes made in other tabs appear here too, and only what changed is redrawn."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self._cards: dict[str, tuple[Any, ui.element]] = {}  # by id, what was drawn and where
        self._form = OptionForm("enroll", (TrainingChoices,))
        self._next: Upload | None = None  # that somebody may be learned from next

    def build(self) -> None:
        with ui.element("div").classes("desk"):
            with ui.column().classes("w-full"):
                heading("Your people").classes(remove="mt-4")
                self._nobody = empty_state(
                    "person_add",
                    "Nobody yet",
                    "Add yourself, or somebody who agreed. The commands find them by name.",
                )
                self._people = ui.element("div").classes("w-full grid gap-4 items-start sm:grid-cols-2")
                self._clips_heading = heading("Your clips")
                self._clips = ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2 md:grid-cols-4")
                self._gallery()
            with ui.column().classes("w-full") as self._adding:
                self._add()
        self._poll()
        ui.timer(POLL_SECONDS, self._poll)

    def _poll(self) -> None:
        """Draw what is new or has changed, and take away what is gone."""
        store = self.studio.store
        jobs, people, clips = self._jobs(), store.people(), store.clips()
        # a card stays from when its job is queued until it ends: a click on one that goes meanwhile would be lost
        self._sync(self._people, [(job.id, job.ended and (job.state, job.sentence), partial(self._job, job))
                                  for job in jobs]
                   + [(one.id, one, partial(self._person, one)) for one in people])  # fmt: skip
        self._sync(self._clips, [(clip.id, clip, partial(self._clip, clip)) for clip in clips])
        self._nobody.set_visibility(not people and not jobs)
        self._adding.classes(**{"remove" if people or jobs else "add": "first"})
        self._clips_heading.set_visibility(bool(clips))

    def _sync(self, grid: ui.element, wanted: list[tuple[str, Any, Callable[[], None]]]) -> None:
        """Have the cards of a grid be those that are wanted: id, what it depends on, and how it is drawn."""
        now = {id: about for id, about, _ in wanted}
        for id, (about, card) in list(self._cards.items()):
            if card.parent_slot is not None and card.parent_slot.parent is grid and now.get(id) != about:
                card.delete()
                del self._cards[id]
        for place, (id, about, fill) in enumerate(wanted):
            if id not in self._cards:
                with grid, ui.card() as card:
                    fill()
                card.move(grid, target_index=place)
                self._cards[id] = about, card

    def _jobs(self) -> list[JobRow]:
        return [job for job in self.studio.store.jobs() if job.kind == ENROL_JOB and job.state != "done"]

    # -- somebody new ----------------------------------------------------------------------------------------------

    def _add(self) -> None:
        with ui.card().classes("w-full") as self._card:
            heading("Add a person").classes(remove="mt-4")
            self._name = ui.input("Name").props("outlined dense").classes("w-full")
            field = uploader(
                self.studio, "Choose a clip or photos", self._uploaded, (CLIP, PHOTO), several=True,
                hint="Drop a clip of one person, or up to nine photos",
            )  # fmt: skip
            recorder = ClipRecorder(field)
            recorder.stage()
            self._form.build()
            self._material()
            for words in ADVICE:
                ui.label(words).classes("opacity-70")

    def _uploaded(self, upload: Upload) -> None:
        if upload.kind == CLIP.name:
            self._take(upload)
        self._material.refresh()

    def _take(self, clip: Upload) -> None:
        """Propose to learn from a clip."""
        self._next = clip
        self._material.refresh()
        ui.run_javascript(f"getHtmlElement({self._card.id}).scrollIntoView()")
        self._poll()

    def _waiting_photos(self) -> list[Upload]:
        """The photos that were uploaded and are in no job, the first one first."""
        jobs = [job for job in self._jobs() if "photos" in job.about]
        taken = {path for job in jobs for path in job.about["photos"]}
        return [one for one in self.studio.store.uploads(PHOTO.name)[::-1] if str(one.path) not in taken]

    @ui.refreshable_method
    def _material(self) -> None:
        """What somebody can be learned from, and what the user says of it before."""
        photos, clip = self._waiting_photos(), self._next
        if clip is not None and clip.path.exists():
            shown(self.studio, clip.path, f"The clip {clip.name}").classes("w-full rounded")
        elif not photos:
            return
        else:
            clip = None
        with ui.row().classes("gap-2"):
            for photo in photos:
                with ui.column().classes("items-center gap-0"):
                    picture = (
                        ui.image(self.studio.url(photo.preview)).classes("w-24 h-24").props("fit=contain")
                    )
                    picture.props["alt"] = photo.name
                    remove = ui.button(icon="delete", color=None, on_click=partial(self._drop, photo))
                    remove.props("flat round dense").props["aria-label"] = f"Remove the photo {photo.name}"
        agreed = ui.checkbox("The person shown here agreed to this, or it is me.")
        many = "this photo" if len(photos) == 1 else f"these {len(photos)} photos"
        ways: list[tuple[str, Callable[[], None]]] = []
        if clip is not None:
            ways.append(("this clip", partial(self._learn_clip, clip)))
        if photos:
            ways.append((many, lambda: self._learn(photos)))
        for words, learn in ways:
            button = ui.button(f"Learn from {words}", icon="face", on_click=learn).classes("w-full")
            button.bind_enabled_from(agreed, "value")

    def _drop(self, photo: Upload) -> None:
        self.studio.store.remove_upload(photo.id)
        self._material.refresh()

    def _learn_clip(self, clip: Upload) -> None:
        train(self.studio, clip, self._name.value, self._form.values)
        self._next = None
        self._begun()

    def _learn(self, photos: list[Upload]) -> None:
        if len(photos) > MAX_PHOTOS:
            raise StudioError(f"choose at most {MAX_PHOTOS} photos of one person, there are {len(photos)}")
        names, options = {str(photo.path): photo.name for photo in photos}, self._form.values
        person = self.studio.store.add_person(self._name.value or photos[0].name, None)
        _start(self.studio, person, {"photos": list(names), "files": names, "options": options})
        self._begun()

    def _begun(self) -> None:
        self._name.value = ""
        self._material.refresh()
        self._poll()

    # -- everybody -------------------------------------------------------------------------------------------------

    def _job(self, job: JobRow) -> None:
        ui.label(job.about["name"]).classes("text-h6")
        if not job.ended:
            show_job(self.studio, job.id, lambda _: self._poll())
            return
        ui.label(sentence(job.sentence or "cancelled"))
        with ui.row():
            ui.button("Try again", on_click=partial(self._retry, job))
            ui.button("Remove", on_click=partial(self._remove_job, job)).props("outline")

    def _retry(self, job: JobRow) -> None:
        self.studio.jobs.start(ENROL_JOB, job.about)
        self.studio.store.remove_job(job.id)
        self._poll()

    def _remove_job(self, job: JobRow) -> None:
        """Remove a failed or cancelled job, and its person if they were new; its photos can be used again."""
        person = self.studio.store.person(job.about["person"])
        if not person.path.exists():
            self.studio.store.remove_person(person.id)
        self.studio.store.remove_job(job.id)
        self._material.refresh()
        self._poll()

    def _person(self, person: Person) -> None:
        with ui.row().classes("w-full no-wrap items-start"):
            face = ui.image(f"/portraits/{person.id}.png?{person.path.stat().st_mtime_ns}")
            face.classes("w-32 shrink-0 rounded").props["alt"] = f"The face of {person.name}"
            with ui.column().classes("gap-1 min-w-0"):
                ui.label(person.name).classes("text-h6 break-all")
                ui.label(f"Added {local_time(person.created)}.").classes("opacity-70")
                facts = self._facts(person)
                if "made_from" in facts:
                    ui.label(f"Learned from {facts['made_from']}.")
                if quality := self._quality(person):
                    ui.label(f"Quality: {quality}.")
                for sentence in facts.get("weaknesses", ()):
                    ui.label(sentence[:1].upper() + sentence[1:] + ".").classes("opacity-70")
        with ui.row().classes("items-center gap-1"):
            for words, use in (("Use live", self._use_live), ("Swap with", self._swap_with)):
                button = ui.button(words, on_click=partial(use, person)).props("padding='xs sm'")
                button.props["aria-label"] = f"{words} {person.name}"
            for words, act in (("Rename", self._rename), ("Delete", self._confirm_delete)):
                button = ui.button(words, on_click=partial(act, person)).props("outline padding='xs sm'")
                button.props["aria-label"] = f"{words} {person.name}"
        with ui.expansion("Details").classes("w-full"):
            picture = f"/montages/{person.id}.png?{person.path.stat().st_mtime_ns}"
            with ui.link(target=picture, new_tab=True).classes("w-full"):
                ui.image(picture).props("loading=lazy").props["alt"] = f"The model of {person.name}"
            link = ui.link("Download the model", self.studio.url(person.path))
            link.props["download"] = f"{person.name}.guise"

    def _facts(self, person: Person) -> dict[str, Any]:
        """What their model says of its enrolment."""
        try:
            return dict(read_header(person.path).facts)
        except ModelError:
            return {}

    def _quality(self, person: Person) -> str:
        """What their last enrolment found, "" where that is not known."""
        jobs = (job for job in self.studio.store.jobs() if job.kind == ENROL_JOB and job.state == "done")
        return next((job.result.get("quality", "") for job in jobs if job.about["person"] == person.id), "")

    def _use_live(self, person: Person) -> None:
        self.studio.store.remember(LIVE_FACE, str(person.path))
        ui.navigate.to("/live")

    def _swap_with(self, person: Person) -> None:
        self.studio.store.remember(SWAP_FACE, str(person.path))
        ui.navigate.to("/swap")

    async def _rename(self, person: Person) -> None:
        name = await asked("A new name", person.name)
        if name and name.strip():
            self.studio.store.rename_person(person.id, name)
            self._poll()

    def _clip(self, clip: Upload) -> None:
        ui.label(clip.name).classes("text-bold break-all")
        ui.label(local_time(clip.created))
        shown(self.studio, clip.path, f"The clip {clip.name}").classes("w-full")
        with ui.row().classes("items-center"):
            learn = ui.button("Learn", on_click=partial(self._take, clip))
            learn.props["aria-label"] = f"Learn from the clip {clip.name}"
            ui.link("Download", self.studio.url(clip.path)).props["download"] = clip.name + clip.path.suffix
            button = ui.button("Delete", on_click=partial(self._confirm_delete, clip)).props("outline")
            button.props["aria-label"] = f"Delete the clip {clip.name}"

    async def _confirm_delete(self, row: Person | Upload) -> None:
        """Delete after the user confirms."""
        what = "the clip" if isinstance(row, Upload) else "the person"
        kept = "" if isinstance(row, Upload) else " Their clip is kept."
        question = f"Delete {what} {row.name}? This cannot be undone.{kept}"
        if await confirm(question, "Delete", "Keep"):
            store = self.studio.store
            (store.remove_person if isinstance(row, Person) else store.remove_upload)(row.id)
            self._poll()

    def _gallery(self) -> None:
        heading("Built-in faces")
        ui.label("Rendered people who do not exist. You may show these faces freely.")
        with ui.element("div").classes("faces"):
            for id, name in FIRST_NAMES.items():
                with ui.column().classes("face items-center gap-0"):
                    face = ui.element("img").props(f'alt="The fictional face {name}"')
                    face.props["src"] = f"/gallery/{id}.png"
                    ui.label(name)


async def _portrait(name: str) -> Response:
    if name not in gallery():
        return PlainTextResponse(f"There is no built-in face called {name}.", 404)
    return Response(await run.io_bound(_drawn, name), media_type="image/png")


@lru_cache
def _montage(file: str, changed: float) -> bytes:
    """A PNG of what a model file holds as it was changed last."""
    return encode_image(montage(Identity.load(file)), None, ".png", {})


@lru_cache
def _drawn(face: str, changed: float = 0.0) -> bytes:
    """A PNG of somebody of the gallery, or of a model file as it was changed last."""
    identity = Identity.load(face) if changed else open_donor(face)
    return encode_image(portrait(identity), None, ".png", {})
