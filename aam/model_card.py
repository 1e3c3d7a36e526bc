"""TOML cards of ONNX models that the user brings: what the cards of all kinds of models say alike.

    name = "mobilefacenet"        # optional, for reports; the card's file name without it
    model = "mobilefacenet.onnx"  # path, relative to the card
    sha256 = "64184e22..."        # optional; checked when there
    licence = "Apache-2.0"        # optional, free text
    source = "https://..."        # optional, free text

    [input]
    size = [112, 112]             # width, height in pixels
    colour = "rgb"                # rgb, bgr, for some models gray; default rgb
    layout = "nchw"               # nchw or nhwc; default nchw
    mean = 127.5                  # value = (byte - mean) * scale, byte in 0..255;
    scale = 0.00784313725490196   # one number or one per channel; default: mean 0, scale 1/255

:mod:`guise.aam.onnx_model` runs a model as its card says.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeGuard

from guise.common.errors import GuiseError
from guise.common.text import first_line

LAYOUTS = ("nchw", "nhwc")
MAX_SIDE_PIXELS = 4096
KEYS = ("name", "model", "sha256", "licence", "source", "input")
INPUT_KEYS = ("size", "colour", "layout", "mean", "scale")


@dataclass(frozen=True, eq=False, kw_only=True)
class ModelCard:
    """What a card says; see the module's text for the meaning of each field.

    A kind of card adds its own fields, what it is called in messages, and its error.
    """

    kind: ClassVar[str] = "model"
    error: ClassVar[type[GuiseError]] = GuiseError
    colours: ClassVar[tuple[str, ...]] = ("rgb", "bgr")

    path: Path
    name: str
    model: Path
    size: tuple[int, int]
    sha256: str | None = None
    licence: str = ""
    source: str = ""
    colour: str = "rgb"
    layout: str = "nchw"
    mean: tuple[float, ...] = (0.0,)
    scale: tuple[float, ...] = (1 / 255,)

    @property
    def channels(self) -> int:
        """Channels of the model's input."""
        return 1 if self.colour == "gray" else 3


class CardReader:
    """Checks a card's values; every failure names the file and the key.

    Parameters
    ----------
    path : of the TOML file.
    card : the kind of card.
    keys : what it may hold besides the common keys, by section; "" for the top level.
    """

    def __init__(
        self, path: str | Path, card: type[ModelCard], keys: Mapping[str, Sequence[str]] = {}
    ) -> None:
        self.path, self._card = Path(path), card
        self._table = self._parsed()
        known = {"": (*KEYS, *(name for name in keys if name), *keys.get("", ())), "input": INPUT_KEYS}
        for section, names in {**keys, **known}.items():
            self._check_keys(section, names)

    def common(self) -> dict[str, Any]:
        """The fields of :class:`ModelCard`, checked."""
        colour = self.choice("input", "colour", self._card.colours)
        channels = 1 if colour == "gray" else 3
        return {
            "path": self.path,
            "name": self.text("", "name", self.path.stem),
            "model": self.path.parent / self.text("", "model", None),
            "size": self.size("input", "size"),
            "sha256": self.text("", "sha256", "").lower() or None,
            "licence": self.text("", "licence", ""),
            "source": self.text("", "source", ""),
            "colour": colour,
            "layout": self.choice("input", "layout", LAYOUTS),
            "mean": self.numbers("input", "mean", 0.0, channels),
            "scale": self.numbers("input", "scale", 1 / 255, channels),
        }

    def text(self, section: str, key: str, default: str | None) -> str:
        """A string; without a default it must be there."""
        value = self.section(section).get(key, default)
        if not isinstance(value, str) or (default is None and not value):
            raise self.fault(section, key, "a text", value or None)
        return value

    def choice(self, section: str, key: str, choices: tuple[str, ...]) -> str:
        """One of the choices; the first is the default."""
        value = self.section(section).get(key, choices[0])
        if value not in choices:
            raise self.fault(section, key, f"one of {', '.join(choices)}", value)
        return str(value)

    def numbers(self, section: str, key: str, default: float, channels: int) -> tuple[float, ...]:
        """One number, or one per channel."""
        value = self.section(section).get(key, default)
        values = value if isinstance(value, list) else [value]
        if len(values) not in {1, channels} or not all(is_number(v) for v in values):
            raise self.fault(section, key, f"one number or {channels}", value)
        return tuple(float(v) for v in values)

    def positive(self, section: str, key: str, default: float) -> float:
        """A number above 0."""
        value = self.section(section).get(key, default)
        if not is_number(value) or not 0 < value < 1e6:
            raise self.fault(section, key, "a number above 0", value)
        return float(value)

    def flag(self, section: str, key: str) -> bool:
        """True or false, by default false."""
        value = self.section(section).get(key, False)
        if not isinstance(value, bool):
            raise self.fault(section, key, "true or false", value)
        return value

    def count(self, section: str, key: str, default: int, most: int) -> int:
        """A whole number from 1."""
        value = self.section(section).get(key, default)
        if not _is_count(value, most):
            raise self.fault(section, key, f"a whole number from 1 to {most}", value)
        return int(value)

    def size(self, section: str, key: str) -> tuple[int, int]:
        """Width and height."""
        value = self.section(section).get(key)
        if not is_list(value, 2) or not all(_is_count(v, MAX_SIDE_PIXELS) for v in value):
            raise self.fault(section, key, "[width, height] in pixels", value)
        return value[0], value[1]

    def section(self, name: str) -> dict[str, Any]:
        """The table of that name; the card itself for an empty name."""
        value = self._table.get(name, {}) if name else self._table
        if not isinstance(value, dict):
            raise self.fault("", name, "a table", value)
        return value

    def fault(self, section: str, key: str, expected: str, got: Any) -> GuiseError:
        """The error for one value."""
        name = f"{section}.{key}" if section else key
        shown = "nothing" if got is None else repr(got)
        return self._error(f"{self.path}: {name} must be {expected}, got {shown}")

    def _parsed(self) -> dict[str, Any]:
        try:
            return tomllib.loads(self.path.read_text(encoding="utf-8"))
        except FileNotFoundError as error:
            raise self._error(f"expected at {self.path}, got no such file") from error
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise self._error(
                f"{self.path} must be a readable TOML file, got: {first_line(error)}"
            ) from error

    def _check_keys(self, section: str, known: Sequence[str]) -> None:
        unknown = sorted(set(self.section(section)) - set(known))
        if unknown:
            name = f"[{section}]" if section else "the top level"
            got = f"{', '.join(known)}, got unknown {', '.join(unknown)}"
            raise self._error(f"{self.path}: {name} may have {got}")

    def _error(self, text: str) -> GuiseError:
        return self._card.error(f"{self._card.kind} card {text}")


MAX_NUMBER = 1e30


def is_list(value: Any, length: int) -> TypeGuard[list[Any]]:
    """Whether a value of a card is a list of that length."""
    return isinstance(value, list) and len(value) == length


def is_number(value: Any) -> bool:
    """Whether a value of a card is a number, neither NaN nor beyond what float32 holds."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= MAX_NUMBER


def _is_count(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most
