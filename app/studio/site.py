"""What the studio's pages share: layout, uploads, progress of jobs, files to show and the faces to choose from."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import app as nicegui_app
from nicegui import events, run, ui
from starlette.requests import Request

from app.deidentify.inputs import VIDEO_SUFFIXES
from app.donors import gallery
from app.failures import explain, user_mistakes
from app.media import open_source
from app.studio.guard import too_large
from app.studio.jobs import Jobs
from app.studio.store import Clip, JobRow, Store

LINKS = {"Live": "/", "People": "/people", "Landmarks": "/landmarks", "De-identify": "/deidentify"}
REFRESH = 0.3  # seconds between two looks at a job
Build = Callable[..., Awaitable[None] | None]


@dataclass(frozen=True)
class StudioOptions:
    """limit : bytes of an upload."""

    limit: int


@dataclass(frozen=True)
class Studio:
    """What a page works with."""

    store: Store
    jobs: Jobs
    options: StudioOptions

    def url(self, path: Path) -> str:
        """The address of a file in the studio's folder, for pictures, videos and downloads."""
        return "/files/" + quote(path.relative_to(self.store.folder).as_posix())

    def faces(self) -> dict[str, str]:
        """Who can be shown: spec for `app.donors.open_donor` -> name; own people first, then the gallery."""
        own = {str(person.path): person.name for person in self.store.people()}
        return own | {name: f"{name} (fictional)" for name in gallery()}


def serve_files(studio: Studio) -> None:
    """Let the pages show what lies in the studio's folder; the base is not among it."""
    for name in ("clips", "people", "jobs"):
        nicegui_app.add_static_files(f"/files/{name}", studio.store.folder / name, max_cache_age=0)


def page(studio: Studio, path: str, title: str, build: Build) -> None:
    """Register a page; `build` fills it and gets the parameters of the path ("/landmarks/{clip}") by name."""

    async def shown(request: Request) -> None:
        with _layout(studio, title, path), told():
            done = build(**request.path_params)
            if done is not None:
                await done

    ui.page(path, title=f"{title} · Guise")(shown)


@contextmanager
def told() -> Iterator[None]:
    """Say a user's mistake as a notification."""
    try:
        yield
    except user_mistakes() as error:
        ui.notify(explain(error)[0], type="negative", multi_line=True)


async def read_upload(studio: Studio, event: events.UploadEventArguments) -> Clip:
    """The clip of an upload, which is on the disk by now.

    Raises StudioError or MediaError when it is no video; nothing of it is kept then.
    """
    clip = studio.store.add_clip(Path(event.file.name).stem, Path(event.file.name).suffix)
    part = clip.path.with_suffix(clip.path.suffix + ".part")
    try:
        await event.file.save(part)
        await run.io_bound(_require_video, part)
        part.replace(clip.path)
    except BaseException:
        part.unlink(missing_ok=True)
        studio.store.remove_clip(clip.id)
        raise
    return clip


def uploader(studio: Studio, label: str, done: Callable[[Clip], Awaitable[None] | None]) -> ui.upload:
    """A field that uploads a video as soon as it is chosen, and says why when it cannot be taken."""

    async def uploaded(event: events.UploadEventArguments) -> None:
        field.reset()
        with told():
            then = done(await read_upload(studio, event))
            if then is not None:
                await then

    def refused() -> None:
        ui.notify(too_large(studio.options.limit), type="negative", multi_line=True)

    limit = studio.options.limit
    field = ui.upload(
        label=label, auto_upload=True, max_file_size=limit, on_upload=uploaded, on_rejected=refused
    )
    accepted = ",".join(("video/*", *sorted(VIDEO_SUFFIXES)))
    field.props(f'accept="{accepted}"').on("failed", refused)
    return field.props("flat bordered").classes("w-full")


def show_job(studio: Studio, id: str, ended: Callable[[JobRow], Any]) -> None:
    """A bar that follows a job, with a button that cancels it; `ended` is called once, with the last state."""

    def look() -> None:
        job = studio.store.job(id)
        bar.value = job.share
        stage.text = "waiting for other work" if job.state == "waiting" else f"{job.stage or 'starting'} …"
        if job.ended:
            timer.cancel()
            ended(job)

    with ui.row().classes("w-full items-center no-wrap"):
        stage = ui.label().classes("w-40").props('role="status"')
        bar = ui.linear_progress(show_value=False).props('aria-label="Progress" rounded')
        ui.button(icon="close", on_click=lambda: studio.jobs.cancel(id)).props(
            'flat round aria-label="Cancel"'
        )
    timer = ui.timer(REFRESH, look)


def _require_video(path: Path) -> None:
    with open_source(path):
        pass


@contextmanager
def _layout(studio: Studio, title: str, path: str) -> Iterator[None]:
    with ui.header(), ui.row():
        for name, target in LINKS.items():
            ui.link(name, target).classes("text-white")
    with ui.column().classes("w-full max-w-5xl mx-auto"):
        ui.label(title).classes("text-h5")
        yield
