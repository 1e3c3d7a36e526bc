"""The editor of a reviewed video: what is done with each track, with donors, covers and sound."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Awaitable, Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from guise.app.deidentify.reach import reach_of
from guise.app.deidentify.report.quality import track_quality
from guise.app.deidentify.report.report import clock
from guise.app.deidentify.report.sheet import ACTION_COLOURS
from guise.app.deidentify.report.timeline import confidence_svg
from guise.app.media import open_input
from guise.app.studio.cover_editor import CoverEditor
from guise.app.studio.deidentify_jobs import (
    DeidentifyChoices,
    preview,
    read_tracks,
    split,
    thumbnail,
    write_edited,
)
from guise.app.studio.dialogs import confirm, submitted
from guise.app.studio.portraits import Portraits
from guise.app.studio.site import Studio, choice_row, empty_state
from guise.app.studio.store import JobRow, Upload
from guise.app.studio.uploads import PICTURE, uploader
from guise.app.studio.videos import PREVIEW_WIDTH_PIXELS, FrameComparison, title
from guise.app.swapping.cover import IMAGE_PREFIX, STRENGTHS
from guise.common.arrays import U8
from guise.common.text import counted

TRACKS_PER_PAGE = 20
ANY_DONOR = "any fictional person"
ACTIONS = {"swap": "Swap", "cover": "Cover", "leave": "Leave"}
COVERS = {"solid": "Solid", "mosaic": "Mosaic", "blur": "Blur", "emoji": "Smiley"}
SOUNDS = {"keep": "Keep", "drop": "Drop", "mask": "Lower voices", "disguise": "Whisper"}
REGIONS = {"face": "Face", "head": "Head"}
HINT = "Each bar shows when a face is seen; the higher it is, the more certain the face."
NOBODY = (
    "Nobody is seen in this clip",
    "Watch it all the same, as a detector can miss a face. Draw a box over what must be covered.",
)
COVERED_ONLY = (
    "Nobody is seen long enough to be followed",
    "What may be a face is covered, and listed below.",
)


class TrackEditor:
    """The tracks of a video and what to do with each; every change is saved.

    job : the review.   render : called with the choices when the user starts the rendering.
    """

    def __init__(self, studio: Studio, job: JobRow, render: Callable[[DeidentifyChoices], None]) -> None:
        self._studio, self._job, self._render = studio, job, render
        self._folder = studio.store.folder_of(job.id)
        value = read_tracks(self._folder)
        self._frames: int = value["frames"]
        self._tracks: list[dict[str, Any]] = value["tracks"]
        self._faces = {"": ANY_DONOR} | studio.faces()
        self._choices = self._load()
        self._page = 1
        self._frame: FrameComparison | None = None
        with open_input(Path(job.about["source"])) as media:
            size = media.width, media.height
        covers = [cover for cover in value.get("covers", []) if not cover["track"]]
        self.covers = CoverEditor(
            studio, self._folder, covers, self._choices, size=size, last=self._frames - 1, frame=self._shown,
            saved=self._save,
        )  # fmt: skip

    def build(self) -> None:
        """The frame, and beside it tracks, settings, and the button that starts the rendering."""
        with ui.element("div").classes("desk"):
            with ui.column().classes("picture w-full"):
                self._frame = FrameComparison(self._draw, self._frames - 1, self._first(), self.covers.drawn)
                self.covers.build_boxes()
            with ui.column().classes("w-full"):
                self._faces_found()
                self._settings()
                with ui.column().classes("act w-full gap-1"):
                    self._exposed()
                    render = ui.button("Render", icon="movie", on_click=lambda: self._render(self._choices))
                    render.classes("w-full")

    def _faces_found(self) -> None:
        """The tracks, and what may be a face besides."""
        if self._tracks and self._frames > 1:
            ui.label(HINT).classes("opacity-70")
        elif not self._tracks:
            empty_state("person_off", *(COVERED_ONLY if self.covers.covers else NOBODY))
        self._people()
        pages = -(-len(self._tracks) // TRACKS_PER_PAGE)
        if pages > 1:
            ui.pagination(1, pages, direction_links=True, on_change=lambda event: self._turn(event.value))
        self.covers.build_covers()

    def _load(self) -> DeidentifyChoices:
        """The saved choices, or the proposed ones; a donor who no longer exists becomes any."""
        choices = DeidentifyChoices.load(self._folder)
        choices.donors = {k: spec if spec in self._faces else "" for k, spec in choices.donors.items()}
        return choices

    def _shown(self) -> int:
        """The frame that is shown."""
        return self._frame.frame if self._frame is not None else 0

    async def _save(self) -> None:
        """Save the choices, also for the command line if the review began there, and draw the frame anew."""
        self._choices.save(self._folder)
        if tracks := self._job.about.get("tracks"):
            write_edited(self._folder, self._choices, Path(tracks))
        self._exposed.refresh()
        if self._frame is not None:
            await self._frame.update()

    def _draw(self, frame: int) -> tuple[U8, U8]:
        source, output = Path(self._job.about["source"]), self._job.result["output"]
        return preview(source, self._folder, self._choices, output, frame, PREVIEW_WIDTH_PIXELS)

    def _first(self) -> int:
        """A frame to show first: in the middle of the longest track, or the clearest one of the first cover."""
        shown = next(([cover["shown"]] * 2 for cover in self.covers.covers), [0, 0])
        longest = max(self._tracks, key=lambda track: track["seen"], default={"frames": shown})
        return int(sum(longest["frames"]) // 2)

    def _turn(self, page: int) -> None:
        self._page = page
        self._people.refresh()

    @ui.refreshable_method
    def _people(self) -> None:
        people: dict[int, list[dict[str, Any]]] = {}
        for track in self._tracks[(self._page - 1) * TRACKS_PER_PAGE : self._page * TRACKS_PER_PAGE]:
            people.setdefault(self._choices.person_of(track), []).append(track)
        for person, tracks in people.items():
            with ui.card().classes("w-full"):
                with ui.row().classes("w-full items-center"):
                    title(f"Person {person}").classes("grow")
                    self._name(str(person))
                    if any(track["can_swap"] for track in tracks):
                        donor = self._choices.donors.setdefault(str(person), "")
                        _DonorButton(
                            self._studio, self._faces, donor, partial(self._choose_donor, str(person))
                        )
                for track in tracks:
                    self._track(track)

    def _name(self, person: str) -> None:
        """What the user calls a person; it is in no report."""
        field = ui.input("Name", value=self._choices.names.get(person, "")).props("dense outlined")
        field.props["aria-label"] = f"Name of person {person}"

        def keep() -> None:
            self._choices.names[person] = field.value
            self._choices.save(self._folder)

        field.on("blur", keep)

    async def _choose_donor(self, person: str, spec: str) -> None:
        self._choices.donors[person] = spec
        await self._save()

    def _track(self, track: dict[str, Any]) -> None:
        number = str(track["track"])
        ui.separator()
        with ui.row().classes("w-full items-center"):
            with ui.column().classes("gap-0 grow basis-60"):
                title(f"Track {number}", 3)
                seen = _about(track) if self._frames > 1 else f"{track['width']:.0f} pixels wide"
                ui.label(seen).classes("opacity-70")
                ui.label(f"Quality: {track_quality(track['width'], track['confidence'])}.")
                if track["reason"]:
                    ui.label(f"Guise proposes to cover it: {track['reason']}.")
            self._action(track, lambda: line.set_content(self._line(track)))
        origin, (first, last) = track.get("part_of", track["track"]), track["frames"]
        with ui.row().classes("gap-1"):
            for place, frame in enumerate(self._job.result["pictures"][str(origin)]):
                if first <= frame <= last:
                    picture = ui.image(self._studio.url(self._folder / thumbnail(origin, place)))
                    picture.classes("w-20 h-20 rounded").props(f'alt="Track {number}, picture {place + 1}"')
        with ui.column().classes("w-full gap-0") as when:
            when.set_visibility(self._frames > 1)
            line = ui.html(self._line(track), sanitize=False).classes("w-full")
            with ui.row().classes("w-full justify-between text-caption opacity-70"):
                ui.label(clock(0))
                ui.label(clock(self._job.result["seconds"]))
        self._edits(track)

    def _edits(self, track: dict[str, Any]) -> None:
        """Split the track, or say that it is of another one's person."""
        number = track["track"]
        with ui.row().classes("items-center"):
            cut = ui.button("Split at the frame shown", icon="content_cut", color=None)
            cut.set_visibility(self._frames > 1)
            cut.on_click(partial(self._split, number)).props("flat dense")
            cut.props["aria-label"] = f"Split track {number} at the frame that is shown"
            own = self._choices.person_of(track)
            people = {self._choices.person_of(one) for one in self._tracks} | {number}
            if len(people) > 1:
                words = {person: f"Person {person}" for person in sorted(people)}
                who = ui.select(words, value=own, label=f"Track {number} is")
                who.on_value_change(partial(self._merge, number)).props("dense outlined").classes("w-32")

    async def _split(self, number: int) -> None:
        output, frame = self._job.result["output"], self._shown()
        self._choices = await asyncio.to_thread(split, self._folder, output, self._choices, number, frame)
        self.covers.choices = self._choices
        self._tracks = read_tracks(self._folder)["tracks"]
        self._people.refresh()

    async def _merge(self, number: int, event: Any) -> None:
        self._choices.people[str(number)] = event.value
        self._choices.donors.setdefault(str(event.value), "")
        await self._save()
        self._people.refresh()

    def _action(self, track: dict[str, Any], changed: Callable[[], Any]) -> None:
        actions, number = self._choices.actions, str(track["track"])

        async def choose() -> None:
            action = toggle.value
            if action == actions[number]:
                return
            if action == "leave" and not await confirm(_warning(track), "Show this face", "Keep it hidden"):
                toggle.value = actions[number]
                return
            actions[number] = action
            changed()
            await self._save()

        possible = {k: word for k, word in ACTIONS.items() if k != "swap" or track["can_swap"]}
        toggle = ui.toggle(possible, value=actions[number], on_change=choose)
        toggle.props(f'no-caps role="group" aria-label="What is done with track {number}"')

    def _line(self, track: dict[str, Any]) -> str:
        return timeline(track, self._frames, self._choices.actions[str(track["track"])])

    def _settings(self) -> None:
        with ui.card().classes("w-full"):
            self._cover = self._setting("Covers", "cover", COVERS)
            with ui.row().classes("items-center"):
                uploader(self._studio, "Cover with a picture", self._cover_with, (PICTURE,))
                self._picture()
            strengths = {one: str(one) for one in STRENGTHS}
            self._setting("Strength", "cover_strength", strengths)
            ui.label("For mosaic and blur: 1 leaves six cells across a face, 5 leaves two.").classes(
                "opacity-70"
            )
            if self._frames > 1:
                self._setting("Sound", "audio", SOUNDS)
            region = self._setting("Replaced", "region", REGIONS)
            ui.label().classes("opacity-70").bind_text_from(region, "value", _told)
            with ui.row().classes("items-center w-full no-wrap pr-4"):
                ui.label("Strength of expression").classes("w-48")
                slider = ui.slider(min=0, max=1, step=0.1, value=self._choices.alpha)
                slider.on_value_change(lambda event: self._set("alpha", event.value))
                slider.props('label aria-label="Strength of expression"')
            ui.label("0 keeps to the donor's own range, 1 lets all of the expression through.").classes(
                "opacity-70"
            )

    async def _cover_with(self, upload: Upload) -> None:
        """Keep an uploaded picture with the video, and cover faces with it."""
        path = self._folder / f"cover.{upload.path.name}"
        shutil.copyfile(upload.path, path)
        self._studio.store.remove_upload(upload.id)
        self._cover.value = None
        await self._set("cover", f"{IMAGE_PREFIX}{path}")

    @ui.refreshable_method
    def _picture(self) -> None:
        """The picture that covers faces, if one does."""
        path = Path(self._choices.cover.removeprefix(IMAGE_PREFIX))
        if path.parent == self._folder:
            picture = ui.image(self._studio.url(path)).classes("w-20 h-20")
            picture.props('fit=contain alt="What covers faces"')

    def _setting(self, label: str, name: str, options: Mapping[Any, str]) -> ui.toggle:
        value = getattr(self._choices, name)
        toggle = choice_row(label, options, value if value in options else None)
        toggle.on_value_change(lambda event: None if event.value is None else self._set(name, event.value))
        return toggle

    async def _set(self, name: str, value: Any) -> None:
        setattr(self._choices, name, value)
        self._picture.refresh()
        await self._save()

    @ui.refreshable_method
    def _exposed(self) -> None:
        """How many real faces will be shown, if any."""
        if left := list(self._choices.actions.values()).count("leave"):
            words = (
                "1 track will show the real face" if left == 1 else f"{left} tracks will show the real faces"
            )
            ui.label(f"{words}, recognisable to anyone.").classes("text-negative text-bold").props(
                'role="status"'
            )
        said = [*self._choices.covers.values(), *(box["action"] for box in self._choices.boxes)]
        if things := said.count("leave"):
            words = f"{counted(things, 'place')} stay as they are" if things > 1 else "1 place stays as it is"
            ui.label(f"{words}, as you said that there is no face.").classes("text-bold").props(
                'role="status"'
            )


def _told(region: str) -> str:
    """What a choice of the region hides."""
    proposal = " If hair or outline give somebody away, choose Head." if region == "face" else ""
    return f"In our benchmark {reach_of(region)}.{proposal}"


def timeline(track: dict[str, Any], frames: int, action: str) -> str:
    """When a track is seen in a video of so many frames, with its confidence; as SVG in the action's colour."""
    first, last = track["frames"]
    curve = track["confidence"]
    title = f"Track {track['track']}: {_about(track)}; mean confidence {sum(curve) / len(curve):.2f}"
    return confidence_svg(curve, (first / frames, (last + 1) / frames), f"rgb{ACTION_COLOURS[action]}", title)


def _about(track: dict[str, Any]) -> str:
    first, last = map(clock, track["seconds"])
    return f"{first} to {last}, seen in {counted(track['seen'], 'frame')}, {track['width']:.0f} pixels wide"


def _warning(track: dict[str, Any]) -> str:
    return (
        f"The real face of track {track['track']} will be shown in {counted(track['seen'], 'frame')}, recognisable to "
        "anyone. Do this only with the person's consent."
    )


class _DonorButton:
    """A button that shows the donor and opens the choice of donors."""

    def __init__(
        self, studio: Studio, faces: dict[str, str], spec: str, chosen: Callable[[str], Awaitable[None]]
    ) -> None:
        self._studio, self._faces, self._spec, self._chosen = studio, faces, spec, chosen
        self._button = ui.button(color=None, on_click=self._choose).props("outline no-caps")
        self._show()

    def _show(self) -> None:
        self._button.clear()
        self._button.props["aria-label"] = f"Donor: {self._faces[self._spec]}"
        with self._button, ui.row().classes("items-center no-wrap gap-2"):
            if self._spec:
                picture = ui.image(self._studio.portrait(self._spec)).classes("w-8 h-8 rounded shrink-0")
                picture.props("no-spinner no-transition")
            ui.label(f"Donor: {self._faces[self._spec]}").classes("min-w-0 break-words")

    async def _choose(self) -> None:
        with ui.dialog() as dialog, ui.card().classes("w-full"):
            title(question := "Whose face is shown")
            Portraits(self._studio, self._faces, self._spec, question, dialog.submit, icon="casino")
        spec = await submitted(dialog)
        if spec is not None:
            self._spec = spec
            self._show()
            await self._chosen(spec)
