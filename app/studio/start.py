"""The first page: what can be done, and sample clips to try it with."""

from __future__ import annotations

from nicegui import ui

from guise.app.studio import deidentify, swap
from guise.app.studio.consent import moving_sample
from guise.app.studio.site import Studio, page
from guise.app.studio.videos import sample_clip

CHOICES = (
    ("Live", "/live", "videocam", "Another face at your camera, while you speak."),
    ("Swap a video or photo", swap.PATH, "movie", "Another face for anyone in a video or photo."),
    (
        "De-identify",
        deidentify.PATH,
        "visibility_off",
        "Hide who is in a video or photo, but keep their expressions.",
    ),
)


def register(studio: Studio) -> None:
    """Add the page /."""
    page(studio, "/", "Start", lambda: _start(studio))


def _start(studio: Studio) -> None:
    with ui.element("div").classes("desk"):
        moving_sample()
        with ui.column().classes("w-full"):
            _choices(studio)


def _choices(studio: Studio) -> None:
    for name, path, icon, words in CHOICES:
        with (
            ui.link(target=path).classes("choice w-full"),
            ui.card().classes("w-full"),
            ui.row().classes("items-center no-wrap"),
        ):
            ui.icon(icon, size="3rem").props('aria-hidden="true"')
            with ui.column().classes("gap-0"):
                ui.label(name).classes("text-h6")
                ui.label(words)
    ui.label("Nothing at hand? Try a sample:")
    with ui.row().classes("gap-2"):
        for words, icon, begin in (
            ("Swap a clip", "movie", swap.begin),
            ("De-identify a clip", "visibility_off", deidentify.begin),
        ):
            button = ui.button(words, icon=icon)
            button.on_click(lambda begin=begin: begin(studio, sample_clip(studio))).props("outline")
