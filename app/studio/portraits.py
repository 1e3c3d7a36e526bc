"""Faces to choose from, by their portraits."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from functools import partial

from nicegui import ui

from guise.app.studio.site import Studio


class Portraits:
    """A row of portraits, one of which is chosen.

    Parameters
    ----------
    faces : spec -> name, as `Studio.faces` gives them; "" stands for no certain face and has an icon instead.
    chosen : the spec chosen at first.   label : of the group.   choose : called with a spec that the user chooses.
    """

    def __init__(
        self, studio: Studio, faces: Mapping[str, str], chosen: str, label: str,
        choose: Callable[[str], Awaitable[None] | None], icon: str = "person",
    ) -> None:  # fmt: skip
        self._choose = choose
        self._buttons: dict[str, ui.button] = {}
        with ui.element("div").classes("faces").props("role=group") as group:
            group.props["aria-label"] = label
            for spec, name in faces.items():
                with ui.button(color=None, on_click=partial(self._clicked, spec)) as button:
                    button.props("outline padding=xs").classes("face").props["aria-label"] = name
                    with ui.column().classes("items-center gap-1 w-full"):
                        if spec:
                            ui.element("img").props('alt=""').props["src"] = studio.portrait(spec)
                        else:
                            ui.icon(icon, size="3rem").classes("none")
                        ui.label(name).classes("text-xs leading-tight break-words")
                self._buttons[spec] = button
        self.press(chosen)

    def press(self, chosen: str) -> None:
        """Show which one is chosen."""
        for spec, button in self._buttons.items():
            button.props["aria-pressed"] = "true" if spec == chosen else "false"
            button.update()

    async def _clicked(self, spec: str) -> None:
        self.press(spec)
        done = self._choose(spec)
        if done is not None:
            await done
