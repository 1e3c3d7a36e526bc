"""The first page: consent at the first visit, then what can be done, and sample clips to try it with."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

from guise.app.studio import deidentify, swap
from guise.app.studio.site import Studio, heading, page
from guise.app.studio.videos import sample_clip

AGREED = "consent"  # the setting
CONSENT = (
    "Guise changes faces in your own videos and photos, and in front of your own camera. Everything stays in a folder "
    "on this computer that only you can read. Nothing is sent anywhere, and you can delete all of it here.",
    "Change and show faces only of people who agreed, and tell people it is synthetic: files made here are marked as "
    "such. The built-in faces belong to nobody.",
)
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
SAMPLE_WORDS = "Left: the clip. Right: the same clip with other faces. These people do not exist."


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

    with ui.element("div").classes("desk"):
        _moving_sample()
        with ui.column().classes("w-full"):
            content()


def _moving_sample() -> None:
    """What Guise does, in a few seconds; it rests for those who want less motion."""
    with ui.column().classes("picture w-full gap-2"):
        video = ui.element("video").props("muted loop playsinline controls").classes("full")
        video.props["src"], video.props["aria-label"] = "/static/sample.mp4", "A clip before and after a swap"
        still = "(prefers-reduced-motion: reduce)"
        video.on("loadeddata", js_handler=f"(e) => matchMedia('{still}').matches || e.target.play()")
        ui.label(SAMPLE_WORDS).classes("opacity-70")


def _consent(agree: Callable[[], None]) -> None:
    with ui.card().classes("w-full"):
        heading("Before you begin").classes(remove="mt-4")
        for sentence in CONSENT:
            ui.label(sentence)
        ui.button("I agree", icon="check", on_click=agree)


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
