"""What the studio's pages share: layout, progress of jobs, files to show and the faces to choose from."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import quote

from nicegui import app as nicegui_app
from nicegui import ui
from starlette.requests import Request

from guise.app.studio.jobs import Jobs
from guise.app.studio.store import FOLDERS, JobRow, Store, StudioError
from guise.app.swapping.donors import gallery
from guise.common.errors import GuiseError
from guise.common.failures import explain

LINKS = {
    "Live": "/",
    "People": "/people",
    "Landmarks": "/landmarks",
    "De-identify": "/deidentify",
    "Analogy": "/analogy",
}
REFRESH = 0.3  # seconds between two looks at a job
_COLOUR = "#0b7a70"  # readable under white and on both backgrounds
_STYLE = """
:focus-visible { outline: 3px solid #f59e0b; outline-offset: 2px; }
.q-focusable:focus-visible { box-shadow: 0 0 0 3px #f59e0b !important; }
.bar { background: #fff; color: #000; border-bottom: 1px solid rgb(128 128 128 / 40%);
       align-items: center; flex-wrap: nowrap; }
.body--dark .bar { background: #1d1d1d; color: #fff; }
.body--dark .q-btn--outline, .body--dark .q-btn--flat { --q-primary: #5eead4; }
.body--dark main .nicegui-link { color: #7cc4ff; }
.bar a { color: inherit; text-decoration: none; padding: 0.25rem 0; border-bottom: 3px solid transparent; }
.bar a[aria-current] { border-color: var(--q-primary); font-weight: 600; }
"""
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
        """Who can be shown: spec for `guise.app.swapping.donors.open_donor` -> name; own people first, then
        the gallery."""
        own = {str(person.path): person.name for person in self.store.people()}
        return own | {name: f"{name} (fictional)" for name in gallery()}


def serve_files(studio: Studio) -> None:
    """Let the pages show what lies in the studio's folder; the base is not among it."""
    for name in FOLDERS:
        nicegui_app.add_static_files(f"/files/{name}", studio.store.folder / name, max_cache_age=0)


def page(studio: Studio, path: str, title: str, build: Build, *, patience: float | None = None) -> None:
    """Register a page; `build` fills it and gets the parameters of the path ("/landmarks/{clip}") by name.

    patience : seconds without a connection for which what a visitor did on the page is kept; default: a few.
    """

    async def shown(request: Request) -> None:
        ui.on_exception(tell)
        with _layout(studio, title, path):
            try:
                done = build(**request.path_params)
                if done is not None:
                    await done
            except GuiseError as error:
                ui.label(explain(error)[0])

    ui.page(path, title=f"{title} · Guise", reconnect_timeout=patience)(shown)


def show_job(studio: Studio, id: str, ended: Callable[[JobRow], Any]) -> None:
    """A bar that follows a job, with a button that cancels it; `ended` is called once, with the last state."""

    def look() -> None:
        try:
            job = studio.store.job(id)
        except StudioError:  # removed in another tab
            timer.cancel()
            return
        bar.value = job.share
        stage.text = "waiting for other work" if job.state == "waiting" else f"{job.stage or 'starting'} …"
        if job.ended:
            timer.cancel()
            ended(job)

    with ui.row().classes("w-full items-center no-wrap"):
        stage = ui.label().classes("w-40").props('role="status"')
        bar = ui.linear_progress(show_value=False).props('aria-label="Progress" rounded')
        cancel = ui.button(icon="close", color=None, on_click=lambda: studio.jobs.cancel(id))
        cancel.props('flat round aria-label="Cancel"')
    timer = ui.timer(REFRESH, look)


def heading(text: str, level: int = 2) -> ui.label:
    """A heading that screen readers know as one."""
    look = "text-h5 mb-4" if level == 1 else "text-h6 mt-4"
    return ui.label(text).props(f"role=heading aria-level={level}").classes(look)


@contextmanager
def _layout(studio: Studio, title: str, path: str) -> Iterator[None]:
    """The header with links and the choice of colours; what follows is the page's own."""
    ui.colors(primary=_COLOUR)
    ui.add_css(_STYLE)
    ui.button.default_props("no-caps")
    with ui.header().classes("bar"):
        ui.link("Skip to content", "#content").classes("sr-only focus:not-sr-only")
        with ui.element("nav").props('aria-label="Pages"').classes("flex items-center grow gap-x-4 gap-y-1"):
            ui.label("Guise").classes("max-sm:hidden text-bold mr-4")
            for name, target in LINKS.items():
                here = 'aria-current="page"' if target == "/" + path.split("/")[1] else ""
                ui.link(name, target).props(here)
        _colour_choice(studio)
    with ui.element("main").props('id="content" tabindex="-1"').classes("w-full max-w-5xl mx-auto"):
        heading(title, 1)
        yield


def _colour_choice(studio: Studio) -> None:
    """Dark or light, as the system has it or as the user wants it; kept for the next time."""
    dark = ui.dark_mode(studio.store.setting("dark"))

    def choose(value: bool | None) -> None:
        dark.value = value
        studio.store.remember("dark", value)

    with (
        ui.button(icon="contrast", color=None).props('flat round aria-label="Colours"'),
        ui.menu().classes("text-no-wrap"),
    ):
        for name, value in (("As the system", None), ("Light", False), ("Dark", True)):
            ui.menu_item(name, partial(choose, value)).props("role=menuitem")


def tell(error: Exception) -> None:
    """Show what went wrong, in a sentence that goes away."""
    ui.notify(explain(error)[0], type="negative", multi_line=True)
