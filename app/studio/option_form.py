"""A form for all options of a command, with presets that have a name, which the command line reads, too."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin

from nicegui import ui

from guise.app.media import EncodeOptions
from guise.app.studio.site import advanced
from guise.app.studio.store import StudioError
from guise.common import presets
from guise.common.option import Option, option, options_of


@dataclass(frozen=True)
class EncodingOptions:
    """How a video is encoded, see `guise.app.media.EncodeOptions`."""

    crf: int | None = option(
        None,
        "Quality; lower is better and larger. Default: as fine as the input, from 15 to 20.",
        least=0,
        most=63,
    )
    encoder: str = option("auto", "Video encoder, such as libx264, libx265 or ffv1.")
    preset: str = option("veryfast", "Encoder preset, from ultrafast to veryslow.", name="--encoder-preset")
    lossless: bool = option(False, "Encode losslessly.")

    def options(self) -> EncodeOptions:
        """For the encoder."""
        return EncodeOptions(self.encoder, self.crf, self.preset, self.lossless)


NO_OPTIONS: Mapping[str, Any] = {}
FIRST = ("from", "to", "outside")  # in a form, before the others
T = TypeVar("T")


def called(name: str, told: Option) -> str:
    """An option on the command line, without hyphens.

    >>> called("keep_metadata", Option("")), called("start", Option("", "--from -f"))
    ('keep-metadata', 'from')
    """
    return (told.name or name.replace("_", "-")).split()[0].lstrip("-")


def taken(kind: type[T], values: Mapping[str, Any]) -> T:
    """A dataclass of options with these values, by their names on the command line; others keep their defaults.

    Raises StudioError for a value that an option does not take.
    """
    given = {}
    for name, (told, _, hint) in options_of(kind).items():
        if (value := values.get(called(name, told))) is not None:
            given[name] = _read(value, called(name, told), told, hint)
    return kind(**given)


def _read(value: Any, name: str, told: Option, hint: Any) -> Any:
    kind = _plain(hint)
    if get_origin(kind) is Literal:
        if value not in get_args(kind):
            raise StudioError(f"{name} is one of {', '.join(map(str, get_args(kind)))}, got {value}")
        return value
    if get_origin(kind) is tuple:
        return tuple(Path(one) for one in value)
    try:
        made = kind(value)
    except (TypeError, ValueError) as error:
        raise StudioError(f"{name} cannot be {value}") from error
    if isinstance(made, int | float) and not told.allows(made):
        raise StudioError(f"{name} must be {told.limits}, got {made:g}")
    return made


def _plain(hint: Any) -> Any:
    """A type without its None."""
    return (
        next(one for one in get_args(hint) if one is not type(None)) if isinstance(hint, UnionType) else hint
    )


class PresetChoice:
    """A choice among the presets of some commands, the first of which is read; what is set can be saved as one.

    values : gives what is set, by names of options.   use : called with the options of a preset, or none.
    """

    def __init__(
        self, commands: Sequence[str], values: Callable[[], dict[str, Any]],
        use: Callable[[dict[str, Any]], Awaitable[None] | None],
    ) -> None:  # fmt: skip
        self._commands, self._values, self._use = commands, values, use

    @ui.refreshable_method
    def build(self, chosen: str | None = None) -> None:
        """The choice, and what saves and deletes.   chosen : the preset that is shown."""
        with ui.row().classes("w-full items-center gap-2 mb-4"):
            choice = ui.select(
                presets.names(), label="Preset", value=chosen, on_change=lambda event: self._take(event.value)
            )
            choice.props("dense outlined clearable").classes("grow")
            name = ui.input("Name of a preset", value=chosen or "").props("dense outlined").classes("grow")
            ui.button("Save", icon="save", on_click=lambda: self._save(name.value)).props("outline")
            if chosen in presets.saved():
                remove = ui.button(icon="delete", color=None, on_click=partial(self._delete, str(chosen)))
                remove.props("flat round").props["aria-label"] = f"Delete the preset {chosen}"

    async def _take(self, name: str | None) -> None:
        done = self._use(presets.preset(name, self._commands[0]) if name else {})
        if done is not None:
            await done
        self.build.refresh(name)

    def _save(self, name: str) -> None:
        for command in self._commands:
            presets.save(name, command, self._values())
        self.build.refresh(presets.checked_name(name))
        ui.notify(f"Saved: guise {self._commands[0]} takes it with --preset.")

    def _delete(self, name: str) -> None:
        presets.delete(name)
        self.build.refresh(None)


class OptionForm:
    """The options of some dataclasses, folded away.   command : whose presets they are, such as "deidentify"."""

    def __init__(self, command: str, kinds: Sequence[type]) -> None:
        self._command, self._kinds = command, kinds
        found = [
            (called(name, told), told, field.default, hint)
            for kind in kinds
            for name, (told, field, hint) in options_of(kind).items()
        ]
        place = {name: order for order, name in enumerate(FIRST)}
        self._options = sorted(found, key=lambda one: place.get(one[0], len(FIRST)))
        self._values: dict[str, Any] = {}

    @property
    def values(self) -> dict[str, Any]:
        """What differs from the defaults, by name.   Raises StudioError for a value that an option does not take."""
        for kind in self._kinds:
            taken(kind, self._values)
        return dict(self._values)

    def build(self) -> None:
        """The presets, and a field for each option."""
        with advanced():
            PresetChoice([self._command], lambda: self.values, self._use).build()
            self._fields()

    def _use(self, given: dict[str, Any]) -> None:
        known = {name for name, *_ in self._options}
        self._values = {name: value for name, value in given.items() if name in known}
        self._fields.refresh()

    @ui.refreshable_method
    def _fields(self) -> None:
        with ui.element("div").classes("w-full grid gap-4 sm:grid-cols-2"):
            for name, told, default, hint in self._options:
                with ui.column().classes("gap-0"):
                    self._field(name, told, default, _plain(hint))

    def _field(self, name: str, told: Option, default: Any, kind: Any) -> None:
        label, value = name.replace("-", " ").capitalize(), self._values.get(name, default)
        field: Any
        if kind is bool:
            field = ui.switch(label, value=value)
        elif get_origin(kind) is Literal:
            field = ui.select(list(get_args(kind)), label=label, value=value)
        elif kind in (int, float):
            field = ui.number(
                label, value=value, min=told.least, max=told.most, step=1 if kind is int else 0.1
            )
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list | tuple) else str(value or "")
            field = ui.input(label, value=text, placeholder=told.metavar)
        field.classes("w-full").on_value_change(
            lambda event: self._set(name, event.value, default, several=get_origin(kind) is tuple)
        )
        if kind is not bool:
            field.props("dense outlined")
        ui.label(told.help).classes("opacity-70 text-caption")

    def _set(self, name: str, value: Any, default: Any, *, several: bool) -> None:
        if several:
            value = [part.strip() for part in value.split(",") if part.strip()]
        if value in (None, "", [], default):
            self._values.pop(name, None)
        else:
            self._values[name] = value
