"""Dialogs in which a page asks the user."""

from __future__ import annotations

from typing import Any

from nicegui import ui


async def confirm(question: str, yes: str, no: str, colour: str = "negative") -> bool:
    """Whether the user agrees; a dialog closed without an answer counts as no.   colour : of yes."""
    with ui.context.client.content:  # outside of what may be redrawn meanwhile, which would delete the dialog
        dialog = ui.dialog()
    with dialog, ui.card().props('role="alertdialog"'):
        ui.label(question)
        with ui.row().classes("w-full justify-end"):
            ui.button(no, color=None, on_click=lambda: dialog.submit(False)).props("flat autofocus")
            ui.button(yes, on_click=lambda: dialog.submit(True)).props(f"color={colour}")
    return bool(await submitted(dialog))


async def asked(question: str, value: str) -> str | None:
    """What the user writes; None for a dialog closed without an answer.   value : there at first."""
    with ui.context.client.content:
        dialog = ui.dialog()
    with dialog, ui.card():
        field = ui.input(question, value=value).props("outlined autofocus").classes("w-72")
        field.on("keydown.enter", lambda: dialog.submit(field.value))
        with ui.row().classes("w-full justify-end"):
            ui.button("Cancel", color=None, on_click=dialog.close).props("flat")
            ui.button("Save", on_click=lambda: dialog.submit(field.value))
    answer = await submitted(dialog)
    return None if answer is None else str(answer)


async def submitted(dialog: ui.dialog) -> Any:
    """What the dialog submits; None when it, or the whole page, is closed."""
    value = await dialog
    if not dialog.is_deleted:
        dialog.delete()
    return value
