"""The first page: consent at the first visit, then what can be done, and sample clips to try it with."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from guise.app.studio import deidentify, swap
from guise.app.studio.site import Studio, heading, page
from guise.app.studio.videos import sample_clip

AGREED = "consent"  # the setting
CONSENT = (
    "Guise changes faces in your own videos and in front of your own camera. Pictures, clips and models of faces stay "
    "in a folder on this computer that only you can read; nothing is sent anywhere, and you can delete all of it here.",
    "Show and change faces only of people who agreed to it, and say of what you make that it was made: its files are "
    "marked as synthetic. The built-in faces are of people who do not exist.",
)
CHOICES = (
    ("Live", "/live", "videocam", "Another face in front of your camera, in this window."),
    ("Swap a video", swap.PATH, "movie", "Other faces for the people in a video."),
    ("De-identify", deidentify.PATH, "visibility_off", "Hide who is in a video and keep their expressions."),
)


def register(studio: Studio) -> None:
    """Add the page /."""
    page(studio, "/", "Start", lambda: _start(studio))


def _start(studio: Studio) -> None:
    @ui.refreshable
    def content() -> None:
        if studio.store.setting(AGREED):
            _choices(studio)
        else:
            _consent(agree)

    def agree() -> None:
        studio.store.remember(AGREED, True)
        content.refresh()

    content()


def _consent(agree: Callable[[], None]) -> None:
    with ui.card().classes("w-full max-w-2xl"):
        heading("Before you begin").classes(remove="mt-4")
        for sentence in CONSENT:
            ui.label(sentence)
        ui.button("I agree", icon="check", on_click=agree)


def _choices(studio: Studio) -> None:
    with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-3"):
        for name, path, icon, words in CHOICES:
            with (
                ui.link(target=path).classes("choice w-full"),
                ui.card().classes("w-full h-full items-center"),
            ):
                ui.icon(icon, size="4rem").props('aria-hidden="true"')
                ui.label(name).classes("text-h6")
                ui.label(words).classes("text-center")
    heading("No video at hand?")
    with ui.row():
        ui.button(
            "Swap a sample clip", icon="movie", on_click=lambda: swap.begin(studio, sample_clip(studio))
        )
        hide = ui.button(
            "De-identify a sample clip", icon="visibility_off",
            on_click=lambda: deidentify.begin(studio, sample_clip(studio)),
        )  # fmt: skip
        hide.props("outline")
