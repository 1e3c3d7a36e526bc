"""Choose a file that was uploaded before, or upload one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from nicegui import ui

from guise.app.studio.dialogs import confirm
from guise.app.studio.site import Studio
from guise.app.studio.store import CLIP, Upload
from guise.app.studio.uploads import UploadKind, shown, uploader


class FilePicker:
    """A choice among the files of some kinds, with previews and an upload button.

    name : short.   label : what to choose.   several : more than one file can be chosen.
    changed : called when another choice was made.
    """

    def __init__(
        self, studio: Studio, name: str, label: str, kinds: Sequence[UploadKind], *, several: bool = False,
        changed: Callable[[], Any] = lambda: None,
    ) -> None:  # fmt: skip
        self._studio, self._kinds, self._several, self._changed = studio, kinds, several, changed
        with ui.column().classes("w-full min-w-0").props("role=group") as group:
            group.props["aria-label"] = name
            self._group = group
            self._select = ui.select({}, label=label, multiple=several, on_change=self._chose)
            self._select.props(
                "clearable outlined dense use-chips" if several else "clearable outlined dense"
            )
            self._select.classes("w-full").on("popup-show", lambda: self._offer())
            with ui.row().classes("w-full items-center no-wrap"):
                uploader(
                    studio,
                    "Choose",
                    lambda row: self._offer(row.id),
                    kinds,
                    several=several,
                    hint="Drop a file here",
                )
                remove = ui.button(icon="delete", color=None, on_click=self._remove).props("flat round")
                remove.props["aria-label"] = f"Delete the files chosen for {name}"
                remove.bind_visibility_from(self._select, "value", bool)
            self._offer()
            self._previews()

    @property
    def chosen(self) -> list[Upload]:
        """The chosen files that still exist."""
        rows = self._rows()
        ids = self._select.value if self._several else [self._select.value]
        return [rows[id] for id in ids or [] if id in rows]

    def _rows(self) -> dict[str, Upload]:
        return {row.id: row for kind in self._kinds for row in self._studio.store.uploads(kind.name)}

    def _offer(self, *added: str) -> None:
        """Offer all files there are now, uploaded here or elsewhere, and choose those that were added."""
        rows = self._rows()
        chosen = [row.id for row in self.chosen]
        chosen = [*chosen, *added] if self._several else [*added, *chosen]
        value = chosen if self._several else next(iter(chosen), None)
        self._select.set_options({id: row.name for id, row in rows.items()}, value=value)

    async def _chose(self) -> None:
        """Show what was chosen; the place for files is smaller then."""
        self._group.classes(**{"add" if self.chosen else "remove": "picked"})
        self._previews.refresh()
        if (then := self._changed()) is not None:
            await then

    @ui.refreshable_method
    def _previews(self) -> None:
        with ui.row().classes("w-full gap-2"):
            for row in self.chosen:
                if row.kind == CLIP:
                    shown(self._studio, row.path, f"The clip {row.name}").classes("h-32")
                else:
                    classes = "h-20 w-20" if self._several else "h-40 w-full"
                    picture = ui.image(self._studio.url(row.preview)).props("fit=contain no-transition")
                    picture.classes(classes).props["alt"] = row.name

    async def _remove(self) -> None:
        rows = self.chosen
        names = ", ".join(row.name for row in rows)
        if await confirm(f"Delete {names}? This cannot be undone.", "Delete", "Keep"):
            for row in rows:
                self._studio.store.remove_upload(row.id)
            self._offer()
