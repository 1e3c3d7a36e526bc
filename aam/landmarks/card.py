"""The TOML card that describes a landmark model.

The card says everything that is needed to feed the model and to read it::

    name = "pfld"                 # optional, for reports; the card's file name without it
    model = "pfld.onnx"           # path, relative to the card
    scheme = "ibug68"             # a landmark scheme: face81, ibug68
    sha256 = "64184e22..."        # optional; checked when there
    licence = "Apache-2.0"        # optional, free text
    source = "https://..."        # optional, free text

    [input]
    size = [112, 112]             # width, height in pixels
    colour = "rgb"                # rgb, bgr or gray; default rgb
    layout = "nchw"               # nchw or nhwc; default nchw
    mean = 0                      # value = (byte - mean) * scale, byte in 0..255;
    scale = 0.00392156862745098   # one number or one per channel; default: mean 0, scale 1/255

    [crop]
    enlarge = 1.1                 # square of this times the longer side of the landmarks' box; default 1
    upright = false               # turn the crop so that the outer eye corners are level; default false

    [output]
    name = "output"               # optional; the model's first output
    order = "interleaved"         # x y x y ... (default) or "split": x x ... y y ...
    unit = "fraction"             # of the crop, 0 to 1, or "pixels" of the input; default fraction

    [box.lbp]                     # optional, per detector: replaces the detector's own adjustment
    scale = 0.84                  # side of the landmarks' box / longer side of the detector's box
    shift = [0.0, 0.18]           # its centre, moved by these times that side, x right, y down

    [start]
    passes = 3                    # crops in all, from a detector's box on; default 3

The landmarks' box is the tight box of the scheme's own points. After a detection the first crop comes from
the detector's box, the next ones from the landmarks just found; to follow a face one pass is enough, from the
landmarks of the frame before. Pixels beyond the picture are black.

Pixels, x right, y down, pixel centres at integers: the fraction u of a crop that begins at x0 and is s wide
lies at x0 + u s. Paths are relative to the card.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from guise.aam.landmarks.face import BoxFit, LandmarkError
from guise.aam.landmarks.schemes import Scheme, scheme_named

_LAYOUTS = ("nchw", "nhwc")
_COLOURS = ("rgb", "bgr", "gray")
_ORDERS = ("interleaved", "split")
_UNITS = ("fraction", "pixels")
_KEYS: Mapping[str, tuple[str, ...]] = {
    "": ("name", "model", "scheme", "sha256", "licence", "source", "input", "crop", "output", "box", "start"),
    "input": ("size", "colour", "layout", "mean", "scale"),
    "crop": ("enlarge", "upright"),
    "output": ("name", "order", "unit"),
    "start": ("passes",),
}


@dataclass(frozen=True)
class Card:
    """What a TOML card says; see the module's text for the meaning of each field."""

    path: Path
    name: str
    model: Path
    scheme: Scheme
    size: tuple[int, int]
    sha256: str | None = None
    licence: str = ""
    source: str = ""
    colour: str = "rgb"
    layout: str = "nchw"
    mean: tuple[float, ...] = (0.0,)
    scale: tuple[float, ...] = (1 / 255,)
    enlarge: float = 1.0
    upright: bool = False
    output: str | None = None
    order: str = "interleaved"
    unit: str = "fraction"
    boxes: Mapping[str, BoxFit] | None = None
    passes: int = 3

    @property
    def channels(self) -> int:
        """Channels of the model's input."""
        return 1 if self.colour == "gray" else 3


def read_card(path: str | Path) -> Card:
    """The card in a TOML file; LandmarkError, in one sentence, for anything wrong in it."""
    path = Path(path)
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise LandmarkError(f"landmark card expected at {path}, got no such file") from error
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LandmarkError(
            f"landmark card {path} must be a readable TOML file, got: {first_line(error)}"
        ) from error
    return _CardReader(path, table).card()


class _CardReader:
    """Checks of a card's values; every failure names the file and the key."""

    def __init__(self, path: Path, table: dict[str, Any]) -> None:
        self.path = path
        self.table = table
        self._check_keys()

    def card(self) -> Card:
        """The checked card."""
        model = self.path.parent / self.text("", "model", None)
        colour = self.choice("input", "colour", _COLOURS)
        channels = 1 if colour == "gray" else 3
        return Card(
            path=self.path,
            name=self.text("", "name", self.path.stem),
            model=model,
            scheme=scheme_named(self.text("", "scheme", None)),
            size=self.size(),
            sha256=self.text("", "sha256", "") or None,
            licence=self.text("", "licence", ""),
            source=self.text("", "source", ""),
            colour=colour,
            layout=self.choice("input", "layout", _LAYOUTS),
            mean=self.numbers("input", "mean", 0.0, channels),
            scale=self.numbers("input", "scale", 1 / 255, channels),
            enlarge=self.positive("crop", "enlarge", 1.0),
            upright=self.flag("crop", "upright"),
            output=self.text("output", "name", "") or None,
            order=self.choice("output", "order", _ORDERS),
            unit=self.choice("output", "unit", _UNITS),
            boxes=self.boxes(),
            passes=self.passes(),
        )

    def text(self, section: str, key: str, default: str | None) -> str:
        """A string; without a default it must be there."""
        value = self.section(section).get(key, default)
        if not isinstance(value, str) or (default is None and not value):
            raise self.fault(section, key, "a text", value)
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
        if len(values) not in {1, channels} or not all(_is_number(v) for v in values):
            raise self.fault(section, key, f"one number or {channels}", value)
        return tuple(float(v) for v in values)

    def positive(self, section: str, key: str, default: float) -> float:
        """A number above 0."""
        value = self.section(section).get(key, default)
        if not _is_number(value) or not 0 < value < 1e6:
            raise self.fault(section, key, "a number above 0", value)
        return float(value)

    def flag(self, section: str, key: str) -> bool:
        """True or false, by default false."""
        value = self.section(section).get(key, False)
        if not isinstance(value, bool):
            raise self.fault(section, key, "true or false", value)
        return value

    def size(self) -> tuple[int, int]:
        """Width and height of the input."""
        value = self.section("input").get("size")
        if not isinstance(value, list) or len(value) != 2 or not all(_is_count(v, 4096) for v in value):
            raise self.fault("input", "size", "[width, height] in pixels", value)
        return value[0], value[1]

    def passes(self) -> int:
        """Passes from a detector's box."""
        value = self.section("start").get("passes", 3)
        if not _is_count(value, 20):
            raise self.fault("start", "passes", "a whole number from 1 to 20", value)
        return int(value)

    def boxes(self) -> dict[str, BoxFit]:
        """Adjustments per detector."""
        return {name: self.box_fit(name, entry) for name, entry in self.section("box").items()}

    def box_fit(self, name: str, entry: Any) -> BoxFit:
        """Adjustment for one detector."""
        if not isinstance(entry, dict) or set(entry) - {"scale", "shift"}:
            raise self.fault("box", name, "a table with scale and shift", entry)
        scale, shift = entry.get("scale", 1.0), entry.get("shift", [0.0, 0.0])
        if not _is_number(scale) or not scale > 0:
            raise self.fault("box", f"{name}.scale", "a number above 0", scale)
        if not isinstance(shift, list) or len(shift) != 2 or not all(_is_number(v) for v in shift):
            raise self.fault("box", f"{name}.shift", "[x, y]", shift)
        return BoxFit(float(scale), (float(shift[0]), float(shift[1])))

    def section(self, name: str) -> dict[str, Any]:
        """The table of that name; the card itself for an empty name."""
        value = self.table.get(name, {}) if name else self.table
        if not isinstance(value, dict):
            raise self.fault("", name, "a table", value)
        return value

    def fault(self, section: str, key: str, expected: str, got: Any) -> LandmarkError:
        """The error for one value."""
        name = f"{section}.{key}" if section else key
        return LandmarkError(f"landmark card {self.path}: {name} must be {expected}, got {_shown(got)}")

    def _check_keys(self) -> None:
        for section, known in _KEYS.items():
            unknown = sorted(set(self.section(section)) - set(known))
            if unknown:
                name = f"[{section}]" if section else "the top level"
                got = f"{', '.join(known)}, got unknown {', '.join(unknown)}"
                raise LandmarkError(f"landmark card {self.path}: {name} may have {got}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _is_count(value: Any, most: int) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= most


def _shown(value: Any) -> str:
    return "nothing" if value is None else repr(value)


def first_line(error: BaseException) -> str:
    """First line of an error's text."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
