"""The page People: clips, and the models that are learned from them."""

from __future__ import annotations

from nicegui import ui

from app.studio.site import Studio, page


def register(studio: Studio) -> None:
    """Add the page /people."""
    page(studio, "/people", "People", lambda: _build(studio))


def _build(studio: Studio) -> None:
    for person in studio.store.people():
        ui.label(person.name)
