"""What every page shows before the user has agreed: what Guise does and keeps, and what it may be used for."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui

AGREED = "consent"  # the setting
CONSENT = (
    "Guise changes faces in your own videos and photos, and at your own camera. Everything stays in a folder "
    "on this computer that only you can read, and you can delete all of it here. Nothing is sent anywhere, but for the "
    "numbers that the page Rig sends when you say so.",
    "Change and show only the faces of people who agreed, and tell people it is synthetic: files made here are marked "
    "as such. The built-in faces are of people who do not exist.",
)
SAMPLE_WORDS = "Left: the clip. Right: the same clip with other faces. These people do not exist."


def ask(agree: Callable[[], None]) -> None:
    """Ask for consent.   agree : called when it is given."""
    with ui.element("div").classes("desk"):
        moving_sample()
        with ui.card().classes("w-full"):
            ui.label("Before you begin").classes("text-h6").props("role=heading aria-level=2")
            for sentence in CONSENT:
                ui.label(sentence)
            ui.button("I agree", icon="check", on_click=agree)


def moving_sample() -> None:
    """What Guise does, in a few seconds; it rests for those who want less motion."""
    with ui.column().classes("picture w-full gap-2"):
        video = ui.element("video").props("muted loop playsinline controls").classes("full")
        video.props["src"], video.props["aria-label"] = "/static/sample.mp4", "A clip before and after a swap"
        still = "(prefers-reduced-motion: reduce)"
        video.on("loadeddata", js_handler=f"(e) => matchMedia('{still}').matches || e.target.play()")
        ui.label(SAMPLE_WORDS).classes("opacity-70")
