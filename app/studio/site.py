"""What the studio's pages share: layout, job progress, addresses of files and the faces to choose from."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import Client, ui
from nicegui import app as nicegui_app
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from guise.app.people import kept
from guise.app.studio.consent import AGREED, ask
from guise.app.studio.jobs import JobQueue
from guise.app.studio.progress_row import ProgressRow
from guise.app.studio.store import FOLDERS, JobRow, MissingError, Store, StudioError, preview_of
from guise.app.swapping.donors import FIRST_NAMES, gallery
from guise.common.errors import GuiseError
from guise.common.failures import explain

LINKS = {
    "Live": "/live",
    "Swap": "/swap",
    "People": "/people",
    "Landmarks": "/landmarks",
    "De-identify": "/deidentify",
    "Analogy": "/analogy",
    "Rig": "/rig",
}
FILE_PATHS = ("/files/", "/static/", "/gallery/", "/portraits/", "/montages/", "/_nicegui")  # of no pages
JOB_POLL_SECONDS = 0.3
STATIC = Path(__file__).parent / "static"
_PRIMARY_COLOUR = "#0b7a70"  # legible below white text and on both backgrounds
_CAMERA_ERRORS = {
    "NotAllowedError": "The browser isn't allowed to use the camera: allow it next to the address bar and try again.",
    "NotFoundError": "The browser found no camera: connect one and try again.",
    "NotReadableError": "Another program is using the camera: close it and try again.",
    "NotSupportedError": "This browser is too old to send pictures: update it, or use guise live in a terminal.",
    "NetworkError": "The connection to the studio was refused: reload the page.",
}
Build = Callable[..., Awaitable[None] | None]


@dataclass(frozen=True)
class Studio:
    """What every page needs.   limit : largest upload, bytes."""

    store: Store
    jobs: JobQueue
    limit: int

    def url(self, path: Path) -> str:
        """Address of a file in the studio's folder, or of a model, for pictures, videos and downloads."""
        if path.parent == kept.folder():
            return f"/files/people/{path.name}"
        return "/files/" + quote(path.relative_to(self.store.folder).as_posix())

    def faces(self) -> dict[str, str]:
        """Donors: spec for `guise.app.swapping.donors.open_donor` -> name; the user's own people come first."""
        own = {str(person.path): person.name for person in self.store.people()}
        return own | {id: f"{name} (fictional)" for id, name in FIRST_NAMES.items()}

    def portrait(self, face: str) -> str:
        """Address of the portrait of one of `faces`, or of a photo."""
        if (path := Path(face)).is_relative_to(self.store.folder / "jobs"):  # a photo, added for one video
            return self.url(preview_of(path))
        return f"/gallery/{face}.png" if face in gallery() else f"/portraits/{Path(face).stem}.png"


def serve_files(studio: Studio) -> None:
    """Serve scripts and styles, and the studio's folders except for the database."""
    nicegui_app.add_static_files("/static", STATIC)
    for name in FOLDERS:
        nicegui_app.add_static_files(f"/files/{name}", studio.store.folder / name, max_cache_age=0)
    nicegui_app.add_static_files("/files/people", kept.folder(), max_cache_age=0)


def serve_missing(studio: Studio) -> None:
    """Answer what is at no address with a page of status 404."""

    async def missing(request: Request, error: Exception) -> Response:
        if request.scope["path"].startswith(FILE_PATHS):
            return PlainTextResponse("There is no such file.", 404)
        with Client(ui.page(""), request=request) as client, _layout(studio, "There is no such page", "/"):
            ui.link("Go to the start", "/")
        return client.build_response(request, 404)

    nicegui_app.add_exception_handler(404, missing)


def script(name: str) -> None:
    """Load one of the studio's scripts in the page."""
    ui.add_head_html(f'<script src="/static/{name}"></script>')


def page(
    studio: Studio, path: str, title: str, build: Build, *, reconnect_seconds: float | None = None
) -> None:
    """Register a page; `build` fills it and gets the parameters of the path ("/landmarks/{clip}") by name.

    reconnect_seconds : for which a visitor's page is kept without a connection; default: the server's.
    A MissingError makes it a page of status 404.  Until the user has agreed, it asks for consent instead.
    """

    def agree() -> None:
        studio.store.remember(AGREED, True)
        ui.navigate.reload()

    async def shown(request: Request) -> Response | None:
        ui.on_exception(show_error)
        with _layout(studio, title, path):
            if not studio.store.setting(AGREED):
                ask(agree)
                return None
            try:
                done = build(**request.path_params)
                if done is not None:
                    await done
            except GuiseError as error:
                ui.label(sentence(explain(error)[0]))
                if isinstance(error, MissingError):
                    return ui.context.client.build_response(request, 404)
        return None

    ui.page(path, title=f"{title} · Guise", reconnect_timeout=reconnect_seconds)(shown)


def show_job(studio: Studio, id: str, ended: Callable[[JobRow], Any]) -> None:
    """A progress bar for a job, with a button that cancels it; `ended` is called once, with the job's last state."""

    def poll() -> None:
        try:
            job = studio.store.job(id)
        except StudioError:  # removed in another tab
            timer.cancel()
            return
        stage = "waiting for other jobs" if job.state == "waiting" else job.stage or "starting"
        row.show(stage[:1].upper() + stage[1:], job.share)
        if job.ended:
            timer.cancel()
            ended(job)

    row = ProgressRow(lambda: studio.jobs.cancel(id))
    timer = ui.timer(JOB_POLL_SECONDS, poll)


def heading(text: str, level: int = 2) -> ui.label:
    """A heading that screen readers recognise."""
    classes = "text-h5 mb-4" if level == 1 else "text-h6 mt-4"
    return ui.label(text).props(f"role=heading aria-level={level}").classes(classes)


def choice_row(label: str, options: Mapping[Any, str], value: Any) -> ui.toggle:
    """A labelled row of buttons, one of which is chosen."""
    with ui.row().classes("items-center"):
        ui.label(label).classes("w-24")
        toggle = ui.toggle(dict(options), value=value)
    return toggle.props(f'no-caps role="group" aria-label="{label}"')


def advanced() -> ui.expansion:
    """Choices that few people need, folded away; filled by `with`."""
    return ui.expansion("Options and presets", icon="tune").classes("w-full")


def empty_state(icon: str, headline: str, words: str) -> ui.element:
    """What is shown where there is nothing yet, or nobody was found; more can be put inside by `with`."""
    with ui.column().classes("empty w-full items-center gap-1") as box:
        ui.icon(icon, size="3rem").props('aria-hidden="true"').classes("opacity-70")
        ui.label(headline).classes("text-h6 text-center")
        ui.label(words).classes("text-center")
    return box


@contextmanager
def _layout(studio: Studio, title: str, path: str) -> Iterator[None]:
    """The header with links and the choice of colours; the page's own content goes inside."""
    ui.colors(primary=_PRIMARY_COLOUR)
    ui.add_head_html('<link rel="stylesheet" href="/static/studio.css">')
    script("drops.js")
    ui.button.default_props("no-caps")
    with ui.header().classes("bar"):
        ui.link("Skip to content", "#content").classes("sr-only focus:not-sr-only")
        with ui.link(target="/").classes("home flex items-center gap-2 text-bold"):
            ui.element("img").props('src="/static/favicon.svg" alt=""').classes("w-8 h-8")
            ui.label("Guise")
        with ui.element("nav").props('aria-label="Pages"').classes("pages flex items-center grow gap-x-4"):
            for name, target in LINKS.items():
                here = 'aria-current="page"' if target == "/" + path.split("/")[1] else ""
                ui.link(name, target).props(here)
        _colour_choice(studio)
    # within the layout's own <main>
    with ui.element("div").props('id="content" tabindex="-1"').classes("content w-full mx-auto"):
        heading(title, 1).classes("sr-only" if path == "/" else "")
        yield


def _colour_choice(studio: Studio) -> None:
    """Dark or light, following the system or the user's choice, which is remembered."""
    dark = ui.dark_mode(studio.store.setting("dark"))

    def choose(value: bool | None) -> None:
        dark.value = value
        studio.store.remember("dark", value)

    with (
        ui.button(icon="contrast", color=None).props('flat round aria-label="Colours"'),
        ui.menu().classes("text-no-wrap"),
    ):
        for name, value in (("System", None), ("Light", False), ("Dark", True)):
            ui.menu_item(name, partial(choose, value)).props("role=menuitem")


def local_time(created: str) -> str:
    """A time of the store as the clock of this computer shows it."""
    return f"{datetime.fromisoformat(created).astimezone():%Y-%m-%d %H:%M}"


def camera_error(name: str) -> str:
    """What to do about an error of the browser's camera, by the error's JavaScript name."""
    return _CAMERA_ERRORS.get(name, f"The camera cannot be used ({name}).")


def sentence(text: str) -> str:
    """What went wrong, as a sentence.

    >>> sentence("no face found: use another clip")
    'No face found: use another clip.'
    """
    return text[:1].upper() + text[1:] + "." * (text[-1:] not in ".!?")


def show_error(error: Exception) -> None:
    """Show what went wrong in a notification."""
    ui.notify(sentence(explain(error)[0]), type="negative", multi_line=True)
