"""The page De-identify: upload a video, look at who is in it, choose what is done with each face, and have it made.

The list of all videos is at /deidentify, each of them at /deidentify/ID, where ID is that of its job "review".  Each
rendering of it is a job "render", which says in `about` whose.
"""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import lru_cache
from typing import Any

from nicegui import ui

from app.deidentify.html import Html, tag
from app.deidentify.page import COUNTS, HEADLINES
from app.deidentify.report import clock
from app.deidentify.sheet import COLOURS
from app.donors import open_donor
from app.media.images import encode_image
from app.montage import draw
from app.outputs import write_whole
from app.studio.deidentify_jobs import REPORTS, TRACKS, Choices, download_name, render, review, thumbnail
from app.studio.site import Studio, page, show_job, uploader
from app.studio.store import Clip, JobRow

PATH = "/deidentify"
REVIEW, RENDER = "deidentify-review", "deidentify-render"
CHOICES = "choices.json"
SHOWN = 20  # tracks on a page
CHOSEN = "chosen by Guise"
ACTIONS = {"swap": "Swap", "cover": "Cover", "leave": "Leave"}
COVERS = {"solid": "Solid", "mosaic": "Mosaic", "blur": "Blur"}
SOUNDS = {"keep": "Keep", "drop": "Drop", "mask": "Disguise voices"}
TONES = {"good": "border-positive", "fair": "border-warning", "bad": "border-negative"}
INTRO = (
    "Every face in a video becomes another person's, with the expression kept, or is covered. Nothing is changed "
    "before you have seen what was found. All of it stays on this computer."
)
LIMITS = (
    "Hair, body, clothes, voice and surroundings stay as they are, and a detector can miss a face: watch the whole "
    "output before you share it."
)


def register(studio: Studio) -> None:
    """Add the pages and what they have done."""
    studio.jobs.register(REVIEW, review)
    studio.jobs.register(RENDER, render)
    page(studio, PATH, "De-identify", lambda: _list(studio))
    page(studio, PATH + "/{id}", "De-identify", lambda id: _Case(studio, id).build())


# -- all videos -----------------------------------------------------------------------------------------------


def _list(studio: Studio) -> None:
    ui.label(INTRO)
    uploader(studio, "A video to de-identify", lambda clip: _begin(studio, clip))
    clips = {clip.id: clip.name for clip in studio.store.clips()}
    if clips:
        with ui.row().classes("w-full items-center no-wrap"):
            chosen = ui.select(clips, label="or one that is here already").classes("grow")
            start = ui.button(
                "Look for faces", on_click=lambda: _begin(studio, studio.store.clip(chosen.value))
            )
            start.bind_enabled_from(chosen, "value", bool)
    reviews = [job for job in studio.store.jobs() if job.kind == REVIEW]
    if reviews:
        ui.label("Earlier").classes("text-h6 mt-4")
        with ui.list().props("bordered separator").classes("w-full"):
            for job in reviews:
                _entry(studio, job)


def _begin(studio: Studio, clip: Clip) -> None:
    id = studio.jobs.start(REVIEW, {"source": str(clip.path), "name": clip.name})
    ui.navigate.to(f"{PATH}/{id}")


def _entry(studio: Studio, job: JobRow) -> None:
    with ui.item().props(f'clickable href="{PATH}/{job.id}"'):
        with ui.item_section():
            ui.item_label(job.about["name"])
            ui.item_label(f"{_when(job)} · {_state(studio, job)}").props("caption")
        with ui.item_section().props("side"):
            ui.icon("chevron_right")


def _state(studio: Studio, job: JobRow) -> str:
    """How far a video is, in a few words."""
    if job.state == "failed":
        return job.sentence
    if job.state == "cancelled":
        return "cancelled"
    if job.state != "done":
        return "looking for faces"
    made = _renders(studio, job.id)
    return made[0].result.get("sentence", "rendering") if made else "ready to be reviewed"


def _renders(studio: Studio, id: str) -> list[JobRow]:
    """What was made of a video, newest first; not what was cancelled."""
    jobs = [job for job in studio.store.jobs() if job.kind == RENDER and job.about["id"] == id]
    return [job for job in jobs if job.state != "cancelled"]


def _when(job: JobRow) -> str:
    return job.created[:16].replace("T", " ") + " UTC"


# -- a video --------------------------------------------------------------------------------------------------


class _Case:
    """A video on a page: its progress, its tracks, and what was made of it."""

    def __init__(self, studio: Studio, id: str) -> None:
        self.studio = studio
        self.job = studio.store.job(id)
        self.folder = studio.store.folder_of(id)

    def build(self) -> None:
        """All of it."""
        with ui.row().classes("w-full items-center"):
            ui.link("All videos", PATH)
            ui.label(self.job.about["name"]).classes("text-h6 grow break-all")
            ui.button("Delete", icon="delete", on_click=self._delete).props("flat")
        self._content()

    @ui.refreshable_method
    def _content(self) -> None:
        job = self.job = self.studio.store.job(self.job.id)
        if not job.ended:
            ui.label("Looking for faces. You may leave this page and come back.")
            show_job(self.studio, job.id, lambda _: self._content.refresh())
        elif job.state == "done":
            self.results()
            _Editor(self).build()
        else:
            _banner("bad", "Nothing was done", job.sentence or "You have cancelled it.")

    @ui.refreshable_method
    def results(self) -> None:
        """What was made, newest first."""
        for place, job in enumerate(_renders(self.studio, self.job.id)):
            if not job.ended:
                show_job(self.studio, job.id, lambda _: self.results.refresh())
            elif job.state == "failed":
                _banner("bad", "Nothing was made", job.sentence)
            else:
                with ui.expansion(_when(job), value=place == 0).classes("w-full"):
                    _result(self.studio, job)

    def render(self, choices: Choices) -> None:
        """Have it made."""
        about = {
            "id": self.job.id, "source": self.job.about["source"], "name": self.job.about["name"],
            "review": str(self.folder), "output": self.job.result["output"], "choices": asdict(choices),
        }  # fmt: skip
        self.studio.jobs.start(RENDER, about)
        self.results.refresh()

    async def _delete(self) -> None:
        words = "What was found in this video and all that was made of it will be deleted. The video itself stays."
        if await _agreed(words, "Delete", "Keep"):
            for job in [*_renders(self.studio, self.job.id), self.job]:
                self.studio.jobs.cancel(job.id)
                self.studio.store.remove_job(job.id)
            ui.navigate.to(PATH)


def _banner(tone: str, title: str, words: str) -> None:
    with ui.column().classes(f"w-full gap-1 p-3 border-l-8 {TONES[tone]}").props('role="status"'):
        ui.label(title).classes("text-h6")
        ui.label(words).classes("break-words")


async def _agreed(words: str, yes: str, no: str) -> bool:
    """Whether the user agrees to what words say."""
    with ui.dialog() as dialog, ui.card().props('role="alertdialog"'):
        ui.label(words)
        with ui.row().classes("w-full justify-end"):
            ui.button(no, on_click=lambda: dialog.submit(False)).props("flat autofocus")
            ui.button(yes, on_click=lambda: dialog.submit(True)).props("color=negative")
    answer = await dialog
    dialog.delete()
    return bool(answer)


# -- what was made --------------------------------------------------------------------------------------------


def _result(studio: Studio, job: JobRow) -> None:
    tone, headline = HEADLINES[job.result["outcome"]]
    _banner(tone, headline, job.result["sentence"])
    folder, output = studio.store.folder_of(job.id), job.about["output"]
    with ui.row().classes("w-full"):
        ui.video(studio.url(folder / output)).classes("grow basis-80").props('aria-label="The output"')
        with ui.column().classes("grow basis-60"):
            _counts(job.result["counts"])
            ui.label(_chosen(Choices(**job.about["choices"]))).classes("opacity-70")
    with ui.row():
        for name, words in ((output, "Video"), (REPORTS[0], "Report (HTML)"), (REPORTS[1], "Report (JSON)")):
            link = ui.link(f"Download {words}", studio.url(folder / name))
            link.props["download"] = download_name(job.about["name"], name)
        ui.link("Open the report", studio.url(folder / REPORTS[0]), new_tab=True)
    ui.label(LIMITS).classes("opacity-70")


def _counts(counts: dict[str, int]) -> None:
    columns = [
        {"name": "what", "label": "Frames with", "field": "what", "align": "left"},
        {"name": "count", "label": "Number", "field": "count"},
    ]
    rows = [{"what": words, "count": f"{counts[name]:,}"} for name, words in COUNTS.items()]
    ui.table(columns=columns, rows=rows).props("flat dense hide-bottom").classes("w-full")


def _chosen(choices: Choices) -> str:
    done = list(choices.actions.values())
    faces = ", ".join(f"{done.count(action)} to {action}" for action in COLOURS if action in done)
    return (
        f"Tracks: {faces or 'none'}. Cover: {COVERS[choices.cover].lower()}. "
        f"Expression: {choices.alpha:.1f}. Sound: {SOUNDS[choices.audio].lower()}."
    )


# -- the choices ----------------------------------------------------------------------------------------------


class _Editor:
    """The tracks of a video and what is to be done with each; every change is kept."""

    def __init__(self, case: _Case) -> None:
        self.case, self.studio = case, case.studio
        value = json.loads((case.folder / TRACKS).read_text(encoding="utf-8"))
        self.frames: int = value["frames"]
        self.tracks: list[dict[str, Any]] = value["tracks"]
        self.faces = {"": CHOSEN} | self.studio.faces()
        self.choices = self._kept()
        self.place = 1

    def build(self) -> None:
        """Tracks, settings, and the button that begins."""
        ui.label("Who is in it").classes("text-h6 mt-4")
        if not self.tracks:
            ui.label("No face could be followed. What may be a face somewhere is covered.")
        self._people()
        pages = -(-len(self.tracks) // SHOWN)
        if pages > 1:
            ui.pagination(1, pages, direction_links=True, on_change=self._turn)
        self._settings()
        self._begin()

    def _kept(self) -> Choices:
        """What was chosen before; a donor who is no longer there is chosen anew."""
        path = self.case.folder / CHOICES
        if not path.exists():
            return Choices.proposed(self.tracks)
        choices = Choices(**json.loads(path.read_text(encoding="utf-8")))
        choices.donors = {k: spec if spec in self.faces else "" for k, spec in choices.donors.items()}
        return choices

    def _keep(self) -> None:
        text = json.dumps(asdict(self.choices))
        write_whole(self.case.folder / CHOICES, lambda part: part.write_text(text, encoding="utf-8"))

    def _turn(self, event: Any) -> None:
        self.place = event.value
        self._people.refresh()

    @ui.refreshable_method
    def _people(self) -> None:
        first = (self.place - 1) * SHOWN
        people: dict[int, list[dict[str, Any]]] = {}
        for track in self.tracks[first : first + SHOWN]:
            people.setdefault(track["person"], []).append(track)
        for person, tracks in people.items():
            with ui.card().classes("w-full"):
                with ui.row().classes("w-full items-center"):
                    ui.label(f"Person {person}").classes("text-h6 grow")
                    if any(track["can_swap"] for track in tracks):
                        self._donor(str(person))
                for track in tracks:
                    self._track(track)

    def _donor(self, person: str) -> None:
        async def choose() -> None:
            spec = await _pick(self.faces)
            if spec is not None:
                self.choices.donors[person] = spec
                self._keep()
                button.text = said()

        def said() -> str:
            return f"Donor: {self.faces[self.choices.donors[person]]}"

        button = ui.button(said(), icon="face", on_click=choose).props("outline no-caps")

    def _track(self, track: dict[str, Any]) -> None:
        number = str(track["track"])
        ui.separator()
        with ui.row().classes("w-full items-center"):
            with ui.column().classes("gap-0 grow"):
                ui.label(f"Track {number}").classes("text-bold")
                ui.label(_about(track)).classes("opacity-70")
                if track["reason"]:
                    ui.label(f"Guise would cover it: {track['reason']}.")
            self._action(track, lambda: line.set_content(self._line(track)))
        with ui.row().classes("gap-1"):
            for place in range(self.case.job.result["pictures"][number]):
                picture = ui.image(self.studio.url(self.case.folder / thumbnail(track["track"], place)))
                picture.classes("w-20 h-20 rounded").props(f'alt="Track {number}, picture {place + 1}"')
        line = ui.html(self._line(track), sanitize=False).classes("w-full")

    def _action(self, track: dict[str, Any], changed: Callable[[], Any]) -> None:
        number = str(track["track"])

        async def choose() -> None:
            action = toggle.value
            if action == self.choices.actions[number]:
                return
            if action == "leave" and not await _agreed(_warning(track), "Show this face", "Keep it hidden"):
                toggle.value = self.choices.actions[number]
                return
            self.choices.actions[number] = action
            self._keep()
            changed()
            self._begin.refresh()

        able = {k: word for k, word in ACTIONS.items() if k != "swap" or track["can_swap"]}
        toggle = ui.toggle(able, value=self.choices.actions[number], on_change=choose)
        toggle.props(f'role="group" aria-label="What is done with track {number}"')

    def _line(self, track: dict[str, Any]) -> str:
        return _timeline(track, self.frames, self.choices.actions[str(track["track"])])

    def _settings(self) -> None:
        with ui.card().classes("w-full"):
            ui.label("How").classes("text-h6")
            for words, name, values in (("Covers", "cover", COVERS), ("Sound", "audio", SOUNDS)):
                with ui.row().classes("items-center"):
                    ui.label(words).classes("w-24")
                    toggle = ui.toggle(values, on_change=self._keep).bind_value(self.choices, name)
                    toggle.props(f'role="group" aria-label="{words}"')
            with ui.row().classes("items-center w-full no-wrap"):
                ui.label("Expression").classes("w-24")
                slider = ui.slider(min=0, max=1, step=0.1, on_change=self._keep).bind_value(
                    self.choices, "alpha"
                )
                slider.props('label aria-label="Share of the expression that the donor never made"')
            ui.label("0: only what the donor's own face can do; 1: all of it.").classes("opacity-70")

    @ui.refreshable_method
    def _begin(self) -> None:
        left = list(self.choices.actions.values()).count("leave")
        if left:
            words = f"{left} track{'s' * (left > 1)} will show the real face, for all to recognise."
            ui.label(words).classes("text-negative text-bold").props('role="status"')
        ui.button("Render", icon="movie", on_click=lambda: self.case.render(self.choices))


def _about(track: dict[str, Any]) -> str:
    first, last = map(clock, track["seconds"])
    return f"{first} to {last}, seen in {track['seen']:,} frames, {track['width']:.0f} pixels wide"


def _warning(track: dict[str, Any]) -> str:
    return (
        f"The face of track {track['track']} will be shown as it is in {track['seen']:,} frames, for all to recognise. "
        "Do this only when the person has agreed."
    )


def _timeline(track: dict[str, Any], frames: int, action: str) -> Html:
    """When a track is seen in the video, and how sure Guise is of it; as SVG."""
    first, last = track["frames"]
    curve, colour = track["confidence"], f"rgb{COLOURS[action]}"
    x0, step = 1000 * first / frames, 1000 * (last + 1 - first) / frames / len(curve)
    tops = "".join(f"V{38 - 34 * c:.1f}h{step:.2f}" for c in curve)
    words = (
        f"Track {track['track']} in the video: {_about(track)}; mean confidence {sum(curve) / len(curve):.2f}"
    )
    return tag(
        "svg",
        tag("title", words),
        tag("rect", width=1000, height=40, fill="currentColor", fill_opacity=0.08),
        tag("path", d=f"M{x0:.1f} 38{tops}V38Z", fill=colour, fill_opacity=0.75),
        tag("rect", x=f"{x0:.1f}", y=38, width=f"{step * len(curve):.1f}", height=2, fill=colour),
        viewBox="0 0 1000 40", preserveAspectRatio="none", role="img",
        style="width: 100%; height: 2.5rem; display: block",
    )  # fmt: skip


# -- donors ---------------------------------------------------------------------------------------------------


async def _pick(faces: dict[str, str]) -> str | None:
    """The spec of the face that the user picks; None for no change."""
    with ui.dialog() as dialog, ui.card().classes("w-full"):
        ui.label("Whose face is shown").classes("text-h6")
        with ui.row().classes("w-full justify-center"):
            for spec, name in faces.items():
                await _choice(spec, name, dialog)
    dialog.open()
    picked: str | None = await dialog
    dialog.delete()
    return picked


async def _choice(spec: str, name: str, dialog: ui.dialog) -> None:
    with ui.button(on_click=lambda: dialog.submit(spec)).props("flat no-caps").classes("w-32"), ui.column():
        if spec:
            ui.image(await asyncio.to_thread(_portrait, spec)).classes("w-24 h-24").props('alt=""')
        else:
            ui.icon("casino", size="6rem")
        ui.label(name).classes("w-24 truncate")


@lru_cache(maxsize=64)
def _portrait(spec: str) -> str:
    """The neutral face of a donor, as a data URI."""
    look = open_donor(spec).appearance
    data = encode_image(draw(look, look.neutral, face=96), None, ".jpg", {})
    return f"data:image/jpeg;base64,{base64.b64encode(data).decode()}"
