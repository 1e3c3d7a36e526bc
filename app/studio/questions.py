"""Questions that a page asks in a dialog."""

from __future__ import annotations

from typing import Any

from nicegui import ui


async def agreed(words: str, yes: str, no: str) -> bool:
    """Whether the user agrees to what words say; no when the dialog is closed without an answer."""
    with ui.context.client.content:  # what is drawn anew meanwhile does not take the question with it
        dialog = ui.dialog()
    with dialog, ui.card().props('role="alertdialog"'):
        ui.label(words)
        with ui.row().classes("w-full justify-end"):
            ui.button(no, color=None, on_click=lambda: dialog.submit(False)).props("flat autofocus")
            ui.button(yes, on_click=lambda: dialog.submit(True)).props("color=negative")
    return bool(await answer(dialog))


async def answer(dialog: ui.dialog) -> Any:
    """What is submitted; None when the dialog or the whole page is closed."""
    given = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return given
